// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "interface.h"
#include "petsc.h"

namespace dolfinx_mortar
{
/// @brief ∫ Ñ_j dγ over the whole slave surface, whether covered or not (∫ ψ_j
/// where multipliers are made of ψ, see is_reproducing).
/// Collective.
/// @param[in] slave Slave surface.
/// @param[in] space Space of the multipliers.
/// @param[in] nonnegative See Basis.
/// @param[in] x Positions of the local slave nodes, shape (n, 3).
/// @return Weight (area) of each local slave node, shape (n).
std::vector<double> nodal_weights(const Surface& slave, MultiplierSpace space,
                                  std::span<const std::int8_t> nonnegative,
                                  std::span<const double> x);

/// @brief The same in the space of an interface. Collective.
std::vector<double> nodal_weights(const Interface& interface,
                                  std::span<const std::int8_t> nonnegative,
                                  std::span<const double> x);

/// @brief Flag the nodes that get functions which are nowhere negative: those
/// of facets that the edge of a master crosses. Collective.
///
/// With the facets around these flagged as well, ties of masters that end
/// within the slave have up to three times the error. Parts that are too steep
/// for the masters do not count. They are off contact, as on the side of a
/// fillet, but the facets around them may be in contact, and a change of their
/// functions is a jump of forces and gaps.
/// @param[in] interface Interface.
/// @param[in] beyond Share of each facet beyond the masters' edges, see
/// NodalIntegrals.
/// @return Flag of each local slave node, shape (n).
std::vector<std::int8_t> flag_nonnegative(const Interface& interface,
                                          std::span<const double> beyond);

/// @brief Insert the basis transformation T, or its inverse, of the slave nodes
/// (displacements by displacements); other rows are not touched. Collective.
/// @param[in] interface Interface.
/// @param[in] nonnegative See Basis.
/// @param[in] inverse Insert T⁻¹.
/// @param[in,out] T Matrix that takes any pattern, see create_matrix; the
/// caller assembles it.
void insert_transformation(const Interface& interface,
                           std::span<const std::int8_t> nonnegative,
                           bool inverse, Mat T);

/// @brief Create an empty parallel AIJ matrix, to be filled with any pattern.
/// Collective.
Matrix create_matrix(MPI_Comm comm, std::int64_t local_rows,
                     std::int64_t local_columns);
} // namespace dolfinx_mortar
