// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "failure.h"
#include "checks.h"
#include "messages.h"
#include "rigid_motions.h"
#include <algorithm>
#include <dolfinx_mortar/common/error.h>

using namespace dolfinx_mortar;

namespace
{
std::string barely_covered(const Coupling& coupling, const Step& step,
                           const State& state, const Evaluation& evaluation)
{
  const auto node = find_barely_covered(coupling, step, state, evaluation);
  return node ? " "
                    + messages::barely_covered(
                        coupling.interfaces[node->second], node->first)
              : "";
}

std::string barely_covered(const FailedSolve& solve)
{
  return any(solve.coupling.comm(), !solve.iteration)
             ? ""
             : barely_covered(solve.coupling, solve.step, solve.state,
                              solve.iteration->interfaces);
}

/// What is behind a failure; empty where nothing is known. Collective.
std::string find_cause(const FailedSolve& solve)
{
  const Coupling& coupling = solve.coupling;
  if (slides_away(coupling, solve.step, solve.history))
    return messages::sliding();
  const std::size_t last = std::min<std::size_t>(solve.history.size(), 5);
  const bool lost = std::any_of(solve.history.end() - last, solve.history.end(),
                                [](auto& i) { return i.active == 0; });
  if (lost and coupling.has_contact() and !is_held(coupling))
    return messages::not_held();
  if (!any(coupling.comm(), !solve.iteration))
  {
    const auto node
        = find_blocked(coupling, solve.step, solve.iteration->interfaces);
    if (node)
      return messages::blocked(*node);
  }
  if (!solve.state.started and solve.start_overlap > 0.5)
    return messages::start_overlap(solve.start_overlap);
  return "";
}
} // namespace

//-----------------------------------------------------------------------------
bool dolfinx_mortar::slides_away(const Coupling& coupling, const Step& step,
                                 const History& history)
{
  bool frictional = coupling.has_contact();
  for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
  {
    frictional = frictional
                 and (coupling.interfaces[i].is_tie() or step.is_frictional(i));
  }
  return frictional and ends_slipping(history) and !is_held(coupling);
}
//-----------------------------------------------------------------------------
std::string dolfinx_mortar::explain(const FailedSolve& solve,
                                    SNESConvergedReason reason)
{
  const Coupling& coupling = solve.coupling;
  if (solve.history.empty())
  {
    std::string why = "The residual is too large.";
    if (!any(coupling.comm(), !solve.iteration))
    {
      const std::string infinite = explain_infinite(
          coupling, solve.step, solve.state, *solve.iteration);
      why = infinite.empty() ? why : infinite;
    }
    return messages::not_begun(reason) + " " + why + messages::smaller_steps;
  }
  std::string text
      = messages::not_converged(reason, solve.history, coupling.has_contact());
  const std::string cause = find_cause(solve);
  if (!cause.empty())
    return text + " " + cause;
  if (!solve.shortened.empty())
    text += " The last step had to be shortened: " + solve.shortened;
  return text + barely_covered(solve) + messages::smaller_steps;
}
//-----------------------------------------------------------------------------
std::string dolfinx_mortar::explain(const FailedSolve& solve,
                                    const std::string& message, bool complete)
{
  std::string cause = find_cause(solve);
  if (cause.empty())
  {
    // Collective, while the message may be that of one rank
    const std::string cover = barely_covered(solve);
    // Systems of iterates that have gone astray may be singular
    const bool astray = solve.history.size() > 2
                        and message.find("load step") == std::string::npos;
    if (!message.empty())
    {
      cause = message + (complete and !astray ? "" : messages::smaller_steps)
              + cover;
    }
  }
  return cause.empty()
             ? ""
             : "The solve failed in Newton iteration "
                   + std::to_string(solve.history.size()) + ". " + cause;
}
//-----------------------------------------------------------------------------
std::string dolfinx_mortar::explain_infinite(const Coupling& coupling,
                                             const Step& step,
                                             const State& state,
                                             const Iteration& iteration)
{
  const std::optional<Infinite> found
      = find_infinite(coupling, iteration.residual);
  if (!found)
    return "";
  if (found->kind == Infinite::Kind::force)
  {
    const std::string cover
        = barely_covered(coupling, step, state, iteration.interfaces);
    if (!cover.empty())
      return messages::infinite_force(found->x) + "." + cover;
  }
  return messages::infinite(*found);
}
