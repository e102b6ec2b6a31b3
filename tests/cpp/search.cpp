// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "grid.h"
#include "numbers.h"
#include <catch2/catch_test_macros.hpp>
#include <catch2/generators/catch_generators.hpp>
#include <catch2/generators/catch_generators_range.hpp>
#include <dolfinx_mortar/surface/search.h>
#include <limits>
#include <stdexcept>

using namespace dolfinx_mortar;
using unit::Grid;
using unit::Point;

namespace
{
/// Many points of a facet, the nodes among them.
std::vector<Point> sample(const Grid& g, int f)
{
  std::vector<Point> points;
  Shapes s;
  for (int i = 0; i <= 8; ++i)
  {
    for (int j = 0; j <= 8; ++j)
    {
      const std::array<double, 2> xi = {i / 8.0, j / 8.0};
      if (!in_reference(g.type, xi, 1e-12))
        continue;
      tabulate(g.type, xi, 0, s);
      Point x = {0, 0, 0};
      for (int k = 0; k < num_nodes(g.type); ++k)
      {
        for (int c = 0; c < 3; ++c)
          x[c] += s.N[k] * g.x[g.facets[f][k]][c];
      }
      points.push_back(x);
    }
  }
  return points;
}

double diameter(const Grid& g, int f)
{
  double largest = 0;
  for (int a : g.facets[f])
  {
    for (int b : g.facets[f])
    {
      const Point &p = g.x[a], &q = g.x[b];
      largest = std::max(largest,
                         std::hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]));
    }
  }
  return largest;
}

/// Whether the boxes around two sets of points are within a distance.
bool near(const std::vector<Point>& p, const std::vector<Point>& q,
          double distance)
{
  for (int c = 0; c < 3; ++c)
  {
    double lower[2], upper[2];
    int side = 0;
    for (const auto* points : {&p, &q})
    {
      lower[side] = std::numeric_limits<double>::infinity();
      upper[side] = -lower[side];
      for (const Point& x : *points)
      {
        lower[side] = std::min(lower[side], x[c]);
        upper[side] = std::max(upper[side], x[c]);
      }
      ++side;
    }
    if (lower[0] > upper[1] + distance or lower[1] > upper[0] + distance)
      return false;
  }
  return true;
}

/// Whether the normals of some linear parts of two facets oppose: cross
/// products of the diagonals of quadrilaterals, of two edges of triangles.
bool oppose(const Grid& a, int f, const Grid& b, int g)
{
  auto normals = [](const Grid& grid, int facet)
  {
    std::vector<Point> normals;
    for (const SubFacet& sub : sub_facets(grid.type))
    {
      auto edge = [&](int from, int to, int c)
      {
        return grid.x[grid.facets[facet][sub.nodes[to]]][c]
               - grid.x[grid.facets[facet][sub.nodes[from]]][c];
      };
      const auto [i, j, k, l]
          = sub.size == 3 ? std::array{0, 1, 0, 2} : std::array{0, 3, 1, 2};
      Point n;
      for (int c = 0; c < 3; ++c)
      {
        const int d = (c + 1) % 3, e = (c + 2) % 3;
        n[c]
            = grid.orientation
              * (edge(i, j, d) * edge(k, l, e) - edge(i, j, e) * edge(k, l, d));
      }
      normals.push_back(n);
    }
    return normals;
  };
  for (const Point& p : normals(a, f))
  {
    for (const Point& q : normals(b, g))
    {
      if (p[0] * q[0] + p[1] * q[1] + p[2] * q[2] < 0)
        return true;
    }
  }
  return false;
}

/// Pairs of a slave facet of this rank, and the nodes of a master.
using Pairs = std::set<std::pair<int, std::vector<std::int64_t>>>;

Pairs brute_force(const Grid& slave, const Grid& master,
                  std::optional<double> distance, double factor)
{
  Pairs pairs;
  for (int s : slave.own)
  {
    const auto points = sample(slave, s);
    for (std::size_t m = 0; m < master.facets.size(); ++m)
    {
      const double d = factor
                       * distance.value_or(
                           std::max(diameter(slave, s), diameter(master, m)));
      if (near(points, sample(master, m), d) and oppose(slave, s, master, m))
        pairs.insert({s, {master.facets[m].begin(), master.facets[m].end()}});
    }
  }
  return pairs;
}

Pairs found_pairs(const Grid& slave, const Grid& master,
                  std::optional<double> distance, double factor)
{
  const Candidates c
      = find_candidates(slave.surface, slave.local_positions(), master.surface,
                        master.local_positions(), distance, factor);
  REQUIRE(c.offsets.size() == slave.own.size() + 1);
  Pairs pairs;
  for (std::size_t f = 0; f < slave.own.size(); ++f)
  {
    for (int i = c.offsets[f]; i < c.offsets[f + 1]; ++i)
    {
      const int m = c.facets[i];
      const int begin = c.master.offsets[m], end = c.master.offsets[m + 1];
      CHECK(c.master.types[m] == master.type);
      CHECK(c.master.orientation[m] == master.orientation);
      // Positions have travelled with the nodes
      for (int k = begin; k < end; ++k)
      {
        for (int d = 0; d < 3; ++d)
        {
          CHECK(c.master.x[3 * k + d] == master.x[c.master.blocks[k]][d]);
        }
      }
      pairs.insert(
          {slave.own[f],
           {c.master.blocks.begin() + begin, c.master.blocks.begin() + end}});
    }
  }
  // No pair is named twice
  CHECK(pairs.size() == c.facets.size());
  return pairs;
}

Point curved(double x, double y)
{
  return {x, y, 0.2 * std::sin(4 * x) * std::cos(3 * y)};
}

Point above(double x, double y)
{
  // No boxes that just touch: these are a matter of round-off
  return {1.2 * x - 0.1437 + 0.05 * y, 0.9 * y + 0.1963,
          0.1 + 0.15 * std::cos(5 * x + y)};
}
} // namespace

TEST_CASE("the search finds all pairs that brute force finds", "[mpi]")
{
  const FacetType slave_type
      = static_cast<FacetType>(GENERATE(range(0, num_facet_types)));
  const FacetType master_type = GENERATE(FacetType::tri3, FacetType::quad9);
  const auto distance
      = GENERATE(std::optional<double>(), std::optional<double>(0.05));
  const double factor = distance ? 1 : 0.5;
  const Grid slave = unit::create_grid(slave_type, 5, 1, curved),
             master = unit::create_grid(master_type, 4, -1, above);
  const Pairs wanted = brute_force(slave, master, distance, factor),
              found = found_pairs(slave, master, distance, factor);
  std::int64_t numbers[2] = {static_cast<std::int64_t>(wanted.size()),
                             static_cast<std::int64_t>(found.size())};
  MPI_Allreduce(MPI_IN_PLACE, numbers, 2, MPI_INT64_T, MPI_SUM, MPI_COMM_WORLD);
  CHECK(numbers[0] > 0);
  CHECK(std::ranges::includes(found, wanted));
  // Control points of curved facets are further out than the facets, but not
  // by much
  if (!is_second_order(slave_type) and !is_second_order(master_type))
    CHECK((found == wanted)); // too many to be printed
  else
    CHECK(numbers[1] < 1.5 * numbers[0]);
}

TEST_CASE("facets that face the same way are no pair", "[mpi]")
{
  auto plane = [](double x, double y) { return Point{x, y, 0}; };
  const Grid slave = unit::create_grid(FacetType::quad4, 3, 1, plane),
             same = unit::create_grid(FacetType::quad4, 3, 1, plane),
             opposite = unit::create_grid(FacetType::quad4, 3, -1, plane);
  CHECK(found_pairs(slave, same, 0.1, 1).empty());
  CHECK(found_pairs(slave, opposite, 0.1, 1)
        == brute_force(slave, opposite, 0.1, 1));
}

TEST_CASE("positions that are not finite are refused on all ranks", "[mpi]")
{
  const Grid slave = unit::create_grid(FacetType::quad4, 3, 1, curved),
             master = unit::create_grid(FacetType::quad4, 3, -1, above);
  int rank;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  std::vector<double> x = slave.local_positions();
  if (rank == 0)
    x[1] = std::numeric_limits<double>::quiet_NaN();
  CHECK_THROWS_AS(find_candidates(slave.surface, x, master.surface,
                                  master.local_positions(), {}),
                  std::runtime_error);
  CHECK_THROWS_AS(find_candidates(slave.surface, slave.local_positions(),
                                  master.surface, master.local_positions(),
                                  -1.0),
                  std::runtime_error);
}

TEST_CASE("facets of no type are refused on all ranks", "[mpi]")
{
  int rank, size;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  const std::vector<double> X = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  const std::vector<std::int32_t> blocks = {0, 1, 2};
  const std::vector<std::int64_t> numbers
      = {3 * rank, 3 * rank + 1, 3 * rank + 2};
  auto create = [&](FacetType type)
  {
    return create_surface(MPI_COMM_WORLD, {type}, blocks, {1}, numbers, 3, {},
                          X);
  };
  CHECK(create(FacetType::tri3).num_global == 3 * size);
  const FacetType last
      = rank == size - 1 ? static_cast<FacetType>(5) : FacetType::tri3;
  CHECK_THROWS_AS(create(last), std::runtime_error);
}

TEST_CASE("ghosts of a surface get and give values", "[mpi]")
{
  const Grid g = unit::create_grid(FacetType::tri6, 4, 1, curved);
  const Surface& s = g.surface;
  const int n = num_local_nodes(s);
  CHECK(s.num_global == static_cast<std::int64_t>(g.x.size()));
  std::vector<double> values(2 * n, -1.0);
  for (int k = 0; k < s.num_owned; ++k)
  {
    values[2 * k] = s.blocks[k];
    values[2 * k + 1] = 0.5 * s.blocks[k];
  }
  scatter_forward(s, std::span<double>(values), 2);
  for (int k = 0; k < n; ++k)
  {
    CHECK(values[2 * k] == s.blocks[k]);
    CHECK(values[2 * k + 1] == 0.5 * s.blocks[k]);
  }
  // Each facet gives one to its nodes: owners get the number of facets
  std::vector<double> counts(n, 0.0), expected(g.x.size(), 0.0);
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    for (int k : facet_nodes(s, f))
      counts[k] += 1;
  }
  scatter_reverse_add(s, std::span<double>(counts), 1);
  for (const auto& nodes : g.facets)
  {
    for (int b : nodes)
      expected[b] += 1;
  }
  for (int k = 0; k < s.num_owned; ++k)
    CHECK(counts[k] == expected[s.blocks[k]]);
}
