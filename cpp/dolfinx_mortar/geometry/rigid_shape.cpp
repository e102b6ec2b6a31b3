// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "rigid_shape.h"
#include <algorithm>
#include <cmath>

using namespace dolfinx_mortar;

namespace
{
/// Distance [radius] from a centre or an axis below which the direction from
/// there is lost in round-off.
constexpr double at_centre = 1e-9;

/// Closest point of a sphere, or of a circle where `X` has no third component.
/// @return Direction from the centre, and the distance from it.
std::pair<Vec3, double> from_centre(const Vec3& X)
{
  const double r = X.norm();
  return r > at_centre ? std::pair(Vec3(X / r), r)
                       : std::pair(Vec3(Vec3::UnitX()), at_centre);
}
} // namespace

//-----------------------------------------------------------------------------
ClosestPoint dolfinx_mortar::closest_point(const RigidShape& shape,
                                           const Vec3& X)
{
  const double sign = shape.hollow ? -1 : 1;
  ClosestPoint p;
  switch (shape.kind)
  {
  case RigidShape::Kind::plane:
    p.X = Vec3(X[0], X[1], 0);
    p.distance = X[2];
    p.normal = Vec3::UnitZ();
    p.tangents = {Vec3::UnitX(), Vec3::UnitY()};
    p.stretch = {1, 1};
    p.turn = {0, 0};
    break;
  case RigidShape::Kind::sphere:
  {
    const auto [n, r] = from_centre(X);
    p.X = n;
    p.distance = sign * (r - 1);
    p.normal = sign * n;
    p.tangents[0] = n.unitOrthogonal();
    p.tangents[1] = n.cross(p.tangents[0]);
    p.stretch = {1 / r, 1 / r};
    p.turn = {sign / r, sign / r};
    break;
  }
  case RigidShape::Kind::cylinder:
  {
    const auto [n, r] = from_centre(Vec3(X[0], X[1], 0));
    p.X = Vec3(n[0], n[1], X[2]);
    p.distance = sign * (r - 1);
    p.normal = sign * n;
    p.tangents = {Vec3::UnitZ(), Vec3::UnitZ().cross(n)};
    p.stretch = {1, 1 / r};
    p.turn = {0, sign / r};
    break;
  }
  }
  return p;
}
//-----------------------------------------------------------------------------
FrameView::FrameView(std::span<const double> x) : origin(x.data())
{
  for (int i = 0; i < 3; ++i)
    axes.col(i) = Eigen::Map<const Vec3>(x.data() + 3 * (i + 1)) - origin;
  inverse = axes.inverse();
}
//-----------------------------------------------------------------------------
Vec3 dolfinx_mortar::opposing_normal(const RigidShape& shape,
                                     const FrameView& frame, const Vec3& x,
                                     std::span<const std::int8_t, 3> fixed,
                                     Eigen::Matrix<double, 3, 15>* d)
{
  const Vec3 X = frame.coordinates(x);
  const ClosestPoint p = closest_point(shape, X);
  Vec3 m = -(frame.axes * p.normal);
  Vec3 kept = Vec3::Ones();
  for (int c = 0; c < 3; ++c)
    kept[c] = fixed[c] ? 0 : 1;
  if (m.cwiseProduct(kept).norm() < 0.1 * m.norm())
    kept.setOnes();
  m = m.cwiseProduct(kept);
  const double length = m.norm();
  const Vec3 n = m / length;
  if (d)
  {
    // d(axes ν) = d(axes) ν + axes dν, dX = axes⁻¹ (dx - Σ N_l dx_l)
    Eigen::Matrix3d turn = Eigen::Matrix3d::Zero();
    for (int a = 0; a < 2; ++a)
      turn += p.turn[a] * p.tangents[a] * p.tangents[a].transpose();
    const Eigen::Matrix3d by_x = frame.axes * turn * frame.inverse;
    const Eigen::Vector4d N = frame_functions(X);
    const Eigen::Vector4d dN = frame_derivatives(p.normal);
    Eigen::Matrix<double, 3, 15> dm;
    dm.leftCols<3>() = by_x;
    for (int l = 0; l < 4; ++l)
    {
      dm.middleCols<3>(3 * (l + 1))
          = dN[l] * Eigen::Matrix3d::Identity() - N[l] * by_x;
    }
    const Eigen::Matrix3d across
        = (Eigen::Matrix3d::Identity() - n * n.transpose()) / length;
    *d = -(across * kept.asDiagonal() * dm);
  }
  return n;
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::append_shape_points(const FacetView& slave,
                                         const RigidShape& shape,
                                         std::span<const double> x,
                                         const QuadratureRule& rule,
                                         const AngleLimits& limits,
                                         bool derivatives, PairPoints& points)
{
  const FrameView frame(x);
  const int n = num_nodes(slave.type), width = 3 * (n + 4);
  using Rows = Eigen::Matrix<double, 5, Eigen::Dynamic, Eigen::RowMajor, 5,
                             3 * (max_facet_nodes + 4)>;
  Rows d(5, width);
  SurfacePoint s;
  for (std::size_t q = 0; q < rule.weights.size(); ++q)
  {
    const std::array<double, 2> xi
        = {rule.points[2 * q], rule.points[2 * q + 1]};
    evaluate(slave, xi, s);
    const Vec3 c = s.a1.cross(s.a2);
    const double measure = c.norm();
    if (!(measure > 0))
      throw_folded(slave, s.x);
    const Vec3 X = frame.coordinates(s.x);
    const ClosestPoint p = closest_point(shape, X);
    const Vec3 normal = (frame.axes * p.normal).normalized();
    if (slave.orientation * c.dot(normal) > -limits.part * measure)
      continue;

    points.xi.insert(points.xi.end(), xi.begin(), xi.end());
    points.w.push_back(rule.weights[q] * measure);
    points.normals.insert(points.normals.end(), normal.begin(), normal.end());
    for (const Eigen::Vector4d& N :
         {frame_functions(p.X), frame_derivatives(p.tangents[0]),
          frame_derivatives(p.tangents[1])})
      points.frame.insert(points.frame.end(), N.begin(), N.end());
    if (!derivatives)
      continue;

    d.setZero();
    const Eigen::Vector4d N = frame_functions(X);
    const Vec3 b1 = s.a2.cross(c) / measure, b2 = c.cross(s.a1) / measure;
    for (int a = 0; a < 2; ++a)
    {
      const Eigen::RowVector3d by_x
          = p.stretch[a] * p.tangents[a].transpose() * frame.inverse;
      for (int k = 0; k < n; ++k)
        d.block<1, 3>(2 + a, 3 * k) = s.s.N[k] * by_x;
      for (int l = 0; l < 4; ++l)
        d.block<1, 3>(2 + a, 3 * (n + l)) = -N[l] * by_x;
    }
    for (int k = 0; k < n; ++k)
    {
      d.block<1, 3>(4, 3 * k)
          = rule.weights[q]
            * (s.s.dN[0][k] * b1 + s.s.dN[1][k] * b2).transpose();
    }
    points.d.insert(points.d.end(), d.data(), d.data() + d.size());
  }
}
