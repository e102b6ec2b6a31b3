// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <cstdint>
#include <dolfinx/common/IndexMap.h>
#include <dolfinx/fem/FunctionSpace.h>
#include <dolfinx/mesh/MeshTags.h>
#include <dolfinx_mortar/surface/surface.h>
#include <functional>
#include <span>
#include <string>
#include <vector>

// The bridge from DOLFINx to surfaces: with compat.h the only part of the
// library that knows DOLFINx.

namespace dolfinx_mortar
{
/// @brief Number the displacement blocks of several bodies in one vector, the
/// part of each rank being [body 0 owned, body 1 owned, ...]. Collective.
///
/// Two bodies with 3 + 2 blocks on rank 0 and 1 + 2 blocks on rank 1:
///
///     rank                 0                 1
///     body       0  0  0  1  1      0  1  1
///     number     0  1  2  3  4      5  6  7
///
/// @param[in] maps Index map of the blocks of each body; all distributed over
/// the same ranks.
/// @return For each body, the number of each local (owned and ghost) block.
std::vector<std::vector<std::int64_t>> number_blocks(
    const std::vector<std::reference_wrapper<const dolfinx::common::IndexMap>>&
        maps);

/// @brief Refuse a space that is none of displacements, see create_surface.
/// @throw std::runtime_error It is.
void check_displacements(const dolfinx::fem::FunctionSpace<double>& V);

/// @brief Facets of one body, as a part of a surface.
struct SurfacePart
{
  /// Displacement space
  const dolfinx::fem::FunctionSpace<double>* V;

  /// Local indices of facets
  std::vector<std::int32_t> facets;

  /// Number of each local block of the space, see number_blocks
  std::span<const std::int64_t> block_numbers;

  /// Where the local blocks of the space begin in the array of displacements
  /// that current_positions takes; different for different bodies
  std::int32_t first_block;

  /// What to call the part in messages, "slave surface (facet tag 3)"
  std::string name;
};

/// @brief Tagged facets as a part of a surface.
/// @param[in] V,block_numbers,first_block See SurfacePart.
/// @param[in] tags Tags of facets of the mesh of `V`.
/// @param[in] tag Value of the tag.
/// @param[in] side "slave" or "master", for messages.
SurfacePart tagged_part(const dolfinx::fem::FunctionSpace<double>& V,
                        const dolfinx::mesh::MeshTags<std::int32_t>& tags,
                        std::int32_t tag, const std::string& side,
                        std::span<const std::int64_t> block_numbers,
                        std::int32_t first_block);

/// @brief A surface that lies on several bodies. Collective.
/// @throw std::runtime_error On all ranks, see below.
Surface create_surface(std::span<const SurfacePart> parts);

/// @brief The surface that a displacement space has on some facets. Collective.
///
/// Displacement spaces are blocked spaces with three components in three
/// dimensions, of Lagrange elements of degree 1 or 2 on tetrahedra or
/// hexahedra, or of custom elements with the same nodes (the nodal serendipity
/// element with 20 nodes). The geometry may be of any degree: nodes of the
/// surface lie where the geometry is at the points of the space's dofs.
///
/// @param[in] V Displacement space.
/// @param[in] facets Local indices of facets. Facets of cells that another rank
/// owns are left to that rank, so each rank may name all facets that it knows.
/// @param[in] block_numbers Number of each local block of the space, see
/// number_blocks.
/// @param[in] name What to call the surface in messages, "slave surface (facet
/// tag 3)".
/// @throw std::runtime_error On all ranks, where the space is none of the
/// above, there are no facets, a facet is inside the mesh or has no area.
Surface create_surface(const dolfinx::fem::FunctionSpace<double>& V,
                       std::span<const std::int32_t> facets,
                       std::span<const std::int64_t> block_numbers,
                       const std::string& name = "surface");

/// @brief The surface that a displacement space has on tagged facets.
/// Collective.
/// @param[in] V,block_numbers See above.
/// @param[in] tags Tags of facets of the mesh of `V`.
/// @param[in] tag Value of the tag.
/// @param[in] side "slave" or "master", for messages.
/// @throw std::runtime_error As above.
Surface create_surface(const dolfinx::fem::FunctionSpace<double>& V,
                       const dolfinx::mesh::MeshTags<std::int32_t>& tags,
                       std::int32_t tag, const std::string& side,
                       std::span<const std::int64_t> block_numbers);
} // namespace dolfinx_mortar
