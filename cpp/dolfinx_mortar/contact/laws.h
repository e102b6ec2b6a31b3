// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace dolfinx_mortar
{
/// @brief State of a slave node.
enum class Status : std::int8_t
{
  open = 0,  ///< no contact
  stick = 1, ///< contact without slip
  slip = 2   ///< contact with slip, frictionless contact included
};

/// @brief Tangential behaviour.
struct Friction
{
  /// Coulomb's coefficient μ
  double coefficient = 0;

  /// Tresca: given bound of the tangential traction, instead of μ z_n
  std::optional<double> bound;
};

/// @brief Nodal values that contact laws depend on; one entry, or row, per
/// node.
struct ContactState
{
  /// Multipliers, shape (n, 3)
  std::span<const double> z;

  /// Unit normals, shape (n, 3)
  std::span<const double> normal;

  /// Weighted gaps g̃, shape (n)
  std::span<const double> gap;

  /// Weighted slip w = B x - B_old x of the master since the last accepted
  /// step, shape (n, 3); slip increment ũ_τ = -(I - n nᵀ) w. May be empty
  /// without friction.
  std::span<const double> weighted_slip;

  /// Scale σ of the tangential equation (traction), shape (n); may be empty
  /// without friction
  std::span<const double> scale;

  /// Complementarity parameters, traction per weighted gap, shape (n)
  std::span<const double> c_n, c_t;

  /// Non-zero for nodes that carry a multiplier, shape (n)
  std::span<const std::int8_t> has_multiplier;

  /// Non-zero for components whose displacement is prescribed, shape (n, 3)
  std::span<const std::int8_t> fixed;

  /// Non-zero for open nodes that can close, see NodalIntegrals; empty where
  /// all can
  std::span<const std::int8_t> near;

  /// Displacement block of each node, shape (n). Nodes of one block are
  /// consecutive: one node for each smooth patch that meets there, see
  /// split_at_edges. Empty where no two have the same
  std::span<const std::int64_t> blocks;
};

/// @brief Derivatives of the residual of a node by the values of another node
/// of the same block (friction on edges); row-major blocks.
struct ContactCouplings
{
  /// Node whose residual, and node whose values, shape (m)
  std::vector<std::int32_t> rows, columns;

  /// ∂C/∂z, ∂C/∂n, ∂C/∂w, shapes (m, 3, 3), and ∂C/∂g̃, shape (m, 3)
  std::vector<double> dz, dn, dw, dg;
};

/// @brief Complementarity function and its derivatives; row-major blocks.
struct ContactResidual
{
  std::vector<Status> status;

  /// Residual C = n C_n + C_τ, shape (n, 3)
  std::vector<double> value;

  /// max(b, ‖t‖) of nodes in frictional contact, else zero, shape (n)
  std::vector<double> bound;

  /// ∂C/∂z, ∂C/∂n, ∂C/∂w, shapes (n, 3, 3), and ∂C/∂g̃, shape (n, 3)
  std::vector<double> dz, dn, dw, dg;

  /// Derivatives by the values of other nodes
  ContactCouplings couplings;
};

/// @brief Contact conditions as a semi-smooth equation (equation 5.1 and
/// Coulomb's or Tresca's law).
///
/// With p = z_n - c_n g̃ and the trial traction t = z_τ + c_t ũ_τ
///
///     open   (p ≤ 0):      C = z
///     closed:              C = n c_n g̃ + C_τ
///     no friction:         C_τ = z_τ
///     slip   (‖t‖ ≥ b):    C_τ = (‖t‖ z_τ - b t) / σ
///     stick  (‖t‖ < b):    C_τ = (b z_τ - b t) / σ
///
/// where b = μ p (Coulomb) or the given bound (Tresca): C_τ is (max(b, ‖t‖) z_τ
/// - b t) / σ. The constant σ sets the scale of the equation and nothing else:
/// max(b, ‖t‖) of the last iterate makes it a traction. (With the divisor
/// max(b, ‖t‖) differentiated as well Newton's method often diverges.)
///
/// A node on an edge can be in contact on several patches, each with its own
/// condition on the gap. It has contact on three at most, those that are
/// pressed most, and not on two with nearly parallel normals: it could not
/// satisfy both. Friction there acts along the edge of two patches, see
/// edge_residual; on three a node cannot slide, and has no friction.
///
/// @param[in] state Nodal values.
/// @param[in] friction Tangential behaviour.
/// @param[in] forced If not empty: states to use instead of those that follow
/// from the values, shape (n).
/// @param[in] damped Change the derivative of slipping nodes whose traction
/// reaches beyond the cone, z_τ·t ≥ b ‖t‖, by putting the projection b t / ‖t‖
/// in place of z_τ (in the spirit of Hüeber, Stadler and Wohlmuth 2008), of
/// sticking nodes by leaving out the change of the bound, and of nodes with a
/// gap as if the equations were written in components along the turning
/// normal. That is no derivative any more but leads Newton's method to the
/// solution, where both agree, from further away.
ContactResidual contact_residual(const ContactState& state,
                                 const Friction& friction,
                                 std::span<const Status> forced,
                                 bool damped = false);
} // namespace dolfinx_mortar
