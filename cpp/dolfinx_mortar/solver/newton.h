// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "convergence.h"
#include "failure.h"
#include "linear_solver.h"
#include "solver_options.h"
#include <exception>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Newton's iteration by PETSc's SNES, for geometry, material, active
/// sets, stick and slip at once.
class Newton
{
public:
  /// @brief Collective.
  /// @param[in] bodies,coupling Bodies and interfaces; they must live as long
  /// as this.
  /// @param[in] options PETSc options.
  /// @param[in] condense Condense the multipliers.
  /// @param[in] poll See ProblemOptions.
  /// @throw std::invalid_argument On all ranks, where PETSc does not accept the
  /// options.
  Newton(Bodies& bodies, const Coupling& coupling, SolverOptions options,
         bool condense, std::function<void()> poll);

  Newton(const Newton&) = delete;
  Newton& operator=(const Newton&) = delete;

  /// @brief Solve. Collective.
  /// @param[in] state State that the solve starts with.
  /// @param[in] step What is decided for it; `forced` is used once.
  /// @param[in] x Displacements and multipliers to start from.
  /// @param[in] start_overlap See largest_overlap; 0 but in the first solve.
  /// @return Evaluation of the solution.
  /// @throw ConvergenceError There is none.
  std::shared_ptr<const Evaluation> solve(const State& state, const Step& step,
                                          std::span<const double> x,
                                          double start_overlap);

  /// @brief Refuse iterations that do not know what contact needs.
  /// @throw std::invalid_argument The type is not Newton's iteration with a
  /// line search, nor the one linear solve that bodies need which are linear
  /// and tied.
  void check_type() const;

  /// Iterates of the last solve
  const History& history() const { return _history; }

  /// Number of iterations of the last solve
  int num_iterations() const;

  SNES snes() const { return _snes.get(); }
  const LinearSolver& linear_solver() const { return *_solver; }
  const SolverOptions& options() const { return _options; }

private:
  static PetscErrorCode function(SNES, Vec x, Vec f, void* self);
  static PetscErrorCode jacobian(SNES, Vec x, Mat, Mat, void* self);
  static PetscErrorCode converged(SNES, PetscInt it, PetscReal, PetscReal,
                                  PetscReal norm, SNESConvergedReason* reason,
                                  void* self);
  static PetscErrorCode precheck(SNESLineSearch, Vec x, Vec y,
                                 PetscBool* changed, void* self);
  static PetscErrorCode monitor(SNES, PetscInt, PetscReal, void* self);
  static PetscErrorCode multiply(Mat, Vec x, Vec y);
  static PetscErrorCode apply(PC, Vec x, Vec y);

  /// Do work that PETSc has asked for, and keep what it raises: PETSc would not
  /// unlock its vectors.
  template <typename Work>
  void guarded(Work&& work);

  void create_snes();
  std::vector<double> row_scale() const;

  /// Residual at x; keeps the last one. Collective.
  const Iteration& evaluate_at(std::span<const double> x);

  void linearise(std::span<const double> x);

  /// Tolerance of an iterative solver: what the SNES asks for (Eisenstat and
  /// Walker), and no more than the end of the iteration needs; 0 where it asks
  /// for none.
  double linear_tolerance() const;
  void check_support(Mat K);
  SNESConvergedReason test(int it, double norm);
  void shorten(std::span<const double> x, Vec y);
  double length_of_step() const;

  FailedSolve failed_solve() const;

  /// Raise what ended the iteration. Collective.
  [[noreturn]] void fail(std::exception_ptr raised);

  Bodies& _bodies;
  const Coupling& _coupling;
  SolverOptions _options;
  std::function<void()> _poll;
  PetscHandle<SNES, SNESDestroy> _snes;
  Matrix _jacobian;
  Vector _x;
  std::unique_ptr<LinearSolver> _solver;
  History _history;

  /// Of one solve
  struct Run
  {
    const State* state;
    Step step;
    double start_overlap = 0;
    std::vector<double> x; // where `iteration` is
    std::optional<Iteration> iteration;
    std::optional<NewtonSystem> system;
    std::vector<double> row_scale; // empty for ones
    ForceReference reference;
    ActiveSets sets;
    std::exception_ptr raised;
    std::string failure; // why the last step was shortened
    bool cycle_pending = false;
    double step_length = 0;    // relative to Newton's
    std::vector<double> begin; // of the last step
    double newton_length = 0;  // of Newton's step from there
    std::function<bool()> overloaded;
  };
  std::optional<Run> _run;
};
} // namespace dolfinx_mortar
