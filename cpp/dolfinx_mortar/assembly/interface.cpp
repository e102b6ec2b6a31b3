// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "interface.h"
#include <algorithm>
#include <dolfinx_mortar/multiplier/multiplier.h>
#include <numeric>

using namespace dolfinx_mortar;

namespace
{
/// Normals of the slave nodes that an analytic tool gives.
Normals tool_normals(const Interface& interface, std::span<const double> x,
                     std::span<const double> x_frame)
{
  const std::size_t num = num_local_nodes(interface.slave);
  const FrameView frame(x_frame);
  Normals normals{std::vector<double>(3 * num), std::vector<double>(num, 1.0)};
  for (std::size_t k = 0; k < num; ++k)
  {
    Eigen::Map<Vec3>(normals.n.data() + 3 * k) = opposing_normal(
        *interface.tool->shape, frame, Vec3(x.data() + 3 * k),
        std::span<const std::int8_t, 3>(interface.fixed.data() + 3 * k, 3));
  }
  return normals;
}
} // namespace

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
          std::nullopt,
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
                                        std::vector<double> offset,
                                        const std::array<double, 12>& x_frame)
{
  Configuration c;
  c.x_slave = std::move(x_slave);
  c.x_master = std::move(x_master);
  c.offset = std::move(offset);
  const bool analytic = interface.is_analytic();
  c.normals
      = analytic ? tool_normals(interface, c.x_slave, x_frame)
                 : compute_normals(interface.slave, c.x_slave, interface.fixed);
  if (interface.normal)
  {
    for (std::size_t i = 0; i < c.normals.n.size(); ++i)
      c.normals.n[i] = (*interface.normal)[i % 3];
  }
  if (analytic)
  {
    // The one tool there is, for all facets: it costs little
    c.candidates.facets.assign(interface.slave.types.size(), 0);
    c.candidates.offsets.resize(interface.slave.types.size() + 1);
    std::iota(c.candidates.offsets.begin(), c.candidates.offsets.end(), 0);
  }
  else
  {
    c.candidates = find_candidates(interface.slave, c.x_slave, interface.master,
                                   c.x_master, interface.options.distance,
                                   interface.options.leave_distant ? 2 : 1);
  }
  if (const auto& tool = interface.tool)
    c.candidates.master.frame = {tool->blocks, x_frame, tool->shape};
  return c;
}
