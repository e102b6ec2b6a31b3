// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "mortar.h"
#include "facet_loop.h"

using namespace dolfinx_mortar;

namespace
{
/// Sums over facets of what belongs to a node: coverage, diagonal, weight, gap,
/// jump, touching facets, normal of masters, covered area and volume.
constexpr int num_sums = 13;

void add_sums(const FacetIntegrals& r, std::span<const std::int32_t> nodes,
              std::vector<double>& sums)
{
  for (std::size_t k = 0; k < nodes.size(); ++k)
  {
    double* v = sums.data() + num_sums * nodes[k];
    v[0] += r.coverage[k];
    v[1] += r.diagonal[k];
    v[2] += r.M.row(k).sum();
    v[3] += r.gap[k];
    for (int c = 0; c < 3; ++c)
      v[4 + c] += r.jump(k, c);
    v[7] += r.touches[k];
    for (int c = 0; c < 3; ++c)
      v[8 + c] += r.master_normal(k, c);
    v[11] += r.area;
    v[12] += r.volume;
  }
}

void set_nodal_values(std::span<const double> sums, NodalIntegrals& out)
{
  for (std::size_t i = 0; i < sums.size(); i += num_sums)
  {
    const double* v = sums.data() + i;
    out.coverage.push_back(v[0]);
    out.diagonal.push_back(v[1]);
    out.weight.push_back(v[2]);
    out.gap.push_back(v[3]);
    out.jump.insert(out.jump.end(), v + 4, v + 7);
    out.near.push_back(v[7] > 0);
    out.master_normal.insert(out.master_normal.end(), v + 8, v + 11);
    out.distance.push_back(v[11] > 0 ? v[12] / v[11] : 0.0);
  }
}

void note_without_multipliers(std::span<const double> x,
                              std::span<const std::int32_t> nodes,
                              NodalIntegrals& out)
{
  if (out.num_without_multipliers++ > 0)
    return;
  for (auto k : nodes)
  {
    for (int c = 0; c < 3; ++c)
      out.without_multipliers[c] += x[3 * k + c] / nodes.size();
  }
}

void add_matrices(const MortarBlocks& blocks,
                  std::span<const std::int64_t> rows,
                  std::span<const std::int64_t> columns,
                  const FacetIntegrals& r)
{
  if (blocks.D)
    blocks.D->add(rows, columns, r.D.data());
  if (blocks.M)
    blocks.M->add(rows, r.master_blocks, r.M.data());
  if (blocks.B)
  {
    blocks.B->add(rows, columns, r.D.data());
    blocks.B->add(rows, r.master_blocks, r.M.data(), -1);
  }
  if (blocks.B_tilde)
  {
    blocks.B_tilde->add(rows, columns, r.D_tilde.data());
    blocks.B_tilde->add(rows, r.master_blocks, r.M.data(), -1);
  }
}
} // namespace

//-----------------------------------------------------------------------------
NodalIntegrals dolfinx_mortar::integrate(const Interface& interface,
                                         const Basis& basis,
                                         const Configuration& configuration,
                                         const MortarBlocks& blocks)
{
  const Surface& s = interface.slave;
  const std::size_t num = num_local_nodes(s);
  const std::vector<double> z(3 * num, 0.0);
  std::vector<double> sums(num_sums * num, 0.0);
  NodalIntegrals out;
  out.facet_area.resize(s.types.size(), 0.0);
  out.nearest.resize(s.types.size(), 0.0);
  out.lost.resize(s.types.size(), 0.0);
  out.beyond.resize(s.types.size(), 0.0);
  std::vector<std::int64_t> rows, columns;
  auto use = [&](std::int32_t f, std::span<const std::int32_t> nodes,
                 const FacetIntegrals& r)
  {
    out.dropped_area += r.dropped_area;
    out.lost[f] = r.lost;
    if (r.without_multipliers)
      note_without_multipliers(configuration.x_slave, nodes, out);
    else
      out.beyond[f] = r.beyond;
    if (!r.covered)
      return;
    out.area += r.area;
    out.facet_area[f] = r.area;
    out.nearest[f] = r.nearest;
    ++out.num_covered;
    out.num_points += r.num_points;
    out.num_pairs += configuration.candidates.offsets[f + 1]
                     - configuration.candidates.offsets[f];
    add_sums(r, nodes, sums);
    rows.clear();
    columns.clear();
    for (auto k : nodes)
    {
      rows.push_back(basis.has_multiplier[k] ? interface.multipliers[k] : -1);
      columns.push_back(s.blocks[k]);
    }
    add_matrices(blocks, rows, columns, r);
  };
  for_each_facet(interface, basis, configuration, z, {}, Derivatives::none,
                 use);
  scatter_reverse_add(s, std::span<double>(sums), num_sums);
  scatter_forward(s, std::span<double>(sums), num_sums);
  set_nodal_values(sums, out);
  return out;
}
