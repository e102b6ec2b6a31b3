// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "reduced.h"
#include "combine_rows.h"
#include "convergence_error.h"
#include <Eigen/Dense>

using namespace dolfinx_mortar;

namespace
{
using Eigen::Matrix3d;
using Eigen::Vector3d;

Eigen::Map<const Vector3d> block(std::span<const double> v, std::size_t node)
{
  return Eigen::Map<const Vector3d>(v.data() + 3 * node);
}
} // namespace

//-----------------------------------------------------------------------------
ReducedPreconditioner::ReducedPreconditioner(MPI_Comm comm,
                                             const std::string& prefix,
                                             std::span<const double> x)
    : _comm(comm), _prefix(prefix)
{
  Vector coordinates;
  check(VecCreate(comm, coordinates.put()), "VecCreate");
  check(VecSetSizes(coordinates.get(), x.size(), PETSC_DETERMINE),
        "VecSetSizes");
  check(VecSetBlockSize(coordinates.get(), 3), "VecSetBlockSize");
  check(VecSetType(coordinates.get(), VECMPI), "VecSetType");
  PetscScalar* values;
  check(VecGetArrayWrite(coordinates.get(), &values), "VecGetArrayWrite");
  std::ranges::copy(x, values);
  check(VecRestoreArrayWrite(coordinates.get(), &values),
        "VecRestoreArrayWrite");
  check(MatNullSpaceCreateRigidBody(coordinates.get(), _modes.put()),
        "MatNullSpaceCreateRigidBody");
}
//-----------------------------------------------------------------------------
void ReducedPreconditioner::prepare(const NewtonSystem& s, const Elimination& e,
                                    const RowOperator& rows)
{
  _s = &s;
  _e = &e;
  _rows = &rows;
  const std::vector<double> stiffness = diagonal(s.K.get());
  double total = 0;
  for (double k : stiffness)
    total += k;
  _mean = sum(_comm, total)
          / sum(_comm, static_cast<std::int64_t>(stiffness.size()));
  // What belongs to the last system is large
  _inner.reset();
  _W.reset();
  _W = create_W();
  const Matrix A = create_operator();
  check(PCCreate(_comm, _inner.put()), "PCCreate");
  check(PCSetOptionsPrefix(_inner.get(), _prefix.c_str()),
        "PCSetOptionsPrefix");
  check(PCSetOperators(_inner.get(), A.get(), A.get()), "PCSetOperators");
  check(PCSetFromOptions(_inner.get()), "PCSetFromOptions");
  check(PCSetUp(_inner.get()), "PCSetUp");
  // PETSc leaves it to the caller to ask
  PCFailedReason reason;
  check(PCGetFailedReason(_inner.get(), &reason), "PCGetFailedReason");
  if (any(_comm, reason != PC_NOERROR))
  {
    throw ConvergenceError("The preconditioner could not be set up: the system "
                           "is singular. A body may not be held: check the "
                           "Dirichlet conditions.");
  }
  _blocks = invert_constraints();
}
//-----------------------------------------------------------------------------
Matrix ReducedPreconditioner::create_W() const
{
  Matrix W = multiply(_e->solve_constraints.get(), _s->B_tilde.get());
  check(MatScale(W.get(), -1.0), "MatScale");
  if (_s->T_minus_one)
  {
    const Matrix TW = multiply(_s->T_minus_one.get(), W.get());
    add(W.get(), 1.0, TW.get());
    add(W.get(), 1.0, _s->T_minus_one.get());
  }
  return W;
}
//-----------------------------------------------------------------------------
Matrix ReducedPreconditioner::create_operator() const
{
  // (I + W)ᵀ (K + Bᵀ S B) (I + W), as K and the few entries that are to be
  // added to it
  const Mat K = _s->K.get(), W = _W.get();
  const Matrix KW = multiply(K, W);
  Matrix WK, WKW;
  check(MatTransposeMatMult(W, K, MAT_INITIAL_MATRIX, PETSC_DEFAULT, WK.put()),
        "MatTransposeMatMult");
  check(MatTransposeMatMult(W, KW.get(), MAT_INITIAL_MATRIX, PETSC_DEFAULT,
                            WKW.put()),
        "MatTransposeMatMult");
  // Unit-like entries in the constrained directions
  std::vector<Entry> units;
  for (std::int32_t node = 0; node < _s->size_u / 3; ++node)
  {
    for (int i = 0; i < 3 and !_e->constrained[node].isZero(0); ++i)
    {
      for (int j = 0; j < 3; ++j)
      {
        units.push_back(
            {3 * node + i, 3 * node + j, _mean * _e->constrained[node](i, j)});
      }
    }
  }
  const Matrix U = create_from_entries(_comm, _s->size_u, _s->size_u, units);
  std::vector<RowTerm> terms
      = {{K}, {KW.get()}, {WK.get()}, {WKW.get()}, {U.get()}};
  const Matrix friction = create_friction();
  if (friction)
    terms.push_back({friction.get()});
  Matrix A = combine_rows(terms);
  std::vector<PetscInt> fixed;
  PetscInt begin;
  check(MatGetOwnershipRange(A.get(), &begin, nullptr), "MatGetOwnershipRange");
  for (std::int32_t dof : _s->fixed)
    fixed.push_back(begin + dof);
  check(MatZeroRowsColumns(A.get(), fixed.size(), fixed.data(), _mean, nullptr,
                           nullptr),
        "MatZeroRowsColumns");
  check(MatSetNearNullSpace(A.get(), _modes.get()), "MatSetNearNullSpace");
  check(MatSetOption(A.get(), MAT_SYMMETRIC, PETSC_TRUE), "MatSetOption");
  return A;
}
//-----------------------------------------------------------------------------
Matrix ReducedPreconditioner::create_friction() const
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
  if (!any(_comm, !entries.empty()))
    return {};
  const Matrix springs
      = create_from_entries(_comm, _s->size_z, _s->size_z, entries);
  const Matrix motion = multiply(_s->B.get(), _W.get());
  add(motion.get(), 1.0, _s->B.get());
  const Matrix traction = multiply(springs.get(), motion.get());
  Matrix forces;
  check(MatTransposeMatMult(motion.get(), traction.get(), MAT_INITIAL_MATRIX,
                            PETSC_DEFAULT, forces.put()),
        "MatTransposeMatMult");
  return forces;
}
//-----------------------------------------------------------------------------
std::vector<Matrix3d> ReducedPreconditioner::invert_constraints() const
{
  // Blocks of the constraints at their own nodes, Π E C_u T Π
  Matrix C = multiply(_rows->E.get(), _s->C_u.get());
  if (_s->T_minus_one)
    add(C.get(), 1.0, multiply(C.get(), _s->T_minus_one.get()).get());
  PetscInt begin;
  check(MatGetOwnershipRange(C.get(), &begin, nullptr), "MatGetOwnershipRange");
  std::vector<Matrix3d> inverse(_s->size_u / 3);
  for (std::size_t node = 0; node < inverse.size(); ++node)
  {
    const Matrix3d& Pi = _e->constrained[node];
    Matrix3d own = Matrix3d::Zero();
    for (int i = 0; i < 3 and !Pi.isZero(0); ++i)
    {
      const MatrixRow row(C.get(), begin + 3 * node + i);
      for (std::size_t k = 0; k < row.columns().size(); ++k)
      {
        const PetscInt j = row.columns()[k] - begin - 3 * node;
        if (j >= 0 and j < 3)
          own(i, j) = row.values()[k];
      }
    }
    inverse[node]
        = (Pi * own * Pi + Matrix3d::Identity() - Pi).partialPivLu().inverse();
  }
  return inverse;
}
//-----------------------------------------------------------------------------
void ReducedPreconditioner::apply(Vec x, Vec y) const
{
  const NewtonSystem& s = *_s;
  const Elimination& e = *_e;
  const std::vector<double> r = local_values(x);
  std::vector<double> step(r.size()), across(r.size());
  for (std::size_t node = 0; node < r.size() / 3; ++node)
  {
    Vector3d r_c = Vector3d::Zero();
    for (int c = 0; c < 3; ++c)
    {
      const std::size_t dof = 3 * node + c;
      if (e.own[dof])
        r_c[c] = r[dof] / _rows->scale[dof];
    }
    // Motions in the directions of the constraints, and equilibrium of what is
    // not constrained: the rows of S hold that of their own nodes
    const Matrix3d& Pi = e.constrained[node];
    Eigen::Map<Vector3d>(step.data() + 3 * node)
        = Pi * _blocks[node] * Pi * r_c;
    Eigen::Map<Vector3d>(across.data() + 3 * node)
        = -block(e.weight, node).cwiseProduct(r_c - Pi * r_c);
  }
  std::vector<double> moved
      = multiply_transposed(s.B_tilde.get(), multiply(e.L.get(), across));
  std::vector<double> rho = r;
  for (std::size_t dof = 0; dof < r.size(); ++dof)
    rho[dof] = e.own[dof] ? across[dof] : r[dof] + moved[dof];
  // Where Dirichlet dofs meet the contact, as at planes of symmetry, `moved` is
  // their reaction
  for (std::int32_t dof : s.fixed)
    rho[dof] = 0;
  const Vector b = create_vector(_comm, rho);
  Vector w;
  check(VecDuplicate(b.get(), w.put()), "VecDuplicate");
  check(PCApply(_inner.get(), b.get(), w.get()), "PCApply");
  check(MatMultAdd(_W.get(), w.get(), w.get(), y), "MatMultAdd");

  std::vector<double> turned;
  if (s.T_minus_one)
    turned = multiply(s.T_minus_one.get(), step);
  PetscScalar* out;
  check(VecGetArray(y, &out), "VecGetArray");
  for (std::size_t dof = 0; dof < r.size(); ++dof)
    out[dof] += step[dof] + (turned.empty() ? 0.0 : turned[dof]);
  for (std::int32_t dof : s.fixed)
    out[dof] = r[dof];
  check(VecRestoreArray(y, &out), "VecRestoreArray");
}
