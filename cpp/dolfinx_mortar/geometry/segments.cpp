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

using PlanePoint = std::array<double, 2>;

/// A linear part in the plane of the slave's.
struct PlanePolygon
{
  std::array<PlanePoint, 4> corners;
  int size;
  std::array<double, 4> box; // smallest coordinates, largest coordinates

  bool meets(const PlanePolygon& other) const
  {
    return !(box[0] > other.box[2] or other.box[0] > box[2]
             or box[1] > other.box[3] or other.box[1] > box[3]);
  }

  double width() const { return std::max(box[2] - box[0], box[3] - box[1]); }
};

/// The plane through the centre of a slave's linear part, normal to n₀.
struct Plane
{
  Vec3 origin, e1, e2;

  explicit Plane(const LinearPart& s) : origin(s.centre)
  {
    e1 = (s.corners[1] - s.corners[0]);
    e1 = (e1 - e1.dot(s.n) * s.n).normalized();
    e2 = s.n.cross(e1);
  }

  PlanePolygon project(const LinearPart& part) const
  {
    constexpr double inf = std::numeric_limits<double>::max();
    PlanePolygon p;
    p.size = part.size;
    p.box = {inf, inf, -inf, -inf};
    for (int i = 0; i < part.size; ++i)
    {
      p.corners[i] = {(part.corners[i] - origin).dot(e1),
                      (part.corners[i] - origin).dot(e2)};
      for (int c = 0; c < 2; ++c)
      {
        p.box[c] = std::min(p.box[c], p.corners[i][c]);
        p.box[2 + c] = std::max(p.box[2 + c], p.corners[i][c]);
      }
    }
    return p;
  }
};

/// Clip a slave's part with a master's whose corners run counter-clockwise too.
ClipPolygon overlap(const PlanePolygon& s, const PlanePolygon& m)
{
  return clip(std::span(s.corners).first(s.size),
              std::span(m.corners).first(m.size), clip_tolerance * s.width());
}

/// Areas of the triangles that a polygon is cut into.
struct PolygonAreas
{
  double sum = 0;    // of their sizes
  double turned = 0; // of the one that runs the other way round most, or zero

  explicit PolygonAreas(const ClipPolygon& polygon)
  {
    for (int i = 1; i + 1 < polygon.size; ++i)
    {
      const auto& a = polygon.vertices[0].p;
      const auto& b = polygon.vertices[i].p;
      const auto& c = polygon.vertices[i + 1].p;
      const double area
          = 0.5
            * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]));
      sum += std::abs(area);
      turned = std::min(turned, area);
    }
  }
};

/// Two linear parts that overlap, and the facets that they are parts of.
struct PartPair
{
  const FacetView &slave, &master;
  const LinearPart& s;
  const LinearPart& m; // corners counter-clockwise about the slave's normal
  const Mat24* dn;     // derivative of the slave's normal, or none
};

/// Corners of an overlap, and their derivatives where these are wanted.
struct Corners
{
  std::array<Vec3, 16> V;
  std::array<Mat24, 16> dV;

  Corners(const PartPair& pair, const ClipPolygon& polygon)
  {
    for (int i = 0; i < polygon.size; ++i)
    {
      const ClipVertex& v = polygon.vertices[i];
      if (pair.dn)
        dV[i] = vertex_derivative(v, pair.s, pair.m, pair.s.n, *pair.dn, V[i]);
      else
        V[i] = vertex_position(v, pair.s, pair.m, pair.s.n);
    }
  }
};

/// The triangle of corners 0, i and i + 1 of an overlap.
struct Triangle
{
  const Corners& corners;
  int i;
  Vec3 E1, E2;   // edges from corner 0
  double area2;  // twice its area
  Row24 d_area2; // set where derivatives are wanted

  Triangle(const PartPair& pair, const Corners& corners, int i)
      : corners(corners), i(i), E1(corners.V[i] - corners.V[0]),
        E2(corners.V[i + 1] - corners.V[0])
  {
    const Vec3& n = pair.s.n;
    const Vec3 E12 = E1.cross(E2);
    area2 = E12.dot(n);
    if (pair.dn and area2 > 0)
    {
      const auto& dV = corners.dV;
      d_area2 = E12.transpose() * *pair.dn
                + E2.cross(n).transpose() * (dV[i] - dV[0])
                + n.cross(E1).transpose() * (dV[i + 1] - dV[0]);
    }
  }
};

/// A quadrature point of a triangle, mapped to both facets.
struct MappedPoint
{
  double b1, b2;  // where it is in the triangle
  double weight;  // of the rule
  double measure; // area of the slave facet by area of the plane
  double w;       // weight on the slave facet
  Vec3 p;         // in the plane
  SurfacePoint s, m;
  Mat23 Ls, Lm; // see pullback
};

/// Append the derivatives of (ξ₁, ξ₂, η₁, η₂, w) at a point.
void append_derivative(const PartPair& pair, const Triangle& triangle,
                       const MappedPoint& q, std::vector<double>& d)
{
  const int num_s = num_nodes(pair.slave.type);
  const int num_m = num_nodes(pair.master.type);
  const int nd = 3 * (num_s + num_m);
  const std::size_t at = d.size();
  d.resize(at + 5 * nd, 0.0);
  Eigen::Map<Eigen::Matrix<double, 5, Eigen::Dynamic, Eigen::RowMajor>> T(
      d.data() + at, 5, nd);

  // By the corners of the parts
  const Vec3& n = pair.s.n;
  const Mat24& dn = *pair.dn;
  const auto& dV = triangle.corners.dV;
  const double alpha = n.dot(q.s.x - q.p), beta = n.dot(q.m.x - q.p);
  const Mat24 dp = (1 - q.b1 - q.b2) * dV[0] + q.b1 * dV[triangle.i]
                   + q.b2 * dV[triangle.i + 1];
  Eigen::Matrix<double, 5, 24> S;
  S.topRows<2>().noalias() = q.Ls * (dp + alpha * dn);
  S.middleRows<2>(2).noalias() = q.Lm * (dp + beta * dn);
  const MeasureDerivative dm(q.s, n);
  S.row(4) = (q.weight * q.measure) * triangle.d_area2
             - q.w * (dm.C.transpose() * dn);
  for (int j = 0; j < pair.s.size + pair.m.size; ++j)
  {
    const int k = j < pair.s.size ? pair.s.nodes[j]
                                  : num_s + pair.m.nodes[j - pair.s.size];
    T.middleCols<3>(3 * k) += S.middleCols<3>(3 * j);
  }

  // The facets themselves move
  for (int k = 0; k < num_s; ++k)
  {
    T.block<2, 3>(0, 3 * k) -= q.s.s.N[k] * q.Ls;
    T.block<1, 3>(4, 3 * k)
        += q.w * (q.s.s.dN[0][k] * dm.A + q.s.s.dN[1][k] * dm.B).transpose();
  }
  for (int k = 0; k < num_m; ++k)
    T.block<2, 3>(2, 3 * (num_s + k)) -= q.m.s.N[k] * q.Lm;
  const Vec3 a11 = second_derivative(pair.slave, q.s.s, 0);
  const Vec3 a12 = second_derivative(pair.slave, q.s.s, 1);
  const Vec3 a22 = second_derivative(pair.slave, q.s.s, 2);
  T.row(4) += q.w * (dm.A.dot(a11) + dm.B.dot(a12)) * T.row(0)
              + q.w * (dm.A.dot(a12) + dm.B.dot(a22)) * T.row(1);
}

/// Points of a triangle of the overlap.
void append_triangle_points(const PartPair& pair, const Triangle& triangle,
                            const QuadratureRule& rule,
                            const AngleLimits& limits, PairPoints& points)
{
  const Vec3& n = pair.s.n;
  MappedPoint point;
  for (std::size_t q = 0; q < rule.weights.size(); ++q)
  {
    point.b1 = rule.points[2 * q];
    point.b2 = rule.points[2 * q + 1];
    point.weight = rule.weights[q];
    const Vec3 p = triangle.corners.V[0] + point.b1 * triangle.E1
                   + point.b2 * triangle.E2;
    point.p = p;
    std::array<double, 2> xi = pair.s.guess(p, n), eta = pair.m.guess(p, n);
    if (!project(pair.slave, p, n, xi, pair.dn ? 2 : 1, point.s, point.Ls)
        or !in_reference(pair.slave.type, xi, folded))
      throw_folded(pair.slave, p);
    if (!project(pair.master, p, n, eta, 1, point.m, point.Lm)
        or !in_reference(pair.master.type, eta, reach)
        or !opposes(pair.master, point.m, n, limits.point))
    {
      points.dropped_area += point.weight * triangle.area2;
      continue;
    }

    const Vec3 c = point.s.a1.cross(point.s.a2);
    point.measure = c.norm() / std::abs(c.dot(n));
    point.w = point.weight * triangle.area2 * point.measure;
    points.xi.insert(points.xi.end(), xi.begin(), xi.end());
    points.eta.insert(points.eta.end(), eta.begin(), eta.end());
    points.w.push_back(point.w);
    if (pair.dn)
      append_derivative(pair, triangle, point, points.d);
  }
}

/// Points of one pair of sub-facets.
/// @param[in] dn Derivative of the slave's normal, where derivatives are
/// wanted.
void append_part_points(const FacetView& slave, const FacetView& master,
                        const LinearPart& s, const LinearPart& m,
                        const Mat24* dn, const QuadratureRule& rule,
                        const AngleLimits& limits, PairPoints& points)
{
  const Plane plane(s);
  const PlanePolygon ps = plane.project(s);
  PlanePolygon pm = plane.project(m);
  if (!ps.meets(pm))
    return;

  // The master's corners run clockwise about the slave's normal: turn them,
  // without losing track of their edges
  LinearPart turned = m;
  std::reverse(turned.corners.begin(), turned.corners.begin() + m.size);
  std::reverse(turned.nodes.begin(), turned.nodes.begin() + m.size);
  std::reverse(pm.corners.begin(), pm.corners.begin() + m.size);

  const ClipPolygon polygon = overlap(ps, pm);
  if (polygon.size < 3)
    return;
  // Some triangle runs the other way round where a sub-facet is folded
  const PolygonAreas areas(polygon);
  const double area_s = s.size == 3 ? 0.5 * s.norm_c : s.norm_c;
  if (!(areas.sum > sliver * area_s) or -areas.turned > sliver * area_s
      or s.n.dot(m.n) > -limits.part)
  {
    points.dropped_area += areas.sum;
    return;
  }

  const PartPair pair = {slave, master, s, turned, dn};
  const Corners corners(pair, polygon);
  for (int i = 1; i + 1 < polygon.size; ++i)
  {
    const Triangle triangle(pair, corners, i);
    if (triangle.area2 > 0)
      append_triangle_points(pair, triangle, rule, limits, points);
  }
}

/// Derivative of the normal of a slave's linear part by its corners.
Mat24 unit_normal_derivative(const LinearPart& s)
{
  Mat24 dn = Mat24::Zero();
  auto W = s.normal_derivative();
  for (int i = 0; i < s.size; ++i)
  {
    dn.block<3, 3>(0, 3 * i)
        = (Eigen::Matrix3d::Identity() - s.n * s.n.transpose()) * W[i]
          / s.norm_c;
  }
  return dn;
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
      dn = unit_normal_derivative(s);
    for (const SubFacet& sub_m : sub_facets(master.type))
    {
      const LinearPart m(master, sub_m);
      if (m.norm_c > 0 and s.n.dot(m.n) < 0)
      {
        append_part_points(slave, master, s, m, derivatives ? &dn : nullptr,
                           rule, limits, points);
      }
    }
  }
}
