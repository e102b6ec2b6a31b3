// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "reference_facets.h"
#include <Eigen/Dense>
#include <algorithm>
#include <basix/cell.h>
#include <dolfinx/mesh/Mesh.h>
#include <dolfinx/mesh/cell_types.h>
#include <span>
#include <stdexcept>
#include <string>

using namespace dolfinx_mortar;

namespace
{
using Vector = Eigen::Vector3d;

const char* const advice
    = "use Lagrange of degree 1 or 2, or dolfinx_mortar.hex20().";

/// Type of the facets of an element that have some number of dofs.
FacetType facet_type(const basix::FiniteElement<double>& e,
                     std::size_t num_dofs)
{
  switch (num_dofs)
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
    throw std::runtime_error("Facets with " + std::to_string(num_dofs)
                             + " node(s) are not supported (element of degree "
                             + std::to_string(e.degree()) + "): " + advice);
  }
}

[[noreturn]] void throw_not_at_nodes()
{
  throw std::runtime_error(
      std::string("The dofs of the space are not values at the vertices and "
                  "the midpoints of edges and facets: ")
      + advice);
}

/// Dofs of a facet in the order of its nodes.
/// @param[in] x0,t0,t1 First corner of the facet and edges from there.
/// @param[in] closure Dofs of the cell on the facet, in any order.
std::vector<int> dofs_at_nodes(const basix::FiniteElement<double>& e,
                               FacetType type, const Vector& x0,
                               const Vector& t0, const Vector& t1,
                               const std::vector<int>& closure)
{
  const std::vector<double>& points = e.points().first;
  const std::span<const double> nodes = node_coordinates(type);
  std::vector<int> dofs;
  for (int k = 0; k < num_nodes(type); ++k)
  {
    const Vector x = x0 + nodes[2 * k] * t0 + nodes[2 * k + 1] * t1;
    auto is_node = [&](int dof)
    {
      const Eigen::Map<const Vector> point(points.data() + 3 * dof);
      return (point - x).lpNorm<1>() < 1e-8;
    };
    const auto dof = std::ranges::find_if(closure, is_node);
    if (dof == closure.end())
      throw_not_at_nodes();
    dofs.push_back(*dof);
  }
  return dofs;
}
} // namespace

//-----------------------------------------------------------------------------
const basix::FiniteElement<double>&
dolfinx_mortar::check_space(const dolfinx::fem::FunctionSpace<double>& V)
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
//-----------------------------------------------------------------------------
std::vector<ReferenceFacet>
dolfinx_mortar::reference_facets(const basix::FiniteElement<double>& e)
{
  const auto topology = basix::cell::topology(e.cell_type());
  const std::vector<double> geometry
      = basix::cell::geometry<double>(e.cell_type()).first;
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
    facet.type = facet_type(e, closure.size());
    if (triangle != (num_corners(facet.type) == 3))
      throw_not_at_nodes();

    const Vector x0 = vertex(topology[2][f][0]);
    const Vector t0 = vertex(topology[2][f][1]) - x0;
    const Vector t1 = vertex(topology[2][f][2]) - x0;
    facet.midpoint = x0 + (t0 + t1) / (triangle ? 3 : 2);
    facet.outward = t0.cross(t1).dot(facet.midpoint - centre) > 0;
    facet.dofs = dofs_at_nodes(e, facet.type, x0, t0, t1, closure);
  }
  return facets;
}
