// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "newton_system.h"

using namespace dolfinx_mortar;

//-----------------------------------------------------------------------------
void dolfinx_mortar::reduce_tools(const Bodies& bodies,
                                  const Evaluation& evaluation, NewtonSystem& s)
{
  const Matrix C = bodies.tool_jacobian();
  if (!C)
    return;
  const bool same = s.B.get() == s.B_tilde.get();
  s.B = multiply(s.B.get(), C.get());
  s.B_tilde = same ? s.B : multiply(s.B_tilde.get(), C.get());
  s.C_u = multiply(s.C_u.get(), C.get());
  Matrix stiffness = bodies.tool_stiffness(evaluation.force);
  if (s.K_c)
  {
    const Matrix KC = multiply(s.K_c.get(), C.get());
    Matrix CKC;
    check(MatTransposeMatMult(C.get(), KC.get(), MAT_INITIAL_MATRIX,
                              PETSC_DEFAULT, CKC.put()),
          "MatTransposeMatMult");
    add(CKC.get(), 1.0, stiffness.get());
    s.K_c = std::move(CKC);
  }
  else
    s.K_c = std::move(stiffness);
}
