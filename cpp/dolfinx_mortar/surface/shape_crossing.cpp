// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "crossing.h"
#include <algorithm>
#include <utility>

using namespace dolfinx_mortar;

namespace
{
/// Share of the radius: a way that ends more than a right angle further round a
/// solid, and leads deeper than this into it, passes through. Ways between
/// points of its surface that are a right angle apart lead to 0.29.
constexpr double through = 0.25;

/// Point of the way from A to B that is nearest to the centre or axis.
Vec3 nearest_to_centre(const RigidShape& shape, Vec3 A, Vec3 B)
{
  Vec3 from = A, to = B;
  if (shape.kind == RigidShape::Kind::cylinder)
    from[2] = to[2] = 0;
  const Vec3 d = to - from;
  const double t
      = std::clamp(-from.dot(d) / std::max(d.squaredNorm(), 1e-300), 0.0, 1.0);
  return A + t * (B - A);
}

/// How far inside of a solid a way from A to B leads, if it passes through.
double depth_of_way(const RigidShape& shape, const Vec3& A, const Vec3& B)
{
  if (shape.kind == RigidShape::Kind::plane or shape.hollow)
    return 0;
  const double depth
      = -closest_point(shape, nearest_to_centre(shape, A, B)).distance;
  const bool beyond
      = closest_point(shape, A).normal.dot(closest_point(shape, B).normal) < 0;
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
    const Vec3 normal = before.inverse * middle_normal(slave, x_before, f);
    const double size = diameter(slave, x_after, f) / unit;
    auto follow = [&](const Vec3& from, const Vec3& x)
    {
      const Vec3 A = before.coordinates(from), B = after.coordinates(x);
      if (closest_point(shape, A).normal.dot(normal) >= 0)
        return;
      const double behind = -closest_point(shape, B).distance;
      const double depth
          = unit
            * std::max(behind > size ? behind : 0.0, depth_of_way(shape, A, B));
      if (depth > deep.depth)
        deep = {depth, as_array(x)};
    };
    follow(middle(slave, x_before, f), middle(slave, x_after, f));
    for (std::int32_t k : facet_nodes(slave, f))
      follow(row(x_before, k), row(x_after, k));
  }
  return deepest(slave.comm, deep);
}
