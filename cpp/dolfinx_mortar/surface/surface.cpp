// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "surface.h"
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <dolfinx_mortar/common/error.h>
#include <dolfinx_mortar/common/mpi_exchange.h>
#include <dolfinx_mortar/common/sorted.h>
#include <numeric>
#include <string>
#include <tuple>
#include <utility>

using namespace dolfinx_mortar;

namespace
{
/// Local blocks of a function space, those that this rank owns first.
struct SpaceBlocks
{
  std::span<const std::int64_t> numbers;
  std::int32_t num_owned;
  std::span<const int> ghost_owners;
  std::span<const double> X;

  std::int32_t size() const { return numbers.size(); }
  int owner(std::int32_t ghost) const
  {
    return ghost_owners[ghost - num_owned];
  }
};

/// What is wrong with the arrays that a surface is made of, else nothing.
std::string check_arrays(MPI_Comm comm, std::span<const FacetType> types,
                         std::span<const std::int8_t> orientation,
                         std::span<const std::int32_t> facet_blocks,
                         const SpaceBlocks& blocks)
{
  int rank, num_ranks;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &num_ranks);
  std::size_t num_facet_nodes = 0;
  for (FacetType type : types)
  {
    const int t = static_cast<int>(type);
    if (t < 0 or t >= num_facet_types)
      return "There is no facet type " + std::to_string(t) + ".";
    num_facet_nodes += num_nodes(type);
  }
  const std::int32_t size = blocks.size();
  if (num_facet_nodes != facet_blocks.size()
      or orientation.size() != types.size() or blocks.num_owned < 0
      or blocks.num_owned > size
      or blocks.ghost_owners.size()
             != static_cast<std::size_t>(size - blocks.num_owned)
      or blocks.X.size() != 3 * static_cast<std::size_t>(size))
  {
    return "The arrays that describe a surface do not fit together: check "
           "their lengths.";
  }
  if (std::ranges::any_of(orientation, [](int o) { return std::abs(o) != 1; }))
    return "The orientation of a facet is +1 or -1.";
  if (std::ranges::any_of(facet_blocks,
                          [=](auto b) { return b < 0 or b >= size; }))
  {
    return "A facet refers to a block that its function space does not have.";
  }
  if (std::ranges::any_of(blocks.ghost_owners, [=](int r)
                          { return r < 0 or r >= num_ranks or r == rank; }))
  {
    return "A ghost block is owned by another rank of the communicator.";
  }
  if (!std::ranges::is_sorted(blocks.numbers.first(blocks.num_owned)))
    return "The numbers of the blocks that a rank owns must ascend.";
  return "";
}

/// Blocks that become nodes of a surface, each once.
struct NodeBlocks
{
  std::vector<std::int32_t> owned;  // ascending
  std::vector<std::int32_t> ghosts; // by owner, then by number
};

/// Blocks that the facets of this rank touch.
NodeBlocks touched_blocks(std::span<const std::int32_t> facet_blocks,
                          const SpaceBlocks& blocks)
{
  NodeBlocks touched;
  touched.owned.assign(facet_blocks.begin(), facet_blocks.end());
  sort_unique(touched.owned);
  const auto split = std::ranges::lower_bound(touched.owned, blocks.num_owned);
  touched.ghosts.assign(split, touched.owned.end());
  touched.owned.erase(split, touched.owned.end());
  std::ranges::sort(touched.ghosts, {}, [&](std::int32_t b)
                    { return std::tuple(blocks.owner(b), blocks.numbers[b]); });
  return touched;
}

/// Numbers of ghosts, for their owners.
RankData<std::int64_t> numbers_for_owners(std::span<const std::int32_t> ghosts,
                                          const SpaceBlocks& blocks)
{
  RankData<std::int64_t> data;
  for (std::int32_t block : ghosts)
  {
    if (data.ranks.empty() or data.ranks.back() != blocks.owner(block))
    {
      data.ranks.push_back(blocks.owner(block));
      data.offsets.push_back(data.offsets.back());
    }
    data.values.push_back(blocks.numbers[block]);
    ++data.offsets.back();
  }
  return data;
}

/// Blocks of this rank that have some numbers. Collective.
std::vector<std::int32_t> owned_blocks(MPI_Comm comm,
                                       std::span<const std::int64_t> numbers,
                                       const SpaceBlocks& blocks)
{
  std::string message;
  std::vector<std::int32_t> found;
  found.reserve(numbers.size());
  const auto owned = blocks.numbers.first(blocks.num_owned);
  for (std::int64_t number : numbers)
  {
    const auto it = std::ranges::lower_bound(owned, number);
    if (it == owned.end() or *it != number)
    {
      message = "Block " + std::to_string(number)
                + " is not owned by the rank that is said to own it.";
    }
    found.push_back(std::distance(owned.begin(), it));
  }
  throw_on_all(comm, message);
  return found;
}

/// One side of the exchange plan of a surface: nodes whose values this rank
/// shares with others.
struct SharedNodes
{
  std::span<const int> ranks;
  std::span<const std::int32_t> offsets, nodes;
};

SharedNodes owned_nodes(const Surface& s)
{
  return {s.ghost_ranks, s.send_offsets, s.send_nodes};
}

SharedNodes ghost_nodes(const Surface& s)
{
  return {s.owner_ranks, s.recv_offsets, s.recv_nodes};
}

/// Exchange values along the plan of a surface.
/// @param[in] from Nodes whose values this rank sends.
/// @param[in] to Nodes whose values it gets.
/// @return Values of the latter.
template <typename T>
std::vector<T> exchange_values(MPI_Comm comm, std::span<const T> values, int bs,
                               const SharedNodes& from, const SharedNodes& to)
{
  constexpr int tag = static_cast<int>(Tag::scatter);
  std::vector<T> send(bs * from.nodes.size());
  for (std::size_t i = 0; i < from.nodes.size(); ++i)
    std::copy_n(values.data() + bs * from.nodes[i], bs, send.data() + bs * i);
  std::vector<T> recv(bs * to.nodes.size());

  // Point-to-point messages need no communicator of the surface's own, which
  // somebody would have to free collectively
  const int size = bs * sizeof(T);
  std::vector<MPI_Request> requests(to.ranks.size() + from.ranks.size());
  for (std::size_t i = 0; i < to.ranks.size(); ++i)
  {
    MPI_Irecv(recv.data() + bs * to.offsets[i],
              size * (to.offsets[i + 1] - to.offsets[i]), MPI_BYTE, to.ranks[i],
              tag, comm, &requests[i]);
  }
  for (std::size_t i = 0; i < from.ranks.size(); ++i)
  {
    MPI_Isend(send.data() + bs * from.offsets[i],
              size * (from.offsets[i + 1] - from.offsets[i]), MPI_BYTE,
              from.ranks[i], tag, comm, &requests[to.ranks.size() + i]);
  }
  MPI_Waitall(requests.size(), requests.data(), MPI_STATUSES_IGNORE);
  received_bytes() += recv.size() * sizeof(T);
  return recv;
}

/// Refuse values that are not one row for each local node: a rank that refused
/// them alone would leave its neighbours waiting for them. Collective.
void check_values(const Surface& s, std::size_t num_values, int bs)
{
  const bool fits
      = num_values == static_cast<std::size_t>(bs) * s.numbers.size();
  throw_on_all(s.comm,
               fits ? ""
                    : "Nodal values of a surface need one row for each local "
                      "node, owned or ghost.");
}
} // namespace

//-----------------------------------------------------------------------------
Surface dolfinx_mortar::create_surface(
    MPI_Comm comm, std::vector<FacetType> types,
    std::span<const std::int32_t> facet_blocks,
    std::vector<std::int8_t> orientation,
    std::span<const std::int64_t> block_numbers, std::int32_t num_owned_blocks,
    std::span<const int> block_owners, std::span<const double> X)
{
  const SpaceBlocks blocks = {block_numbers, num_owned_blocks, block_owners, X};
  throw_on_all(comm,
               check_arrays(comm, types, orientation, facet_blocks, blocks));

  Surface s;
  s.comm = comm;
  s.types = std::move(types);
  s.orientation = std::move(orientation);
  s.offsets.reserve(s.types.size() + 1);
  for (FacetType type : s.types)
    s.offsets.push_back(s.offsets.back() + num_nodes(type));

  // Owned nodes are those of this rank's facets, and those that others ask for
  NodeBlocks nodes = touched_blocks(facet_blocks, blocks);
  const RankData<std::int64_t> wanted
      = numbers_for_owners(nodes.ghosts, blocks);
  const RankData<std::int64_t> asked = exchange(comm, wanted);
  const std::vector<std::int32_t> shared
      = owned_blocks(comm, asked.values, blocks);
  nodes.owned.insert(nodes.owned.end(), shared.begin(), shared.end());
  sort_unique(nodes.owned);

  s.num_owned = nodes.owned.size();
  s.local_blocks = std::move(nodes.owned);
  s.local_blocks.insert(s.local_blocks.end(), nodes.ghosts.begin(),
                        nodes.ghosts.end());
  std::vector<std::int32_t> node_of_block(blocks.size(), -1);
  for (std::size_t i = 0; i < s.local_blocks.size(); ++i)
  {
    const std::int32_t block = s.local_blocks[i];
    node_of_block[block] = i;
    s.blocks.push_back(blocks.numbers[block]);
    s.X.insert(s.X.end(), X.begin() + 3 * block, X.begin() + 3 * block + 3);
  }
  auto node = [&](std::int32_t block) { return node_of_block[block]; };
  s.nodes.resize(facet_blocks.size());
  std::ranges::transform(facet_blocks, s.nodes.begin(), node);

  s.owner_ranks = wanted.ranks;
  s.recv_offsets = wanted.offsets;
  s.recv_nodes.resize(nodes.ghosts.size());
  std::iota(s.recv_nodes.begin(), s.recv_nodes.end(), s.num_owned);
  s.ghost_ranks = asked.ranks;
  s.send_offsets = asked.offsets;
  s.send_nodes.resize(shared.size());
  std::ranges::transform(shared, s.send_nodes.begin(), node);

  number_nodes(s);
  // Cells of different ranks agree on X up to round-off only
  scatter_forward(s, std::span(s.X), 3);
  return s;
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::number_nodes(Surface& s)
{
  int rank;
  MPI_Comm_rank(s.comm, &rank);
  const std::int64_t n = s.num_owned;
  MPI_Exscan(&n, &s.first_owned, 1, MPI_INT64_T, MPI_SUM, s.comm);
  MPI_Allreduce(&n, &s.num_global, 1, MPI_INT64_T, MPI_SUM, s.comm);
  if (rank == 0)
    s.first_owned = 0;
  s.numbers.resize(s.num_owned + s.recv_nodes.size());
  std::iota(s.numbers.begin(), s.numbers.end(), s.first_owned);
  scatter_forward(s, std::span(s.numbers), 1);
}
//-----------------------------------------------------------------------------
template <typename T>
void dolfinx_mortar::scatter_forward(const Surface& s, std::span<T> values,
                                     int bs)
{
  check_values(s, values.size(), bs);
  const std::vector<T> recv
      = exchange_values<T>(s.comm, values, bs, owned_nodes(s), ghost_nodes(s));
  for (std::size_t i = 0; i < s.recv_nodes.size(); ++i)
    std::copy_n(recv.data() + bs * i, bs, values.data() + bs * s.recv_nodes[i]);
}
//-----------------------------------------------------------------------------
template <typename T>
void dolfinx_mortar::scatter_reverse_add(const Surface& s, std::span<T> values,
                                         int bs)
{
  check_values(s, values.size(), bs);
  const std::vector<T> recv
      = exchange_values<T>(s.comm, values, bs, ghost_nodes(s), owned_nodes(s));
  for (std::size_t i = 0; i < s.send_nodes.size(); ++i)
    for (int c = 0; c < bs; ++c)
      values[bs * s.send_nodes[i] + c] += recv[bs * i + c];
}
//-----------------------------------------------------------------------------
template void dolfinx_mortar::scatter_forward(const Surface&, std::span<double>,
                                              int);
template void dolfinx_mortar::scatter_forward(const Surface&,
                                              std::span<std::int8_t>, int);
template void dolfinx_mortar::scatter_forward(const Surface&,
                                              std::span<std::int32_t>, int);
template void dolfinx_mortar::scatter_forward(const Surface&,
                                              std::span<std::int64_t>, int);
template void dolfinx_mortar::scatter_reverse_add(const Surface&,
                                                  std::span<double>, int);
template void dolfinx_mortar::scatter_reverse_add(const Surface&,
                                                  std::span<std::int8_t>, int);
template void dolfinx_mortar::scatter_reverse_add(const Surface&,
                                                  std::span<std::int32_t>, int);
template void dolfinx_mortar::scatter_reverse_add(const Surface&,
                                                  std::span<std::int64_t>, int);
//-----------------------------------------------------------------------------
std::vector<double> dolfinx_mortar::current_positions(const Surface& s,
                                                      std::span<const double> u)
{
  std::string message;
  std::vector<double> x = s.X;
  for (std::int32_t i = 0; i < s.num_owned and message.empty(); ++i)
  {
    const std::size_t block = s.local_blocks[i];
    if (3 * block + 3 > u.size())
    {
      message = "The displacement has too few values for the function space of "
                "the surface.";
      break;
    }
    for (int c = 0; c < 3; ++c)
      x[3 * i + c] += u[3 * block + c];
    if (!std::isfinite(x[3 * i] + x[3 * i + 1] + x[3 * i + 2]))
    {
      message = "The displacement of the surface node at "
                + to_string(std::span(s.X).subspan(3 * i).first<3>())
                + " is not finite (NaN or infinite): the solver has diverged, "
                  "or the displacement was never set.";
    }
  }
  throw_on_all(s.comm, message);
  scatter_forward(s, std::span(x), 3);
  return x;
}
