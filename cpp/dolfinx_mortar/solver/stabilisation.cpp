// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "stabilisation.h"
#include "rigid_motions.h"
#include <algorithm>
#include <cmath>
#include <stdexcept>

using namespace dolfinx_mortar;

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
                                                    const Evaluation& solution)
{
  // Squares of forces: of springs and of contact; energy and work
  std::vector<double> sums(4, 0.0);
  for (std::size_t i = 0; i < step.springs.size(); ++i)
  {
    const double moved = solution.u[i] - step.spring_origin[i];
    const double force = step.springs[i] * moved;
    sums[0] += force * force;
    sums[1] += solution.force[i] * solution.force[i];
    sums[2] += 0.5 * force * moved;
    sums[3] += 0.5 * std::abs(solution.force[i] * moved);
  }
  sums = sum(coupling.comm(), std::move(sums));
  Stabilisation s;
  s.force = std::sqrt(sums[0] / std::max(sums[1], 1e-300));
  s.energy = sums[2];
  s.energy_share = sums[2] / std::max(sums[3], 1e-300);
  return s;
}
