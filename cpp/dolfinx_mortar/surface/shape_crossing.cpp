// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "crossing.h"
#include <algorithm>
#include <utility>

using namespace dolfinx_mortar;

namespace
{
/// Share of the radius: what comes nearer than this to the centre or axis of a
/// tool does not slide on its surface.
constexpr double through = 0.5;

/// Point of the way from A to B that is nearest to the centre or axis.
Vec3 nearest_to_centre(const RigidShape& shape, Vec3 A, Vec3 B)
{
  Vec3 from = A, to = B;
  if (shape.kind == RigidShape::Kind::cylinder)
    from[2] = to[2] = 0;
  const Vec3 d = to - from;
  const double t = std::clamp(
      -from.dot(d) / std::max(d.squaredNorm(), 1e-300), 0.0, 1.0);
  return A + t * (B - A);
}

/// How far inside of a solid a way from A to B leads, if it passes through.
double depth_of_way(const RigidShape& shape, const Vec3& A, const Vec3& B)
{
  if (shape.kind == RigidShape::Kind::plane or shape.hollow)
    return 0;
  const double depth
      = -closest_point(shape, nearest_to_centre(shape, A, B)).distance;
  const bool beyond = closest_point(shape, A).normal.dot(
                          closest_point(shape, B).normal)
                      < 0;
  return beyond and depth > through ? depth : 0;
}
} // namespace

//-----------------------------------------------------------------------------
Depth dolfinx_mortar::find_shape_crossing(const Surface& slave,
                                          const RigidShape& shape,
                                          std::span<const double> x_before,
                                          std::span<const double> frame_before,
                                          std::span<const double> x_after,
                                          std::span<const double> frame_after)
{
  const FrameView before(frame_before), after(frame_after);
  const double unit = after.axes.col(0).norm();
  Depth deep;
  for (std::int32_t f = 0; f < static_cast<std::int32_t>(slave.types.size());
       ++f)
  {
    const Vec3 A = before.coordinates(middle(slave, x_before, f));
    const Vec3 normal = before.inverse * middle_normal(slave, x_before, f);
    if (closest_point(shape, A).normal.dot(normal) >= 0)
      continue;
    const Vec3 x = middle(slave, x_after, f);
    const Vec3 B = after.coordinates(x);
    double depth = -closest_point(shape, B).distance;
    if (depth * unit <= diameter(slave, x_after, f))
      depth = 0;
    depth = unit * std::max(depth, depth_of_way(shape, A, B));
    if (depth > deep.depth)
      deep = {depth, as_array(x)};
  }
  return deepest(slave.comm, deep);
}
