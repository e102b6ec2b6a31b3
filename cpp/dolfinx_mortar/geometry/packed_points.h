// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT
//
// Points of a facet, four at a time.

#pragma once

#include "projection.h"
#include <dolfinx_mortar/common/pack.h>
#include <span>

namespace dolfinx_mortar
{
/// @brief Three coordinates of four points.
using PackVec3 = std::array<Pack, 3>;

/// @brief Four places on a facet.
struct PackedPoint
{
  std::array<Pack, 2> xi;            // where they are
  ShapesOf<Pack> s;                  // functions there
  PackVec3 x, a1, a2;                // positions and tangents
  PackVec3 a11, a12, a22;            // second derivatives of the position
  std::array<PackVec3, 2> L;         // see pullback
  std::array<bool, pack_size> found; // false where no place was found
};

/// @brief Map four points p along n to a facet, see `project`.
/// @param[in] p Points.
/// @param[in] order Highest derivative to evaluate there, 1 or 2.
/// @param[in,out] point Its `xi` are the starting points; all is set.
void project_pack(const FacetView& f, const PackVec3& p, const Vec3& n,
                  int order, PackedPoint& point);

/// @brief Shape functions of a facet at points.
/// @param[in] xi Points, shape (num_points, 2).
/// @param[out] N Values, shape (num_points, num_nodes).
/// @param[out] dN Derivatives by both coordinates, of the same shape; null for
/// none.
void tabulate_points(FacetType type, std::span<const double> xi, double* N,
                     std::array<double*, 2> dN);
} // namespace dolfinx_mortar
