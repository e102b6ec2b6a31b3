// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "history.h"
#include "iteration.h"
#include <petscsnes.h>
#include <string>

// Why a solve failed, in words: checks of where it ended, put together. Nothing
// here changes anything.

namespace dolfinx_mortar
{
/// @brief A solve that failed, and where it ended.
struct FailedSolve
{
  const Coupling& coupling;
  const Step& step;
  const State& state;
  const History& history;

  /// The last iterate; null where nothing is known of it
  const Iteration* iteration;

  /// See largest_overlap; 0 but in the first solve
  double start_overlap;

  /// Why the last step was shortened; empty where it was not
  std::string shortened;
};

/// @brief Whether friction alone holds bodies, and the iteration ends with all
/// nodes slipping. Collective.
bool slides_away(const Coupling& coupling, const Step& step,
                 const History& history);

/// @brief Say why the iteration ended without a solution. Collective.
/// @param[in] reason PETSc's reason.
std::string explain(const FailedSolve& solve, SNESConvergedReason reason);

/// @brief Say why an error ended the iteration. Collective.
/// @param[in] message The error; empty on ranks that have none.
/// @param[in] complete It names the cause and the cure already.
/// @return Empty on ranks that have no error and know of no cause.
std::string explain(const FailedSolve& solve, const std::string& message,
                    bool complete);

/// @brief Say where the residual of an iterate is not finite; empty where it
/// is. Collective.
std::string explain_infinite(const Coupling& coupling, const Step& step,
                             const State& state, const Iteration& iteration);
} // namespace dolfinx_mortar
