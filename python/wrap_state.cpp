// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

// States of a problem: values that Python may keep, change and give back.

#include "arrays.h"
#include <dolfinx_mortar/contact/state.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/vector.h>

namespace nb = nanobind;
using namespace dolfinx_mortar;
using namespace dolfinx_mortar_wrappers;

namespace
{
/// Array that Python reads and writes as a copy, with `columns` values in a row
/// (0: one axis only)
template <typename C>
void def_values(nb::class_<C>& c, const char* name,
                std::vector<double> C::* member, const char* doc,
                std::size_t columns = 0)
{
  auto set = [member](C& self, In<double> v) { self.*member = copy(v); };
  if (columns)
  {
    c.def_prop_rw(
        name, [member, columns](const C& self)
        { return as_rows(std::vector<double>(self.*member), columns); }, set,
        nb::rv_policy::automatic, doc);
  }
  else
  {
    c.def_prop_rw(
        name, [member](const C& self)
        { return as_array(std::vector<double>(self.*member)); }, set,
        nb::rv_policy::automatic, doc);
  }
}

std::vector<Status> statuses(const In<std::int8_t>& values)
{
  std::vector<Status> out;
  for (std::int8_t v : span(values))
  {
    check_index(v, 3, "status");
    out.push_back(static_cast<Status>(v));
  }
  return out;
}
} // namespace

void wrap_state(nb::module_& m)
{
  nb::class_<InterfaceState> i(m, "InterfaceState",
                               "What an interface remembers between solves.");
  i.def_prop_ro(
       "basis", [](const InterfaceState& s) -> const Basis& { return s.basis; },
       nb::rv_policy::reference_internal,
       "Nodes that carry multipliers, and the basis there; a view.")
      .def_ro("dissipation", &InterfaceState::dissipation,
              "Energy that friction took in the last step, of this rank.")
      .def_prop_rw(
          "status", [](const InterfaceState& s)
          { return as_numbers(std::span(s.status)); },
          [](InterfaceState& s, In<std::int8_t> v) { s.status = statuses(v); },
          nb::rv_policy::automatic,
          "State of each owned node, values of Status; a copy.");
  def_values(i, "slip", &InterfaceState::slip,
             "Slip of each owned node [length] since contact began, shape "
             "(n, 3); a copy.",
             3);
  def_values(i, "c_n", &InterfaceState::c_n,
             "Normal complementarity parameters [traction per weighted gap] "
             "of the owned nodes; a copy.");
  def_values(i, "c_t", &InterfaceState::c_t,
             "Tangential complementarity parameters [traction per weighted "
             "gap] of the owned nodes; a copy.");
  def_values(i, "scale", &InterfaceState::scale,
             "Scales of the tangential equations [traction] where no traction "
             "gives one; a copy.");

  nb::class_<State> s(m, "State", "State of a coupled problem: a value.");
  s.def(nb::init<const State&>(), nb::arg("other"))
      .def_rw("started", &State::started, "A step has been accepted.")
      .def_rw("interfaces", &State::interfaces,
              "Of each interface; a list of copies.")
      .def(
          "__eq__", [](const State& a, const State& b) { return a == b; },
          nb::sig("def __eq__(self, other: object, /) -> bool"),
          nb::is_operator());
  def_values(s, "u", &State::u,
             "Displacements of the owned dofs in the last accepted step, empty "
             "before there is one; a copy.");
  def_values(s, "z", &State::z,
             "Multipliers of the owned slave nodes of one interface after the "
             "other; a copy.");
}
