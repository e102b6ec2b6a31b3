// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "elimination.h"
#include "convergence_error.h"
#include <Eigen/Dense>
#include <algorithm>
#include <dolfinx_mortar/common/dense.h>
#include <dolfinx_mortar/common/error.h>
#include <map>
#include <numeric>

using namespace dolfinx_mortar;

namespace
{
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;

/// Entries of the matrices of an Elimination.
struct Entries
{
  std::vector<Entry> G, H, L, L_c, D, solve;
};

/// Add a block; rows and columns are nodes.
template <typename Block>
void add(std::vector<Entry>& entries, std::int32_t row, std::int32_t column,
         const Block& block)
{
  for (int i = 0; i < 3; ++i)
  {
    for (int j = 0; j < 3; ++j)
    {
      if (block(i, j) != 0)
        entries.push_back({3 * row + i, 3 * column + j, block(i, j)});
    }
  }
}

/// Diagonal matrix of the active components of a multiplier node.
Matrix3d active_components(const MultiplierNodes& nodes, std::int32_t j)
{
  const std::int8_t* a = nodes.active.data() + 3 * j;
  return Vector3d(a[0], a[1], a[2]).asDiagonal();
}

/// A displacement node with one multiplier.
void add_single(const MultiplierNodes& nodes, std::int32_t j, Entries& entries,
                Elimination& e)
{
  const Matrix3d flags = active_components(nodes, j);
  const double d = nodes.diagonal[j];
  const std::int32_t u = nodes.own[j];
  const Matrix3d directions = flags * nodes.directions[j] * flags;
  add(entries.G, u, j, flags);
  add(entries.H, u, u, Matrix3d(flags * nodes.dz[j] * flags / d));
  add(entries.L, j, u, Matrix3d(flags / d));
  add(entries.D, u, j, Matrix3d(d * flags));
  add(entries.solve, u, j, Matrix3d(directions / d));
  e.constrained[u] = directions;
  for (int c = 0; c < 3; ++c)
  {
    e.weight[3 * u + c] = flags(c, c) * d;
    e.own[3 * u + c] = flags(c, c) != 0;
  }
}

/// Directions of the constraints of a node with several multipliers.
struct Directions
{
  std::vector<Matrix3d> solve; // blocks of solve_constraints
  Matrix3d constrained;        // projection on the constrained directions
  Matrix3d along; // projection on those that are tangential to all patches
};

Directions find_directions(const MultiplierNodes& nodes,
                           std::span<const std::int32_t> group,
                           const Matrix3d& flags)
{
  const int m = group.size();
  MatrixXd n(m, 3);
  for (int p = 0; p < m; ++p)
    n.row(p) = (flags * nodes.normals[group[p]]).transpose();
  const MatrixXd dual = pseudo_inverse(n).transpose();
  Directions out;
  out.constrained = dual.transpose() * n;
  out.along = Matrix3d::Identity() - out.constrained;
  for (int p = 0; p < m; ++p)
  {
    out.solve.push_back(dual.row(p).transpose() * n.row(p)
                        / nodes.diagonal[group[p]]);
  }
  const bool stick = std::ranges::all_of(group, [&](std::int32_t j)
                                         { return nodes.stick[j]; });
  if (m == 2 and stick)
  {
    // The law of friction along the edge is that of one patch
    const int lead
        = nodes.diagonal[group[0]] >= nodes.diagonal[group[1]] ? 0 : 1;
    const Matrix3d stuck = flags * out.along;
    out.solve[lead] += stuck / nodes.diagonal[group[lead]];
    out.constrained += stuck;
  }
  return out;
}

/// Equations of the multipliers of a group, components of one node after the
/// other: C_z, and the node's own equilibrium relative to the total weight.
MatrixXd group_equations(const MultiplierNodes& nodes,
                         std::span<const std::int32_t> group, double total)
{
  const int m = group.size();
  MatrixXd S = MatrixXd::Zero(3 * m + 3, 3 * m);
  for (int p = 0; p < m; ++p)
  {
    S.block<3, 3>(3 * p, 3 * p) = nodes.dz[group[p]];
    S.block<3, 3>(3 * m, 3 * p)
        = nodes.diagonal[group[p]] / total * Matrix3d::Identity();
  }
  for (const auto& c : nodes.coupled)
  {
    auto row = std::ranges::find(group, c.row);
    auto column = std::ranges::find(group, c.column);
    if (row != group.end() and column != group.end())
    {
      S.block<3, 3>(3 * (row - group.begin()), 3 * (column - group.begin()))
          = c.dz;
    }
  }
  return S;
}

/// A displacement node with several multipliers.
void add_group(const MultiplierNodes& nodes,
               std::span<const std::int32_t> group, Entries& entries,
               Elimination& e)
{
  // A component that is prescribed at the node is so for all its multipliers
  const Matrix3d flags = active_components(nodes, group.front());
  const int m = group.size();
  const std::int32_t u = nodes.own[group.front()];
  double total = 0;
  for (std::int32_t j : group)
    total += nodes.diagonal[j];
  const Directions directions = find_directions(nodes, group, flags);

  std::vector<int> free, all_free;
  for (int p = 0; p <= m; ++p)
  {
    for (int c = 0; c < 3; ++c)
    {
      if (flags(c, c) != 0 and p == m)
        free.push_back(c);
      else if (flags(c, c) != 0)
        all_free.push_back(3 * p + c);
    }
  }
  std::vector<int> rows = all_free;
  for (int c : free)
    rows.push_back(3 * m + c);
  const MatrixXd S = group_equations(nodes, group, total)(rows, all_free);
  const int n = free.size(), nm = all_free.size();
  MatrixXd left = left_null_space(S);
  // Rows that look at the normals of their own patches, and at no other
  // direction twice
  MatrixXd test(nm, n);
  for (int p = 0; p < m; ++p)
  {
    const Vector3d v = nodes.normals[group[p]];
    const Matrix3d t = v * v.transpose() + directions.along;
    test.middleRows(n * p, n) = t(free, free);
  }
  left = lu_solve(left.leftCols(nm) * test, left);
  const MatrixXd inverse = pseudo_inverse(S);

  auto put = [&](std::vector<Entry>& to, std::int32_t row, std::int32_t column,
                 double value)
  {
    if (value != 0)
      to.push_back({row, column, value});
  };
  for (int i = 0; i < n; ++i)
  {
    const std::int32_t row = 3 * u + free[i];
    for (int k = 0; k < nm; ++k)
    {
      const std::int32_t z = 3 * group[all_free[k] / 3] + all_free[k] % 3;
      put(entries.G, row, z, left(i, k));
      put(entries.L, z, row, inverse(k, nm + i) / total);
    }
    for (int k = 0; k < n; ++k)
      put(entries.H, row, 3 * u + free[k], -left(i, nm + k) / total);
  }
  for (int i = 0; i < nm; ++i)
  {
    for (int k = 0; k < nm; ++k)
    {
      put(entries.L_c, 3 * group[all_free[i] / 3] + all_free[i] % 3,
          3 * group[all_free[k] / 3] + all_free[k] % 3, inverse(i, k));
    }
  }
  for (int p = 0; p < m; ++p)
  {
    add(entries.D, u, group[p], Matrix3d(nodes.diagonal[group[p]] * flags));
    add(entries.solve, u, group[p], directions.solve[p]);
  }
  e.constrained[u] = directions.constrained;
  for (int c = 0; c < 3; ++c)
  {
    e.weight[3 * u + c] = flags(c, c) * total;
    e.own[3 * u + c] = flags(c, c) != 0;
  }
}
} // namespace

//-----------------------------------------------------------------------------
Elimination dolfinx_mortar::eliminate(MPI_Comm comm,
                                      const MultiplierNodes& nodes,
                                      std::int32_t size_u)
{
  Elimination e;
  e.constrained.resize(size_u / 3, Matrix3d::Zero());
  e.weight.resize(size_u, 0.0);
  e.own.resize(size_u, 0);

  // Active nodes, those of one displacement node one after the other
  std::vector<std::int32_t> active;
  bool uncovered = false;
  for (std::size_t j = 0; j < nodes.size(); ++j)
  {
    if (active_components(nodes, j).isZero(0))
      continue;
    active.push_back(j);
    uncovered = uncovered or nodes.diagonal[j] == 0;
  }
  if (any(comm, uncovered))
  {
    throw ConvergenceError(
        "No master covers a slave node in contact any more, so that its "
        "multiplier cannot be condensed. Take smaller load steps.");
  }
  std::ranges::stable_sort(active, {},
                           [&](std::int32_t j) { return nodes.own[j]; });
  Entries entries;
  bool several = false;
  for (std::size_t begin = 0, end = 0; begin < active.size(); begin = end)
  {
    while (end < active.size()
           and nodes.own[active[end]] == nodes.own[active[begin]])
      ++end;
    if (end == begin + 1)
    {
      add_single(nodes, active[begin], entries, e);
      continue;
    }
    several = true;
    add_group(nodes, std::span(active).subspan(begin, end - begin), entries, e);
  }
  const std::int32_t size_z = 3 * nodes.size();
  auto matrix = [&](std::int32_t rows, std::int32_t columns,
                    const std::vector<Entry>& values)
  { return create_from_entries(comm, rows, columns, values); };
  e.G = matrix(size_u, size_z, entries.G);
  e.H = matrix(size_u, size_u, entries.H);
  e.L = matrix(size_z, size_u, entries.L);
  if (any(comm, several))
    e.L_c = matrix(size_z, size_z, entries.L_c);
  e.D = matrix(size_u, size_z, entries.D);
  e.solve_constraints = matrix(size_u, size_z, entries.solve);
  return e;
}
