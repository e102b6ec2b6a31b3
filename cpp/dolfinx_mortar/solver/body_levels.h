// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <dolfinx_mortar/assembly/petsc.h>
#include <petscksp.h>
#include <string>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Interpolations of smoothed aggregation (`gamg`), the finest first.
/// Collective.
///
/// Rows and columns are over the dofs of a level and of the next coarser one.
/// Aggregates of a system in which bodies are coupled have nodes of both sides
/// of an interface, and move them by rigid motions together: no coarse level
/// would let bodies slide on each other. Those of the bodies alone do.
/// @param[in] comm Communicator.
/// @param[in] prefix Prefix of the options.
/// @param[in] K Stiffness of bodies that do not touch.
/// @param[in] modes Their rigid body modes.
std::vector<Matrix> aggregate_bodies(MPI_Comm comm, const std::string& prefix,
                                     Mat K, MatNullSpace modes);

/// @brief Make a preconditioner multigrid with given interpolations.
/// Collective.
///
/// The smoothers and the coarse solver have the prefixes that they have with
/// `gamg`; of the options of the cycle only `pc_mg_cycle_type` counts.
/// @param[in] pc Preconditioner.
/// @param[in] prefix Prefix of the options.
/// @param[in] A Matrix of the finest level.
/// @param[in] P Interpolations, the finest first. Columns may depend on each
/// other, or be empty.
/// @param[in] unit Size of the diagonal of A.
void set_levels(PC pc, const std::string& prefix, const Matrix& A,
                const std::vector<Matrix>& P, double unit);
} // namespace dolfinx_mortar
