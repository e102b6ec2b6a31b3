// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT
//
// Shape functions at one point or at a pack of points; `tabulate` is for all
// others.

#pragma once

#include "facet.h"
#include <dolfinx_mortar/common/pack.h>

namespace dolfinx_mortar
{
/// @brief Lagrange polynomials on [0, 1] with their first and second
/// derivatives.
template <int P, typename T>
struct LineFunctions
{
  std::array<std::array<T, P + 1>, 3> v;

  MORTAR_INLINE explicit LineFunctions(const T& x)
  {
    const T one = constant<T>(1);
    if constexpr (P == 1)
    {
      v[0] = {one - x, x};
      v[1] = {-one, one};
      v[2] = {0 * one, 0 * one};
    }
    else
    {
      // Nodes 0, 1, 1/2: ends first
      v[0] = {(1 - x) * (1 - 2 * x), x * (2 * x - 1), 4 * x * (1 - x)};
      v[1] = {4 * x - 3, 4 * x - 1, 4 - 8 * x};
      v[2] = {4 * one, 4 * one, -8 * one};
    }
  }
};

/// @brief Tensor products of line functions.
/// @param[in] index The pair of line functions of each node.
template <int P, std::size_t n, typename T>
MORTAR_INLINE void
tabulate_tensor(const std::array<std::array<int, 2>, n>& index, const T& x,
                const T& y, int order, ShapesOf<T>& s)
{
  const LineFunctions<P, T> a(x), b(y);
#pragma GCC unroll 9
  for (std::size_t k = 0; k < n; ++k)
  {
    const int i = index[k][0], j = index[k][1];
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

/// @brief Linear functions.
template <typename T>
MORTAR_INLINE void tabulate_tri3(const T& x, const T& y, int order,
                                 ShapesOf<T>& s)
{
  const T one = constant<T>(1), zero = constant<T>(0);
  s.N = {1 - x - y, x, y};
  if (order > 0)
  {
    s.dN[0] = {-one, one, zero};
    s.dN[1] = {-one, zero, one};
  }
  if (order > 1)
    s.ddN = {};
}

/// @brief Quadratic functions.
template <typename T>
MORTAR_INLINE void tabulate_tri6(const T& x, const T& y, int order,
                                 ShapesOf<T>& s)
{
  const T zero = constant<T>(0), four = constant<T>(4), l = 1 - x - y;
  s.N = {l * (2 * l - 1), x * (2 * x - 1), y * (2 * y - 1),
         4 * x * y,       4 * l * y,       4 * l * x};
  if (order > 0)
  {
    s.dN[0] = {1 - 4 * l, 4 * x - 1, zero, 4 * y, -4 * y, 4 * (l - x)};
    s.dN[1] = {1 - 4 * l, zero, 4 * y - 1, 4 * x, 4 * (l - y), -4 * x};
  }
  if (order > 1)
  {
    s.ddN[0] = {four, four, zero, zero, zero, -2 * four};
    s.ddN[1] = {four, zero, zero, four, -four, -four};
    s.ddN[2] = {four, zero, four, zero, -2 * four, zero};
  }
}

/// @brief Serendipity functions on r, s in [-1, 1]; derivatives scaled to [0,
/// 1].
template <typename T>
MORTAR_INLINE void tabulate_quad8(const T& x, const T& y, int order,
                                  ShapesOf<T>& s)
{
  const T r = 2 * x - 1, t = 2 * y - 1;
  constexpr std::array<std::array<double, 2>, 4> c
      = {{{-1, -1}, {1, -1}, {-1, 1}, {1, 1}}};
#pragma GCC unroll 4
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
#pragma GCC unroll 2
  for (int side = 0; side < 2; ++side)
  {
    const double a = 2.0 * side - 1;
    // Edges η = 0 and η = 1 (nodes 4 and 7), then ξ = 0 and ξ = 1 (5 and 6)
    const int k = 4 + 3 * side, l = 5 + side;
    s.N[k] = 0.5 * (1 - r * r) * (1 + a * t);
    s.N[l] = 0.5 * (1 + a * r) * (1 - t * t);
    if (order > 0)
    {
      s.dN[0][k] = -2 * r * (1 + a * t);
      s.dN[1][k] = a * (1 - r * r);
      s.dN[0][l] = a * (1 - t * t);
      s.dN[1][l] = -2 * t * (1 + a * r);
    }
    if (order > 1)
    {
      s.ddN[0][k] = -4 * (1 + a * t);
      s.ddN[1][k] = -4 * a * r;
      s.ddN[2][k] = constant<T>(0);
      s.ddN[0][l] = constant<T>(0);
      s.ddN[1][l] = -4 * a * t;
      s.ddN[2][l] = -4 * (1 + a * r);
    }
  }
}

/// @brief Shape functions of a facet, see `tabulate`.
template <FacetType type, typename T>
MORTAR_INLINE void tabulate_functions(const T& x, const T& y, int order,
                                      ShapesOf<T>& s)
{
  if constexpr (type == FacetType::tri3)
    tabulate_tri3(x, y, order, s);
  else if constexpr (type == FacetType::tri6)
    tabulate_tri6(x, y, order, s);
  else if constexpr (type == FacetType::quad4)
    tabulate_tensor<1>(quad4_index, x, y, order, s);
  else if constexpr (type == FacetType::quad8)
    tabulate_quad8(x, y, order, s);
  else
    tabulate_tensor<2>(quad9_index, x, y, order, s);
}
} // namespace dolfinx_mortar
