// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "first_contact.h"
#include "checks.h"
#include "rigid_motions.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <dolfinx_mortar/common/dense.h>
#include <limits>

using namespace dolfinx_mortar;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace
{
constexpr double infinity = std::numeric_limits<double>::infinity();

/// How much further away [size of a node's area] than the first node others may
/// be.
constexpr double patch = 0.2;

/// The same, for nodes that a body meets first on its way; the smallest that
/// holds it, so that those nodes are few which contact, in a bore, has to let
/// go again.
constexpr std::array<double, 4> first_patches = {0.005, 0.02, 0.05, 0.2};

/// Nodes of a contact, their gaps and how fast these close.
struct Approach
{
  std::vector<std::int8_t> usable;
  std::vector<double> gap, size; // [length], shape (num_owned)
  MatrixXd relative;             // see relative_motions
  VectorXd rate;                 // of closing in the motion that loads drive
  bool frictional = false;

  Eigen::Vector3d normal(std::size_t k) const
  {
    return Eigen::Map<const Eigen::Vector3d>(normals.data() + 3 * k);
  }
  std::span<const double> normals;
};

/// Nodes that are nearest to a master: a patch, that keeps a body from tilting.
std::vector<std::int8_t> nearest(MPI_Comm comm, const Approach& a)
{
  double least = infinity;
  for (double g : a.gap)
    least = std::min(least, g);
  least = min(comm, least);
  std::vector<std::int8_t> flags(a.gap.size(), 0);
  for (std::size_t k = 0; k < flags.size(); ++k)
  {
    flags[k] = std::isfinite(least) and a.usable[k]
               and a.gap[k] <= least + patch * a.size[k];
  }
  return flags;
}

/// Nodes that come nearer to a master; those of a contact where none does all
/// count.
std::vector<std::int8_t> approaching(MPI_Comm comm, const Approach& a)
{
  const double largest
      = max(comm, a.rate.size() > 0 ? std::max(0.0, a.rate.maxCoeff()) : 0.0);
  std::vector<std::int8_t> flags(a.gap.size());
  for (std::size_t k = 0; k < flags.size(); ++k)
    flags[k] = !(largest > 0) or a.rate[k] > 0.01 * largest;
  return flags;
}

/// Nodes that meet a master first; the nearest where gaps do not close.
std::vector<std::int8_t> first_on_the_way(MPI_Comm comm, const Approach& a,
                                          double width)
{
  std::vector<std::int8_t> closing = approaching(comm, a);
  double time = infinity;
  for (std::size_t k = 0; k < closing.size(); ++k)
  {
    closing[k] = closing[k] and a.usable[k] and std::isfinite(a.gap[k])
                 and a.rate[k] > 0;
    if (closing[k])
      time = std::min(time, a.gap[k] / a.rate[k]);
  }
  time = min(comm, time);
  if (!std::isfinite(time))
    return nearest(comm, a);
  for (std::size_t k = 0; k < closing.size(); ++k)
  {
    closing[k]
        = closing[k] and a.gap[k] - a.rate[k] * time <= width * a.size[k];
  }
  return closing;
}

/// Coefficients of the free motion that forces drive, per force; zero in
/// balance. Collective.
VectorXd driven_motion(MPI_Comm comm, const MatrixXd& motions,
                       const MatrixXd& gram, std::span<const double> force)
{
  double total = 0;
  for (double f : force)
    total += std::abs(f);
  total = sum(comm, total);
  if (!(total > 0) or !std::isfinite(total)) // the iteration says what is wrong
    return VectorXd::Zero(gram.rows());
  const VectorXd f
      = Eigen::Map<const VectorXd>(force.data(), force.size()) / total;
  const VectorXd work = sum(comm, MatrixXd(-(motions.transpose() * f)));
  const double size = std::sqrt(sum(comm, f.squaredNorm()));
  const VectorXd bound = 1e-8 * size * gram.diagonal().cwiseSqrt();
  if ((work.cwiseAbs().array() <= bound.array()).all())
    return VectorXd::Zero(gram.rows());
  return least_squares(gram, work);
}

/// Number of free motions that nodes resist: sticking ones all, others along
/// the normal. Collective.
int resisted_rank(MPI_Comm comm, const std::vector<Approach>& approaches,
                  const MatrixXd& gram,
                  const std::vector<std::vector<std::int8_t>>& flags)
{
  MatrixXd resisted = MatrixXd::Zero(gram.rows(), gram.cols());
  for (std::size_t i = 0; i < approaches.size(); ++i)
  {
    const Approach& a = approaches[i];
    for (std::size_t k = 0; k < flags[i].size(); ++k)
    {
      if (!flags[i][k])
        continue;
      MatrixXd rows = a.relative.middleRows(3 * k, 3);
      if (!a.frictional)
        rows = MatrixXd(a.normal(k).transpose() * rows);
      resisted += rows.transpose() * rows;
    }
  }
  const VectorXd values = eigenpairs(sum(comm, resisted), gram).values;
  return (values.array() > 1e-5 * std::max(0.0, values.maxCoeff())).count();
}
} // namespace

//-----------------------------------------------------------------------------
std::vector<MatrixXd>
dolfinx_mortar::relative_motions(const Coupling& coupling,
                                 const Evaluation& evaluation,
                                 const MatrixXd& motions)
{
  std::vector<MatrixXd> relative(coupling.interfaces.size());
  for (std::size_t i = 0; i < relative.size(); ++i)
  {
    if (!coupling.interfaces[i].is_tie())
    {
      relative[i].resize(3 * coupling.interfaces[i].num_owned(),
                         motions.cols());
    }
  }
  for (Eigen::Index m = 0; m < motions.cols(); ++m)
  {
    const std::vector<double> moved = multiply(
        evaluation.B_contact.get(),
        {motions.col(m).data(), static_cast<std::size_t>(motions.rows())});
    for (std::size_t i = 0; i < relative.size(); ++i)
    {
      if (coupling.interfaces[i].is_tie())
        continue;
      const auto own = coupling.part(std::span(moved), i, 3);
      const auto& weight = evaluation.interfaces[i].geometry->nodal.weight;
      for (std::size_t j = 0; j < own.size(); ++j)
        relative[i](j, m) = own[j] / std::max(weight[j / 3], 1e-300);
    }
  }
  return relative;
}
//-----------------------------------------------------------------------------
std::optional<NodeFlags> dolfinx_mortar::find_first_nodes(
    const Coupling& coupling, const Step& step, const State& state,
    const Evaluation& evaluation, std::span<const double> force)
{
  MPI_Comm comm = coupling.comm();
  const MatrixXd motions = free_motions(coupling, evaluation.u);
  if (motions.cols() == 0)
    return std::nullopt;
  const MatrixXd gram = sum(comm, MatrixXd(motions.transpose() * motions));
  const std::vector<MatrixXd> relative
      = relative_motions(coupling, evaluation, motions);
  const VectorXd drive = driven_motion(comm, motions, gram, force);

  std::vector<std::size_t> contacts;
  std::vector<Approach> approaches;
  for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    if (c.is_tie())
      continue;
    const std::size_t n = c.num_owned();
    const InterfaceEvaluation& e = evaluation.interfaces[i];
    Approach a;
    const auto& has_multiplier = state.interfaces[i].basis.has_multiplier;
    a.usable.assign(has_multiplier.begin(), has_multiplier.begin() + n);
    a.gap = nodal_gaps(c.data, state.interfaces[i].basis, e);
    a.normals = e.geometry->configuration.normals.n;
    a.relative = relative[i];
    a.rate.resize(n);
    a.frictional = step.is_frictional(i);
    for (std::size_t k = 0; k < n; ++k)
    {
      a.gap[k] = std::max(a.gap[k], 0.0);
      a.size.push_back(std::sqrt(step.weights[i][k]));
      a.rate[k] = a.normal(k).dot(a.relative.middleRows(3 * k, 3) * drive);
    }
    contacts.push_back(i);
    approaches.push_back(std::move(a));
  }

  auto choose = [&](auto&& flags_of)
  {
    std::vector<std::vector<std::int8_t>> flags;
    for (const Approach& a : approaches)
      flags.push_back(flags_of(a));
    return flags;
  };
  const auto near = choose([&](auto& a) { return nearest(comm, a); });
  auto chosen = near;
  const int needed = resisted_rank(comm, approaches, gram, near);
  auto suffices = [&](std::vector<std::vector<std::int8_t>> flags)
  {
    if (resisted_rank(comm, approaches, gram, flags) < needed)
      return false;
    chosen = std::move(flags);
    return true;
  };
  bool found = false;
  for (double width : first_patches)
  {
    found = suffices(
        choose([&](auto& a) { return first_on_the_way(comm, a, width); }));
    if (found)
      break;
  }
  if (!found)
  {
    suffices(choose(
        [&](auto& a)
        {
          std::vector<std::int8_t> flags = approaching(comm, a);
          const auto close = nearest(comm, a);
          for (std::size_t k = 0; k < flags.size(); ++k)
            flags[k] = flags[k] and close[k];
          return flags;
        }));
  }
  NodeFlags out(coupling.interfaces.size());
  for (std::size_t j = 0; j < contacts.size(); ++j)
    out[contacts[j]] = chosen[j];
  return out;
}
//-----------------------------------------------------------------------------
std::vector<std::vector<Status>>
dolfinx_mortar::initial_status(const Coupling& coupling, const Step& step,
                               const State& state, const Evaluation& evaluation,
                               const std::vector<InitialActive>& choices,
                               std::span<const double> force)
{
  const std::optional<NodeFlags> first
      = find_first_nodes(coupling, step, state, evaluation, force);
  std::vector<std::vector<Status>> status(coupling.interfaces.size());
  for (std::size_t i = 0; i < status.size(); ++i)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    if (c.is_tie())
      continue;
    const std::size_t n = c.num_owned();
    const Status closed = step.is_frictional(i) ? Status::stick : Status::slip;
    status[i].assign(n, Status::open);
    std::vector<std::int8_t> given;
    if (choices[i].choice == InitialActive::Choice::given)
      given = choices[i].flags(std::span(c.data.slave.X).first(3 * n));
    const std::vector<double> distance
        = shown_gaps(c, state.interfaces[i].basis, evaluation.interfaces[i],
                     evaluation.interfaces[i].law.status);
    for (std::size_t k = 0; k < n; ++k)
    {
      if (!state.interfaces[i].basis.has_multiplier[k])
        continue;
      bool is_closed = choices[i].choice == InitialActive::Choice::all;
      if (choices[i].choice == InitialActive::Choice::given)
        is_closed = given[k];
      if (choices[i].choice == InitialActive::Choice::gap)
      {
        // Where surfaces touch, round-off must not choose among their nodes
        is_closed = evaluation.interfaces[i].law.status[k] != Status::open
                    or distance[k] <= 1e-9 * std::sqrt(step.weights[i][k])
                    or (first and (*first)[i][k]);
      }
      if (is_closed)
        status[i][k] = closed;
    }
  }
  return status;
}
