// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "numbers.h"
#include <catch2/catch_test_macros.hpp>
#include <catch2/generators/catch_generators.hpp>
#include <catch2/generators/catch_generators_range.hpp>
#include <dolfinx_mortar/geometry/facet.h>
#include <vector>

using namespace dolfinx_mortar;
using unit::close;

namespace
{
FacetType any_type()
{
  return static_cast<FacetType>(GENERATE(range(0, num_facet_types)));
}

/// Points within a reference facet, and some beyond it.
std::vector<std::array<double, 2>> points()
{
  unit::Numbers number(7);
  std::vector<std::array<double, 2>> p;
  for (int i = 0; i < 20; ++i)
    p.push_back({0.5 + 0.7 * number(), 0.5 + 0.7 * number()});
  return p;
}

/// Largest power of a coordinate that the functions reproduce together with
/// those of the other one: total degree, or degree in each coordinate.
bool reproduces(FacetType type, int i, int j)
{
  switch (type)
  {
  case FacetType::tri3:
    return i + j <= 1;
  case FacetType::tri6:
    return i + j <= 2;
  case FacetType::quad4:
    return i <= 1 and j <= 1;
  case FacetType::quad8:
    // Serendipity: quadratic, and the products that are linear in one
    return i + j <= 3 and i <= 2 and j <= 2;
  default:
    return i <= 2 and j <= 2;
  }
}
} // namespace

TEST_CASE("shape functions are one at their node and zero at others")
{
  const FacetType type = any_type();
  const int n = num_nodes(type);
  const auto nodes = node_coordinates(type);
  REQUIRE(nodes.size() == static_cast<std::size_t>(2 * n));
  Shapes s;
  for (int k = 0; k < n; ++k)
  {
    tabulate(type, {nodes[2 * k], nodes[2 * k + 1]}, 0, s);
    for (int l = 0; l < n; ++l)
      CHECK(close(s.N[l], k == l, 1e-14));
  }
}

TEST_CASE("shape functions reproduce the monomials of their space")
{
  // With i = j = 0 the partition of unity
  const FacetType type = any_type();
  const auto nodes = node_coordinates(type);
  Shapes s;
  for (const auto& p : points())
  {
    tabulate(type, p, 0, s);
    for (int i = 0; i < 4; ++i)
    {
      for (int j = 0; j < 4; ++j)
      {
        double sum = 0;
        for (int k = 0; k < num_nodes(type); ++k)
        {
          sum += s.N[k] * std::pow(nodes[2 * k], i)
                 * std::pow(nodes[2 * k + 1], j);
        }
        const double exact = std::pow(p[0], i) * std::pow(p[1], j);
        if (reproduces(type, i, j))
          CHECK(close(sum, exact, 1e-12));
      }
    }
  }
}

TEST_CASE("derivatives of shape functions agree with differences")
{
  const FacetType type = any_type();
  const double h = 1e-5;
  Shapes s, plus, minus;
  for (const auto& p : points())
  {
    tabulate(type, p, 2, s);
    for (int d = 0; d < 2; ++d)
    {
      auto a = p, b = p;
      a[d] += h;
      b[d] -= h;
      tabulate(type, a, 1, plus);
      tabulate(type, b, 1, minus);
      for (int k = 0; k < num_nodes(type); ++k)
      {
        CHECK(close(s.dN[d][k], (plus.N[k] - minus.N[k]) / (2 * h), 1e-8));
        for (int e = 0; e < 2; ++e)
        {
          CHECK(close(s.ddN[d + e][k],
                      (plus.dN[e][k] - minus.dN[e][k]) / (2 * h), 1e-8));
        }
      }
    }
  }
}

TEST_CASE("edge nodes lie between their corners, sub-facets fill the facet")
{
  const FacetType type = any_type();
  const auto x = node_coordinates(type);
  if (is_second_order(type))
  {
    const int nc = num_corners(type);
    const auto edges = edge_corners(type);
    for (int e = 0; e < nc; ++e)
    {
      for (int c = 0; c < 2; ++c)
      {
        const double middle
            = 0.5 * (x[2 * edges[e][0] + c] + x[2 * edges[e][1] + c]);
        CHECK(x[2 * (nc + e) + c] == middle);
      }
    }
  }
  double area = 0;
  for (const SubFacet& sub : sub_facets(type))
  {
    auto cross = [&](int a, int b, int c)
    {
      return (x[2 * b] - x[2 * a]) * (x[2 * c + 1] - x[2 * a + 1])
             - (x[2 * b + 1] - x[2 * a + 1]) * (x[2 * c] - x[2 * a]);
    };
    const auto& [a, b, c, d] = sub.nodes;
    // With the orientation of the facet, so no part may be negative
    CHECK(cross(a, b, c) > 0);
    area += 0.5 * cross(a, b, c);
    if (sub.size == 4)
    {
      CHECK(cross(b, d, c) > 0);
      area += 0.5 * cross(b, d, c);
    }
  }
  CHECK(close(area, num_corners(type) == 3 ? 0.5 : 1, 1e-15));
}

TEST_CASE("points in and beyond the reference facet")
{
  const FacetType type = any_type();
  const bool triangle = num_corners(type) == 3;
  CHECK(in_reference(type, {0.3, 0.3}, 0));
  CHECK(in_reference(type, {0, 0}, 0));
  CHECK(in_reference(type, {0.8, 0.8}, 0) == !triangle);
  CHECK(!in_reference(type, {-1e-3, 0.5}, 1e-4));
  CHECK(in_reference(type, {-1e-3, 0.5}, 1e-2));
  CHECK(!in_reference(type, {1.1, 0.0}, 1e-2));
  CHECK(!in_reference(type, {0.0, 1.1}, 1e-2));
}
