// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "options.h"
#include <Eigen/Dense>
#include <cstdint>
#include <dolfinx_mortar/geometry/facet.h>
#include <span>

namespace dolfinx_mortar
{
/// Dense matrix of a facet.
using FacetMatrix
    = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor,
                    max_facet_nodes, max_facet_nodes>;

/// @brief Number of nodes of a facet that have multipliers; these come first.
int num_multipliers(MultiplierSpace space, FacetType type);

/// @brief True where the multiplier functions are biorthogonal to Ñ.
constexpr bool is_dual(MultiplierSpace space)
{
  return space != MultiplierSpace::standard;
}

/// @brief True where the multiplier functions are made of the (bi)linear
/// functions ψ of the corners: Φ = D_e G_e⁻¹ ψ with G_e = ∫ ψ_c Ñ_k.
constexpr bool is_reproducing(MultiplierSpace space, FacetType type)
{
  return space == MultiplierSpace::dual_reproducing
         and (type == FacetType::tri6 or type == FacetType::quad8);
}

/// @brief Basis transformation of a facet, Ñᵀ = Nᵀ T (equations 4.5, 4.13).
///
/// - dual: Ñ_c = N_c + Σ_{e∋c} α_e N_e, Ñ_e = (1 - 2 α_e) N_e, with α = 1/12 on
///   tri6, 1/5 on quad8 and T = I elsewhere. Any α above 0 (tri6) or 1/8
///   (quad8) makes ∫ Ñ_c positive; these put the centroid of Ñ_c on its node,
///   so that corners reproduce linear tractions;
/// - dual-linear, and standard on tri6 and quad8: Ñ_c = N_c + ½ Σ_{e∋c} N_e
///   (+ ¼ N_centre), Ñ_e = N_e;
/// - dual-reproducing on tri6 and quad8: the corner functions of dual, and
///   Ñ_e = N_e. On affine facets these α, and no others, let Φ = D_e G_e⁻¹ ψ
///   reproduce linear tractions.
///
/// Where a master covers only a part of a facet, ∫ Ñ_k over this part can be
/// negative, and a weighted gap would have the wrong sign. Edges (and centres)
/// flagged as `nonnegative` get α = 3/8 on tri6 and quad8, and Bernstein's
/// functions (α = 1/4, centre ¼ N, its shares 1/16 and 1/8) on quad9: the Ñ of
/// a facet all of whose edges are flagged are nowhere negative, and still add
/// up to one. The space dual-reproducing has α = ½ at flagged edges: Ñ_c = ψ_c
/// where all edges of a facet are.
///
/// T depends on connectivity and flags alone: entries of nodes shared by facets
/// agree.
/// @param[in] nonnegative Flags of the nodes of the facet, or empty; those of
/// corners do not matter.
/// @return T, shape (num_nodes, num_nodes).
FacetMatrix transformation(MultiplierSpace space, FacetType type,
                           std::span<const std::int8_t> nonnegative = {});

/// @brief Inverse of the basis transformation, d̃ = T⁻¹ d (equations 4.6,
/// 4.14); exact.
FacetMatrix inverse_transformation(MultiplierSpace space, FacetType type,
                                   std::span<const std::int8_t> nonnegative
                                   = {});

/// @brief True where no Ñ of a multiplier node has a negative value on a facet
/// with these flags; outside of the reference facet it may have.
bool is_nonnegative(MultiplierSpace space, FacetType type,
                    std::span<const std::int8_t> nonnegative);

/// @brief Matrix with a positive diagonal, factorised with this scaled to one
/// (mass matrices of barely covered facets are close to singular).
class ScaledFactors
{
public:
  /// @param[in] M Matrix.
  /// @param[in] symmetric It is symmetric, and must be positive definite.
  /// @return False where a symmetric matrix is not positive definite to working
  /// precision, and where another one has a pivot below 1e-3 of the diagonal.
  bool compute(const FacetMatrix& M, bool symmetric);

  /// @brief Solve M X = B in place.
  template <typename Derived>
  void solve(Eigen::MatrixBase<Derived>& B) const
  {
    B.array().colwise() *= _scale.array();
    if (_symmetric)
      _llt.solveInPlace(B);
    else
      B.derived() = _lu.solve(B.derived()).eval();
    B.array().colwise() *= _scale.array();
  }

  /// @brief Solve Mᵀ X = B in place.
  template <typename Derived>
  void solve_transposed(Eigen::MatrixBase<Derived>& B) const
  {
    if (_symmetric)
      return solve(B);
    B.array().colwise() *= _scale.array();
    B.derived() = _lu.transpose().solve(B.derived()).eval();
    B.array().colwise() *= _scale.array();
  }

private:
  bool _symmetric = true;
  Eigen::Matrix<double, Eigen::Dynamic, 1, 0, max_facet_nodes, 1> _scale;
  Eigen::LLT<FacetMatrix> _llt;
  Eigen::PartialPivLU<FacetMatrix> _lu;
};
} // namespace dolfinx_mortar
