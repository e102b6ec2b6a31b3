// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "packed_points.h"
#include "shape_functions.h"
#include <algorithm>

using namespace dolfinx_mortar;

namespace
{
/// What project_pack was given
struct Line
{
  const double* nodes; // positions of the nodes
  const double* n;
  const PackVec3* p;
  int order;
};

MORTAR_INLINE void cross(const PackVec3& a, const PackVec3& b, PackVec3& c)
{
  c[0] = a[1] * b[2] - a[2] * b[1];
  c[1] = a[2] * b[0] - a[0] * b[2];
  c[2] = a[0] * b[1] - a[1] * b[0];
}

/// Σ N_k x_k
template <int n>
MORTAR_INLINE void interpolate(const std::array<Pack, max_facet_nodes>& N,
                               const double* nodes, PackVec3& x)
{
#pragma GCC unroll 3
  for (int c = 0; c < 3; ++c)
  {
    Pack sum = N[0] * nodes[c];
#pragma GCC unroll 9
    for (int k = 1; k < n; ++k)
      sum += N[k] * nodes[3 * k + c];
    x[c] = sum;
  }
}

/// Position, tangents and pullback at the places of a point.
template <FacetType type>
MORTAR_INLINE void evaluate_pack(const Line& line, PackedPoint& point)
{
  constexpr int n = num_nodes(type);
  interpolate<n>(point.s.N, line.nodes, point.x);
  interpolate<n>(point.s.dN[0], line.nodes, point.a1);
  interpolate<n>(point.s.dN[1], line.nodes, point.a2);
  const PackVec3 normal = {constant<Pack>(line.n[0]), constant<Pack>(line.n[1]),
                           constant<Pack>(line.n[2])};
  PackVec3 c;
  cross(point.a1, point.a2, c);
  const Pack scale
      = 1 / (c[0] * normal[0] + c[1] * normal[1] + c[2] * normal[2]);
  cross(point.a2, normal, point.L[0]);
  cross(normal, point.a1, point.L[1]);
  for (int a = 0; a < 2; ++a)
  {
    for (int i = 0; i < 3; ++i)
      point.L[a][i] *= scale;
  }
}

/// Newton's iteration of `project` for each of four points.
template <FacetType type>
MORTAR_INLINE void project_type(const Line* line, PackedPoint* point)
{
  constexpr int n = num_nodes(type);
  PackedPoint& q = *point;
  std::array<bool, pack_size> moving;
  moving.fill(true);
  q.found.fill(false);
  for (int it = 0; it < 25; ++it)
  {
    tabulate_functions<type>(q.xi[0], q.xi[1], 1, q.s);
    evaluate_pack<type>(*line, q);
    std::array<Pack, 2> step;
    for (int a = 0; a < 2; ++a)
    {
      step[a] = q.L[a][0] * ((*line->p)[0] - q.x[0])
                + q.L[a][1] * ((*line->p)[1] - q.x[1])
                + q.L[a][2] * ((*line->p)[2] - q.x[2]);
    }
    bool done = true;
    for (int i = 0; i < pack_size; ++i)
    {
      const double size
          = std::fmax(std::fabs(step[0][i]), std::fabs(step[1][i]));
      const bool valid = std::isfinite(step[0][i] + step[1][i]) and size < 10;
      const bool moves = moving[i] and valid;
      if (moves)
      {
        q.xi[0][i] += step[0][i];
        q.xi[1][i] += step[1][i];
        q.found[i] = size < 1e-8;
      }
      moving[i] = moves and !q.found[i];
      done = done and !moving[i];
    }
    if (done)
      break;
  }
  tabulate_functions<type>(q.xi[0], q.xi[1], line->order, q.s);
  evaluate_pack<type>(*line, q);
  if (line->order > 1)
  {
    interpolate<n>(q.s.ddN[0], line->nodes, q.a11);
    interpolate<n>(q.s.ddN[1], line->nodes, q.a12);
    interpolate<n>(q.s.ddN[2], line->nodes, q.a22);
  }
}

/// What tabulate_points was given
struct Tabulation
{
  std::span<const double> xi;
  double* N;
  std::array<double*, 2> dN;
};

template <FacetType type>
MORTAR_INLINE void tabulate_type(const Tabulation* t)
{
  constexpr int n = num_nodes(type);
  const int num = t->xi.size() / 2;
  ShapesOf<Pack> s;
  for (int first = 0; first < num; first += pack_size)
  {
    Pack x, y;
    for (int i = 0; i < pack_size; ++i)
    {
      const int q = std::min(first + i, num - 1);
      x[i] = t->xi[2 * q];
      y[i] = t->xi[2 * q + 1];
    }
    tabulate_functions<type>(x, y, t->dN[0] ? 1 : 0, s);
    for (int i = 0; i < pack_size and first + i < num; ++i)
    {
      const std::ptrdiff_t row = n * (first + i);
      for (int k = 0; k < n; ++k)
        t->N[row + k] = s.N[k][i];
      if (t->dN[0])
      {
        for (int k = 0; k < n; ++k)
          t->dN[0][row + k] = s.dN[0][k][i];
        for (int k = 0; k < n; ++k)
          t->dN[1][row + k] = s.dN[1][k][i];
      }
    }
  }
}
} // namespace

//-----------------------------------------------------------------------------
void dolfinx_mortar::project_pack(const FacetView& f, const PackVec3& p,
                                  const Vec3& n, int order, PackedPoint& point)
{
  const Line line = {f.x.data(), n.data(), &p, order};
  switch (f.type)
  {
  case FacetType::tri3:
    return call_packed<project_type<FacetType::tri3>>(&line, &point);
  case FacetType::tri6:
    return call_packed<project_type<FacetType::tri6>>(&line, &point);
  case FacetType::quad4:
    return call_packed<project_type<FacetType::quad4>>(&line, &point);
  case FacetType::quad8:
    return call_packed<project_type<FacetType::quad8>>(&line, &point);
  case FacetType::quad9:
    return call_packed<project_type<FacetType::quad9>>(&line, &point);
  }
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::tabulate_points(FacetType type, std::span<const double> xi,
                                     double* N, std::array<double*, 2> dN)
{
  const Tabulation t = {xi, N, dN};
  switch (type)
  {
  case FacetType::tri3:
    return call_packed<tabulate_type<FacetType::tri3>>(&t);
  case FacetType::tri6:
    return call_packed<tabulate_type<FacetType::tri6>>(&t);
  case FacetType::quad4:
    return call_packed<tabulate_type<FacetType::quad4>>(&t);
  case FacetType::quad8:
    return call_packed<tabulate_type<FacetType::quad8>>(&t);
  case FacetType::quad9:
    return call_packed<tabulate_type<FacetType::quad9>>(&t);
  }
}
