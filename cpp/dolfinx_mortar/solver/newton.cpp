// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "newton.h"
#include "convergence_error.h"
#include "failure.h"
#include "messages.h"
#include "support.h"
#include <algorithm>
#include <cmath>
#include <dolfinx_mortar/common/error.h>
#include <limits>

using namespace dolfinx_mortar;

namespace
{
// Share of the default c_n in the first iterations. What a nonlinear step
// leaves of the gaps is common to many nodes, and these resist it much less
// than a node alone: counted with the stiffness of nodes, it would open nodes
// in the middle of a contact zone, for the next step to close them again.
// Where sets do not settle soon, nodes that have come apart are better opened.
constexpr double first_share = 0.1;
constexpr int num_first = 5;

/// Whether each step is a full one of the present linearisation. What line
/// searches compare, and a linearisation of an earlier iterate, is to be of one
/// and the same c_n.
bool takes_full_steps(SNES snes, const std::string& line_search)
{
  PetscInt lag;
  check(SNESGetLagJacobian(snes, &lag), "SNESGetLagJacobian");
  return lag == 1 and line_search == "basic";
}
} // namespace

//-----------------------------------------------------------------------------
Newton::Newton(Bodies& bodies, const Coupling& coupling, SolverOptions options,
               bool condense, std::function<void()> poll)
    : _bodies(bodies), _coupling(coupling), _options(std::move(options)),
      _poll(std::move(poll))
{
  {
    SolverOptions::Loan loan(_options);
    PetscErrorText errors;
    _solver = std::make_unique<LinearSolver>(
        coupling.comm(), _options.prefix(), condense,
        coupling.layout.owned(coupling.layout.X, 3),
        [&bodies]
        {
          return create_corner_interpolation(bodies.layout(), bodies.spaces());
        });
    create_snes();
  }
  _options.check_names();
}
//-----------------------------------------------------------------------------
std::vector<double> Newton::row_scale() const
{
  // A line search looks at the norm of all residuals together, full steps do
  // not: factors that make forces of them
  if (_options.line_search() == "basic")
    return {};
  std::vector<double> stiffness = diagonal(_bodies.tangent().get());
  for (double& k : stiffness)
    k = std::abs(k);
  std::vector<double> scale(stiffness.size(), 1.0);
  for (std::int32_t dof : _coupling.fixed_dofs)
    scale[dof] = stiffness[dof];
  const std::vector<double> more
      = force_scale(_coupling, _run->step, stiffness);
  scale.insert(scale.end(), more.begin(), more.end());
  return scale;
}
//-----------------------------------------------------------------------------
std::shared_ptr<const Evaluation> Newton::solve(const State& state,
                                                const Step& step,
                                                std::span<const double> x,
                                                double start_overlap)
{
  _history.clear();
  _run.emplace(Run{.state = &state,
                   .step = step,
                   .start_overlap = start_overlap,
                   .x = {},
                   .iteration = {},
                   .system = {},
                   .row_scale = {},
                   .reference = {},
                   .sets = ActiveSets(_coupling.comm()),
                   .raised = {},
                   .failure = {},
                   .begin = {},
                   .overloaded = {}});
  struct Forget
  {
    std::optional<Run>& run;
    ~Forget() { run.reset(); }
  } forget{_run};
  if (takes_full_steps(_snes.get(), _options.line_search()))
    _run->step.normal_share = first_share;
  _run->row_scale = row_scale();
  set_values(_x.get(), x);
  PetscErrorCode code;
  {
    SolverOptions::Loan loan(_options);
    PetscErrorText errors;
    code = SNESSolve(_snes.get(), nullptr, _x.get());
  }
  if (any(_coupling.comm(), static_cast<bool>(_run->raised)))
    fail(_run->raised);
  check(code, "SNESSolve");
  SNESConvergedReason reason;
  check(SNESGetConvergedReason(_snes.get(), &reason), "SNESGetConvergedReason");
  if (reason <= 0)
    throw ConvergenceError(explain(failed_solve(), reason));
  const VectorView solution(_x.get());
  evaluate_at(solution.get());
  return std::make_shared<Evaluation>(std::move(_run->iteration->interfaces));
}
//-----------------------------------------------------------------------------
FailedSolve Newton::failed_solve() const
{
  return {.coupling = _coupling,
          .step = _run->step,
          .state = *_run->state,
          .history = _history,
          .iteration = _run->iteration ? &*_run->iteration : nullptr,
          .start_overlap = _run->start_overlap,
          .shortened = _run->failure};
}
//-----------------------------------------------------------------------------
void Newton::fail(std::exception_ptr raised)
{
  // What one rank has raised, all do; errors of the solve get an explanation
  std::string message;
  bool foreign = false, complete = false;
  try
  {
    if (raised)
      std::rethrow_exception(raised);
  }
  catch (const ConvergenceError& e)
  {
    message = e.what();
    complete = true;
  }
  catch (const std::runtime_error& e)
  {
    message = e.what();
  }
  catch (...)
  {
    foreign = true;
  }
  if (any(_coupling.comm(), foreign))
  {
    // As an interrupt, or an error of somebody's function: raised together
    if (raised)
      std::rethrow_exception(raised);
    throw std::runtime_error("Another rank has been interrupted.");
  }
  const std::string text = explain(failed_solve(), message, complete);
  try
  {
    throw_on_all(_coupling.comm(), message.empty() ? "" : text);
  }
  catch (const std::runtime_error& e)
  {
    throw ConvergenceError(e.what());
  }
  throw ConvergenceError(text);
}
//-----------------------------------------------------------------------------
const Iteration& Newton::evaluate_at(std::span<const double> x)
{
  Run& run = *_run;
  const bool same = run.iteration and std::ranges::equal(x, run.x);
  if (!any(_coupling.comm(), !same))
    return *run.iteration;
  run.iteration.reset();
  run.iteration = evaluate(_bodies, _coupling, run.step, *run.state, x);
  run.x.assign(x.begin(), x.end());
  return *run.iteration;
}
//-----------------------------------------------------------------------------
void Newton::linearise(std::span<const double> x)
{
  Run& run = *_run;
  const Iteration& it = evaluate_at(x);
  run.system.reset();
  const Matrix K = _bodies.tangent();
  if (!run.step.springs.empty())
  {
    const Vector springs = create_vector(_coupling.comm(), run.step.springs);
    check(MatDiagonalSet(K.get(), springs.get(), ADD_VALUES), "MatDiagonalSet");
    _bodies.forget_tangents();
  }
  run.reference.floor = force_floor(_coupling.layout, K.get(),
                                    x.first(_coupling.layout.size()));
  run.system = dolfinx_mortar::linearise(_coupling, run.step, *run.state,
                                         it.interfaces, K);
  reduce_tools(_bodies, it.interfaces, *run.system);
  if (_coupling.has_contact())
    check_support(K.get());
}
//-----------------------------------------------------------------------------
void Newton::check_support(Mat K)
{
  Run& run = *_run;
  const Iteration& it = *run.iteration;
  if (_history.back().active == 0
      and is_unsupported(_coupling, it.interfaces, K, it.free_forces))
  {
    throw ConvergenceError("Nothing holds a body against its loads.");
  }
  if (_history.size() == 1)
  {
    const std::optional<Balance> balance = find_balance(
        _coupling, run.step, *run.state, it.interfaces, K, it.free_forces);
    if (balance)
    {
      run.overloaded = [comm = _coupling.comm(), balance = *balance]
      { return is_overloaded(comm, balance); };
    }
  }
  else if (stagnates(_history) and slides_away(_coupling, run.step, _history)
           and run.overloaded and run.overloaded())
  {
    throw ConvergenceError("Friction does not hold a body against its loads.");
  }
}
//-----------------------------------------------------------------------------
SNESConvergedReason Newton::test(int it, double residual_norm)
{
  Run& run = *_run;
  PetscReal atol, rtol;
  PetscInt max_it;
  check(SNESGetTolerances(_snes.get(), &atol, &rtol, nullptr, &max_it, nullptr),
        "SNESGetTolerances");
  const bool failed
      = run.raised or !run.iteration or !std::isfinite(residual_norm);
  if (any(_coupling.comm(), failed))
    return SNES_DIVERGED_FNORM_NAN;

  Iterate record = measure(_coupling, run.step, *run.state, *run.iteration,
                           run.reference, run.sets);
  record.iteration = it;
  record.step = it > 0 ? length_of_step() : 0.0;

  const bool small
      = std::max({record.force, record.constraint, record.prescribed}) <= rtol
        or (record.residual <= atol and record.constraint <= rtol
            and record.prescribed <= rtol);
  const bool settled
      = record.changes == 0
        or is_undecided(_coupling, run.step, *run.state,
                        run.iteration->interfaces, run.sets, rtol);
  SNESConvergedReason reason = SNES_CONVERGED_ITERATING;
  if (small and settled and run.step.forced.empty())
    reason = SNES_CONVERGED_FNORM_RELATIVE;
  else if (it >= max_it)
    reason = SNES_DIVERGED_MAX_IT;
  else if (run.sets.cycling())
    record.cycle = run.cycle_pending = true;
  _history.push_back(record);
  return reason;
}
//-----------------------------------------------------------------------------
double Newton::length_of_step() const
{
  const Run& run = *_run;
  if (_options.line_search() == "basic" or run.newton_length == 0)
    return run.step_length;
  std::vector<double> step = run.x;
  for (std::size_t i = 0; i < step.size(); ++i)
    step[i] -= run.begin[i];
  return norm(_coupling.comm(), step) / run.newton_length;
}
//-----------------------------------------------------------------------------
void Newton::shorten(std::span<const double> x, Vec y)
{
  Run& run = *_run;
  if (_poll)
    _poll();
  {
    const VectorView step(y);
    run.newton_length = norm(_coupling.comm(), step.get());
  }
  if (!std::isfinite(run.newton_length))
  {
    throw ConvergenceError(
        "The linear solver found no finite solution. The system may be "
        "singular, as where a body is not held (check the Dirichlet "
        "conditions); a saddle point needs a solver that chooses its pivots "
        "(MUMPS).");
  }
  run.step_length = 1;
  run.begin.assign(x.begin(), x.end());
  auto halve = [&]
  {
    check(VecScale(y, 0.5), "VecScale");
    run.step_length *= 0.5;
  };
  // A cycle of active sets: a shorter step leads out of it
  if (run.cycle_pending)
    halve();
  run.cycle_pending = false;
  run.step.forced.clear();
  if (std::ssize(_history) >= num_first)
    run.step.normal_share = 1;
  run.failure.clear();
  for (int i = 0; i < 10; ++i)
  {
    std::string failure;
    try
    {
      std::vector<double> target = run.begin;
      {
        const VectorView step(y);
        for (std::size_t k = 0; k < target.size(); ++k)
          target[k] -= step.get()[k];
      }
      failure = explain_infinite(_coupling, run.step, *run.state,
                                 evaluate_at(target));
    }
    catch (const std::runtime_error& e)
    {
      failure = e.what();
    }
    if (failure.empty())
      return;
    run.failure = failure;
    run.iteration.reset();
    halve();
  }
  throw ConvergenceError("However short the step, it leads to no admissible "
                         "state. "
                         + run.failure + messages::smaller_steps);
}
