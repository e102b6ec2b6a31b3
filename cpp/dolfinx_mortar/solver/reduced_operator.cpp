// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "reduced_operator.h"
#include "combine_rows.h"
#include "projected_tangent.h"
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

using namespace dolfinx_mortar;

namespace
{
using Eigen::Matrix3d;

/// Mean of the diagonal of a matrix. Collective.
double mean_diagonal(MPI_Comm comm, Mat K)
{
  const std::vector<double> stiffness = diagonal(K);
  double total = 0;
  for (double k : stiffness)
    total += k;
  return sum(comm, total)
         / sum(comm, static_cast<std::int64_t>(stiffness.size()));
}

/// Add the blocks at the diagonal of a matrix to blocks.
void add_blocks(Mat A, std::vector<Matrix3d>& blocks)
{
  Mat own;
  check(MatGetDiagonalBlock(A, &own), "MatGetDiagonalBlock");
  for (std::size_t dof = 0; dof < 3 * blocks.size(); ++dof)
  {
    const MatrixRow row(own, dof);
    const auto columns = row.columns();
    const PetscInt first = dof - dof % 3;
    for (auto it = std::ranges::lower_bound(columns, first);
         it != columns.end() and *it < first + 3; ++it)
    {
      blocks[dof / 3](dof % 3, *it - first)
          += row.values()[it - columns.begin()];
    }
  }
}
} // namespace

//-----------------------------------------------------------------------------
ReducedOperator::ReducedOperator(const NewtonSystem& s, const Elimination& e,
                                 Mat W)
    : _s(&s), _unit(mean_diagonal(s.comm, s.K.get()))
{
  const Mat K = s.K.get();
  const Matrix KW = multiply(K, W);
  Matrix WK, WKW;
  {
    // The product copies its second factor: few rows of K are multiplied
    std::vector<std::int8_t> moved(s.size_u);
    PetscInt begin;
    check(MatGetOwnershipRange(W, &begin, nullptr), "MatGetOwnershipRange");
    for (std::int32_t dof = 0; dof < s.size_u; ++dof)
      moved[dof] = !MatrixRow(W, begin + dof).columns().empty();
    const std::vector<RowTerm> rows = {{K, moved}};
    check(MatTransposeMatMult(W, combine_rows(rows).get(), MAT_INITIAL_MATRIX,
                              PETSC_DEFAULT, WK.put()),
          "MatTransposeMatMult");
  }
  check(MatTransposeMatMult(W, KW.get(), MAT_INITIAL_MATRIX, PETSC_DEFAULT,
                            WKW.put()),
        "MatTransposeMatMult");
  std::vector<Entry> units;
  for (std::int32_t node = 0; node < s.size_u / 3; ++node)
  {
    const Matrix3d& Pi = e.constrained[node];
    for (int i = 0; i < 3 and !Pi.isZero(0); ++i)
    {
      for (int j = 0; j < 3; ++j)
        units.push_back({3 * node + i, 3 * node + j, _unit * Pi(i, j)});
    }
  }
  _springs = create_from_entries(s.comm, s.size_u, s.size_u, units);
  if (const Matrix friction = create_friction(W))
    add(_springs.get(), 1.0, friction.get());
  const std::vector<RowTerm> terms
      = {{KW.get()}, {WK.get()}, {WKW.get()}, {_springs.get()}};
  _changes = combine_rows(terms);
  check(MatCreateVecs(K, _free.put(), nullptr), "MatCreateVecs");
}
//-----------------------------------------------------------------------------
void ReducedOperator::apply(Vec x, Vec y) const
{
  check(VecCopy(x, _free.get()), "VecCopy");
  PetscScalar* values;
  check(VecGetArray(_free.get(), &values), "VecGetArray");
  for (std::int32_t dof : _s->fixed)
    values[dof] = 0;
  check(VecRestoreArray(_free.get(), &values), "VecRestoreArray");
  check(MatMult(_s->K.get(), _free.get(), y), "MatMult");
  check(MatMultAdd(_changes.get(), _free.get(), y, y), "MatMultAdd");
  const VectorView in(x);
  check(VecGetArray(y, &values), "VecGetArray");
  for (std::int32_t dof : _s->fixed)
    values[dof] = _unit * in.get()[dof];
  check(VecRestoreArray(y, &values), "VecRestoreArray");
}
//-----------------------------------------------------------------------------
Matrix ReducedOperator::assemble() const
{
  const std::vector<RowTerm> terms = {{_s->K.get()}, {_changes.get()}};
  Matrix A = combine_rows(terms);
  std::vector<PetscInt> fixed;
  PetscInt begin;
  check(MatGetOwnershipRange(A.get(), &begin, nullptr), "MatGetOwnershipRange");
  for (std::int32_t dof : _s->fixed)
    fixed.push_back(begin + dof);
  check(MatZeroRowsColumns(A.get(), fixed.size(), fixed.data(), _unit, nullptr,
                           nullptr),
        "MatZeroRowsColumns");
  check(MatSetOption(A.get(), MAT_SYMMETRIC, PETSC_TRUE), "MatSetOption");
  return A;
}
//-----------------------------------------------------------------------------
Matrix ReducedOperator::project(Mat P, Mat W, ProjectedTangent& tangent,
                                Mat more) const
{
  const Matrix moved = multiply(W, P);
  add(moved.get(), 1.0, P);
  Matrix springs;
  check(MatPtAP(_springs.get(), P, MAT_INITIAL_MATRIX, PETSC_DEFAULT,
                springs.put()),
        "MatPtAP");
  add(springs.get(), 1.0, more);
  return tangent.project(_s->K.get(), moved.get(), springs.get());
}
//-----------------------------------------------------------------------------
std::vector<Matrix3d> ReducedOperator::blocks() const
{
  std::vector<Matrix3d> blocks(_s->size_u / 3, Matrix3d::Zero());
  add_blocks(_s->K.get(), blocks);
  add_blocks(_changes.get(), blocks);
  for (std::int32_t dof : _s->fixed)
  {
    Matrix3d& block = blocks[dof / 3];
    const int i = dof % 3;
    block.row(i).setZero();
    block.col(i).setZero();
    block(i, i) = _unit;
  }
  return blocks;
}
//-----------------------------------------------------------------------------
Matrix ReducedOperator::part(std::span<const std::int32_t> dofs) const
{
  PetscInt begin;
  check(MatGetOwnershipRange(_s->K.get(), &begin, nullptr),
        "MatGetOwnershipRange");
  std::vector<PetscInt> numbers;
  for (std::int32_t dof : dofs)
    numbers.push_back(begin + dof);
  PetscHandle<IS, ISDestroy> own;
  check(ISCreateGeneral(_s->comm, numbers.size(), numbers.data(),
                        PETSC_COPY_VALUES, own.put()),
        "ISCreateGeneral");
  Matrix A, more;
  check(MatCreateSubMatrix(_s->K.get(), own.get(), own.get(),
                           MAT_INITIAL_MATRIX, A.put()),
        "MatCreateSubMatrix");
  check(MatCreateSubMatrix(_changes.get(), own.get(), own.get(),
                           MAT_INITIAL_MATRIX, more.put()),
        "MatCreateSubMatrix");
  add(A.get(), 1.0, more.get());
  return A;
}
//-----------------------------------------------------------------------------
Matrix ReducedOperator::create_friction(Mat W) const
{
  // (I + W)ᵀ Bᵀ S B (I + W). Springs that are stiffer than the bodies would
  // leave out of account that pressures, and friction with them, follow the
  // motion too.
  const MultiplierNodes& nodes = _s->nodes;
  const std::vector<double> stiffness = diagonal(_s->K.get());
  std::vector<Entry> entries;
  for (std::size_t j = 0; j < nodes.size(); ++j)
  {
    const double size
        = nodes.across[j].norm() * nodes.diagonal[j] * nodes.diagonal[j];
    if (!(size > 0))
      continue;
    const double most = std::abs(stiffness[3 * nodes.own[j]]);
    const Matrix3d S = std::min(1.0, most / size) * nodes.across[j];
    for (int a = 0; a < 3; ++a)
    {
      for (int b = 0; b < 3; ++b)
      {
        entries.push_back({static_cast<std::int32_t>(3 * j + a),
                           static_cast<std::int32_t>(3 * j + b), S(a, b)});
      }
    }
  }
  if (!any(_s->comm, !entries.empty()))
    return {};
  const Matrix springs
      = create_from_entries(_s->comm, _s->size_z, _s->size_z, entries);
  const Matrix motion = multiply(_s->B.get(), W);
  add(motion.get(), 1.0, _s->B.get());
  const Matrix traction = multiply(springs.get(), motion.get());
  Matrix forces;
  check(MatTransposeMatMult(motion.get(), traction.get(), MAT_INITIAL_MATRIX,
                            PETSC_DEFAULT, forces.put()),
        "MatTransposeMatMult");
  return forces;
}
