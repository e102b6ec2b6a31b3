// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "patches.h"
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <compare>
#include <dolfinx_mortar/common/mpi_exchange.h>
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

/// Index in `owner_ranks` of the owner of a ghost.
std::size_t owner_index(const Surface& s, std::int32_t ghost)
{
  const auto it = std::ranges::upper_bound(s.recv_offsets, ghost - s.num_owned);
  return std::distance(s.recv_offsets.begin(), it) - 1;
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

/// A node of a rank's facets.
struct PatchNode
{
  std::int64_t number;
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
    std::ranges::sort(v);
    v.erase(std::ranges::unique(v).begin(), v.end());
    out.ranks.push_back(data.ranks[r]);
    out.values.insert(out.values.end(), v.begin(), v.end());
    out.offsets.push_back(out.values.size());
  }
  return out;
}
} // namespace

//-----------------------------------------------------------------------------
Surface dolfinx_mortar::split_at_edges(const Surface& s, double feature_angle)
{
  // Facets at nodes, in the order of `s.nodes`
  std::vector<double> normals(3 * s.nodes.size());
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    facet_normals(s, s.X, f,
                  std::span(normals).subspan(3 * s.offsets[f],
                                             3 * facet_nodes(s, f).size()));
  }

  // This rank's own nodes come first among what an owner numbers, then those of
  // other ranks, rank after rank
  std::vector<std::vector<std::int32_t>> at_owner(s.owner_ranks.size());
  std::vector<std::int32_t> at_own;
  for (std::size_t i = 0; i < s.nodes.size(); ++i)
  {
    if (s.nodes[i] < s.num_owned)
      at_own.push_back(i);
    else
      at_owner[owner_index(s, s.nodes[i])].push_back(i);
  }
  auto incidence = [&](std::int32_t i) -> Incidence
  {
    return {s.numbers[s.nodes[i]],
            {normals[3 * i], normals[3 * i + 1], normals[3 * i + 2]}};
  };
  std::vector<Incidence> incidences;
  std::ranges::transform(at_own, std::back_inserter(incidences), incidence);
  RankData<Incidence> sent;
  sent.ranks = s.owner_ranks;
  for (const auto& list : at_owner)
  {
    std::ranges::transform(list, std::back_inserter(sent.values), incidence);
    sent.offsets.push_back(sent.values.size());
  }
  const RankData<Incidence> received = exchange(s.comm, sent);
  incidences.insert(incidences.end(), received.values.begin(),
                    received.values.end());

  // The owners number the patches
  const Patches patches
      = find_patches(s, incidences, std::cos(std::min(feature_angle, M_PI)));
  std::vector<std::int32_t> first(s.num_owned + 1, 0);
  std::inclusive_scan(patches.count.begin(), patches.count.end(),
                      first.begin() + 1);
  const std::int64_t local[2] = {first.back(), first.back() - s.num_owned};
  std::int64_t global[2];
  MPI_Allreduce(local, global, 2, MPI_INT64_T, MPI_SUM, s.comm);
  if (global[1] == 0)
    return s;

  RankData<std::int32_t> answers;
  answers.ranks = received.ranks;
  answers.offsets = received.offsets;
  answers.values.assign(patches.of_incidence.begin() + at_own.size(),
                        patches.of_incidence.end());
  const RankData<std::int32_t> answered = exchange(s.comm, answers);

  // Ghosts are those patches of nodes that facets of this rank are on; the
  // owner lists them in the same order
  RankData<PatchNode> wanted, asked;
  wanted.ranks = s.owner_ranks;
  std::vector<std::int32_t> patch(s.nodes.size());
  for (std::size_t i = 0; i < at_own.size(); ++i)
    patch[at_own[i]] = patches.of_incidence[i];
  for (std::size_t r = 0, i = 0; r < at_owner.size(); ++r)
  {
    for (std::int32_t k : at_owner[r])
    {
      patch[k] = answered.values[i++];
      wanted.values.push_back({s.numbers[s.nodes[k]], patch[k]});
    }
    wanted.offsets.push_back(wanted.values.size());
  }
  asked.ranks = received.ranks;
  asked.offsets = received.offsets;
  for (std::size_t i = 0; i < received.values.size(); ++i)
    asked.values.push_back({received.values[i].number, answers.values[i]});
  wanted = unique_by_rank(wanted);
  asked = unique_by_rank(asked);

  Surface out = s;
  out.num_owned = first.back();
  out.num_global = global[0];
  MPI_Exscan(local, &out.first_owned, 1, MPI_INT64_T, MPI_SUM, s.comm);
  int rank;
  MPI_Comm_rank(s.comm, &rank);
  if (rank == 0)
    out.first_owned = 0;
  out.owner_ranks = wanted.ranks;
  out.recv_offsets = wanted.offsets;
  out.recv_nodes.resize(wanted.values.size());
  std::iota(out.recv_nodes.begin(), out.recv_nodes.end(), out.num_owned);
  out.ghost_ranks = asked.ranks;
  out.send_offsets = asked.offsets;
  out.send_nodes.clear();
  for (const PatchNode& node : asked.values)
    out.send_nodes.push_back(first[node.number - s.first_owned] + node.patch);

  // Data of nodes, from the node that each is a part of
  std::vector<std::int32_t> origin;
  for (std::int32_t k = 0; k < s.num_owned; ++k)
    origin.insert(origin.end(), patches.count[k], k);
  std::vector<std::pair<std::int64_t, std::int32_t>> ghosts; // number, index
  for (std::int32_t i = s.num_owned; i < num_local_nodes(s); ++i)
    ghosts.emplace_back(s.numbers[i], i);
  std::ranges::sort(ghosts);
  for (const PatchNode& node : wanted.values)
  {
    origin.push_back(std::ranges::lower_bound(
                         ghosts, std::pair(node.number, std::int32_t(0)))
                         ->second);
  }
  out.numbers.resize(origin.size());
  out.blocks.resize(origin.size());
  out.local_blocks.resize(origin.size());
  out.X.resize(3 * origin.size());
  for (std::size_t i = 0; i < origin.size(); ++i)
  {
    out.numbers[i] = out.first_owned + i;
    out.blocks[i] = s.blocks[origin[i]];
    out.local_blocks[i] = s.local_blocks[origin[i]];
    std::copy_n(s.X.data() + 3 * origin[i], 3, out.X.data() + 3 * i);
  }
  scatter_forward(out, std::span(out.numbers), 1);

  // Nodes of facets
  for (std::size_t r = 0; r < s.owner_ranks.size(); ++r)
  {
    const std::span<const PatchNode> list
        = std::span(wanted.values)
              .subspan(wanted.offsets[r],
                       wanted.offsets[r + 1] - wanted.offsets[r]);
    for (std::int32_t k : at_owner[r])
    {
      const auto it = std::ranges::lower_bound(
          list, PatchNode{s.numbers[s.nodes[k]], patch[k]});
      out.nodes[k]
          = out.num_owned + wanted.offsets[r] + std::distance(list.begin(), it);
    }
  }
  for (std::int32_t k : at_own)
    out.nodes[k] = first[s.nodes[k]] + patch[k];
  return out;
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
