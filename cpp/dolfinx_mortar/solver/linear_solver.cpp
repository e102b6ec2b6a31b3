// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "linear_solver.h"
#include "combine_rows.h"
#include "convergence_error.h"
#include <algorithm>
#include <cmath>
#include <dolfinx_mortar/dolfinx/timer.h>

using namespace dolfinx_mortar;

namespace
{
constexpr const char* singular
    = "the system is singular. A body may not be held: check the Dirichlet "
      "conditions.";

/// What became of a linear solver that failed, and what to do.
std::string describe_failure(KSP ksp)
{
  KSPConvergedReason reason;
  check(KSPGetConvergedReason(ksp, &reason), "KSPGetConvergedReason");
  KSPType type;
  check(KSPGetType(ksp, &type), "KSPGetType");
  PetscInt iterations;
  check(KSPGetIterationNumber(ksp, &iterations), "KSPGetIterationNumber");
  std::string text = "The linear solver failed (";
  text += KSPConvergedReasons[reason];
  PC pc;
  check(KSPGetPC(ksp, &pc), "KSPGetPC");
  PCFailedReason failed;
  check(PCGetFailedReason(pc, &failed), "PCGetFailedReason");
  if (failed == PC_FACTOR_OUTMEMORY)
  {
    return text
           + "): the factorisation needs more memory than was planned. Raise "
             "mat_mumps_icntl_14, the percentage by which MUMPS may exceed "
             "its estimate.";
  }
  if (reason == KSP_DIVERGED_PC_FAILED or std::string(type) == KSPPREONLY)
    return text + "): " + singular;
  text += " after " + std::to_string(iterations) + " iterations of " + type;
  if (reason == KSP_DIVERGED_ITS)
  {
    return text
           + "): allow more (ksp_max_it), or choose another preconditioner "
             "(pc_type).";
  }
  // An iteration that stagnates does not tell whether the system or the solver
  // is to blame
  return text
         + "): the solver does not fit the system. Choose another "
           "preconditioner (pc_type) or iteration (ksp_type), or a direct "
           "solver (ksp_type preonly, pc_type lu), which tells whether the "
           "system itself is singular.";
}

/// @brief Rows of the condensed system. Collective.
RowOperator create_rows(const NewtonSystem& s, const Elimination& e,
                        std::span<const double> free)
{
  RowOperator rows;
  Matrix B_R = transpose(s.B_tilde.get());
  add(B_R.get(), -1.0, e.D.get());
  rows.N = multiply(B_R.get(), e.L.get());
  add(rows.N.get(), 1.0, e.H.get());
  check(MatScale(rows.N.get(), -1.0), "MatScale");
  if (s.T_minus_one)
  {
    Matrix Tt = transpose(s.T_minus_one.get());
    const Matrix NT = multiply(rows.N.get(), Tt.get());
    add(rows.N.get(), 1.0, NT.get());
    std::vector<double> kept(s.size_u);
    std::ranges::transform(e.own, kept.begin(),
                           [](auto own) { return own ? 0.0 : 1.0; });
    scale_rows(Tt.get(), kept);
    add(rows.N.get(), 1.0, Tt.get());
  }
  scale_columns(rows.N.get(), free);
  rows.E = e.G;
  if (e.L_c)
  {
    rows.E = duplicate(e.G.get());
    add(rows.E.get(), -1.0, multiply(B_R.get(), e.L_c.get()).get());
  }

  // Constraints are tractions, C_z = I - n nᵀ without friction: times -D̃ their
  // tangential part is the equilibrium of the node again. Normal parts become
  // as stiff as the tangent, or a tenth of it. Those of ties are displacements
  // times areas.
  rows.scale.assign(s.size_u, 1.0);
  std::vector<double> stiffness;
  if (s.tied)
    stiffness = diagonal(s.K.get());
  for (std::int32_t dof = 0; dof < s.size_u; ++dof)
  {
    if (e.own[dof])
    {
      rows.scale[dof]
          = s.tied ? std::abs(stiffness[dof]) / e.weight[dof] : -e.weight[dof];
    }
  }
  return rows;
}

/// (I_R + N) (K + K_c) + E C_u, rows scaled, with unit rows at Dirichlet dofs.
Matrix create_condensed(const NewtonSystem& s, const Elimination& e,
                        const RowOperator& rows)
{
  // N has columns of slave nodes only: those few rows of K are multiplied
  std::vector<std::int8_t> slave(s.size_u, 0), kept(s.size_u);
  for (std::int32_t node : s.nodes.own)
    std::fill_n(slave.begin() + 3 * node, 3, 1);
  std::ranges::transform(e.own, kept.begin(), [](auto own) { return !own; });
  std::vector<RowTerm> rest = {{s.K.get(), kept}};
  std::vector<RowTerm> multiplied = {{s.K.get(), slave}};
  if (s.K_c)
  {
    rest.push_back({s.K_c.get(), kept});
    multiplied.push_back({s.K_c.get(), slave});
  }
  const Matrix K_slave = combine_rows(multiplied);
  const Matrix NK = multiply(rows.N.get(), K_slave.get());
  const Matrix EC = multiply(rows.E.get(), s.C_u.get());
  rest.push_back({NK.get()});
  rest.push_back({EC.get()});
  return combine_rows(rest, rows.scale, s.fixed);
}

/// The condensed system as products.
struct CondensedOperator
{
  const NewtonSystem& s;
  const Elimination& e;
  const RowOperator& rows;

  /// @brief The left-hand side for du, with unit rows at Dirichlet dofs.
  std::vector<double> multiply(std::span<const double> x) const
  {
    using dolfinx_mortar::multiply;
    std::vector<double> f = multiply(s.K.get(), x);
    if (s.K_c)
    {
      const std::vector<double> more = multiply(s.K_c.get(), x);
      for (std::size_t i = 0; i < f.size(); ++i)
        f[i] += more[i];
    }
    std::vector<double> y = multiply(rows.N.get(), f);
    const std::vector<double> c
        = multiply(rows.E.get(), multiply(s.C_u.get(), x));
    for (std::size_t i = 0; i < y.size(); ++i)
      y[i] = rows.scale[i] * (y[i] + c[i] + (e.own[i] ? 0.0 : f[i]));
    for (std::int32_t dof : s.fixed)
      y[dof] = x[dof];
    return y;
  }
};

PetscErrorCode multiply_condensed(Mat A, Vec x, Vec y)
{
  PetscFunctionBeginUser;
  void* context;
  PetscCall(MatShellGetContext(A, &context));
  try
  {
    const auto values
        = static_cast<const CondensedOperator*>(context)->multiply(
            local_values(x));
    PetscScalar* out;
    PetscCall(VecGetArrayWrite(y, &out));
    std::ranges::copy(values, out);
    PetscCall(VecRestoreArrayWrite(y, &out));
  }
  catch (const std::exception&)
  {
    PetscFunctionReturn(PETSC_ERR_LIB);
  }
  PetscFunctionReturn(PETSC_SUCCESS);
}

PetscErrorCode apply_reduced(PC pc, Vec x, Vec y)
{
  PetscFunctionBeginUser;
  void* context;
  PetscCall(PCShellGetContext(pc, &context));
  try
  {
    static_cast<const ReducedPreconditioner*>(context)->apply(x, y);
  }
  catch (const std::exception&)
  {
    PetscFunctionReturn(PETSC_ERR_LIB);
  }
  PetscFunctionReturn(PETSC_SUCCESS);
}

/// Tolerances of a solver, which are as they were when this ends.
class Tolerances
{
public:
  explicit Tolerances(KSP ksp) : _ksp(ksp)
  {
    check(KSPGetTolerances(ksp, &rtol, &_atol, &_dtol, &max_it),
          "KSPGetTolerances");
  }
  Tolerances(const Tolerances&) = delete;
  Tolerances& operator=(const Tolerances&) = delete;
  ~Tolerances() { set(rtol, max_it); }

  void set(PetscReal relative, PetscInt most) const
  {
    KSPSetTolerances(_ksp, relative, _atol, _dtol, most);
  }

  PetscReal rtol;
  PetscInt max_it;

private:
  KSP _ksp;
  PetscReal _atol, _dtol;
};

/// @brief Run the solver. A preconditioner of an earlier system that does not
/// do is replaced by one of this system.
KSPConvergedReason solve_to(KSP ksp, double rtol, Vec b, Vec x,
                            ReducedPreconditioner* reduced)
{
  const Tolerances own(ksp);
  rtol = std::max(rtol, own.rtol);
  KSPConvergedReason reason;
  PetscInt iterations;
  do
  {
    const PetscInt most = reduced ? reduced->patience(rtol) : own.max_it;
    own.set(rtol, std::min(own.max_it, most));
    check(KSPSolve(ksp, b, x), "KSPSolve");
    check(KSPGetConvergedReason(ksp, &reason), "KSPGetConvergedReason");
    check(KSPGetIterationNumber(ksp, &iterations), "KSPGetIterationNumber");
  } while (reduced and !reduced->judge(reason > 0, iterations, rtol));
  return reason;
}
} // namespace

//-----------------------------------------------------------------------------
LinearSolver::LinearSolver(MPI_Comm comm, const std::string& prefix,
                           bool condense, std::span<const double> x,
                           std::function<Matrix()> interpolate_corners)
    : _condense(condense)
{
  check(KSPCreate(comm, _ksp.put()), "KSPCreate");
  check(KSPSetOptionsPrefix(_ksp.get(), prefix.c_str()), "KSPSetOptionsPrefix");
  check(KSPSetFromOptions(_ksp.get()), "KSPSetFromOptions");
  PC pc;
  check(KSPGetPC(_ksp.get(), &pc), "KSPGetPC");
  KSPType type;
  PCType pc_type;
  check(KSPGetType(_ksp.get(), &type), "KSPGetType");
  check(PCGetType(pc, &pc_type), "PCGetType");
  const std::string name = pc_type ? pc_type : "";
  const bool direct
      = std::string(type) == KSPPREONLY or name == PCNONE or name == "python";
  if (condense and !direct)
  {
    _reduced = std::make_unique<ReducedPreconditioner>(
        comm, prefix, x, std::move(interpolate_corners));
    check(PCSetType(pc, PCSHELL), "PCSetType");
    check(PCShellSetContext(pc, _reduced.get()), "PCShellSetContext");
    check(PCShellSetApply(pc, apply_reduced), "PCShellSetApply");
  }
}
//-----------------------------------------------------------------------------
std::vector<double> LinearSolver::solve(const NewtonSystem& s,
                                        std::span<const double> r, double rtol)
{
  return _condense ? solve_condensed(s, r, rtol) : solve_saddle_point(s, r);
}
//-----------------------------------------------------------------------------
std::vector<double> LinearSolver::run(Mat A, std::span<const double> b,
                                      double rtol)
{
  Timer timer("~mortar: solve");
  MPI_Comm comm;
  check(PetscObjectGetComm(reinterpret_cast<PetscObject>(A), &comm),
        "PetscObjectGetComm");
  const Vector right = create_vector(comm, b);
  Vector x;
  check(VecDuplicate(right.get(), x.put()), "VecDuplicate");
  check(KSPSetOperators(_ksp.get(), A, A), "KSPSetOperators");
  const KSPConvergedReason reason
      = solve_to(_ksp.get(), rtol, right.get(), x.get(), _reduced.get());
  if (reason < 0)
    throw ConvergenceError(describe_failure(_ksp.get()));
  // A factorisation is large, and of no use for the next system
  check(KSPReset(_ksp.get()), "KSPReset");
  return local_values(x.get());
}
//-----------------------------------------------------------------------------
std::vector<double> LinearSolver::solve_saddle_point(const NewtonSystem& s,
                                                     std::span<const double> r)
{
  const Matrix Bt = transpose(s.B.get());
  Matrix K = duplicate(s.K.get());
  if (s.K_c)
    add(K.get(), 1.0, s.K_c.get());
  std::array<Mat, 4> blocks = {K.get(), Bt.get(), s.C_u.get(), s.C_z.get()};
  Matrix nest, A;
  check(
      MatCreateNest(s.comm, 2, nullptr, 2, nullptr, blocks.data(), nest.put()),
      "MatCreateNest");
  check(MatConvert(nest.get(), MATAIJ, MAT_INITIAL_MATRIX, A.put()),
        "MatConvert");
  // Prescribed values are on the right-hand side already; PETSc reads them
  // while it changes that
  const Vector b = create_vector(s.comm, r), values = create_vector(s.comm, r);
  PetscInt begin;
  check(MatGetOwnershipRange(A.get(), &begin, nullptr), "MatGetOwnershipRange");
  check(MatSetOption(A.get(), MAT_KEEP_NONZERO_PATTERN, PETSC_TRUE),
        "MatSetOption");
  std::vector<PetscInt> fixed;
  for (std::int32_t dof : s.fixed)
    fixed.push_back(begin + dof);
  check(MatZeroRowsColumns(A.get(), fixed.size(), fixed.data(), 1.0,
                           values.get(), b.get()),
        "MatZeroRowsColumns");
  return run(A.get(), local_values(b.get()));
}
//-----------------------------------------------------------------------------
std::vector<double> LinearSolver::solve_condensed(const NewtonSystem& s,
                                                  std::span<const double> r,
                                                  double rtol)
{
  const std::span<const double> r_u = r.first(s.size_u),
                                r_z = r.subspan(s.size_u);
  auto subtract = [](std::vector<double>& from, const std::vector<double>& x)
  {
    for (std::size_t i = 0; i < from.size(); ++i)
      from[i] -= x[i];
  };
  std::vector<double> free(s.size_u, 1.0);
  for (std::int32_t dof : s.fixed)
    free[dof] = 0;

  // Multipliers that are not active: C_z is the identity
  std::vector<double> dz(s.size_z);
  for (std::int32_t i = 0; i < s.size_z; ++i)
    dz[i] = s.nodes.active[i] ? 0.0 : r_z[i];
  // Reactions at Dirichlet dofs are not known
  std::vector<double> r_test(r_u.begin(), r_u.end());
  subtract(r_test, multiply_transposed(s.B.get(), dz));
  for (std::int32_t dof : s.fixed)
    r_test[dof] = 0;

  Elimination e;
  RowOperator rows;
  Matrix A;
  std::unique_ptr<CondensedOperator> products;
  {
    Timer timer("~mortar: condense");
    e = eliminate(s.comm, s.nodes, s.size_u);
    rows = create_rows(s, e, free);
    if (_reduced)
    {
      products = std::make_unique<CondensedOperator>(s, e, rows);
      check(MatCreateShell(s.comm, s.size_u, s.size_u, PETSC_DETERMINE,
                           PETSC_DETERMINE, products.get(), A.put()),
            "MatCreateShell");
      check(MatShellSetOperation(
                A.get(), MATOP_MULT,
                reinterpret_cast<void (*)(void)>(multiply_condensed)),
            "MatShellSetOperation");
    }
    else
      A = create_condensed(s, e, rows);
  }
  if (_reduced)
    _reduced->prepare(s, e, rows);

  std::vector<double> c = multiply(s.C_z.get(), dz);
  for (std::int32_t i = 0; i < s.size_z; ++i)
    c[i] = s.nodes.active[i] ? r_z[i] - c[i] : 0.0;
  std::vector<double> b = multiply(rows.N.get(), r_test);
  const std::vector<double> Ec = multiply(rows.E.get(), c);
  for (std::int32_t i = 0; i < s.size_u; ++i)
    b[i] = rows.scale[i] * (b[i] + Ec[i] + (e.own[i] ? 0.0 : r_test[i]));
  for (std::int32_t dof : s.fixed)
    b[dof] = r_u[dof];
  std::vector<double> x = run(A.get(), b, rtol);

  // Multipliers from the equilibrium of the slave nodes
  std::vector<double> rho = r_test;
  subtract(rho, multiply(s.K.get(), x));
  if (s.K_c)
    subtract(rho, multiply(s.K_c.get(), x));
  for (std::int32_t dof : s.fixed)
    rho[dof] = 0;
  if (s.T_minus_one)
  {
    const std::vector<double> more
        = multiply_transposed(s.T_minus_one.get(), rho);
    for (std::int32_t i = 0; i < s.size_u; ++i)
      rho[i] += more[i];
  }
  const std::vector<double> z = multiply(e.L.get(), rho);
  std::vector<double> z_c;
  if (e.L_c)
  {
    subtract(c, multiply(s.C_u.get(), x));
    z_c = multiply(e.L_c.get(), c);
  }
  for (std::int32_t i = 0; i < s.size_z; ++i)
  {
    if (s.nodes.active[i])
      dz[i] = z[i] + (z_c.empty() ? 0.0 : z_c[i]);
  }
  x.insert(x.end(), dz.begin(), dz.end());
  return x;
}
