// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "rigid_tool.h"
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <stdexcept>

using namespace dolfinx_mortar;

namespace
{
/// (R - I) a, which keeps its digits where the rotation is small.
Vec3 turn(const Vec3& rotation, const Vec3& a)
{
  const double angle = rotation.norm();
  if (angle == 0)
    return Vec3::Zero();
  const Vec3 axis = rotation / angle;
  const double h = std::sin(angle / 2);
  const Vec3 across = axis.cross(a);
  return std::sin(angle) * across + 2 * h * h * axis.cross(across);
}

/// b = (1 - cos φ) / φ² and c = (φ - sin φ) / φ³ of T = I + b [θ] + c [θ]², and
/// their derivatives by φ, divided by φ.
struct Coefficients
{
  double b, c, db, dc;

  explicit Coefficients(double angle)
  {
    const double x = angle * angle;
    if (angle < 0.05)
    {
      b = 1.0 / 2 - x / 24 * (1 - x / 30 * (1 - x / 56));
      c = 1.0 / 6 - x / 120 * (1 - x / 42 * (1 - x / 72));
      db = -1.0 / 12 + x / 180 * (1 - x / 37.333333333333336);
      dc = -1.0 / 60 + x / 1260 * (1 - x / 48);
      return;
    }
    const double s = std::sin(angle), h = std::sin(angle / 2);
    b = 2 * h * h / x;
    c = (angle - s) / (x * angle);
    db = (s / angle - 2 * b) / x;
    dc = (b - 3 * c) / x;
  }
};
} // namespace

//-----------------------------------------------------------------------------
Eigen::Matrix3d dolfinx_mortar::cross_matrix(const Vec3& v)
{
  Eigen::Matrix3d W;
  W << 0, -v[2], v[1], v[2], 0, -v[0], -v[1], v[0], 0;
  return W;
}
//-----------------------------------------------------------------------------
Eigen::Matrix3d dolfinx_mortar::rotation_matrix(const Vec3& vector)
{
  Eigen::Matrix3d R;
  for (int i = 0; i < 3; ++i)
    R.col(i) = Vec3(Vec3::Unit(i)) + turn(vector, Vec3(Vec3::Unit(i)));
  return R;
}
//-----------------------------------------------------------------------------
Vec3 dolfinx_mortar::rotation_vector(const Eigen::Matrix3d& R)
{
  const Eigen::AngleAxisd a{Eigen::Quaterniond(R).normalized()};
  return a.angle() * a.axis();
}
//-----------------------------------------------------------------------------
Eigen::Matrix3d dolfinx_mortar::rotation_tangent(const Vec3& vector)
{
  const Coefficients k(vector.norm());
  const Eigen::Matrix3d W = cross_matrix(vector);
  return Eigen::Matrix3d::Identity() + k.b * W + k.c * W * W;
}
//-----------------------------------------------------------------------------
Eigen::Matrix3d dolfinx_mortar::rotation_tangent_derivative(const Vec3& vector,
                                                            const Vec3& v)
{
  // Tᵀ v = v - b θ×v + c θ×(θ×v)
  const Coefficients k(vector.norm());
  const Eigen::Matrix3d W = cross_matrix(vector);
  const Vec3 once = W * v, twice = W * once;
  return k.b * cross_matrix(v) - k.db * once * vector.transpose()
         - k.c * (cross_matrix(once) + W * cross_matrix(v))
         + k.dc * twice * vector.transpose();
}
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
  std::array<double, 12> u;
  for (int l = 0; l < 4; ++l)
  {
    const Vec3 a = Vec3(X.data() + 3 * l) - reference_point;
    Eigen::Map<Vec3>(u.data() + 3 * l) = translation + turn(rotation, a);
  }
  return u;
}
//-----------------------------------------------------------------------------
bool RigidTool::is_loaded() const
{
  return std::ranges::any_of(free, [](auto f) { return f != 0; });
}
