// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "problem.h"
#include "checks.h"
#include "convergence_error.h"
#include "factorisation_work.h"
#include "messages.h"
#include <algorithm>
#include <cmath>
#include <dolfinx_mortar/common/error.h>
#include <dolfinx_mortar/dolfinx/timer.h>
#include <dolfinx_mortar/multiplier/multiplier.h>
#include <stdexcept>

using namespace dolfinx_mortar;

namespace
{
/// Whether to condense the multipliers.
bool choose_condensation(std::optional<bool> condense, const Coupling& coupling)
{
  const bool dual
      = std::ranges::all_of(coupling.interfaces, [](const CoupledInterface& i)
                            { return is_dual(i.data.options.space); });
  if (condense.value_or(false) and !dual)
  {
    throw std::invalid_argument(
        "Standard multipliers cannot be condensed: leave condense out, or use "
        "multiplier='dual'.");
  }
  return condense.value_or(dual);
}

/// What a solution that cannot be meant is said to be; empty where it can.
/// Collective.
std::string describe_solution(const Bodies& bodies, const Coupling& coupling,
                              const Step& step, const Evaluation& evaluation)
{
  const bool current = std::ranges::any_of(coupling.interfaces, [](auto& i)
                                           { return i.is_current(); });
  std::string text;
  if (current)
  {
    const Bodies::Inverted cells = bodies.find_inverted();
    if (cells.number > 0)
      text = messages::inverted(cells);
    const std::vector<double> before = bodies.extend(step.u_old),
                              after = bodies.local_displacements();
    for (std::size_t i = 0; i < coupling.interfaces.size() and text.empty();
         ++i)
    {
      if (!coupling.interfaces[i].is_current())
        continue;
      const Depth inside = find_deep_facet(
          coupling, i, *evaluation.interfaces[i].geometry, after);
      if (inside.depth > 0)
        text = messages::deep_facet(inside);
      else
      {
        const Depth passed = find_passage(coupling, i, before, after);
        if (passed.depth > 0)
          text = messages::passage(passed);
      }
      if (!text.empty())
        text += " It has passed through the surface in this step.";
    }
  }
  if (!text.empty())
    text += messages::smaller_steps;
  else if (const auto node = find_blocked(coupling, step, evaluation))
    text = messages::blocked(*node);
  return text.empty()
             ? text
             : "The solve converged to a state that cannot be meant. " + text;
}

/// Refuse to begin with bodies deep inside each other. Collective.
void check_start(const Coupling& coupling, const Step& step,
                 const std::vector<double>& u)
{
  for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    if (c.is_tie())
      continue;
    // Frozen geometry is that without displacements
    const Depth inside = find_deep_facet(
        coupling, i, *step.geometry[i],
        c.is_current() ? u : std::vector<double>(u.size(), 0.0));
    if (inside.depth > 0)
    {
      throw std::runtime_error(
          messages::deep_facet(inside)
          + " Begin with the bodies apart, and bring them together in load "
            "steps; or give the contact a search_distance of at least that "
            "depth, if it is to push them apart in one step.");
    }
  }
}

/// Refuse a state of another problem. Collective.
void check_state(const Coupling& coupling, const State& state)
{
  const std::size_t n = coupling.layout.size(), m = coupling.size();
  bool fits = state.z.size() == m
              and (state.u.size() == n or (state.u.empty() and !state.started))
              and state.interfaces.size() == coupling.interfaces.size();
  for (std::size_t i = 0; fits and i < state.interfaces.size(); ++i)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    const InterfaceState& s = state.interfaces[i];
    const std::size_t local = num_local_nodes(c.data.slave);
    const std::size_t owned = c.num_owned();
    for (const auto* flags :
         {&s.basis.has_multiplier, &s.basis.nonnegative, &s.basis.idle})
      fits = fits and flags->size() == local;
    if (c.is_tie() or !state.started)
      continue;
    fits = fits and s.status.size() == owned and s.slip.size() == 3 * owned;
    for (const auto* values : {&s.c_n, &s.c_t, &s.scale})
      fits = fits and values->size() == owned;
  }
  if (any(coupling.comm(), !fits))
    throw std::invalid_argument("The state is that of another problem.");
}

/// Some node of this rank is in contact.
bool is_touching(const Evaluation& evaluation)
{
  return std::ranges::any_of(evaluation.interfaces,
                             [](const InterfaceEvaluation& i)
                             {
                               return std::ranges::any_of(
                                   i.law.status,
                                   [](Status s) { return s != Status::open; });
                             });
}

std::vector<double> concatenate(std::span<const double> u,
                                std::span<const double> z)
{
  std::vector<double> x(u.begin(), u.end());
  x.insert(x.end(), z.begin(), z.end());
  return x;
}
} // namespace

//-----------------------------------------------------------------------------
ContactProblem::ContactProblem(
    MPI_Comm comm, std::vector<Body> bodies,
    std::vector<std::shared_ptr<const DirichletBC>> bcs,
    const std::vector<InterfaceOptions>& interfaces, ProblemOptions options)
    : _bodies(comm, std::move(bodies), std::move(bcs), tools_of(interfaces)),
      _coupling(create_coupling(_bodies.layout(), _bodies.spaces(),
                                _bodies.prescribed(), interfaces)),
      _warned(interfaces.size(), 0), _options(std::move(options))
{
  for (const InterfaceOptions& i : interfaces)
  {
    _settings.friction.push_back(i.friction);
    _settings.offset.emplace_back();
    _initial_active.push_back(i.initial_active);
  }
  _step = create_step(_coupling, _state);
  warn_of_lost_area(_step);
  if (_options.stabilise > 0)
    check_loose(_coupling);
  const bool condense = choose_condensation(_options.condense, _coupling);
  SolverOptions solver(_options.petsc_options_prefix, _options.petsc_options,
                       !condense, [this] { return is_large(_bodies); });
  int rank;
  MPI_Comm_rank(_coupling.comm(), &rank);
  if (rank == 0 and solver.is_multigrid_by_size())
  {
    log_info("Linear systems of a model of this size and shape are solved by "
             "GMRES with algebraic multigrid; "
             "petsc_options={\"pc_type\": \"lu\"} is the direct solver.");
  }
  _newton = std::make_unique<Newton>(_bodies, _coupling, std::move(solver),
                                     condense, _options.poll);
}
//-----------------------------------------------------------------------------
ContactProblem::~ContactProblem() = default;
//-----------------------------------------------------------------------------
void ContactProblem::warn_of_lost_area(const Step& step) const
{
  int rank;
  MPI_Comm_rank(_coupling.comm(), &rank);
  for (std::size_t i = 0; i < _coupling.interfaces.size(); ++i)
  {
    const CoupledInterface& c = _coupling.interfaces[i];
    if (_warned[i] or !step.geometry[i])
      continue;
    const auto facet = find_lost(c, *step.geometry[i]);
    _warned[i] = facet.has_value();
    if (facet and rank == 0)
      log_warning(messages::lost(c, *facet));
  }
}
//-----------------------------------------------------------------------------
void ContactProblem::check_unchanged() const
{
  std::string message;
  if (_bodies.meshes_moved())
    message = "A mesh has been moved since the problem was made";
  else
  {
    const std::vector<std::int8_t> flags
        = _coupling.layout.owned(_bodies.prescribed(), 3);
    std::vector<std::int32_t> fixed;
    for (std::size_t dof = 0; dof < flags.size(); ++dof)
    {
      if (flags[dof])
        fixed.push_back(dof);
    }
    if (any(_coupling.comm(), fixed != _coupling.fixed_dofs))
      message = "The Dirichlet conditions are not on the dofs they were on";
  }
  if (!message.empty())
  {
    throw std::runtime_error(
        message
        + ": the interfaces are still those of before. Make new interfaces and "
          "a new ContactProblem. Motions belong into the displacement, "
          "changing loads and boundary values into a fem.Constant or "
          "fem.Function.");
  }
}
//-----------------------------------------------------------------------------
std::pair<State, Step> ContactProblem::begin() const
{
  _bodies.forget_tangents(); // loads and materials may have changed
  State state = _state;
  Step step = _step;
  step.settings = _settings;
  if (state.u.empty())
    state.u = _bodies.displacements();
  step.u_old = state.u;
  if (!_coupling.has_contact())
    return {std::move(state), std::move(step)};
  if (!state.started)
  {
    const std::vector<double> stiffness = diagonal(_bodies.tangent().get());
    for (std::size_t i = 0; i < _coupling.interfaces.size(); ++i)
    {
      const CoupledInterface& c = _coupling.interfaces[i];
      if (c.is_tie())
        continue;
      std::vector<double> k(c.num_owned(), 0.0);
      for (std::size_t j = 0; j < k.size(); ++j)
      {
        const double* d = stiffness.data() + 3 * _coupling.own_block(c, j);
        k[j] = (std::abs(d[0]) + std::abs(d[1]) + std::abs(d[2])) / 3;
      }
      set_parameters(*c.contact, std::span(step.weights[i]).first(k.size()), k,
                     state.interfaces[i]);
    }
  }
  step = begin_step(_coupling, step, _settings, _bodies.local_displacements(),
                    _bodies.extend(state.u), state);
  warn_of_lost_area(step);
  return {std::move(state), std::move(step)};
}
//-----------------------------------------------------------------------------
int ContactProblem::solve()
{
  _newton->check_type();
  check_unchanged();
  const std::vector<double> u = _bodies.displacements();
  try
  {
    auto [state, step] = begin();
    const std::vector<double> x = concatenate(_bodies.unknowns(), state.z);
    double overlap = 0;
    if (_coupling.has_contact() and !state.started)
    {
      overlap = largest_overlap(_coupling, step, state);
      check_start(_coupling, step, _bodies.local_displacements());
      const Iteration first = evaluate(_bodies, _coupling, step, state, x);
      step.forced = initial_status(_coupling, step, state, first.interfaces,
                                   _initial_active, first.free_forces);
    }
    std::shared_ptr<const Evaluation> solution;
    if (_options.stabilise > 0)
      solution = solve_stabilised(state, step, x, overlap);
    else
    {
      solution = _newton->solve(state, step, x, overlap);
      _num_iterations = _newton->num_iterations();
    }
    step.forced.clear();
    const std::string wrong
        = describe_solution(_bodies, _coupling, step, *solution);
    if (!wrong.empty())
      throw ConvergenceError(wrong);
    if (_options.poll)
      _options.poll();
    accept(_coupling, step, *solution, state);
    _state = std::move(state);
    _step = std::move(step);
    _evaluation = std::move(solution);
  }
  catch (...)
  {
    _bodies.set_displacements(u);
    throw;
  }
  return _num_iterations;
}
//-----------------------------------------------------------------------------
std::shared_ptr<const Evaluation>
ContactProblem::solve_stabilised(State& state, Step& step,
                                 std::span<const double> x, double overlap)
{
  const std::vector<double> u = _bodies.displacements();
  const std::vector<double> springs
      = create_springs(_coupling, u, diagonal(_bodies.tangent().get()));
  std::vector<double> from(x.begin(), x.end());
  std::shared_ptr<const Evaluation> solution;
  _num_iterations = 0;
  for (double stage : stabilisation_stages)
  {
    if (solution)
    {
      step = begin_step(_coupling, step, _settings,
                        _bodies.local_displacements(), _bodies.extend(state.u),
                        state);
    }
    step.spring_origin.assign(x.begin(), x.begin() + u.size());
    step.springs = springs;
    for (double& k : step.springs)
      k *= stage * _options.stabilise;
    // A body that has come near to another one by now meets it on its way
    if (solution and !any(_coupling.comm(), is_touching(*solution)))
    {
      const Iteration first = evaluate(_bodies, _coupling, step, state, from);
      step.forced = initial_status(_coupling, step, state, first.interfaces,
                                   _initial_active, first.free_forces);
    }
    try
    {
      solution = _newton->solve(state, step, from, overlap);
    }
    catch (const ConvergenceError& error)
    {
      throw ConvergenceError(error.what()
                             + (solution ? messages::with_springs(stage)
                                         : messages::stiffer_springs()));
    }
    _num_iterations += _newton->num_iterations();
    from = concatenate(_bodies.unknowns(), solution->z);
    step.forced.clear();
    _stabilisation = measure_stabilisation(_coupling, step, *solution,
                                           std::span(from).first(u.size()));
  }
  step.springs.clear();
  step.spring_origin.clear();
  if (std::max(_stabilisation.force, _stabilisation.energy_share)
      > negligible_stabilisation)
    throw ConvergenceError(messages::stabilised(_stabilisation));
  return solution;
}
//-----------------------------------------------------------------------------
int ContactProblem::solve(const std::function<void(double)>& load, int max_cuts)
{
  const std::vector<double> u = _bodies.displacements();
  const State state = _state;
  const Step step = _step;
  const std::shared_ptr<const Evaluation> evaluation = _evaluation;
  int total = 0;
  try
  {
    double done = 0, part = 1;
    while (done < 1)
    {
      const double target = std::min(1.0, done + part);
      load(target);
      try
      {
        total += solve();
      }
      catch (const ConvergenceError&)
      {
        part /= 2;
        if (part < std::pow(0.5, max_cuts))
          throw;
        continue;
      }
      done = target;
      part = done < 1 ? std::min(2 * part, 1 - done) : part;
    }
  }
  catch (...)
  {
    _state = state;
    _step = step;
    _evaluation = evaluation;
    _bodies.set_displacements(u);
    throw;
  }
  return total;
}
//-----------------------------------------------------------------------------
void ContactProblem::resume(const State& state)
{
  check_state(_coupling, state);
  _bodies.set_displacements(state.u);
  const std::vector<double> u = _bodies.local_displacements();
  State resumed = state;
  Step step = begin_step(_coupling, _step, _settings, u, u, resumed);
  _evaluation = std::make_shared<Evaluation>(
      evaluate(_coupling, step, resumed, u, state.u, resumed.z));
  for (std::size_t i = 0; i < _coupling.interfaces.size(); ++i)
  {
    if (!_coupling.interfaces[i].is_tie())
      resumed.interfaces[i].status = _evaluation->interfaces[i].law.status;
  }
  _state = std::move(resumed);
  _step = std::move(step);
}
//-----------------------------------------------------------------------------
void ContactProblem::restore(const State& state, std::span<const double> u)
{
  check_state(_coupling, state);
  _evaluation.reset();
  if (state.started)
  {
    _bodies.set_displacements(state.u);
    const std::vector<double> local = _bodies.local_displacements();
    _step = resume_step(_coupling, _step, _settings, local, state);
    _evaluation = std::make_shared<Evaluation>(
        evaluate(_coupling, _step, state, local, state.u, state.z));
  }
  _state = state;
  _bodies.set_displacements(u);
}
//-----------------------------------------------------------------------------
void ContactProblem::set_friction(std::size_t interface,
                                  const Friction& friction)
{
  _settings.friction.at(interface) = friction;
}
//-----------------------------------------------------------------------------
void ContactProblem::set_offset(std::size_t interface,
                                std::vector<double> offset)
{
  const CoupledInterface& c = _coupling.interfaces.at(interface);
  const Surface& s = c.data.slave;
  auto finite = [](double v) { return std::isfinite(v); };
  const bool none = !any(_coupling.comm(), !offset.empty());
  std::string message;
  if (c.is_tie())
    message = "A tie has no gap that an offset could be added to.";
  else if (!none
           and static_cast<std::int32_t>(offset.size()) != num_local_nodes(s))
  {
    message = "The offset needs a value for each local slave node.";
  }
  else if (!std::all_of(offset.begin(),
                        offset.begin() + (none ? 0 : s.num_owned), finite))
    message = "The offset is not finite at all slave nodes.";
  throw_on_all(_coupling.comm(), message);
  if (!none)
    scatter_forward(s, std::span(offset), 1);
  _settings.offset.at(interface) = std::move(offset);
}
