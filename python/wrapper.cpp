// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include <nanobind/nanobind.h>

namespace nb = nanobind;

void wrap_facets(nb::module_& m);
void wrap_surface(nb::module_& m);
void wrap_assembly(nb::module_& m);
void wrap_laws(nb::module_& m);
void wrap_passage(nb::module_& m);
void wrap_state(nb::module_& m);
void wrap_coupling(nb::module_& m);
void wrap_evaluation(nb::module_& m);
void wrap_problem(nb::module_& m);

NB_MODULE(cpp, m)
{
  m.doc() = "Mortar coupling of finite element surfaces: C++ library";
  m.attr("version") = MORTAR_VERSION;
  // Each needs the types of those before, whose names are in its signatures
  wrap_facets(m);
  wrap_surface(m);
  wrap_assembly(m);
  wrap_laws(m);
  wrap_passage(m);
  wrap_state(m);
  wrap_coupling(m);
  wrap_evaluation(m);
  wrap_problem(m);
}
