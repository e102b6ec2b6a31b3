// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "reduced_operator.h"
#include <Eigen/Dense>
#include <cstdint>
#include <span>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Inverses of blocks at the diagonal of an operator: one of each owned
/// node, and one of several nodes of all ranks together.
class DiagonalBlocks
{
public:
  /// @brief Collective.
  /// @param[in] comm Communicator.
  /// @param[in] A Operator.
  /// @param[in] together Owned dofs, ascending and none of them prescribed,
  /// that share a block with those of other ranks.
  DiagonalBlocks(MPI_Comm comm, const ReducedOperator& A,
                 std::span<const std::int32_t> together);

  /// @brief Product y of the inverses and x. Collective.
  void apply(Vec x, Vec y) const;

private:
  std::vector<Eigen::Matrix3d> _inverse;
  std::vector<std::int32_t> _together;
  PetscHandle<PC, PCDestroy> _factor; // null where nothing shares a block
  Vector _right, _solution;
};
} // namespace dolfinx_mortar
