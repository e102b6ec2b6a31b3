// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "pair.h"
#include <cmath>
#include <limits>

using namespace dolfinx_mortar;

namespace
{
using RowMajor
    = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Where the normal of a slave point meets the masters.
struct Hit
{
  /// Master, or -1 where there is none
  int master = -1;

  /// A master that would be hit if it were not too steep, or -1
  int steep = -1;

  /// Distance to the master along the normal
  double distance = std::numeric_limits<double>::max();

  std::array<double, 2> eta = {0, 0};
  SurfacePoint point;
  Mat23 L; // see pullback
};

/// Nearest place where the line through a slave point x along n meets a master
/// that faces it.
void find_nearest(const Vec3& x, const Vec3& n,
                  std::span<const FacetView> masters, const AngleLimits& limits,
                  Hit& hit)
{
  SurfacePoint point;
  Mat23 L;
  for (std::size_t i = 0; i < masters.size(); ++i)
  {
    const FacetView& master = masters[i];
    for (const SubFacet& sub : sub_facets(master.type))
    {
      const LinearPart m(master, sub);
      const double cosine = -n.dot(m.n);
      if (!(m.norm_c > 0) or !(cosine > 0))
        continue;
      // Far outside of the part
      if ((pullback(m.t1, m.t2, n) * (x - m.centre)).lpNorm<Eigen::Infinity>()
          > 1.5)
        continue;
      std::array<double, 2> eta = m.guess(x, n);
      if (!project(master, x, n, eta, point, L)
          or !in_reference(master.type, eta, 1e-10))
        continue;
      if (cosine < limits.part
          or !opposes(master, point.a1, point.a2, n, limits.point))
      {
        hit.steep = i;
        continue;
      }
      const double distance = std::abs(n.dot(point.x - x));
      if (distance < hit.distance)
        hit = {static_cast<int>(i), hit.steep, distance, eta, point, L};
      break;
    }
  }
}
} // namespace

//-----------------------------------------------------------------------------
void dolfinx_mortar::append_element_points(const FacetView& slave,
                                           std::span<const FacetView> masters,
                                           const QuadratureRule& rule,
                                           const AngleLimits& limits,
                                           bool derivatives,
                                           std::span<PairPoints> points)
{
  const int num_s = num_nodes(slave.type);
  SurfacePoint qs;
  for (std::size_t q = 0; q < rule.weights.size(); ++q)
  {
    const std::array<double, 2> xi
        = {rule.points[2 * q], rule.points[2 * q + 1]};
    evaluate(slave, xi, qs);
    const Vec3 c = qs.a1.cross(qs.a2);
    const double norm_c = c.norm();
    if (!(norm_c > 0))
      throw_folded(slave, qs.x);
    const Vec3 n = slave.orientation * c / norm_c;
    const double w = rule.weights[q] * norm_c;

    Hit hit;
    find_nearest(qs.x, n, masters, limits, hit);
    if (hit.master < 0)
    {
      if (hit.steep >= 0)
        points[hit.steep].dropped_area += w;
      continue;
    }

    PairPoints& out = points[hit.master];
    out.xi.insert(out.xi.end(), xi.begin(), xi.end());
    out.eta.insert(out.eta.end(), hit.eta.begin(), hit.eta.end());
    out.w.push_back(w);
    if (!derivatives)
      continue;

    const int num_m = num_nodes(masters[hit.master].type);
    const int nd = 3 * (num_s + num_m);
    const std::size_t at = out.d.size();
    out.d.resize(at + 5 * nd, 0.0);
    Eigen::Map<RowMajor> T(out.d.data() + at, 5, nd);
    const double beta = n.dot(hit.point.x - qs.x);
    const Eigen::Matrix3d Pn = (Eigen::Matrix3d::Identity() - n * n.transpose())
                               * (slave.orientation / norm_c);
    for (int k = 0; k < num_s; ++k)
    {
      // dc = dN₁ dx × a₂ + dN₂ a₁ × dx
      const Vec3 v = qs.s.dN[0][k] * qs.a2 - qs.s.dN[1][k] * qs.a1;
      Eigen::Matrix3d dc; // dc = dx × v
      dc << 0, v[2], -v[1], -v[2], 0, v[0], v[1], -v[0], 0;
      T.block<2, 3>(2, 3 * k)
          = hit.L
            * (qs.s.N[k] * Eigen::Matrix3d::Identity() + beta * (Pn * dc));
      T.block<1, 3>(4, 3 * k)
          = (rule.weights[q] / norm_c) * (c.transpose() * dc);
    }
    for (int k = 0; k < num_m; ++k)
      T.block<2, 3>(2, 3 * (num_s + k)) = -hit.point.s.N[k] * hit.L;
  }
}
