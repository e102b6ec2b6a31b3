// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "newton.h"
#include "checks.h"
#include "convergence_error.h"
#include "messages.h"
#include "rigid_motions.h"
#include "support.h"
#include <algorithm>
#include <cmath>
#include <dolfinx_mortar/common/error.h>
#include <limits>

using namespace dolfinx_mortar;

namespace
{
constexpr double infinity = std::numeric_limits<double>::infinity();

/// Largest side of the box around all bodies [length]. Collective.
double extent(const Layout& layout)
{
  std::array<double, 6> box;
  box.fill(infinity);
  for (std::size_t i = 0; i < layout.X.size(); ++i)
  {
    box[i % 3] = std::min(box[i % 3], layout.X[i]);
    box[3 + i % 3] = std::min(box[3 + i % 3], -layout.X[i]);
  }
  MPI_Allreduce(MPI_IN_PLACE, box.data(), 6, MPI_DOUBLE, MPI_MIN, layout.comm);
  return std::max({-box[3] - box[0], -box[4] - box[1], -box[5] - box[2]});
}

/// Read-only values of a vector, as long as this lives.
class Values
{
public:
  explicit Values(Vec x) : _x(x)
  {
    check(VecGetLocalSize(x, &_size), "VecGetLocalSize");
    check(VecGetArrayRead(x, &_data), "VecGetArrayRead");
  }
  Values(const Values&) = delete;
  Values& operator=(const Values&) = delete;
  ~Values() { VecRestoreArrayRead(_x, &_data); }

  std::span<const double> get() const
  {
    return {_data, static_cast<std::size_t>(_size)};
  }

private:
  Vec _x;
  PetscInt _size = 0;
  const PetscScalar* _data = nullptr;
};

void set_values(Vec x, std::span<const double> values)
{
  PetscScalar* data;
  check(VecGetArrayWrite(x, &data), "VecGetArrayWrite");
  std::ranges::copy(values, data);
  check(VecRestoreArrayWrite(x, &data), "VecRestoreArrayWrite");
}

bool all_finite(std::span<const double> values)
{
  return std::ranges::all_of(values, [](double v) { return std::isfinite(v); });
}
} // namespace

//-----------------------------------------------------------------------------
Iteration dolfinx_mortar::evaluate(Bodies& bodies, const Coupling& coupling,
                                   const Step& step, const State& state,
                                   std::span<const double> x)
{
  const std::size_t n = coupling.layout.size();
  const std::span<const double> u = x.first(n), z = x.subspan(n);
  bodies.set_displacements(u);
  Iteration it;
  it.free_forces = bodies.residual();
  it.interfaces
      = evaluate(coupling, step, state, bodies.local_displacements(), u, z);
  it.residual = it.free_forces;
  for (std::size_t i = 0; i < n; ++i)
    it.residual[i] += it.interfaces.force[i];
  std::vector<double> at_work = it.interfaces.force;
  const std::vector<double> prescribed = bodies.prescribed_values();
  for (std::int32_t dof : coupling.fixed_dofs)
  {
    at_work.push_back(it.residual[dof]);
    it.residual[dof] = u[dof] - prescribed[dof];
    it.free_forces[dof] = 0;
  }
  it.force_scale = norm(coupling.comm(), at_work);
  it.residual.insert(it.residual.end(), it.interfaces.constraints.begin(),
                     it.interfaces.constraints.end());
  return it;
}
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
        coupling.layout.owned(coupling.layout.X, 3));
    create_snes();
  }
  _options.check_names();
}
//-----------------------------------------------------------------------------
void Newton::create_snes()
{
  MPI_Comm comm = _coupling.comm();
  const PetscInt size = _coupling.layout.size() + _coupling.size();
  _x = create_vector(comm, std::vector<double>(size, 0.0));
  Vector f;
  check(VecDuplicate(_x.get(), f.put()), "VecDuplicate");
  check(MatCreateShell(comm, size, size, PETSC_DETERMINE, PETSC_DETERMINE, this,
                       _jacobian.put()),
        "MatCreateShell");
  check(MatShellSetOperation(_jacobian.get(), MATOP_MULT,
                             reinterpret_cast<void (*)(void)>(multiply)),
        "MatShellSetOperation");
  check(SNESCreate(comm, _snes.put()), "SNESCreate");
  const SNES snes = _snes.get();
  const std::string& prefix = _options.prefix();
  check(SNESSetOptionsPrefix(snes, prefix.c_str()), "SNESSetOptionsPrefix");
  check(SNESSetType(snes, SNESNEWTONLS), "SNESSetType");
  check(SNESSetFunction(snes, f.get(), function, this), "SNESSetFunction");
  check(SNESSetJacobian(snes, _jacobian.get(), _jacobian.get(), jacobian, this),
        "SNESSetJacobian");
  check(SNESSetConvergenceTest(snes, converged, this, nullptr),
        "SNESSetConvergenceTest");
  SNESLineSearch search;
  check(SNESGetLineSearch(snes, &search), "SNESGetLineSearch");
  check(SNESLineSearchSetPreCheck(search, precheck, this),
        "SNESLineSearchSetPreCheck");
  KSP ksp;
  PC pc;
  check(SNESGetKSP(snes, &ksp), "SNESGetKSP");
  check(KSPSetOptionsPrefix(ksp, (prefix + "newton_").c_str()),
        "KSPSetOptionsPrefix");
  check(KSPSetType(ksp, KSPPREONLY), "KSPSetType");
  check(KSPGetPC(ksp, &pc), "KSPGetPC");
  check(PCSetType(pc, PCSHELL), "PCSetType");
  check(PCShellSetContext(pc, this), "PCShellSetContext");
  check(PCShellSetApply(pc, apply), "PCShellSetApply");
  check(SNESSetFromOptions(snes), "SNESSetFromOptions");
  check_type();
  PetscBool monitored;
  check(
      PetscOptionsHasName(nullptr, prefix.c_str(), "-snes_monitor", &monitored),
      "PetscOptionsHasName");
  if (monitored)
    check(SNESMonitorSet(snes, monitor, this, nullptr), "SNESMonitorSet");
}
//-----------------------------------------------------------------------------
void Newton::check_type() const
{
  SNESType type;
  check(SNESGetType(_snes.get(), &type), "SNESGetType");
  const std::string name = type;
  if (name != SNESNEWTONLS and (_coupling.has_contact() or name != SNESKSPONLY))
  {
    throw std::invalid_argument(
        "snes_type is '" + name
        + "', but must be 'newtonls', Newton's iteration with a line search: "
          "active sets settle in several such steps. To change the steps "
          "choose "
          "snes_linesearch_type. Without contact a linear problem may have "
          "'ksponly'.");
  }
}
//-----------------------------------------------------------------------------
int Newton::num_iterations() const
{
  PetscInt n;
  check(SNESGetIterationNumber(_snes.get(), &n), "SNESGetIterationNumber");
  return n;
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
                   .sets = ActiveSets(_coupling.comm()),
                   .raised = {},
                   .failure = {},
                   .begin = {},
                   .first_residual = {},
                   .overloaded = {}});
  struct Forget
  {
    std::optional<Run>& run;
    ~Forget() { run.reset(); }
  } forget{_run};
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
    throw ConvergenceError(explain_reason(reason));
  const Values solution(_x.get());
  evaluate_at(solution.get());
  return std::make_shared<Evaluation>(std::move(_run->iteration->interfaces));
}
//-----------------------------------------------------------------------------
void Newton::fail(std::exception_ptr raised)
{
  // What one rank has raised, all do; errors of the solve get an explanation
  std::string message, failed = "The solve failed in Newton iteration "
                                + std::to_string(_history.size()) + ".";
  bool foreign = false, convergence = false;
  try
  {
    if (raised)
      std::rethrow_exception(raised);
  }
  catch (const ConvergenceError& e)
  {
    message = e.what();
    convergence = true;
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
  const std::string hint = find_hint();
  if (hint.empty())
  {
    failed += " " + message + (convergence ? "" : messages::smaller_steps)
              + find_barely();
  }
  else
    failed += " " + hint;
  try
  {
    throw_on_all(_coupling.comm(), message.empty() ? "" : failed);
  }
  catch (const std::runtime_error& e)
  {
    throw ConvergenceError(e.what());
  }
  throw ConvergenceError(failed);
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
  // Displacements that leave no strain still have the round-off of a
  // deformation gradient; those far beyond the bodies' size are a body's that
  // moves away, and excuse nothing
  const double size = extent(_coupling.layout);
  std::vector<double> forces = diagonal(K.get());
  std::size_t dof = 0;
  for (std::size_t b = 0; b < _coupling.layout.num_bodies(); ++b)
  {
    const double cell = _coupling.layout.cell_sizes[b];
    for (std::int32_t k = 0; k < 3 * _coupling.layout.num_owned[b]; ++k, ++dof)
    {
      forces[dof] *= std::clamp(std::abs(x[dof]), 0.1 * cell,
                                std::max(0.1 * cell, 10 * size));
    }
  }
  run.force_floor = 1e-5 * norm(_coupling.comm(), forces);
  run.system = dolfinx_mortar::linearise(_coupling, run.step, *run.state,
                                         it.interfaces, K);
  if (_coupling.has_contact())
    check_support(K.get());
  bool bare = false;
  const MultiplierNodes& nodes = run.system->nodes;
  for (std::size_t i = 0; i < nodes.active.size(); ++i)
    bare = bare or (nodes.active[i] and nodes.diagonal[i / 3] == 0);
  if (any(_coupling.comm(), bare and _solver->condense()))
  {
    throw ConvergenceError(
        std::string("No master covers a slave node in contact any more, so "
                    "that its multiplier cannot be condensed.")
        + messages::smaller_steps);
  }
}
//-----------------------------------------------------------------------------
void Newton::check_support(Mat K)
{
  Run& run = *_run;
  const Iteration& it = *run.iteration;
  if (_history.back().active == 0
      and is_flying(_coupling, it.interfaces, K, it.free_forces))
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
  else if (wanders(_history) and slides_away() and run.overloaded
           and run.overloaded())
  {
    throw ConvergenceError("Friction does not hold a body against its loads.");
  }
}
//-----------------------------------------------------------------------------
bool Newton::slides_away() const
{
  bool frictional = _coupling.has_contact();
  for (std::size_t i = 0; i < _coupling.interfaces.size(); ++i)
  {
    frictional
        = frictional
          and (_coupling.interfaces[i].is_tie() or _run->step.is_frictional(i));
  }
  return frictional and ends_slipping(_history) and !is_held(_coupling);
}
//-----------------------------------------------------------------------------
bool Newton::undecided(double rtol) const
{
  // Round-off moves nodes that have neither gap nor traction back and forth;
  // either state solves the problem
  const Run& run = *_run;
  if (run.sets.size() < 2)
    return false;
  bool ok = true;
  std::size_t at = 0;
  for (std::size_t i = 0; i < _coupling.interfaces.size(); ++i)
  {
    const CoupledInterface& c = _coupling.interfaces[i];
    if (c.is_tie())
      continue;
    const InterfaceEvaluation& e = run.iteration->interfaces.interfaces[i];
    const InterfaceState& s = run.state->interfaces[i];
    const std::span<const double> z = _coupling.part(
        std::span<const double>(run.iteration->interfaces.z), i, 3);
    const double largest = largest_traction(c.data, s, run.step.weights[i], z);
    for (std::int32_t k = 0; k < c.num_owned(); ++k, ++at)
    {
      if (run.sets.status(0)[at] == run.sets.status(1)[at])
        continue;
      double zn = 0;
      for (int d = 0; d < 3; ++d)
      {
        zn += z[3 * k + d] * e.geometry->configuration.normals.n[3 * k + d];
      }
      zn = std::abs(zn);
      const double cg = std::abs(s.c_n[k] * e.gap[k]);
      ok = ok
           and (std::max(zn, cg) <= 100 * rtol * largest
                or (run.step.is_frictional(i)
                    and e.law.status[k] != Status::open and zn > 0));
    }
  }
  return !any(_coupling.comm(), !ok);
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

  MPI_Comm comm = _coupling.comm();
  const Iteration& now = *run.iteration;
  const std::size_t n = _coupling.layout.size();
  std::vector<double> forces(now.residual.begin(), now.residual.begin() + n);
  double prescribed = 0;
  for (std::int32_t dof : _coupling.fixed_dofs)
  {
    prescribed = std::max(prescribed, std::abs(forces[dof]));
    forces[dof] = 0;
  }
  prescribed = max(comm, prescribed);
  Iterate record{.iteration = it};
  record.residual = norm(comm, forces);
  if (!run.first_residual)
    run.first_residual = record.residual;
  // Forces below the round-off of stiffness times displacement are no forces.
  // What forces an iterate on the way had is no measure: it may have been far
  // off.
  const double reference
      = std::max({*run.first_residual, now.force_scale, run.force_floor});
  const double length = std::max(max_norm(comm, now.interfaces.u), prescribed);
  record.force = reference > 0 ? record.residual / reference : 0.0;
  record.constraint = constraint_measure(_coupling, run.step, *run.state,
                                         now.interfaces, length);
  record.prescribed = length > 0 ? prescribed / length : 0.0;

  std::vector<Status> status;
  for (const InterfaceEvaluation& e : now.interfaces.interfaces)
    status.insert(status.end(), e.law.status.begin(), e.law.status.end());
  const ContactCounts counts = count_nodes(comm, status);
  record.active = counts.active;
  record.stick = counts.stick;
  record.slip = counts.slip;
  record.changes = run.sets.record(std::move(status));
  record.step = it > 0 ? length_of_step() : 0.0;

  const bool small
      = std::max({record.force, record.constraint, record.prescribed}) <= rtol
        or (record.residual <= atol and record.constraint <= rtol
            and record.prescribed <= rtol);
  const bool settled = record.changes == 0 or undecided(rtol);
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
    const Values step(y);
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
  run.failure.clear();
  for (int i = 0; i < 10; ++i)
  {
    std::string failure;
    try
    {
      std::vector<double> target = run.begin;
      {
        const Values step(y);
        for (std::size_t k = 0; k < target.size(); ++k)
          target[k] -= step.get()[k];
      }
      evaluate_at(target);
      failure = find_infinite();
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
//-----------------------------------------------------------------------------
std::string Newton::find_infinite() const
{
  const Run& run = *_run;
  MPI_Comm comm = _coupling.comm();
  const std::vector<double>& f = run.iteration->residual;
  const std::size_t n = _coupling.layout.size();
  if (!any(comm, !all_finite(f)))
    return "";
  bool prescribed = false;
  for (std::int32_t dof : _coupling.fixed_dofs)
    prescribed = prescribed or !std::isfinite(f[dof]);
  std::array<double, 3> at = {infinity, infinity, infinity};
  const std::vector<double> X = _coupling.layout.owned(_coupling.layout.X, 3);
  for (std::size_t k = 0; k < n; k += 3)
  {
    if (!all_finite(std::span(f).subspan(k, 3)))
      at = std::min(at, {X[k], X[k + 1], X[k + 2]});
  }
  int size;
  MPI_Comm_size(comm, &size);
  std::vector<std::array<double, 3>> all(size);
  MPI_Allgather(at.data(), 3, MPI_DOUBLE, all.data(), 3, MPI_DOUBLE, comm);
  at = *std::ranges::min_element(all);
  if (any(comm, prescribed))
    return "A prescribed displacement is not a finite number.";
  if (!std::isfinite(at[0]))
    return "A contact traction is not a finite number.";
  const std::string text
      = "The residual force is not finite near X = " + messages::point(at);
  const auto barely = find_barely_covered(_coupling, run.step, *run.state,
                                          run.iteration->interfaces);
  if (barely)
  {
    return text + ". "
           + messages::barely_covered(_coupling.interfaces[barely->second],
                                      barely->first);
  }
  return text + ": a load is not a finite number, or a cell is inside out.";
}
//-----------------------------------------------------------------------------
std::string Newton::find_barely() const
{
  if (any(_coupling.comm(), !_run->iteration))
    return "";
  const auto found = find_barely_covered(_coupling, _run->step, *_run->state,
                                         _run->iteration->interfaces);
  return found ? " "
                     + messages::barely_covered(
                         _coupling.interfaces[found->second], found->first)
               : "";
}
//-----------------------------------------------------------------------------
std::string Newton::find_hint() const
{
  if (slides_away())
    return messages::sliding();
  bool lost = false;
  for (std::size_t i = _history.size() > 5 ? _history.size() - 5 : 0;
       i < _history.size(); ++i)
    lost = lost or _history[i].active == 0;
  if (lost and _coupling.has_contact() and !is_held(_coupling))
    return messages::not_held();
  if (!any(_coupling.comm(), !_run->iteration))
  {
    const auto node
        = find_blocked(_coupling, _run->step, _run->iteration->interfaces);
    if (node)
      return messages::blocked(*node);
  }
  if (!_run->state->started and _run->start_overlap > 0.5)
    return messages::start_overlap(_run->start_overlap);
  return "";
}
//-----------------------------------------------------------------------------
std::string Newton::explain_reason(SNESConvergedReason reason) const
{
  if (_history.empty())
  {
    std::string why = "The residual is too large.";
    if (!any(_coupling.comm(), !_run->iteration))
    {
      const std::string infinite = find_infinite();
      why = infinite.empty() ? why : infinite;
    }
    return messages::not_begun(reason) + " " + why + messages::smaller_steps;
  }
  std::string text
      = messages::not_converged(reason, _history, _coupling.has_contact());
  const std::string hint = find_hint();
  if (!hint.empty())
    return text + " " + hint;
  if (!_run->failure.empty())
    text += " The last step had to be shortened: " + _run->failure;
  return text + find_barely() + messages::smaller_steps;
}

//-----------------------------------------------------------------------------
// What PETSc calls
//-----------------------------------------------------------------------------
template <typename Work>
void Newton::guarded(Work&& work)
{
  try
  {
    work();
  }
  catch (...)
  {
    _run->raised = std::current_exception();
  }
}
//-----------------------------------------------------------------------------
PetscErrorCode Newton::function(SNES, Vec x, Vec f, void* context)
{
  Newton& self = *static_cast<Newton*>(context);
  std::vector<double> residual;
  self.guarded(
      [&]
      {
        const Values values(x);
        residual = self.evaluate_at(values.get()).residual;
        const std::vector<double>& scale = self._run->row_scale;
        for (std::size_t i = 0; i < scale.size(); ++i)
          residual[i] *= scale[i];
        set_values(f, residual);
      });
  if (self._run->raised)
  {
    self._run->iteration.reset();
    PetscCall(VecSet(f, std::numeric_limits<double>::quiet_NaN()));
  }
  return PETSC_SUCCESS;
}
//-----------------------------------------------------------------------------
PetscErrorCode Newton::jacobian(SNES, Vec x, Mat, Mat, void* context)
{
  Newton& self = *static_cast<Newton*>(context);
  self.guarded([&] { self.linearise(Values(x).get()); });
  return PETSC_SUCCESS;
}
//-----------------------------------------------------------------------------
PetscErrorCode Newton::converged(SNES, PetscInt it, PetscReal, PetscReal,
                                 PetscReal norm, SNESConvergedReason* reason,
                                 void* context)
{
  Newton& self = *static_cast<Newton*>(context);
  *reason = SNES_DIVERGED_FNORM_NAN;
  self.guarded([&] { *reason = self.test(it, norm); });
  return PETSC_SUCCESS;
}
//-----------------------------------------------------------------------------
PetscErrorCode Newton::precheck(SNESLineSearch, Vec x, Vec y,
                                PetscBool* changed, void* context)
{
  Newton& self = *static_cast<Newton*>(context);
  *changed = PETSC_TRUE;
  Run& run = *self._run;
  int raised = static_cast<bool>(run.raised);
  MPI_Allreduce(MPI_IN_PLACE, &raised, 1, MPI_INT, MPI_LOR,
                self._coupling.comm());
  if (!raised)
    self.guarded([&] { self.shorten(Values(x).get(), y); });
  if (raised or run.raised)
    PetscCall(VecSet(y, 0.0)); // the iteration ends with this step
  return PETSC_SUCCESS;
}
//-----------------------------------------------------------------------------
PetscErrorCode Newton::monitor(SNES, PetscInt, PetscReal, void* context)
{
  const Newton& self = *static_cast<const Newton*>(context);
  int rank;
  MPI_Comm_rank(self._coupling.comm(), &rank);
  if (rank > 0 or self._history.empty())
    return PETSC_SUCCESS;
  const Iterate& last = self._history.back();
  if (self._coupling.has_contact())
  {
    PetscCall(PetscPrintf(
        PETSC_COMM_SELF, "      active %d (stick %d, slip %d), %d changed, ",
        static_cast<int>(last.active), static_cast<int>(last.stick),
        static_cast<int>(last.slip), static_cast<int>(last.changes)));
  }
  else
    PetscCall(PetscPrintf(PETSC_COMM_SELF, "      "));
  PetscCall(PetscPrintf(PETSC_COMM_SELF, "force %.3e, constraint %.3e\n",
                        last.force, last.constraint));
  return PETSC_SUCCESS;
}
//-----------------------------------------------------------------------------
PetscErrorCode Newton::multiply(Mat A, Vec x, Vec y)
{
  void* context;
  PetscCall(MatShellGetContext(A, &context));
  Newton& self = *static_cast<Newton*>(context);
  self.guarded(
      [&]
      {
        std::vector<double> f = self._run->system->multiply(Values(x).get());
        const std::vector<double>& scale = self._run->row_scale;
        for (std::size_t i = 0; i < scale.size(); ++i)
          f[i] *= scale[i];
        set_values(y, f);
      });
  if (self._run->raised)
    PetscCall(VecSet(y, std::numeric_limits<double>::quiet_NaN()));
  return PETSC_SUCCESS;
}
//-----------------------------------------------------------------------------
PetscErrorCode Newton::apply(PC pc, Vec x, Vec y)
{
  void* context;
  PetscCall(PCShellGetContext(pc, &context));
  Newton& self = *static_cast<Newton*>(context);
  Run& run = *self._run;
  int raised = static_cast<bool>(run.raised);
  MPI_Allreduce(MPI_IN_PLACE, &raised, 1, MPI_INT, MPI_LOR,
                self._coupling.comm());
  if (!raised)
  {
    self.guarded(
        [&]
        {
          if (!run.system)
          {
            throw std::runtime_error("The SNES asks for no Jacobian: let it "
                                     "form one in each solve.");
          }
          std::vector<double> r = local_values(x);
          for (std::size_t i = 0; i < run.row_scale.size(); ++i)
            r[i] /= run.row_scale[i];
          set_values(y, self._solver->solve(*run.system, r));
        });
  }
  if (raised or run.raised)
    PetscCall(VecSet(y, 0.0));
  return PETSC_SUCCESS;
}
