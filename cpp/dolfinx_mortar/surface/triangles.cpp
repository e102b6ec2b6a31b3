// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "triangles.h"
#include <algorithm>

using namespace dolfinx_mortar;
using Vector = Eigen::Vector3d;

//-----------------------------------------------------------------------------
std::vector<std::array<std::int32_t, 3>> dolfinx_mortar::split(const Surface& s,
                                                               std::int32_t f)
{
  const std::span<const std::int32_t> nodes = facet_nodes(s, f);
  std::vector<std::array<std::int32_t, 3>> triangles;
  auto append = [&](int i, int j, int k)
  {
    if (s.orientation[f] < 0)
      std::swap(j, k);
    triangles.push_back({nodes[i], nodes[j], nodes[k]});
  };
  for (const SubFacet& sub : sub_facets(s.types[f]))
  {
    const auto& [i, j, k, l] = sub.nodes;
    append(i, j, k);
    if (sub.size == 4)
      append(j, l, k);
  }
  return triangles;
}
//-----------------------------------------------------------------------------
Vector dolfinx_mortar::middle_normal(const Surface& s,
                                     std::span<const double> x, std::int32_t f)
{
  const std::span<const std::int32_t> n = facet_nodes(s, f);
  Vector a = row(x, n[1]) - row(x, n[0]), b = row(x, n[2]) - row(x, n[0]);
  if (num_corners(s.types[f]) == 4)
  {
    a += row(x, n[3]) - row(x, n[2]);
    b += row(x, n[3]) - row(x, n[1]);
  }
  return s.orientation[f] * a.cross(b);
}
//-----------------------------------------------------------------------------
Vector dolfinx_mortar::middle(const Surface& s, std::span<const double> x,
                              std::int32_t f)
{
  const FacetType type = s.types[f];
  const double c = num_corners(type) == 3 ? 1.0 / 3 : 0.5;
  Shapes shapes;
  tabulate(type, {c, c}, 0, shapes);
  Vector p = Vector::Zero();
  const std::span<const std::int32_t> nodes = facet_nodes(s, f);
  for (std::size_t k = 0; k < nodes.size(); ++k)
    p += shapes.N[k] * row(x, nodes[k]);
  return p;
}
//-----------------------------------------------------------------------------
double dolfinx_mortar::diameter(const Surface& s, std::span<const double> x,
                                std::int32_t f)
{
  double d = 0;
  for (std::int32_t k : facet_nodes(s, f))
    for (std::int32_t l : facet_nodes(s, f))
      d = std::max(d, (row(x, k) - row(x, l)).norm());
  return d;
}
//-----------------------------------------------------------------------------
Vector dolfinx_mortar::barycentric(const Vector& p, const Corners& t)
{
  const Vector a = t[1] - t[0], b = t[2] - t[0], n = a.cross(b);
  const double area = n.squaredNorm();
  const double v = (p - t[0]).cross(b).dot(n) / area;
  const double w = a.cross(p - t[0]).dot(n) / area;
  return {1 - v - w, v, w};
}
//-----------------------------------------------------------------------------
Vector dolfinx_mortar::nearest_point(const Vector& p, const Corners& t)
{
  const Vector b = barycentric(p, t);
  if (b.minCoeff() >= 0)
    return b[0] * t[0] + b[1] * t[1] + b[2] * t[2];
  Vector nearest = t[0];
  for (int k = 0; k < 3; ++k)
  {
    const Vector e = t[(k + 1) % 3] - t[k];
    const double length = e.squaredNorm();
    const double s = length > 0 ? e.dot(p - t[k]) / length : 0.0;
    const Vector q = t[k] + std::clamp(s, 0.0, 1.0) * e;
    if ((q - p).squaredNorm() < (nearest - p).squaredNorm())
      nearest = q;
  }
  return nearest;
}
//-----------------------------------------------------------------------------
Depth dolfinx_mortar::deepest(MPI_Comm comm, const Depth& mine)
{
  int size;
  MPI_Comm_size(comm, &size);
  std::vector<Depth> all(size);
  static_assert(sizeof(Depth) == 4 * sizeof(double));
  MPI_Allgather(&mine, 4, MPI_DOUBLE, all.data(), 4, MPI_DOUBLE, comm);
  return *std::ranges::max_element(all, {}, [](const Depth& d)
                                   { return std::pair(d.depth, d.x); });
}
//-----------------------------------------------------------------------------
