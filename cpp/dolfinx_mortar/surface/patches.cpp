// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "patches.h"
#include "triangles.h"
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <compare>
#include <dolfinx_mortar/common/mpi_exchange.h>
#include <dolfinx_mortar/common/sorted.h>
#include <numeric>
#include <utility>
#include <vector>

using namespace dolfinx_mortar;

namespace
{
using Vector = Eigen::Vector3d;

/// A facet at one of its nodes, as the owner of the node needs to know it.
struct Incidence
{
  std::int64_t number; // of the node
  std::array<double, 3> normal;
};

/// Patch at the node of each incidence, and number of patches of each node.
struct Patches
{
  std::vector<std::int32_t> of_incidence, count;
};

/// Where facets use nodes, as positions in `Surface::nodes`.
struct NodeUses
{
  /// Of nodes that this rank owns
  std::vector<std::int32_t> own;

  /// Of ghosts, for each of `Surface::owner_ranks`
  std::vector<std::vector<std::int32_t>> of_owner;
};

/// Index in `owner_ranks` of the owner of a ghost.
std::size_t owner_index(const Surface& s, std::int32_t ghost)
{
  const auto it = std::ranges::upper_bound(s.recv_offsets, ghost - s.num_owned);
  return std::distance(s.recv_offsets.begin(), it) - 1;
}

NodeUses node_uses(const Surface& s)
{
  NodeUses uses;
  uses.of_owner.resize(s.owner_ranks.size());
  for (std::size_t i = 0; i < s.nodes.size(); ++i)
  {
    if (s.nodes[i] < s.num_owned)
      uses.own.push_back(i);
    else
      uses.of_owner[owner_index(s, s.nodes[i])].push_back(i);
  }
  return uses;
}

/// Facets at their nodes, in the order of `Surface::nodes`.
std::vector<Incidence> facet_incidences(const Surface& s)
{
  std::vector<Incidence> all;
  all.reserve(s.nodes.size());
  std::array<double, 3 * max_facet_nodes> n;
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    facet_normals(s, s.X, f, n);
    const std::span<const std::int32_t> nodes = facet_nodes(s, f);
    for (std::size_t k = 0; k < nodes.size(); ++k)
    {
      all.push_back(
          {s.numbers[nodes[k]], {n[3 * k], n[3 * k + 1], n[3 * k + 2]}});
    }
  }
  return all;
}

/// What belongs to the uses of ghosts, for their owners.
template <typename T>
RankData<T> for_owners(const Surface& s, const NodeUses& uses,
                       std::span<const T> values)
{
  RankData<T> data;
  data.ranks = s.owner_ranks;
  for (const auto& list : uses.of_owner)
  {
    for (std::int32_t i : list)
      data.values.push_back(values[i]);
    data.offsets.push_back(data.values.size());
  }
  return data;
}

/// Number the smooth patches at a node.
/// @param[in] incidences Facets at the node.
/// @param[in] cosine Of the feature angle.
/// @param[out] patch Patch of each of `incidences`.
/// @return Number of patches.
std::int32_t number_patches(std::span<const std::int32_t> incidences,
                            std::span<const Incidence> all, double cosine,
                            std::vector<std::int32_t>& patch)
{
  const std::size_t n = incidences.size();
  auto normal = [&](std::size_t i)
  { return Eigen::Map<const Vector>(all[incidences[i]].normal.data()); };

  // Chains of facets without an edge between one and the next
  std::vector<std::size_t> chain(n);
  std::iota(chain.begin(), chain.end(), 0);
  for (std::size_t i = 0; i < n; ++i)
  {
    for (std::size_t j = 0; j < i; ++j)
    {
      if (chain[i] != chain[j] and normal(i).dot(normal(j)) > cosine)
        std::ranges::replace(chain, std::size_t(chain[i]), chain[j]);
    }
  }

  // In an order that no partition changes: along a direction to which no two
  // normals of a usual mesh are alike
  const Vector direction(0.5377, 0.2914, 0.7912);
  std::vector<std::pair<double, std::size_t>> order;
  for (std::size_t c = 0; c < n; ++c)
  {
    Vector sum = Vector::Zero();
    for (std::size_t i = 0; i < n; ++i)
      if (chain[i] == c)
        sum += normal(i);
    if (std::ranges::find(chain, c) != chain.end())
      order.emplace_back(sum.normalized().dot(direction), c);
  }
  std::ranges::sort(order);
  patch.resize(n);
  for (std::size_t p = 0; p < order.size(); ++p)
    for (std::size_t i = 0; i < n; ++i)
      if (chain[i] == order[p].second)
        patch[i] = p;
  return order.size();
}

/// Number the patches at all nodes that this rank owns.
/// @param[in] incidences Facets of all ranks at these nodes.
Patches find_patches(const Surface& s, std::span<const Incidence> incidences,
                     double cosine)
{
  // By node
  std::vector<std::int32_t> order(incidences.size());
  std::iota(order.begin(), order.end(), 0);
  auto number = [&](std::int32_t i) { return incidences[i].number; };
  std::ranges::stable_sort(order, {}, number);

  Patches patches{std::vector<std::int32_t>(incidences.size()),
                  std::vector<std::int32_t>(s.num_owned, 1)};
  std::vector<std::int32_t> patch;
  for (auto begin = order.begin(); begin != order.end();)
  {
    const auto end = std::find_if(begin, order.end(), [&](std::int32_t i)
                                  { return number(i) != number(*begin); });
    const std::span<const std::int32_t> at_node(begin, end);
    patches.count[number(*begin) - s.first_owned]
        = number_patches(at_node, incidences, cosine, patch);
    for (std::size_t i = 0; i < at_node.size(); ++i)
      patches.of_incidence[at_node[i]] = patch[i];
    begin = end;
  }
  return patches;
}

/// A patch at a node.
struct PatchNode
{
  std::int64_t number; // of the node
  std::int32_t patch;
  auto operator<=>(const PatchNode&) const = default;
};

/// Values of each rank sorted, each once.
RankData<PatchNode> unique_by_rank(const RankData<PatchNode>& data)
{
  RankData<PatchNode> out;
  for (std::size_t r = 0; r < data.ranks.size(); ++r)
  {
    std::vector<PatchNode> v(data.values.begin() + data.offsets[r],
                             data.values.begin() + data.offsets[r + 1]);
    sort_unique(v);
    out.ranks.push_back(data.ranks[r]);
    out.values.insert(out.values.end(), v.begin(), v.end());
    out.offsets.push_back(out.values.size());
  }
  return out;
}

/// Patch of each entry of `Surface::nodes`.
/// @param[in] of_own Patches at the uses of owned nodes.
/// @param[in] of_ghosts Patches at the uses of ghosts, owner after owner.
std::vector<std::int32_t> patch_of_uses(const NodeUses& uses,
                                        std::span<const std::int32_t> of_own,
                                        std::span<const std::int32_t> of_ghosts)
{
  std::vector<std::int32_t> patch(of_own.size() + of_ghosts.size());
  for (std::size_t i = 0; i < of_own.size(); ++i)
    patch[uses.own[i]] = of_own[i];
  auto next = of_ghosts.begin();
  for (const auto& list : uses.of_owner)
    for (std::int32_t k : list)
      patch[k] = *next++;
  return patch;
}

/// The node that each node of a split surface is a part of.
/// @param[in] count Number of patches of each owned node.
/// @param[in] ghosts Ghosts of the split surface.
std::vector<std::int32_t> origins(const Surface& s,
                                  std::span<const std::int32_t> count,
                                  std::span<const PatchNode> ghosts)
{
  std::vector<std::int32_t> origin;
  for (std::int32_t k = 0; k < s.num_owned; ++k)
    origin.insert(origin.end(), count[k], k);
  std::vector<std::pair<std::int64_t, std::int32_t>> index; // of a number
  for (std::int32_t i = s.num_owned; i < num_local_nodes(s); ++i)
    index.emplace_back(s.numbers[i], i);
  std::ranges::sort(index);
  for (const PatchNode& node : ghosts)
  {
    origin.push_back(
        std::ranges::lower_bound(index, std::pair(node.number, std::int32_t(0)))
            ->second);
  }
  return origin;
}

/// Nodes of the facets of a split surface.
/// @param[in] first First part of each owned node.
/// @param[in] num_owned Number of parts that this rank owns.
/// @param[in] patch Patch of each entry of `Surface::nodes`.
/// @param[in] ghosts Ghosts of the split surface, by owner.
std::vector<std::int32_t> split_nodes(const Surface& s, const NodeUses& uses,
                                      std::span<const std::int32_t> first,
                                      std::int32_t num_owned,
                                      std::span<const std::int32_t> patch,
                                      const RankData<PatchNode>& ghosts)
{
  std::vector<std::int32_t> nodes(s.nodes.size());
  for (std::int32_t k : uses.own)
    nodes[k] = first[s.nodes[k]] + patch[k];
  for (std::size_t r = 0; r < s.owner_ranks.size(); ++r)
  {
    const auto begin = ghosts.values.begin() + ghosts.offsets[r],
               end = ghosts.values.begin() + ghosts.offsets[r + 1];
    for (std::int32_t k : uses.of_owner[r])
    {
      const auto it = std::lower_bound(
          begin, end, PatchNode{s.numbers[s.nodes[k]], patch[k]});
      nodes[k] = num_owned + std::distance(ghosts.values.begin(), it);
    }
  }
  return nodes;
}

/// The surface whose nodes are the patches at the nodes of another. Collective.
/// @param[in] count Number of patches of each owned node.
/// @param[in] patch Patch of each entry of `Surface::nodes`.
/// @param[in] ghosts Patches that facets of this rank are on, of nodes that
/// others own.
/// @param[in] shared Patches of owned nodes that facets of others are on.
Surface split_surface(const Surface& s, const NodeUses& uses,
                      std::span<const std::int32_t> count,
                      std::span<const std::int32_t> patch,
                      const RankData<PatchNode>& ghosts,
                      const RankData<PatchNode>& shared)
{
  std::vector<std::int32_t> first(s.num_owned + 1, 0);
  std::inclusive_scan(count.begin(), count.end(), first.begin() + 1);

  Surface out;
  out.comm = s.comm;
  out.types = s.types;
  out.offsets = s.offsets;
  out.orientation = s.orientation;
  out.num_owned = first.back();
  out.nodes = split_nodes(s, uses, first, out.num_owned, patch, ghosts);
  for (std::int32_t k : origins(s, count, ghosts.values))
  {
    out.blocks.push_back(s.blocks[k]);
    out.local_blocks.push_back(s.local_blocks[k]);
    out.X.insert(out.X.end(), s.X.begin() + 3 * k, s.X.begin() + 3 * k + 3);
  }

  out.owner_ranks = ghosts.ranks;
  out.recv_offsets = ghosts.offsets;
  out.recv_nodes.resize(ghosts.values.size());
  std::iota(out.recv_nodes.begin(), out.recv_nodes.end(), out.num_owned);
  out.ghost_ranks = shared.ranks;
  out.send_offsets = shared.offsets;
  for (const PatchNode& node : shared.values)
    out.send_nodes.push_back(first[node.number - s.first_owned] + node.patch);
  number_nodes(out);
  return out;
}

/// True where some node of some rank has several patches. Collective.
bool any_split(MPI_Comm comm, std::span<const std::int32_t> count)
{
  int several = std::ranges::any_of(count, [](auto n) { return n > 1; });
  MPI_Allreduce(MPI_IN_PLACE, &several, 1, MPI_INT, MPI_MAX, comm);
  return several;
}
} // namespace

//-----------------------------------------------------------------------------
Surface dolfinx_mortar::split_at_edges(const Surface& s, double feature_angle)
{
  // The owner of a node numbers its patches: first the facets of this rank at
  // its own nodes, then those of other ranks, rank after rank
  const NodeUses uses = node_uses(s);
  const std::vector<Incidence> local = facet_incidences(s);
  std::vector<Incidence> incidences;
  for (std::int32_t i : uses.own)
    incidences.push_back(local[i]);
  const RankData<Incidence> received = exchange(
      s.comm, for_owners(s, uses, std::span<const Incidence>(local)));
  incidences.insert(incidences.end(), received.values.begin(),
                    received.values.end());
  const Patches patches
      = find_patches(s, incidences, std::cos(std::min(feature_angle, M_PI)));
  if (!any_split(s.comm, patches.count))
    return s;

  // The owners answer in the order in which they were asked
  const std::span<const std::int32_t> found(patches.of_incidence);
  const std::span<const std::int32_t> answers = found.subspan(uses.own.size());
  const RankData<std::int32_t> answered = exchange(
      s.comm, RankData<std::int32_t>{received.ranks,
                                     received.offsets,
                                     {answers.begin(), answers.end()}});
  const std::vector<std::int32_t> patch
      = patch_of_uses(uses, found.first(uses.own.size()), answered.values);

  // Ghosts are those patches of nodes that facets of this rank are on; the
  // owner lists them in the same order
  std::vector<PatchNode> nodes(s.nodes.size());
  for (std::size_t i = 0; i < nodes.size(); ++i)
    nodes[i] = {s.numbers[s.nodes[i]], patch[i]};
  const RankData<PatchNode> ghosts
      = unique_by_rank(for_owners(s, uses, std::span<const PatchNode>(nodes)));
  RankData<PatchNode> asked = {received.ranks, received.offsets, {}};
  for (std::size_t i = 0; i < received.values.size(); ++i)
    asked.values.push_back({received.values[i].number, answers[i]});
  return split_surface(s, uses, patches.count, patch, ghosts,
                       unique_by_rank(asked));
}
//-----------------------------------------------------------------------------
bool dolfinx_mortar::has_plane_patches(const Surface& s, double feature_angle)
{
  const Surface patches = split_at_edges(s, feature_angle);
  const double tol = 1e-3;
  std::array<double, 3 * max_facet_nodes> n;
  std::vector<double> sum(3 * num_local_nodes(patches), 0.0);
  for (std::size_t f = 0; f < patches.types.size(); ++f)
  {
    facet_normals(patches, patches.X, f, n);
    const std::span<const std::int32_t> nodes = facet_nodes(patches, f);
    for (std::size_t k = 0; k < nodes.size(); ++k)
      Eigen::Map<Vector>(sum.data() + 3 * nodes[k]) += row(n, k);
  }
  scatter_reverse_add(patches, std::span(sum), 3);
  scatter_forward(patches, std::span(sum), 3);
  int all = 1;
  for (std::size_t f = 0; f < patches.types.size(); ++f)
  {
    facet_normals(patches, patches.X, f, n);
    const std::span<const std::int32_t> nodes = facet_nodes(patches, f);
    for (std::size_t k = 0; k < nodes.size(); ++k)
    {
      const Vector mean = row(sum, nodes[k]).normalized();
      if (!((row(n, k) - row(n, 0)).norm() < tol
            and (row(n, k) - mean).norm() < tol))
        all = 0;
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, &all, 1, MPI_INT, MPI_LAND, s.comm);
  return all;
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::share_largest(const Surface& s,
                                   std::span<std::int32_t> values)
{
  for (std::int32_t begin = 0; begin < s.num_owned;)
  {
    std::int32_t end = begin;
    while (end < s.num_owned and s.blocks[end] == s.blocks[begin])
      ++end;
    const std::int32_t largest
        = *std::max_element(values.begin() + begin, values.begin() + end);
    std::fill(values.begin() + begin, values.begin() + end, largest);
    begin = end;
  }
}
