// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <cstdint>
#include <dolfinx/common/version.h>
#include <dolfinx/fem/CoordinateElement.h>
#include <dolfinx/fem/FiniteElement.h>
#include <dolfinx/fem/FunctionSpace.h>
#include <dolfinx/fem/utils.h>
#include <dolfinx/la/Vector.h>
#include <dolfinx/mesh/Mesh.h>
#include <memory>
#include <span>
#include <vector>

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

/// @brief Space of functions with three components, each of an element.
inline std::shared_ptr<dolfinx::fem::FunctionSpace<double>>
create_vector_space(std::shared_ptr<dolfinx::mesh::Mesh<double>> mesh,
                    const basix::FiniteElement<double>& element)
{
  namespace fem = dolfinx::fem;
  const std::vector<std::size_t> shape = {3};
#if DOLFINX_MORTAR_DOLFINX_AT_LEAST(0, 10)
  auto e = std::make_shared<const fem::FiniteElement<double>>(element, shape);
  return std::make_shared<fem::FunctionSpace<double>>(
      fem::create_functionspace<double>(mesh, e));
#else
  return std::make_shared<fem::FunctionSpace<double>>(
      fem::create_functionspace<double>(mesh, element, shape));
#endif
}

/// @brief Owned and ghost values of a vector.
inline std::span<double> values(dolfinx::la::Vector<double>& v)
{
  auto get = [](auto& w) -> std::span<double>
  {
    if constexpr (requires { w.mutable_array(); })
      return w.mutable_array();
    else
      return w.array();
  };
  return get(v);
}
} // namespace dolfinx_mortar::compat
