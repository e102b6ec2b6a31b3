// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "body_levels.h"

using namespace dolfinx_mortar;

namespace
{
/// Pᵀ A P, positive definite. Collective.
Matrix create_coarse(Mat A, Mat P, double unit)
{
  // Where constraints hold most of an aggregate its columns of P depend on each
  // other, or vanish. The shift is far below the stiffness of any motion, and
  // above round-off.
  Matrix coarse;
  check(MatPtAP(A, P, MAT_INITIAL_MATRIX, PETSC_DEFAULT, coarse.put()),
        "MatPtAP");
  check(MatShift(coarse.get(), 1e-12 * unit), "MatShift");
  PetscInt block;
  check(MatGetBlockSizes(P, nullptr, &block), "MatGetBlockSizes");
  check(MatSetBlockSize(coarse.get(), block), "MatSetBlockSize");
  check(MatSetOption(coarse.get(), MAT_SYMMETRIC, PETSC_TRUE), "MatSetOption");
  return coarse;
}
} // namespace

//-----------------------------------------------------------------------------
std::vector<Matrix> dolfinx_mortar::aggregate_bodies(MPI_Comm comm,
                                                     const std::string& prefix,
                                                     Mat K, MatNullSpace modes)
{
  check(MatSetBlockSize(K, 3), "MatSetBlockSize");
  check(MatSetNearNullSpace(K, modes), "MatSetNearNullSpace");
  check(MatSetOption(K, MAT_SYMMETRIC, PETSC_TRUE), "MatSetOption");
  PetscHandle<PC, PCDestroy> pc;
  check(PCCreate(comm, pc.put()), "PCCreate");
  check(PCSetOptionsPrefix(pc.get(), prefix.c_str()), "PCSetOptionsPrefix");
  check(PCSetOperators(pc.get(), K, K), "PCSetOperators");
  check(PCSetFromOptions(pc.get()), "PCSetFromOptions");
  check(PCSetUp(pc.get()), "PCSetUp");
  PetscInt num_levels;
  Mat* found;
  check(PCGetInterpolations(pc.get(), &num_levels, &found),
        "PCGetInterpolations");
  std::vector<Matrix> P(num_levels - 1);
  for (PetscInt level = 0; level + 1 < num_levels; ++level)
    *P[num_levels - 2 - level].put() = found[level];
  check(PetscFree(found), "PetscFree");
  return P;
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::set_levels(PC pc, const std::string& prefix,
                                const Matrix& A, const std::vector<Matrix>& P,
                                double unit)
{
  const PetscInt num_levels = P.size() + 1;
  // The type in the options is that of aggregation
  check(PCSetOptionsPrefix(pc, (prefix + "mg_bodies_").c_str()),
        "PCSetOptionsPrefix");
  check(PCSetType(pc, PCMG), "PCSetType");
  check(PCMGSetLevels(pc, num_levels, nullptr), "PCMGSetLevels");
  PetscEnum cycle;
  PetscBool given;
  check(PetscOptionsGetEnum(nullptr, prefix.c_str(), "-pc_mg_cycle_type",
                            PCMGCycleTypes, &cycle, &given),
        "PetscOptionsGetEnum");
  if (given)
  {
    check(PCMGSetCycleType(pc, static_cast<PCMGCycleType>(cycle)),
          "PCMGSetCycleType");
  }
  Matrix coarse;
  Mat now = A.get();
  for (PetscInt level = num_levels - 1; level >= 0; --level)
  {
    KSP ksp;
    check(PCMGGetSmoother(pc, level, &ksp), "PCMGGetSmoother");
    const std::string name
        = level > 0 ? "mg_levels_" + std::to_string(level) + "_" : "mg_coarse_";
    check(KSPSetOptionsPrefix(ksp, (prefix + name).c_str()),
          "KSPSetOptionsPrefix");
    check(KSPSetOperators(ksp, now, now), "KSPSetOperators");
    if (level == 0)
      break;
    const Mat to = P[num_levels - 1 - level].get();
    check(PCMGSetInterpolation(pc, level, to), "PCMGSetInterpolation");
    coarse = create_coarse(now, to, unit);
    now = coarse.get();
  }
}
