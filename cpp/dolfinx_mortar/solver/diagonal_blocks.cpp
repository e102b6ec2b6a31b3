// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "diagonal_blocks.h"
#include <cmath>

using namespace dolfinx_mortar;

//-----------------------------------------------------------------------------
DiagonalBlocks::DiagonalBlocks(const ReducedOperator& A,
                               std::span<const std::int32_t> together)
    : _inverse(A.blocks())
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
  if (together.empty())
    return;
  for (std::int32_t node : together)
  {
    for (int c = 0; c < 3; ++c)
      _dofs.push_back(3 * node + c);
  }
  const PetscInt size = _dofs.size();
  _shared = create_from_entries(MPI_COMM_SELF, size, size, A.entries(_dofs));
  check(PCCreate(MPI_COMM_SELF, _factor.put()), "PCCreate");
  check(PCSetType(_factor.get(), PCLU), "PCSetType");
  check(PCFactorSetMatOrderingType(_factor.get(), MATORDERINGND),
        "PCFactorSetMatOrderingType");
  check(PCSetOperators(_factor.get(), _shared.get(), _shared.get()),
        "PCSetOperators");
  check(PCSetUp(_factor.get()), "PCSetUp");
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
    std::vector<double> part(_dofs.size());
    for (std::size_t i = 0; i < part.size(); ++i)
      part[i] = in.get()[_dofs[i]];
    const Vector b = create_vector(MPI_COMM_SELF, part);
    Vector solution;
    check(VecDuplicate(b.get(), solution.put()), "VecDuplicate");
    check(PCApply(_factor.get(), b.get(), solution.get()), "PCApply");
    const VectorView values(solution.get());
    for (std::size_t i = 0; i < part.size(); ++i)
      out[_dofs[i]] = values.get()[i];
  }
  check(VecRestoreArrayWrite(y, &out), "VecRestoreArrayWrite");
}
