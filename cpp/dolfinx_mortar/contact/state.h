// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "laws.h"
#include <dolfinx_mortar/assembly/interface.h>
#include <vector>

namespace dolfinx_mortar
{
/// @brief What an interface remembers from one solve to the next; a value.
///
/// Arrays of nodes are over the owned slave nodes. Those below `basis` are of
/// contacts only, and empty before the first solve.
struct InterfaceState
{
  /// Nodes that carry multipliers, and the basis there
  Basis basis;

  /// State of each node, shape (n)
  std::vector<Status> status;

  /// Slip [length] since contact began, shape (n, 3)
  std::vector<double> slip;

  /// Complementarity parameters [traction per weighted gap], and scale of the
  /// tangential equations [traction] where no traction gives one, shape (n)
  std::vector<double> c_n, c_t, scale;

  /// Energy that friction took in the last step, of this rank's nodes
  double dissipation = 0;

  bool operator==(const InterfaceState&) const = default;
};

/// @brief State of a coupled problem: the one thing that a solve changes.
///
/// A failed step leaves it as it is; to go back is to copy it.
struct State
{
  /// True after the first accepted step
  bool started = false;

  /// Displacements of the owned dofs in the last accepted configuration, empty
  /// before there is one
  std::vector<double> u;

  /// Multipliers of the owned slave nodes of one interface after the other
  std::vector<double> z;

  /// Of each interface
  std::vector<InterfaceState> interfaces;

  bool operator==(const State&) const = default;
};
} // namespace dolfinx_mortar
