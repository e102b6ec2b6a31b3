// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "newton_system.h"
#include <algorithm>
#include <cmath>
#include <dolfinx_mortar/contact/derivative.h>
#include <dolfinx_mortar/dolfinx/timer.h>

using namespace dolfinx_mortar;

namespace
{
using RowMat3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

/// Contact conditions to be linearised, of each interface.
std::vector<ContactResidual> evaluate_laws(const Coupling& coupling,
                                           const Step& step, const State& state,
                                           const Evaluation& e, bool damped)
{
  std::vector<ContactResidual> laws(coupling.interfaces.size());
  for (std::size_t i = 0; i < laws.size(); ++i)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    if (c.is_tie())
      continue;
    if (!damped)
    {
      laws[i] = e.interfaces[i].law;
      continue;
    }
    laws[i] = evaluate_law(
        c.data, *c.contact, step.settings.friction[i], state.interfaces[i],
        e.interfaces[i], coupling.part(std::span<const double>(e.z), i, 3),
        c.blocks,
        step.forced.empty() ? std::span<const Status>()
                            : std::span<const Status>(step.forced[i]),
        true, step.normal_share);
  }
  return laws;
}

/// A symmetric matrix without its part of negative eigenvalues.
Eigen::Matrix2d positive_part(const Eigen::Matrix2d& A)
{
  const double mean = A.trace() / 2;
  const double radius = std::hypot((A(0, 0) - A(1, 1)) / 2, A(0, 1));
  const double low = mean - radius, high = mean + radius;
  if (low >= 0)
    return A;
  if (high <= 0)
    return Eigen::Matrix2d::Zero();
  return high / (high - low) * (A - low * Eigen::Matrix2d::Identity());
}

/// Stiffness of the law of friction at a slipping node, see MultiplierNodes.
///
/// Tractions turn with the motion: a node that has just begun to slip resists a
/// motion across its direction nearly as one that sticks. Along it the traction
/// only follows the pressure.
Eigen::Matrix3d stiffness_across_slip(const Eigen::Vector3d& normal,
                                      const Eigen::Matrix3d& dz,
                                      const Eigen::Matrix3d& dw)
{
  // Two tangents as rows
  Eigen::Matrix<double, 2, 3> axes;
  axes.row(0) = normal.unitOrthogonal().transpose();
  axes.row(1) = normal.cross(Eigen::Vector3d(axes.row(0))).transpose();
  const Eigen::Matrix2d by_z = axes * dz * axes.transpose();
  const Eigen::Matrix2d by_w = axes * dw * axes.transpose();
  // Where slip begins the law does not depend on the traction across: the node
  // sticks
  const double least = 1e-6 * std::max(by_z.squaredNorm(), 1e-300);
  double det = by_z.determinant();
  det = std::abs(det) < least ? least : det;
  const Eigen::Matrix2d cofactors
      = by_z.trace() * Eigen::Matrix2d::Identity() - by_z;
  const Eigen::Matrix2d S = cofactors * by_w / det;
  return axes.transpose() * positive_part((S + S.transpose()) / 2) * axes;
}

void set_contact_nodes(const CoupledInterface& c, const InterfaceEvaluation& e,
                       const ContactResidual& law, bool frictional,
                       MultiplierNodes& nodes)
{
  // The law of an edge is one of two nodes
  std::vector<std::int8_t> coupled(c.num_owned(), 0);
  for (std::int32_t k : law.couplings.rows)
    coupled[k] = 1;
  for (std::int32_t k = 0; k < c.num_owned(); ++k)
  {
    const std::int32_t j = c.first_node + k;
    const Status status = law.status[k];
    for (int d = 0; d < 3; ++d)
    {
      nodes.active[3 * j + d]
          = status != Status::open and !c.data.fixed[3 * k + d];
    }
    nodes.dz[j] = Eigen::Map<const RowMat3>(law.dz.data() + 9 * k);
    nodes.normals[j] = Eigen::Map<const Eigen::Vector3d>(
        e.geometry->configuration.normals.n.data() + 3 * k);
    if (status == Status::slip)
      nodes.directions[j] = nodes.normals[j] * nodes.normals[j].transpose();
    nodes.stick[j] = status == Status::stick;
    if (frictional and status == Status::slip and !coupled[k])
    {
      nodes.across[j] = stiffness_across_slip(
          nodes.normals[j], nodes.dz[j],
          Eigen::Map<const RowMat3>(law.dw.data() + 9 * k));
    }
  }
  const ContactCouplings& couplings = law.couplings;
  for (std::size_t i = 0; i < couplings.rows.size(); ++i)
  {
    nodes.coupled.push_back(
        {c.first_node + couplings.rows[i], c.first_node + couplings.columns[i],
         Eigen::Map<const RowMat3>(couplings.dz.data() + 9 * i)});
  }
}

MultiplierNodes create_nodes(const Coupling& coupling, const Step& step,
                             const State& state, const Evaluation& e,
                             const std::vector<ContactResidual>& laws)
{
  const std::size_t n = coupling.num_nodes;
  MultiplierNodes nodes;
  nodes.active.resize(3 * n, 0);
  nodes.own.resize(n);
  nodes.diagonal.resize(n);
  nodes.weight.resize(n);
  nodes.dz.resize(n, Eigen::Matrix3d::Identity());
  nodes.directions.resize(n, Eigen::Matrix3d::Identity());
  nodes.across.resize(n, Eigen::Matrix3d::Zero());
  nodes.normals.resize(n, Eigen::Vector3d::Zero());
  nodes.stick.resize(n, 0);
  for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    const InterfaceEvaluation& own = e.interfaces[i];
    for (std::int32_t k = 0; k < c.num_owned(); ++k)
    {
      nodes.own[c.first_node + k] = coupling.own_block(c, k);
      nodes.diagonal[c.first_node + k] = own.geometry->nodal.diagonal[k];
      nodes.weight[c.first_node + k] = own.geometry->nodal.weight[k];
    }
    if (!c.is_tie())
    {
      set_contact_nodes(c, own, laws[i], step.is_frictional(i), nodes);
      continue;
    }
    const auto tied = tied_dofs(c, state.interfaces[i].basis);
    for (std::size_t dof = 0; dof < tied.size(); ++dof)
    {
      const std::int32_t j = c.first_node + dof / 3;
      nodes.active[3 * j + dof % 3] = tied[dof];
      nodes.dz[j](dof % 3, dof % 3) = !tied[dof];
    }
  }
  return nodes;
}

/// Derivative of the constraints by the multipliers.
Matrix create_C_z(const Coupling& coupling, const MultiplierNodes& nodes)
{
  std::vector<Entry> entries;
  auto add
      = [&](std::int32_t row, std::int32_t column, const Eigen::Matrix3d& block)
  {
    for (int i = 0; i < 3; ++i)
    {
      for (int j = 0; j < 3; ++j)
        entries.push_back({3 * row + i, 3 * column + j, block(i, j)});
    }
  };
  for (std::size_t j = 0; j < nodes.size(); ++j)
    add(j, j, nodes.dz[j]);
  for (const auto& c : nodes.coupled)
    add(c.row, c.column, c.dz);
  return create_from_entries(coupling.comm(), coupling.size(), coupling.size(),
                             entries);
}

/// Add the rows of B that are constraints of ties.
void add_ties(const Coupling& coupling, const Step& step,
              const MultiplierNodes& nodes, BlockAccumulator<3, 3>& constraints)
{
  for (const CoupledInterface& c : coupling.interfaces)
  {
    if (!c.is_tie())
      continue;
    for (std::int32_t j = c.first_node; j < c.first_node + c.num_owned(); ++j)
    {
      RowMat3 block = RowMat3::Zero();
      for (int d = 0; d < 3; ++d)
        block(d, d) = nodes.active[3 * j + d];
      if (block.isZero(0))
        continue;
      const std::int64_t row = coupling.first_node + j;
      const MatrixRow b(step.B_ties.get(), 3 * row);
      for (std::size_t i = 0; i < b.columns().size(); ++i)
      {
        constraints.add(row, b.columns()[i] / 3, block.data(), b.values()[i]);
      }
    }
  }
}

/// Add a product of matrices, whose rows are those of the constraints.
void add_product(const Coupling& coupling, Mat A, Mat B,
                 BlockAccumulator<3, 3>& constraints)
{
  const Matrix AB = multiply(A, B);
  std::vector<double> values;
  std::vector<std::int64_t> columns;
  for (std::int64_t j = 0; j < coupling.num_nodes; ++j)
  {
    const std::int64_t row = coupling.first_node + j;
    // The three rows of a node have the same columns, three of each node
    columns.clear();
    values.clear();
    for (int d = 0; d < 3; ++d)
    {
      const MatrixRow r(AB.get(), 3 * row + d);
      for (std::size_t i = 0; d == 0 and i < r.columns().size(); i += 3)
        columns.push_back(r.columns()[i] / 3);
      values.insert(values.end(), r.values().begin(), r.values().end());
    }
    constraints.add(std::span(&row, 1), columns, values.data());
  }
}

/// Derivatives of constraints and forces by displacements. Collective.
void linearise_contacts(const Coupling& coupling, const Step& step,
                        const State& state, const Evaluation& e,
                        const std::vector<ContactResidual>& laws,
                        ContactDerivatives& derivatives)
{
  for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    if (c.is_tie())
      continue;
    const Configuration& configuration
        = e.interfaces[i].geometry->configuration;
    const bool frictional = step.is_frictional(i);
    if (!c.is_current())
    {
      add_matrix_derivatives(c.data, configuration, laws[i], true, frictional,
                             e.B_contact.get(), derivatives);
      continue;
    }
    add_current_derivatives(c.data, state.interfaces[i].basis, configuration,
                            laws[i], frictional,
                            local_multipliers(coupling, i, e.z), derivatives);
    if (frictional)
    {
      add_matrix_derivatives(c.data, configuration, laws[i], false, true,
                             step.B_old.get(), derivatives);
    }
  }
}
} // namespace

//-----------------------------------------------------------------------------
std::vector<double> NewtonSystem::multiply(std::span<const double> x) const
{
  using dolfinx_mortar::multiply;
  const std::span<const double> u = x.first(size_u), z = x.subspan(size_u);
  std::vector<double> f = multiply(K.get(), u);
  auto add = [](std::vector<double>& to, const std::vector<double>& more)
  {
    for (std::size_t i = 0; i < to.size(); ++i)
      to[i] += more[i];
  };
  add(f, multiply_transposed(B.get(), z));
  if (K_c)
    add(f, multiply(K_c.get(), u));
  for (std::int32_t dof : fixed)
    f[dof] = u[dof];
  std::vector<double> c = multiply(C_u.get(), u);
  add(c, multiply(C_z.get(), z));
  f.insert(f.end(), c.begin(), c.end());
  return f;
}
//-----------------------------------------------------------------------------
NewtonSystem dolfinx_mortar::linearise(const Coupling& coupling,
                                       const Step& step, const State& state,
                                       const Evaluation& evaluation, Matrix K,
                                       bool damped)
{
  Timer timer("~mortar: linearise");
  const std::vector<ContactResidual> laws
      = evaluate_laws(coupling, step, state, evaluation, damped);
  NewtonSystem s;
  s.comm = coupling.comm();
  s.size_u = coupling.layout.size();
  s.size_z = coupling.size();
  s.K = std::move(K);
  s.B = evaluation.B;
  s.B_tilde = evaluation.B_tilde;
  s.T_minus_one = step.T_minus_one;
  s.nodes = create_nodes(coupling, step, state, evaluation, laws);
  s.fixed = coupling.fixed_dofs;
  s.tied = !coupling.has_contact();
  s.C_z = create_C_z(coupling, s.nodes);

  ContactDerivatives derivatives;
  linearise_contacts(coupling, step, state, evaluation, laws, derivatives);
  if (step.B_ties)
    add_ties(coupling, step, s.nodes, derivatives.constraints);
  const bool current = std::ranges::any_of(coupling.interfaces, [](auto& i)
                                           { return i.is_current(); });
  if (current)
  {
    // The largest first: its blocks make room
    s.K_c = derivatives.force.assemble(s.comm, s.size_u, s.size_u);
    const Matrix by_normals
        = derivatives.by_normals.assemble(s.comm, s.size_z, s.size_z);
    const Matrix normals
        = derivatives.normals.assemble(s.comm, s.size_z, s.size_u);
    add_product(coupling, by_normals.get(), normals.get(),
                derivatives.constraints);
  }
  s.C_u = derivatives.constraints.assemble(s.comm, s.size_z, s.size_u);
  return s;
}
