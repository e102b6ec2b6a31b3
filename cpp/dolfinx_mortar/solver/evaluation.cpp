// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "evaluation.h"
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <dolfinx_mortar/dolfinx/timer.h>

using namespace dolfinx_mortar;

namespace
{
Eigen::Map<const Eigen::Vector3d> vector(std::span<const double> v,
                                         std::size_t j)
{
  return Eigen::Map<const Eigen::Vector3d>(v.data() + 3 * j);
}

/// B of contacts and of ties together.
void combine(const Step& step, const Matrix& B_contact,
             const Matrix& B_tilde_contact, Evaluation& e)
{
  if (!step.B_ties or !B_contact)
  {
    e.B = B_contact ? B_contact : step.B_ties;
    e.B_tilde = B_contact ? B_tilde_contact : step.B_tilde_ties;
    return;
  }
  e.B = duplicate(B_contact.get());
  add(e.B.get(), 1.0, step.B_ties.get());
  e.B_tilde = e.B;
  if (step.T)
  {
    e.B_tilde = duplicate(B_tilde_contact.get());
    add(e.B_tilde.get(), 1.0, step.B_tilde_ties.get());
  }
}

/// Set the geometry of all contacts. Collective.
/// @return B and B̃ of contacts.
std::pair<Matrix, Matrix> evaluate_geometry(const Coupling& coupling,
                                            const Step& step,
                                            const State& state,
                                            const std::vector<double>& u_local,
                                            Evaluation& e)
{
  if (step.B_frozen)
  {
    for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
      e.interfaces[i].geometry = step.geometry[i];
    return {step.B_frozen, step.B_tilde_frozen};
  }
  std::vector<std::size_t> which;
  std::vector<Configuration> configurations;
  {
    Timer timer("~mortar: search");
    for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
    {
      const CoupledInterface& c = coupling.interfaces[i];
      e.interfaces[i].geometry = step.geometry[i];
      if (c.is_tie())
        continue;
      which.push_back(i);
      configurations.push_back(configure(
          c, interface_positions(c, c.is_current() ? &u_local : nullptr),
          step.settings.offset[i]));
    }
  }
  std::vector<const Configuration*> pointers;
  for (const Configuration& c : configurations)
    pointers.push_back(&c);
  std::vector<NodalIntegrals> nodal;
  auto matrices
      = assemble_mortar(coupling, step, state, which, pointers, nodal);
  for (std::size_t k = 0; k < which.size(); ++k)
  {
    e.interfaces[which[k]].geometry = std::make_shared<InterfaceGeometry>(
        InterfaceGeometry{std::move(configurations[k]), std::move(nodal[k])});
  }
  return matrices;
}

/// Products with B that gaps and slips are made of; empty where not needed.
struct Moved
{
  std::vector<double> old;      // B_old (X + u)
  std::vector<double> total;    // B u
  std::vector<double> accepted; // B u_old
};

Moved move(const Coupling& coupling, const Step& step, Mat B,
           std::span<const double> u)
{
  Moved moved;
  if (step.B_old)
  {
    std::vector<double> x = coupling.layout.owned(coupling.layout.X, 3);
    for (std::size_t i = 0; i < x.size(); ++i)
      x[i] += u[i];
    moved.old = multiply(step.B_old.get(), x);
  }
  const bool frozen
      = std::ranges::any_of(coupling.interfaces, [](auto& i)
                            { return !i.is_tie() and !i.is_current(); });
  if (frozen)
  {
    moved.total = multiply(B, u);
    if (step.B_old)
      moved.accepted = multiply(B, step.u_old);
  }
  return moved;
}

/// Set gap and weighted slip of a contact.
void set_slip(const Coupling& coupling, std::size_t i, bool frictional,
              const Moved& moved, InterfaceEvaluation& e)
{
  const CoupledInterface& c = coupling.interfaces[i];
  const std::size_t n = c.num_owned();
  const NodalIntegrals& nodal = e.geometry->nodal;
  auto part = [&](const std::vector<double>& v)
  { return coupling.part(std::span<const double>(v), i, 3); };
  e.gap.assign(nodal.gap.begin(), nodal.gap.begin() + n);
  e.weighted_slip.clear();
  if (!c.is_current())
  {
    const auto total = part(moved.total);
    for (std::size_t j = 0; j < n; ++j)
    {
      e.gap[j] -= vector(e.geometry->configuration.normals.n, j)
                      .dot(vector(total, j));
    }
    if (frictional)
    {
      const auto accepted = part(moved.accepted);
      e.weighted_slip.assign(accepted.begin(), accepted.end());
      for (std::size_t j = 0; j < 3 * n; ++j)
        e.weighted_slip[j] -= total[j];
    }
  }
  else if (frictional)
  {
    const auto old = part(moved.old);
    e.weighted_slip.assign(nodal.jump.begin(), nodal.jump.begin() + 3 * n);
    for (std::size_t j = 0; j < 3 * n; ++j)
      e.weighted_slip[j] -= old[j];
  }
}

/// Evaluate the conditions of a contact.
void evaluate_contact(const Coupling& coupling, const Step& step,
                      const State& state, std::size_t i,
                      std::span<const double> z, InterfaceEvaluation& e)
{
  const CoupledInterface& c = coupling.interfaces[i];
  const InterfaceState& s = state.interfaces[i];
  const std::size_t n = c.num_owned();
  e.usable.resize(n);
  for (std::size_t j = 0; j < n; ++j)
  {
    e.usable[j] = s.basis.has_multiplier[j] and !step.barred[i][j]
                  and e.geometry->nodal.coverage[j] > 0;
  }
  const bool given = !step.scale.empty() and !step.scale[i].empty();
  e.scale = given ? step.scale[i] : s.scale;
  auto evaluate = [&]
  {
    e.law = evaluate_law(
        c.data, *c.contact, step.settings.friction[i], s, e, z, c.blocks,
        step.forced.empty() ? std::span<const Status>()
                            : std::span<const Status>(step.forced[i]),
        false, step.normal_share);
  };
  evaluate();
  if (step.is_frictional(i) and !given)
  {
    for (std::size_t j = 0; j < n; ++j)
    {
      if (e.law.bound[j] > 0)
        e.scale[j] = e.law.bound[j];
    }
    evaluate();
  }
}

/// Largest component of the contact conditions of a node [traction], with all
/// of c_n: where a node is closed, the part along its normal is c_n times the
/// gap.
/// @param[in] c,e Contact, and its evaluation.
/// @param[in] conditions Those of all owned nodes, shape (n, 3).
/// @param[in] k Node.
/// @param[in] normal_share Share of c_n that they were evaluated with.
double contact_measure(const CoupledInterface& c, const InterfaceEvaluation& e,
                       std::span<const double> conditions, std::int32_t k,
                       double normal_share)
{
  Eigen::Vector3d f(conditions.data() + 3 * k);
  if (normal_share < 1 and e.law.status[k] != Status::open)
  {
    Eigen::Vector3d n(e.geometry->configuration.normals.n.data() + 3 * k);
    for (int d = 0; d < 3; ++d)
    {
      if (c.data.fixed[3 * k + d])
        n[d] = 0;
    }
    f += (1 / normal_share - 1) * f.dot(n) * n;
  }
  return f.cwiseAbs().maxCoeff();
}
} // namespace

//-----------------------------------------------------------------------------
std::pair<Matrix, Matrix> dolfinx_mortar::assemble_mortar(
    const Coupling& coupling, const Step& step, const State& state,
    std::span<const std::size_t> which,
    std::span<const Configuration* const> configurations,
    std::vector<NodalIntegrals>& nodal)
{
  Timer timer("~mortar: integrate");
  BlockAccumulator<1, 1> B, B_tilde, M;
  const bool transformed = static_cast<bool>(step.T);
  const bool chained = coupling.chained and transformed;
  nodal.clear();
  for (std::size_t k = 0; k < which.size(); ++k)
  {
    nodal.push_back(integrate(coupling.interfaces[which[k]].data,
                              state.interfaces[which[k]].basis,
                              *configurations[k],
                              {.D = nullptr,
                               .M = chained ? &M : nullptr,
                               .B = &B,
                               .B_tilde = transformed ? &B_tilde : nullptr}));
  }
  const std::int32_t rows = coupling.size(), columns = coupling.layout.size();
  Matrix B_ = B.assemble(coupling.comm(), rows, columns);
  if (!transformed)
    return {B_, B_};
  Matrix B_tilde_ = B_tilde.assemble(coupling.comm(), rows, columns);
  if (chained)
  {
    // Masters of one interface may be slave nodes of another: - M (T - I)
    const Matrix M_ = M.assemble(coupling.comm(), rows, columns);
    add(B_tilde_.get(), -1.0, multiply(M_.get(), step.T_minus_one.get()).get());
  }
  return {B_, B_tilde_};
}
//-----------------------------------------------------------------------------
Evaluation dolfinx_mortar::evaluate(const Coupling& coupling, const Step& step,
                                    const State& state,
                                    const std::vector<double>& u_local,
                                    std::span<const double> u,
                                    std::span<const double> z)
{
  Evaluation e;
  e.u.assign(u.begin(), u.end());
  e.z.assign(z.begin(), z.end());
  e.constraints = e.z;
  e.interfaces.resize(coupling.interfaces.size());
  if (coupling.interfaces.empty())
  {
    e.force.assign(u.size(), 0.0);
    e.B = create_from_entries(coupling.comm(), 0, u.size(), {});
    e.B_tilde = e.B;
    return e;
  }
  Matrix B_tilde_contact;
  if (coupling.has_contact())
  {
    std::tie(e.B_contact, B_tilde_contact)
        = evaluate_geometry(coupling, step, state, u_local, e);
  }
  else
  {
    for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
      e.interfaces[i].geometry = step.geometry[i];
  }
  combine(step, e.B_contact, B_tilde_contact, e);
  e.force = multiply_transposed(e.B.get(), z);

  std::vector<double> jump;
  if (step.B_ties)
    jump = multiply(step.B_ties.get(), u);
  Moved moved;
  if (coupling.has_contact())
    moved = move(coupling, step, e.B_contact.get(), u);
  for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    const std::span<double> f = coupling.part(std::span(e.constraints), i, 3);
    if (c.is_tie())
    {
      const auto tied = tied_dofs(c, state.interfaces[i].basis);
      const auto own = coupling.part(std::span(jump), i, 3);
      for (std::size_t dof = 0; dof < tied.size(); ++dof)
      {
        if (tied[dof])
          f[dof] = own[dof];
      }
      continue;
    }
    set_slip(coupling, i, step.is_frictional(i), moved, e.interfaces[i]);
    evaluate_contact(coupling, step, state, i, coupling.part(z, i, 3),
                     e.interfaces[i]);
    std::ranges::copy(e.interfaces[i].law.value, f.begin());
  }
  return e;
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::accept(const Coupling& coupling, const Step& step,
                            const Evaluation& evaluation, State& state)
{
  for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    if (c.is_tie())
      continue;
    InterfaceState& s = state.interfaces[i];
    const InterfaceEvaluation& e = evaluation.interfaces[i];
    s.status = e.law.status;
    s.scale = e.scale;
    if (step.is_frictional(i))
    {
      accept_slip(c.data, e,
                  coupling.part(std::span<const double>(evaluation.z), i, 3),
                  s);
    }
  }
  state.u = evaluation.u;
  state.z = evaluation.z;
  state.started = true;
}
//-----------------------------------------------------------------------------
double dolfinx_mortar::constraint_measure(const Coupling& coupling,
                                          const Step& step, const State& state,
                                          const Evaluation& evaluation,
                                          double length)
{
  double worst = 0;
  const std::span<const double> all = evaluation.constraints, z = evaluation.z;
  for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    const InterfaceState& s = state.interfaces[i];
    const std::span<const double> f = coupling.part(all, i, 3);
    double largest = 0;
    if (c.is_tie())
    {
      const auto tied = tied_dofs(c, s.basis);
      const auto& weight = step.geometry[i]->nodal.weight;
      for (std::size_t dof = 0; dof < tied.size(); ++dof)
      {
        if (tied[dof])
        {
          largest
              = std::max(largest, std::abs(f[dof]) / std::abs(weight[dof / 3]));
        }
      }
      worst = std::max(worst, length > 0 ? largest / length : 0.0);
    }
    else
    {
      const double normal_share = c.contact->c_n ? 1.0 : step.normal_share;
      for (std::int32_t k = 0; k < c.num_owned(); ++k)
      {
        largest = std::max(largest, contact_measure(c, evaluation.interfaces[i],
                                                    f, k, normal_share));
      }
      worst = std::max(worst, largest
                                  / largest_traction(c.data, s, step.weights[i],
                                                     coupling.part(z, i, 3)));
    }
  }
  return max(coupling.comm(), worst);
}
//-----------------------------------------------------------------------------
std::vector<double>
dolfinx_mortar::force_scale(const Coupling& coupling, const Step& step,
                            std::span<const double> stiffness)
{
  std::vector<double> scale(coupling.size(), 1.0);
  for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    for (std::int32_t k = 0; k < c.num_owned(); ++k)
    {
      const double weight = std::abs(step.weights[i][k]);
      for (int d = 0; d < 3; ++d)
      {
        const double own = stiffness[3 * coupling.own_block(c, k) + d];
        scale[3 * (c.first_node + k) + d] = c.is_tie() ? own / weight : weight;
      }
    }
  }
  return scale;
}
