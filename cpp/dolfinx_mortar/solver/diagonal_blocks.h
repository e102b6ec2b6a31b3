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
/// node, and one of several nodes together.
class DiagonalBlocks
{
public:
  /// @param[in] A Operator.
  /// @param[in] together Owned nodes that share a block.
  DiagonalBlocks(const ReducedOperator& A,
                 std::span<const std::int32_t> together);

  /// @brief Product y of the inverses and x.
  void apply(Vec x, Vec y) const;

private:
  std::vector<Eigen::Matrix3d> _inverse;
  std::vector<std::int32_t> _dofs; // of the nodes that share a block
  Matrix _shared;
  PetscHandle<PC, PCDestroy> _factor;
};
} // namespace dolfinx_mortar
