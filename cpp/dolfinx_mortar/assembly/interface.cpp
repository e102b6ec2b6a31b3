// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "interface.h"
#include <algorithm>
#include <dolfinx_mortar/multiplier/multiplier.h>

using namespace dolfinx_mortar;

//-----------------------------------------------------------------------------
std::vector<std::int8_t> dolfinx_mortar::multiplier_nodes(const Surface& slave,
                                                          MultiplierSpace space)
{
  std::vector<std::int32_t> uses(num_local_nodes(slave), 0);
  for (std::size_t f = 0; f < slave.types.size(); ++f)
  {
    const int n = num_multipliers(space, slave.types[f]);
    for (std::int32_t k : facet_nodes(slave, f).first(n))
      uses[k] = 1;
  }
  // A rank may own nodes that only other ranks' facets touch
  scatter_reverse_add(slave, std::span(uses), 1);
  scatter_forward(slave, std::span(uses), 1);
  std::vector<std::int8_t> flags(uses.size());
  std::ranges::transform(uses, flags.begin(), [](auto n) { return n > 0; });
  return flags;
}
//-----------------------------------------------------------------------------
Interface dolfinx_mortar::create_interface(Surface slave, Surface master,
                                           const IntegrationOptions& options)
{
  const std::size_t num = num_local_nodes(slave);
  std::vector<std::int8_t> candidates = multiplier_nodes(slave, options.space);
  std::vector<std::int64_t> multipliers = slave.numbers;
  return {std::move(slave),
          std::move(master),
          options,
          std::move(multipliers),
          std::move(candidates),
          std::vector<std::int8_t>(3 * num, 0),
          std::nullopt};
}
//-----------------------------------------------------------------------------
Basis dolfinx_mortar::create_basis(const Interface& interface)
{
  const std::vector<std::int8_t> none(interface.candidates.size(), 0);
  return {interface.candidates, none, none};
}
//-----------------------------------------------------------------------------
Configuration dolfinx_mortar::configure(const Interface& interface,
                                        std::vector<double> x_slave,
                                        std::vector<double> x_master,
                                        std::vector<double> offset)
{
  Normals normals = compute_normals(interface.slave, x_slave, interface.fixed);
  if (interface.normal)
  {
    for (std::size_t i = 0; i < normals.n.size(); ++i)
      normals.n[i] = (*interface.normal)[i % 3];
  }
  Candidates candidates = find_candidates(
      interface.slave, x_slave, interface.master, x_master,
      interface.options.distance, interface.options.leave_distant ? 2 : 1);
  return {std::move(x_slave), std::move(x_master), std::move(normals),
          std::move(candidates), std::move(offset)};
}
