// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "newton.h"
#include <dolfinx_mortar/common/error.h>
#include <limits>
#include <stdexcept>

// What PETSc's SNES is told, and what it calls.

using namespace dolfinx_mortar;

//-----------------------------------------------------------------------------
void Newton::create_snes()
{
  MPI_Comm comm = _coupling.comm();
  const PetscInt size = _coupling.layout.size() + _coupling.size();
  _x = create_vector(comm, std::vector<double>(size, 0.0));
  Vector f;
  check(VecDuplicate(_x.get(), f.put()), "VecDuplicate");
  check(MatCreateShell(comm, size, size, PETSC_DETERMINE, PETSC_DETERMINE, this,
                       _jacobian.put()),
        "MatCreateShell");
  check(MatShellSetOperation(_jacobian.get(), MATOP_MULT,
                             reinterpret_cast<void (*)(void)>(multiply)),
        "MatShellSetOperation");
  check(SNESCreate(comm, _snes.put()), "SNESCreate");
  const SNES snes = _snes.get();
  const std::string& prefix = _options.prefix();
  check(SNESSetOptionsPrefix(snes, prefix.c_str()), "SNESSetOptionsPrefix");
  check(SNESSetType(snes, SNESNEWTONLS), "SNESSetType");
  check(SNESSetFunction(snes, f.get(), function, this), "SNESSetFunction");
  check(SNESSetJacobian(snes, _jacobian.get(), _jacobian.get(), jacobian, this),
        "SNESSetJacobian");
  check(SNESSetConvergenceTest(snes, converged, this, nullptr),
        "SNESSetConvergenceTest");
  SNESLineSearch search;
  check(SNESGetLineSearch(snes, &search), "SNESGetLineSearch");
  check(SNESLineSearchSetPreCheck(search, precheck, this),
        "SNESLineSearchSetPreCheck");
  KSP ksp;
  PC pc;
  check(SNESGetKSP(snes, &ksp), "SNESGetKSP");
  check(KSPSetOptionsPrefix(ksp, (prefix + "newton_").c_str()),
        "KSPSetOptionsPrefix");
  check(KSPSetType(ksp, KSPPREONLY), "KSPSetType");
  check(KSPGetPC(ksp, &pc), "KSPGetPC");
  check(PCSetType(pc, PCSHELL), "PCSetType");
  check(PCShellSetContext(pc, this), "PCShellSetContext");
  check(PCShellSetApply(pc, apply), "PCShellSetApply");
  check(SNESSetFromOptions(snes), "SNESSetFromOptions");
  check_type();
  PetscBool monitored;
  check(
      PetscOptionsHasName(nullptr, prefix.c_str(), "-snes_monitor", &monitored),
      "PetscOptionsHasName");
  if (monitored)
    check(SNESMonitorSet(snes, monitor, this, nullptr), "SNESMonitorSet");
}
//-----------------------------------------------------------------------------
void Newton::check_type() const
{
  SNESType type;
  check(SNESGetType(_snes.get(), &type), "SNESGetType");
  const std::string name = type;
  if (name != SNESNEWTONLS and (_coupling.has_contact() or name != SNESKSPONLY))
  {
    throw std::invalid_argument(
        "snes_type is '" + name
        + "', but must be 'newtonls', Newton's iteration with a line search: "
          "active sets settle in several such steps. To change the steps "
          "choose "
          "snes_linesearch_type. Without contact a linear problem may have "
          "'ksponly'.");
  }
}
//-----------------------------------------------------------------------------
int Newton::num_iterations() const
{
  PetscInt n;
  check(SNESGetIterationNumber(_snes.get(), &n), "SNESGetIterationNumber");
  return n;
}
//-----------------------------------------------------------------------------
template <typename Work>
void Newton::guarded(Work&& work)
{
  try
  {
    work();
  }
  catch (...)
  {
    _run->raised = std::current_exception();
  }
}
//-----------------------------------------------------------------------------
PetscErrorCode Newton::function(SNES, Vec x, Vec f, void* context)
{
  Newton& self = *static_cast<Newton*>(context);
  std::vector<double> residual;
  self.guarded(
      [&]
      {
        const VectorView values(x);
        residual = self.evaluate_at(values.get()).residual;
        const std::vector<double>& scale = self._run->row_scale;
        for (std::size_t i = 0; i < scale.size(); ++i)
          residual[i] *= scale[i];
        set_values(f, residual);
      });
  if (self._run->raised)
  {
    self._run->iteration.reset();
    PetscCall(VecSet(f, std::numeric_limits<double>::quiet_NaN()));
  }
  return PETSC_SUCCESS;
}
//-----------------------------------------------------------------------------
PetscErrorCode Newton::jacobian(SNES, Vec x, Mat, Mat, void* context)
{
  Newton& self = *static_cast<Newton*>(context);
  self.guarded([&] { self.linearise(VectorView(x).get()); });
  return PETSC_SUCCESS;
}
//-----------------------------------------------------------------------------
PetscErrorCode Newton::converged(SNES, PetscInt it, PetscReal, PetscReal,
                                 PetscReal norm, SNESConvergedReason* reason,
                                 void* context)
{
  Newton& self = *static_cast<Newton*>(context);
  *reason = SNES_DIVERGED_FNORM_NAN;
  self.guarded([&] { *reason = self.test(it, norm); });
  return PETSC_SUCCESS;
}
//-----------------------------------------------------------------------------
PetscErrorCode Newton::precheck(SNESLineSearch, Vec x, Vec y,
                                PetscBool* changed, void* context)
{
  Newton& self = *static_cast<Newton*>(context);
  *changed = PETSC_TRUE;
  Run& run = *self._run;
  const bool raised = any(self._coupling.comm(), static_cast<bool>(run.raised));
  if (!raised)
    self.guarded([&] { self.shorten(VectorView(x).get(), y); });
  if (raised or run.raised)
    PetscCall(VecSet(y, 0.0)); // the iteration ends with this step
  return PETSC_SUCCESS;
}
//-----------------------------------------------------------------------------
PetscErrorCode Newton::monitor(SNES, PetscInt, PetscReal, void* context)
{
  const Newton& self = *static_cast<const Newton*>(context);
  int rank;
  MPI_Comm_rank(self._coupling.comm(), &rank);
  if (rank > 0 or self._history.empty())
    return PETSC_SUCCESS;
  const Iterate& last = self._history.back();
  if (self._coupling.has_contact())
  {
    PetscCall(PetscPrintf(
        PETSC_COMM_SELF, "      active %d (stick %d, slip %d), %d changed, ",
        static_cast<int>(last.active), static_cast<int>(last.stick),
        static_cast<int>(last.slip), static_cast<int>(last.changes)));
  }
  else
    PetscCall(PetscPrintf(PETSC_COMM_SELF, "      "));
  PetscCall(PetscPrintf(PETSC_COMM_SELF, "force %.3e, constraint %.3e\n",
                        last.force, last.constraint));
  return PETSC_SUCCESS;
}
//-----------------------------------------------------------------------------
PetscErrorCode Newton::multiply(Mat A, Vec x, Vec y)
{
  void* context;
  PetscCall(MatShellGetContext(A, &context));
  Newton& self = *static_cast<Newton*>(context);
  self.guarded(
      [&]
      {
        std::vector<double> f
            = self._run->system->multiply(VectorView(x).get());
        const std::vector<double>& scale = self._run->row_scale;
        for (std::size_t i = 0; i < scale.size(); ++i)
          f[i] *= scale[i];
        set_values(y, f);
      });
  if (self._run->raised)
    PetscCall(VecSet(y, std::numeric_limits<double>::quiet_NaN()));
  return PETSC_SUCCESS;
}
//-----------------------------------------------------------------------------
double Newton::linear_tolerance() const
{
  PetscBool inexact;
  check(SNESKSPGetUseEW(_snes.get(), &inexact), "SNESKSPGetUseEW");
  if (!inexact)
    return 0;
  KSP ksp;
  PetscReal asked, rtol;
  check(SNESGetKSP(_snes.get(), &ksp), "SNESGetKSP");
  check(KSPGetTolerances(ksp, &asked, nullptr, nullptr, nullptr),
        "KSPGetTolerances");
  check(
      SNESGetTolerances(_snes.get(), nullptr, &rtol, nullptr, nullptr, nullptr),
      "SNESGetTolerances");
  PetscReal loosest;
  check(SNESKSPGetParametersEW(_snes.get(), nullptr, nullptr, &loosest, nullptr,
                               nullptr, nullptr, nullptr),
        "SNESKSPGetParametersEW");
  const Iterate& now = _history.back();
  // While sets change the next system is another one, whose residual does not
  // follow from this one's
  if (now.changes > 0)
    return std::max(asked, loosest);
  const double left = std::max({now.force, now.constraint, now.prescribed});
  return std::max(asked, std::min(loosest, 0.1 * rtol / left));
}
//-----------------------------------------------------------------------------
PetscErrorCode Newton::apply(PC pc, Vec x, Vec y)
{
  void* context;
  PetscCall(PCShellGetContext(pc, &context));
  Newton& self = *static_cast<Newton*>(context);
  Run& run = *self._run;
  const bool raised = any(self._coupling.comm(), static_cast<bool>(run.raised));
  if (!raised)
  {
    self.guarded(
        [&]
        {
          if (!run.system)
          {
            throw std::runtime_error("The SNES asks for no Jacobian: let it "
                                     "form one in each solve.");
          }
          std::vector<double> r = local_values(x);
          for (std::size_t i = 0; i < run.row_scale.size(); ++i)
            r[i] /= run.row_scale[i];
          set_values(
              y, self._solver->solve(*run.system, r, self.linear_tolerance()));
        });
  }
  if (raised or run.raised)
    PetscCall(VecSet(y, 0.0));
  return PETSC_SUCCESS;
}
