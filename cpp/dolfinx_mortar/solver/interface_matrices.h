// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "problem.h"
#include <cstdint>
#include <vector>

// Matrices of an interface, as a user may want them for work of his own. All
// functions are collective.

namespace dolfinx_mortar
{
/// @brief D or M of an interface (equations 3.5, 3.6), a contact's in the
/// present configuration; multiplier by displacement dofs.
/// @param[in] which 'D' or 'M'.
Matrix mortar_matrix(const ContactProblem& problem, std::size_t interface,
                     char which);

/// @brief T, or its inverse, of an interface; the identity off its slave nodes.
Matrix transformation(const ContactProblem& problem, std::size_t interface,
                      bool inverse);

/// @brief D⁻¹ = T D̃⁻¹ of an interface with dual multipliers; displacement by
/// multiplier dofs.
/// @throw std::runtime_error Multipliers are not dual, or a node on an edge
/// carries one for each of several patches.
Matrix inverse(const ContactProblem& problem, std::size_t interface);

/// @brief Constraints u_slave = Σ c u_master, row by row; what dolfinx_mpc's
/// `add_constraint` takes.
struct Constraints
{
  /// Slave dofs of this rank, local numbers, ascending
  std::vector<std::int32_t> slaves;

  /// Master dofs, global numbers; those of `slaves[i]` are
  /// `masters[offsets[i]:offsets[i + 1]]`
  std::vector<std::int64_t> masters;

  /// Coefficient and owning rank of each master dof
  std::vector<double> coefficients;
  std::vector<std::int32_t> owners;

  std::vector<std::int32_t> offsets = {0};
};

/// @brief A tie as constraints. Dofs are those of the coupled problem, the
/// numbers DOLFINx has in a problem with one body.
///
/// Masters are dofs of the master surface, and slave nodes that carry no
/// multiplier themselves.
/// @throw std::runtime_error See inverse.
Constraints constraints(const ContactProblem& problem, std::size_t interface);
} // namespace dolfinx_mortar
