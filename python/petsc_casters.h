// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

// Where DOLFINx's casters of PETSc objects are depends on its version
#if __has_include(<dolfinx_wrappers/caster_petsc.h>)
#include <dolfinx_wrappers/caster_petsc.h>
#else
#include <caster_petsc.h>
#endif
#include <dolfinx_mortar/assembly/petsc.h>

namespace dolfinx_mortar_wrappers
{
/// A new reference to a matrix, for Python to take over; none for null
inline Mat give(const dolfinx_mortar::Matrix& A)
{
  if (A.get())
    PetscObjectReference(reinterpret_cast<PetscObject>(A.get()));
  return A.get();
}
} // namespace dolfinx_mortar_wrappers
