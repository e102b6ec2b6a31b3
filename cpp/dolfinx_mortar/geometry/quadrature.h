// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "facet.h"
#include <vector>

namespace dolfinx_mortar
{
/// @brief Quadrature rule on a reference triangle or square.
struct QuadratureRule
{
  /// Points, shape (num_points, 2)
  std::vector<double> points;

  /// Weights; their sum is the area of the reference facet
  std::vector<double> weights;
};

/// @brief Basix' default rule.
/// @param[in] num_corners 3 for the triangle, 4 for the square.
/// @param[in] degree Polynomial degree integrated exactly, 0 to 100.
/// @throw std::invalid_argument There is no such rule.
QuadratureRule create_rule(int num_corners, int degree);

/// @brief Degree that integrates Φ·N exactly on both sides, and the weighted
/// gap Φ n·x, on flat facets with straight edges.
///
/// The 7-point rule (degree 5) of first-order practice is too low for
/// second-order facets.
int default_degree(FacetType slave, FacetType master);
} // namespace dolfinx_mortar
