// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <cstdint>
#include <dolfinx/common/version.h>
#include <dolfinx/fem/CoordinateElement.h>
#include <dolfinx/mesh/Mesh.h>
#include <span>

#define DOLFINX_MORTAR_DOLFINX_AT_LEAST(major, minor)                          \
  (DOLFINX_VERSION_MAJOR > major                                               \
   || (DOLFINX_VERSION_MAJOR == major && DOLFINX_VERSION_MINOR >= minor))

/// @brief What differs between the versions of DOLFINx; nothing outside this
/// file asks for the version.
namespace dolfinx_mortar::compat
{
/// @brief The map from the reference cell to cells, of a mesh with one type of
/// cells.
inline const dolfinx::fem::CoordinateElement<double>&
coordinate_element(const dolfinx::mesh::Mesh<double>& mesh)
{
#if DOLFINX_MORTAR_DOLFINX_AT_LEAST(0, 10)
  return mesh.geometry().cmaps().front();
#else
  return mesh.geometry().cmap();
#endif
}

/// @brief Geometry nodes of a cell, of a mesh with one type of cells.
inline std::span<const std::int32_t>
geometry_nodes(const dolfinx::mesh::Mesh<double>& mesh, std::int32_t cell)
{
#if DOLFINX_MORTAR_DOLFINX_AT_LEAST(0, 11)
  const auto dofmap = mesh.geometry().dofmaps().front();
#else
  const auto dofmap = mesh.geometry().dofmap();
#endif
  const std::size_t n = dofmap.extent(1);
  return std::span<const std::int32_t>(dofmap.data_handle() + n * cell, n);
}
} // namespace dolfinx_mortar::compat
