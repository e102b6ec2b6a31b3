// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "evaluation.h"
#include <Eigen/Dense>
#include <optional>

// Whether anything holds bodies against their loads. Where friction cannot,
// there is no static solution, and Newton's iteration stagnates with all
// nodes slipping.

namespace dolfinx_mortar
{
/// @brief Rates of work in motions of unit length, at the start of a solve.
struct Balance
{
  /// Of what acts on the bodies; alike on all ranks
  Eigen::VectorXd loads;

  /// Of tractions along the edges of the pyramids of friction of this rank's
  /// nodes; shape (number of edges, number of motions)
  Eigen::MatrixXd edges;
};

/// @brief What must be in balance; none where more than Coulomb's friction
/// holds bodies. Collective.
/// @param[in] coupling,step,state,evaluation State and what follows from it.
/// @param[in] K Tangent of the bodies.
/// @param[in] force Residual forces without those of contact, zero at Dirichlet
/// dofs.
std::optional<Balance> find_balance(const Coupling& coupling, const Step& step,
                                    const State& state,
                                    const Evaluation& evaluation, Mat K,
                                    std::span<const double> force);

/// @brief Whether pressure and friction cannot balance the loads, as if bodies
/// were rigid. Collective.
bool is_overloaded(MPI_Comm comm, const Balance& balance);

/// @brief Whether a body moves freely under its loads where no contact is
/// active. Collective.
/// @param[in] coupling,evaluation,K,force See find_balance.
bool is_unsupported(const Coupling& coupling, const Evaluation& evaluation,
                    Mat K, std::span<const double> force);

/// @brief Distance of a point from the cone that vectors span. Collective.
///
/// Least ‖point - Σ c_i v_i‖ with c_i ≥ 0, by the active set method of Lawson
/// and Hanson (Solving Least Squares Problems, 1974, chapter 23): few vectors
/// are in use at a time, and ranks find the next one together.
/// @param[in] comm Communicator.
/// @param[in] vectors Unit vectors of this rank, shape (n, m).
/// @param[in] point The same on all ranks, shape (m).
double distance_from_cone(MPI_Comm comm, const Eigen::MatrixXd& vectors,
                          const Eigen::VectorXd& point);
} // namespace dolfinx_mortar
