// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "search.h"
#include "boxes.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <dolfinx_mortar/common/error.h>
#include <dolfinx_mortar/common/mpi_exchange.h>
#include <numeric>
#include <string>
#include <utility>

using namespace dolfinx_mortar;

namespace
{
using Coordinates = std::array<double, 3>;

/// What the search needs to know of a facet.
struct Outline
{
  Box box;

  /// Largest distance between two nodes
  double diameter = 0;

  /// Outward normals of the sub-facets, not normalised
  std::array<Coordinates, 5> normals;
  int num_normals = 0;
};

/// Control points of the Bézier form of a facet, whose convex hull contains
/// the facet.
int control_points(FacetType type, std::span<const Coordinates> x,
                   std::array<Coordinates, max_facet_nodes>& b)
{
  const int n = num_nodes(type);
  std::copy_n(x.begin(), n, b.begin());
  if (!is_second_order(type))
    return n;

  const int num = num_corners(type);
  const auto corners = edge_corners(type);
  for (int e = 0; e < num; ++e)
    for (int c = 0; c < 3; ++c)
    {
      b[num + e][c] = 2 * x[num + e][c]
                      - 0.5 * (x[corners[e][0]][c] + x[corners[e][1]][c]);
    }
  if (type == FacetType::tri6)
    return n;

  // Centre: twice the line formula above, once in each direction. In quad8 the
  // centre is at Σ edges / 2 - Σ corners / 4.
  for (int c = 0; c < 3; ++c)
  {
    double sum_c = 0, sum_e = 0;
    for (int k = 0; k < 4; ++k)
    {
      sum_c += x[k][c];
      sum_e += x[4 + k][c];
    }
    const double centre
        = type == FacetType::quad9 ? x[8][c] : 0.5 * sum_e - 0.25 * sum_c;
    b[8][c] = 4 * centre - sum_e + 0.25 * sum_c;
  }
  return 9;
}

/// @param[in] type,orientation Facet.
/// @param[in] x Positions of its nodes.
Outline outline(FacetType type, std::int8_t orientation,
                std::span<const Coordinates> x)
{
  Outline o;
  std::array<Coordinates, max_facet_nodes> b;
  const int num_points = control_points(type, x, b);
  for (int k = 0; k < num_points; ++k)
    add(o.box, b[k]);

  double squared = 0;
  for (std::size_t k = 0; k < x.size(); ++k)
    for (std::size_t l = 0; l < k; ++l)
    {
      double d = 0;
      for (int c = 0; c < 3; ++c)
        d += (x[k][c] - x[l][c]) * (x[k][c] - x[l][c]);
      squared = std::max(squared, d);
    }
  o.diameter = std::sqrt(squared);

  for (const SubFacet& sub : sub_facets(type))
  {
    // Directions of the tangents at the centre
    Coordinates a, b;
    const auto& [i, j, k, l] = sub.nodes;
    for (int c = 0; c < 3; ++c)
    {
      a[c] = x[j][c] - x[i][c];
      b[c] = x[k][c] - x[i][c];
      if (sub.size == 4)
      {
        a[c] += x[l][c] - x[k][c];
        b[c] += x[l][c] - x[j][c];
      }
    }
    o.normals[o.num_normals++] = {orientation * (a[1] * b[2] - a[2] * b[1]),
                                  orientation * (a[2] * b[0] - a[0] * b[2]),
                                  orientation * (a[0] * b[1] - a[1] * b[0])};
  }
  return o;
}

bool oppose(const Outline& a, const Outline& b)
{
  for (int i = 0; i < a.num_normals; ++i)
    for (int j = 0; j < b.num_normals; ++j)
    {
      const Coordinates &p = a.normals[i], &q = b.normals[j];
      if (p[0] * q[0] + p[1] * q[1] + p[2] * q[2] < 0)
        return true;
    }
  return false;
}

/// Outlines of all facets of a surface.
std::vector<Outline> outlines(const Surface& s, std::span<const double> x)
{
  std::vector<Outline> o;
  o.reserve(s.types.size());
  std::array<Coordinates, max_facet_nodes> points;
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    std::span<const std::int32_t> nodes = facet_nodes(s, f);
    for (std::size_t k = 0; k < nodes.size(); ++k)
      std::copy_n(x.data() + 3 * nodes[k], 3, points[k].begin());
    o.push_back(outline(s.types[f], s.orientation[f],
                        std::span(points).first(nodes.size())));
  }
  return o;
}

/// A node of a facet as it travels.
struct Node
{
  std::int64_t block;
  Coordinates x;
};

/// A facet as it travels; its nodes travel beside it.
struct Facet
{
  FacetType type;
  std::int8_t orientation;
};

/// A list of facets with their nodes one after the other.
struct Facets
{
  std::vector<Facet> facets;
  std::vector<std::int32_t> offsets = {0};
  std::vector<Node> nodes;

  std::span<const Node> nodes_of(std::int32_t f) const
  {
    return std::span(nodes).subspan(offsets[f], offsets[f + 1] - offsets[f]);
  }
};

void append(Facets& list, const Surface& s, std::span<const double> x,
            std::int32_t f)
{
  list.facets.push_back({s.types[f], s.orientation[f]});
  for (std::int32_t k : facet_nodes(s, f))
  {
    list.nodes.push_back({s.blocks[k], {x[3 * k], x[3 * k + 1], x[3 * k + 2]}});
  }
  list.offsets.push_back(list.nodes.size());
}

/// The facets of this rank, and those that other ranks send, that are near
/// this rank's slave facets. Collective.
/// @param[in] around Boxes around this rank's slave facets.
/// @param[in] s,x,boxes Master surface, its positions, boxes of its facets.
Facets collect(std::span<const Box> around, const Surface& s,
               std::span<const double> x, std::span<const Box> boxes)
{
  int rank, size;
  MPI_Comm_rank(s.comm, &rank);
  MPI_Comm_size(s.comm, &size);
  Facets near;
  RankData<Facet> facets;
  RankData<Node> nodes;
  const RankData<std::int32_t> wanted = boxes_near(s.comm, around, boxes);
  for (std::size_t i = 0; i < wanted.ranks.size(); ++i)
  {
    Facets list;
    for (std::int32_t k = wanted.offsets[i]; k < wanted.offsets[i + 1]; ++k)
      append(list, s, x, wanted.values[k]);
    if (wanted.ranks[i] == rank)
      near = std::move(list);
    else
    {
      facets.ranks.push_back(wanted.ranks[i]);
      facets.values.insert(facets.values.end(), list.facets.begin(),
                           list.facets.end());
      facets.offsets.push_back(facets.values.size());
      nodes.ranks.push_back(wanted.ranks[i]);
      nodes.values.insert(nodes.values.end(), list.nodes.begin(),
                          list.nodes.end());
      nodes.offsets.push_back(nodes.values.size());
    }
  }

  if (size > 1)
  {
    const RankData<Facet> f = exchange(s.comm, facets);
    const RankData<Node> n = exchange(s.comm, nodes);
    near.facets.insert(near.facets.end(), f.values.begin(), f.values.end());
    near.nodes.insert(near.nodes.end(), n.values.begin(), n.values.end());
    for (const Facet& facet : f.values)
      near.offsets.push_back(near.offsets.back() + num_nodes(facet.type));
  }
  return near;
}
/// Order of facets by their blocks, which no partition changes.
std::vector<std::int32_t> order_by_blocks(const Facets& list)
{
  std::vector<std::int32_t> order(list.facets.size());
  std::iota(order.begin(), order.end(), 0);
  std::ranges::sort(order,
                    [&](std::int32_t a, std::int32_t b)
                    {
                      return std::ranges::lexicographical_compare(
                          list.nodes_of(a), list.nodes_of(b), {}, &Node::block,
                          &Node::block);
                    });
  return order;
}

/// Outlines of some facets of a list.
std::vector<Outline> outlines(const Facets& list,
                              std::span<const std::int32_t> which)
{
  std::vector<Outline> o;
  o.reserve(which.size());
  std::array<Coordinates, max_facet_nodes> points;
  for (std::int32_t f : which)
  {
    const std::span<const Node> nodes = list.nodes_of(f);
    std::ranges::transform(nodes, points.begin(), &Node::x);
    o.push_back(outline(list.facets[f].type, list.facets[f].orientation,
                        std::span(points).first(nodes.size())));
  }
  return o;
}

/// How far apart facets may be. Without a given distance it is that of a pair,
/// max(d_slave, d_master): boxes grown by their own facet's diameter meet in
/// every such pair, and in some more.
struct Reach
{
  std::optional<double> distance; ///< times the factor, where it is given
  double factor;

  double of_pair(const Outline& s, const Outline& m) const
  {
    return distance.value_or(factor * std::max(s.diameter, m.diameter));
  }

  double of_facet(const Outline& o) const
  {
    return distance ? 0 : factor * o.diameter;
  }

  Box around_slave(const Outline& o) const
  {
    return grown(o.box, of_facet(o) + distance.value_or(0));
  }

  std::vector<Box> around_masters(std::span<const Outline> list) const
  {
    std::vector<Box> boxes(list.size());
    std::ranges::transform(list, boxes.begin(), [&](const Outline& o)
                           { return grown(o.box, of_facet(o)); });
    return boxes;
  }
};

/// Masters of each slave facet, as pairs of offsets and ascending indices.
void find_pairs(std::span<const Outline> slaves,
                std::span<const Outline> masters, const Reach& reach,
                Candidates& candidates)
{
  candidates.offsets.reserve(slaves.size() + 1);
  candidates.offsets.push_back(0);
  std::vector<std::int32_t>& pairs = candidates.facets;
  const BoxTree tree = create_tree(reach.around_masters(masters));
  for (const Outline& s : slaves)
  {
    query(tree, reach.around_slave(s),
          [&](std::int32_t m)
          {
            const double d = reach.of_pair(s, masters[m]);
            if (meet(grown(s.box, d), masters[m].box) and oppose(s, masters[m]))
              pairs.push_back(m);
          });
    std::sort(pairs.begin() + candidates.offsets.back(), pairs.end());
    candidates.offsets.push_back(pairs.size());
  }
}

/// Let the candidates have the masters that are in a pair, and refer to these.
/// @param[in] order Facets of `near` that the pairs refer to.
void keep_paired(const Facets& near, std::span<const std::int32_t> order,
                 Candidates& candidates)
{
  std::vector<std::int32_t> index(order.size(), -1);
  for (std::int32_t m : candidates.facets)
    index[m] = 0;
  FacetList& list = candidates.master;
  for (std::size_t m = 0; m < order.size(); ++m)
  {
    if (index[m] < 0)
      continue;
    index[m] = list.types.size();
    const Facet& facet = near.facets[order[m]];
    list.types.push_back(facet.type);
    list.orientation.push_back(facet.orientation);
    for (const Node& node : near.nodes_of(order[m]))
    {
      list.blocks.push_back(node.block);
      list.x.insert(list.x.end(), node.x.begin(), node.x.end());
    }
    list.offsets.push_back(list.blocks.size());
  }
  for (std::int32_t& m : candidates.facets)
    m = index[m];
}

/// What is wrong with positions, else nothing.
std::string check_positions(const Surface& s, std::span<const double> x)
{
  if (x.size() != 3 * s.numbers.size())
    return "Positions need three values for each node of a surface.";
  if (!std::ranges::all_of(x, [](double v)
                           { return std::abs(v) <= largest_position; }))
  {
    return "The position of a surface node is not finite (NaN, infinite or "
           "beyond 1e75): the solver has diverged.";
  }
  return "";
}
} // namespace

//-----------------------------------------------------------------------------
Candidates dolfinx_mortar::find_candidates(const Surface& slave,
                                           std::span<const double> x_slave,
                                           const Surface& master,
                                           std::span<const double> x_master,
                                           std::optional<double> distance,
                                           double factor)
{
  std::string message = check_positions(slave, x_slave);
  if (message.empty())
    message = check_positions(master, x_master);
  if (distance and !(*distance > 0 and std::isfinite(*distance)))
    message = "The search distance must be a positive length.";
  throw_on_all(slave.comm, message);

  const Reach reach
      = {distance ? std::optional(*distance * factor) : std::nullopt, factor};
  const std::vector<Outline> slaves = outlines(slave, x_slave);
  std::vector<Box> around;
  for (const Outline& o : slaves)
    around.push_back(reach.around_slave(o));
  const Facets near = collect(boxes_of_parts(slave, around), master, x_master,
                              reach.around_masters(outlines(master, x_master)));

  const std::vector<std::int32_t> order = order_by_blocks(near);
  Candidates candidates;
  find_pairs(slaves, outlines(near, order), reach, candidates);
  keep_paired(near, order, candidates);
  return candidates;
}
