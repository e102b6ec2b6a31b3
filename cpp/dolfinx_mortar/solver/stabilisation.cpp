// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "stabilisation.h"
#include "rigid_motions.h"
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

using namespace dolfinx_mortar;

namespace
{
/// Stiffness of the slave nodes that may meet a tool, all together. Collective.
double stiffness_of_slaves(const Coupling& coupling, const LoadedTool& tool,
                           std::span<const double> stiffness)
{
  double total = 0;
  for (const CoupledInterface& c : coupling.interfaces)
  {
    if (!c.data.tool or c.data.tool->blocks != tool.frame.blocks)
      continue;
    for (std::int32_t k = 0; k < c.num_owned(); ++k)
    {
      const std::int32_t own = coupling.own_block(c, k);
      for (std::int32_t i = 3 * own; i < 3 * own + 3; ++i)
        total += std::abs(stiffness[i]) / 3;
    }
  }
  return sum(coupling.comm(), total);
}
} // namespace

//-----------------------------------------------------------------------------
std::vector<double>
dolfinx_mortar::create_springs(const Coupling& coupling,
                               std::span<const double> u,
                               std::span<const double> stiffness)
{
  const Eigen::MatrixXd motions = free_motions(coupling, u);
  std::vector<double> springs(stiffness.size(), 0.0);
  for (std::size_t block = 0; block < springs.size() / 3; ++block)
  {
    // All three of a node: a body that may only turn is loose, too
    if (motions.middleRows(3 * block, 3).isZero(0))
      continue;
    for (std::size_t i = 3 * block; i < 3 * block + 3; ++i)
      springs[i] = std::abs(stiffness[i]);
  }
  for (std::int32_t dof : coupling.fixed_dofs)
    springs[dof] = 0;
  for (const LoadedTool& tool : coupling.loaded_tools)
  {
    const double k = stiffness_of_slaves(coupling, tool, stiffness);
    if (tool.first_dof < 0 or motions.middleRows(tool.first_dof, 12).isZero(0))
      continue;
    // The last six are no unknowns, but nodes that a free motion moves
    for (int i = 0; i < 12; ++i)
      springs[tool.first_dof + i] = i >= 6 or tool.free[i] ? k : 0.0;
  }
  return springs;
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::check_loose(const Coupling& coupling)
{
  if (!is_held(coupling))
    return;
  throw std::invalid_argument(
      "stabilise is for bodies that nothing holds but contact, but Dirichlet "
      "conditions and ties hold all of them: leave it out.");
}
//-----------------------------------------------------------------------------
Stabilisation dolfinx_mortar::measure_stabilisation(const Coupling& coupling,
                                                    const Step& step,
                                                    const Evaluation& solution,
                                                    std::span<const double> x)
{
  // Squares of forces: of springs and of contact; energy and work
  std::vector<double> sums(4, 0.0);
  for (std::size_t i = 0; i < step.springs.size(); ++i)
  {
    const double force = step.springs[i] * (x[i] - step.spring_origin[i]);
    sums[0] += force * force;
    sums[1] += solution.force[i] * solution.force[i];
    sums[2] += 0.5 * force * (x[i] - step.spring_origin[i]);
    sums[3] += 0.5
               * std::abs(solution.force[i]
                          * (solution.u[i] - step.spring_origin[i]));
  }
  sums = sum(coupling.comm(), std::move(sums));
  Stabilisation s;
  // Without any contact they carry all that there is
  auto ratio = [](double part, double whole)
  {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    return part == 0 ? 0.0 : whole == 0 ? infinity : part / whole;
  };
  s.force = std::sqrt(ratio(sums[0], sums[1]));
  s.energy = sums[2];
  s.energy_share = ratio(sums[2], sums[3]);
  return s;
}
