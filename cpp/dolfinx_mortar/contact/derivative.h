// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "evaluation.h"
#include <dolfinx_mortar/assembly/blocks.h>

namespace dolfinx_mortar
{
/// @brief Derivatives of contacts by displacements, to be added to.
///
/// Constraints C depend on weighted gaps g, normals n and weighted slips w,
///
///     C_u = W_g ∂g/∂u + W_w ∂w/∂u + (W_g ∂g/∂n + W_n) ∂n/∂u.
///
/// The first part is added facet by facet; what is in brackets is kept, and so
/// is ∂n/∂u, which reaches around all facets of a node.
struct ContactDerivatives
{
  /// First part of C_u; multipliers by displacements
  BlockAccumulator<3, 3> constraints;

  /// What is in brackets; multipliers by multipliers (their nodes' normals)
  BlockAccumulator<3, 3> by_normals;

  /// ∂n/∂u; multipliers by displacements
  BlockAccumulator<3, 3> normals;

  /// ∂(Bᵀz)/∂u with z fixed; displacements by displacements
  BlockAccumulator<3, 3> force;
};

/// @brief Add the derivatives of a contact that moves with its bodies.
/// Collective.
/// @param[in] interface,basis,configuration See integrate.
/// @param[in] law Contact conditions of the owned nodes.
/// @param[in] with_slip The conditions depend on the slip.
/// @param[in] z Multipliers of the local slave nodes, shape (n, 3).
/// @param[in,out] derivatives Derivatives to add to.
void add_current_derivatives(const Interface& interface, const Basis& basis,
                             const Configuration& configuration,
                             const ContactResidual& law, bool with_slip,
                             std::span<const double> z,
                             ContactDerivatives& derivatives);

/// @brief Add what the rows of the mortar matrix B of a contact's owned nodes
/// contribute to the derivatives.
///
/// With current geometry slips are w = jump - B_old x; with frozen geometry
/// gaps are g - n·B u, and slips B (u_old - u).
/// @param[in] interface Interface.
/// @param[in] configuration Its configuration.
/// @param[in] law Contact conditions of the owned nodes.
/// @param[in] by_gap,by_slip Take the part of gaps, and of slips.
/// @param[in] B B_old, or B where geometry is frozen; multipliers by
/// displacements.
/// @param[in,out] derivatives Derivatives to add to.
void add_matrix_derivatives(const Interface& interface,
                            const Configuration& configuration,
                            const ContactResidual& law, bool by_gap,
                            bool by_slip, Mat B,
                            ContactDerivatives& derivatives);
} // namespace dolfinx_mortar
