// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "problem.h"
#include "checks.h"
#include "convergence_error.h"
#include "messages.h"
#include <algorithm>
#include <cmath>
#include <dolfinx_mortar/dolfinx/timer.h>
#include <dolfinx_mortar/surface/patches.h>
#include <numbers>
#include <stdexcept>

using namespace dolfinx_mortar;

namespace
{
std::string tag_name(const std::vector<TaggedFacets>& parts)
{
  return "facet tag " + std::to_string(parts.front().tag);
}

/// Whether to condense the multipliers.
bool choose_condensation(std::optional<bool> condense,
                         const std::vector<InterfaceOptions>& interfaces)
{
  const bool dual = std::ranges::all_of(
      interfaces,
      [](auto& i) { return i.integration.space != MultiplierSpace::standard; });
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

std::vector<double> concatenate(std::span<const double> u,
                                std::span<const double> z)
{
  std::vector<double> x(u.begin(), u.end());
  x.insert(x.end(), z.begin(), z.end());
  return x;
}
} // namespace

//-----------------------------------------------------------------------------
Coupling dolfinx_mortar::create_coupling(
    Layout layout, std::span<const std::shared_ptr<const FunctionSpace>> spaces,
    std::span<const std::int8_t> prescribed,
    const std::vector<InterfaceOptions>& interfaces)
{
  std::vector<CoupledInterface> coupled;
  for (const InterfaceOptions& i : interfaces)
  {
    CoupledInterface c;
    c.contact = i.contact;
    c.min_coverage = i.min_coverage;
    c.feature_angle = i.feature_angle * std::numbers::pi / 180;
    c.x_slave = i.x_slave;
    c.x_master = i.x_master;
    c.slave_name = tag_name(i.slave);
    c.master_name = tag_name(i.master);
    Surface slave = create_surface(layout, spaces, i.slave, "slave");
    if (i.contact)
      slave = split_at_edges(slave, c.feature_angle);
    Surface master = create_surface(layout, spaces, i.master, "master");
    IntegrationOptions options = i.integration;
    options.leave_distant = i.contact.has_value();
    c.data = create_interface(std::move(slave), std::move(master), options);
    c.data.normal = i.normal;
    coupled.push_back(std::move(c));
  }
  return create_coupling(std::move(layout), std::move(coupled), prescribed);
}
//-----------------------------------------------------------------------------
ContactProblem::ContactProblem(
    MPI_Comm comm, std::vector<Body> bodies,
    std::vector<std::shared_ptr<const DirichletBC>> bcs,
    const std::vector<InterfaceOptions>& interfaces, ProblemOptions options)
    : _bodies(comm, std::move(bodies), std::move(bcs)),
      _coupling(create_coupling(_bodies.layout(), _bodies.spaces(),
                                _bodies.prescribed(), interfaces)),
      _warned(interfaces.size(), 0), _options(std::move(options))
{
  for (const InterfaceOptions& i : interfaces)
  {
    _friction.push_back(i.friction);
    _initial_active.push_back(i.initial_active);
  }
  _step = create_step(_coupling, _state);
  warn_of_lost_area(_step);
  _newton = std::make_unique<Newton>(
      _bodies, _coupling,
      SolverOptions(_options.petsc_options_prefix, _options.petsc_options),
      choose_condensation(_options.condense, interfaces), _options.poll);
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
  State state = _state;
  Step step = _step;
  step.friction = _friction;
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
  step = begin_step(_coupling, step, _friction, _bodies.local_displacements(),
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
    const std::vector<double> x = concatenate(u, state.z);
    double overlap = 0;
    if (_coupling.has_contact() and !state.started)
    {
      overlap = largest_overlap(_coupling, step, state);
      check_start(_coupling, step, _bodies.local_displacements());
      const Iteration first = evaluate(_bodies, _coupling, step, state, x);
      step.forced = initial_status(_coupling, step, state, first.interfaces,
                                   _initial_active, first.free_forces);
    }
    std::shared_ptr<const Evaluation> solution
        = _newton->solve(state, step, x, overlap);
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
  return _newton->num_iterations();
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
  Step step = begin_step(_coupling, _step, _friction, u, u, resumed);
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
    _step = resume_step(_coupling, _step, _friction, local, state);
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
  _friction.at(interface) = friction;
}
//-----------------------------------------------------------------------------
Resultants ContactProblem::resultants(std::size_t interface) const
{
  if (!_evaluation)
  {
    throw std::runtime_error(
        "There is no solution yet: call solve() of the ContactProblem first.");
  }
  const CoupledInterface& c = _coupling.interfaces.at(interface);
  BlockAccumulator<1, 1> D, M;
  integrate(c.data, _state.interfaces[interface].basis,
            _evaluation->interfaces[interface].geometry->configuration,
            {.D = &D, .M = &M});
  const std::int32_t rows = _coupling.size(), columns = _coupling.layout.size();
  std::vector<double> z(rows, 0.0);
  std::ranges::copy(
      _coupling.part(std::span<const double>(_state.z), interface, 3),
      _coupling.part(std::span(z), interface, 3).begin());
  std::vector<double> x = _coupling.layout.owned(_coupling.layout.X, 3);
  for (std::size_t i = 0; i < x.size() and c.is_current(); ++i)
    x[i] += _state.u[i];
  auto resultant = [&](BlockAccumulator<1, 1>& blocks, double sign)
  {
    const Matrix A = blocks.assemble(_coupling.comm(), rows, columns);
    const std::vector<double> f = multiply_transposed(A.get(), z);
    std::vector<double> sums(6, 0.0);
    for (std::size_t k = 0; k < f.size(); k += 3)
    {
      for (int d = 0; d < 3; ++d)
      {
        const int e = (d + 1) % 3, g = (d + 2) % 3;
        sums[d] += sign * f[k + d];
        sums[3 + d] += sign * (x[k + e] * f[k + g] - x[k + g] * f[k + e]);
      }
    }
    return sum(_coupling.comm(), std::move(sums));
  };
  const std::vector<double> s = resultant(D, -1), m = resultant(M, 1);
  return {{s[0], s[1], s[2]},
          {m[0], m[1], m[2]},
          {s[3], s[4], s[5]},
          {m[3], m[4], m[5]}};
}
//-----------------------------------------------------------------------------
Matrix ContactProblem::mortar_matrix(std::size_t interface, char which) const
{
  const CoupledInterface& c = _coupling.interfaces.at(interface);
  const std::vector<double> u = _bodies.local_displacements();
  auto [x, y] = interface_positions(c, c.is_current() ? &u : nullptr);
  const Configuration configuration
      = configure(c.data, std::move(x), std::move(y));
  BlockAccumulator<1, 1> blocks;
  MortarBlocks wanted;
  (which == 'D' ? wanted.D : wanted.M) = &blocks;
  integrate(c.data, _state.interfaces[interface].basis, configuration, wanted);
  return blocks.assemble(_coupling.comm(), _coupling.size(),
                         _coupling.layout.size());
}
//-----------------------------------------------------------------------------
Matrix ContactProblem::transformation(std::size_t interface, bool inverse) const
{
  std::vector<const std::vector<std::int8_t>*> flags;
  for (const InterfaceState& i : _state.interfaces)
    flags.push_back(&i.basis.nonnegative);
  const std::array<std::size_t, 1> which = {interface};
  return plus_identity(
      transformation_minus_one(_coupling, which, flags, inverse).get());
}
//-----------------------------------------------------------------------------
Matrix ContactProblem::inverse(std::size_t interface) const
{
  const CoupledInterface& c = _coupling.interfaces.at(interface);
  if (c.data.options.space != MultiplierSpace::dual)
  {
    throw std::runtime_error(
        "D has a sparse inverse with multiplier='dual' only: D⁻¹, P and "
        "constraints are not available with other multipliers.");
  }
  const auto& geometry = _evaluation
                             ? _evaluation->interfaces[interface].geometry
                             : _step.geometry[interface];
  std::vector<Entry> entries;
  std::vector<std::int8_t> used(_coupling.layout.num_blocks(), 0);
  bool several = false;
  for (std::int32_t k = 0; k < c.num_owned(); ++k)
  {
    if (!_state.interfaces[interface].basis.has_multiplier[k])
      continue;
    const std::int32_t own = _coupling.own_block(c, k);
    several = several or used[own]++;
    for (int d = 0; d < 3; ++d)
    {
      entries.push_back({3 * own + d, 3 * (c.first_node + k) + d,
                         1 / geometry->nodal.diagonal[k]});
    }
  }
  if (any(_coupling.comm(), several))
  {
    throw std::runtime_error(
        "D has no inverse where slave nodes on an edge carry one multiplier "
        "for each of the patches that meet there: D⁻¹ and P are not available. "
        "Tag one smooth side of the edge, or average normals over edges with "
        "feature_angle=180.");
  }
  const Matrix E = create_from_entries(
      _coupling.comm(), _coupling.layout.size(), _coupling.size(), entries);
  return multiply(transformation(interface, false).get(), E.get());
}
//-----------------------------------------------------------------------------
Matrix ContactProblem::constraint_matrix(std::size_t interface) const
{
  // Rows T (I_R - E D̃⁻¹ B̃_R) T⁻¹ of the slave dofs
  const CoupledInterface& c = _coupling.interfaces.at(interface);
  const std::int32_t n = _coupling.layout.size();
  const auto tied = tied_dofs(c, _state.interfaces[interface].basis);
  std::vector<double> kept(n, 1.0), rows(_coupling.size(), 0.0);
  for (std::size_t dof = 0; dof < tied.size(); ++dof)
  {
    rows[3 * c.first_node + dof] = 1;
    if (tied[dof])
      kept[3 * _coupling.own_block(c, dof / 3) + dof % 3] = 0;
  }
  const Matrix B = duplicate(_step.B_tilde_ties.get());
  scale_rows(B.get(), rows);
  scale_columns(B.get(), kept);
  const Matrix DB = multiply(inverse(interface).get(), B.get());
  std::vector<Entry> entries;
  for (std::int32_t dof = 0; dof < n; ++dof)
  {
    if (kept[dof] != 0)
      entries.push_back({dof, dof, 1.0});
  }
  const Matrix I_R = create_from_entries(_coupling.comm(), n, n, entries);
  const Matrix R = multiply(transformation(interface, false).get(), I_R.get());
  add(R.get(), -1.0, DB.get());
  return multiply(R.get(), transformation(interface, true).get());
}
