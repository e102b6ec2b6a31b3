// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

// What follows from a state: evaluations and linearisations.

#include "arrays.h"
#include "petsc_objects.h"
#include <dolfinx_mortar/solver/newton.h>
#include <dolfinx_mortar/solver/problem.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

namespace nb = nanobind;
using namespace dolfinx_mortar;
using namespace dolfinx_mortar_wrappers;

namespace
{
void wrap_evaluations(nb::module_& m)
{
  nb::class_<InterfaceEvaluation> i(
      m, "InterfaceEvaluation",
      "An interface in a state; arrays are views, over the owned nodes.");
  def_array(i, "gap", &InterfaceEvaluation::gap, "Weighted gaps [length³].");
  def_array(i, "weighted_slip", &InterfaceEvaluation::weighted_slip,
            "Weighted relative motion since the last accepted step [length³], "
            "shape (n, 3); empty without friction.",
            3);
  def_array(i, "scale", &InterfaceEvaluation::scale,
            "Scales of the tangential equations [traction].");
  i.def_ro("law", &InterfaceEvaluation::law,
           "Contact conditions with their derivatives; a view.")
      .def_prop_ro(
          "nodal", [](const InterfaceEvaluation& e) -> const NodalIntegrals&
          { return e.geometry->nodal; }, nb::rv_policy::reference_internal,
          "What the integrals leave on the slave nodes; a view.")
      .def_prop_ro(
          "configuration",
          [](const InterfaceEvaluation& e) -> const Configuration&
          { return e.geometry->configuration; },
          nb::rv_policy::reference_internal, "Where the surfaces are; a view.");

  nb::class_<Evaluation> e(m, "Evaluation",
                           "Interfaces in a state; arrays are views.");
  e.def_ro("interfaces", &Evaluation::interfaces, "A list of views.");
  def_array(e, "force", &Evaluation::force,
            "Forces Bᵀz of the interfaces on the owned dofs.");
  def_array(e, "constraints", &Evaluation::constraints,
            "Residual of the constraints.");

  nb::class_<Iteration> it(m, "Iteration", "Bodies and interfaces in a state.");
  it.def_ro("interfaces", &Iteration::interfaces, "The interfaces; a view.")
      .def_ro("force_scale", &Iteration::force_scale,
              "Size of the forces at work: reactions and contact forces.");
  def_array(it, "residual", &Iteration::residual,
            "Residual [forces, constraints] of this rank; at Dirichlet dofs "
            "the distance to the prescribed displacement. A view.");
}

void wrap_linearisation(nb::module_& m)
{
  nb::class_<Step>(m, "Step", "What is the same for all iterates of a solve.")
      .def(nb::init<const Step&>(), nb::arg("other"))
      .def_prop_ro(
          "weights", [](const Step& s) { return s.weights; },
          "Area of each local slave node [length²], of each interface; a "
          "copy.")
      .def_rw("scale", &Step::scale,
              "Scales of the tangential equations to be used, of each "
              "interface; empty for the nodes' own. A copy.")
      .def_prop_ro(
          "T", [](const Step& s) { return give_or_none(s.T); },
          "Basis transformation; None where it is the identity.")
      .def_prop_ro(
          "B_ties", [](const Step& s) { return give_or_none(s.B_ties); },
          "Mortar matrix [D, -M] of the ties; None without ties.")
      .def_prop_ro(
          "B_tilde_ties",
          [](const Step& s) { return give_or_none(s.B_tilde_ties); },
          "The same in the transformed basis.");

  nb::class_<NewtonSystem> n(m, "NewtonSystem", "The linearised problem.");
  auto matrix
      = [&](const char* name, Matrix NewtonSystem::* member, const char* doc)
  {
    n.def_prop_ro(
        name, [member](const NewtonSystem& s)
        { return give_or_none(s.*member); }, doc);
  };
  matrix("K", &NewtonSystem::K, "Tangent of the bodies.");
  matrix("K_c", &NewtonSystem::K_c,
         "Derivative of the contact forces; None where there is none.");
  matrix("B", &NewtonSystem::B, "Mortar matrix [D, -M].");
  matrix("C_u", &NewtonSystem::C_u,
         "Derivative of the constraints by displacements.");
  matrix("C_z", &NewtonSystem::C_z,
         "Derivative of the constraints by multipliers.");
  def_array(n, "fixed", &NewtonSystem::fixed,
            "Local displacement dofs with a Dirichlet condition; a view.");
  n.def(
      "multiply",
      [](const NewtonSystem& s, In<double> x)
      {
        check_size(x, s.size_u + s.size_z, "x");
        return as_array(s.multiply(span(x)));
      },
      nb::arg("x"), "The left-hand sides for [du, dz]. Collective.");

  nb::class_<Iterate>(m, "Iterate", "An iterate of Newton's method.")
      .def_ro("iteration", &Iterate::iteration, "Its number.")
      .def_ro("force", &Iterate::force,
              "Norm of the residual force, relative to the forces at work.")
      .def_ro("residual", &Iterate::residual, "The same, absolute.")
      .def_ro("constraint", &Iterate::constraint,
              "Largest violation of a constraint, relative to displacements or "
              "tractions.")
      .def_ro("prescribed", &Iterate::prescribed,
              "Largest distance to a prescribed displacement, relative to "
              "displacements.")
      .def_ro("active", &Iterate::active, "Number of nodes in contact.")
      .def_ro("stick", &Iterate::stick, "Number of nodes that stick.")
      .def_ro("slip", &Iterate::slip, "Number of nodes that slip.")
      .def_ro("changes", &Iterate::changes,
              "Number of nodes that changed their state.")
      .def_ro("step", &Iterate::step,
              "Length of the step that led here, relative to Newton's.")
      .def_ro("cycle", &Iterate::cycle,
              "The active sets have been found to cycle.");
}
} // namespace

void wrap_evaluation(nb::module_& m)
{
  import_petsc4py();
  wrap_evaluations(m);
  wrap_linearisation(m);
}
