// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT
//
// Numbers of the displacement dofs of bodies and tools, and surfaces of tools.

#include "adapter.h"
#include "bodies.h"
#include "compat.h"
#include <algorithm>
#include <dolfinx/mesh/utils.h>
#include <limits>
#include <numeric>
#include <set>

using namespace dolfinx_mortar;

namespace
{
/// Union-find over the local blocks of a space: blocks of a cell are connected.
std::vector<std::int32_t> local_components(const FunctionSpace& V)
{
  const auto& map = *V.dofmap()->index_map;
  std::vector<std::int32_t> parent(map.size_local() + map.num_ghosts());
  std::iota(parent.begin(), parent.end(), 0);
  auto root = [&](std::int32_t i)
  {
    while (parent[i] != i)
      i = parent[i] = parent[parent[i]];
    return i;
  };
  const auto& cells = *V.mesh()->topology()->index_map(3);
  for (std::int32_t c = 0; c < cells.size_local() + cells.num_ghosts(); ++c)
  {
    const auto dofs = V.dofmap()->cell_dofs(c);
    for (std::int32_t dof : dofs)
      parent[root(dof)] = root(dofs[0]);
  }
  for (std::size_t i = 0; i < parent.size(); ++i)
    parent[i] = root(i);
  return parent;
}

/// Connected part of the mesh that each local block is on, as the smallest
/// number of the blocks of that part. Collective.
std::vector<double> connected_parts(MPI_Comm comm, const FunctionSpace& V,
                                    std::span<const std::int64_t> numbers)
{
  const std::vector<std::int32_t> component = local_components(V);
  dolfinx::la::Vector<double> v(V.dofmap()->index_map, 1);
  std::ranges::copy(numbers, compat::values(v).begin());
  for (bool changed = true; changed;)
  {
    const std::span<double> x = compat::values(v);
    const std::vector<double> before(x.begin(), x.end());
    std::vector<double> smallest(x.size(),
                                 std::numeric_limits<double>::infinity());
    for (std::size_t i = 0; i < x.size(); ++i)
      smallest[component[i]] = std::min(smallest[component[i]], x[i]);
    for (std::size_t i = 0; i < x.size(); ++i)
      x[i] = smallest[component[i]];
    v.scatter_rev([](double a, double b) { return std::min(a, b); });
    v.scatter_fwd();
    changed = any(comm, !std::ranges::equal(x, before));
  }
  const std::span<double> x = compat::values(v);
  return {x.begin(), x.end()};
}

/// Mean size of the cells of a mesh [length]. Collective.
double mean_cell_size(MPI_Comm comm, const dolfinx::mesh::Mesh<double>& mesh)
{
  const std::int32_t num = mesh.topology()->index_map(3)->size_local();
  std::vector<std::int32_t> cells(num);
  std::iota(cells.begin(), cells.end(), 0);
  double total = 0;
  for (double h : dolfinx::mesh::h(mesh, std::span(std::as_const(cells)), 3))
    total += h;
  return sum(comm, total) / sum(comm, static_cast<std::int64_t>(num));
}

/// The four nodes of a frame: on rank 0, and known to all others. Collective.
std::shared_ptr<const dolfinx::common::IndexMap> create_frame_map(MPI_Comm comm)
{
  int rank;
  MPI_Comm_rank(comm, &rank);
  if (rank == 0)
  {
    return std::make_shared<dolfinx::common::IndexMap>(
        comm, 4, std::vector<std::int64_t>{}, std::vector<int>{});
  }
  return std::make_shared<dolfinx::common::IndexMap>(
      comm, 0, std::vector<std::int64_t>{0, 1, 2, 3}, std::vector<int>(4, 0));
}

/// Largest side of the box around positions of all ranks. Collective.
double extent(MPI_Comm comm, std::span<const double> x)
{
  std::array<double, 6> box;
  box.fill(std::numeric_limits<double>::infinity());
  for (std::size_t i = 0; i < x.size(); ++i)
  {
    box[i % 3] = std::min(box[i % 3], x[i]);
    box[3 + i % 3] = std::min(box[3 + i % 3], -x[i]);
  }
  MPI_Allreduce(MPI_IN_PLACE, box.data(), 6, MPI_DOUBLE, MPI_MIN, comm);
  return std::max({-box[3] - box[0], -box[4] - box[1], -box[5] - box[2]});
}
} // namespace

//-----------------------------------------------------------------------------
Layout dolfinx_mortar::create_layout(
    MPI_Comm comm, std::span<const std::shared_ptr<const FunctionSpace>> spaces,
    std::span<const std::shared_ptr<const RigidTool>> tools)
{
  Layout layout;
  layout.comm = comm;
  std::vector<std::reference_wrapper<const dolfinx::common::IndexMap>> maps;
  for (auto& V : spaces)
  {
    check_displacements(*V);
    maps.push_back(*V->dofmap()->index_map);
  }
  const std::shared_ptr<const dolfinx::common::IndexMap> four
      = tools.empty() ? nullptr : create_frame_map(comm);
  for (std::size_t t = 0; t < tools.size(); ++t)
    maps.push_back(*four);
  layout.blocks = number_blocks(maps);
  std::vector<double> parts;
  for (std::size_t b = 0; b < spaces.size(); ++b)
  {
    const FunctionSpace& V = *spaces[b];
    layout.num_owned.push_back(maps[b].get().size_local());
    layout.num_local.push_back(maps[b].get().size_local()
                               + maps[b].get().num_ghosts());
    const std::vector<double> X = V.tabulate_dof_coordinates(false);
    layout.X.insert(layout.X.end(), X.begin(),
                    X.begin() + 3 * layout.num_local[b]);
    const std::vector<double> own = connected_parts(comm, V, layout.blocks[b]);
    parts.insert(parts.end(), own.begin(), own.end());
    layout.cell_sizes.push_back(mean_cell_size(comm, *V.mesh()));
  }
  const double length = tools.empty() ? 0 : extent(comm, layout.X);
  for (std::size_t t = 0; t < tools.size(); ++t)
  {
    const std::size_t b = spaces.size() + t;
    layout.num_owned.push_back(four->size_local());
    layout.num_local.push_back(4);
    const std::array<double, 12> X = tools[t]->frame(length);
    layout.X.insert(layout.X.end(), X.begin(), X.end());
    parts.insert(parts.end(), 4, layout.blocks[b][0]);
    layout.cell_sizes.push_back(length);
  }
  layout.first_block = first_of_rank(comm, layout.num_blocks());

  // Parts by ascending number of their first block, which some rank owns
  std::vector<double> roots;
  std::set<double> mine;
  for (std::size_t i = 0; i < parts.size(); ++i)
  {
    if (parts[i] >= layout.first_block
        and parts[i] < layout.first_block + layout.num_blocks())
      mine.insert(parts[i]);
  }
  int size, count = mine.size();
  MPI_Comm_size(comm, &size);
  std::vector<int> counts(size), displacements(size + 1, 0);
  MPI_Allgather(&count, 1, MPI_INT, counts.data(), 1, MPI_INT, comm);
  std::partial_sum(counts.begin(), counts.end(), displacements.begin() + 1);
  roots.resize(displacements.back());
  const std::vector<double> sent(mine.begin(), mine.end());
  MPI_Allgatherv(sent.data(), count, MPI_DOUBLE, roots.data(), counts.data(),
                 displacements.data(), MPI_DOUBLE, comm);
  for (double part : parts)
  {
    layout.parts.push_back(std::ranges::lower_bound(roots, part)
                           - roots.begin());
  }
  layout.num_parts = roots.size();
  return layout;
}
//-----------------------------------------------------------------------------
Surface dolfinx_mortar::create_tool_surface(std::span<const TaggedFacets> parts,
                                            std::int32_t frame)
{
  std::vector<std::shared_ptr<const FunctionSpace>> spaces;
  std::vector<std::reference_wrapper<const dolfinx::common::IndexMap>> maps;
  for (const TaggedFacets& part : parts)
  {
    if (std::ranges::find(spaces, part.V) != spaces.end())
      continue;
    spaces.push_back(part.V);
    maps.push_back(*part.V->dofmap()->index_map);
  }
  Layout own;
  own.blocks = number_blocks(maps);
  for (const auto& map : maps)
  {
    own.num_owned.push_back(map.get().size_local());
    own.num_local.push_back(map.get().size_local() + map.get().num_ghosts());
  }
  Surface s = create_surface(own, spaces, parts, "master");
  std::ranges::fill(s.local_blocks, frame);
  return s;
}
