// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <array>
#include <cstdint>
#include <span>

namespace dolfinx_mortar
{
/// @brief Corner of a clipped polygon, with what it was made of, so that its
/// position can be differentiated.
struct ClipVertex
{
  enum class Kind : std::int8_t
  {
    slave,       ///< corner `slave` of the slave polygon
    master,      ///< corner `master` of the master polygon
    intersection ///< of slave edge `slave` and master edge `master`
  };

  std::array<double, 2> p;
  Kind kind;

  /// Corner of, or edge (from this corner to the next of) the polygon
  std::int8_t slave, master;

  /// Line that the edge from this vertex to the next lies on: master edge
  /// (0 to 3) or 4 + slave edge
  std::int8_t line;
};

/// @brief Result of clipping two polygons of at most four corners.
struct ClipPolygon
{
  std::array<ClipVertex, 16> vertices;
  int size = 0;
};

/// @brief Intersection of two polygons in a plane (Sutherland and Hodgman,
/// with the origin of each corner).
///
/// @param[in] slave Corners of the clipping polygon, convex and
/// counter-clockwise.
/// @param[in] master Corners of the polygon to clip, counter-clockwise.
/// @param[in] tol Length up to which a corner counts as lying on an edge.
/// @return Corners, counter-clockwise; less than three where the polygons do
/// not overlap.
ClipPolygon clip(std::span<const std::array<double, 2>> slave,
                 std::span<const std::array<double, 2>> master, double tol);
} // namespace dolfinx_mortar
