// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <cstdint>
#include <optional>

namespace dolfinx_mortar
{
/// @brief Spaces of Lagrange multipliers λ_h = Σ Φ_j z_j.
///
/// - standard: Φ = N at all nodes of tri3, quad4 and quad9, (bi)linear
///   functions at the corners of tri6 and quad8;
/// - dual: at all nodes, dual to the transformed functions Ñ;
/// - dual_linear: at the corners, dual to the (bi)linear corner functions;
/// - dual_reproducing: on tri6 and quad8 at the corners, made of the (bi)linear
///   corner functions, so that linear tractions are reproduced, and
///   biorthogonal to the transformed functions of the corners (the dual bases
///   of lower dimension of Lamichhane, Stevenson and Wohlmuth,
///   doi:10.1007/s00211-005-0636-z); dual elsewhere.
enum class MultiplierSpace : std::int8_t
{
  standard,
  dual,
  dual_linear,
  dual_reproducing
};

/// @brief How the overlap of the surfaces is integrated.
enum class Integration : std::int8_t
{
  segment, ///< on the clipped overlap of each pair of facets
  element  ///< at points of the slave facet, projected on the nearest master
};

/// @brief Options of the mortar integrals.
struct IntegrationOptions
{
  MultiplierSpace space = MultiplierSpace::dual;
  Integration integration = Integration::segment;

  /// Degree of quadrature, by default default_degree
  std::optional<int> degree;

  /// Largest angle [degrees] between the normal of a (linear part of a) slave
  /// facet and that of a master, turned round; steeper masters are left out.
  /// A curved facet and its linear parts are apart by some height, and points
  /// projected along the slave's normal by the tangent of the angle times that:
  /// 2.7 times at 70 degrees, 57 times at 89
  double max_angle = 70;

  /// Leave out slave facets that are nowhere nearer to a master than
  /// `distance`. Otherwise facets at the end of what the search reaches are
  /// covered in part, and nodes that are far from contact can get the weighted
  /// gap of a penetration.
  bool leave_distant = false;

  /// Search distance (a length), by default the larger diameter of the two
  /// facets of a pair
  std::optional<double> distance;
};
} // namespace dolfinx_mortar
