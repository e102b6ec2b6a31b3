// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>
#include <petscsys.h>
#include <stdexcept>
#include <string>
#include <vector>

namespace nb = nanobind;

namespace
{
/// Names in PETSc's database of options that nothing has asked for yet;
/// petsc4py does not tell.
std::vector<std::string> unread_options()
{
  PetscInt num = 0;
  char **names = nullptr, **values = nullptr;
  if (PetscOptionsLeftGet(nullptr, &num, &names, &values) != PETSC_SUCCESS)
    throw std::runtime_error("PETSc does not list its options.");
  const std::vector<std::string> unread(names, names + num);
  PetscOptionsLeftRestore(nullptr, &num, &names, &values);
  return unread;
}
} // namespace

void wrap_facets(nb::module_& m);
void wrap_surface(nb::module_& m);
void wrap_coupling(nb::module_& m);
void wrap_passage(nb::module_& m);

NB_MODULE(cpp, m)
{
  m.doc() = "Mortar coupling of finite element surfaces: C++ library";
  wrap_facets(m);
  wrap_surface(m);
  wrap_coupling(m);
  m.def("unread_options", &unread_options);
  wrap_passage(m);
}
