// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "evaluation.h"
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <dolfinx_mortar/assembly/basis.h>
#include <dolfinx_mortar/common/error.h>
#include <dolfinx_mortar/dolfinx/timer.h>
#include <iomanip>
#include <limits>
#include <numeric>
#include <sstream>
#include <stdexcept>

using namespace dolfinx_mortar;

namespace
{
using NodalFlags = std::vector<std::int8_t>;

std::vector<const NodalFlags*> nonnegative_flags(const State& state)
{
  std::vector<const NodalFlags*> flags;
  for (const InterfaceState& i : state.interfaces)
    flags.push_back(&i.basis.nonnegative);
  return flags;
}

/// Indices of the ties, or of the contacts.
std::vector<std::size_t> select(const Coupling& coupling, bool ties)
{
  std::vector<std::size_t> which;
  for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
  {
    if (coupling.interfaces[i].is_tie() == ties)
      which.push_back(i);
  }
  return which;
}

/// Form T anew, after a change of bases. Collective.
void update_transformation(const Coupling& coupling, const State& state,
                           Step& step)
{
  std::vector<std::size_t> all(coupling.interfaces.size());
  std::iota(all.begin(), all.end(), 0);
  step.T = {};
  step.T_minus_one = transformation_minus_one(coupling, all,
                                              nonnegative_flags(state), false);
  double norm;
  check(MatNorm(step.T_minus_one.get(), NORM_FROBENIUS, &norm), "MatNorm");
  if (norm == 0)
    step.T_minus_one = {};
  else
    step.T = plus_identity(step.T_minus_one.get());
}

/// Geometry of an interface in a configuration, in a given basis. Collective.
InterfaceGeometry create_geometry(const CoupledInterface& c, const Basis& basis,
                                  const std::vector<double>* u,
                                  const std::vector<double>& offset)
{
  InterfaceGeometry g;
  {
    Timer timer("~mortar: search");
    g.configuration = configure(c, interface_positions(c, u), offset);
  }
  g.nodal = integrate(c.data, basis, g.configuration);
  return g;
}

/// Change the basis of an interface. Collective.
void set_nonnegative(const Coupling& coupling, std::size_t i, NodalFlags flags,
                     State& state, Step& step)
{
  state.interfaces[i].basis.nonnegative = std::move(flags);
  const Interface& data = coupling.interfaces[i].data;
  step.weights[i] = nodal_weights(data, state.interfaces[i].basis.nonnegative,
                                  data.slave.X);
}

/// Adapt the multipliers of an interface to what masters cover. Collective.
/// @param[in] u Displacements of the local blocks; null for the reference
/// configuration.
/// @param[in,out] changed Set where that changes the basis transformation.
InterfaceGeometry choose(const Coupling& coupling, std::size_t i,
                         const std::vector<double>* u, State& state, Step& step,
                         std::vector<std::int8_t>& changed)
{
  const CoupledInterface& c = coupling.interfaces[i];
  Basis& basis = state.interfaces[i].basis;
  basis.has_multiplier = c.data.candidates;
  basis.idle.assign(c.data.candidates.size(), 0);
  InterfaceGeometry g = create_geometry(c, basis, u, step.settings.offset[i]);
  NodalFlags flags = flag_nonnegative(c.data, g.nodal.beyond);
  if (any(coupling.comm(), flags != basis.nonnegative))
  {
    changed[i] = 1;
    set_nonnegative(coupling, i, std::move(flags), state, step);
    g.nodal = integrate(c.data, basis, g.configuration);
  }
  return g;
}

/// Let interfaces agree on the basis at slave nodes that they share.
/// Collective.
/// @param[in] which Interfaces that take part.
/// @param[in,out] geometries Geometry of each of these.
void share_nonnegative(const Coupling& coupling,
                       std::span<const std::size_t> which,
                       std::span<InterfaceGeometry> geometries, State& state,
                       Step& step, std::vector<std::int8_t>& changed)
{
  if (!coupling.shared)
    return;
  NodalFlags shared(coupling.layout.num_local_blocks(), 0);
  for (std::size_t i : which)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    for (std::int32_t k = 0; k < c.num_owned(); ++k)
    {
      shared[c.data.slave.local_blocks[k]]
          |= state.interfaces[i].basis.nonnegative[k];
    }
  }
  for (std::size_t j = 0; j < which.size(); ++j)
  {
    const std::size_t i = which[j];
    const CoupledInterface& c = coupling.interfaces[i];
    NodalFlags flags(num_local_nodes(c.data.slave), 0);
    for (std::int32_t k = 0; k < c.num_owned(); ++k)
      flags[k] = shared[c.data.slave.local_blocks[k]];
    scatter_forward(c.data.slave, std::span(flags), 1);
    if (any(coupling.comm(), flags != state.interfaces[i].basis.nonnegative))
    {
      changed[i] = 1;
      set_nonnegative(coupling, i, std::move(flags), state, step);
      geometries[j].nodal = integrate(c.data, state.interfaces[i].basis,
                                      geometries[j].configuration);
    }
  }
}

/// Of patches that meet the same master surface at a node the one that faces it
/// best stays. On a plane the gaps of both sides of an edge are one condition:
/// both are the distance of the edge from the plane. Masters that face
/// different ways give one each.
NodalFlags find_repeated(const CoupledInterface& c, const InterfaceGeometry& g,
                         const NodalFlags& has_multiplier)
{
  using Vec3 = Eigen::Vector3d;
  const std::int32_t n = c.num_owned();
  NodalFlags barred(n, 0);
  const double same = std::cos(c.feature_angle);
  auto master = [&](std::int32_t k)
  {
    const Vec3 m(g.nodal.master_normal.data() + 3 * k);
    return Vec3(m / std::max(m.norm(), 1e-300));
  };
  auto opposed = [&](std::int32_t k)
  {
    const Vec3 own(g.configuration.normals.n.data() + 3 * k);
    return -master(k).dot(own);
  };
  for (std::size_t begin = 0, end = 0; begin < c.blocks.size(); begin = end)
  {
    std::vector<std::int32_t> nodes;
    for (; end < c.blocks.size() and c.blocks[end] == c.blocks[begin]; ++end)
    {
      if (has_multiplier[end])
        nodes.push_back(end);
    }
    if (end - begin < 2)
      continue;
    std::ranges::stable_sort(nodes, std::greater{}, opposed);
    std::vector<std::int32_t> kept;
    for (std::int32_t j : nodes)
    {
      if (std::ranges::any_of(kept, [&](auto k)
                              { return master(j).dot(master(k)) > same; }))
        barred[j] = 1;
      else
        kept.push_back(j);
    }
  }
  return barred;
}

/// Let only nodes carry a multiplier that a master covers enough.
void drop_uncovered(const Coupling& coupling, std::size_t i,
                    const InterfaceGeometry& g, State& state, Step& step)
{
  const CoupledInterface& c = coupling.interfaces[i];
  Basis& basis = state.interfaces[i].basis;
  NodalFlags& flags = basis.has_multiplier;
  for (std::size_t k = 0; k < flags.size(); ++k)
  {
    const bool covered
        = g.nodal.coverage[k] > c.min_coverage * step.weights[i][k];
    flags[k] = c.data.candidates[k] and covered;
    // Shared among the neighbours, the gap of a node that masters do not touch
    // would count as theirs: a master that comes under the side of a fillet
    // would lift the nodes that it rests on. Left out, the node is open, as it
    // is with a multiplier once it is covered. Where geometry is frozen, gaps
    // are not those of the integrals.
    basis.idle[k] = c.is_current() and c.data.candidates[k] and !covered
                    and !g.nodal.near[k];
  }
  if (!c.is_tie())
    step.barred[i] = find_repeated(c, g, flags);
}

/// Form anew what depends on bases that have changed. Collective.
void change_basis(const Coupling& coupling,
                  const std::vector<std::int8_t>& changed, const State& state,
                  Step& step)
{
  if (std::ranges::none_of(changed, [](auto c) { return c; }))
    return;
  update_transformation(coupling, state, step);
  const std::vector<std::size_t> ties = select(coupling, true);
  if (ties.empty())
    return;
  std::vector<const Configuration*> configurations;
  for (std::size_t i : ties)
    configurations.push_back(&step.geometry[i]->configuration);
  std::vector<NodalIntegrals> nodal;
  std::tie(step.B_ties, step.B_tilde_ties)
      = assemble_mortar(coupling, step, state, ties, configurations, nodal);
  for (std::size_t j = 0; j < ties.size(); ++j)
  {
    step.geometry[ties[j]]
        = std::make_shared<InterfaceGeometry>(InterfaceGeometry{
            step.geometry[ties[j]]->configuration, std::move(nodal[j])});
  }
}

void check_multipliers(const Coupling& coupling, const NodalIntegrals& nodal)
{
  std::ostringstream message;
  if (nodal.num_without_multipliers > 0)
  {
    message << std::setprecision(6) << "Slave facet at ("
            << nodal.without_multipliers[0] << ", "
            << nodal.without_multipliers[1] << ", "
            << nodal.without_multipliers[2]
            << ") has no node that can carry a multiplier: all its nodes "
               "belong to other interfaces or to Dirichlet boundaries. Refine "
               "the slave surface there, or swap slave and master.";
  }
  throw_on_all(coupling.comm(), message.str());
}

/// "[0 0 1] to [1 1 1]", the box around a surface. Collective.
std::string box(const Surface& s)
{
  constexpr double infinity = std::numeric_limits<double>::infinity();
  std::array<double, 6> corners;
  corners.fill(infinity);
  for (std::int32_t k = 0; k < 3 * s.num_owned; ++k)
  {
    corners[k % 3] = std::min(corners[k % 3], s.X[k]);
    corners[3 + k % 3] = std::min(corners[3 + k % 3], -s.X[k]);
  }
  MPI_Allreduce(MPI_IN_PLACE, corners.data(), 6, MPI_DOUBLE, MPI_MIN, s.comm);
  std::ostringstream text;
  text << std::setprecision(4) << "[" << corners[0] << " " << corners[1] << " "
       << corners[2] << "] to [" << -corners[3] << " " << -corners[4] << " "
       << -corners[5] << "]";
  return text.str();
}

void check_met(const Coupling& coupling, const CoupledInterface& c,
               const NodalIntegrals& nodal)
{
  if (sum(coupling.comm(), nodal.num_covered) > 0)
    return;
  throw std::runtime_error("No slave facet meets a master facet: slave ("
                           + c.slave_name + ") spans " + box(c.data.slave)
                           + ", master (" + c.master_name + ") "
                           + box(c.data.master)
                           + ". Check the tags, that the surfaces face each "
                             "other, and search_distance.");
}
/// Set what an iterate is compared with: matrices of the last accepted step,
/// and those of frozen geometry. Collective.
void remember_accepted(const Coupling& coupling,
                       const std::vector<double>& u_old, const State& state,
                       Step& step)
{
  step.u_old = coupling.layout.owned(u_old, 3);
  step.B_old = step.B_frozen = step.B_tilde_frozen = {};
  const std::vector<std::size_t> contacts = select(coupling, false);
  bool frictional = false, frozen = !contacts.empty();
  for (std::size_t i : contacts)
  {
    frictional = frictional or step.is_frictional(i);
    frozen = frozen and !coupling.interfaces[i].is_current();
  }
  if (!frictional and !frozen)
    return;
  std::vector<Configuration> configurations;
  for (std::size_t i : contacts)
  {
    Timer timer("~mortar: search");
    const CoupledInterface& c = coupling.interfaces[i];
    configurations.push_back(
        configure(c, interface_positions(c, c.is_current() ? &u_old : nullptr),
                  step.settings.offset[i]));
  }
  std::vector<const Configuration*> pointers;
  for (const Configuration& c : configurations)
    pointers.push_back(&c);
  std::vector<NodalIntegrals> nodal;
  auto [B, B_tilde]
      = assemble_mortar(coupling, step, state, contacts, pointers, nodal);
  if (frictional)
    step.B_old = B;
  if (!frozen)
    return;
  step.B_frozen = B;
  step.B_tilde_frozen = B_tilde;
  for (std::size_t j = 0; j < contacts.size(); ++j)
  {
    step.geometry[contacts[j]] = std::make_shared<InterfaceGeometry>(
        InterfaceGeometry{std::move(configurations[j]), std::move(nodal[j])});
  }
}
} // namespace

//-----------------------------------------------------------------------------
Step dolfinx_mortar::create_step(const Coupling& coupling, State& state)
{
  const std::size_t num = coupling.interfaces.size();
  Step step;
  step.geometry.resize(num);
  step.weights.resize(num);
  step.barred.resize(num);
  step.settings.friction.resize(num);
  step.settings.offset.resize(num);
  state = {};
  state.z.assign(coupling.size(), 0.0);
  for (const CoupledInterface& c : coupling.interfaces)
    state.interfaces.emplace_back().basis = create_basis(c.data);
  for (std::size_t i = 0; i < num; ++i)
  {
    set_nonnegative(coupling, i, state.interfaces[i].basis.nonnegative, state,
                    step);
  }
  if (num == 0)
    return step;

  const std::vector<std::size_t> ties = select(coupling, true);
  std::vector<std::int8_t> changed(num, 0);
  std::vector<InterfaceGeometry> geometries;
  for (std::size_t i : ties)
    geometries.push_back(choose(coupling, i, nullptr, state, step, changed));
  share_nonnegative(coupling, ties, geometries, state, step, changed);
  for (std::size_t j = 0; j < ties.size(); ++j)
  {
    check_multipliers(coupling, geometries[j].nodal);
    check_met(coupling, coupling.interfaces[ties[j]], geometries[j].nodal);
    drop_uncovered(coupling, ties[j], geometries[j], state, step);
    step.geometry[ties[j]]
        = std::make_shared<InterfaceGeometry>(std::move(geometries[j]));
  }
  change_basis(coupling, std::vector<std::int8_t>(num, 1), state, step);
  return step;
}
//-----------------------------------------------------------------------------
Step dolfinx_mortar::begin_step(const Coupling& coupling, const Step& before,
                                const Settings& settings,
                                const std::vector<double>& u,
                                const std::vector<double>& u_old, State& state)
{
  Step step = before;
  step.settings = settings;
  const std::vector<std::size_t> contacts = select(coupling, false);
  std::vector<std::size_t> all;
  std::vector<std::int8_t> changed(coupling.interfaces.size(), 0);
  std::vector<InterfaceGeometry> geometries;
  for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    all.push_back(i);
    geometries.push_back(c.is_tie() ? *step.geometry[i]
                                    : choose(coupling, i,
                                             c.is_current() ? &u : nullptr,
                                             state, step, changed));
  }
  share_nonnegative(coupling, all, geometries, state, step, changed);
  change_basis(coupling, changed, state, step);
  for (std::size_t i : contacts)
  {
    drop_uncovered(coupling, i, geometries[i], state, step);
    // Lets be seen what was left out, also before anything is evaluated
    step.geometry[i]
        = std::make_shared<InterfaceGeometry>(std::move(geometries[i]));
    InterfaceState& s = state.interfaces[i];
    const std::size_t n = coupling.interfaces[i].num_owned();
    s.slip.resize(3 * n, 0.0);
    s.status.resize(n, Status::open);
  }
  remember_accepted(coupling, u_old, state, step);
  return step;
}
//-----------------------------------------------------------------------------
Step dolfinx_mortar::resume_step(const Coupling& coupling, const Step& before,
                                 const Settings& settings,
                                 const std::vector<double>& u,
                                 const State& state)
{
  Step step = before;
  step.settings = settings;
  const std::vector<std::int8_t> changed(coupling.interfaces.size(), 1);
  for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    const Basis& basis = state.interfaces[i].basis;
    step.weights[i] = nodal_weights(c.data, basis.nonnegative, c.data.slave.X);
    step.barred[i].assign(c.is_tie() ? 0 : c.num_owned(), 0);
    if (any(coupling.comm(), !c.is_tie() and !c.blocks.empty()))
    {
      const InterfaceGeometry g = create_geometry(
          c, basis, c.is_current() ? &u : nullptr, settings.offset[i]);
      step.barred[i] = find_repeated(c, g, basis.has_multiplier);
    }
  }
  change_basis(coupling, changed, state, step);
  remember_accepted(coupling, u, state, step);
  return step;
}
