// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "body_levels.h"
#include "reduced.h"
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <dolfinx_mortar/common/unused_memory.h>
#include <numeric>

// The levels of all nodes, of the corners of cells, and below these.

using namespace dolfinx_mortar;

namespace
{
using Eigen::Matrix3d;

/// Owned dofs that others follow, by the entries of their columns, but for
/// prescribed ones. Collective.
std::vector<std::int32_t> followed_dofs(MPI_Comm comm, Mat W,
                                        std::span<const std::int32_t> fixed)
{
  const auto [rows, columns] = local_size(W);
  PetscInt begin;
  check(MatGetOwnershipRange(W, &begin, nullptr), "MatGetOwnershipRange");
  std::vector<PetscInt> offsets = {0}, used;
  for (PetscInt dof = 0; dof < rows; ++dof)
  {
    const MatrixRow row(W, begin + dof);
    used.insert(used.end(), row.columns().begin(), row.columns().end());
    offsets.push_back(used.size());
  }
  const Matrix pattern = create_from_rows(comm, rows, columns, offsets, used,
                                          std::vector<double>(used.size(), 1));
  std::vector<double> count
      = multiply_transposed(pattern.get(), std::vector<double>(rows, 1.0));
  for (std::int32_t dof : fixed)
    count[dof] = 0;
  std::vector<std::int32_t> dofs;
  for (PetscInt dof = 0; dof < columns; ++dof)
  {
    if (count[dof] > 0)
      dofs.push_back(dof);
  }
  return dofs;
}
} // namespace

//-----------------------------------------------------------------------------
void ReducedPreconditioner::create_multigrid(std::unique_ptr<ReducedOperator> A)
{
  // Corners have the displacements that their rows of P, the identity, give
  std::vector<double> x;
  std::vector<Entry> units;
  std::vector<std::int8_t> fixed(_s->size_u, 0);
  for (std::int32_t dof : _s->fixed)
    fixed[dof] = 1;
  for (std::int32_t dof : corner_dofs(_P.get()))
  {
    const std::int32_t corner = x.size(), component = dof % 3;
    x.push_back(_x[dof]);
    if (fixed[dof])
      units.push_back({corner, corner, A->unit()});
    const Matrix3d& Pi = _e->constrained[dof / 3];
    for (std::int32_t j = 0; j < 3 and !Pi.isZero(0); ++j)
    {
      units.push_back(
          {corner, corner - component + j, A->unit() * Pi(component, j)});
    }
  }
  const PetscInt size = x.size();
  const Matrix U = create_from_entries(_comm, size, size, units);
  const Vector coordinates = create_vector(_comm, x, 3);
  PetscHandle<MatNullSpace, MatNullSpaceDestroy> modes;
  check(MatNullSpaceCreateRigidBody(coordinates.get(), modes.put()),
        "MatNullSpaceCreateRigidBody");
  // What is tied to masters couples them: the surface of a stiff body to the
  // nodes of a soft one, corners to edges that share their weight
  std::vector<std::int32_t> together;
  if (_s->tied or _R)
    together = followed_dofs(_comm, _W.get(), _s->fixed);
  if (!_projected)
  {
    // What most rows of P are
    std::vector<double> moves, corner_moves;
    for (std::int8_t held : fixed)
      moves.push_back(held ? 0.0 : 1.0);
    for (std::int32_t dof : corner_dofs(_P.get()))
      corner_moves.push_back(moves[dof]);
    Matrix usual = duplicate(_P.get());
    scale_rows(usual.get(), moves);
    scale_columns(usual.get(), corner_moves);
    _projected = std::make_unique<ProjectedTangent>(std::move(usual));
  }
  std::vector<Matrix> levels;
  if (_aggregation and slides())
    levels = body_levels(A->unit(), modes.get());
  Matrix P = interpolate_motions(_P.get(), *_s, *_e, _W.get(), _R.get());
  Matrix A_corners = A->project(P.get(), _W.get(), *_projected, U.get());
  give_back_memory();
  _multigrid = std::make_unique<CornerMultigrid>(
      _comm, _prefix, std::move(A), std::move(P), std::move(A_corners),
      modes.get(), std::move(together), levels);
}
//-----------------------------------------------------------------------------
bool ReducedPreconditioner::slides() const
{
  // Nodes that stick or are tied have no free direction left
  std::vector<int> num_free(_e->constrained.size(), 3);
  for (std::int32_t dof : _s->fixed)
    --num_free[dof / 3];
  bool free = false;
  for (std::size_t node = 0; node < num_free.size(); ++node)
  {
    const auto num = std::lround(_e->constrained[node].trace());
    free = free or (num > 0 and num < num_free[node]);
  }
  if (!any(_comm, free))
    return false;
  // Masters that are fixed need no motion, and tools have no stiffness, so that
  // no aggregate of their own would move them
  const std::vector<double> stiffness = diagonal(_s->K.get());
  std::vector<std::int8_t> slave(_s->size_u, 0);
  for (std::int32_t node : _s->nodes.own)
    std::fill_n(slave.begin() + 3 * node, 3, 1);
  if (_s->T_minus_one)
  {
    PetscInt begin;
    check(MatGetOwnershipRange(_s->T_minus_one.get(), &begin, nullptr),
          "MatGetOwnershipRange");
    for (std::int32_t dof = 0; dof < _s->size_u; ++dof)
    {
      if (!MatrixRow(_s->T_minus_one.get(), begin + dof).columns().empty())
        slave[dof] = 1;
    }
  }
  const auto followed = followed_dofs(_comm, _W.get(), _s->fixed);
  return any(_comm, std::ranges::any_of(
                        followed, [&](std::int32_t dof)
                        { return !slave[dof] and stiffness[dof] != 0; }));
}
//-----------------------------------------------------------------------------
std::vector<Matrix> ReducedPreconditioner::body_levels(double unit,
                                                       MatNullSpace modes)
{
  std::vector<std::int32_t> dofs(_s->size_u);
  if (_P)
    dofs = corner_dofs(_P.get());
  else
    std::iota(dofs.begin(), dofs.end(), 0);
  std::vector<std::int8_t> fixed(_s->size_u, 0);
  for (std::int32_t dof : _s->fixed)
    fixed[dof] = 1;
  PetscInt begin;
  check(
      MatGetOwnershipRangeColumn(_P ? _P.get() : _s->K.get(), &begin, nullptr),
      "MatGetOwnershipRangeColumn");
  std::vector<PetscInt> held;
  std::vector<Matrix3d> constrained;
  std::vector<double> moves;
  for (std::size_t i = 0; i < dofs.size(); ++i)
  {
    moves.push_back(fixed[dofs[i]] ? 0.0 : 1.0);
    if (fixed[dofs[i]])
      held.push_back(begin + i);
    if (i % 3 == 0)
      constrained.push_back(_e->constrained[dofs[i] / 3]);
  }
  if (_aggregates.empty())
  {
    const Matrix K
        = _P ? _projected->project(_s->K.get()) : duplicate(_s->K.get());
    // Smoothers divide by the diagonal
    const std::vector<double> stiffness = diagonal(K.get());
    for (std::size_t i = 0; i < dofs.size(); ++i)
    {
      if (stiffness[i] == 0)
        held.push_back(begin + i);
    }
    check(MatZeroRowsColumns(K.get(), held.size(), held.data(), unit, nullptr,
                             nullptr),
          "MatZeroRowsColumns");
    _aggregates = aggregate_bodies(_comm, _prefix, K.get(), modes);
  }
  std::vector<Matrix> levels = _aggregates;
  if (!levels.empty())
  {
    const Matrix free = create_free_directions(_comm, constrained);
    scale_rows(free.get(), moves);
    PetscInt block;
    check(MatGetBlockSizes(levels.front().get(), nullptr, &block),
          "MatGetBlockSizes");
    levels.front() = multiply(free.get(), levels.front().get());
    check(MatSetBlockSizes(levels.front().get(), 3, block), "MatSetBlockSizes");
  }
  return levels;
}
