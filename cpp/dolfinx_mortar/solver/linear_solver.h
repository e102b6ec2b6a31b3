// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "elimination.h"
#include "newton_system.h"
#include "reduced.h"
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Solver of the Newton system in displacements and multipliers,
///
///     K du + Bᵀ dz = r_u
///     C_u du + C_z dz = r_z.
///
/// Dual multipliers are condensed exactly: with the rows of the slave nodes in
/// the transformed basis, B T = [D̃, …] with D̃ diagonal, the multipliers of the
/// nodes S in contact (or tied) follow from their nodes' own equilibrium,
///
///     dz_S = D̃⁻¹ [Tᵀ (r_u - K du)]_S,
///
/// and what is left is a system in du alone: no saddle point (equations 4.8 to
/// 4.12; see Elimination for nodes with several multipliers).
class LinearSolver
{
public:
  /// @brief Create the solver, with options from PETSc's database. Collective.
  ///
  /// An iterative solver of the condensed system is preconditioned through the
  /// symmetric system that is left when the constraints are eliminated; that is
  /// what `pc_type` is for: multigrid, or a Cholesky factorisation, half as
  /// large as that of the condensed system.
  /// @param[in] comm Communicator.
  /// @param[in] prefix Prefix of the options.
  /// @param[in] condense Condense the multipliers, or solve the saddle point.
  /// @param[in] x Positions of the owned displacement dofs, for rigid body
  /// modes.
  /// @param[in] interpolate_corners See ReducedPreconditioner; none, and there
  /// is no level of corners.
  LinearSolver(MPI_Comm comm, const std::string& prefix, bool condense,
               std::span<const double> x,
               std::function<Matrix()> interpolate_corners = {});

  /// @brief Solve for [du, dz]. Collective.
  /// @param[in] s Newton system.
  /// @param[in] r [r_u, r_z]; entries at Dirichlet dofs are the steps of these.
  /// @param[in] rtol Tolerance of an iterative solver, where `ksp_rtol` need
  /// not be reached.
  /// @throw ConvergenceError On all ranks, where there is no solution.
  std::vector<double> solve(const NewtonSystem& s, std::span<const double> r,
                            double rtol = 0);

  /// True where multipliers are condensed
  bool condense() const { return _condense; }

  /// The Krylov solver
  KSP ksp() const { return _ksp.get(); }

  /// Preconditioner of the reduced system; null where there is none
  PC inner() const { return _reduced ? _reduced->inner() : nullptr; }

private:
  std::vector<double> solve_saddle_point(const NewtonSystem& s,
                                         std::span<const double> r);
  std::vector<double> solve_condensed(const NewtonSystem& s,
                                      std::span<const double> r, double rtol);

  /// @brief Run the Krylov solver, to the looser one of two tolerances.
  /// @throw ConvergenceError On all ranks, where there is no solution.
  std::vector<double> run(Mat A, std::span<const double> b, double rtol = 0);

  PetscHandle<KSP, KSPDestroy> _ksp;
  bool _condense;
  std::unique_ptr<ReducedPreconditioner> _reduced;
};
} // namespace dolfinx_mortar
