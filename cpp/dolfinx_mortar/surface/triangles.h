// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "surface.h"
#include <Eigen/Dense>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Corners of a triangle.
using Corners = std::array<Eigen::Vector3d, 3>;

/// @brief Nodes of a facet at the corners of the triangles that it is split
/// into, turned so that their normals point out of the body. Neighbours share
/// whole edges, so that triangles leave no gap between facets.
///
/// @param[in] s Surface.
/// @param[in] f Facet.
/// @return Local nodes, three to a triangle: tri3 makes 1 triangle, tri6 4,
/// quad4 2, quad8 6 and quad9 8.
std::vector<std::array<std::int32_t, 3>> split(const Surface& s,
                                               std::int32_t f);

/// @brief A surface position, or another row of three values.
inline Eigen::Map<const Eigen::Vector3d> row(std::span<const double> x,
                                             std::int32_t i)
{
  return Eigen::Map<const Eigen::Vector3d>(x.data() + 3 * i);
}

/// @brief A point as boxes and messages hold it.
inline std::array<double, 3> as_array(const Eigen::Vector3d& x)
{
  return {x[0], x[1], x[2]};
}

/// @brief Outward normal of a facet at its middle, by its corners; not
/// normalised.
Eigen::Vector3d middle_normal(const Surface& s, std::span<const double> x,
                              std::int32_t f);

/// @brief Position of the middle of a facet.
Eigen::Vector3d middle(const Surface& s, std::span<const double> x,
                       std::int32_t f);

/// @brief Largest distance between two nodes of a facet.
double diameter(const Surface& s, std::span<const double> x, std::int32_t f);

/// @brief Point of a triangle that is nearest to another point.
/// @param[in] p Point.
/// @param[in] t Triangle.
/// @return The nearest point of the triangle.
Eigen::Vector3d nearest_point(const Eigen::Vector3d& p, const Corners& t);

/// @brief Barycentric coordinates of the projection of a point on the plane of
/// a triangle; not finite where the triangle has no area.
Eigen::Vector3d barycentric(const Eigen::Vector3d& p, const Corners& t);

/// @brief A point of one surface that is in the other one's body.
struct Depth
{
  /// How far it is in there [length]; zero where there is no such point
  double depth = 0;

  /// Where it is
  std::array<double, 3> x = {0, 0, 0};
};

/// @brief Deepest of all ranks' points. Collective.
Depth deepest(MPI_Comm comm, const Depth& mine);
} // namespace dolfinx_mortar
