// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "adapter.h"
#include "compat.h"
#include "reference_facets.h"
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <dolfinx/mesh/Topology.h>
#include <dolfinx_mortar/common/error.h>
#include <dolfinx_mortar/common/sorted.h>
#include <map>
#include <stdexcept>
#include <utility>

using namespace dolfinx_mortar;

namespace
{
using Vector = Eigen::Vector3d;

/// Derivatives of the functions of a coordinate element at a point, shape (3,
/// number of functions).
std::vector<double>
tabulate_derivatives(const dolfinx::fem::CoordinateElement<double>& cmap,
                     const Vector& X)
{
  const std::array<std::size_t, 4> shape = cmap.tabulate_shape(1, 1);
  std::vector<double> phi(shape[0] * shape[1] * shape[2] * shape[3]);
  cmap.tabulate(1, std::span(X.data(), 3), {1, 3}, phi);
  return std::vector(phi.begin() + shape[2], phi.end());
}

/// Determinant of the Jacobian of a cell.
/// @param[in] dphi Derivatives, shape (3, number of nodes).
/// @param[in] nodes Geometry nodes of the cell.
/// @param[in] x Positions of nodes.
double jacobian_determinant(std::span<const double> dphi,
                            std::span<const std::int32_t> nodes,
                            std::span<const double> x)
{
  Eigen::Matrix3d J = Eigen::Matrix3d::Zero();
  for (int i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < nodes.size(); ++k)
      J.col(i) += dphi[i * nodes.size() + k]
                  * Eigen::Map<const Vector>(x.data() + 3 * nodes[k]);
  return J.determinant();
}

/// Midpoint of the geometry nodes of a cell.
std::string cell_midpoint(const dolfinx::mesh::Mesh<double>& mesh,
                          std::int32_t cell)
{
  const auto nodes = compat::geometry_nodes(mesh, cell);
  Vector x = Vector::Zero();
  for (std::int32_t n : nodes)
    x += Eigen::Map<const Vector>(mesh.geometry().x().data() + 3 * n)
         / nodes.size();
  return to_string(std::span<const double, 3>(x.data(), 3));
}
} // namespace

//-----------------------------------------------------------------------------
void dolfinx_mortar::check_displacements(
    const dolfinx::fem::FunctionSpace<double>& V)
{
  check_space(V);
}
//-----------------------------------------------------------------------------
std::vector<std::vector<std::int64_t>> dolfinx_mortar::number_blocks(
    const std::vector<std::reference_wrapper<const dolfinx::common::IndexMap>>&
        maps)
{
  if (maps.empty())
    return {};
  MPI_Comm comm = maps.front().get().comm();
  int size;
  MPI_Comm_size(comm, &size);

  // Number of blocks of each body on each rank
  const std::size_t n = maps.size();
  std::vector<std::int64_t> local(n), all(n * size);
  for (std::size_t b = 0; b < n; ++b)
    local[b] = maps[b].get().size_local();
  MPI_Allgather(local.data(), n, MPI_INT64_T, all.data(), n, MPI_INT64_T, comm);

  // What to add to the index of a block in its own body's map
  std::vector<std::int64_t> shift(n * size), first(n, 0);
  std::int64_t number = 0;
  for (int r = 0; r < size; ++r)
    for (std::size_t b = 0; b < n; ++b)
    {
      shift[n * r + b] = number - first[b];
      number += all[n * r + b];
      first[b] += all[n * r + b];
    }

  int rank;
  MPI_Comm_rank(comm, &rank);
  std::vector<std::vector<std::int64_t>> numbers(n);
  for (std::size_t b = 0; b < n; ++b)
  {
    const dolfinx::common::IndexMap& map = maps[b];
    for (std::int64_t i = map.local_range()[0]; i < map.local_range()[1]; ++i)
      numbers[b].push_back(i + shift[n * rank + b]);
    for (std::size_t i = 0; i < map.ghosts().size(); ++i)
      numbers[b].push_back(map.ghosts()[i] + shift[n * map.owners()[i] + b]);
  }
  return numbers;
}
//-----------------------------------------------------------------------------
namespace
{
/// Facets of a part of a surface; blocks are local blocks of the space.
struct PartFacets
{
  std::vector<FacetType> types;
  std::vector<std::int8_t> orientation;
  std::vector<std::int32_t> blocks;
};

/// Facets of owned cells, checked. Collective.
PartFacets part_facets(const SurfacePart& part)
{
  const dolfinx::fem::FunctionSpace<double>& V = *part.V;
  const std::string& name = part.name;
  const std::span<const std::int32_t> facets = part.facets;
  const std::vector<ReferenceFacet> reference
      = reference_facets(check_space(V));
  const dolfinx::mesh::Mesh<double>& mesh = *V.mesh();
  MPI_Comm comm = mesh.comm();
  mesh.topology_mutable()->create_entities(2);
  mesh.topology_mutable()->create_connectivity(2, 3);
  mesh.topology_mutable()->create_connectivity(3, 2);
  const dolfinx::mesh::Topology& topology = *mesh.topology();
  const auto facet_cells = topology.connectivity(2, 3);
  const auto cell_facets = topology.connectivity(3, 2);
  const std::int32_t num_cells = topology.index_map(3)->size_local();

  std::vector<std::int32_t> sorted(facets.begin(), facets.end());
  sort_unique(sorted);
  std::string message;
  if (!sorted.empty()
      and (sorted.front() < 0 or sorted.back() >= facet_cells->num_nodes()))
  {
    message = "The " + name
              + " has a facet with an index out of range: facets "
                "are given by their local indices in the mesh.";
  }
  throw_on_all(comm, message);

  // Jacobians at the midpoints of facets decide which way facets are oriented
  const auto& cmap = compat::coordinate_element(mesh);
  std::vector<std::vector<double>> dphi;
  for (const ReferenceFacet& facet : reference)
    dphi.push_back(tabulate_derivatives(cmap, facet.midpoint));

  // Without ghost cells a facet inside the mesh has one cell on each of its
  // two ranks; the topology knows these
  std::vector<std::int32_t> shared(topology.interprocess_facets().begin(),
                                   topology.interprocess_facets().end());
  std::ranges::sort(shared);

  std::vector<FacetType> types;
  std::vector<std::int8_t> orientation;
  std::vector<std::int32_t> blocks;
  for (std::int32_t f : sorted)
  {
    const auto cells = facet_cells->links(f);
    const auto cell = std::ranges::find_if(cells, [=](std::int32_t c)
                                           { return c < num_cells; });
    if (cell == cells.end())
      continue;
    if (cells.size() > 1 or std::ranges::binary_search(shared, f))
    {
      message = "The " + name
                + " has facets inside the mesh, between two cells, one of them "
                  "at "
                + cell_midpoint(mesh, *cell)
                + ": a surface must lie on the boundary of its body (bodies of "
                  "one mesh must not share nodes).";
      break;
    }

    const auto local = cell_facets->links(*cell);
    const std::size_t i
        = std::distance(local.begin(), std::ranges::find(local, f));
    types.push_back(reference[i].type);
    const double detJ = jacobian_determinant(
        dphi[i], compat::geometry_nodes(mesh, *cell), mesh.geometry().x());
    orientation.push_back(reference[i].outward == (detJ > 0) ? 1 : -1);
    const auto dofs = V.dofmap()->cell_dofs(*cell);
    for (int dof : reference[i].dofs)
      blocks.push_back(dofs[dof]);
  }
  throw_on_all(comm, message);
  return {std::move(types), std::move(orientation), std::move(blocks)};
}

/// Local blocks of all bodies of a surface in one list, the owned ones first.
struct BlockList
{
  /// Where the blocks of a body begin in the list
  struct Begin
  {
    std::int32_t owned, ghosts;
  };

  std::vector<std::int64_t> numbers;
  std::vector<double> X;
  std::vector<std::int32_t> origin; // in the array of displacements
  std::vector<int> owners;          // of ghosts
  std::int32_t num_owned = 0;
  std::map<std::int32_t, Begin> begin; // by SurfacePart::first_block

  /// Place of a block of a part's space in the list.
  std::int32_t place(const SurfacePart& part, std::int32_t block) const
  {
    const Begin& b = begin.at(part.first_block);
    const std::int32_t owned = part.V->dofmap()->index_map->size_local();
    return block < owned ? b.owned + block : b.ghosts + block - owned;
  }
};

/// @param[in] bodies A part of each body.
BlockList list_blocks(std::span<const SurfacePart* const> bodies)
{
  BlockList list;
  std::vector<std::vector<double>> coordinates;
  for (const SurfacePart* part : bodies)
    coordinates.push_back(part->V->tabulate_dof_coordinates(false));
  auto append = [&](std::size_t b, std::int32_t begin, std::int32_t end)
  {
    const std::span<const std::int64_t> n = bodies[b]->block_numbers;
    const std::vector<double>& x = coordinates[b];
    list.numbers.insert(list.numbers.end(), n.begin() + begin, n.begin() + end);
    list.X.insert(list.X.end(), x.begin() + 3 * begin, x.begin() + 3 * end);
    for (std::int32_t i = begin; i < end; ++i)
      list.origin.push_back(bodies[b]->first_block + i);
  };
  for (std::size_t b = 0; b < bodies.size(); ++b)
  {
    list.begin[bodies[b]->first_block].owned = list.numbers.size();
    append(b, 0, bodies[b]->V->dofmap()->index_map->size_local());
  }
  list.num_owned = list.numbers.size();
  for (std::size_t b = 0; b < bodies.size(); ++b)
  {
    const auto& map = *bodies[b]->V->dofmap()->index_map;
    list.begin[bodies[b]->first_block].ghosts = list.numbers.size();
    append(b, map.size_local(), map.size_local() + map.num_ghosts());
    list.owners.insert(list.owners.end(), map.owners().begin(),
                       map.owners().end());
  }
  return list;
}

/// A part of each body, by where its displacements begin; checked. Collective.
std::vector<const SurfacePart*> bodies_of(std::span<const SurfacePart> parts,
                                          MPI_Comm comm)
{
  std::map<std::int32_t, const SurfacePart*> bodies;
  for (const SurfacePart& part : parts)
    bodies.insert({part.first_block, &part});
  std::string message;
  std::vector<const SurfacePart*> list;
  for (auto& [first, part] : bodies)
  {
    check_space(*part->V);
    const auto& map = *part->V->dofmap()->index_map;
    if (part->block_numbers.size()
        != static_cast<std::size_t>(map.size_local() + map.num_ghosts()))
    {
      message = "Each local block of the function space needs a number.";
    }
    list.push_back(part);
  }
  throw_on_all(comm, message);
  return list;
}

/// Refuse a part that has no facets on any rank. Collective.
void check_not_empty(const SurfacePart& part, const PartFacets& facets,
                     MPI_Comm comm)
{
  const std::int64_t local = facets.types.size();
  std::int64_t global = 0;
  MPI_Allreduce(&local, &global, 1, MPI_INT64_T, MPI_SUM, comm);
  if (global == 0)
  {
    throw std::runtime_error("The " + part.name
                             + " has no facets on any rank: check the tag "
                               "and the mesh's facet tags.");
  }
}
} // namespace
//-----------------------------------------------------------------------------
Surface dolfinx_mortar::create_surface(std::span<const SurfacePart> parts)
{
  if (parts.empty())
    throw std::runtime_error("A surface needs at least one part.");
  MPI_Comm comm = parts.front().V->mesh()->comm();
  const BlockList blocks = list_blocks(bodies_of(parts, comm));
  PartFacets all;
  for (const SurfacePart& part : parts)
  {
    const PartFacets f = part_facets(part);
    check_not_empty(part, f, comm);
    all.types.insert(all.types.end(), f.types.begin(), f.types.end());
    all.orientation.insert(all.orientation.end(), f.orientation.begin(),
                           f.orientation.end());
    for (std::int32_t b : f.blocks)
      all.blocks.push_back(blocks.place(part, b));
  }

  Surface s = create_surface(comm, std::move(all.types), all.blocks,
                             std::move(all.orientation), blocks.numbers,
                             blocks.num_owned, blocks.owners, blocks.X);
  for (std::int32_t& b : s.local_blocks)
    b = blocks.origin[b];
  check_areas(s, s.X, parts.front().name);
  return s;
}
//-----------------------------------------------------------------------------
Surface
dolfinx_mortar::create_surface(const dolfinx::fem::FunctionSpace<double>& V,
                               std::span<const std::int32_t> facets,
                               std::span<const std::int64_t> block_numbers,
                               const std::string& name)
{
  const SurfacePart part{
      &V, {facets.begin(), facets.end()}, block_numbers, 0, name};
  return create_surface(std::span(&part, 1));
}
//-----------------------------------------------------------------------------
SurfacePart
dolfinx_mortar::tagged_part(const dolfinx::fem::FunctionSpace<double>& V,
                            const dolfinx::mesh::MeshTags<std::int32_t>& tags,
                            std::int32_t tag, const std::string& side,
                            std::span<const std::int64_t> block_numbers,
                            std::int32_t first_block)
{
  const std::string name
      = side + " surface (facet tag " + std::to_string(tag) + ")";
  if (tags.dim() != 2)
  {
    throw std::runtime_error("The " + name
                             + " needs tags of facets, but these "
                               "tag entities of dimension "
                             + std::to_string(tags.dim()) + ".");
  }
  if (tags.topology() != V.mesh()->topology())
  {
    throw std::runtime_error("The facet tags of the " + name
                             + " are those of another mesh than the one of its "
                               "function space.");
  }
  return {&V, tags.find(tag), block_numbers, first_block, name};
}
//-----------------------------------------------------------------------------
Surface dolfinx_mortar::create_surface(
    const dolfinx::fem::FunctionSpace<double>& V,
    const dolfinx::mesh::MeshTags<std::int32_t>& tags, std::int32_t tag,
    const std::string& side, std::span<const std::int64_t> block_numbers)
{
  const SurfacePart part = tagged_part(V, tags, tag, side, block_numbers, 0);
  return create_surface(std::span(&part, 1));
}
