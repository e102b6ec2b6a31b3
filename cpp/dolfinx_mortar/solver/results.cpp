// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "results.h"
#include "checks.h"
#include "recovery.h"
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <map>

using namespace dolfinx_mortar;

namespace
{
/// How one value is made of those of several slave nodes at one place.
enum class Combine
{
  mean,    ///< weighted by a measure
  largest, ///< largest value
  smallest,
  first ///< value of the node with the largest measure
};

/// Give nodes without a multiplier the mean of their facets' nodes that have
/// one, at the middle of an edge that of its ends. Collective.
/// @param[in] values Values of local nodes, shape (n, columns).
std::vector<double> spread(const Surface& s,
                           std::span<const std::int8_t> has_multiplier,
                           std::span<const double> values, int columns)
{
  // Sums over facets of values and of their number
  const int width = columns + 1;
  std::vector<double> sums(width * num_local_nodes(s), 0.0);
  auto add_mean = [&](std::int32_t node, const auto& others)
  {
    const auto count = std::ranges::count_if(others, [&](auto k)
                                             { return has_multiplier[k]; });
    for (auto k : others)
    {
      for (int c = 0; c < columns and has_multiplier[k]; ++c)
        sums[width * node + c] += values[columns * k + c] / count;
    }
    sums[width * node + columns] += count > 0;
    return count > 0;
  };
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    auto nodes = facet_nodes(s, f);
    const auto edges = edge_corners(s.types[f]);
    const std::size_t nc = num_corners(s.types[f]);
    for (std::size_t i = 0; i < nodes.size(); ++i)
    {
      if (i >= nc and i < 2 * nc
          and add_mean(nodes[i], std::array{nodes[edges[i - nc][0]],
                                            nodes[edges[i - nc][1]]}))
        continue;
      add_mean(nodes[i], nodes);
    }
  }
  scatter_reverse_add(s, std::span(sums), width);
  scatter_forward(s, std::span(sums), width);
  std::vector<double> out(values.size(), 0.0);
  for (std::int32_t k = 0; k < num_local_nodes(s); ++k)
  {
    const double count = sums[width * k + columns];
    for (int c = 0; c < columns; ++c)
    {
      if (has_multiplier[k])
        out[columns * k + c] = values[columns * k + c];
      else if (count > 0)
        out[columns * k + c] = sums[width * k + c] / count;
    }
  }
  return out;
}

/// One value for each displacement node.
Field combine(std::string name, const Surface& s,
              std::span<const double> values, int columns, Combine how,
              std::span<const double> measure = {})
{
  std::map<std::int32_t, std::vector<std::int32_t>> groups;
  for (std::int32_t k = 0; k < s.num_owned; ++k)
    groups[s.local_blocks[k]].push_back(k);
  Field field{std::move(name), columns, {}, {}};
  for (const auto& [block, nodes] : groups)
  {
    field.nodes.push_back(block);
    std::vector<double> value(columns, 0.0);
    double total = 0;
    for (std::int32_t k : nodes)
      total += how == Combine::mean ? measure[k] : 0.0;
    std::int32_t lead = nodes.front();
    for (std::int32_t k : nodes)
    {
      if (how == Combine::first and measure[k] > measure[lead])
        lead = k;
    }
    for (int c = 0; c < columns; ++c)
    {
      value[c] = values[columns * lead + c];
      if (nodes.size() == 1 or how == Combine::first)
        continue;
      double mean = 0;
      for (std::int32_t k : nodes)
      {
        const double v = values[columns * k + c];
        if (how == Combine::largest)
          value[c] = std::max(value[c], v);
        if (how == Combine::smallest)
          value[c] = std::min(value[c], v);
        if (how == Combine::mean)
          mean += (total > 0 ? measure[k] / total : 1.0 / nodes.size()) * v;
      }
      if (how == Combine::mean)
        value[c] = mean;
    }
    field.values.insert(field.values.end(), value.begin(), value.end());
  }
  return field;
}

std::vector<double> extend(const Surface& s, std::span<const double> owned,
                           int columns)
{
  std::vector<double> local(columns * num_local_nodes(s), 0.0);
  std::ranges::copy(owned, local.begin());
  scatter_forward(s, std::span(local), columns);
  return local;
}
} // namespace

//-----------------------------------------------------------------------------
const Evaluation& dolfinx_mortar::last_evaluation(const ContactProblem& problem)
{
  const Evaluation* evaluation = problem.evaluation();
  if (!evaluation)
  {
    throw std::runtime_error(
        "There is no solution yet: call solve() of the ContactProblem first.");
  }
  return *evaluation;
}
//-----------------------------------------------------------------------------
std::vector<Field> dolfinx_mortar::results(const ContactProblem& problem,
                                           std::size_t interface)
{
  const CoupledInterface& c = problem.coupling().interfaces.at(interface);
  const State& state = problem.state();
  const InterfaceState& own = state.interfaces[interface];
  if (!c.is_tie() and !problem.evaluation())
    return {};
  const Surface& s = c.data.slave;
  const auto& has_multiplier = own.basis.has_multiplier;
  const std::vector<double> z
      = local_multipliers(problem.coupling(), interface, state.z);
  const InterfaceGeometry& geometry
      = problem.evaluation()
            ? *problem.evaluation()->interfaces[interface].geometry
            : *problem.step().geometry[interface];
  std::vector<double> shares(geometry.nodal.weight.begin(),
                             geometry.nodal.weight.begin() + s.num_owned);
  for (double& w : shares)
    w = std::max(w, 0.0);

  std::vector<Field> fields;
  auto put = [&](const std::string& name, std::span<const double> values,
                 int columns, Combine how, std::span<const double> measure = {})
  {
    fields.push_back(combine(name, s,
                             spread(s, has_multiplier, values, columns),
                             columns, how, measure));
  };
  std::vector<double> traction = z;
  for (double& t : traction)
    t = -t;
  put("multiplier", z, 3, Combine::mean, shares);
  put("traction", traction, 3, Combine::mean, shares);
  const std::vector<double> recovered
      = recover(c.data, own.basis, geometry.configuration, z);
  std::ranges::transform(recovered, traction.begin(), std::negate());
  fields.push_back(
      combine("recovered_traction", s, traction, 3, Combine::mean, shares));
  if (c.is_tie())
    return fields;

  const std::span<const double> normals = geometry.configuration.normals.n;
  std::vector<double> pressure(num_local_nodes(s)), tangential(z.size()),
      mean(num_local_nodes(s));
  for (std::size_t k = 0; k < pressure.size(); ++k)
  {
    const Eigen::Map<const Eigen::Vector3d> n(normals.data() + 3 * k),
        zk(z.data() + 3 * k);
    pressure[k] = n.dot(zk);
    mean[k]
        = n.dot(Eigen::Map<const Eigen::Vector3d>(recovered.data() + 3 * k));
    Eigen::Map<Eigen::Vector3d>(tangential.data() + 3 * k)
        = pressure[k] * n - zk;
  }
  const InterfaceEvaluation& e = problem.evaluation()->interfaces[interface];
  std::vector<double> status;
  for (Status v : own.status)
    status.push_back(static_cast<double>(v));
  put("pressure", pressure, 1, Combine::largest);
  fields.push_back(combine("recovered_pressure", s, mean, 1, Combine::largest));
  put("tangential_traction", tangential, 3, Combine::mean, shares);
  put("gap", extend(s, shown_gaps(c, own.basis, e, own.status), 1), 1,
      Combine::smallest);
  put("slip", extend(s, own.slip, 3), 3, Combine::first, status);
  fields.push_back(combine("status", s, status, 1, Combine::largest));
  return fields;
}
//-----------------------------------------------------------------------------
std::vector<double>
dolfinx_mortar::facet_multipliers(const ContactProblem& problem,
                                  std::size_t interface)
{
  const Evaluation& evaluation = last_evaluation(problem);
  const Coupling& coupling = problem.coupling();
  const State& state = problem.state();
  return facet_multipliers(
      coupling.interfaces.at(interface).data, state.interfaces[interface].basis,
      evaluation.interfaces[interface].geometry->configuration,
      local_multipliers(coupling, interface, state.z));
}
//-----------------------------------------------------------------------------
std::int64_t dolfinx_mortar::num_multiplier_nodes(const ContactProblem& problem,
                                                  std::size_t interface)
{
  const auto& flags
      = problem.state().interfaces.at(interface).basis.has_multiplier;
  const std::int32_t n = problem.coupling().interfaces[interface].num_owned();
  const std::int64_t count = std::count_if(flags.begin(), flags.begin() + n,
                                           [](auto f) { return f != 0; });
  return sum(problem.coupling().comm(), count);
}
//-----------------------------------------------------------------------------
Resultants dolfinx_mortar::resultants(const ContactProblem& problem,
                                      std::size_t interface)
{
  const Coupling& coupling = problem.coupling();
  const State& state = problem.state();
  const Evaluation& evaluation = last_evaluation(problem);
  const CoupledInterface& c = coupling.interfaces.at(interface);
  BlockAccumulator<1, 1> D, M;
  integrate(c.data, state.interfaces[interface].basis,
            evaluation.interfaces[interface].geometry->configuration,
            {.D = &D, .M = &M});
  const std::int32_t rows = coupling.size(), columns = coupling.layout.size();
  std::vector<double> z(rows, 0.0);
  std::ranges::copy(
      coupling.part(std::span<const double>(state.z), interface, 3),
      coupling.part(std::span(z), interface, 3).begin());
  std::vector<double> x = coupling.layout.owned(coupling.layout.X, 3);
  for (std::size_t i = 0; i < x.size() and c.is_current(); ++i)
    x[i] += state.u[i];
  auto resultant = [&](BlockAccumulator<1, 1>& blocks, double sign)
  {
    const Matrix A = blocks.assemble(coupling.comm(), rows, columns);
    const std::vector<double> f = multiply_transposed(A.get(), z);
    std::vector<double> sums(6, 0.0);
    for (std::size_t k = 0; k < f.size(); k += 3)
    {
      for (int d = 0; d < 3; ++d)
      {
        const int e = (d + 1) % 3, g = (d + 2) % 3;
        sums[d] += sign * f[k + d];
        sums[3 + d] += sign * (x[k + e] * f[k + g] - x[k + g] * f[k + e]);
      }
    }
    return sum(coupling.comm(), std::move(sums));
  };
  const std::vector<double> s = resultant(D, -1), m = resultant(M, 1);
  return {{s[0], s[1], s[2]},
          {m[0], m[1], m[2]},
          {s[3], s[4], s[5]},
          {m[3], m[4], m[5]}};
}
//-----------------------------------------------------------------------------
std::array<double, 3> dolfinx_mortar::tool_point(const ContactProblem& problem,
                                                 std::size_t interface)
{
  last_evaluation(problem);
  const CoupledInterface& c = problem.coupling().interfaces.at(interface);
  if (!c.data.tool)
    throw std::invalid_argument("The interface has no rigid tool.");
  const Tool& tool = *c.data.tool;
  if (!c.is_current())
    return tool.point;
  const std::vector<double> u = problem.bodies().extend(problem.state().u);
  std::array<double, 12> x = tool.X;
  for (int l = 0; l < 4; ++l)
  {
    for (int d = 0; d < 3; ++d)
      x[3 * l + d] += u[3 * tool.local_blocks[l] + d];
  }
  const FrameView reference(tool.X), now(x);
  const Vec3 point
      = now.origin + now.axes * reference.coordinates(Vec3(tool.point.data()));
  return {point[0], point[1], point[2]};
}
