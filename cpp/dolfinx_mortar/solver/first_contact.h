// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "evaluation.h"
#include <Eigen/Dense>
#include <functional>
#include <optional>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Nodes in contact when the first solve starts.
struct InitialActive
{
  enum class Choice : std::int8_t
  {
    gap, ///< those that penetrate or touch, and those that hold a loose body
    none,
    all,
    given ///< those of `flags`
  };
  Choice choice = Choice::gap;

  /// Flags of the owned slave nodes at these positions, shape (3 n)
  std::function<std::vector<std::int8_t>(std::span<const double>)> flags;
};

/// Flags of the owned nodes, of each interface; empty for ties.
using NodeFlags = std::vector<std::vector<std::int8_t>>;

/// @brief States that the first solve begins with. Collective.
/// @param[in] coupling,step,state,evaluation State and what follows from it.
/// @param[in] choices Choice of each interface.
/// @param[in] force Residual forces without those of contact, zero at Dirichlet
/// dofs.
/// @return States of the owned nodes, of each interface.
std::vector<std::vector<Status>>
initial_status(const Coupling& coupling, const Step& step, const State& state,
               const Evaluation& evaluation,
               const std::vector<InitialActive>& choices,
               std::span<const double> force);

/// @brief Nodes that hold bodies which nothing else holds. Collective.
///
/// A body that nothing touches moves rigidly where its loads drive it. The
/// nodes that meet a master first on this way hold it, if they can: a pin with
/// clearance all around touches its bore on one side. Where loads drive no node
/// towards a master, or those that meet it first would let the body tilt, it is
/// the nodes that are nearest.
/// @param[in] coupling,step,state,evaluation,force See initial_status.
/// @return None where all bodies are held.
std::optional<NodeFlags> find_first_nodes(const Coupling& coupling,
                                          const Step& step, const State& state,
                                          const Evaluation& evaluation,
                                          std::span<const double> force);

/// @brief Motions of slaves relative to masters. Collective.
/// @param[in] coupling,evaluation Evaluated state.
/// @param[in] motions Motions of the owned displacement dofs, shape (n, number
/// of motions).
/// @return Means at the owned nodes of each interface, shape (3 num_owned,
/// number of motions); empty for ties.
std::vector<Eigen::MatrixXd> relative_motions(const Coupling& coupling,
                                              const Evaluation& evaluation,
                                              const Eigen::MatrixXd& motions);
} // namespace dolfinx_mortar
