// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <dolfinx_mortar/dolfinx/bodies.h>

namespace dolfinx_mortar
{
/// @brief Operations that an LU factorisation of the tangent takes, as MUMPS
/// estimates them from its pattern; infinite where PETSc has no MUMPS.
/// Collective.
///
/// The number of unknowns does not tell: a slice of 132 000 takes fewer than a
/// cube of 28 000. What interfaces add to the pattern is left out.
double factorisation_work(const Bodies& bodies);

/// @brief Whether a model is large for a direct solver, see SolverOptions.
/// Collective.
bool is_large(const Bodies& bodies);
} // namespace dolfinx_mortar
