// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "factorisation_work.h"
#include "solver_options.h"
#include <limits>

using namespace dolfinx_mortar;

namespace
{
/// Operations of the LLᵀ factorisation of a symmetric pattern.
double symmetric_work(Mat A)
{
  constexpr double infinity = std::numeric_limits<double>::infinity();
  PetscBool available;
  check(
      MatGetFactorAvailable(A, MATSOLVERMUMPS, MAT_FACTOR_CHOLESKY, &available),
      "MatGetFactorAvailable");
  if (!available)
    return infinity;
#ifdef PETSC_HAVE_MUMPS
  check(MatSetOption(A, MAT_SPD, PETSC_TRUE), "MatSetOption");
  Matrix F;
  check(MatGetFactor(A, MATSOLVERMUMPS, MAT_FACTOR_CHOLESKY, F.put()),
        "MatGetFactor");
  MatFactorInfo info;
  check(MatFactorInfoInitialize(&info), "MatFactorInfoInitialize");
  check(MatCholeskyFactorSymbolic(F.get(), A, nullptr, &info),
        "MatCholeskyFactorSymbolic");
  PetscReal work;
  check(MatMumpsGetRinfog(F.get(), 1, &work), "MatMumpsGetRinfog");
  return work;
#else
  return infinity;
#endif
}
} // namespace

//-----------------------------------------------------------------------------
double dolfinx_mortar::factorisation_work(const Bodies& bodies)
{
  double work = 0;
  for (const Body& body : bodies.bodies())
  {
    const Matrix graph = create_block_graph(bodies.layout().comm, body);
    // An operation on blocks is 27 on numbers, and LU takes twice those of LLᵀ
    work += 2 * 27 * symmetric_work(graph.get());
  }
  return work;
}
//-----------------------------------------------------------------------------
bool dolfinx_mortar::is_large(const Bodies& bodies)
{
  const Layout& layout = bodies.layout();
  const std::int64_t size
      = sum(layout.comm, static_cast<std::int64_t>(layout.size()));
  return size > SolverOptions::always_large
         or (size > SolverOptions::never_large
             and factorisation_work(bodies) > SolverOptions::largest_work);
}
