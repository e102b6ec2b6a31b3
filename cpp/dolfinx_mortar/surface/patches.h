// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "surface.h"
#include <cstdint>
#include <span>

namespace dolfinx_mortar
{
/// @brief Split the nodes of a surface at its edges. Collective.
///
/// Two facets that meet at a node are on the same smooth patch there if the
/// angle between their unit normals at the node, in the reference
/// configuration, is below `feature_angle`, or if a chain of such facets leads
/// from one to the other. A node where several patches meet becomes as many
/// nodes of the surface, one for each patch, with the same displacement block:
/// each gets the averaged normal, the weighted gap and the multiplier of its
/// own patch.
///
///     bottom of a block  ____k____          ____k k'
///     and its side                |    ->          |
///                                 |                |
///
/// The nodes of one block are consecutive, in an order that depends on their
/// normals but not on the partition.
///
/// @param[in] s Surface.
/// @param[in] feature_angle Angle between facets from which on they meet at an
/// edge [rad]; none do from π on.
/// @return Surface with the facets of `s`, in their order.
Surface split_at_edges(const Surface& s, double feature_angle);

/// @brief Whether all smooth patches of a surface are plane, as the sides of a
/// box are: no facet is curved, and facets that meet at a node of a patch have
/// the same normal, to 1e-3 rad, in the reference configuration. Collective.
/// @param[in] s Surface.
/// @param[in] feature_angle See split_at_edges.
bool has_plane_patches(const Surface& s, double feature_angle);

/// @brief Let the owned nodes of one block have the largest of their values.
///
/// What is a property of the displacement node, as the basis transformation,
/// must not differ between the patches that meet there.
/// @param[in] s Surface.
/// @param[in,out] values Value of each local node, shape (n); those of ghosts
/// are left as they are.
void share_largest(const Surface& s, std::span<std::int32_t> values);
} // namespace dolfinx_mortar
