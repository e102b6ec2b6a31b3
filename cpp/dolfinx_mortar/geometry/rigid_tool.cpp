// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "rigid_tool.h"
#include <cmath>
#include <stdexcept>

using namespace dolfinx_mortar;

//-----------------------------------------------------------------------------
RigidTool::RigidTool(const Vec3& reference_point_)
    : reference_point(reference_point_), _origin(reference_point_)
{
}
//-----------------------------------------------------------------------------
RigidTool::RigidTool(const RigidShape& shape, const Vec3& origin,
                     const Vec3& direction, double radius)
    : reference_point(origin), _shape(shape), _origin(origin)
{
  if (shape.kind != RigidShape::Kind::sphere)
  {
    const double length = direction.norm();
    if (!(length > 0) or !std::isfinite(length))
    {
      throw std::invalid_argument(
          "The direction of a rigid plane or cylinder must be a vector of "
          "non-zero length.");
    }
    _axes.col(2) = direction / length;
    _axes.col(0) = Vec3(_axes.col(2)).unitOrthogonal();
    _axes.col(1) = Vec3(_axes.col(2)).cross(Vec3(_axes.col(0)));
  }
  if (shape.kind != RigidShape::Kind::plane)
  {
    if (!(radius > 0) or !std::isfinite(radius))
    {
      throw std::invalid_argument(
          "The radius of a rigid sphere or cylinder must be positive.");
    }
    _length = radius;
  }
}
//-----------------------------------------------------------------------------
std::array<double, 12> RigidTool::frame(double size) const
{
  std::array<double, 12> x;
  const Eigen::Matrix3d axes = _length.value_or(size) * _axes;
  for (int l = 0; l < 4; ++l)
  {
    const Vec3 p = l == 0 ? _origin : Vec3(_origin + axes.col(l - 1));
    Eigen::Map<Vec3>(x.data() + 3 * l) = p;
  }
  return x;
}
//-----------------------------------------------------------------------------
std::array<double, 12>
RigidTool::displacements(const std::array<double, 12>& X) const
{
  // (R - I) a, which keeps its digits where the rotation is small
  const double angle = rotation.norm();
  const Vec3 axis = angle > 0 ? Vec3(rotation / angle) : Vec3(Vec3::UnitZ());
  const double s = std::sin(angle), h = std::sin(angle / 2);
  std::array<double, 12> u;
  for (int l = 0; l < 4; ++l)
  {
    const Vec3 a = Vec3(X.data() + 3 * l) - reference_point;
    const Vec3 across = axis.cross(a);
    Eigen::Map<Vec3>(u.data() + 3 * l)
        = translation + s * across + 2 * h * h * axis.cross(across);
  }
  return u;
}
