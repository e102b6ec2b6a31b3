// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "recovery.h"
#include <algorithm>
#include <dolfinx_mortar/assembly/basis.h>
#include <dolfinx_mortar/assembly/facet_loop.h>
#include <dolfinx_mortar/multiplier/multiplier.h>

using namespace dolfinx_mortar;

namespace
{
/// ψ_c at the nodes of a facet, shape (nodes, nodes): columns of corners. They
/// are sums of N with these coefficients, ψ_c = Σ_k N_k ψ_c(x_k).
FacetMatrix corner_functions(FacetType type)
{
  return transformation(MultiplierSpace::dual_linear, type)
      .leftCols(num_corners(type));
}

/// Values of the nodes of a facet, shape (nodes.size(), 3)
RowMatrix rows(std::span<const double> z, std::span<const std::int32_t> nodes)
{
  RowMatrix values(nodes.size(), 3);
  for (std::size_t k = 0; k < nodes.size(); ++k)
  {
    values.row(k)
        = Eigen::Map<const Eigen::RowVector3d>(z.data() + 3 * nodes[k]);
  }
  return values;
}
} // namespace

//-----------------------------------------------------------------------------
std::vector<double> dolfinx_mortar::recover(const Interface& interface,
                                            const Basis& basis,
                                            const Configuration& configuration,
                                            std::span<const double> z)
{
  const Surface& s = interface.slave;
  std::vector<double> loads(3 * num_local_nodes(s), 0.0);
  for_each_facet(interface, basis, configuration, z, {}, Derivatives::none,
                 [&](std::int32_t f, std::span<const std::int32_t> nodes,
                     const FacetIntegrals& r)
                 {
                   if (!r.covered)
                     return;
                   const RowMatrix load
                       = corner_functions(s.types[f]).transpose()
                         * (r.D.transpose() * rows(z, nodes));
                   for (int c = 0; c < num_corners(s.types[f]); ++c)
                   {
                     for (int i = 0; i < 3; ++i)
                       loads[3 * nodes[c] + i] += load(c, i);
                   }
                 });
  scatter_reverse_add(s, std::span(loads), 3);
  scatter_forward(s, std::span(loads), 3);
  const std::vector<double> weights
      = nodal_weights(s, MultiplierSpace::dual_linear, basis.nonnegative,
                      configuration.x_slave);

  // The same from all facets of a node. A rank may own nodes that only other
  // ranks' facets touch: values, and the number of ranks that have them
  std::vector<double> sums(4 * num_local_nodes(s), 0.0);
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    auto nodes = facet_nodes(s, f);
    const FacetMatrix psi = corner_functions(s.types[f]);
    for (std::size_t k = 0; k < nodes.size(); ++k)
    {
      double* v = sums.data() + 4 * nodes[k];
      for (int i = 0; i < 3; ++i)
      {
        v[i] = 0;
        for (int c = 0; c < psi.cols(); ++c)
          v[i] += psi(k, c) * loads[3 * nodes[c] + i] / weights[nodes[c]];
      }
      v[3] = 1;
    }
  }
  scatter_reverse_add(s, std::span(sums), 4);
  scatter_forward(s, std::span(sums), 4);
  std::vector<double> out(loads.size());
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i] = sums[4 * (i / 3) + i % 3] / std::max(sums[4 * (i / 3) + 3], 1.0);
  return out;
}
//-----------------------------------------------------------------------------
std::vector<double> dolfinx_mortar::facet_multipliers(
    const Interface& interface, const Basis& basis,
    const Configuration& configuration, std::span<const double> z)
{
  const Surface& s = interface.slave;
  std::vector<double> values(3 * s.nodes.size(), 0.0);
  for_each_facet(interface, basis, configuration, z, {}, Derivatives::none,
                 [&](std::int32_t f, std::span<const std::int32_t> nodes,
                     const FacetIntegrals& r)
                 {
                   if (!r.covered)
                     return;
                   Eigen::Map<RowMatrix>(values.data() + 3 * s.offsets[f],
                                         nodes.size(), 3)
                       = r.functions.transpose() * rows(z, nodes);
                 });
  return values;
}
