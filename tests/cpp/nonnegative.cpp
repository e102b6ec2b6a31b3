// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "grid.h"
#include "numbers.h"
#include <catch2/catch_test_macros.hpp>
#include <catch2/generators/catch_generators.hpp>
#include <catch2/generators/catch_generators_range.hpp>
#include <dolfinx_mortar/assembly/basis.h>

using namespace dolfinx_mortar;
using unit::Grid;
using unit::Point;

namespace
{
Point flat(double x, double y) { return {x, y, 0}; }

/// Nodes of some facets.
std::set<int> nodes_of(const Grid& g, const std::set<int>& facets)
{
  std::set<int> nodes;
  for (int f : facets)
    nodes.insert(g.facets[f].begin(), g.facets[f].end());
  return nodes;
}

/// Shares beyond the masters' edges, of the facets of this rank.
std::vector<double> shares(const Grid& g, const std::set<int>& facets,
                           double share)
{
  std::vector<double> beyond;
  for (int f : g.own)
    beyond.push_back(facets.contains(f) ? share : 0.0);
  return beyond;
}
} // namespace

TEST_CASE("functions are changed on the facets where a master ends", "[mpi]")
{
  const FacetType type
      = static_cast<FacetType>(GENERATE(range(0, num_facet_types)));
  const Grid g = unit::create_grid(type, 6, 1, flat);
  Interface interface;
  interface.slave = g.surface;
  for (MultiplierSpace space :
       {MultiplierSpace::dual, MultiplierSpace::dual_reproducing})
  {
    interface.options.space = space;
    for (const std::set<int>& facets :
         {std::set<int>{0}, {14}, {3, 30}, std::set<int>{}})
    {
      const auto flags = flag_nonnegative(interface, shares(g, facets, 0.4));
      const std::set<int> expected = nodes_of(g, facets);
      REQUIRE(flags.size() == g.surface.blocks.size());
      for (std::size_t k = 0; k < flags.size(); ++k)
        CHECK((flags[k] != 0) == expected.contains(g.surface.blocks[k]));
      // A seam between masters is no edge
      for (auto flag : flag_nonnegative(interface, shares(g, facets, 0.02)))
        CHECK(flag == 0);
    }
  }
  // Other spaces have no functions to change
  interface.options.space = MultiplierSpace::dual_linear;
  for (auto flag : flag_nonnegative(interface, shares(g, {0, 14}, 0.4)))
    CHECK(flag == 0);
}

TEST_CASE("weights of all nodes are positive and add up to the area", "[mpi]")
{
  const FacetType type
      = static_cast<FacetType>(GENERATE(range(0, num_facet_types)));
  const Grid g = unit::create_grid(type, 4, 1, flat);
  Interface interface;
  interface.slave = g.surface;
  const auto x = g.local_positions();
  for (const std::set<int>& facets : {std::set<int>{}, {5}})
  {
    const auto flags = flag_nonnegative(interface, shares(g, facets, 0.4));
    const auto weights = nodal_weights(interface, flags, x);
    double area = 0;
    for (int k = 0; k < g.surface.num_owned; ++k)
    {
      CHECK(weights[k] > 0);
      area += weights[k];
    }
    CHECK(unit::close(sum(MPI_COMM_WORLD, area), 1, 1e-13));
  }
}
