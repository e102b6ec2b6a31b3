// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "unused_memory.h"
#include <cstddef>
#include <mpi.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif

#ifdef __GLIBC__
namespace
{
/// Memory [B] of all ranks that is not worth it: what has been given back comes
/// again page by page, which took a fifth of the time of a solve of 80 000
/// unknowns.
constexpr std::size_t least = 512'000'000;

/// Memory [B] of the heap that nothing is in.
std::size_t unused()
{
#if __GLIBC_PREREQ(2, 33)
  return mallinfo2().fordblks;
#else
  return least;
#endif
}
} // namespace
#endif

//-----------------------------------------------------------------------------
void dolfinx_mortar::give_back_memory()
{
#ifdef __GLIBC__
  int num_ranks;
  MPI_Comm_size(MPI_COMM_WORLD, &num_ranks);
  if (unused() >= least / num_ranks)
    malloc_trim(0);
#endif
}
