// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "surface.h"
#include <array>
#include <cstdint>
#include <dolfinx_mortar/geometry/rigid_shape.h>
#include <optional>
#include <span>
#include <vector>

namespace dolfinx_mortar
{
/// @brief The frame that a rigid tool moves with, see RigidShape.
struct Frame
{
  /// Displacement blocks (numbers in the coupled problem) of its four nodes
  std::array<std::int64_t, 4> blocks;

  /// Their current positions, shape (4, 3)
  std::array<double, 12> x;

  /// Analytic surface of the tool; none where it has facets
  std::optional<RigidShape> shape;
};

/// @brief Facets that carry the positions of their nodes with them, as they
/// travel between ranks.
struct FacetList
{
  /// Type of each facet
  std::vector<FacetType> types;

  /// +1 where x,ξ₁ × x,ξ₂ points out of the body, -1 where it points into it
  std::vector<std::int8_t> orientation;

  /// Nodes of facet `f` are the entries `offsets[f]` to `offsets[f + 1]` of
  /// `blocks` and `x`
  std::vector<std::int32_t> offsets = {0};

  /// Displacement block (number in the coupled problem) of each node
  std::vector<std::int64_t> blocks;

  /// Current position of each node, shape (offsets.back(), 3)
  std::vector<double> x;

  /// What the nodes move with, where the facets are those of a rigid tool:
  /// forces and derivatives are those of the frame then. A tool with a shape
  /// has no facets
  std::optional<Frame> frame;
};

/// @brief Pairs of facets that may meet.
struct Candidates
{
  /// Master facets near the slave facets of this rank
  FacetList master;

  /// Masters of slave facet `f` are `facets[offsets[f]:offsets[f + 1]]`,
  /// indices into `master`, ascending
  std::vector<std::int32_t> offsets, facets;
};

/// @brief Find the master facets near each slave facet. Collective.
///
/// A pair is a candidate if the bounding boxes of the facets are no further
/// apart than the search distance (in any coordinate) and some of the normals
/// of their sub-facets oppose. The boxes hold the facets entirely, also where
/// these are curved and bulge beyond their nodes. Every rank learns the boxes
/// of the parts of every other rank's slave facets; master facets travel only
/// to the ranks whose boxes they meet.
///
/// @param[in] slave,master Surfaces.
/// @param[in] x_slave,x_master Current positions of their local nodes, shape
/// (n, 3).
/// @param[in] distance Search distance (a length); by default the larger
/// diameter of the two facets of a pair.
/// @param[in] factor Factor of the distance, given or default.
/// @return Candidates; `master` holds only facets that are in a pair, sorted by
/// their blocks, so that the order does not depend on the ranks they came from.
/// @throw std::runtime_error On all ranks, where positions are not finite or
/// the distance is not positive.
Candidates find_candidates(const Surface& slave,
                           std::span<const double> x_slave,
                           const Surface& master,
                           std::span<const double> x_master,
                           std::optional<double> distance, double factor = 1);
} // namespace dolfinx_mortar
