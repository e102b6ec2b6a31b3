// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "checks.h"
#include "history.h"
#include "stabilisation.h"
#include <dolfinx_mortar/dolfinx/bodies.h>
#include <petscsnes.h>
#include <string>

// What is said of a solve: sentences made of data, and nothing else. Each ends
// with a full stop, and names the cure where there is one.

namespace dolfinx_mortar::messages
{
/// The cure that is always worth a try
inline constexpr const char* smaller_steps
    = " Take smaller load steps, or let solve(adaptive=...) cut them; the "
      "state is as before the step.";

/// A position, "(0.25, 1, -3)".
std::string point(const std::array<double, 3>& x);

std::string deep_facet(const Depth& depth);
std::string passage(const Depth& depth);
std::string inverted(const Bodies::Inverted& cells);
std::string blocked(const Located& node);
std::string lost(const CoupledInterface& c, const Located& facet);
std::string barely_covered(const CoupledInterface& c, const Located& node);
std::string start_overlap(double depth);
std::string sliding();
std::string stabilised(const Stabilisation& springs);

/// What is added to an error of a solve that converged with stronger springs.
/// @param[in] stage Factor of the springs with which it did not.
std::string with_springs(double stage);

/// What is added to an error of a solve that fails with the first springs.
std::string stiffer_springs();

/// Beginning of a sentence, without its full stop.
std::string infinite_force(const std::array<double, 3>& x);
std::string infinite(const Infinite& what);
std::string not_held();

/// What became of an iteration that ended without a solution.
/// @param[in] reason PETSc's reason.
/// @param[in] history The iteration; not empty.
/// @param[in] has_contact Some interface is a contact.
std::string not_converged(SNESConvergedReason reason, const History& history,
                          bool has_contact);

/// The same, of one that did not begin.
std::string not_begun(SNESConvergedReason reason);
} // namespace dolfinx_mortar::messages
