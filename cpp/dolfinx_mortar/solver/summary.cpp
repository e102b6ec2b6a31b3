// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "summary.h"
#include "results.h"
#include <Eigen/Dense>
#include <algorithm>
#include <stdexcept>

using namespace dolfinx_mortar;

namespace
{
using Vec3 = Eigen::Vector3d;

Eigen::Map<const Vec3> node_row(std::span<const double> x, std::size_t k)
{
  return Eigen::Map<const Vec3>(x.data() + 3 * k);
}

/// Deepest overlap of facets with a node in contact.
double overlap_in_contact(const Surface& slave, const NodalIntegrals& nodal,
                          std::span<const Status> status)
{
  std::vector<std::int8_t> closed(num_local_nodes(slave), 0);
  for (std::size_t k = 0; k < status.size(); ++k)
    closed[k] = status[k] != Status::open;
  scatter_forward(slave, std::span(closed), 1);
  double depth = 0;
  for (std::size_t f = 0; f < slave.types.size(); ++f)
  {
    if (std::ranges::any_of(facet_nodes(slave, f),
                            [&](auto k) { return closed[k] != 0; }))
      depth = std::max(depth, -nodal.nearest[f]);
  }
  return depth;
}
} // namespace

//-----------------------------------------------------------------------------
Summary dolfinx_mortar::summarise(const ContactProblem& problem,
                                  std::size_t interface)
{
  const Coupling& coupling = problem.coupling();
  const CoupledInterface& c = coupling.interfaces.at(interface);
  if (c.is_tie())
    throw std::invalid_argument("A tie has no summary of contact.");
  const Resultants resultant = resultants(problem, interface);
  const InterfaceState& state = problem.state().interfaces[interface];
  const InterfaceEvaluation& evaluation
      = problem.evaluation()->interfaces[interface];
  const InterfaceGeometry& geometry = *evaluation.geometry;
  const std::vector<double> z
      = local_multipliers(coupling, interface, problem.state().z);

  // Position times force, force, area; counts; energy
  std::vector<double> sums(9, 0.0);
  double largest = 0, overlap = 0;
  for (std::int32_t k = 0; k < c.num_owned(); ++k)
  {
    if (!state.basis.has_multiplier[k])
      continue;
    ++sums[5 + static_cast<int>(state.status[k])];
    if (state.status[k] == Status::open)
      continue;
    const double weight = geometry.nodal.weight[k];
    const double pressure
        = node_row(geometry.configuration.normals.n, k).dot(node_row(z, k));
    largest = std::max(largest, pressure);
    overlap = std::max(overlap, -evaluation.gap[k] / weight);
    Eigen::Map<Vec3>(sums.data())
        += weight * pressure * node_row(geometry.configuration.x_slave, k);
    sums[3] += weight * pressure;
    sums[4] += weight;
  }
  sums[8] = state.dissipation;
  sums = sum(coupling.comm(), std::move(sums));

  Summary s;
  s.force = resultant.slave_force;
  for (int i = 0; i < 3 and sums[3] > 0; ++i)
    s.centre[i] = sums[i] / sums[3];
  s.area = sums[4];
  s.mean_pressure = s.area > 0 ? sums[3] / s.area : 0.0;
  s.largest_pressure = max(coupling.comm(), largest);
  if (c.is_current())
  {
    overlap = overlap_in_contact(c.data.slave, geometry.nodal, state.status);
  }
  s.penetration = max(coupling.comm(), overlap);
  s.open = sums[5];
  s.stick = sums[6];
  s.slip = sums[7];
  s.dissipation = sums[8];
  return s;
}
//-----------------------------------------------------------------------------
std::vector<double> dolfinx_mortar::nodal_forces(const ContactProblem& problem,
                                                 std::size_t interface)
{
  const Evaluation& evaluation = last_evaluation(problem);
  const Coupling& coupling = problem.coupling();
  const State& state = problem.state();
  std::vector<double> z(coupling.size(), 0.0);
  std::ranges::copy(
      coupling.part(std::span<const double>(state.z), interface, 3),
      coupling.part(std::span(z), interface, 3).begin());
  std::vector<double> f = multiply_transposed(evaluation.B.get(), z);
  for (double& v : f)
    v = -v;
  return f;
}
//-----------------------------------------------------------------------------
std::vector<double> dolfinx_mortar::reactions(const ContactProblem& problem)
{
  const Evaluation& evaluation = last_evaluation(problem);
  std::vector<double> f = problem.bodies().residual();
  for (std::size_t i = 0; i < f.size(); ++i)
    f[i] += evaluation.force[i];
  return f;
}
