// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "facet.h"

using namespace dolfinx_mortar;

namespace
{
/// Lagrange polynomials on [0, 1] with their first and second derivatives.
template <int P>
struct Line
{
  std::array<std::array<double, P + 1>, 3> v;

  explicit Line(double x)
  {
    if constexpr (P == 1)
      v = {{{1 - x, x}, {-1, 1}, {0, 0}}};
    else
    {
      // Nodes 0, 1, 1/2: ends first
      v = {{{(1 - x) * (1 - 2 * x), x * (2 * x - 1), 4 * x * (1 - x)},
            {4 * x - 3, 4 * x - 1, 4 - 8 * x},
            {4, 4, -8}}};
    }
  }
};

/// Tensor products of line functions; `index` holds the pair of line
/// functions of each node.
template <int P, std::size_t n>
void tensor(const std::array<std::array<int, 2>, n>& index,
            std::array<double, 2> xi, int order, Shapes& s)
{
  const Line<P> a(xi[0]), b(xi[1]);
  for (std::size_t k = 0; k < n; ++k)
  {
    auto [i, j] = index[k];
    s.N[k] = a.v[0][i] * b.v[0][j];
    if (order > 0)
    {
      s.dN[0][k] = a.v[1][i] * b.v[0][j];
      s.dN[1][k] = a.v[0][i] * b.v[1][j];
    }
    if (order > 1)
    {
      s.ddN[0][k] = a.v[2][i] * b.v[0][j];
      s.ddN[1][k] = a.v[1][i] * b.v[1][j];
      s.ddN[2][k] = a.v[0][i] * b.v[2][j];
    }
  }
}

constexpr std::array<std::array<int, 2>, 4> quad4_index
    = {{{0, 0}, {1, 0}, {0, 1}, {1, 1}}};
constexpr std::array<std::array<int, 2>, 9> quad9_index = {
    {{0, 0}, {1, 0}, {0, 1}, {1, 1}, {2, 0}, {0, 2}, {1, 2}, {2, 1}, {2, 2}}};

void tri6(std::array<double, 2> xi, int order, Shapes& s)
{
  const double x = xi[0], y = xi[1], l = 1 - x - y;
  s.N = {l * (2 * l - 1), x * (2 * x - 1), y * (2 * y - 1),
         4 * x * y,       4 * l * y,       4 * l * x};
  if (order > 0)
  {
    s.dN[0] = {1 - 4 * l, 4 * x - 1, 0, 4 * y, -4 * y, 4 * (l - x)};
    s.dN[1] = {1 - 4 * l, 0, 4 * y - 1, 4 * x, 4 * (l - y), -4 * x};
  }
  if (order > 1)
  {
    s.ddN[0] = {4, 4, 0, 0, 0, -8};
    s.ddN[1] = {4, 0, 0, 4, -4, -4};
    s.ddN[2] = {4, 0, 4, 0, -8, 0};
  }
}

/// Serendipity functions on r, s in [-1, 1]; derivatives scaled to [0, 1].
void quad8(std::array<double, 2> xi, int order, Shapes& s)
{
  const double r = 2 * xi[0] - 1, t = 2 * xi[1] - 1;
  constexpr std::array<std::array<int, 2>, 4> c
      = {{{-1, -1}, {1, -1}, {-1, 1}, {1, 1}}};
  for (int k = 0; k < 4; ++k)
  {
    const double a = c[k][0], b = c[k][1];
    s.N[k] = 0.25 * (1 + a * r) * (1 + b * t) * (a * r + b * t - 1);
    if (order > 0)
    {
      s.dN[0][k] = 0.5 * a * (1 + b * t) * (2 * a * r + b * t);
      s.dN[1][k] = 0.5 * b * (1 + a * r) * (2 * b * t + a * r);
    }
    if (order > 1)
    {
      s.ddN[0][k] = 2 * (1 + b * t);
      s.ddN[1][k] = a * b * (2 * a * r + 2 * b * t + 1);
      s.ddN[2][k] = 2 * (1 + a * r);
    }
  }
  // Edges η = 0 and η = 1 (nodes 4 and 7)
  for (int k : {4, 7})
  {
    const double b = k == 4 ? -1 : 1;
    s.N[k] = 0.5 * (1 - r * r) * (1 + b * t);
    if (order > 0)
    {
      s.dN[0][k] = -2 * r * (1 + b * t);
      s.dN[1][k] = b * (1 - r * r);
    }
    if (order > 1)
    {
      s.ddN[0][k] = -4 * (1 + b * t);
      s.ddN[1][k] = -4 * b * r;
      s.ddN[2][k] = 0;
    }
  }
  // Edges ξ = 0 and ξ = 1 (nodes 5 and 6)
  for (int k : {5, 6})
  {
    const double a = k == 5 ? -1 : 1;
    s.N[k] = 0.5 * (1 + a * r) * (1 - t * t);
    if (order > 0)
    {
      s.dN[0][k] = a * (1 - t * t);
      s.dN[1][k] = -2 * t * (1 + a * r);
    }
    if (order > 1)
    {
      s.ddN[0][k] = 0;
      s.ddN[1][k] = -4 * a * t;
      s.ddN[2][k] = -4 * (1 + a * r);
    }
  }
}
} // namespace

//-----------------------------------------------------------------------------
std::span<const double> dolfinx_mortar::node_coordinates(FacetType type)
{
  static constexpr std::array<double, 12> tri
      = {0, 0, 1, 0, 0, 1, 0.5, 0.5, 0, 0.5, 0.5, 0};
  static constexpr std::array<double, 18> quad
      = {0, 0, 1, 0, 0, 1, 1, 1, 0.5, 0, 0, 0.5, 1, 0.5, 0.5, 1, 0.5, 0.5};
  std::size_t n = 2 * num_nodes(type);
  if (num_corners(type) == 3)
    return std::span(tri).first(n);
  else
    return std::span(quad).first(n);
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::tabulate(FacetType type, std::array<double, 2> xi,
                              int order, Shapes& s)
{
  switch (type)
  {
  case FacetType::tri3:
    s.N = {1 - xi[0] - xi[1], xi[0], xi[1]};
    s.dN = {{{-1, 1, 0}, {-1, 0, 1}}};
    if (order > 1)
      s.ddN = {};
    break;
  case FacetType::tri6:
    tri6(xi, order, s);
    break;
  case FacetType::quad4:
    tensor<1>(quad4_index, xi, order, s);
    break;
  case FacetType::quad8:
    quad8(xi, order, s);
    break;
  case FacetType::quad9:
    tensor<2>(quad9_index, xi, order, s);
    break;
  }
}
//-----------------------------------------------------------------------------
std::span<const SubFacet> dolfinx_mortar::sub_facets(FacetType type)
{
  static constexpr std::array<SubFacet, 1> tri3 = {{{3, {0, 1, 2, -1}}}};
  static constexpr std::array<SubFacet, 4> tri6 = {{{3, {0, 5, 4, -1}},
                                                    {3, {5, 1, 3, -1}},
                                                    {3, {4, 3, 2, -1}},
                                                    {3, {3, 4, 5, -1}}}};
  static constexpr std::array<SubFacet, 1> quad4 = {{{4, {0, 1, 2, 3}}}};
  static constexpr std::array<SubFacet, 5> quad8 = {{{3, {0, 4, 5, -1}},
                                                     {3, {4, 1, 6, -1}},
                                                     {3, {5, 7, 2, -1}},
                                                     {3, {6, 3, 7, -1}},
                                                     {4, {4, 6, 5, 7}}}};
  static constexpr std::array<SubFacet, 4> quad9 = {{{4, {0, 4, 5, 8}},
                                                     {4, {4, 1, 8, 6}},
                                                     {4, {5, 8, 2, 7}},
                                                     {4, {8, 6, 7, 3}}}};
  switch (type)
  {
  case FacetType::tri3:
    return tri3;
  case FacetType::tri6:
    return tri6;
  case FacetType::quad4:
    return quad4;
  case FacetType::quad8:
    return quad8;
  default:
    return quad9;
  }
}
//-----------------------------------------------------------------------------
bool dolfinx_mortar::in_reference(FacetType type, std::array<double, 2> xi,
                                  double tol)
{
  if (xi[0] < -tol or xi[1] < -tol)
    return false;
  if (num_corners(type) == 3)
    return xi[0] + xi[1] <= 1 + tol;
  else
    return xi[0] <= 1 + tol and xi[1] <= 1 + tol;
}
