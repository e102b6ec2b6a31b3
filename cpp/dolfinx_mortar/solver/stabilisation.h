// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "evaluation.h"
#include "iteration.h"
#include <span>
#include <vector>

namespace dolfinx_mortar
{
/// @brief What the springs did that were the last ones of a solve.
struct Stabilisation
{
  /// Norm of their forces relative to that of the forces at work, reactions and
  /// contact forces
  double force = 0;

  /// Energy in them, and that relative to the work of contact forces on the way
  /// from the beginning of the step
  double energy = 0, energy_share = 0;
};

/// Share of the forces at work, and of the work, from which on springs count.
constexpr double negligible_stabilisation = 1e-3;

/// @brief Factors of the springs, one solution after the other.
constexpr double stabilisation_stages[]
    = {1, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6};

/// @brief Springs at the nodes of bodies that neither Dirichlet conditions nor
/// ties hold, of the stiffness of the nodes themselves, and at the unknowns of
/// loaded tools, of the stiffness of the slave nodes that they may meet; zero
/// at others. Collective.
///
/// Of the twelve dofs of the frame of such a tool the last six, which are not
/// unknowns, have springs too: the tangent tells which motions are resisted.
/// @param[in] coupling Interfaces.
/// @param[in] u Owned displacements.
/// @param[in] stiffness Diagonal of the tangent.
std::vector<double> create_springs(const Coupling& coupling,
                                   std::span<const double> u,
                                   std::span<const double> stiffness);

/// @brief Measure what the springs of a step do in a solution. Collective.
/// @param[in] coupling,step,solution Interfaces, and what follows from
/// unknowns.
/// @param[in] unknowns Owned unknowns, see Bodies::unknowns.
Stabilisation measure_stabilisation(const Coupling& coupling, const Step& step,
                                    const Evaluation& solution,
                                    std::span<const double> unknowns);

/// @brief Refuse to stabilise where there is nothing to. Collective.
/// @throw std::invalid_argument See create_springs.
void check_loose(const Coupling& coupling);
} // namespace dolfinx_mortar
