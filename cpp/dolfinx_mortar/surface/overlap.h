// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "surface.h"
#include "triangles.h"
#include <cstdint>
#include <span>

namespace dolfinx_mortar
{
/// @brief Find the slave facet that is deepest inside a master body.
/// Collective.
///
/// From the middle of a slave facet a ray goes into its own body. If that
/// leaves another body first, through a master facet and further away than
/// either facet is large, then the slave facet is in there. This needs no
/// earlier configuration, but bodies that are separate, and a ray that has not
/// left the other body on its far side. Ranks send each other the triangles
/// that rays may meet, no more.
///
/// @param[in] slave,master Surfaces.
/// @param[in] x_slave,x_master Current positions of their local nodes, shape
/// (n, 3).
/// @param[in] test Non-zero for each slave facet to look at.
/// @param[in] slave_bodies,master_bodies Body that each facet is on.
/// @param[in] boxes Lower and upper corners of the boxes around all bodies,
/// shape (n, 2, 3), the same on all ranks.
/// @return Depth along the ray and middle of the deepest facet, the same on all
/// ranks.
Depth find_overlap(const Surface& slave, std::span<const double> x_slave,
                   std::span<const std::int8_t> test,
                   std::span<const std::int64_t> slave_bodies,
                   const Surface& master, std::span<const double> x_master,
                   std::span<const std::int64_t> master_bodies,
                   std::span<const double> boxes);
} // namespace dolfinx_mortar
