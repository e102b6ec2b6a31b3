// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "problem.h"
#include <algorithm>
#include <dolfinx_mortar/surface/patches.h>
#include <dolfinx_mortar/surface/spread.h>
#include <numbers>

using namespace dolfinx_mortar;

namespace
{
std::string tag_name(const std::vector<TaggedFacets>& parts)
{
  return parts.empty() ? "an analytic tool"
                       : "facet tag " + std::to_string(parts.front().tag);
}

/// Frame of a tool that is a body of a layout.
Tool create_tool(const Layout& layout, std::size_t body, const RigidTool& tool)
{
  Tool t;
  const std::int32_t start = layout.local_start(body);
  for (int l = 0; l < 4; ++l)
  {
    t.blocks[l] = layout.blocks[body][l];
    t.local_blocks[l] = start + l;
  }
  std::copy_n(layout.X.begin() + 3 * start, 12, t.X.begin());
  std::copy_n(tool.reference_point.data(), 3, t.point.begin());
  t.shape = tool.shape();
  return t;
}

LoadedTool create_loaded(const Layout& layout, std::size_t body,
                         const RigidTool& tool)
{
  LoadedTool t;
  t.frame = create_tool(layout, body, tool);
  t.part = layout.parts[layout.local_start(body)];
  t.free = tool.free;
  if (layout.num_owned[body] > 0)
    t.first_dof = 3 * layout.owned_start(body);
  return t;
}

/// Slave facets on all ranks from which on it pays to spread them (measured,
/// see docs/performance.md).
constexpr std::int64_t many_facets = 50;

/// Whether to spread the slave facets of an interface over the ranks.
/// Collective.
bool is_to_be_spread(const InterfaceOptions& options, const Surface& slave)
{
  int size;
  MPI_Comm_size(slave.comm, &size);
  if (size == 1 or !options.contact or options.contact->reference_geometry)
    return false;
  const std::int64_t num = slave.types.size();
  return options.balance.value_or(sum(slave.comm, num) >= many_facets);
}

/// Surface of a tool, which has no facets where it is analytic. Collective.
Surface create_master(const Layout& layout, const InterfaceOptions& options,
                      const Tool& tool)
{
  if (!tool.shape)
    return create_tool_surface(options.master, tool.local_blocks[0]);
  Surface s;
  s.comm = layout.comm;
  return s;
}
} // namespace

//-----------------------------------------------------------------------------
std::vector<std::shared_ptr<const RigidTool>>
dolfinx_mortar::tools_of(const std::vector<InterfaceOptions>& interfaces)
{
  std::vector<std::shared_ptr<const RigidTool>> tools;
  for (const InterfaceOptions& i : interfaces)
  {
    if (i.tool and std::ranges::find(tools, i.tool) == tools.end())
      tools.push_back(i.tool);
  }
  return tools;
}
//-----------------------------------------------------------------------------
Coupling dolfinx_mortar::create_coupling(
    Layout layout, std::span<const std::shared_ptr<const FunctionSpace>> spaces,
    std::span<const std::int8_t> prescribed,
    const std::vector<InterfaceOptions>& interfaces)
{
  const auto tools = tools_of(interfaces);
  std::vector<CoupledInterface> coupled;
  for (const InterfaceOptions& i : interfaces)
  {
    CoupledInterface c;
    c.contact = i.contact;
    c.min_coverage = i.min_coverage;
    c.feature_angle = i.feature_angle * std::numbers::pi / 180;
    c.x_slave = i.x_slave;
    c.x_master = i.x_master;
    c.slave_name = tag_name(i.slave);
    c.master_name = tag_name(i.master);
    std::optional<Tool> tool;
    if (i.tool)
    {
      const std::size_t t = std::ranges::find(tools, i.tool) - tools.begin();
      tool = create_tool(layout, spaces.size() + t, *i.tool);
    }
    Surface slave = create_surface(layout, spaces, i.slave, "slave");
    // An analytic tool has one normal at a node, whatever meets there
    if (i.contact and !(tool and tool->shape))
      slave = split_at_edges(slave, c.feature_angle);
    if (is_to_be_spread(i, slave))
      slave = spread_facets(slave);
    Surface master = tool ? create_master(layout, i, *tool)
                          : create_surface(layout, spaces, i.master, "master");
    c.space = i.space;
    IntegrationOptions options = i.integration;
    options.leave_distant = i.contact.has_value();
    c.data = create_interface(std::move(slave), std::move(master), options);
    c.data.normal = i.normal;
    c.data.tool = tool;
    coupled.push_back(std::move(c));
  }
  std::vector<LoadedTool> loaded;
  for (std::size_t t = 0; t < tools.size(); ++t)
  {
    if (tools[t]->is_loaded())
      loaded.push_back(create_loaded(layout, spaces.size() + t, *tools[t]));
  }
  Coupling coupling
      = create_coupling(std::move(layout), std::move(coupled), prescribed);
  coupling.loaded_tools = std::move(loaded);
  return coupling;
}
