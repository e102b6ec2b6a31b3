// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "coupling.h"
#include "block_accumulator.h"
#include "error.h"
#include "integrals.h"
#include "patches.h"
#include <algorithm>
#include <map>
#include <stdexcept>

using namespace dolfinx_mortar;

namespace
{
/// Share of the area from which on a facet counts as covered. Segments on
/// curved facets leave seams of some per mille; 0.9 and 0.995 give the same
/// iterations in the demo of sliding shells.
constexpr double whole = 0.97;

void check(PetscErrorCode code, const char* what)
{
  if (code != PETSC_SUCCESS)
    throw std::runtime_error(std::string("PETSc failed in ") + what);
}

/// Values of the nodes of a facet, gathered from values of all local nodes.
template <typename T>
void gather(std::span<const std::int32_t> nodes, std::span<const T> values,
            int bs, std::vector<T>& out)
{
  out.resize(nodes.size() * bs);
  for (std::size_t i = 0; i < nodes.size(); ++i)
    std::copy_n(values.begin() + bs * nodes[i], bs, out.begin() + bs * i);
}

/// Calls `use(facet, nodes, integrals)` for every covered slave facet.
template <typename Use>
void for_each_facet(const Interface& interface, const Configuration& conf,
                    std::span<const double> z,
                    std::span<const std::int8_t> wanted,
                    Derivatives derivatives, Use&& use)
{
  const Surface& s = interface.slave;
  FacetIntegrator integrator(interface.options);
  std::vector<double> x, n, zf;
  std::vector<std::int8_t> carries, positive, wanted_f;
  std::string message;
  try
  {
    for (std::int32_t f = 0; f < static_cast<std::int32_t>(s.types.size()); ++f)
    {
      const std::int32_t begin = conf.candidates.offsets[f];
      const std::int32_t end = conf.candidates.offsets[f + 1];
      if (begin == end)
        continue;
      auto nodes = facet_nodes(s, f);
      gather(nodes, z, 3, zf);
      if (!wanted.empty())
      {
        gather(nodes, wanted, 1, wanted_f);
        auto zero = [](auto v) { return v == 0; };
        if (std::all_of(zf.begin(), zf.end(), zero)
            and std::all_of(wanted_f.begin(), wanted_f.end(), zero))
        {
          continue;
        }
      }
      gather(nodes, std::span<const double>(conf.x_slave), 3, x);
      gather(nodes, std::span<const double>(conf.normals.n), 3, n);
      gather(nodes, std::span<const std::int8_t>(interface.carries), 1,
             carries);
      for (std::size_t i = 0; i < nodes.size(); ++i)
      {
        if (carries[i] == 0 and interface.idle[nodes[i]] != 0)
          carries[i] = -1;
      }
      gather(nodes, std::span<const std::int8_t>(interface.positive), 1,
             positive);
      const FacetIntegrals& r = integrator.compute(
          {s.types[f], s.orientation[f], x}, n, carries, positive, zf,
          conf.candidates.master,
          std::span(conf.candidates.facets).subspan(begin, end - begin),
          derivatives);
      use(f, nodes, r);
    }
  }
  catch (const std::exception& e)
  {
    message = e.what();
  }
  throw_on_all(s.comm, message);
}
} // namespace

//-----------------------------------------------------------------------------
Interface dolfinx_mortar::create_interface(Surface slave, Surface master,
                                           const IntegrationOptions& options)
{
  const std::size_t num = num_local_nodes(slave);
  std::vector<std::int32_t> uses(num, 0);
  for (std::size_t f = 0; f < slave.types.size(); ++f)
  {
    const int n = num_multipliers(options.space, slave.types[f]);
    for (std::int32_t k : facet_nodes(slave, f).first(n))
      uses[k] = 1;
  }
  // A rank may own nodes that only other ranks' facets touch
  scatter_reverse_add(slave, std::span(uses), 1);
  scatter_forward(slave, std::span(uses), 1);
  std::vector<std::int8_t> carries(num);
  std::transform(uses.begin(), uses.end(), carries.begin(),
                 [](auto n) { return n > 0; });
  std::vector<std::int64_t> multipliers = slave.numbers;
  return {std::move(slave),
          std::move(master),
          options,
          std::move(multipliers),
          std::move(carries),
          std::vector<std::int8_t>(num, 0),
          std::vector<std::int8_t>(num, 0),
          std::vector<std::int8_t>(3 * num, 0)};
}
//-----------------------------------------------------------------------------
Configuration dolfinx_mortar::configure(const Interface& interface,
                                        std::vector<double> x_slave,
                                        std::vector<double> x_master)
{
  Normals normals = compute_normals(interface.slave, x_slave, interface.fixed);
  Candidates candidates = find_candidates(
      interface.slave, x_slave, interface.master, x_master,
      interface.options.distance, interface.options.leave_distant ? 2 : 1);
  return {std::move(x_slave), std::move(x_master), std::move(normals),
          std::move(candidates)};
}
//-----------------------------------------------------------------------------
NodalIntegrals dolfinx_mortar::integrate(const Interface& interface,
                                         const Configuration& configuration,
                                         const CouplingMatrices& matrices)
{
  const Surface& s = interface.slave;
  const std::size_t num = num_local_nodes(s);
  const std::vector<double> z(3 * num, 0.0);
  // Columns of nodal values: coverage, diagonal, weight, gap, offset, touching
  // facets, normal of masters, covered area and volume below the facets
  constexpr int columns_of_node = 13;
  std::vector<double> nodal(columns_of_node * num, 0.0);
  NodalIntegrals out;
  out.facet_area.resize(s.types.size(), 0.0);
  out.lost.resize(s.types.size(), 0.0);
  out.beyond.resize(s.types.size(), 0.0);
  BlockAccumulator<1, 1> D, M, B, B_tilde;
  std::vector<std::int64_t> rows, columns;
  for_each_facet(interface, configuration, z, {}, Derivatives::none,
                 [&](std::int32_t f, std::span<const std::int32_t> nodes,
                     const FacetIntegrals& r)
                 {
                   out.dropped_area += r.dropped_area;
                   out.lost[f] = r.lost;
                   if (r.orphan)
                   {
                     if (out.num_orphans++ == 0)
                     {
                       for (auto k : nodes)
                       {
                         for (int c = 0; c < 3; ++c)
                         {
                           out.orphan[c] += configuration.x_slave[3 * k + c]
                                            / nodes.size();
                         }
                       }
                     }
                   }
                   if (!r.covered)
                     return;
                   out.area += r.area;
                   out.facet_area[f] = r.area;
                   out.beyond[f] = r.beyond;
                   ++out.num_covered;
                   out.num_pairs += configuration.candidates.offsets[f + 1]
                                    - configuration.candidates.offsets[f];
                   rows.clear();
                   columns.clear();
                   for (std::size_t k = 0; k < nodes.size(); ++k)
                   {
                     double* v = nodal.data() + columns_of_node * nodes[k];
                     v[0] += r.coverage[k];
                     v[1] += r.diagonal[k];
                     v[2] += r.M.row(k).sum();
                     v[3] += r.gap[k];
                     for (int c = 0; c < 3; ++c)
                       v[4 + c] += r.offset(k, c);
                     v[7] += r.touches[k];
                     for (int c = 0; c < 3; ++c)
                       v[8 + c] += r.master_normal(k, c);
                     v[11] += r.area;
                     v[12] += r.volume;
                     rows.push_back(interface.carries[nodes[k]]
                                        ? interface.multipliers[nodes[k]]
                                        : -1);
                     columns.push_back(s.blocks[nodes[k]]);
                   }
                   if (matrices.D)
                     D.add(rows, columns, r.D.data());
                   if (matrices.M)
                     M.add(rows, r.master_blocks, r.M.data());
                   if (matrices.B)
                   {
                     B.add(rows, columns, r.D.data());
                     B.add(rows, r.master_blocks, r.M.data(), -1);
                   }
                   if (matrices.B_tilde)
                   {
                     B_tilde.add(rows, columns, r.D_tilde.data());
                     B_tilde.add(rows, r.master_blocks, r.M.data(), -1);
                   }
                 });
  D.flush(matrices.D);
  M.flush(matrices.M);
  B.flush(matrices.B);
  B_tilde.flush(matrices.B_tilde);

  scatter_reverse_add(s, std::span<double>(nodal), columns_of_node);
  scatter_forward(s, std::span<double>(nodal), columns_of_node);
  for (std::size_t i = 0; i < num; ++i)
  {
    const double* v = nodal.data() + columns_of_node * i;
    out.coverage.push_back(v[0]);
    out.diagonal.push_back(v[1]);
    out.weight.push_back(v[2]);
    out.gap.push_back(v[3]);
    out.offset.insert(out.offset.end(), v + 4, v + 7);
    out.near.push_back(v[7] > 0);
    out.master_normal.insert(out.master_normal.end(), v + 8, v + 11);
    out.distance.push_back(v[11] > 0 ? v[12] / v[11] : 0.0);
  }
  return out;
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::integrate_derivatives(const Interface& interface,
                                           const Configuration& configuration,
                                           std::span<const double> z,
                                           std::span<const std::int8_t> active,
                                           const DerivativeMatrices& matrices)
{
  const Surface& s = interface.slave;
  std::vector<std::int64_t> blocks, multipliers, rows;
  const Derivatives derivatives
      = matrices.offset ? Derivatives::gap_and_slip : Derivatives::gap;
  BlockAccumulator<3, 3> force, offset;
  BlockAccumulator<1, 3> gap, gap_normal;
  for_each_facet(interface, configuration, z, active, derivatives,
                 [&](std::int32_t, std::span<const std::int32_t> nodes,
                     const FacetIntegrals& r)
                 {
                   if (!r.covered)
                     return;
                   blocks.clear();
                   multipliers.clear();
                   rows.clear();
                   for (auto k : nodes)
                   {
                     blocks.push_back(s.blocks[k]);
                     multipliers.push_back(interface.multipliers[k]);
                     rows.push_back(interface.carries[k] and active[k]
                                        ? interface.multipliers[k]
                                        : -1);
                   }
                   blocks.insert(blocks.end(), r.master_blocks.begin(),
                                 r.master_blocks.end());
                   if (matrices.force)
                     force.add(blocks, blocks, r.d_force.data());
                   if (matrices.gap)
                     gap.add(rows, blocks, r.d_gap.data());
                   if (matrices.gap_normal)
                     gap_normal.add(rows, multipliers, r.d_gap_normal.data());
                   if (matrices.offset)
                     offset.add(rows, blocks, r.d_offset.data());
                 });
  force.flush(matrices.force);
  gap.flush(matrices.gap);
  gap_normal.flush(matrices.gap_normal);
  offset.flush(matrices.offset);
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::differentiate_normals(const Interface& interface,
                                           const Configuration& configuration,
                                           Mat A)
{
  const Surface& s = interface.slave;
  std::vector<double> dn;
  std::vector<std::int64_t> rows, columns;
  BlockAccumulator<3, 3> blocks;
  for (std::int32_t f = 0; f < static_cast<std::int32_t>(s.types.size()); ++f)
  {
    auto nodes = facet_nodes(s, f);
    dn.resize(9 * nodes.size() * nodes.size());
    normal_derivative(s, configuration.x_slave, interface.fixed,
                      configuration.normals, f, dn);
    rows.clear();
    columns.clear();
    for (auto k : nodes)
    {
      rows.push_back(interface.multipliers[k]);
      columns.push_back(s.blocks[k]);
    }
    blocks.add(rows, columns, dn.data());
  }
  blocks.flush(A);
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::insert_transformation(const Interface& interface,
                                           bool inverse, Mat T)
{
  const Surface& s = interface.slave;
  const MultiplierSpace space = interface.options.space;
  std::vector<std::int8_t> positive;
  for (std::int32_t f = 0; f < static_cast<std::int32_t>(s.types.size()); ++f)
  {
    auto nodes = facet_nodes(s, f);
    gather(nodes, std::span<const std::int8_t>(interface.positive), 1,
           positive);
    const FacetMatrix Te
        = inverse ? inverse_transformation(space, s.types[f], positive)
                  : transformation(space, s.types[f], positive);
    for (std::size_t i = 0; i < nodes.size(); ++i)
    {
      for (std::size_t j = 0; j < nodes.size(); ++j)
      {
        if (Te(i, j) == 0)
          continue;
        for (int c = 0; c < 3; ++c)
        {
          // Facets that share an edge insert the same values
          check(MatSetValue(T, 3 * s.blocks[nodes[i]] + c,
                            3 * s.blocks[nodes[j]] + c, Te(i, j),
                            INSERT_VALUES),
                "MatSetValue");
        }
      }
    }
  }
}
//-----------------------------------------------------------------------------
Mat dolfinx_mortar::create_matrix(MPI_Comm comm, std::int64_t local_rows,
                                  std::int64_t local_columns)
{
  Mat A;
  check(MatCreate(comm, &A), "MatCreate");
  check(MatSetSizes(A, local_rows, local_columns, PETSC_DETERMINE,
                    PETSC_DETERMINE),
        "MatSetSizes");
  check(MatSetType(A, MATAIJ), "MatSetType");
  check(MatSetUp(A), "MatSetUp");
  check(MatSetOption(A, MAT_NEW_NONZERO_ALLOCATION_ERR, PETSC_FALSE),
        "MatSetOption");
  return A;
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::add_blocks(Mat A, std::span<const std::int64_t> first_rows,
                                std::span<const std::int64_t> first_columns,
                                int rows, int columns,
                                std::span<const double> blocks)
{
  std::vector<PetscInt> r(rows), c(columns);
  for (std::size_t i = 0; i < first_rows.size(); ++i)
  {
    for (int k = 0; k < rows; ++k)
      r[k] = first_rows[i] + k;
    for (int k = 0; k < columns; ++k)
      c[k] = first_columns[i] + k;
    check(MatSetValues(A, rows, r.data(), columns, c.data(),
                       blocks.data() + rows * columns * i, ADD_VALUES),
          "MatSetValues");
  }
}
//-----------------------------------------------------------------------------
std::vector<double> dolfinx_mortar::nodal_weights(const Interface& interface,
                                                  std::span<const double> x)
{
  const Surface& s = interface.slave;
  std::vector<double> weights(num_local_nodes(s), 0.0);
  std::map<FacetType, QuadratureRule> rules;
  Shapes shapes;
  std::vector<std::int8_t> positive;
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    const FacetType type = s.types[f];
    const int n = num_nodes(type);
    auto [it, made] = rules.try_emplace(type);
    if (made)
      it->second = create_rule(num_corners(type), 2 * total_degree(type));
    auto nodes = facet_nodes(s, f);
    gather(nodes, std::span<const std::int8_t>(interface.positive), 1,
           positive);
    const FacetMatrix T
        = transformation(interface.options.space, type, positive);
    for (std::size_t q = 0; q < it->second.weights.size(); ++q)
    {
      tabulate(type, {it->second.points[2 * q], it->second.points[2 * q + 1]},
               1, shapes);
      Eigen::Vector3d a1 = Eigen::Vector3d::Zero(), a2 = a1;
      for (int k = 0; k < n; ++k)
      {
        const Eigen::Map<const Eigen::Vector3d> xk(x.data() + 3 * nodes[k]);
        a1 += shapes.dN[0][k] * xk;
        a2 += shapes.dN[1][k] * xk;
      }
      const double w = it->second.weights[q] * a1.cross(a2).norm();
      for (int k = 0; k < n; ++k)
      {
        for (int i = 0; i < n; ++i)
          weights[nodes[k]] += w * shapes.N[i] * T(i, k);
      }
    }
  }
  scatter_reverse_add(s, std::span<double>(weights), 1);
  scatter_forward(s, std::span<double>(weights), 1);
  return weights;
}
//-----------------------------------------------------------------------------
std::vector<std::int8_t>
dolfinx_mortar::flag_positive(const Interface& interface,
                              std::span<const double> beyond)
{
  const Surface& s = interface.slave;
  const std::int32_t num = num_local_nodes(s);
  std::vector<std::int8_t> flags(num, 0);
  if (interface.options.space != MultiplierSpace::dual)
    return flags;

  // Nodes of facets that are not covered as a whole
  std::vector<std::int32_t> open(num, 0);
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    if (beyond[f] > 1 - whole)
    {
      for (auto k : facet_nodes(s, f))
        open[k] = 1;
    }
  }
  scatter_reverse_add(s, std::span<std::int32_t>(open), 1);
  share_largest(s, open);
  scatter_forward(s, std::span<std::int32_t>(open), 1);

  // Nodes of facets around
  std::vector<std::int32_t> near(num, 0);
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    auto nodes = facet_nodes(s, f);
    if (std::any_of(nodes.begin(), nodes.end(),
                    [&](auto k) { return open[k] > 0; }))
    {
      for (auto k : nodes)
        near[k] = 1;
    }
  }
  scatter_reverse_add(s, std::span<std::int32_t>(near), 1);
  share_largest(s, near);
  scatter_forward(s, std::span<std::int32_t>(near), 1);
  for (std::int32_t i = 0; i < num; ++i)
    flags[i] = near[i] > 0;
  return flags;
}
//-----------------------------------------------------------------------------
Mat dolfinx_mortar::combine_rows(Mat K, Mat Delta,
                                 std::span<const RowSource> sources)
{
  PetscInt begin, end, num_rows, num_columns;
  check(MatGetOwnershipRange(K, &begin, &end), "MatGetOwnershipRange");
  check(MatGetLocalSize(K, &num_rows, &num_columns), "MatGetLocalSize");
  if (static_cast<PetscInt>(sources.size()) != num_rows or num_rows % 3 != 0)
    throw std::invalid_argument(
        "Each local row needs a source, rows are blocks of 3.");

  std::vector<PetscInt> offsets = {0}, columns;
  std::vector<PetscScalar> values;
  MatInfo info;
  check(MatGetInfo(K, MAT_LOCAL, &info), "MatGetInfo");
  columns.reserve(static_cast<std::size_t>(1.1 * info.nz_used));
  values.reserve(columns.capacity());
  for (PetscInt row = begin; row < end; ++row)
  {
    const RowSource source = sources[row - begin];
    if (source == RowSource::unit)
    {
      columns.push_back(row);
      values.push_back(1);
      offsets.push_back(columns.size());
      continue;
    }
    PetscInt nk = 0, nd = 0;
    const PetscInt *ck = nullptr, *cd = nullptr;
    const PetscScalar *vk = nullptr, *vd = nullptr;
    if (source == RowSource::both)
      check(MatGetRow(K, row, &nk, &ck, &vk), "MatGetRow");
    check(MatGetRow(Delta, row, &nd, &cd, &vd), "MatGetRow");
    PetscInt i = 0, j = 0;
    while (i < nk or j < nd)
    {
      const bool from_k = j == nd or (i < nk and ck[i] <= cd[j]);
      const bool from_d = i == nk or (j < nd and cd[j] <= ck[i]);
      PetscScalar v = 0;
      columns.push_back(from_k ? ck[i] : cd[j]);
      if (from_k)
        v += vk[i++];
      if (from_d)
        v += vd[j++];
      values.push_back(v);
    }
    if (source == RowSource::both)
      check(MatRestoreRow(K, row, &nk, &ck, &vk), "MatRestoreRow");
    check(MatRestoreRow(Delta, row, &nd, &cd, &vd), "MatRestoreRow");
    offsets.push_back(columns.size());
  }

  MPI_Comm comm;
  check(PetscObjectGetComm(reinterpret_cast<PetscObject>(K), &comm),
        "PetscObjectGetComm");
  Mat A;
  check(MatCreate(comm, &A), "MatCreate");
  check(MatSetSizes(A, num_rows, num_columns, PETSC_DETERMINE, PETSC_DETERMINE),
        "MatSetSizes");
  check(MatSetType(A, MATAIJ), "MatSetType");
  check(MatSetBlockSize(A, 3), "MatSetBlockSize");
  check(MatSeqAIJSetPreallocationCSR(A, offsets.data(), columns.data(),
                                     values.data()),
        "MatSeqAIJSetPreallocationCSR");
  check(MatMPIAIJSetPreallocationCSR(A, offsets.data(), columns.data(),
                                     values.data()),
        "MatMPIAIJSetPreallocationCSR");
  return A;
}
