// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "clip.h"
#include "pair.h"
#include "projection.h"
#include <algorithm>
#include <cmath>
#include <limits>

using namespace dolfinx_mortar;

namespace
{
using Row24 = Eigen::Matrix<double, 1, 24>;
using Mat24 = Eigen::Matrix<double, 3, 24>;

/// Corners closer to an edge than this, relative to the size of the slave
/// sub-facet, lie on it.
constexpr double clip_tolerance = 1e-9;

/// Overlaps smaller than this, relative to the area of the slave sub-facet,
/// are left out.
constexpr double sliver = 1e-10;

/// Share of the reference facet by which a point may lie beyond the master. The
/// points are those of linear parts, and a curved facet ends elsewhere than
/// these: on random facets with nodes up to 0.1 facet sizes off their places,
/// turned by up to 70 degrees, one in a hundred reaches further than this.
/// Shape functions grow to 1.9 here, to 7 at 0.5.
constexpr double reach = 0.1;

/// The same for the slave facet, where such a point would be on a fold.
constexpr double folded = 0.5;

/// Derivative with respect to the corners of a pair of sub-facets (slave, then
/// master, 3 columns each) of the corners of their overlap.
Mat24 vertex_derivative(const ClipVertex& v, const LinearPart& s,
                        const LinearPart& m, const Vec3& n, const Mat24& dn,
                        Vec3& V)
{
  Mat24 dV = Mat24::Zero();
  const int offset = 3 * s.size;
  if (v.kind == ClipVertex::Kind::slave)
  {
    V = s.corners[v.slave];
    dV.block<3, 3>(0, 3 * v.slave).setIdentity();
  }
  else if (v.kind == ClipVertex::Kind::master)
  {
    V = m.corners[v.master];
    dV.block<3, 3>(0, offset + 3 * v.master).setIdentity();
  }
  else
  {
    // Point y_c + t (y_d - y_c) of the master edge in the plane through the
    // slave edge x_a, x_b and n: (y_c + t (y_d - y_c) - x_a)·e = 0 with
    // e = n × (x_b - x_a)
    const int a = v.slave, b = (v.slave + 1) % s.size;
    const int c = v.master, d = (v.master + 1) % m.size;
    const Vec3 ab = s.corners[b] - s.corners[a];
    const Vec3 cd = m.corners[d] - m.corners[c];
    const Vec3 e = n.cross(ab);
    const double denominator = cd.dot(e);
    const double t = (s.corners[a] - m.corners[c]).dot(e) / denominator;
    V = m.corners[c] + t * cd;
    // dt (cd·e) = (dx_a - (1-t) dy_c - t dy_d)·e - (V - x_a)·de
    const Vec3 r = V - s.corners[a];
    Row24 dt = Row24::Zero();
    // de = dn × ab + n × (dx_b - dx_a);  r·(dn × ab) = dn·(ab × r),
    // r·(n × dx) = dx·(r × n)
    dt.noalias() -= ab.cross(r).transpose() * dn;
    const Vec3 rn = r.cross(n);
    dt.segment<3>(3 * a) += (e + rn).transpose();
    dt.segment<3>(3 * b) -= rn.transpose();
    dt.segment<3>(offset + 3 * c) -= (1 - t) * e.transpose();
    dt.segment<3>(offset + 3 * d) -= t * e.transpose();
    dt /= denominator;
    dV.noalias() = cd * dt;
    dV.block<3, 3>(0, offset + 3 * c).diagonal().array() += 1 - t;
    dV.block<3, 3>(0, offset + 3 * d).diagonal().array() += t;
  }
  return dV;
}

Vec3 vertex_position(const ClipVertex& v, const LinearPart& s,
                     const LinearPart& m, const Vec3& n)
{
  if (v.kind == ClipVertex::Kind::slave)
    return s.corners[v.slave];
  if (v.kind == ClipVertex::Kind::master)
    return m.corners[v.master];
  const Vec3& xa = s.corners[v.slave];
  const Vec3& yc = m.corners[v.master];
  const Vec3 cd = m.corners[(v.master + 1) % m.size] - yc;
  const Vec3 e = n.cross(s.corners[(v.slave + 1) % s.size] - xa);
  return yc + ((xa - yc).dot(e) / cd.dot(e)) * cd;
}

/// The derivative of log(|c| / |c·n|), c = a₁ × a₂.
struct MeasureDerivative
{
  Vec3 A, B, C; // d = A·da₁ + B·da₂ - C·dn

  MeasureDerivative(const SurfacePoint& p, const Vec3& n)
  {
    const Vec3 c = p.a1.cross(p.a2);
    const double cn = c.dot(n);
    const Vec3 r = c / c.squaredNorm() - n / cn;
    A = p.a2.cross(r);
    B = r.cross(p.a1);
    C = c / cn;
  }
};

/// Points of one pair of sub-facets.
void sub_pair_points(const FacetView& slave, const FacetView& master,
                     const LinearPart& s, const LinearPart& m,
                     const Mat24* dn_s, const QuadratureRule& rule,
                     const AngleLimits& limits, PairPoints& points)
{
  const Vec3& n = s.n;

  // Coordinates in the plane, relative to the centre
  Vec3 e1 = (s.corners[1] - s.corners[0]);
  e1 = (e1 - e1.dot(n) * n).normalized();
  const Vec3 e2 = n.cross(e1);
  auto plane = [&](const Vec3& x) -> std::array<double, 2>
  { return {(x - s.centre).dot(e1), (x - s.centre).dot(e2)}; };
  std::array<std::array<double, 2>, 4> ps, pm;
  std::array<double, 4> box_s, box_m;
  auto fill = [&](const LinearPart& part, auto& p, auto& box)
  {
    constexpr double inf = std::numeric_limits<double>::max();
    box = {inf, inf, -inf, -inf};
    for (int i = 0; i < part.size; ++i)
    {
      p[i] = plane(part.corners[i]);
      for (int c = 0; c < 2; ++c)
      {
        box[c] = std::min(box[c], p[i][c]);
        box[2 + c] = std::max(box[2 + c], p[i][c]);
      }
    }
  };
  fill(s, ps, box_s);
  fill(m, pm, box_m);
  if (box_s[0] > box_m[2] or box_m[0] > box_s[2] or box_s[1] > box_m[3]
      or box_m[1] > box_s[3])
    return;

  // The master's corners run clockwise about the slave's normal: turn them,
  // without losing track of their edges
  LinearPart mr = m;
  std::reverse(mr.corners.begin(), mr.corners.begin() + m.size);
  std::reverse(mr.nodes.begin(), mr.nodes.begin() + m.size);
  std::reverse(pm.begin(), pm.begin() + m.size);

  const double size = std::max(box_s[2] - box_s[0], box_s[3] - box_s[1]);
  const ClipPolygon polygon
      = clip(std::span(ps).first(s.size), std::span(pm).first(m.size),
             clip_tolerance * size);
  if (polygon.size < 3)
    return;
  double area = 0, turned = 0;
  for (int i = 1; i + 1 < polygon.size; ++i)
  {
    const auto& a = polygon.vertices[0].p;
    const auto& b = polygon.vertices[i].p;
    const auto& c = polygon.vertices[i + 1].p;
    const double part
        = 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]));
    area += std::abs(part);
    turned = std::min(turned, part);
  }
  // Some triangle runs the other way round where a sub-facet is folded
  const double area_s = s.size == 3 ? 0.5 * s.norm_c : s.norm_c;
  if (!(area > sliver * area_s) or -turned > sliver * area_s)
  {
    points.dropped_area += area;
    return;
  }
  if (n.dot(m.n) > -limits.part)
  {
    points.dropped_area += area;
    return;
  }

  const bool derivatives = dn_s != nullptr;
  std::array<Vec3, 16> V;
  std::array<Mat24, 16> dV;
  for (int i = 0; i < polygon.size; ++i)
  {
    if (derivatives)
      dV[i] = vertex_derivative(polygon.vertices[i], s, mr, n, *dn_s, V[i]);
    else
      V[i] = vertex_position(polygon.vertices[i], s, mr, n);
  }

  const int num_s = num_nodes(slave.type), num_m = num_nodes(master.type);
  const int nd = 3 * (num_s + num_m);
  const int nsub = 3 * (s.size + m.size);
  SurfacePoint qs, qm;
  Mat23 Ls, Lm;
  for (int i = 1; i + 1 < polygon.size; ++i)
  {
    const Vec3 E1 = V[i] - V[0], E2 = V[i + 1] - V[0];
    const Vec3 E12 = E1.cross(E2);
    const double area2 = E12.dot(n);
    if (!(area2 > 0))
      continue;
    Row24 darea2;
    if (derivatives)
    {
      darea2 = E12.transpose() * *dn_s
               + E2.cross(n).transpose() * (dV[i] - dV[0])
               + n.cross(E1).transpose() * (dV[i + 1] - dV[0]);
    }
    // Find all points of the triangle before any is appended
    const std::size_t num_rule = rule.weights.size();
    for (std::size_t q = 0; q < num_rule; ++q)
    {
      const double b1 = rule.points[2 * q], b2 = rule.points[2 * q + 1];
      const Vec3 p = V[0] + b1 * E1 + b2 * E2;
      std::array<double, 2> xi = s.guess(p, n), eta = m.guess(p, n);
      if (!project(slave, p, n, xi, derivatives ? 2 : 1, qs, Ls)
          or !in_reference(slave.type, xi, folded))
        throw_folded(slave, p);
      if (!project(master, p, n, eta, 1, qm, Lm)
          or !in_reference(master.type, eta, reach)
          or !opposes(master, qm, n, limits.point))
      {
        points.dropped_area += rule.weights[q] * area2;
        continue;
      }

      const Vec3 c = qs.a1.cross(qs.a2);
      const double cn = std::abs(c.dot(n));
      const double measure = c.norm() / cn;
      const double w = rule.weights[q] * area2 * measure;
      points.xi.insert(points.xi.end(), xi.begin(), xi.end());
      points.eta.insert(points.eta.end(), eta.begin(), eta.end());
      points.w.push_back(w);
      if (!derivatives)
        continue;

      const std::size_t at = points.d.size();
      points.d.resize(at + 5 * nd, 0.0);
      Eigen::Map<Eigen::Matrix<double, 5, Eigen::Dynamic, Eigen::RowMajor>> T(
          points.d.data() + at, 5, nd);

      const double alpha = n.dot(qs.x - p), beta = n.dot(qm.x - p);
      const Mat24 dp = (1 - b1 - b2) * dV[0] + b1 * dV[i] + b2 * dV[i + 1];
      Eigen::Matrix<double, 5, 24> S;
      S.topRows<2>().noalias() = Ls * (dp + alpha * *dn_s);
      S.middleRows<2>(2).noalias() = Lm * (dp + beta * *dn_s);
      const MeasureDerivative dm(qs, n);
      S.row(4) = (rule.weights[q] * measure) * darea2
                 - w * (dm.C.transpose() * *dn_s);
      for (int j = 0; j < nsub / 3; ++j)
      {
        const int k = j < s.size ? s.nodes[j] : num_s + mr.nodes[j - s.size];
        T.middleCols<3>(3 * k) += S.middleCols<3>(3 * j);
      }
      // The facets themselves move
      for (int k = 0; k < num_s; ++k)
      {
        T.block<2, 3>(0, 3 * k) -= qs.s.N[k] * Ls;
        T.block<1, 3>(4, 3 * k)
            += w * (qs.s.dN[0][k] * dm.A + qs.s.dN[1][k] * dm.B).transpose();
      }
      for (int k = 0; k < num_m; ++k)
        T.block<2, 3>(2, 3 * (num_s + k)) -= qm.s.N[k] * Lm;
      const Vec3 a11 = second_derivative(slave, qs.s, 0);
      const Vec3 a12 = second_derivative(slave, qs.s, 1);
      const Vec3 a22 = second_derivative(slave, qs.s, 2);
      T.row(4) += w * (dm.A.dot(a11) + dm.B.dot(a12)) * T.row(0)
                  + w * (dm.A.dot(a12) + dm.B.dot(a22)) * T.row(1);
    }
  }
}
} // namespace

//-----------------------------------------------------------------------------
void dolfinx_mortar::append_segment_points(const FacetView& slave,
                                           const FacetView& master,
                                           const QuadratureRule& rule,
                                           const AngleLimits& limits,
                                           bool derivatives, PairPoints& points)
{
  for (const SubFacet& sub_s : sub_facets(slave.type))
  {
    const LinearPart s(slave, sub_s);
    if (!(s.norm_c > 0))
      throw_folded(slave, s.centre);
    Mat24 dn;
    if (derivatives)
    {
      dn.setZero();
      auto W = s.normal_derivative();
      for (int i = 0; i < s.size; ++i)
      {
        dn.block<3, 3>(0, 3 * i)
            = (Eigen::Matrix3d::Identity() - s.n * s.n.transpose()) * W[i]
              / s.norm_c;
      }
    }
    for (const SubFacet& sub_m : sub_facets(master.type))
    {
      const LinearPart m(master, sub_m);
      if (m.norm_c > 0 and s.n.dot(m.n) < 0)
      {
        sub_pair_points(slave, master, s, m, derivatives ? &dn : nullptr, rule,
                        limits, points);
      }
    }
  }
}
