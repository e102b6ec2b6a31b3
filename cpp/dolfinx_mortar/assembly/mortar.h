// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "blocks.h"
#include "interface.h"

namespace dolfinx_mortar
{
/// @brief Nodal values that the integrals leave on the slave nodes; local nodes
/// with ghosts up to date.
struct NodalIntegrals
{
  /// ∫ Ñ_j over the part of the surface that a master covers, shape (n)
  std::vector<double> coverage;

  /// ∫ Ñ_j n⁽²⁾ with the unit outward normals of the masters' facets: the way
  /// the master faces there, shape (n, 3)
  std::vector<double> master_normal;

  /// Diagonal of D̃ for dual multipliers, shape (n)
  std::vector<double> diagonal;

  /// ∫ Φ_j, the row sums of D and of M, shape (n)
  std::vector<double> weight;

  /// Weighted gap g̃_j, shape (n)
  std::vector<double> gap;

  /// Weighted relative position ∫ Φ_j (x⁽¹⁾ - x⁽²⁾∘P), shape (n, 3)
  std::vector<double> jump;

  /// Covered area, and area of overlaps left out (see PairPoints), of the
  /// facets of this rank
  double area = 0, dropped_area = 0;

  /// Share of each facet of this rank that is left out and that no other master
  /// covers, shape (num_facets)
  std::vector<double> lost;

  /// Share of the parts of each facet of this rank that face the masters that
  /// lies beyond the edge of these, shape (num_facets)
  std::vector<double> beyond;

  /// Non-zero for nodes around which some point is nearly in contact. The
  /// weighted gap of other nodes can be negative all the same, as Φ is in
  /// places; that is no contact. Shape (n)
  std::vector<std::int8_t> near;

  /// Mean gap over the covered parts of the facets around each node, zero where
  /// there are none: no penetration can come from functions that are negative
  /// in places. Shape (n)
  std::vector<double> distance;

  /// Covered area of each facet of this rank, shape (num_facets)
  std::vector<double> facet_area;

  /// Smallest gap at the points of each facet of this rank, zero where no
  /// master covers it; shape (num_facets)
  std::vector<double> nearest;

  /// Number of facets of this rank that some master covers, of pairs and of
  /// quadrature points
  std::int64_t num_covered = 0, num_pairs = 0, num_points = 0;

  /// Covered facets none of whose nodes carries a multiplier (left out), and
  /// the midpoint of the first of them
  std::int64_t num_without_multipliers = 0;
  std::array<double, 3> without_multipliers = {0, 0, 0};
};

/// @brief Mortar matrices to add to, of one interface or of several; null for
/// those not wanted. Rows are multipliers, columns displacements.
struct MortarBlocks
{
  /// D_jk = ∫ Φ_j N_k and M_jl = ∫ Φ_j N_l∘P (equations 3.5, 3.6)
  BlockAccumulator<1, 1>*D = nullptr, *M = nullptr;

  /// B = [D, -M] (equation 3.4)
  BlockAccumulator<1, 1>* B = nullptr;

  /// B with its slave columns in the transformed basis, [D̃, -M] = B T
  BlockAccumulator<1, 1>* B_tilde = nullptr;
};

/// @brief Integrate the nodal values of an interface, and add its mortar
/// matrices. Collective.
///
/// @param[in] interface Interface.
/// @param[in] basis Which nodes carry multipliers, and the basis there.
/// @param[in] configuration Positions, normals and candidate pairs.
/// @param[in] blocks Where to add D, M, B and B̃.
/// @throw std::runtime_error On all ranks, see FacetIntegrator::compute.
NodalIntegrals integrate(const Interface& interface, const Basis& basis,
                         const Configuration& configuration,
                         const MortarBlocks& blocks = {});
} // namespace dolfinx_mortar
