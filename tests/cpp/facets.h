// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "numbers.h"
#include <dolfinx_mortar/geometry/projection.h>
#include <vector>

namespace unit
{
/// Nodes of a facet about the size of the reference facet, near the plane z =
/// 0 and oriented along +z.
/// @param[in] in_plane How far nodes move within the plane; edges of facets of
/// second order become curved.
/// @param[in] height How far nodes move out of the plane.
inline std::vector<double> distorted(dolfinx_mortar::FacetType type,
                                     double in_plane, double height,
                                     Numbers& number)
{
  const auto xi = dolfinx_mortar::node_coordinates(type);
  std::vector<double> x;
  for (int k = 0; k < dolfinx_mortar::num_nodes(type); ++k)
  {
    x.push_back(xi[2 * k] + in_plane * number());
    x.push_back(xi[2 * k + 1] + in_plane * number());
    x.push_back(height * number());
  }
  return x;
}

/// Corners of a facet moved within the plane z = 0; edges stay straight, with
/// nodes in the middle.
inline std::vector<double> straight(dolfinx_mortar::FacetType type,
                                    double in_plane, Numbers& number)
{
  using namespace dolfinx_mortar;
  std::vector<double> x = distorted(type, in_plane, 0, number);
  const int nc = num_corners(type);
  const auto edges = edge_corners(type);
  for (int k = nc; k < num_nodes(type); ++k)
  {
    for (int c = 0; c < 3; ++c)
    {
      x[3 * k + c] = k < 2 * nc
                         ? 0.5
                               * (x[3 * edges[k - nc][0] + c]
                                  + x[3 * edges[k - nc][1] + c])
                         : 0.25 * (x[c] + x[3 + c] + x[6 + c] + x[9 + c]);
    }
  }
  return x;
}
} // namespace unit
