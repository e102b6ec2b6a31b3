// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <dolfinx_mortar/assembly/interface.h>
#include <span>
#include <vector>

namespace dolfinx_mortar
{
/// @brief The multiplier as a continuous field of first order on the slave
/// surface. Collective.
///
/// Its values at corners are averages of λ_h with the (bi)linear functions ψ_c
/// of the corners,
///
///     λ̄_c = ∫ ψ_c λ_h dγ / ∫ ψ_c dγ,
///
/// the L² projection with a lumped mass matrix; it is (bi)linear between them.
/// Kinks of a coarse master and the dual functions' changes of sign even out,
/// whatever the multiplier space, and since Σ ψ_c = 1 its integral over the
/// slave surface is that of λ_h, the force.
/// @param[in] interface Interface.
/// @param[in] basis Which nodes carry multipliers, and the basis there.
/// @param[in] configuration Positions, normals and candidate pairs.
/// @param[in] z Multipliers of the local slave nodes, shape (n, 3).
/// @return Values at the local slave nodes, shape (n, 3).
std::vector<double> recover(const Interface& interface, const Basis& basis,
                            const Configuration& configuration,
                            std::span<const double> z);

/// @brief The multiplier λ_h = Σ_j Φ_j z_j itself, facet by facet. Collective.
///
/// On a facet it is Σ_k N_k λ_h(x_k) with the values at the facet's nodes,
/// and has no meaning beyond the part of it that masters cover. Dual functions
/// jump from facet to facet and change their sign, and so does λ_h: it shows
/// what the multiplier space holds, not what the pressure is.
/// @param[in] interface,basis,configuration,z See recover.
/// @return Values at the nodes of all facets, in the order of Surface::nodes,
/// shape (Surface::nodes.size(), 3); zero on facets that no master covers.
std::vector<double> facet_multipliers(const Interface& interface,
                                      const Basis& basis,
                                      const Configuration& configuration,
                                      std::span<const double> z);
} // namespace dolfinx_mortar
