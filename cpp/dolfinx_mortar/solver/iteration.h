// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "evaluation.h"
#include <dolfinx_mortar/dolfinx/bodies.h>
#include <span>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Everything that follows from unknowns and multipliers.
struct Iteration
{
  /// Of the interfaces
  Evaluation interfaces;

  /// Residual [forces, constraints], forces as reduce_forces has them; at
  /// Dirichlet dofs the distance to the
  /// prescribed displacement
  std::vector<double> residual;

  /// Residual forces without those of contact, zero at Dirichlet dofs; those of
  /// loaded tools at the nodes of their frames
  std::vector<double> free_forces;

  /// Size of the forces at work: reactions and contact forces
  double force_scale = 0;
};

/// @brief Evaluate bodies and interfaces. Collective.
/// @param[in,out] bodies Their displacements are set.
/// @param[in] coupling,step,state What does not change in a solve.
/// @param[in] x Unknowns (see Bodies::unknowns) and multipliers of the owned
/// dofs.
Iteration evaluate(Bodies& bodies, const Coupling& coupling, const Step& step,
                   const State& state, std::span<const double> x);
} // namespace dolfinx_mortar
