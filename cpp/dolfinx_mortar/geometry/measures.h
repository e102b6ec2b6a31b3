// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "projection.h"
#include "quadrature.h"
#include <array>
#include <span>

namespace dolfinx_mortar
{
/// @brief Mean of the positions of nodes, shape (n, 3).
std::array<double, 3> centre(std::span<const double> x);

/// @brief Area of a facet.
/// @param[in] rule Rule on the reference facet.
double facet_area(const FacetView& f, const QuadratureRule& rule);

/// @brief Largest distance between two nodes of a facet.
double diameter(const FacetView& f);

/// @brief Unit outward normal of a facet in the plane of its corners.
Vec3 corner_normal(const FacetView& f);
} // namespace dolfinx_mortar
