// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

// PETSc objects as petsc4py has them, with its names in signatures. Each file
// that includes this calls import_petsc4py().

#include <dolfinx_mortar/assembly/petsc.h>
#include <nanobind/nanobind.h>
#include <optional>
#include <petsc4py/petsc4py.h>

namespace dolfinx_mortar_wrappers
{
inline bool is_mat(PyObject* o)
{
  return PyObject_TypeCheck(o, &PyPetscMat_Type);
}
inline bool is_snes(PyObject* o)
{
  return PyObject_TypeCheck(o, &PyPetscSNES_Type);
}
inline bool is_ksp(PyObject* o)
{
  return PyObject_TypeCheck(o, &PyPetscKSP_Type);
}
inline bool is_pc(PyObject* o)
{
  return PyObject_TypeCheck(o, &PyPetscPC_Type);
}

struct PyMat : nanobind::object
{
  NB_OBJECT(PyMat, nanobind::object, "petsc4py.PETSc.Mat", is_mat)
};
struct PySnes : nanobind::object
{
  NB_OBJECT(PySnes, nanobind::object, "petsc4py.PETSc.SNES", is_snes)
};
struct PyKsp : nanobind::object
{
  NB_OBJECT(PyKsp, nanobind::object, "petsc4py.PETSc.KSP", is_ksp)
};
struct PyPc : nanobind::object
{
  NB_OBJECT(PyPc, nanobind::object, "petsc4py.PETSc.PC", is_pc)
};

/// A matrix for Python, which shares it; none for null
inline std::optional<PyMat> give_or_none(const dolfinx_mortar::Matrix& A)
{
  if (!A)
    return std::nullopt;
  return nanobind::steal<PyMat>(PyPetscMat_New(A.get()));
}

/// A matrix, not null, for Python, which shares it
inline PyMat give(const dolfinx_mortar::Matrix& A)
{
  return give_or_none(A).value();
}
} // namespace dolfinx_mortar_wrappers
