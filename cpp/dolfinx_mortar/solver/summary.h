// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "problem.h"
#include <array>
#include <cstdint>
#include <vector>

namespace dolfinx_mortar
{
/// @brief A contact in numbers, in the last accepted state.
struct Summary
{
  /// Resultant of the contact forces on the slave
  std::array<double, 3> force = {0, 0, 0};

  /// Where the pressure acts: mean position of the slave nodes, weighted with
  /// their normal forces; zero without any
  std::array<double, 3> centre = {0, 0, 0};

  /// Area that belongs to the nodes in contact (∫ Φ_j), and mean pressure there
  double area = 0, mean_pressure = 0;

  /// Largest nodal pressure
  double largest_pressure = 0;

  /// Deepest overlap [length] at the integration points of facets with a node
  /// in contact, an offset counted in; with reference geometry, whose points do
  /// not move, that of the nodes in contact, as averages around them
  double penetration = 0;

  /// Nodes with a multiplier by their state; those in contact without friction
  /// are in `slip`
  std::int64_t open = 0, stick = 0, slip = 0;

  /// Energy that friction took in the last step
  double dissipation = 0;
};

/// @brief Sum up a contact. Collective.
/// @throw std::runtime_error On all ranks, before the first solve.
/// @throw std::invalid_argument The interface is a tie.
Summary summarise(const ContactProblem& problem, std::size_t interface);

/// @brief Forces of an interface at the owned displacement nodes of all bodies:
/// -Dᵀz at those of the slave, Mᵀz at those of the master; shape (size of the
/// layout). Collective.
/// @throw std::runtime_error On all ranks, before the first solve.
std::vector<double> nodal_forces(const ContactProblem& problem,
                                 std::size_t interface);

/// @brief Forces that hold the bodies against everything else, Dirichlet
/// conditions' reactions, in the last accepted state: residual and forces of
/// all interfaces; zero, to the tolerance of the solver, where a dof is free.
/// Shape (size of the layout). Collective.
/// @throw std::runtime_error On all ranks, before the first solve.
std::vector<double> reactions(const ContactProblem& problem);
} // namespace dolfinx_mortar
