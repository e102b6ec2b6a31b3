// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "boxes.h"
#include <dolfinx_mortar/common/sorted.h>
#include <numeric>

using namespace dolfinx_mortar;

namespace
{
void build(BoxTree& tree, std::span<const Box> boxes, std::int32_t begin,
           std::int32_t end)
{
  constexpr int leaf_size = 8;
  const std::size_t i = tree.entries.size();
  Box box, centres;
  auto centre = [&](std::int32_t k, int c)
  { return boxes[k].lower[c] + boxes[k].upper[c]; };
  for (std::int32_t j = begin; j < end; ++j)
  {
    const std::int32_t k = tree.order[j];
    add(box, boxes[k]);
    add(centres,
        std::array<double, 3>{centre(k, 0), centre(k, 1), centre(k, 2)});
  }
  tree.entries.push_back({box, 0, begin, end, end - begin <= leaf_size});
  if (!tree.entries[i].leaf)
  {
    int axis = 0;
    for (int c = 1; c < 3; ++c)
      if (centres.upper[c] - centres.lower[c]
          > centres.upper[axis] - centres.lower[axis])
        axis = c;
    const std::int32_t middle = begin + (end - begin) / 2;
    auto it = tree.order.begin();
    std::nth_element(it + begin, it + middle, it + end, [&](auto a, auto b)
                     { return centre(a, axis) < centre(b, axis); });
    build(tree, boxes, begin, middle);
    build(tree, boxes, middle, end);
  }
  tree.entries[i].next = tree.entries.size();
}
} // namespace

//-----------------------------------------------------------------------------
void dolfinx_mortar::add(Box& box, const std::array<double, 3>& x)
{
  for (int c = 0; c < 3; ++c)
  {
    box.lower[c] = std::min(box.lower[c], x[c]);
    box.upper[c] = std::max(box.upper[c], x[c]);
  }
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::add(Box& box, const Box& other)
{
  add(box, other.lower);
  add(box, other.upper);
}
//-----------------------------------------------------------------------------
Box dolfinx_mortar::grown(const Box& box, double distance)
{
  Box b = box;
  for (int c = 0; c < 3; ++c)
  {
    b.lower[c] -= distance;
    b.upper[c] += distance;
  }
  return b;
}
//-----------------------------------------------------------------------------
bool dolfinx_mortar::meet(const Box& a, const Box& b)
{
  for (int c = 0; c < 3; ++c)
    if (!(a.lower[c] <= b.upper[c] and b.lower[c] <= a.upper[c]))
      return false;
  return true;
}
//-----------------------------------------------------------------------------
BoxTree dolfinx_mortar::create_tree(std::span<const Box> boxes)
{
  BoxTree tree;
  tree.order.resize(boxes.size());
  std::iota(tree.order.begin(), tree.order.end(), 0);
  if (!boxes.empty())
    build(tree, boxes, 0, boxes.size());
  return tree;
}
//-----------------------------------------------------------------------------
std::vector<Box> dolfinx_mortar::boxes_of_parts(const Surface& s,
                                                std::span<const Box> facets)
{
  const std::vector<std::int32_t> one
      = {0, static_cast<std::int32_t>(facets.size())};
  const std::vector<std::int32_t>& parts = s.parts.empty() ? one : s.parts;
  std::vector<Box> boxes(parts.size() - 1);
  for (std::size_t p = 0; p < boxes.size(); ++p)
  {
    for (std::int32_t f = parts[p]; f < parts[p + 1]; ++f)
      add(boxes[p], facets[f]);
  }
  return boxes;
}
//-----------------------------------------------------------------------------
RankData<std::int32_t> dolfinx_mortar::boxes_near(MPI_Comm comm,
                                                  std::span<const Box> wanted,
                                                  std::span<const Box> boxes)
{
  int size;
  MPI_Comm_size(comm, &size);
  static_assert(sizeof(Box) == 6 * sizeof(double));
  const int num = 6 * wanted.size();
  std::vector<int> nums(size), first(size + 1, 0);
  MPI_Allgather(&num, 1, MPI_INT, nums.data(), 1, MPI_INT, comm);
  std::inclusive_scan(nums.begin(), nums.end(), first.begin() + 1);
  std::vector<Box> all(first.back() / 6);
  MPI_Allgatherv(wanted.data(), num, MPI_DOUBLE, all.data(), nums.data(),
                 first.data(), MPI_DOUBLE, comm);
  received_bytes() += (all.size() - wanted.size()) * sizeof(Box);

  const BoxTree tree = create_tree(boxes);
  RankData<std::int32_t> near;
  for (int r = 0; r < size; ++r)
  {
    std::vector<std::int32_t> found;
    for (int i = first[r] / 6; i < first[r + 1] / 6; ++i)
    {
      query(tree, all[i],
            [&](std::int32_t k)
            {
              if (meet(boxes[k], all[i]))
                found.push_back(k);
            });
    }
    if (found.empty())
      continue;
    sort_unique(found);
    near.ranks.push_back(r);
    near.values.insert(near.values.end(), found.begin(), found.end());
    near.offsets.push_back(near.values.size());
  }
  return near;
}
//-----------------------------------------------------------------------------
