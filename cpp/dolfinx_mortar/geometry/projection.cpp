// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "projection.h"
#include <algorithm>
#include <cmath>
#include <numbers>
#include <sstream>
#include <stdexcept>

using namespace dolfinx_mortar;

//-----------------------------------------------------------------------------
void dolfinx_mortar::evaluate(const FacetView& f, std::array<double, 2> xi,
                              SurfacePoint& p)
{
  tabulate(f.type, xi, 1, p.s);
  p.x.setZero();
  p.a1.setZero();
  p.a2.setZero();
  for (int k = 0; k < num_nodes(f.type); ++k)
  {
    const Vec3 xk = node(f, k);
    p.x += p.s.N[k] * xk;
    p.a1 += p.s.dN[0][k] * xk;
    p.a2 += p.s.dN[1][k] * xk;
  }
}
//-----------------------------------------------------------------------------
Mat23 dolfinx_mortar::pullback(const Vec3& a1, const Vec3& a2, const Vec3& n)
{
  const double det = a1.cross(a2).dot(n);
  Mat23 L;
  L.row(0) = a2.cross(n) / det;
  L.row(1) = n.cross(a1) / det;
  return L;
}
//-----------------------------------------------------------------------------
LinearPart::LinearPart(const FacetView& f, const SubFacet& sub) : size(sub.size)
{
  auto ref = node_coordinates(f.type);
  auto R = [&](int i)
  { return Eigen::Vector2d(ref[2 * sub.nodes[i]], ref[2 * sub.nodes[i] + 1]); };
  auto x = [&](int i) { return node(f, sub.nodes[i]); };
  if (size == 3)
  {
    t1 = x(1) - x(0);
    t2 = x(2) - x(0);
    r1 = R(1) - R(0);
    r2 = R(2) - R(0);
    centre = (x(0) + x(1) + x(2)) / 3;
    xi = (R(0) + R(1) + R(2)) / 3;
    c = t1.cross(t2);
    nodes = sub.nodes;
  }
  else
  {
    t1 = 0.5 * (x(1) - x(0) + x(3) - x(2));
    t2 = 0.5 * (x(2) - x(0) + x(3) - x(1));
    r1 = 0.5 * (R(1) - R(0) + R(3) - R(2));
    r2 = 0.5 * (R(2) - R(0) + R(3) - R(1));
    centre = 0.25 * (x(0) + x(1) + x(2) + x(3));
    xi = 0.25 * (R(0) + R(1) + R(2) + R(3));
    c = t1.cross(t2);
    nodes = {sub.nodes[0], sub.nodes[1], sub.nodes[3], sub.nodes[2]};
  }
  if (f.orientation < 0)
  {
    c = -c;
    std::reverse(nodes.begin(), nodes.begin() + size);
  }
  for (int i = 0; i < size; ++i)
    corners[i] = node(f, nodes[i]);
  norm_c = c.norm();
  n = c / norm_c;
}
//-----------------------------------------------------------------------------
std::array<Eigen::Matrix3d, 4> LinearPart::normal_derivative() const
{
  auto cross_matrix = [](const Vec3& v)
  {
    Eigen::Matrix3d W;
    W << 0, -v[2], v[1], v[2], 0, -v[0], -v[1], v[0], 0;
    return W;
  };
  std::array<Eigen::Matrix3d, 4> W;
  // In counter-clockwise order c is (x₁-x₀)×(x₂-x₀) or ½(x₂-x₀)×(x₃-x₁),
  // whatever the orientation of the facet
  if (size == 3)
  {
    for (int i = 0; i < 3; ++i)
      W[i] = cross_matrix(corners[(i + 2) % 3] - corners[(i + 1) % 3]);
  }
  else
  {
    const Vec3 u = 0.5 * (corners[2] - corners[0]);
    const Vec3 v = 0.5 * (corners[3] - corners[1]);
    W[2] = -cross_matrix(v);
    W[0] = cross_matrix(v);
    W[3] = cross_matrix(u);
    W[1] = -cross_matrix(u);
  }
  return W;
}
//-----------------------------------------------------------------------------
std::array<double, 2> LinearPart::guess(const Vec3& p, const Vec3& normal) const
{
  const Eigen::Vector2d t = pullback(t1, t2, normal) * (p - centre);
  return {xi[0] + r1[0] * t[0] + r2[0] * t[1],
          xi[1] + r1[1] * t[0] + r2[1] * t[1]};
}
//-----------------------------------------------------------------------------
AngleLimits::AngleLimits(double max_angle)
    : part(std::cos(max_angle * std::numbers::pi / 180)),
      point(std::cos((max_angle + 90) * std::numbers::pi / 360))
{
}
//-----------------------------------------------------------------------------
bool dolfinx_mortar::project(const FacetView& f, const Vec3& p, const Vec3& n,
                             std::array<double, 2>& xi, SurfacePoint& point,
                             Mat23& L)
{
  for (int it = 0; it < 25; ++it)
  {
    evaluate(f, xi, point);
    L = pullback(point.a1, point.a2, n);
    const Eigen::Vector2d step = L * (p - point.x);
    const double size = step.lpNorm<Eigen::Infinity>();
    if (!(size < 10))
      return false;
    xi[0] += step[0];
    xi[1] += step[1];
    if (size < 1e-8)
    {
      if (size > 1e-15)
      {
        evaluate(f, xi, point);
        L = pullback(point.a1, point.a2, n);
      }
      return true;
    }
  }
  return false;
}
//-----------------------------------------------------------------------------
bool dolfinx_mortar::opposes(const FacetView& f, const Vec3& a1, const Vec3& a2,
                             const Vec3& n, double cosine)
{
  const Vec3 c = f.orientation * a1.cross(a2);
  return c.dot(n) < -cosine * c.norm();
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::throw_folded(const FacetView& f, const Vec3& x)
{
  std::stringstream s;
  s << "Slave facet near (" << x[0] + f.origin[0] << ", " << x[1] + f.origin[1]
    << ", " << x[2] + f.origin[2]
    << ") is folded or inside out: refine the surface, or take a smaller load "
       "step.";
  throw std::runtime_error(s.str());
}
