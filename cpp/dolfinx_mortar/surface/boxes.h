// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "surface.h"
#include <algorithm>
#include <array>
#include <cstdint>
#include <dolfinx_mortar/common/mpi_exchange.h>
#include <limits>
#include <mpi.h>
#include <span>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Box with sides along the axes; empty by default.
struct Box
{
  static constexpr double inf = std::numeric_limits<double>::infinity();
  std::array<double, 3> lower = {inf, inf, inf};
  std::array<double, 3> upper = {-inf, -inf, -inf};
};

/// @brief Let a box hold a point too.
void add(Box& box, const std::array<double, 3>& x);

/// @brief Let a box hold another one too.
void add(Box& box, const Box& other);

/// @brief Box whose sides are `distance` further out.
Box grown(const Box& box, double distance);

/// @brief True where boxes have a point in common.
bool meet(const Box& a, const Box& b);

/// @brief Bounding box tree, depth first: the first child of entry `i` is
/// `i + 1`, and `next` leads past the subtree of an entry.
struct BoxTree
{
  struct Entry
  {
    Box box;
    std::int32_t next;
    std::int32_t begin, end;
    bool leaf;
  };
  std::vector<Entry> entries;

  /// Leaves hold `order[begin:end]`, indices of boxes
  std::vector<std::int32_t> order;
};

/// @brief Create the tree of some boxes.
BoxTree create_tree(std::span<const Box> boxes);

/// @brief Call `fn` with the index of each box that meets a given one, and
/// perhaps of some that do not.
template <typename F>
void query(const BoxTree& tree, const Box& box, F&& fn)
{
  std::size_t i = 0;
  while (i < tree.entries.size())
  {
    const BoxTree::Entry& e = tree.entries[i];
    if (!meet(e.box, box))
    {
      i = e.next;
      continue;
    }
    if (e.leaf)
      std::for_each(tree.order.begin() + e.begin, tree.order.begin() + e.end,
                    fn);
    ++i;
  }
}

/// @brief Boxes around the parts of a surface.
/// @param[in] s Surface.
/// @param[in] facets Box around each facet of this rank.
std::vector<Box> boxes_of_parts(const Surface& s, std::span<const Box> facets);

/// @brief Which of this rank's boxes meet those around what each other rank
/// looks for. Collective.
///
/// Every rank learns these of every other rank.
///
/// @param[in] comm Communicator.
/// @param[in] wanted Boxes around what this rank looks for.
/// @param[in] boxes Boxes of what this rank has.
/// @return Indices of boxes, ascending, for each rank (this one included) some
/// of whose boxes they meet.
RankData<std::int32_t> boxes_near(MPI_Comm comm, std::span<const Box> wanted,
                                  std::span<const Box> boxes);

/// @brief What ranks have within the boxes around what this rank looks for.
/// Collective.
/// @param[in] comm Communicator.
/// @param[in] wanted Boxes around what this rank looks for.
/// @param[in] items What this rank has.
/// @param[in] boxes Box of each of these.
/// @return Items of all ranks, this one included, by rank.
template <typename T>
std::vector<T> collect_near(MPI_Comm comm, std::span<const Box> wanted,
                            std::span<const T> items,
                            std::span<const Box> boxes)
{
  const RankData<std::int32_t> near = boxes_near(comm, wanted, boxes);
  RankData<T> send = {near.ranks, near.offsets, {}};
  for (std::int32_t i : near.values)
    send.values.push_back(items[i]);
  return exchange(comm, send).values;
}
} // namespace dolfinx_mortar
