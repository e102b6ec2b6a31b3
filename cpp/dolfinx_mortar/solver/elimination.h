// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "newton_system.h"

namespace dolfinx_mortar
{
/// @brief Elimination of the active multipliers, node by node.
///
/// With ρ = Tᵀ (r_u - K du) at a slave node, D̃_p the entries of D̃ of its active
/// multipliers z_p and c = r_z - C_u du the constraints, the multipliers of the
/// node satisfy
///
///     Σ_p D̃_p dz_p = ρ,    C_z dz = c.
///
/// A node has one multiplier, and more only where it is in contact on several
/// patches at an edge. With one, dz = ρ / D̃, and what is left for du is c - C_z
/// D̃⁻¹ ρ = 0. In general
///
///     dz = L ρ + L_c c,    G c - H ρ = 0
///
/// where [L_c, L] is a left inverse of the matrix of the equations above, and
/// [G, -H] spans its left null space. All of it is local to the nodes.
struct Elimination
{
  /// Displacement by multiplier, displacement by displacement, multiplier by
  /// displacement dofs
  Matrix G, H, L;

  /// Multiplier by multiplier dofs; null where no node has several multipliers
  Matrix L_c;

  /// Entries of B̃ᵀ at the multipliers' own dofs: displacement by multiplier
  Matrix D;

  /// du = - solve_constraints B̃ du satisfies the constraints at their own
  /// dofs, as far as these are constraints on displacements
  Matrix solve_constraints;

  /// Projection of the displacements of each owned block on the directions of
  /// the constraints
  std::vector<Eigen::Matrix3d> constrained;

  /// Sum of D̃ over the multipliers at each displacement dof, zero at others
  std::vector<double> weight;

  /// Non-zero for displacement dofs whose rows are those of constraints
  std::vector<std::int8_t> own;
};

/// @brief Eliminate the active multipliers. Collective.
/// @param[in] comm Communicator.
/// @param[in] nodes Multiplier nodes.
/// @param[in] size_u Number of displacement dofs of this rank.
/// @throw ConvergenceError On all ranks, where D̃ of an active node is zero.
Elimination eliminate(MPI_Comm comm, const MultiplierNodes& nodes,
                      std::int32_t size_u);
} // namespace dolfinx_mortar
