// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "multiplier.h"
#include "pair.h"
#include "search.h"
#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Which derivatives to compute.
enum class Derivatives : std::int8_t
{
  none,
  gap,         ///< of the contact force and the weighted gap
  gap_and_slip ///< and of the weighted relative position
};

using RowMatrix
    = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// @brief Mortar integrals of one slave facet with all its masters.
///
/// n is the number of its nodes, m the number of different nodes of its
/// masters. Rows of nodes without multiplier are zero. Derivatives are with
/// respect to the positions of the n slave nodes, then of the m master nodes.
struct FacetIntegrals
{
  /// Displacement blocks of the m master nodes
  std::vector<std::int64_t> master_blocks;

  /// False where no master covers any part of the facet (nothing else is set)
  bool covered = false;

  /// True where masters cover the facet but none of its nodes carries a
  /// multiplier (then nothing else is set)
  bool orphan = false;

  /// Covered area, area left out as slivers
  double area = 0, dropped_area = 0;

  /// True where the gap of some point is below 5 % of the facet's diameter
  bool touches = false;

  /// ∫ Ñ_k over the covered part, shape (n)
  Eigen::VectorXd coverage;

  /// Diagonal of D̃ (dual spaces), shape (n)
  Eigen::VectorXd diagonal;

  /// D̃_jk = ∫ Φ_j Ñ_k and D_jk = ∫ Φ_j N_k (D = D̃ T⁻¹), shape (n, n)
  RowMatrix D_tilde, D;

  /// M_jl = ∫ Φ_j N_l∘P, shape (n, m)
  RowMatrix M;

  /// Weighted gap g̃_j = -∫ Φ_j n·(x⁽¹⁾ - x⁽²⁾∘P), shape (n)
  Eigen::VectorXd gap;

  /// Weighted relative position ∫ Φ_j (x⁽¹⁾ - x⁽²⁾∘P), shape (n, 3)
  RowMatrix offset;

  /// Derivative of the contact force Bᵀz, B = [D, -M], with z fixed, shape
  /// (3 (n + m), 3 (n + m))
  RowMatrix d_force;

  /// Derivative of the weighted gap with fixed nodal normals, shape (n, 3 (n +
  /// m)), and with respect to the nodal normals, shape (n, 3 n)
  RowMatrix d_gap, d_gap_normal;

  /// Derivative of `offset`, shape (3 n, 3 (n + m))
  RowMatrix d_offset;
};

/// @brief Computes the mortar integrals of one slave facet after the other.
///
/// Dual functions are built on the covered part of the facet, with the same
/// quadrature points as everything else: A_e = D_e M_e⁻¹, D_e = diag ∫ Ñ_k,
/// M_e = ∫ Ñ_j Ñ_k. They are biorthogonal to round-off for any quadrature and
/// any overlap, and their derivatives include master positions.
class FacetIntegrator
{
public:
  explicit FacetIntegrator(const IntegrationOptions& options);

  /// @brief Integrate over one slave facet.
  ///
  /// @param[in] slave Slave facet.
  /// @param[in] normals Averaged normals of its nodes, shape (n, 3).
  /// @param[in] carries Non-zero for nodes that carry a multiplier, shape (n).
  /// The functions Φ of the other multiplier nodes of the space are shared
  /// equally among those.
  /// @param[in] positive Flags of nodes for the basis transformation, see
  /// transformation; shape (n) or empty.
  /// @param[in] z Nodal multipliers, shape (n, 3); used for derivatives only.
  /// @param[in] list Facets that `masters` refers to.
  /// @param[in] masters Candidate master facets.
  /// @param[in] derivatives Derivatives to compute.
  /// @return Integrals, valid until the next call.
  /// @throw std::runtime_error The facet is folded.
  const FacetIntegrals&
  compute(const FacetView& slave, std::span<const double> normals,
          std::span<const std::int8_t> carries,
          std::span<const std::int8_t> positive, std::span<const double> z,
          const FacetList& list, std::span<const std::int32_t> masters,
          Derivatives derivatives);

private:
  /// Rule for a pair, made once
  const QuadratureRule& rule(FacetType slave, FacetType master);

  /// Shape functions at the points of a pair, one row for each point
  struct PairShapes
  {
    RowMatrix N, Nt; // slave functions N and Ñ
    std::array<RowMatrix, 2> dN, dNt;
    RowMatrix Nm; // master functions
    std::array<RowMatrix, 2> dNm;
    RowMatrix field;                 // gap and offset, shape (num_points, 4)
    std::array<RowMatrix, 4> dfield; // ∂/∂ξ₁, ∂/∂ξ₂, ∂/∂η₁, ∂/∂η₂
    RowMatrix normal;                // unit normal, shape (num_points, 3)
    RowMatrix gap_normal;            // ∂gap/∂(Σ N_k n_k), shape (num_points, 3)
  };

  void tabulate_pair(const FacetView& slave, const FacetView& master,
                     std::span<const double> normals, const FacetMatrix& T,
                     bool derivatives, const PairPoints& points,
                     PairShapes& shapes) const;

  IntegrationOptions _options;
  std::map<std::array<int, 3>, QuadratureRule> _rules;
  std::vector<PairPoints> _points;
  std::vector<PairShapes> _shapes;
  FacetIntegrals _result;
};
} // namespace dolfinx_mortar
