// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <cstdint>
#include <vector>

namespace dolfinx_mortar
{
/// @brief What is known of an iterate of Newton's method.
struct Iterate
{
  int iteration = 0;

  /// Norm of the residual force, relative to the forces at work, and absolute
  double force = 0, residual = 0;

  /// Largest violation of a constraint, relative to displacements or tractions
  double constraint = 0;

  /// Largest distance to a prescribed displacement, relative to displacements
  double prescribed = 0;

  /// Numbers of nodes in contact, and of those that changed their state
  std::int64_t active = 0, stick = 0, slip = 0, changes = 0;

  /// Length of the step that led here, relative to Newton's
  double step = 0;

  /// The active sets have been found to cycle
  bool cycle = false;
};

using History = std::vector<Iterate>;

/// @brief Whether an iteration looks like that of a body that slides away: it
/// ends with all nodes slipping, before contact may be lost altogether.
bool ends_slipping(const History& history);

/// @brief All nodes have slipped for four iterations, and the residual does not
/// fall.
bool stagnates(const History& history);
} // namespace dolfinx_mortar
