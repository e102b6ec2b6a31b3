// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "evaluation.h"
#include <array>
#include <dolfinx_mortar/surface/triangles.h>
#include <optional>
#include <vector>

// States that solve the equations, but cannot be meant, and what may be behind
// a failure. The search for master facets ends at a certain distance, and a
// prescribed displacement leaves contact nothing to decide: Newton's iteration
// sees none of this. All that is here returns data, the same on all ranks;
// messages.h has the words.

namespace dolfinx_mortar
{
/// A value and the place that it is from.
struct Located
{
  double value;
  std::array<double, 3> x;
};

/// @brief Gaps of the owned nodes [length] as results show them: the mean
/// gap around where the master is far, since negative parts of multiplier
/// functions would show a penetration there that does not exist; zero without a
/// multiplier.
/// @param[in] status States of the owned nodes.
std::vector<double> shown_gaps(const CoupledInterface& c, const Basis& basis,
                               const InterfaceEvaluation& evaluation,
                               std::span<const Status> status);

/// @brief Deepest overlap at the nodes that carry a multiplier, in facet sizes,
/// in the geometry that a solve begins with. Collective.
double largest_overlap(const Coupling& coupling, const Step& step,
                       const State& state);

/// @brief The slave facet that is deepest inside a master body, where the
/// search finds no facet (see find_overlap); depth zero where there is none.
/// Collective.
/// @param[in] i Contact.
/// @param[in] geometry Its geometry.
/// @param[in] u Displacements of the local blocks.
Depth find_deep_facet(const Coupling& coupling, std::size_t i,
                      const InterfaceGeometry& geometry,
                      const std::vector<double>& u);

/// @brief Where the surfaces of a contact have passed through each other on the
/// way from `before` to `after` (see find_crossing); depth zero where they have
/// not. Collective.
/// @param[in] before,after Displacements of the local blocks.
Depth find_passage(const Coupling& coupling, std::size_t i,
                   const std::vector<double>& before,
                   const std::vector<double>& after);

/// @brief The slave node that Dirichlet conditions hold deepest inside a
/// master, and its gap [length] there. Collective.
std::optional<Located> find_blocked(const Coupling& coupling, const Step& step,
                                    const Evaluation& evaluation);

/// @brief The slave facet that loses the largest share of its area to masters
/// that are too steep, if that is more than slivers take. Collective.
///
/// Only for facets of ties, and facets of contacts that a master is near of.
std::optional<Located> find_lost(const CoupledInterface& c,
                                 const InterfaceGeometry& geometry);

/// @brief The slave node with a multiplier that masters cover least, if they
/// hardly cover it; its covered share, and its interface. Collective.
std::optional<std::pair<Located, std::size_t>>
find_barely_covered(const Coupling& coupling, const Step& step,
                    const State& state, const Evaluation& evaluation);

/// A part of a residual that is not a finite number.
struct Infinite
{
  enum class Kind
  {
    prescribed, // displacement
    traction,
    force
  };
  Kind kind;

  /// Where a force is not finite
  std::array<double, 3> x;
};

/// @brief What of a residual is not finite. Collective.
/// @param[in] residual See Iteration.
std::optional<Infinite> find_infinite(const Coupling& coupling,
                                      std::span<const double> residual);
} // namespace dolfinx_mortar
