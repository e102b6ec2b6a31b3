// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "history.h"
#include "iteration.h"
#include <dolfinx_mortar/contact/active_sets.h>
#include <optional>

// What Newton's iteration is judged by: forces, constraints and prescribed
// displacements, each relative to what they are made of, and active sets.

namespace dolfinx_mortar
{
/// @brief Forces that residuals are compared with, if those at work are
/// smaller.
struct ForceReference
{
  /// Norm of the residual forces that the iteration starts with
  std::optional<double> first_residual;

  /// Round-off of stiffness times displacement; see force_floor
  double floor = 0;
};

/// @brief Size below which residual forces are round-off. Collective.
///
/// Displacements that leave no strain still have the round-off of a deformation
/// gradient; those far beyond the bodies' size are a body's that moves away,
/// and do not count.
/// @param[in] layout Displacement dofs of the bodies.
/// @param[in] K Tangent of the bodies.
/// @param[in] x Owned displacements.
double force_floor(const Layout& layout, Mat K, std::span<const double> x);

/// @brief Measures of an iterate: residuals and numbers of nodes in contact.
/// Collective.
/// @param[in] coupling,step,state What does not change in a solve.
/// @param[in] iteration The iterate.
/// @param[in,out] reference Its first residual is set, if it is not yet.
/// @param[in,out] sets Active sets of the iterates so far.
Iterate measure(const Coupling& coupling, const Step& step, const State& state,
                const Iteration& iteration, ForceReference& reference,
                ActiveSets& sets);

/// @brief Whether the last change of active sets is of nodes that have neither
/// gap nor traction: round-off alone changes their states, and either
/// state solves the problem. Collective.
/// @param[in] rtol Relative tolerance of the iteration.
bool is_undecided(const Coupling& coupling, const Step& step,
                  const State& state, const Evaluation& evaluation,
                  const ActiveSets& sets, double rtol);
} // namespace dolfinx_mortar
