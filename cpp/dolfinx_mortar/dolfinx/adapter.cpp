// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "adapter.h"
#include "compat.h"
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <basix/cell.h>
#include <basix/finite-element.h>
#include <cmath>
#include <dolfinx/mesh/Topology.h>
#include <dolfinx/mesh/cell_types.h>
#include <dolfinx_mortar/common/error.h>
#include <map>
#include <stdexcept>
#include <utility>

using namespace dolfinx_mortar;

namespace
{
using Vector = Eigen::Vector3d;

/// A facet of the reference cell.
struct ReferenceFacet
{
  FacetType type;

  /// Dofs of the cell at the nodes of the facet, in the order of facet.h
  std::vector<int> dofs;

  Vector midpoint;

  /// Tangents x,ξ₁ × x,ξ₂ point out of the reference cell
  bool outward;
};

/// Check that nodes and values of a space are those of a displacement.
/// @return Basix element of a component.
const basix::FiniteElement<double>&
check_space(const dolfinx::fem::FunctionSpace<double>& V)
{
  const dolfinx::mesh::Mesh<double>& mesh = *V.mesh();
  if (mesh.geometry().dim() != 3 or mesh.topology()->dim() != 3)
  {
    throw std::runtime_error(
        "Mortar coupling is for three-dimensional bodies: the mesh has "
        "topological dimension "
        + std::to_string(mesh.topology()->dim()) + " and geometric dimension "
        + std::to_string(mesh.geometry().dim()) + ".");
  }
  const auto cell = mesh.topology()->cell_type();
  if (cell != dolfinx::mesh::CellType::tetrahedron
      and cell != dolfinx::mesh::CellType::hexahedron)
  {
    throw std::runtime_error("Cells of type " + dolfinx::mesh::to_string(cell)
                             + " are not supported: use tetrahedra or "
                               "hexahedra.");
  }
  if (!V.component().empty() or V.element()->is_mixed())
  {
    throw std::runtime_error(
        "The space is mixed or part of another space: displacements need a "
        "space of their own, fem.functionspace(mesh, (\"Lagrange\", degree, "
        "(3,))).");
  }

  const basix::FiniteElement<double>& e = [&]() -> auto&
  {
    try
    {
      return V.element()->basix_element();
    }
    catch (const std::exception&)
    {
      throw std::runtime_error(
          "The element of the space has no basis functions (quadrature "
          "element?): use Lagrange of degree 1 or 2, or "
          "dolfinx_mortar.hex20().");
    }
  }();
  if (!e.value_shape().empty())
  {
    throw std::runtime_error(
        "The components of the space's element are coupled (Nedelec, "
        "Raviart-Thomas, ...): use a blocked Lagrange element, "
        "(\"Lagrange\", degree, (3,)).");
  }
  if (e.discontinuous() or e.entity_closure_dofs()[2][0].empty())
  {
    throw std::runtime_error(
        "The space is discontinuous, so that facets have no dofs of their own: "
        "use Lagrange of degree 1 or 2, or dolfinx_mortar.hex20().");
  }
  if (!e.interpolation_is_identity())
  {
    if (e.family() == basix::element::family::serendipity)
    {
      throw std::runtime_error(
          "The space uses Basix serendipity, whose edge dofs are moments: use "
          "dolfinx_mortar.hex20(), whose dofs are values at nodes.");
    }
    throw std::runtime_error(
        "The dofs of the space are not values at nodes: use Lagrange of degree "
        "1 or 2, or dolfinx_mortar.hex20().");
  }
  if (V.dofmap()->bs() != 3 or V.dofmap()->index_map_bs() != 3)
  {
    throw std::runtime_error(
        "The space has " + std::to_string(V.dofmap()->bs())
        + " component(s), a displacement has 3: use fem.functionspace(mesh, "
          "(\"Lagrange\", degree, (3,))).");
  }
  return e;
}

/// Facets of the reference cell with their dofs, found by position: this is
/// independent of how an element numbers its dofs.
std::vector<ReferenceFacet>
reference_facets(const basix::FiniteElement<double>& e)
{
  const auto topology = basix::cell::topology(e.cell_type());
  const std::vector<double> geometry
      = basix::cell::geometry<double>(e.cell_type()).first;
  const std::vector<double>& points = e.points().first;
  auto vertex = [&](int v) -> Vector
  { return {geometry[3 * v], geometry[3 * v + 1], geometry[3 * v + 2]}; };
  Vector centre = Vector::Zero();
  const int num_vertices = topology[0].size();
  for (int v = 0; v < num_vertices; ++v)
    centre += vertex(v) / num_vertices;

  std::vector<ReferenceFacet> facets(topology[2].size());
  for (std::size_t f = 0; f < facets.size(); ++f)
  {
    ReferenceFacet& facet = facets[f];
    const std::vector<int>& closure = e.entity_closure_dofs()[2][f];
    const bool triangle = topology[2][f].size() == 3;
    const auto type = [&]() -> FacetType
    {
      switch (closure.size())
      {
      case 3:
        return FacetType::tri3;
      case 6:
        return FacetType::tri6;
      case 4:
        return FacetType::quad4;
      case 8:
        return FacetType::quad8;
      case 9:
        return FacetType::quad9;
      default:
        throw std::runtime_error(
            "Facets with " + std::to_string(closure.size())
            + " node(s) are not supported (element of degree "
            + std::to_string(e.degree())
            + "): use Lagrange of degree 1 or 2, or dolfinx_mortar.hex20().");
      }
    };
    facet.type = type();

    const Vector x0 = vertex(topology[2][f][0]);
    const Vector t0 = vertex(topology[2][f][1]) - x0;
    const Vector t1 = vertex(topology[2][f][2]) - x0;
    facet.midpoint = x0 + (t0 + t1) / (triangle ? 3 : 2);
    facet.outward = t0.cross(t1).dot(facet.midpoint - centre) > 0;

    const std::span<const double> nodes = node_coordinates(facet.type);
    for (int k = 0; k < num_nodes(facet.type); ++k)
    {
      auto is_node = [&](int dof)
      {
        double distance = 0;
        for (int c = 0; c < 3; ++c)
        {
          const double x
              = x0[c] + nodes[2 * k] * t0[c] + nodes[2 * k + 1] * t1[c];
          distance += std::abs(points[3 * dof + c] - x);
        }
        return distance < 1e-8;
      };
      const auto dof = std::ranges::find_if(closure, is_node);
      if (triangle != (num_corners(facet.type) == 3) or dof == closure.end())
      {
        throw std::runtime_error(
            "The dofs of the space are not values at the vertices and the "
            "midpoints of edges and facets: use Lagrange of degree 1 or 2, or "
            "dolfinx_mortar.hex20().");
      }
      facet.dofs.push_back(*dof);
    }
  }
  return facets;
}

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
  std::ranges::sort(sorted);
  sorted.erase(std::ranges::unique(sorted).begin(), sorted.end());
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
} // namespace
//-----------------------------------------------------------------------------
Surface dolfinx_mortar::create_surface(std::span<const SurfacePart> parts)
{
  if (parts.empty())
    throw std::runtime_error("A surface needs at least one part.");
  MPI_Comm comm = parts.front().V->mesh()->comm();

  // Local blocks of all bodies in one list, the owned ones first
  struct Body
  {
    const SurfacePart* part;
    std::int32_t first_owned, first_ghost; // in the list
  };
  std::map<std::int32_t, Body> bodies;
  for (const SurfacePart& part : parts)
    bodies.insert({part.first_block, {&part, 0, 0}});
  std::int32_t size = 0;
  std::vector<std::int64_t> numbers;
  std::vector<std::int32_t> origin;
  std::vector<double> X;
  std::vector<int> owners;
  std::string message;
  std::map<std::int32_t, std::vector<double>> coordinates;
  for (auto& [first, body] : bodies)
  {
    check_space(*body.part->V);
    coordinates[first] = body.part->V->tabulate_dof_coordinates(false);
    const auto& map = *body.part->V->dofmap()->index_map;
    if (body.part->block_numbers.size()
        != static_cast<std::size_t>(map.size_local() + map.num_ghosts()))
    {
      message = "Each local block of the function space needs a number.";
    }
  }
  throw_on_all(comm, message);
  auto append = [&](std::int32_t first, const Body& body, std::int32_t begin,
                    std::int32_t end)
  {
    const auto& n = body.part->block_numbers;
    const auto& x = coordinates[first];
    numbers.insert(numbers.end(), n.begin() + begin, n.begin() + end);
    X.insert(X.end(), x.begin() + 3 * begin, x.begin() + 3 * end);
    for (std::int32_t i = begin; i < end; ++i)
      origin.push_back(first + i);
    size += end - begin;
  };
  for (auto& [first, body] : bodies)
  {
    body.first_owned = size;
    append(first, body, 0, body.part->V->dofmap()->index_map->size_local());
  }
  const std::int32_t num_owned = size;
  for (auto& [first, body] : bodies)
  {
    const auto& map = *body.part->V->dofmap()->index_map;
    body.first_ghost = size;
    append(first, body, map.size_local(), map.size_local() + map.num_ghosts());
    owners.insert(owners.end(), map.owners().begin(), map.owners().end());
  }

  // Facets of all parts
  PartFacets all;
  for (const SurfacePart& part : parts)
  {
    const PartFacets f = part_facets(part);
    const Body& body = bodies.at(part.first_block);
    const std::int32_t owned = part.V->dofmap()->index_map->size_local();
    const std::int64_t local = f.types.size();
    std::int64_t global = 0;
    MPI_Allreduce(&local, &global, 1, MPI_INT64_T, MPI_SUM, comm);
    if (global == 0)
    {
      throw std::runtime_error("The " + part.name
                               + " has no facets on any rank: check the tag "
                                 "and the mesh's facet tags.");
    }
    all.types.insert(all.types.end(), f.types.begin(), f.types.end());
    all.orientation.insert(all.orientation.end(), f.orientation.begin(),
                           f.orientation.end());
    for (std::int32_t b : f.blocks)
    {
      all.blocks.push_back(b < owned ? body.first_owned + b
                                     : body.first_ghost + b - owned);
    }
  }

  Surface s = create_surface(comm, std::move(all.types), all.blocks,
                             std::move(all.orientation), numbers, num_owned,
                             owners, X);
  for (std::int32_t& b : s.local_blocks)
    b = origin[b];
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
//-----------------------------------------------------------------------------
