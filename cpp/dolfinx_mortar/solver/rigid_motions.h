// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "coupling.h"
#include <Eigen/Dense>

namespace dolfinx_mortar
{
/// @brief Rigid motions that Dirichlet conditions and ties leave to bodies.
/// Collective.
/// @param[in] coupling Bodies and interfaces.
/// @param[in] u Displacements of the owned dofs: motions are those from there.
/// @return Motions of the owned displacement dofs, shape (n, number of
/// motions).
Eigen::MatrixXd free_motions(const Coupling& coupling,
                             std::span<const double> u);

/// @brief Whether no body, with those it is tied to, can move rigidly.
/// Collective.
bool is_held(const Coupling& coupling);

/// @brief Those combinations of motions that a stiffness, as of springs or
/// inertia, leaves free. Collective.
/// @param[in] coupling Bodies and interfaces.
/// @param[in] motions Motions of the owned displacement dofs.
/// @param[in] K Tangent of the bodies.
Eigen::MatrixXd unresisted(const Coupling& coupling,
                           const Eigen::MatrixXd& motions, Mat K);

/// @brief Sum of a small dense matrix over all ranks. Collective.
Eigen::MatrixXd sum(MPI_Comm comm, const Eigen::MatrixXd& A);
} // namespace dolfinx_mortar
