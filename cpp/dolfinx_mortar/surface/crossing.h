// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "surface.h"
#include "triangles.h"
#include <dolfinx_mortar/geometry/rigid_shape.h>
#include <optional>
#include <span>

namespace dolfinx_mortar
{
/// @brief Find the point of a surface that has passed through another surface
/// on its way to a new configuration, and is deepest behind it. Collective.
///
/// All nodes move on straight lines. Nodes and middles of the facets of one
/// surface are followed past the triangles of the other one: a point enters
/// where the volume of the tetrahedron of point and triangle, a cubic function
/// of time, turns negative within the triangle, and leaves where it turns
/// positive. Points that are a little behind the surface at the beginning, as
/// nodes in contact are, have entered. Only facets count that face each other
/// at that time: so a facet that leaves a sheet through its far side has not
/// left, and one that is turned in a bore, on a path that cuts the pin, has.
///
/// A point that has entered and not left has passed through, if no facet of the
/// other surface that faces it is within reach, the search distance (where
/// there is one contact sees it), and if it is further than that behind the
/// plane of the triangle it came through. Sliding over an edge is no passing.
///
/// This needs no bodies: the surfaces may be on one, and be left behind
/// entirely. Both surfaces are looked at from the other one. Triangles travel
/// only to the ranks whose points they may meet.
///
/// @param[in] slave,master Surfaces.
/// @param[in] slave_before,slave_after,master_before,master_after Positions of
/// their local nodes, shape (n, 3).
/// @param[in] distance Search distance (a length), by default the larger
/// diameter of the two facets.
/// @return How far the deepest point is behind the plane of its triangle, and
/// where it is now; the same on all ranks.
Depth find_crossing(const Surface& slave, std::span<const double> slave_before,
                    std::span<const double> slave_after, const Surface& master,
                    std::span<const double> master_before,
                    std::span<const double> master_after,
                    std::optional<double> distance);

/// @brief Find the slave facet that has passed through an analytic tool on its
/// way to a new configuration, and is deepest behind its surface. Collective.
///
/// Middles and nodes of facets that face the tool at the beginning are
/// followed, on straight lines in the tool's coordinates. One has passed
/// through if it is further inside of the tool than the facet is large, or if
/// it is more than a right angle further round a sphere or a cylinder, and its
/// way led deeper into that than a quarter of the radius.
/// @param[in] slave Surface.
/// @param[in] shape Shape of the tool.
/// @param[in] x_before,x_after Positions of the local slave nodes, shape (n,
/// 3).
/// @param[in] frame_before,frame_after Positions of the nodes of the tool's
/// frame, shape (4, 3).
/// @return Depth, and where the facet is now; the same on all ranks.
Depth find_shape_crossing(const Surface& slave, const RigidShape& shape,
                          std::span<const double> x_before,
                          std::span<const double> frame_before,
                          std::span<const double> x_after,
                          std::span<const double> frame_after);
} // namespace dolfinx_mortar
