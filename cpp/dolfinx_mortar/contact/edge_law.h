// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <Eigen/Dense>
#include <array>
#include <optional>

namespace dolfinx_mortar
{
/// @brief What the law of friction needs to know of one of the two patches
/// that a node on an edge is in contact on.
struct PatchState
{
  /// Multiplier [traction], unit normal, and weighted slip w = B x - B_old x
  Eigen::Vector3d z, n, w;

  /// Weighted gap
  double gap;

  /// Complementarity parameters, traction per weighted gap
  double c_n, c_t;

  /// Scale of the tangential equation [traction]
  double sigma;
};

/// @brief Residual of both patches and its derivatives.
struct EdgeResidual
{
  /// Residual of each patch
  std::array<Eigen::Vector3d, 2> value;

  /// True where the node sticks
  bool stick;

  /// max(b, |t|) of each patch
  std::array<double, 2> bound;

  /// Derivatives of patch i by the values of patch j, `[i][j]`
  std::array<std::array<Eigen::Matrix3d, 2>, 2> dz, dn, dw;
  std::array<std::array<Eigen::Vector3d, 2>, 2> dg;
};

/// @brief Contact with friction at a node on an edge, closed on both patches.
///
/// Both gaps together leave the node the direction e = n₁ × n₂ / |n₁ × n₂| to
/// move in, and one law of friction with it. It is that of the patch l with the
/// larger bound b; the traction of the other one is in proportion to its bound,
/// as it is anyway where both slide:
///
///     patch l:  C_τ = e f(z_l·e, u_l·e) + (e × n_l) (z_l·(e × n_l))
///     patch k:  C_τ = e (z_k - b_k/b_l z_l)·e + (e × n_k) (z_k·(e × n_k))
///     stick (|t| < b):  f = -b c_t u / σ        t = z + c_t u
///     slip  (|t| ≥ b):  f = (|t| z - b t) / σ
///
/// So the node sticks if the patch with the larger bound sticks, and its
/// friction is at most μ times the sum of both normal forces.
///
/// @param[in] patches Values of both patches; normals must not be parallel.
/// @param[in] coefficient Coulomb's μ.
/// @param[in] bound Tresca's bound, instead of μ (z_n - c_n g̃).
/// @param[in] forced Whether the node sticks, instead of what follows from the
/// values.
/// @param[in] damped See contact_residual.
EdgeResidual edge_residual(const std::array<PatchState, 2>& patches,
                           double coefficient, std::optional<double> bound,
                           std::optional<bool> forced, bool damped);
} // namespace dolfinx_mortar
