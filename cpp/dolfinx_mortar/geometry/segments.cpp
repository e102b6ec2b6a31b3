// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "clip.h"
#include "packed_points.h"
#include "pair.h"
#include <algorithm>
#include <cmath>
#include <limits>

using namespace dolfinx_mortar;

namespace
{
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

/// Starting points of the projection to a facet: the places on its linear part.
struct Guess
{
  Vec3 centre;
  Eigen::Vector2d xi;
  Mat23 L;

  Guess(const LinearPart& part, const Vec3& n)
      : centre(part.centre), xi(part.xi),
        L(part.r1 * pullback(part.t1, part.t2, n).row(0)
          + part.r2 * pullback(part.t1, part.t2, n).row(1))
  {
  }

  void set(const PackVec3& p, std::array<Pack, 2>& out) const
  {
    for (int a = 0; a < 2; ++a)
    {
      out[a] = constant<Pack>(xi[a]);
      for (int i = 0; i < 3; ++i)
        out[a] += L(a, i) * (p[i] - centre[i]);
    }
  }
};

/// Two linear parts that overlap, and the facets that they are parts of.
struct PartPair
{
  const FacetView &slave, &master;
  const LinearPart &s, &m; // corners counter-clockwise about the slave's normal
  Guess guess_s, guess_m;
};

/// Four points of a triangle of an overlap, on both facets.
struct MappedPack
{
  std::array<Pack, 3> b; // coordinates in the triangle
  Pack weight;           // of the rule, times twice the area
  PackVec3 p;            // in the plane
  PackedPoint s, m;
};

/// Append one of four points.
/// @param[in] triangle Triangle of the record of derivatives, or -1.
void append_point(const PartPair& pair, const MappedPack& pack, int lane,
                  int triangle, PairPoints& points)
{
  auto at = [lane](const PackVec3& v)
  { return Vec3(v[0][lane], v[1][lane], v[2][lane]); };
  const Vec3& n = pair.s.n;
  const Vec3 a1 = at(pack.s.a1), a2 = at(pack.s.a2), c = a1.cross(a2);
  const double cn = c.dot(n);
  const double w = pack.weight[lane] * (c.norm() / std::abs(cn));
  for (int a = 0; a < 2; ++a)
  {
    points.xi.push_back(pack.s.xi[a][lane]);
    points.eta.push_back(pack.m.xi[a][lane]);
  }
  points.w.push_back(w);
  if (triangle < 0)
    return;

  SegmentDerivative::Point& q = points.segments.points.emplace_back();
  q.triangle = triangle;
  q.w = w;
  const Vec3 p = at(pack.p);
  q.alpha = n.dot(at(pack.s.x) - p);
  q.beta = n.dot(at(pack.m.x) - p);
  for (int i = 0; i < 3; ++i)
  {
    q.b[i] = pack.b[i][lane];
    for (int a = 0; a < 2; ++a)
    {
      q.Ls(a, i) = pack.s.L[a][i][lane];
      q.Lm(a, i) = pack.m.L[a][i][lane];
    }
  }
  // The derivative of log(|c| / |c·n|)
  const Vec3 r = c / c.squaredNorm() - n / cn;
  q.a1 = a2.cross(r);
  q.a2 = r.cross(a1);
  q.c = c / cn;
  const Vec3 a11 = at(pack.s.a11), a12 = at(pack.s.a12), a22 = at(pack.s.a22);
  q.kappa = {q.a1.dot(a11) + q.a2.dot(a12), q.a1.dot(a12) + q.a2.dot(a22)};
  for (int k = 0; k < num_nodes(pair.slave.type); ++k)
  {
    q.N[k] = pack.s.s.N[k][lane];
    q.dN1[k] = pack.s.s.dN[0][k][lane];
    q.dN2[k] = pack.s.s.dN[1][k][lane];
  }
  for (int k = 0; k < num_nodes(pair.master.type); ++k)
    q.Nm[k] = pack.m.s.N[k][lane];
}

/// Append those of four points that have a place on the master.
void append_pack(const PartPair& pair, const MappedPack& pack, int num,
                 const AngleLimits& limits, int triangle, PairPoints& points)
{
  const Vec3& n = pair.s.n;
  for (int i = 0; i < num; ++i)
  {
    auto in = [i](FacetType type, const std::array<Pack, 2>& xi, double tol)
    { return in_reference(type, {xi[0][i], xi[1][i]}, tol); };
    if (!pack.s.found[i] or !in(pair.slave.type, pack.s.xi, folded))
      throw_folded(pair.slave, Vec3(pack.p[0][i], pack.p[1][i], pack.p[2][i]));
    const PackVec3 &a1 = pack.m.a1, &a2 = pack.m.a2;
    if (!pack.m.found[i] or !in(pair.master.type, pack.m.xi, reach)
        or !opposes(pair.master, Vec3(a1[0][i], a1[1][i], a1[2][i]),
                    Vec3(a2[0][i], a2[1][i], a2[2][i]), n, limits.point))
    {
      points.dropped_area += pack.weight[i];
      continue;
    }
    append_point(pair, pack, i, triangle, points);
  }
}

/// Points of the triangle of corners 0, i and i + 1 of an overlap.
/// @param[in] triangle See append_point.
void append_triangle_points(const PartPair& pair, std::span<const Vec3> V,
                            int i, double area2, const QuadratureRule& rule,
                            const AngleLimits& limits, int triangle,
                            PairPoints& points)
{
  const Vec3 &n = pair.s.n, E1 = V[i] - V[0], E2 = V[i + 1] - V[0];
  const int num = rule.weights.size();
  MappedPack pack;
  for (int first = 0; first < num; first += pack_size)
  {
    for (int l = 0; l < pack_size; ++l)
    {
      const int q = std::min(first + l, num - 1);
      const double b1 = rule.points[2 * q], b2 = rule.points[2 * q + 1];
      pack.b[0][l] = 1 - b1 - b2;
      pack.b[1][l] = b1;
      pack.b[2][l] = b2;
      pack.weight[l] = rule.weights[q] * area2;
    }
    for (int c = 0; c < 3; ++c)
      pack.p[c] = V[0][c] + E1[c] * pack.b[1] + E2[c] * pack.b[2];
    pair.guess_s.set(pack.p, pack.s.xi);
    pair.guess_m.set(pack.p, pack.m.xi);
    project_pack(pair.slave, pack.p, n, triangle < 0 ? 1 : 2, pack.s);
    project_pack(pair.master, pack.p, n, 1, pack.m);
    append_pack(pair, pack, std::min(pack_size, num - first), limits, triangle,
                points);
  }
}

/// A linear part of the slave with its plane.
struct SlavePart
{
  LinearPart part;
  Plane plane;
  PlanePolygon polygon;

  explicit SlavePart(const LinearPart& s)
      : part(s), plane(s), polygon(plane.project(s))
  {
  }
};

/// Points of one pair of sub-facets.
void append_part_points(const FacetView& slave, const FacetView& master,
                        const SlavePart& slave_part, const LinearPart& m,
                        const QuadratureRule& rule, const AngleLimits& limits,
                        bool derivatives, PairPoints& points)
{
  const LinearPart& s = slave_part.part;
  PlanePolygon pm = slave_part.plane.project(m);
  if (!slave_part.polygon.meets(pm))
    return;

  // The master's corners run clockwise about the slave's normal: turn them,
  // without losing track of their edges
  LinearPart turned = m;
  std::reverse(turned.corners.begin(), turned.corners.begin() + m.size);
  std::reverse(turned.nodes.begin(), turned.nodes.begin() + m.size);
  std::reverse(pm.corners.begin(), pm.corners.begin() + m.size);

  const ClipPolygon polygon = overlap(slave_part.polygon, pm);
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

  std::array<Vec3, 16> V;
  for (int i = 0; i < polygon.size; ++i)
    V[i] = overlap_corner(polygon.vertices[i], s, turned, s.n);
  SegmentDerivative& record = points.segments;
  const int index = record.overlaps.size();
  if (derivatives)
    record.overlaps.push_back({s, turned, polygon, V});
  const PartPair pair
      = {slave, master, s, turned, Guess(s, s.n), Guess(turned, s.n)};
  for (int i = 1; i + 1 < polygon.size; ++i)
  {
    const double area2 = (V[i] - V[0]).cross(V[i + 1] - V[0]).dot(s.n);
    if (!(area2 > 0))
      continue;
    int triangle = -1;
    if (derivatives)
    {
      triangle = record.triangles.size();
      record.triangles.push_back({index, i});
    }
    append_triangle_points(pair, V, i, area2, rule, limits, triangle, points);
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
  std::vector<LinearPart> parts;
  parts.reserve(5);
  for (const SubFacet& sub : sub_facets(master.type))
    parts.emplace_back(master, sub);
  for (const SubFacet& sub : sub_facets(slave.type))
  {
    const LinearPart s(slave, sub);
    if (!(s.norm_c > 0))
      throw_folded(slave, s.centre);
    const SlavePart slave_part(s);
    for (const LinearPart& m : parts)
    {
      if (m.norm_c > 0 and s.n.dot(m.n) < 0)
      {
        append_part_points(slave, master, slave_part, m, rule, limits,
                           derivatives, points);
      }
    }
  }
}
