// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "reduced.h"
#include "body_levels.h"
#include "convergence_error.h"
#include "solver_options.h"
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <dolfinx_mortar/common/unused_memory.h>
#include <dolfinx_mortar/dolfinx/timer.h>
#include <limits>

using namespace dolfinx_mortar;

namespace
{
using Eigen::Matrix3d;
using Eigen::Vector3d;

Eigen::Map<const Vector3d> block(std::span<const double> v, std::size_t node)
{
  return Eigen::Map<const Vector3d>(v.data() + 3 * node);
}

// An inner preconditioner serves further systems. Nodes whose constraints have
// changed cost iterations, and so does what has become of the bodies'
// stiffness; a new one costs as much as a dozen of them.
constexpr std::int64_t most_changed = 40;
constexpr double most_share = 0.25; // of those with constraints
constexpr double most_growth = 1.3, most_more = 4;

/// An option that is true unless it is set.
bool option(const std::string& prefix, const char* name)
{
  PetscBool value = PETSC_TRUE;
  check(PetscOptionsGetBool(nullptr, prefix.c_str(), name, &value, nullptr),
        "PetscOptionsGetBool");
  return value;
}

std::vector<std::int8_t> num_constraints(const Elimination& e)
{
  std::vector<std::int8_t> num(e.constrained.size());
  std::ranges::transform(e.constrained, num.begin(), [](const Matrix3d& Pi)
                         { return std::lround(Pi.trace()); });
  return num;
}
} // namespace

//-----------------------------------------------------------------------------
ReducedPreconditioner::ReducedPreconditioner(
    MPI_Comm comm, const std::string& prefix, std::span<const double> x,
    std::function<Matrix()> interpolate_corners)
    : _comm(comm), _prefix(prefix), _x(x.begin(), x.end())
{
  _reuse = option(prefix, "-pc_mortar_reuse");
  const bool corners = option(prefix, "-pc_mortar_corners");
  std::array<char, 64> type = {};
  check(PetscOptionsGetString(nullptr, prefix.c_str(), "-pc_type", type.data(),
                              type.size(), nullptr),
        "PetscOptionsGetString");
  if (corners and interpolate_corners and has_corner_level(type.data()))
    _P = interpolate_corners();
  _aggregation = std::string(type.data()) == PCGAMG;
}
//-----------------------------------------------------------------------------
void ReducedPreconditioner::prepare(const NewtonSystem& s, const Elimination& e,
                                    const RowOperator& rows)
{
  _s = &s;
  _e = &e;
  _rows = &rows;
  // What belongs to the last system is large
  const bool worn = !_reuse or _worn;
  if (inner() and (worn or has_changed()))
    forget();
  if (worn)
    _aggregates.clear();
  _W.reset();
  {
    Timer timer("~mortar: condense");
    _R = follow_masters();
    _W = create_W();
  }
  _is_new = false;
  if (!inner())
    set_up();
  else if (_multigrid)
  {
    Timer timer("~mortar: renew");
    _multigrid->update(std::make_unique<ReducedOperator>(s, e, _W.get()));
  }
  _blocks = invert_constraints();
  give_back_memory();
}
//-----------------------------------------------------------------------------
bool ReducedPreconditioner::has_changed() const
{
  const std::vector<std::int8_t> now = num_constraints(*_e);
  std::int64_t changed = 0, constrained = 0;
  for (std::size_t node = 0; node < now.size(); ++node)
  {
    changed += now[node] != _constraints[node];
    constrained += now[node] > 0;
  }
  changed = sum(_comm, changed);
  constrained = sum(_comm, constrained);
  return changed > most_changed and changed > most_share * constrained;
}
//-----------------------------------------------------------------------------
int ReducedPreconditioner::patience(double rtol) const
{
  if (_is_new)
    return std::numeric_limits<int>::max();
  return static_cast<int>(-3 * std::log10(rtol) * _iterations_per_digit) + 20;
}
//-----------------------------------------------------------------------------
bool ReducedPreconditioner::judge(bool converged, int iterations, double rtol)
{
  if (!converged and (!_is_new or _kept_aggregates))
  {
    _aggregates.clear();
    set_up();
    return false;
  }
  const double digits = -std::log10(rtol);
  if (_is_new and !_kept_aggregates)
    _iterations_per_digit = iterations / digits;
  _worn = !converged
          or iterations
                 > most_growth * digits * _iterations_per_digit + most_more;
  return true;
}
//-----------------------------------------------------------------------------
void ReducedPreconditioner::forget()
{
  _inner.reset();
  _multigrid.reset();
}
//-----------------------------------------------------------------------------
void ReducedPreconditioner::set_up()
{
  Timer timer("~mortar: set up");
  forget();
  give_back_memory();
  _constraints = num_constraints(*_e);
  _is_new = true;
  _kept_aggregates = !_aggregates.empty();
  auto reduced = std::make_unique<ReducedOperator>(*_s, *_e, _W.get());
  if (_P)
    create_multigrid(std::move(reduced));
  else
  {
    const Matrix A = reduced->assemble();
    const auto modes = create_modes();
    check(MatSetNearNullSpace(A.get(), modes.get()), "MatSetNearNullSpace");
    check(PCCreate(_comm, _inner.put()), "PCCreate");
    check(PCSetOperators(_inner.get(), A.get(), A.get()), "PCSetOperators");
    std::vector<Matrix> levels;
    // Those of bodies are of displacements, not of another basis
    if (_aggregation and !_s->T_minus_one and slides())
      levels = body_levels(reduced->unit(), modes.get());
    if (levels.empty())
    {
      check(PCSetOptionsPrefix(_inner.get(), _prefix.c_str()),
            "PCSetOptionsPrefix");
      check(PCSetFromOptions(_inner.get()), "PCSetFromOptions");
    }
    else
      set_levels(_inner.get(), _prefix, A, levels, reduced->unit());
    check(PCSetUp(_inner.get()), "PCSetUp");
  }
  // PETSc leaves it to the caller to ask
  PCFailedReason reason;
  check(PCGetFailedReason(inner(), &reason), "PCGetFailedReason");
  if (any(_comm, reason != PC_NOERROR))
  {
    throw ConvergenceError("The preconditioner could not be set up: the system "
                           "is singular. A body may not be held: check the "
                           "Dirichlet conditions.");
  }
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
  if (_R)
  {
    add(W.get(), 1.0, multiply(W.get(), _R.get()).get());
    add(W.get(), 1.0, _R.get());
  }
  return W;
}
//-----------------------------------------------------------------------------
Matrix ReducedPreconditioner::follow_masters() const
{
  const NewtonSystem& s = *_s;
  if (!s.T_minus_one)
    return {};
  std::vector<std::int8_t> stays(s.size_u, 0); // dofs that follow nothing
  for (std::int32_t dof = 0; dof < s.size_u; ++dof)
    stays[dof] = _e->own[dof];
  for (std::int32_t dof : s.fixed)
    stays[dof] = 1;
  PetscInt begin;
  check(MatGetOwnershipRange(s.T_minus_one.get(), &begin, nullptr),
        "MatGetOwnershipRange");
  std::vector<PetscInt> offsets = {0}, columns;
  std::vector<double> values;
  for (std::int32_t dof = 0; dof < s.size_u; ++dof)
  {
    const MatrixRow row(s.T_minus_one.get(), begin + dof);
    // Edges that keep a part only of their functions have multipliers
    const bool whole
        = std::ranges::find(row.columns(), begin + dof) == row.columns().end();
    for (std::size_t k = 0; k < row.columns().size() and whole; ++k)
    {
      const double missing = 1.0 / row.columns().size() - row.values()[k];
      if (stays[dof] or missing == 0)
        continue;
      columns.push_back(row.columns()[k]);
      values.push_back(missing);
    }
    offsets.push_back(columns.size());
  }
  if (!any(_comm, !columns.empty()))
    return {};
  const Matrix edges
      = create_from_rows(_comm, s.size_u, s.size_u, offsets, columns, values);

  // Mean motion of masters, in the directions of the constraints
  std::vector<double> kept(s.size_u, 1.0), shares(s.size_z, 0.0);
  for (std::size_t j = 0; j < s.nodes.size(); ++j)
  {
    std::fill_n(kept.begin() + 3 * s.nodes.own[j], 3, 0.0);
    if (s.nodes.weight[j] > 0)
    {
      std::fill_n(shares.begin() + 3 * j, 3,
                  -s.nodes.diagonal[j] / s.nodes.weight[j]);
    }
  }
  const Matrix B = duplicate(s.B_tilde.get());
  scale_columns(B.get(), kept);
  const Matrix Q = duplicate(_e->solve_constraints.get());
  scale_columns(Q.get(), shares);
  return multiply(edges.get(), multiply(Q.get(), B.get()).get());
}
//-----------------------------------------------------------------------------
PetscHandle<MatNullSpace, MatNullSpaceDestroy>
ReducedPreconditioner::create_modes() const
{
  using NullSpace = PetscHandle<MatNullSpace, MatNullSpaceDestroy>;
  const Vector coordinates = create_vector(_comm, _x, 3);
  NullSpace nodal;
  check(MatNullSpaceCreateRigidBody(coordinates.get(), nodal.put()),
        "MatNullSpaceCreateRigidBody");
  if (!_s->T_minus_one)
    return nodal;

  // The same motions as values of the transformed basis, w = T⁻¹ u. Centres
  // depend on edges, and these on corners: after three sweeps w is exact
  PetscBool constant;
  PetscInt size;
  const Vec* modes;
  check(MatNullSpaceGetVecs(nodal.get(), &constant, &size, &modes),
        "MatNullSpaceGetVecs");
  const std::vector<double> d = diagonal(_s->T_minus_one.get());
  std::vector<Vector> transformed;
  for (PetscInt m = 0; m < size; ++m)
  {
    const std::vector<double> u = local_values(modes[m]);
    std::vector<double> w = u;
    for (int sweep = 0; sweep < 3; ++sweep)
    {
      const std::vector<double> Tw = multiply(_s->T_minus_one.get(), w);
      for (std::size_t i = 0; i < w.size(); ++i)
        w[i] = (u[i] - Tw[i] + d[i] * w[i]) / (1 + d[i]);
    }
    // R moves edges by masters alone, which nothing moves: I - R is inverse
    if (_R)
    {
      const std::vector<double> Rw = multiply(_R.get(), w);
      for (std::size_t i = 0; i < w.size(); ++i)
        w[i] -= Rw[i];
    }
    transformed.push_back(create_vector(_comm, w, 3));
    // MatNullSpaceCreate asks for orthonormal vectors
    for (PetscInt k = 0; k < m; ++k)
    {
      PetscScalar along;
      check(VecDot(transformed[m].get(), transformed[k].get(), &along),
            "VecDot");
      check(VecAXPY(transformed[m].get(), -along, transformed[k].get()),
            "VecAXPY");
    }
    check(VecNormalize(transformed[m].get(), nullptr), "VecNormalize");
  }
  std::vector<Vec> vectors;
  for (const Vector& v : transformed)
    vectors.push_back(v.get());
  NullSpace out;
  check(MatNullSpaceCreate(_comm, constant, size, vectors.data(), out.put()),
        "MatNullSpaceCreate");
  return out;
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
  if (_R)
  {
    moved = multiply_transposed(_R.get(), rho);
    for (std::size_t dof = 0; dof < r.size(); ++dof)
      rho[dof] += moved[dof];
  }
  // Where Dirichlet dofs meet the contact, as at planes of symmetry, `moved` is
  // their reaction
  for (std::int32_t dof : s.fixed)
    rho[dof] = 0;
  const Vector b = create_vector(_comm, rho);
  Vector w;
  check(VecDuplicate(b.get(), w.put()), "VecDuplicate");
  check(PCApply(inner(), b.get(), w.get()), "PCApply");
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
