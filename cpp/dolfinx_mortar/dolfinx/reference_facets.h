// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <Eigen/Core>
#include <basix/finite-element.h>
#include <dolfinx/fem/FunctionSpace.h>
#include <dolfinx_mortar/geometry/facet.h>
#include <vector>

namespace dolfinx_mortar
{
/// @brief A facet of the reference cell.
struct ReferenceFacet
{
  FacetType type;

  /// Dofs of the cell at the nodes of the facet, in the order of facet.h
  std::vector<int> dofs;

  Eigen::Vector3d midpoint;

  /// Tangents x,ξ₁ × x,ξ₂ point out of the reference cell
  bool outward;
};

/// @brief Check that nodes and values of a space are those of a displacement.
/// @return Basix element of a component.
/// @throw std::runtime_error They are not.
const basix::FiniteElement<double>&
check_space(const dolfinx::fem::FunctionSpace<double>& V);

/// @brief Facets of the reference cell with their dofs, found by position: this
/// is independent of how an element numbers its dofs.
/// @throw std::runtime_error The dofs are not at the nodes of any FacetType.
std::vector<ReferenceFacet>
reference_facets(const basix::FiniteElement<double>& e);
} // namespace dolfinx_mortar
