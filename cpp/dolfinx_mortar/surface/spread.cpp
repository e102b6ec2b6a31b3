// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "spread.h"
#include "boxes.h"
#include "triangles.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <dolfinx_mortar/common/mpi_exchange.h>
#include <dolfinx_mortar/common/sorted.h>
#include <numeric>

using namespace dolfinx_mortar;

namespace
{
/// Parts of a rank: a contact zone on a tenth of the surface has a dozen of
/// each. Parts of more facets than these have few edges compared with their
/// areas already.
constexpr std::int64_t parts_of_rank = 128;
constexpr std::int64_t most_facets = 16;

/// A facet as it travels; its nodes travel beside it.
struct PlacedFacet
{
  std::int64_t place; ///< among all facets along the curve
  FacetType type;
  std::int8_t orientation;
};

/// Box around the nodes of all ranks. Collective.
Box bounding_box(const Surface& s)
{
  Box box;
  for (std::int32_t k = 0; k < s.num_owned; ++k)
    add(box, std::array{s.X[3 * k], s.X[3 * k + 1], s.X[3 * k + 2]});
  MPI_Allreduce(MPI_IN_PLACE, box.lower.data(), 3, MPI_DOUBLE, MPI_MIN, s.comm);
  MPI_Allreduce(MPI_IN_PLACE, box.upper.data(), 3, MPI_DOUBLE, MPI_MAX, s.comm);
  return box;
}

/// Bits of a coordinate along the curve
constexpr int bits = 20;

/// Where a cell of a grid is along Hilbert's curve, with Skilling's algorithm
/// (doi:10.1063/1.1751381).
std::uint64_t along_curve(std::array<std::uint32_t, 3> x)
{
  for (std::uint32_t q = 1U << (bits - 1); q > 1; q >>= 1)
  {
    for (std::uint32_t& y : x)
    {
      const std::uint32_t t = (x[0] ^ y) & (q - 1);
      if (y & q)
        x[0] ^= q - 1;
      else
      {
        x[0] ^= t;
        y ^= t;
      }
    }
  }
  x[1] ^= x[0];
  x[2] ^= x[1];
  std::uint32_t t = 0;
  for (std::uint32_t q = 1U << (bits - 1); q > 1; q >>= 1)
  {
    if (x[2] & q)
      t ^= q - 1;
  }
  std::uint64_t code = 0;
  for (int b = bits - 1; b >= 0; --b)
  {
    for (std::uint32_t y : x)
      code = code << 1 | ((y ^ t) >> b & 1);
  }
  return code;
}

/// Where the middles of the facets of this rank are along the curve.
/// @param[in] box Box around all nodes.
std::vector<std::uint64_t> curve_codes(const Surface& s, const Box& box)
{
  double side = 0;
  for (int c = 0; c < 3; ++c)
    side = std::max(side, box.upper[c] - box.lower[c]);
  const double last = (1U << bits) - 1, scale = side > 0 ? last / side : 0.0;
  std::vector<std::uint64_t> codes;
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    const Eigen::Vector3d x = middle(s, s.X, f);
    std::array<std::uint32_t, 3> cell;
    for (int c = 0; c < 3; ++c)
    {
      // Middles may lie outside of the nodes' box where facets are curved
      cell[c] = std::clamp((x[c] - box.lower[c]) * scale, 0.0, last);
    }
    codes.push_back(along_curve(cell));
  }
  return codes;
}

/// Places of the facets of this rank among those of all ranks. Collective.
std::vector<std::int64_t> places(MPI_Comm comm,
                                 std::span<const std::uint64_t> codes)
{
  int rank, size;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &size);
  const int num = codes.size();
  std::vector<int> nums(size), first(size + 1, 0);
  MPI_Allgather(&num, 1, MPI_INT, nums.data(), 1, MPI_INT, comm);
  std::inclusive_scan(nums.begin(), nums.end(), first.begin() + 1);
  std::vector<std::uint64_t> all(first.back());
  MPI_Allgatherv(codes.data(), num, MPI_UINT64_T, all.data(), nums.data(),
                 first.data(), MPI_UINT64_T, comm);
  std::vector<std::int32_t> order(all.size());
  std::iota(order.begin(), order.end(), 0);
  std::ranges::stable_sort(order, {}, [&](auto i) { return all[i]; });
  std::vector<std::int64_t> place(num);
  for (std::size_t i = 0; i < order.size(); ++i)
  {
    const std::int32_t f = order[i] - first[rank];
    if (f >= 0 and f < num)
      place[f] = i;
  }
  return place;
}

/// Send facets, and the numbers of their nodes, to where they are to be; those
/// of this rank too.
/// @return Facets and nodes that arrive.
std::pair<RankData<PlacedFacet>, RankData<std::int64_t>>
deal(const Surface& s, std::span<const std::int64_t> place,
     std::int64_t part_size)
{
  int size;
  MPI_Comm_size(s.comm, &size);
  std::vector<std::int32_t> order(place.size());
  std::iota(order.begin(), order.end(), 0);
  auto destination = [&](std::int32_t f)
  { return static_cast<int>(place[f] / part_size % size); };
  std::ranges::stable_sort(order, {}, destination);
  RankData<PlacedFacet> facets;
  RankData<std::int64_t> nodes;
  for (std::int32_t f : order)
  {
    if (facets.ranks.empty() or facets.ranks.back() != destination(f))
    {
      facets.ranks.push_back(destination(f));
      nodes.ranks.push_back(destination(f));
      facets.offsets.push_back(facets.offsets.back());
      nodes.offsets.push_back(nodes.offsets.back());
    }
    facets.values.push_back({place[f], s.types[f], s.orientation[f]});
    for (std::int32_t k : facet_nodes(s, f))
      nodes.values.push_back(s.numbers[k]);
    facets.offsets.back() = facets.values.size();
    nodes.offsets.back() = nodes.values.size();
  }
  return {exchange(s.comm, facets), exchange(s.comm, nodes)};
}

/// Give a surface its facets, in the order of the curve, and the parts these
/// form.
/// @param[in] facets,nodes What has arrived, see deal.
/// @return Numbers of the nodes of all facets, one facet after the other.
std::vector<std::int64_t> set_facets(Surface& s,
                                     std::span<const PlacedFacet> facets,
                                     std::span<const std::int64_t> nodes,
                                     std::int64_t part_size)
{
  std::vector<std::int32_t> order(facets.size()), begin(facets.size());
  std::iota(order.begin(), order.end(), 0);
  std::int32_t at = 0;
  for (std::size_t f = 0; f < facets.size(); ++f)
  {
    begin[f] = at;
    at += num_nodes(facets[f].type);
  }
  std::ranges::sort(order, {}, [&](auto f) { return facets[f].place; });
  std::vector<std::int64_t> numbers;
  s.parts = {0};
  for (std::size_t i = 0; i < order.size(); ++i)
  {
    const PlacedFacet& facet = facets[order[i]];
    s.types.push_back(facet.type);
    s.orientation.push_back(facet.orientation);
    const auto own = nodes.subspan(begin[order[i]], num_nodes(facet.type));
    numbers.insert(numbers.end(), own.begin(), own.end());
    s.offsets.push_back(numbers.size());
    if (i + 1 == order.size()
        or facets[order[i + 1]].place / part_size != facet.place / part_size)
      s.parts.push_back(i + 1);
  }
  return numbers;
}

/// Numbers of nodes that other ranks own, for their owners; ascending.
/// Collective.
RankData<std::int64_t> foreign(const Surface& s,
                               std::vector<std::int64_t> numbers)
{
  int size;
  MPI_Comm_size(s.comm, &size);
  std::vector<std::int64_t> first(size);
  MPI_Allgather(&s.first_owned, 1, MPI_INT64_T, first.data(), 1, MPI_INT64_T,
                s.comm);
  sort_unique(numbers);
  RankData<std::int64_t> data;
  for (std::int64_t n : numbers)
  {
    if (n >= s.first_owned and n < s.first_owned + s.num_owned)
      continue;
    // Ranks without nodes begin where the next one does
    const int owner = std::ranges::upper_bound(first, n) - first.begin() - 1;
    if (data.ranks.empty() or data.ranks.back() != owner)
    {
      data.ranks.push_back(owner);
      data.offsets.push_back(data.offsets.back());
    }
    data.values.push_back(n);
    ++data.offsets.back();
  }
  return data;
}
} // namespace

//-----------------------------------------------------------------------------
Surface dolfinx_mortar::spread_facets(const Surface& s)
{
  int size;
  MPI_Comm_size(s.comm, &size);
  const std::vector<std::int64_t> place
      = places(s.comm, curve_codes(s, bounding_box(s)));
  std::int64_t num = s.types.size();
  MPI_Allreduce(MPI_IN_PLACE, &num, 1, MPI_INT64_T, MPI_SUM, s.comm);
  const std::int64_t part_size
      = std::clamp<std::int64_t>(num / (parts_of_rank * size), 1, most_facets);
  const auto [facets, nodes] = deal(s, place, part_size);

  Surface out;
  out.comm = s.comm;
  out.num_owned = s.num_owned;
  out.first_owned = s.first_owned;
  out.num_global = s.num_global;
  const std::vector<std::int64_t> numbers
      = set_facets(out, facets.values, nodes.values, part_size);
  const RankData<std::int64_t> wanted = foreign(s, numbers);
  const RankData<std::int64_t> asked = exchange(s.comm, wanted);
  out.owner_ranks = wanted.ranks;
  out.recv_offsets = wanted.offsets;
  out.recv_nodes.resize(wanted.values.size());
  std::iota(out.recv_nodes.begin(), out.recv_nodes.end(), out.num_owned);
  out.ghost_ranks = asked.ranks;
  out.send_offsets = asked.offsets;
  for (std::int64_t n : asked.values)
    out.send_nodes.push_back(n - s.first_owned);

  out.numbers.assign(s.numbers.begin(), s.numbers.begin() + s.num_owned);
  out.numbers.insert(out.numbers.end(), wanted.values.begin(),
                     wanted.values.end());
  const std::size_t num_nodes = out.numbers.size();
  out.blocks.assign(s.blocks.begin(), s.blocks.begin() + s.num_owned);
  out.blocks.resize(num_nodes, -1);
  out.local_blocks.assign(s.local_blocks.begin(),
                          s.local_blocks.begin() + s.num_owned);
  out.local_blocks.resize(num_nodes, -1);
  out.X.assign(s.X.begin(), s.X.begin() + 3 * s.num_owned);
  out.X.resize(3 * num_nodes, 0.0);
  scatter_forward(out, std::span(out.blocks), 1);
  scatter_forward(out, std::span(out.X), 3);
  for (std::int64_t n : numbers)
  {
    const bool own = n >= s.first_owned and n < s.first_owned + s.num_owned;
    // Owners ascend, and so do all foreign numbers
    const std::int64_t k
        = own ? n - s.first_owned
              : s.num_owned
                    + (std::ranges::lower_bound(wanted.values, n)
                       - wanted.values.begin());
    out.nodes.push_back(k);
  }
  return out;
}
