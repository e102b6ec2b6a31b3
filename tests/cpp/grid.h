// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <algorithm>
#include <array>
#include <dolfinx_mortar/surface/surface.h>
#include <functional>
#include <map>
#include <set>
#include <vector>

namespace unit
{
using Point = std::array<double, 3>;

/// A regular surface over the unit square: all of it as every rank knows it,
/// and the distributed one made of it.
struct Grid
{
  /// Nodes of each facet; a node is an index of `x` and the number of its
  /// block
  std::vector<std::vector<int>> facets;

  std::vector<Point> x;

  /// Facets of this rank, in the order of those of `surface`
  std::vector<int> own;

  dolfinx_mortar::FacetType type;
  int orientation;
  dolfinx_mortar::Surface surface;

  /// Positions of the local nodes of the surface
  std::vector<double> local_positions() const
  {
    std::vector<double> values;
    for (std::int64_t block : surface.blocks)
      values.insert(values.end(), x[block].begin(), x[block].end());
    return values;
  }
};

/// @brief Facets in an n x n grid, dealt out to the ranks in stripes. Nodes
/// belong to ranks by their numbers, facets nearby or not. Collective.
/// @param[in] map Where the points of the unit square lie.
inline Grid create_grid(dolfinx_mortar::FacetType type, int n, int orientation,
                        const std::function<Point(double, double)>& map)
{
  using namespace dolfinx_mortar;
  const MPI_Comm comm = MPI_COMM_WORLD;
  int rank, size;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &size);
  Grid g;
  g.type = type;
  g.orientation = orientation;
  const auto xi = node_coordinates(type);
  std::map<std::array<int, 2>, int> numbers; // by place in a grid of 2 n
  for (int i = 0; i < n * n; ++i)
  {
    const int corner[2] = {2 * (i % n), 2 * (i / n)};
    // A square is two triangles, the second one turned by 180 degrees
    for (int half = 0; half < (num_corners(type) == 3 ? 2 : 1); ++half)
    {
      std::vector<int> nodes;
      for (int k = 0; k < num_nodes(type); ++k)
      {
        std::array<int, 2> place;
        for (int c = 0; c < 2; ++c)
        {
          const int step = static_cast<int>(2 * xi[2 * k + c]);
          place[c] = corner[c] + (half ? 2 - step : step);
        }
        const auto [at, made] = numbers.try_emplace(place, g.x.size());
        if (made)
        {
          g.x.push_back(map(place[0] / (2.0 * n), place[1] / (2.0 * n)));
        }
        nodes.push_back(at->second);
      }
      g.facets.push_back(nodes);
    }
  }

  const int num_blocks = g.x.size(), num_facets = g.facets.size();
  auto owner = [&](int block)
  { return static_cast<int>(std::int64_t{block} * size / num_blocks); };
  std::vector<std::int64_t> blocks;
  for (int b = 0; b < num_blocks; ++b)
  {
    if (owner(b) == rank)
      blocks.push_back(b);
  }
  const std::int32_t num_owned = blocks.size();
  std::set<int> ghosts;
  for (int f = 0; f < num_facets; ++f)
  {
    if (f * size / num_facets != rank)
      continue;
    g.own.push_back(f);
    for (int b : g.facets[f])
    {
      if (owner(b) != rank)
        ghosts.insert(b);
    }
  }
  blocks.insert(blocks.end(), ghosts.begin(), ghosts.end());
  std::vector<std::int32_t> facet_blocks;
  for (int f : g.own)
  {
    for (int b : g.facets[f])
    {
      facet_blocks.push_back(std::ranges::find(blocks, b) - blocks.begin());
    }
  }
  std::vector<int> owners;
  std::vector<double> X;
  for (std::size_t i = 0; i < blocks.size(); ++i)
  {
    if (static_cast<std::int32_t>(i) >= num_owned)
      owners.push_back(owner(blocks[i]));
    X.insert(X.end(), g.x[blocks[i]].begin(), g.x[blocks[i]].end());
  }
  g.surface = create_surface(
      comm, std::vector<FacetType>(g.own.size(), type), facet_blocks,
      std::vector<std::int8_t>(g.own.size(), orientation), blocks, num_owned,
      owners, X);
  return g;
}
} // namespace unit
