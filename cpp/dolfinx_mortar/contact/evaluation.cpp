// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "evaluation.h"
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <dolfinx_mortar/assembly/petsc.h>
#include <limits>

using namespace dolfinx_mortar;

namespace
{
Eigen::Vector3d vector(std::span<const double> v, std::size_t j)
{
  return Eigen::Map<const Eigen::Vector3d>(v.data() + 3 * j);
}
} // namespace

//-----------------------------------------------------------------------------
ContactResidual dolfinx_mortar::evaluate_law(
    const Interface& interface, const ContactOptions& options,
    const Friction& friction, const InterfaceState& state,
    const InterfaceEvaluation& evaluation, std::span<const double> z,
    std::span<const std::int64_t> blocks, std::span<const Status> forced,
    bool damped, double normal_share)
{
  const std::size_t n = interface.slave.num_owned;
  const InterfaceGeometry& geometry = *evaluation.geometry;
  const std::span<const double> normals = geometry.configuration.normals.n;
  std::span<const std::int8_t> near = geometry.nodal.near;
  // Distances of the reference configuration say nothing about the present one
  near = options.reference_geometry ? near.first(0) : near.first(n);
  const std::span<const std::int8_t> fixed = interface.fixed;
  std::vector<double> c_n = state.c_n;
  if (!options.c_n)
  {
    for (double& value : c_n)
      value *= normal_share;
  }
  return contact_residual({z, normals.first(3 * n), evaluation.gap,
                           evaluation.weighted_slip, evaluation.scale, c_n,
                           state.c_t, evaluation.usable, fixed.first(3 * n),
                           near, blocks},
                          friction, forced, damped);
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::set_parameters(const ContactOptions& options,
                                    std::span<const double> weights,
                                    std::span<const double> stiffness,
                                    InterfaceState& state)
{
  const std::size_t n = weights.size();
  state.c_n.resize(n);
  state.c_t.resize(n);
  state.scale.resize(n);
  for (std::size_t j = 0; j < n; ++j)
  {
    const double area = std::max(weights[j], 1e-300);
    const double c = stiffness[j] / (area * area);
    state.c_n[j] = options.c_n ? *options.c_n / area : c;
    state.c_t[j] = options.c_t ? *options.c_t / area : c;
    // A traction, until an iterate gives a better one
    state.scale[j] = state.c_t[j] * std::pow(area, 1.5);
  }
}
//-----------------------------------------------------------------------------
double dolfinx_mortar::largest_traction(const Interface& interface,
                                        const InterfaceState& state,
                                        std::span<const double> weights,
                                        std::span<const double> z)
{
  // Times the default tolerance 1e-9 the floor is the round-off of positions,
  // 1e-15, times the stiffness with which gaps count as tractions
  std::array<double, 3> largest = {0, 0, 0};
  for (double v : z)
    largest[0] = std::max(largest[0], std::abs(v));
  for (const Surface* s : {&interface.slave, &interface.master})
  {
    for (double v : s->X)
      largest[1] = std::max(largest[1], std::abs(v));
  }
  for (std::size_t j = 0; j < state.c_n.size(); ++j)
    largest[2] = std::max(largest[2], state.c_n[j] * weights[j]);
  MPI_Allreduce(MPI_IN_PLACE, largest.data(), 3, MPI_DOUBLE, MPI_MAX,
                interface.slave.comm);
  return std::max(largest[0], 1e-6 * largest[1] * largest[2]);
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::accept_slip(const Interface& interface,
                                 const InterfaceEvaluation& evaluation,
                                 std::span<const double> z,
                                 InterfaceState& state)
{
  const InterfaceGeometry& geometry = *evaluation.geometry;
  state.dissipation = 0;
  for (std::size_t j = 0;
       j < static_cast<std::size_t>(interface.slave.num_owned); ++j)
  {
    Eigen::Map<Eigen::Vector3d> total(state.slip.data() + 3 * j);
    if (evaluation.law.status[j] == Status::open)
    {
      total.setZero();
      continue;
    }
    const Eigen::Vector3d n = vector(geometry.configuration.normals.n, j);
    const Eigen::Vector3d w = vector(evaluation.weighted_slip, j);
    const Eigen::Vector3d slip = w.dot(n) * n - w;
    state.dissipation += vector(z, j).dot(slip);
    // An average of slip, from slip times area
    total += slip / geometry.nodal.weight[j];
  }
}
//-----------------------------------------------------------------------------
std::vector<double>
dolfinx_mortar::nodal_gaps(const Interface& interface, const Basis& basis,
                           const InterfaceEvaluation& evaluation)
{
  std::vector<double> gaps(interface.slave.num_owned,
                           std::numeric_limits<double>::infinity());
  for (std::size_t j = 0; j < gaps.size(); ++j)
  {
    if (basis.has_multiplier[j])
      gaps[j] = evaluation.gap[j] / evaluation.geometry->nodal.weight[j];
  }
  return gaps;
}
