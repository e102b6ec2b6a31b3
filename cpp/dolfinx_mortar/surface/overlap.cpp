// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "overlap.h"
#include "boxes.h"
#include <algorithm>
#include <cmath>
#include <vector>

using namespace dolfinx_mortar;

namespace
{
using Vector = Eigen::Vector3d;
using Array = std::array<double, 3>;

/// A master triangle as it travels.
struct Triangle
{
  std::array<Array, 3> x;
  Array normal; ///< of its facet
  double size;  ///< diameter of its facet
  std::int64_t body;
};

/// A ray from a slave facet into its own body.
struct Ray
{
  Vector x, n; ///< middle and outward unit normal of the facet
  double size;
  std::int64_t body;
  double length; ///< to where it leaves the boxes of the masters that x is in
};

bool inside(const Vector& x, const Box& box)
{
  for (int c = 0; c < 3; ++c)
    if (!(x[c] > box.lower[c] and x[c] < box.upper[c]))
      return false;
  return true;
}

/// Length of the ray within a box that it begins in
double length_within(const Ray& ray, const Box& box)
{
  double length = Box::inf;
  for (int c = 0; c < 3; ++c)
  {
    const double end = ray.n[c] > 0 ? box.lower[c] : box.upper[c];
    if (ray.n[c] != 0)
      length = std::min(length, (ray.x[c] - end) / ray.n[c]);
  }
  return length;
}

Box box_of(const Ray& ray)
{
  Box box;
  add(box, as_array(ray.x));
  // The facet it leaves through may be on the side of the box: mind round-off
  add(box, as_array(ray.x - 1.001 * ray.length * ray.n));
  return box;
}

/// Triangles of the master facets of this rank, and their boxes
std::pair<std::vector<Triangle>, std::vector<Box>>
triangles(const Surface& s, std::span<const double> x,
          std::span<const std::int64_t> bodies)
{
  std::vector<Triangle> list;
  std::vector<Box> boxes;
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    const Array normal = as_array(middle_normal(s, x, f));
    const double size = diameter(s, x, f);
    for (const auto& nodes : split(s, f))
    {
      Triangle t = {{}, normal, size, bodies[f]};
      Box box;
      for (int k = 0; k < 3; ++k)
      {
        t.x[k] = as_array(row(x, nodes[k]));
        add(box, t.x[k]);
      }
      list.push_back(t);
      boxes.push_back(box);
    }
  }
  return {std::move(list), std::move(boxes)};
}

/// Distance along a ray to a triangle; infinite where it does not meet it
double distance(const Ray& ray, const Triangle& t)
{
  const Vector p = Eigen::Map<const Vector>(t.x[0].data());
  const Vector a = Eigen::Map<const Vector>(t.x[1].data()) - p;
  const Vector b = Eigen::Map<const Vector>(t.x[2].data()) - p;
  const Vector h = b.cross(ray.n), s = ray.x - p, q = s.cross(a);
  const double det = a.dot(h);
  const double v = s.dot(h) / det, w = -q.dot(ray.n) / det;
  const double along = b.dot(q) / det;
  const bool meets = v >= 0 and w >= 0 and v + w <= 1 and along > 0;
  return meets ? along : Box::inf;
}

/// How deep the facet of a ray is in another body, else zero
double depth(const Ray& ray, std::span<const Triangle> triangles,
             const BoxTree& tree, std::span<const Box> bodies)
{
  double first = Box::inf;
  const Triangle* hit = nullptr;
  query(tree, box_of(ray),
        [&](std::int32_t i)
        {
          const double d = distance(ray, triangles[i]);
          if (d < first)
          {
            first = d;
            hit = &triangles[i];
          }
        });
  if (!hit or hit->body == ray.body or !inside(ray.x, bodies[hit->body]))
    return 0;
  const bool leaves
      = Eigen::Map<const Vector>(hit->normal.data()).dot(ray.n) < 0;
  return leaves and first > std::max(ray.size, hit->size) ? first : 0;
}
} // namespace

//-----------------------------------------------------------------------------
Depth dolfinx_mortar::find_overlap(const Surface& slave,
                                   std::span<const double> x_slave,
                                   std::span<const std::int8_t> test,
                                   std::span<const std::int64_t> slave_bodies,
                                   const Surface& master,
                                   std::span<const double> x_master,
                                   std::span<const std::int64_t> master_bodies,
                                   std::span<const double> boxes)
{
  std::vector<Box> bodies(boxes.size() / 6);
  std::vector<std::int8_t> is_master(bodies.size(), 0);
  for (std::size_t b = 0; b < bodies.size(); ++b)
  {
    std::copy_n(boxes.data() + 6 * b, 3, bodies[b].lower.begin());
    std::copy_n(boxes.data() + 6 * b + 3, 3, bodies[b].upper.begin());
  }
  for (std::int64_t b : master_bodies)
    is_master[b] = 1;
  MPI_Allreduce(MPI_IN_PLACE, is_master.data(), is_master.size(), MPI_INT8_T,
                MPI_MAX, slave.comm);

  std::vector<Ray> rays;
  std::vector<Box> around(slave.types.size());
  for (std::size_t f = 0; f < slave.types.size(); ++f)
  {
    if (!test[f])
      continue;
    Ray ray = {middle(slave, x_slave, f),
               middle_normal(slave, x_slave, f).normalized(),
               diameter(slave, x_slave, f), slave_bodies[f], 0};
    for (std::size_t b = 0; b < bodies.size(); ++b)
      if (is_master[b] and static_cast<std::int64_t>(b) != ray.body
          and inside(ray.x, bodies[b]))
        ray.length = std::max(ray.length, length_within(ray, bodies[b]));
    if (ray.length > 0)
    {
      rays.push_back(ray);
      around[f] = box_of(ray);
    }
  }

  const auto [local, local_boxes] = triangles(master, x_master, master_bodies);
  const std::vector<Triangle> near
      = collect_near(slave.comm, boxes_of_parts(slave, around),
                     std::span<const Triangle>(local), local_boxes);
  std::vector<Box> near_boxes(near.size());
  for (std::size_t i = 0; i < near.size(); ++i)
    for (const Array& x : near[i].x)
      add(near_boxes[i], x);
  const BoxTree tree = create_tree(near_boxes);
  Depth deep;
  for (const Ray& ray : rays)
  {
    const double d = depth(ray, near, tree, bodies);
    if (d > deep.depth)
      deep = {d, as_array(ray.x)};
  }
  return deepest(slave.comm, deep);
}
//-----------------------------------------------------------------------------
