// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "derivative.h"
#include <Eigen/Dense>
#include <dolfinx_mortar/assembly/facet_loop.h>

using namespace dolfinx_mortar;

namespace
{
using Mat3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

/// Derivatives of the conditions of a row by the values of a node.
struct Weights
{
  std::int64_t row; // multiplier number, -1 for none
  Eigen::Vector3d g;
  Mat3 n, w;
};

/// For each local slave node, the rows that its gap, normal and slip are in:
/// its own, and at an edge that of another patch.
class NodeWeights
{
public:
  /// Ghosts get those of their owners. Collective.
  NodeWeights(const Interface& interface, const ContactResidual& law)
      : _values(num_local_nodes(interface.slave) * 2 * size, 0.0)
  {
    const Surface& s = interface.slave;
    for (std::size_t slot = 0; slot < _values.size(); slot += size)
      _values[slot] = -1;
    for (std::int32_t j = 0; j < s.num_owned; ++j)
    {
      if (law.status[j] != Status::open)
      {
        put(2 * j, interface.multipliers[j], law.dg.data() + 3 * j,
            law.dn.data() + 9 * j, law.dw.data() + 9 * j);
      }
    }
    const ContactCouplings& c = law.couplings;
    for (std::size_t i = 0; i < c.rows.size(); ++i)
    {
      put(2 * c.columns[i] + 1, interface.multipliers[c.rows[i]],
          c.dg.data() + 3 * i, c.dn.data() + 9 * i, c.dw.data() + 9 * i);
    }
    scatter_forward(s, std::span<double>(_values), 2 * size);
  }

  /// @param[in] node Local slave node.
  /// @param[in] which 0 for its own row, 1 for that of another patch.
  Weights get(std::int32_t node, int which) const
  {
    const double* v = _values.data() + (2 * node + which) * size;
    return {static_cast<std::int64_t>(v[0]),
            Eigen::Map<const Eigen::Vector3d>(v + 1),
            Eigen::Map<const Mat3>(v + 4), Eigen::Map<const Mat3>(v + 13)};
  }

private:
  static constexpr int size = 1 + 3 + 9 + 9;

  void put(std::int32_t slot, std::int64_t row, const double* g,
           const double* n, const double* w)
  {
    double* v = _values.data() + slot * size;
    v[0] = row;
    std::copy_n(g, 3, v + 1);
    std::copy_n(n, 9, v + 4);
    std::copy_n(w, 9, v + 13);
  }

  std::vector<double> _values;
};

/// Flags of the local slave nodes on whose normals some condition depends.
/// Collective.
std::vector<std::int8_t>
nodes_around_contact(const Surface& s, std::span<const std::int8_t> closed)
{
  std::vector<std::int32_t> around(num_local_nodes(s), 0);
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    auto nodes = facet_nodes(s, f);
    if (std::ranges::any_of(nodes, [&](auto k) { return closed[k]; }))
    {
      for (auto k : nodes)
        around[k] = 1;
    }
  }
  scatter_reverse_add(s, std::span<std::int32_t>(around), 1);
  scatter_forward(s, std::span<std::int32_t>(around), 1);
  std::vector<std::int8_t> flags(around.size());
  std::ranges::transform(around, flags.begin(), [](auto n) { return n > 0; });
  return flags;
}

/// Add ∂n/∂u of the flagged nodes.
void add_normal_derivatives(const Interface& interface,
                            const Configuration& configuration,
                            std::span<const std::int8_t> flags,
                            BlockAccumulator<3, 3>& normals)
{
  const Surface& s = interface.slave;
  std::vector<double> dn;
  std::vector<std::int64_t> rows, columns;
  for (std::int32_t f = 0; f < static_cast<std::int32_t>(s.types.size()); ++f)
  {
    auto nodes = facet_nodes(s, f);
    if (std::ranges::none_of(nodes, [&](auto k) { return flags[k]; }))
      continue;
    dn.resize(9 * nodes.size() * nodes.size());
    normal_derivative(s, configuration.x_slave, interface.fixed,
                      configuration.normals, f, dn);
    rows.clear();
    columns.clear();
    for (auto k : nodes)
    {
      rows.push_back(flags[k] ? interface.multipliers[k] : -1);
      columns.push_back(s.blocks[k]);
    }
    normals.add(rows, columns, dn.data());
  }
}
/// The same of an analytic tool's normals, at owned nodes.
void add_tool_derivatives(const Interface& interface,
                          const Configuration& configuration,
                          std::span<const std::int8_t> flags,
                          BlockAccumulator<3, 3>& normals)
{
  const Surface& s = interface.slave;
  const Frame& tool = *configuration.candidates.master.frame;
  const FrameView frame(tool.x);
  Eigen::Matrix<double, 3, 15> d;
  Eigen::Matrix<double, 3, 15, Eigen::RowMajor> rows;
  for (std::int32_t k = 0; k < s.num_owned; ++k)
  {
    if (!flags[k])
      continue;
    opposing_normal(
        *tool.shape, frame,
        Eigen::Vector3d(configuration.x_slave.data() + 3 * k),
        std::span<const std::int8_t, 3>(interface.fixed.data() + 3 * k, 3), &d);
    rows = d;
    std::vector<std::int64_t> columns = {s.blocks[k]};
    columns.insert(columns.end(), tool.blocks.begin(), tool.blocks.end());
    normals.add(std::span(&interface.multipliers[k], 1), columns, rows.data());
  }
}
} // namespace

//-----------------------------------------------------------------------------
void dolfinx_mortar::add_current_derivatives(
    const Interface& interface, const Basis& basis,
    const Configuration& configuration, const ContactResidual& law,
    bool with_slip, std::span<const double> z, ContactDerivatives& derivatives)
{
  const Surface& s = interface.slave;
  const NodeWeights weights(interface, law);
  std::vector<std::int8_t> closed(num_local_nodes(s), 0);
  for (std::size_t k = 0; k < closed.size(); ++k)
    closed[k] = weights.get(k, 0).row >= 0;

  std::vector<std::int64_t> blocks, multipliers;
  RowMatrix rows;
  auto use = [&](std::int32_t, std::span<const std::int32_t> nodes,
                 const FacetIntegrals& r)
  {
    if (!r.covered)
      return;
    blocks.clear();
    multipliers.clear();
    for (auto k : nodes)
    {
      blocks.push_back(s.blocks[k]);
      multipliers.push_back(interface.multipliers[k]);
    }
    blocks.insert(blocks.end(), r.master_blocks.begin(), r.master_blocks.end());
    derivatives.force.add(blocks, blocks, r.d_force.data());
    for (std::size_t a = 0; a < nodes.size(); ++a)
    {
      if (!basis.has_multiplier[nodes[a]])
        continue;
      for (int which : {0, 1})
      {
        const Weights v = weights.get(nodes[a], which);
        if (v.row < 0)
          continue;
        rows.noalias() = v.g * r.d_gap.row(a);
        if (with_slip)
          rows.noalias() += v.w * r.d_jump.middleRows(3 * a, 3);
        derivatives.constraints.add(std::span(&v.row, 1), blocks, rows.data());
        rows.noalias() = v.g * r.d_gap_normal.row(a);
        derivatives.by_normals.add(std::span(&v.row, 1), multipliers,
                                   rows.data());
      }
    }
  };
  for_each_facet(interface, basis, configuration, z, closed,
                 with_slip ? Derivatives::gap_and_slip : Derivatives::gap, use);

  for (std::int32_t k = 0; k < s.num_owned; ++k)
  {
    for (int which : {0, 1})
    {
      const Weights v = weights.get(k, which);
      if (v.row >= 0)
        derivatives.by_normals.add(v.row, interface.multipliers[k], v.n.data());
    }
  }
  // A given normal does not turn
  if (interface.is_analytic())
  {
    add_tool_derivatives(interface, configuration,
                         nodes_around_contact(s, closed), derivatives.normals);
  }
  else if (!interface.normal)
  {
    add_normal_derivatives(interface, configuration,
                           nodes_around_contact(s, closed),
                           derivatives.normals);
  }
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::add_matrix_derivatives(const Interface& interface,
                                            const Configuration& configuration,
                                            const ContactResidual& law,
                                            bool by_gap, bool by_slip, Mat B,
                                            ContactDerivatives& derivatives)
{
  // Block of a row by one of B, which is a multiple of the identity
  auto add =
      [&](std::int64_t row, std::int32_t k, const double* dg, const double* dw)
  {
    const Eigen::Map<const Eigen::Vector3d> n(configuration.normals.n.data()
                                              + 3 * k);
    Mat3 block = Mat3::Zero();
    if (by_gap)
      block -= Eigen::Map<const Eigen::Vector3d>(dg) * n.transpose();
    if (by_slip)
      block -= Eigen::Map<const Mat3>(dw);
    const MatrixRow b(B, 3 * interface.multipliers[k]);
    for (std::size_t i = 0; i < b.columns().size(); ++i)
    {
      derivatives.constraints.add(row, b.columns()[i] / 3, block.data(),
                                  b.values()[i]);
    }
  };
  for (std::int32_t k = 0; k < interface.slave.num_owned; ++k)
  {
    if (law.status[k] != Status::open)
    {
      add(interface.multipliers[k], k, law.dg.data() + 3 * k,
          law.dw.data() + 9 * k);
    }
  }
  const ContactCouplings& c = law.couplings;
  for (std::size_t i = 0; i < c.rows.size(); ++i)
  {
    add(interface.multipliers[c.rows[i]], c.columns[i], c.dg.data() + 3 * i,
        c.dw.data() + 9 * i);
  }
}
