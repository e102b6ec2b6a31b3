// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "crossing.h"
#include "boxes.h"
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

using namespace dolfinx_mortar;

namespace
{
using Vector = Eigen::Vector3d;
using Array = std::array<double, 3>;

/// Positions of a surface's nodes at both ends of the step.
struct Motion
{
  const Surface& surface;
  std::span<const double> before, after;

  /// What is added to `before`, so that a motion of all is none
  Vector shift;

  Vector at(std::int32_t node, double t) const
  {
    return (1 - t) * (row(before, node) + shift) + t * row(after, node);
  }
};

/// A triangle that moves, as it travels: `x[0]` before, `x[1]` after.
struct Triangle
{
  std::array<std::array<Array, 3>, 2> x;
  double diameter; ///< of its facet
};

Corners corners(const Triangle& triangle, double t)
{
  Corners c;
  for (int k = 0; k < 3; ++k)
    c[k] = (1 - t) * Eigen::Map<const Vector>(triangle.x[0][k].data())
           + t * Eigen::Map<const Vector>(triangle.x[1][k].data());
  return c;
}

Vector normal(const Corners& c) { return (c[1] - c[0]).cross(c[2] - c[0]); }

/// A point that moves, and the normals of its facet.
struct Point
{
  std::array<Vector, 2> x, normals;
  double diameter; ///< of its facet

  Vector at(double t) const { return (1 - t) * x[0] + t * x[1]; }

  bool faces(const Corners& c, double t) const
  {
    return normal(c).dot((1 - t) * normals[0] + t * normals[1]) < 0;
  }
};

double volume(const Vector& p, const Vector& a, const Vector& b)
{
  return p.dot(a.cross(b));
}

/// Coefficients of the volume of point and triangle in Bernstein polynomials.
std::array<double, 4> volumes(const Point& point, const Triangle& triangle)
{
  std::array<std::array<Vector, 3>, 2> v;
  for (int i = 0; i < 2; ++i)
  {
    const Corners c = corners(triangle, i);
    v[i] = {point.x[i] - c[0], c[1] - c[0], c[2] - c[0]};
  }
  auto mixed
      = [&](int i, int j, int k) { return volume(v[i][0], v[j][1], v[k][2]); };
  return {
      mixed(0, 0, 0), (mixed(1, 0, 0) + mixed(0, 1, 0) + mixed(0, 0, 1)) / 3,
      (mixed(0, 1, 1) + mixed(1, 0, 1) + mixed(1, 1, 0)) / 3, mixed(1, 1, 1)};
}

/// Call `fn` with the times in [begin, end] at which a cubic polynomial, given
/// by its Bernstein coefficients there, changes its sign; ascending. Zero
/// counts as positive.
template <typename F>
void sign_changes(const std::array<double, 4>& b, double begin, double end,
                  F&& fn)
{
  const int negative = std::ranges::count_if(b, [](double v) { return v < 0; });
  if (negative == 0 or negative == 4)
    return;
  const double middle = (begin + end) / 2;
  if (end - begin < 1e-9)
  {
    if ((b[0] < 0) != (b[3] < 0))
      fn(middle);
    return;
  }
  const double p = (b[0] + b[1]) / 2, q = (b[1] + b[2]) / 2,
               r = (b[2] + b[3]) / 2, s = (p + q) / 2, t = (q + r) / 2;
  const double centre = (s + t) / 2;
  sign_changes({b[0], p, s, centre}, begin, middle, fn);
  sign_changes({centre, t, r, b[3]}, middle, end, fn);
}

/// A point goes through a triangle.
struct Event
{
  double time;
  bool enters;
  const Triangle* triangle;
};

/// Append the times at which a point goes through a triangle.
void append_events(std::vector<Event>& events, const Point& point,
                   const Triangle& triangle)
{
  const std::array<double, 4> b = volumes(point, triangle);
  bool behind = b[0] < 0;
  sign_changes(b, 0, 1,
               [&](double t)
               {
                 behind = !behind;
                 const Corners c = corners(triangle, t);
                 // Too many rather than a gap between neighbours
                 if (barycentric(point.at(t), c).minCoeff() > -1e-6
                     and point.faces(c, t))
                   events.push_back({t, behind, &triangle});
               });
}

/// How far a point is behind a triangle's plane at the end
double depth(const Point& point, const Triangle& triangle)
{
  const Corners c = corners(triangle, 1);
  return -(point.x[1] - c[0]).dot(normal(c).normalized());
}

/// How deep a point is after it has passed through, else zero.
/// @param[in] near Triangles whose boxes meet that of the point.
/// @param[in] reach Distance within which contact sees a triangle.
template <typename Reach>
double passed(const Point& point, std::span<const Triangle* const> near,
              Reach&& reach)
{
  std::vector<Event> events;
  for (const Triangle* t : near)
    append_events(events, point, *t);

  // Behind the surface at the beginning, where that is nearest?
  double nearest = Box::inf;
  const Triangle* first = nullptr;
  for (const Triangle* t : near)
  {
    const Corners c = corners(*t, 0);
    const double d = (nearest_point(point.x[0], c) - point.x[0]).norm();
    if (d > reach(*t) or d >= nearest or !point.faces(c, 0))
      continue;
    nearest = d;
    const bool behind = (point.x[0] - c[0]).dot(normal(c)) < 0
                        and barycentric(point.x[0], c).minCoeff() > -1e-6;
    first = behind ? t : nullptr;
  }
  if (first)
    events.push_back({-1, true, first});

  std::ranges::stable_sort(events, {}, &Event::time);
  double deep = 0;
  for (const Event& e : events)
  {
    const double d = e.enters ? depth(point, *e.triangle) : 0.0;
    deep = !e.enters ? 0.0 : d > reach(*e.triangle) ? std::max(d, deep) : deep;
  }
  if (deep == 0)
    return 0;
  for (const Triangle* t : near)
  {
    const Corners c = corners(*t, 1);
    const double d = (nearest_point(point.x[1], c) - point.x[1]).norm();
    if (d <= reach(*t) and point.faces(c, 1))
      return 0;
  }
  return deep;
}

Box box_of(const Triangle& t)
{
  Box box;
  for (const auto& x : t.x)
    for (const Array& p : x)
      add(box, p);
  return box;
}

std::vector<Triangle> triangles(const Motion& m)
{
  std::vector<Triangle> list;
  for (std::size_t f = 0; f < m.surface.types.size(); ++f)
  {
    const double size = diameter(m.surface, m.after, f);
    for (const auto& nodes : split(m.surface, f))
    {
      Triangle t = {{}, size};
      for (int i = 0; i < 2; ++i)
        for (int k = 0; k < 3; ++k)
          t.x[i][k] = as_array(m.at(nodes[k], i));
      list.push_back(t);
    }
  }
  return list;
}

/// Nodes and middle of a facet.
std::vector<Point> points(const Motion& m, std::int32_t f)
{
  const std::array<Vector, 2> normals = {middle_normal(m.surface, m.before, f),
                                         middle_normal(m.surface, m.after, f)};
  const double size = diameter(m.surface, m.after, f);
  std::vector<Point> list;
  for (std::int32_t k : facet_nodes(m.surface, f))
    list.push_back({{m.at(k, 0), m.at(k, 1)}, normals, size});
  list.push_back({{middle(m.surface, m.before, f) + m.shift,
                   middle(m.surface, m.after, f)},
                  normals,
                  size});
  return list;
}

/// Deepest of this rank's points of one surface behind the other one.
Depth look(const Motion& from, const Motion& at, std::optional<double> distance)
{
  auto extent = [&](double diameter) { return distance ? 0.0 : diameter; };
  const double extra = distance.value_or(0);
  std::vector<Point> all;
  std::vector<Box> around;
  auto box_of_point = [&](const Point& p)
  {
    Box box;
    add(box, as_array(p.x[0]));
    add(box, as_array(p.x[1]));
    return grown(box, extent(p.diameter) + extra);
  };
  for (std::size_t f = 0; f < from.surface.types.size(); ++f)
  {
    around.emplace_back();
    for (const Point& p : points(from, f))
    {
      all.push_back(p);
      add(around.back(), box_of_point(p));
    }
  }

  auto boxes = [&](std::span<const Triangle> list)
  {
    std::vector<Box> b;
    for (const Triangle& t : list)
      b.push_back(grown(box_of(t), extent(t.diameter)));
    return b;
  };
  const std::vector<Triangle> local = triangles(at);
  const std::vector<Triangle> list
      = collect_near(at.surface.comm, boxes_of_parts(from.surface, around),
                     std::span<const Triangle>(local), boxes(local));
  const BoxTree tree = create_tree(boxes(list));

  Depth deep;
  std::vector<const Triangle*> near;
  for (const Point& p : all)
  {
    near.clear();
    query(tree, box_of_point(p),
          [&](std::int32_t i) { near.push_back(&list[i]); });
    const double d = passed(
        p, near, [&](const Triangle& t)
        { return distance.value_or(std::max(p.diameter, t.diameter)); });
    if (d > deep.depth)
      deep = {d, as_array(p.x[1])};
  }
  return deep;
}

/// Mean displacement of the nodes of surfaces. Collective.
Vector mean_displacement(const Motion& a, const Motion& b)
{
  std::array<double, 4> sums = {0, 0, 0, 0};
  for (const Motion* m : {&a, &b})
    for (std::int32_t k = 0; k < m->surface.num_owned; ++k)
    {
      const Vector d = row(m->after, k) - row(m->before, k);
      for (int c = 0; c < 3; ++c)
        sums[c] += d[c];
      sums[3] += 1;
    }
  MPI_Allreduce(MPI_IN_PLACE, sums.data(), 4, MPI_DOUBLE, MPI_SUM,
                a.surface.comm);
  return Vector(sums[0], sums[1], sums[2]) / std::max(sums[3], 1.0);
}
} // namespace

//-----------------------------------------------------------------------------
Depth dolfinx_mortar::find_crossing(const Surface& slave,
                                    std::span<const double> slave_before,
                                    std::span<const double> slave_after,
                                    const Surface& master,
                                    std::span<const double> master_before,
                                    std::span<const double> master_after,
                                    std::optional<double> distance)
{
  Motion a = {slave, slave_before, slave_after, Vector::Zero()};
  Motion b = {master, master_before, master_after, Vector::Zero()};
  a.shift = b.shift = mean_displacement(a, b);
  const Depth from_slave = look(a, b, distance);
  const Depth from_master = look(b, a, distance);
  return deepest(slave.comm, from_slave.depth >= from_master.depth
                                 ? from_slave
                                 : from_master);
}
//-----------------------------------------------------------------------------
