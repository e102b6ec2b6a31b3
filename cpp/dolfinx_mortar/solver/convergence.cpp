// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "convergence.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <dolfinx_mortar/common/error.h>
#include <limits>

using namespace dolfinx_mortar;

namespace
{
/// Largest side of the box around all bodies [length]. Collective.
double extent(const Layout& layout)
{
  std::array<double, 6> box;
  box.fill(std::numeric_limits<double>::infinity());
  for (std::size_t i = 0; i < layout.X.size(); ++i)
  {
    box[i % 3] = std::min(box[i % 3], layout.X[i]);
    box[3 + i % 3] = std::min(box[3 + i % 3], -layout.X[i]);
  }
  MPI_Allreduce(MPI_IN_PLACE, box.data(), 6, MPI_DOUBLE, MPI_MIN, layout.comm);
  return std::max({-box[3] - box[0], -box[4] - box[1], -box[5] - box[2]});
}
} // namespace

//-----------------------------------------------------------------------------
double dolfinx_mortar::force_floor(const Layout& layout, Mat K,
                                   std::span<const double> x)
{
  const double size = extent(layout);
  std::vector<double> forces = diagonal(K);
  std::size_t dof = 0;
  for (std::size_t b = 0; b < layout.num_bodies(); ++b)
  {
    const double cell = layout.cell_sizes[b];
    for (std::int32_t k = 0; k < 3 * layout.num_owned[b]; ++k, ++dof)
    {
      forces[dof] *= std::clamp(std::abs(x[dof]), 0.1 * cell,
                                std::max(0.1 * cell, 10 * size));
    }
  }
  return 1e-5 * norm(layout.comm, forces);
}
//-----------------------------------------------------------------------------
Iterate dolfinx_mortar::measure(const Coupling& coupling, const Step& step,
                                const State& state, const Iteration& iteration,
                                ForceReference& reference, ActiveSets& sets)
{
  MPI_Comm comm = coupling.comm();
  const std::size_t n = coupling.layout.size();
  std::vector<double> forces(iteration.residual.begin(),
                             iteration.residual.begin() + n);
  double prescribed = 0;
  for (std::int32_t dof : coupling.fixed_dofs)
  {
    prescribed = std::max(prescribed, std::abs(forces[dof]));
    forces[dof] = 0;
  }
  prescribed = max(comm, prescribed);
  Iterate record;
  record.residual = norm(comm, forces);
  if (!reference.first_residual)
    reference.first_residual = record.residual;
  // Forces below the round-off of stiffness times displacement are no forces.
  // What forces an iterate on the way had is no measure: it may have been far
  // off.
  const double largest = std::max(
      {*reference.first_residual, iteration.force_scale, reference.floor});
  const Evaluation& e = iteration.interfaces;
  const double length = std::max(max_norm(comm, e.u), prescribed);
  record.force = largest > 0 ? record.residual / largest : 0.0;
  record.constraint = constraint_measure(coupling, step, state, e, length);
  record.prescribed = length > 0 ? prescribed / length : 0.0;

  std::vector<Status> status;
  for (const InterfaceEvaluation& i : e.interfaces)
    status.insert(status.end(), i.law.status.begin(), i.law.status.end());
  const ContactCounts counts = count_nodes(comm, status);
  record.active = counts.active;
  record.stick = counts.stick;
  record.slip = counts.slip;
  record.changes = sets.record(std::move(status));
  return record;
}
//-----------------------------------------------------------------------------
bool dolfinx_mortar::is_undecided(const Coupling& coupling, const Step& step,
                                  const State& state,
                                  const Evaluation& evaluation,
                                  const ActiveSets& sets, double rtol)
{
  if (sets.size() < 2)
    return false;
  bool ok = true;
  std::size_t at = 0;
  for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    if (c.is_tie())
      continue;
    const InterfaceEvaluation& e = evaluation.interfaces[i];
    const InterfaceState& s = state.interfaces[i];
    const std::span<const double> z
        = coupling.part(std::span<const double>(evaluation.z), i, 3);
    const double largest = largest_traction(c.data, s, step.weights[i], z);
    for (std::int32_t k = 0; k < c.num_owned(); ++k, ++at)
    {
      if (sets.status(0)[at] == sets.status(1)[at])
        continue;
      double zn = 0;
      for (int d = 0; d < 3; ++d)
        zn += z[3 * k + d] * e.geometry->configuration.normals.n[3 * k + d];
      zn = std::abs(zn);
      const double cg = std::abs(s.c_n[k] * e.gap[k]);
      ok = ok
           and (std::max(zn, cg) <= 100 * rtol * largest
                or (step.is_frictional(i) and e.law.status[k] != Status::open
                    and zn > 0));
    }
  }
  return !any(coupling.comm(), !ok);
}
