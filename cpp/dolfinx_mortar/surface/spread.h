// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "surface.h"

namespace dolfinx_mortar
{
/// @brief The same surface, its facets spread evenly over the ranks whatever
/// the partition of the bodies. Collective.
///
/// Facets are dealt like cards, in small compact parts that follow each other
/// along a space-filling curve: a contact zone that moves over the surface is
/// always on all ranks, and nothing has to be dealt again. Nodes stay with the
/// ranks that own them, with their numbers; the facets of a rank may all have
/// nodes of others (see Surface::local_blocks of ghosts).
/// @param[in] s Surface, whose reference positions say what is compact.
Surface spread_facets(const Surface& s);
} // namespace dolfinx_mortar
