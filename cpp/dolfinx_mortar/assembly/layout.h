// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <cstdint>
#include <mpi.h>
#include <numeric>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Where the displacement dofs of several bodies are in the vectors of a
/// coupled problem.
///
/// A *block* is the three components of a node, dof = 3 * block + component.
/// The part of a rank is [body 0 owned, body 1 owned, ...]. *Local* values are
/// [body 0 owned, body 0 ghosts, body 1 owned, ...].
struct Layout
{
  /// Communicator of all matrices and vectors
  MPI_Comm comm = MPI_COMM_NULL;

  /// For each body the number of each local (owned and ghost) block
  std::vector<std::vector<std::int64_t>> blocks;

  /// Number of owned, and of local blocks of each body
  std::vector<std::int32_t> num_owned, num_local;

  /// First block of this rank
  std::int64_t first_block = 0;

  /// Reference positions of the local blocks, shape (n, 3)
  std::vector<double> X;

  /// Connected part of the meshes that each local block is on; one mesh may
  /// hold several disconnected bodies
  std::vector<std::int32_t> parts;

  /// Number of such parts on all ranks
  std::int32_t num_parts = 0;

  /// Mean cell size of each body [length]
  std::vector<double> cell_sizes;

  /// Number of bodies
  std::size_t num_bodies() const { return blocks.size(); }

  /// Number of owned blocks of all bodies
  std::int32_t num_blocks() const
  {
    return std::accumulate(num_owned.begin(), num_owned.end(), 0);
  }

  /// Number of local blocks of all bodies
  std::int32_t num_local_blocks() const
  {
    return std::accumulate(num_local.begin(), num_local.end(), 0);
  }

  /// Number of displacement dofs of this rank
  std::int32_t size() const { return 3 * num_blocks(); }

  /// First of a body's owned blocks among those of this rank
  std::int32_t owned_start(std::size_t body) const
  {
    return std::accumulate(num_owned.begin(), num_owned.begin() + body, 0);
  }

  /// First of a body's local blocks among the local ones of all bodies
  std::int32_t local_start(std::size_t body) const
  {
    return std::accumulate(num_local.begin(), num_local.begin() + body, 0);
  }

  /// Values of the owned blocks among those of local ones.
  /// @param[in] local Shape (num_local_blocks, bs).
  /// @return Shape (num_blocks, bs).
  template <typename T>
  std::vector<T> owned(const std::vector<T>& local, int bs) const
  {
    std::vector<T> values;
    values.reserve(bs * num_blocks());
    for (std::size_t b = 0; b < num_bodies(); ++b)
    {
      auto begin = local.begin() + bs * local_start(b);
      values.insert(values.end(), begin, begin + bs * num_owned[b]);
    }
    return values;
  }
};
} // namespace dolfinx_mortar
