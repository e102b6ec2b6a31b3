// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "adapter.h"
#include "bodies.h"
#include "compat.h"
#include <algorithm>
#include <basix/cell.h>

using namespace dolfinx_mortar;

namespace
{
/// Corners of the owned blocks of a body, shape (owned blocks, variable), as
/// local blocks: of a block on an edge, a facet or inside of a cell those of
/// this edge, facet or cell.
std::vector<std::vector<std::int32_t>> corners_of_blocks(const FunctionSpace& V)
{
  const auto& map = *V.dofmap()->index_map;
  std::vector<std::vector<std::int32_t>> corners(map.size_local());
  const basix::FiniteElement<double>& e = V.element()->basix_element();
  const auto topology = basix::cell::topology(e.cell_type());
  const auto& dofs_of = e.entity_dofs();
  const auto& cells = *V.mesh()->topology()->index_map(3);
  for (std::int32_t c = 0; c < cells.size_local() + cells.num_ghosts(); ++c)
  {
    const auto blocks = V.dofmap()->cell_dofs(c);
    for (std::size_t dim = 0; dim < dofs_of.size(); ++dim)
    {
      for (std::size_t i = 0; i < dofs_of[dim].size(); ++i)
      {
        for (int dof : dofs_of[dim][i])
        {
          const std::int32_t block = blocks[dof];
          if (block >= map.size_local() or !corners[block].empty())
            continue;
          for (int vertex : topology[dim][i])
            corners[block].push_back(blocks[dofs_of[0][vertex][0]]);
        }
      }
    }
  }
  return corners;
}

/// Numbers of the corners among those of all ranks, at local blocks of a body.
/// Collective.
std::vector<std::int64_t>
number_corners(const FunctionSpace& V,
               std::span<const std::vector<std::int32_t>> corners,
               std::int64_t first)
{
  dolfinx::la::Vector<double> v(V.dofmap()->index_map, 1);
  for (std::size_t block = 0; block < corners.size(); ++block)
  {
    if (corners[block].size() == 1)
      compat::values(v)[block] = first++;
  }
  v.scatter_fwd();
  const std::span<double> x = compat::values(v);
  return {x.begin(), x.end()};
}
} // namespace

//-----------------------------------------------------------------------------
Matrix dolfinx_mortar::create_corner_interpolation(
    const Layout& layout,
    std::span<const std::shared_ptr<const FunctionSpace>> spaces)
{
  std::vector<std::vector<std::vector<std::int32_t>>> corners;
  std::int64_t num_corners = 0;
  for (const auto& V : spaces)
  {
    corners.push_back(corners_of_blocks(*V));
    num_corners
        += std::ranges::count(corners.back(), std::size_t(1),
                              [](auto& of_block) { return of_block.size(); });
  }
  const std::int32_t num_blocks = layout.num_blocks();
  if (!any(layout.comm, num_corners < layout.owned_start(spaces.size())))
    return {};
  // Blocks of tools come last
  const std::int32_t num_tools = num_blocks - layout.owned_start(spaces.size());
  std::int64_t first = first_of_rank(layout.comm, num_corners + num_tools);
  const std::int64_t first_of_tools = first + num_corners;

  std::vector<PetscInt> offsets = {0}, columns;
  std::vector<double> values;
  auto append = [&](std::span<const std::int64_t> numbers)
  {
    for (int component = 0; component < 3; ++component)
    {
      for (std::int64_t number : numbers)
        columns.push_back(3 * number + component);
      values.insert(values.end(), numbers.size(), 1.0 / numbers.size());
      offsets.push_back(columns.size());
    }
  };
  for (std::size_t b = 0; b < spaces.size(); ++b)
  {
    const std::vector<std::int64_t> numbers
        = number_corners(*spaces[b], corners[b], first);
    for (const std::vector<std::int32_t>& of_block : corners[b])
    {
      std::vector<std::int64_t> own;
      for (std::int32_t corner : of_block)
        own.push_back(numbers[corner]);
      first += own.size() == 1;
      std::ranges::sort(own);
      append(own);
    }
  }
  for (std::int64_t number = first_of_tools;
       number < first_of_tools + num_tools; ++number)
    append({&number, 1});
  return create_from_rows(layout.comm, 3 * num_blocks,
                          3 * (num_corners + num_tools), offsets, columns,
                          values);
}
