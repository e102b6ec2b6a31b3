// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "iteration.h"
#include <dolfinx_mortar/common/error.h>

using namespace dolfinx_mortar;

//-----------------------------------------------------------------------------
Iteration dolfinx_mortar::evaluate(Bodies& bodies, const Coupling& coupling,
                                   const Step& step, const State& state,
                                   std::span<const double> x)
{
  const std::size_t n = coupling.layout.size();
  const std::span<const double> u = x.first(n), z = x.subspan(n);
  bodies.set_unknowns(u);
  const std::vector<double> moved = bodies.displacements();
  Iteration it;
  it.free_forces = bodies.residual();
  std::vector<std::int8_t> is_load(n, 0);
  for (std::int32_t dof : bodies.tool_dofs())
    is_load[dof] = 1;
  auto spring_force = [&](std::size_t i)
  { return step.springs[i] * (u[i] - step.spring_origin[i]); };
  for (std::size_t i = 0; i < step.springs.size(); ++i)
    it.free_forces[i] += is_load[i] ? 0.0 : spring_force(i);
  it.interfaces
      = evaluate(coupling, step, state, bodies.local_displacements(), moved, z);
  it.residual = it.free_forces;
  for (std::size_t i = 0; i < n; ++i)
    it.residual[i] += it.interfaces.force[i];
  bodies.reduce_forces(it.residual);
  // Springs of loaded tools act on the unknowns
  for (std::size_t i = 0; i < step.springs.size(); ++i)
    it.residual[i] += is_load[i] ? spring_force(i) : 0.0;
  std::vector<double> at_work = it.interfaces.force;
  const std::vector<double> prescribed = bodies.prescribed_values();
  for (std::int32_t dof : coupling.fixed_dofs)
  {
    at_work.push_back(it.residual[dof]);
    it.residual[dof] = u[dof] - prescribed[dof];
    if (!is_load[dof])
      it.free_forces[dof] = 0;
  }
  it.force_scale = norm(coupling.comm(), at_work);
  it.residual.insert(it.residual.end(), it.interfaces.constraints.begin(),
                     it.interfaces.constraints.end());
  return it;
}
