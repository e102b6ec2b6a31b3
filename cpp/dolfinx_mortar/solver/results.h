// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "problem.h"

namespace dolfinx_mortar
{
/// @brief What follows from the last accepted state.
/// @throw std::runtime_error On all ranks, before the first solve.
const Evaluation& last_evaluation(const ContactProblem& problem);

/// @brief Nodal values of a result on the slave surface of an interface.
struct Field
{
  /// "multiplier", "traction", "recovered_traction" (see recover); of contacts
  /// also "pressure", "recovered_pressure", "gap", "status", "slip" and
  /// "tangential_traction"
  std::string name;

  /// Number of values at a node
  int columns;

  /// Displacement block of each node, among the local blocks of all bodies (see
  /// Layout::local_start); each once, those this rank owns
  std::vector<std::int32_t> nodes;

  /// Shape (nodes.size(), columns)
  std::vector<double> values;
};

/// @brief Results of an interface in the last accepted state. Collective.
///
/// Nodes that carry no multiplier have the mean of their facets' nodes that
/// have one, those at the middle of an edge that of its ends. Where several
/// slave nodes are at one displacement node, at an edge, pressure and status
/// are the largest, the gap is the smallest, slip that of the node with the
/// largest status, tractions are means.
/// @return Empty for contacts before the first solve.
std::vector<Field> results(const ContactProblem& problem,
                           std::size_t interface);

/// @brief λ_h at the nodes of each slave facet of this rank in the last
/// accepted state, see facet_multipliers of recovery.h. Collective.
/// @throw std::runtime_error On all ranks, before the first solve.
std::vector<double> facet_multipliers(const ContactProblem& problem,
                                      std::size_t interface);

/// @brief Forces and moments about the origin of an interface.
struct Resultants
{
  std::array<double, 3> slave_force, master_force, slave_moment, master_moment;
};

/// @brief Forces and moments of an interface in the last accepted state, with
/// the positions that it is integrated at. Collective.
/// @throw std::runtime_error On all ranks, before the first solve.
Resultants resultants(const ContactProblem& problem, std::size_t interface);

/// @brief Where the reference point of an interface's rigid tool is, with the
/// positions of `resultants`. Collective.
/// @throw std::invalid_argument The interface has no tool.
/// @throw std::runtime_error Before the first solve.
std::array<double, 3> tool_point(const ContactProblem& problem,
                                 std::size_t interface);

/// @brief Number of slave nodes, on all ranks, that carry a multiplier.
/// Collective.
std::int64_t num_multiplier_nodes(const ContactProblem& problem,
                                  std::size_t interface);
} // namespace dolfinx_mortar
