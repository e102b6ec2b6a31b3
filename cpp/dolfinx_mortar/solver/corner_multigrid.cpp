// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "corner_multigrid.h"
#include "body_levels.h"
#include <algorithm>
#include <array>

using namespace dolfinx_mortar;

namespace
{
using Eigen::Matrix3d;

/// T⁻¹ u. Collective.
Matrix transform_back(const Matrix& u, Mat T_minus_one)
{
  // Centres depend on edges, and these on corners: after three sweeps w is
  // exact
  const std::vector<double> d = diagonal(T_minus_one);
  std::vector<double> factors(d.size());
  std::ranges::transform(d, factors.begin(),
                         [](double x) { return 1 / (1 + x); });
  Matrix w = u;
  for (int sweep = 0; sweep < 3; ++sweep)
  {
    const Matrix own = duplicate(w.get());
    scale_rows(own.get(), d);
    add(own.get(), -1.0, multiply(T_minus_one, w.get()).get());
    w = duplicate(u.get());
    add(w.get(), 1.0, own.get());
    scale_rows(w.get(), factors);
  }
  return w;
}

/// Directions in which nodes have no motion of their own: those of their
/// constraints, and where they follow masters with the corners of their edge
/// (R), the mean of the corners'. Collective.
std::vector<Matrix3d> held_directions(const NewtonSystem& s,
                                      const Elimination& e, Mat R)
{
  std::vector<Matrix3d> held = e.constrained;
  if (!R)
    return held;
  // Weights of the corners of an edge are alike
  const Mat T = s.T_minus_one.get();
  const std::vector<double> ones(s.size_u, 1.0), weight = multiply(T, ones);
  std::array<std::vector<double>, 3> columns;
  for (int j = 0; j < 3; ++j)
  {
    std::vector<double> of_corners(s.size_u);
    for (std::int32_t dof = 0; dof < s.size_u; ++dof)
      of_corners[dof] = e.constrained[dof / 3](dof % 3, j);
    columns[j] = multiply(T, of_corners);
  }
  PetscInt begin;
  check(MatGetOwnershipRange(R, &begin, nullptr), "MatGetOwnershipRange");
  for (std::int32_t dof = 0; dof < s.size_u; ++dof)
  {
    if (MatrixRow(R, begin + dof).columns().empty())
      continue;
    for (int j = 0; j < 3; ++j)
      held[dof / 3](dof % 3, j) += columns[j][dof] / weight[dof];
  }
  return held;
}
} // namespace

//-----------------------------------------------------------------------------
std::vector<std::int32_t> dolfinx_mortar::corner_dofs(Mat P)
{
  std::vector<std::int32_t> dofs; // their rows have one entry
  PetscInt begin, end;
  check(MatGetOwnershipRange(P, &begin, &end), "MatGetOwnershipRange");
  for (PetscInt row = begin; row < end; ++row)
  {
    if (MatrixRow(P, row).columns().size() == 1)
      dofs.push_back(row - begin);
  }
  return dofs;
}
//-----------------------------------------------------------------------------
Matrix
dolfinx_mortar::create_free_directions(MPI_Comm comm,
                                       std::span<const Matrix3d> constrained)
{
  std::vector<Entry> entries;
  for (std::size_t node = 0; node < constrained.size(); ++node)
  {
    const std::int32_t dof = 3 * node;
    const Matrix3d& Pi = constrained[node];
    for (int i = 0; i < 3; ++i)
    {
      for (int j = 0; j < 3; ++j)
      {
        const double value = (i == j) - Pi(i, j);
        if (i == j or value != 0)
          entries.push_back({dof + i, dof + j, value});
      }
    }
  }
  const PetscInt size = 3 * constrained.size();
  return create_from_entries(comm, size, size, entries);
}
//-----------------------------------------------------------------------------
Matrix dolfinx_mortar::interpolate_motions(Mat P, const NewtonSystem& s,
                                           const Elimination& e, Mat W, Mat R)
{
  const std::vector<std::int32_t> corners = corner_dofs(P);
  // Corners by corners: those that are slaves follow their masters
  std::vector<double> kept(s.size_u, 1.0);
  PetscInt begin;
  check(MatGetOwnershipRange(W, &begin, nullptr), "MatGetOwnershipRange");
  for (std::int32_t dof = 0; dof < s.size_u; ++dof)
  {
    if (!MatrixRow(W, begin + dof).columns().empty())
      kept[dof] = 0;
  }
  std::vector<Entry> picks, ones;
  for (std::size_t c = 0; c < corners.size(); ++c)
  {
    kept[corners[c]] = 1;
    picks.push_back({static_cast<std::int32_t>(c), corners[c], 1.0});
    ones.push_back(
        {static_cast<std::int32_t>(c), static_cast<std::int32_t>(c), 1.0});
  }
  const PetscInt num_corners = corners.size();
  const Matrix J = create_from_entries(s.comm, num_corners, s.size_u, picks);
  Matrix C = create_from_entries(s.comm, num_corners, num_corners, ones);
  {
    const Matrix followers = duplicate(P);
    scale_rows(followers.get(), kept);
    const Matrix JW = multiply(J.get(), W);
    add(C.get(), 1.0, multiply(JW.get(), followers.get()).get());
  }
  Matrix w = multiply(P, C.get());
  if (s.T_minus_one)
    w = transform_back(w, s.T_minus_one.get());
  if (R)
  {
    const Matrix Rw = multiply(R, w.get());
    w = duplicate(w.get());
    add(w.get(), -1.0, Rw.get());
  }
  const std::vector<Matrix3d> held = held_directions(s, e, R);
  const Matrix free = create_free_directions(s.comm, held);
  w = multiply(free.get(), w.get());
  std::vector<double> moves(s.size_u, 1.0), corner_moves(num_corners, 1.0);
  for (std::int32_t dof : s.fixed)
    moves[dof] = 0;
  for (PetscInt c = 0; c < num_corners; ++c)
    corner_moves[c] = moves[corners[c]];
  scale_rows(w.get(), moves);
  scale_columns(w.get(), corner_moves);
  return w;
}
//-----------------------------------------------------------------------------
CornerMultigrid::CornerMultigrid(MPI_Comm comm, const std::string& prefix,
                                 std::unique_ptr<ReducedOperator> A, Matrix P,
                                 Matrix A_corners, MatNullSpace modes,
                                 std::vector<std::int32_t> together,
                                 const std::vector<Matrix>& levels)
    : _comm(comm), _together(std::move(together))
{
  check(MatSetBlockSize(A_corners.get(), 3), "MatSetBlockSize");
  check(MatSetNearNullSpace(A_corners.get(), modes), "MatSetNearNullSpace");
  check(MatSetOption(A_corners.get(), MAT_SYMMETRIC, PETSC_TRUE),
        "MatSetOption");
  const PetscInt size = local_size(P.get()).first;
  check(MatCreateShell(comm, size, size, PETSC_DETERMINE, PETSC_DETERMINE, this,
                       _shell.put()),
        "MatCreateShell");
  check(MatSetBlockSize(_shell.get(), 3), "MatSetBlockSize");
  check(MatSetOption(_shell.get(), MAT_SYMMETRIC, PETSC_TRUE), "MatSetOption");
  check(MatShellSetOperation(_shell.get(), MATOP_MULT,
                             reinterpret_cast<void (*)(void)>(multiply)),
        "MatShellSetOperation");

  check(PCCreate(comm, _pc.put()), "PCCreate");
  check(PCSetOptionsPrefix(_pc.get(), (prefix + "mg_corners_").c_str()),
        "PCSetOptionsPrefix");
  check(PCSetType(_pc.get(), PCMG), "PCSetType");
  check(PCMGSetLevels(_pc.get(), 2, nullptr), "PCMGSetLevels");
  check(PCMGSetInterpolation(_pc.get(), 1, P.get()), "PCMGSetInterpolation");
  KSP smoother, corners;
  PC pc;
  check(PCMGGetSmoother(_pc.get(), 1, &smoother), "PCMGGetSmoother");
  check(KSPSetOptionsPrefix(smoother, (prefix + "mg_nodes_").c_str()),
        "KSPSetOptionsPrefix");
  check(KSPGetPC(smoother, &pc), "KSPGetPC");
  check(PCSetType(pc, PCSHELL), "PCSetType");
  check(PCShellSetContext(pc, this), "PCShellSetContext");
  check(PCShellSetApply(pc, apply_blocks), "PCShellSetApply");
  check(PCMGGetCoarseSolve(_pc.get(), &corners), "PCMGGetCoarseSolve");
  check(KSPSetType(corners, KSPPREONLY), "KSPSetType");
  check(KSPSetOperators(corners, A_corners.get(), A_corners.get()),
        "KSPSetOperators");
  check(KSPGetPC(corners, &pc), "KSPGetPC");
  if (levels.empty())
  {
    check(PCSetOptionsPrefix(pc, prefix.c_str()), "PCSetOptionsPrefix");
    check(PCSetFromOptions(pc), "PCSetFromOptions");
  }
  else
    set_levels(pc, prefix, A_corners, levels, A->unit());
  update(std::move(A));
  check(PCSetOperators(_pc.get(), _shell.get(), _shell.get()),
        "PCSetOperators");
  check(PCSetUp(_pc.get()), "PCSetUp");
}
//-----------------------------------------------------------------------------
void CornerMultigrid::update(std::unique_ptr<ReducedOperator> A)
{
  _operator = std::move(A);
  _blocks = std::make_unique<DiagonalBlocks>(_comm, *_operator, _together);
}
//-----------------------------------------------------------------------------
PetscErrorCode CornerMultigrid::multiply(Mat A, Vec x, Vec y)
{
  PetscFunctionBeginUser;
  void* context;
  PetscCall(MatShellGetContext(A, &context));
  try
  {
    static_cast<const CornerMultigrid*>(context)->_operator->apply(x, y);
  }
  catch (const std::exception&)
  {
    PetscFunctionReturn(PETSC_ERR_LIB);
  }
  PetscFunctionReturn(PETSC_SUCCESS);
}
//-----------------------------------------------------------------------------
PetscErrorCode CornerMultigrid::apply_blocks(PC pc, Vec x, Vec y)
{
  PetscFunctionBeginUser;
  void* context;
  PetscCall(PCShellGetContext(pc, &context));
  try
  {
    static_cast<const CornerMultigrid*>(context)->_blocks->apply(x, y);
  }
  catch (const std::exception&)
  {
    PetscFunctionReturn(PETSC_ERR_LIB);
  }
  PetscFunctionReturn(PETSC_SUCCESS);
}
