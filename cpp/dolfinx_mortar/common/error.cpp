// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "error.h"
#include <sstream>
#include <stdexcept>

//-----------------------------------------------------------------------------
void dolfinx_mortar::throw_on_all(MPI_Comm comm, const std::string& message)
{
  int rank, size;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &size);
  const int candidate = message.empty() ? size : rank;
  int root;
  MPI_Allreduce(&candidate, &root, 1, MPI_INT, MPI_MIN, comm);
  if (root == size)
    return;

  std::string text = message;
  int length = text.size();
  MPI_Bcast(&length, 1, MPI_INT, root, comm);
  text.resize(length);
  MPI_Bcast(text.data(), length, MPI_CHAR, root, comm);
  throw std::runtime_error(text);
}
//-----------------------------------------------------------------------------
std::string dolfinx_mortar::to_string(std::span<const double, 3> x)
{
  std::ostringstream s;
  s << "(" << x[0] << ", " << x[1] << ", " << x[2] << ")";
  return s.str();
}
