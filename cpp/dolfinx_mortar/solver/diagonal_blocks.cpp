// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "diagonal_blocks.h"
#include <cmath>

using namespace dolfinx_mortar;

namespace
{
/// LU factorisation of a matrix that is small in comparison with the bodies'.
/// Collective.
PetscHandle<PC, PCDestroy> factorise(MPI_Comm comm, const Matrix& A)
{
  PetscHandle<PC, PCDestroy> pc;
  check(PCCreate(comm, pc.put()), "PCCreate");
  check(PCSetOperators(pc.get(), A.get(), A.get()), "PCSetOperators");
  int size;
  MPI_Comm_size(comm, &size);
  PetscBool available = PETSC_FALSE;
  check(
      MatGetFactorAvailable(A.get(), MATSOLVERMUMPS, MAT_FACTOR_LU, &available),
      "MatGetFactorAvailable");
  if (size == 1)
  {
    check(PCSetType(pc.get(), PCLU), "PCSetType");
    check(PCFactorSetMatOrderingType(pc.get(), MATORDERINGND),
          "PCFactorSetMatOrderingType");
  }
  else if (available)
  {
    check(PCSetType(pc.get(), PCLU), "PCSetType");
    check(PCFactorSetMatSolverType(pc.get(), MATSOLVERMUMPS),
          "PCFactorSetMatSolverType");
  }
  else
    check(PCSetType(pc.get(), PCREDUNDANT), "PCSetType");
  check(PCSetUp(pc.get()), "PCSetUp");
  return pc;
}
} // namespace

//-----------------------------------------------------------------------------
DiagonalBlocks::DiagonalBlocks(MPI_Comm comm, const ReducedOperator& A,
                               std::span<const std::int32_t> together)
    : _inverse(A.blocks()), _together(together.begin(), together.end())
{
  for (Eigen::Matrix3d& block : _inverse)
  {
    // Nothing resists some motions of a tool that touches nothing
    const double size = block.norm();
    if (std::abs(block.determinant()) > 1e-14 * size * size * size)
      block = block.inverse().eval();
    else
      block = Eigen::Matrix3d::Identity() / A.unit();
  }
  if (!any(comm, !_together.empty()))
    return;
  const Matrix part = A.part(_together);
  _factor = factorise(comm, part);
  check(MatCreateVecs(part.get(), _solution.put(), _right.put()),
        "MatCreateVecs");
}
//-----------------------------------------------------------------------------
void DiagonalBlocks::apply(Vec x, Vec y) const
{
  const VectorView in(x);
  PetscScalar* out;
  check(VecGetArrayWrite(y, &out), "VecGetArrayWrite");
  for (std::size_t node = 0; node < _inverse.size(); ++node)
  {
    Eigen::Map<Eigen::Vector3d>(out + 3 * node).noalias()
        = _inverse[node]
          * Eigen::Map<const Eigen::Vector3d>(in.get().data() + 3 * node);
  }
  if (_factor)
  {
    PetscScalar* right;
    check(VecGetArrayWrite(_right.get(), &right), "VecGetArrayWrite");
    for (std::size_t i = 0; i < _together.size(); ++i)
      right[i] = in.get()[_together[i]];
    check(VecRestoreArrayWrite(_right.get(), &right), "VecRestoreArrayWrite");
    check(PCApply(_factor.get(), _right.get(), _solution.get()), "PCApply");
    const VectorView values(_solution.get());
    for (std::size_t i = 0; i < _together.size(); ++i)
      out[_together[i]] = values.get()[i];
  }
  check(VecRestoreArrayWrite(y, &out), "VecRestoreArrayWrite");
}
