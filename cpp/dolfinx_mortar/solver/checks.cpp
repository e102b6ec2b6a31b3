// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "checks.h"
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <dolfinx_mortar/surface/crossing.h>
#include <dolfinx_mortar/surface/overlap.h>
#include <limits>

using namespace dolfinx_mortar;

namespace
{
constexpr double infinity = std::numeric_limits<double>::infinity();

/// Largest penetration [size of a node's area] of nodes that cannot move.
constexpr double tolerated = 0.1;

/// Share of a facet's area that may be left out without a word: slivers and the
/// seams between curved facets take some per mille.
constexpr double lost_share = 0.05;

/// Share of its surroundings below which a slave node is hardly covered.
constexpr double barely = 0.15;

/// The largest of the values of all ranks, of equal ones that with the largest
/// position. Collective.
Located find_largest(MPI_Comm comm, const Located& mine)
{
  int size;
  MPI_Comm_size(comm, &size);
  std::vector<std::array<double, 4>> all(size);
  const std::array<double, 4> own
      = {mine.value, mine.x[0], mine.x[1], mine.x[2]};
  MPI_Allgather(own.data(), 4, MPI_DOUBLE, all.data(), 4, MPI_DOUBLE, comm);
  const auto& a = *std::ranges::max_element(all);
  return {a[0], {a[1], a[2], a[3]}};
}

std::array<double, 3> point(std::span<const double> x, std::size_t k)
{
  return {x[3 * k], x[3 * k + 1], x[3 * k + 2]};
}

/// Lower and upper corners of the boxes around all separate bodies. Collective.
/// @param[in] x_tool Positions of the nodes of a tool's surface.
/// @param[in] tool Part that they are on, where there are any.
std::vector<double> body_boxes(const Layout& layout,
                               const std::vector<double>& u,
                               std::span<const double> x_tool,
                               std::int32_t tool)
{
  std::vector<double> boxes(6 * layout.num_parts, infinity);
  auto add = [&](std::int32_t part, int c, double x)
  {
    double* box = boxes.data() + 6 * part;
    box[c] = std::min(box[c], x);
    box[3 + c] = std::min(box[3 + c], -x);
  };
  for (std::size_t k = 0; k < layout.parts.size(); ++k)
  {
    for (int c = 0; c < 3; ++c)
      add(layout.parts[k], c, layout.X[3 * k + c] + u[3 * k + c]);
  }
  for (std::size_t i = 0; i < x_tool.size(); ++i)
    add(tool, i % 3, x_tool[i]);
  MPI_Allreduce(MPI_IN_PLACE, boxes.data(), boxes.size(), MPI_DOUBLE, MPI_MIN,
                layout.comm);
  for (std::size_t i = 0; i < boxes.size(); ++i)
  {
    if (i % 6 > 2)
      boxes[i] = -boxes[i];
  }
  return boxes;
}

/// Body that each facet of a surface is on. Collective.
std::vector<std::int64_t> facet_bodies(const Layout& layout, const Surface& s)
{
  std::vector<std::int64_t> of_nodes(num_local_nodes(s), 0);
  for (std::int32_t k = 0; k < s.num_owned; ++k)
    of_nodes[k] = layout.parts[s.local_blocks[k]];
  scatter_forward(s, std::span(of_nodes), 1);
  std::vector<std::int64_t> bodies;
  for (std::size_t f = 0; f < s.types.size(); ++f)
    bodies.push_back(of_nodes[s.nodes[s.offsets[f]]]);
  return bodies;
}
} // namespace

//-----------------------------------------------------------------------------
std::vector<double>
dolfinx_mortar::shown_gaps(const CoupledInterface& c, const Basis& basis,
                           const InterfaceEvaluation& evaluation,
                           std::span<const Status> status)
{
  std::vector<double> gaps = nodal_gaps(c.data, basis, evaluation);
  for (std::size_t k = 0; k < gaps.size(); ++k)
  {
    if (!std::isfinite(gaps[k]))
      gaps[k] = 0;
    if (c.is_current() and basis.has_multiplier[k]
        and !evaluation.geometry->nodal.near[k] and status[k] == Status::open)
    {
      gaps[k] = evaluation.geometry->nodal.distance[k];
    }
  }
  return gaps;
}
//-----------------------------------------------------------------------------
double dolfinx_mortar::largest_overlap(const Coupling& coupling,
                                       const Step& step, const State& state)
{
  double worst = 0;
  for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    if (c.is_tie())
      continue;
    const NodalIntegrals& nodal = step.geometry[i]->nodal;
    double depth = 0, area = 0;
    for (std::int32_t k = 0; k < c.num_owned(); ++k)
    {
      if (state.interfaces[i].basis.has_multiplier[k] and nodal.near[k])
        depth = std::max(depth, -nodal.gap[k] / nodal.weight[k]);
      area = std::max(area, step.weights[i][k]);
    }
    worst = std::max(worst, max(coupling.comm(), depth)
                                / std::sqrt(max(coupling.comm(), area)));
  }
  return worst;
}
//-----------------------------------------------------------------------------
Depth dolfinx_mortar::find_deep_facet(const Coupling& coupling, std::size_t i,
                                      const InterfaceGeometry& geometry,
                                      const std::vector<double>& u)
{
  const CoupledInterface& c = coupling.interfaces[i];
  const Interface& data = c.data;
  // What lies further apart is not to meet, says the user. An analytic tool
  // meets all facets that face it
  if (data.options.distance or data.is_analytic())
    return {};
  std::vector<std::int8_t> uncovered;
  for (double area : geometry.nodal.facet_area)
    uncovered.push_back(area == 0);
  const Positions x = interface_positions(c, &u);
  const bool carried = data.tool.has_value();
  const std::int32_t part
      = carried ? coupling.layout.parts[data.tool->local_blocks[0]] : 0;
  return find_overlap(data.slave, x.slave, uncovered,
                      facet_bodies(coupling.layout, data.slave), data.master,
                      x.master, facet_bodies(coupling.layout, data.master),
                      body_boxes(coupling.layout, u,
                                 carried ? std::span<const double>(x.master)
                                         : std::span<const double>(),
                                 part));
}
//-----------------------------------------------------------------------------
Depth dolfinx_mortar::find_passage(const Coupling& coupling, std::size_t i,
                                   const std::vector<double>& before,
                                   const std::vector<double>& after)
{
  const CoupledInterface& c = coupling.interfaces[i];
  const Interface& data = c.data;
  const Positions a = interface_positions(c, &before),
                  b = interface_positions(c, &after);
  if (data.is_analytic())
  {
    return find_shape_crossing(data.slave, *data.tool->shape, a.slave, a.frame,
                               b.slave, b.frame);
  }
  return find_crossing(data.slave, a.slave, b.slave, data.master, a.master,
                       b.master, data.options.distance);
}
//-----------------------------------------------------------------------------
std::optional<Located>
dolfinx_mortar::find_blocked(const Coupling& coupling, const Step& step,
                             const Evaluation& evaluation)
{
  std::optional<Located> worst;
  for (std::size_t i = 0; i < coupling.interfaces.size() and !worst; ++i)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    if (c.is_tie())
      continue;
    const InterfaceGeometry& geometry = *evaluation.interfaces[i].geometry;
    // A node that can move at a slant to its normal is not blocked
    std::vector<std::int8_t> fixed(c.num_owned());
    for (std::int32_t k = 0; k < c.num_owned(); ++k)
    {
      double free = 0;
      for (int d = 0; d < 3; ++d)
      {
        const double n = geometry.configuration.normals.n[3 * k + d];
        free += c.data.fixed[3 * k + d] ? 0.0 : n * n;
      }
      fixed[k] = std::sqrt(free) < 0.3;
    }
    if (!any(coupling.comm(),
             std::ranges::any_of(fixed, [](auto f) { return f; })))
      continue;

    // Gaps as if all nodes carried a multiplier
    const std::size_t num = num_local_nodes(c.data.slave);
    const std::vector<std::int8_t> none(num, 0);
    const Basis all{std::vector<std::int8_t>(num, 1), none, none};
    BlockAccumulator<1, 1> blocks;
    const NodalIntegrals nodal
        = integrate(c.data, all, geometry.configuration, {.B = &blocks});
    std::vector<double> moved;
    if (!c.is_current())
    {
      const Matrix B = blocks.assemble(coupling.comm(), coupling.size(),
                                       coupling.layout.size());
      moved = multiply(B.get(), evaluation.u);
    }
    Located mine{-infinity, {-infinity, -infinity, -infinity}};
    for (std::int32_t k = 0; k < c.num_owned(); ++k)
    {
      const double area = step.weights[i][k];
      if (!fixed[k] or !(nodal.weight[k] > c.min_coverage * area)
          or (c.is_current() and !nodal.near[k]))
        continue;
      double gap = nodal.gap[k];
      for (int d = 0; d < 3 and !c.is_current(); ++d)
      {
        gap -= geometry.configuration.normals.n[3 * k + d]
               * moved[3 * (c.first_node + k) + d];
      }
      gap /= nodal.weight[k];
      if (gap < -tolerated * std::sqrt(area) and -gap > mine.value)
        mine = {-gap, point(c.data.slave.X, k)};
    }
    const Located found = find_largest(coupling.comm(), mine);
    if (found.value > 0)
      worst = Located{-found.value, found.x};
  }
  return worst;
}
//-----------------------------------------------------------------------------
std::optional<Located>
dolfinx_mortar::find_lost(const CoupledInterface& c,
                          const InterfaceGeometry& geometry)
{
  const Surface& s = c.data.slave;
  Located mine{-infinity, {-infinity, -infinity, -infinity}};
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    const double lost = geometry.nodal.lost[f];
    auto nodes = facet_nodes(s, f);
    const bool counts
        = c.is_tie()
          or std::ranges::any_of(nodes, [&](auto k)
                                 { return geometry.nodal.near[k] != 0; });
    if (!counts or lost <= lost_share or lost <= mine.value)
      continue;
    mine = {lost, {0, 0, 0}};
    for (auto k : nodes)
    {
      for (int d = 0; d < 3; ++d)
        mine.x[d] += s.X[3 * k + d] / nodes.size();
    }
  }
  const Located found = find_largest(s.comm, mine);
  return found.value > 0 ? std::optional(found) : std::nullopt;
}
//-----------------------------------------------------------------------------
std::optional<std::pair<Located, std::size_t>>
dolfinx_mortar::find_barely_covered(const Coupling& coupling, const Step& step,
                                    const State& state,
                                    const Evaluation& evaluation)
{
  for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    const NodalIntegrals& nodal = evaluation.interfaces[i].geometry->nodal;
    Located mine{-infinity, {-infinity, -infinity, -infinity}};
    for (std::int32_t k = 0; k < c.num_owned(); ++k)
    {
      const double share = nodal.coverage[k] / step.weights[i][k];
      if (state.interfaces[i].basis.has_multiplier[k] and share < barely
          and -share > mine.value)
        mine = {-share, point(c.data.slave.X, k)};
    }
    const Located found = find_largest(coupling.comm(), mine);
    if (std::isfinite(found.value))
      return std::pair(Located{std::max(-found.value, 0.0), found.x}, i);
  }
  return std::nullopt;
}
//-----------------------------------------------------------------------------
std::optional<Infinite>
dolfinx_mortar::find_infinite(const Coupling& coupling,
                              std::span<const double> residual)
{
  MPI_Comm comm = coupling.comm();
  auto finite = [](std::span<const double> values)
  {
    return std::ranges::all_of(values,
                               [](double v) { return std::isfinite(v); });
  };
  if (!any(comm, !finite(residual)))
    return std::nullopt;
  bool prescribed = false;
  for (std::int32_t dof : coupling.fixed_dofs)
    prescribed = prescribed or !std::isfinite(residual[dof]);
  if (any(comm, prescribed))
    return Infinite{Infinite::Kind::prescribed, {}};
  const std::vector<double> X = coupling.layout.owned(coupling.layout.X, 3);
  std::array<double, 3> at = {infinity, infinity, infinity};
  for (std::size_t k = 0; k < X.size(); k += 3)
  {
    if (!finite(residual.subspan(k, 3)))
      at = std::min(at, {X[k], X[k + 1], X[k + 2]});
  }
  int size;
  MPI_Comm_size(comm, &size);
  std::vector<std::array<double, 3>> all(size);
  MPI_Allgather(at.data(), 3, MPI_DOUBLE, all.data(), 3, MPI_DOUBLE, comm);
  at = *std::ranges::min_element(all);
  return Infinite{std::isfinite(at[0]) ? Infinite::Kind::force
                                       : Infinite::Kind::traction,
                  at};
}
