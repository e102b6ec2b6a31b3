// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

// Problems, and what needs a whole one.

#include "arrays.h"
#include "petsc_objects.h"
#include <algorithm>
#include <cmath>
#include <dolfinx_mortar/solver/checks.h>
#include <dolfinx_mortar/solver/convergence_error.h>
#include <dolfinx_mortar/solver/interface_matrices.h>
#include <dolfinx_mortar/solver/messages.h>
#include <dolfinx_mortar/solver/problem.h>
#include <dolfinx_mortar/solver/relocation.h>
#include <dolfinx_mortar/solver/results.h>
#include <dolfinx_mortar/solver/summary.h>
#include <dolfinx_mortar/solver/support.h>
#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/function.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

namespace nb = nanobind;
using namespace dolfinx_mortar;
using namespace dolfinx_mortar_wrappers;

namespace
{
using Conditions = std::vector<std::shared_ptr<const DirichletBC>>;
using Form = std::shared_ptr<const dolfinx::fem::Form<double>>;
using Function = std::shared_ptr<dolfinx::fem::Function<double>>;
using Options = std::map<std::string, std::string>;

void wrap_results(nb::module_& m)
{
  nb::class_<Resultants>(
      m, "Resultants",
      "Forces and moments about the origin of a contact, on both bodies.")
      .def_ro("slave_force", &Resultants::slave_force)
      .def_ro("master_force", &Resultants::master_force)
      .def_ro("slave_moment", &Resultants::slave_moment)
      .def_ro("master_moment", &Resultants::master_moment);
  nb::class_<Field> f(m, "Field",
                      "Nodal values of a result on the slave surface.");
  f.def_ro("name", &Field::name, "Name of the result.")
      .def_prop_ro(
          "values",
          [](const Field& self)
          {
            return view(
                self, self.values.data(),
                {self.nodes.size(), static_cast<std::size_t>(self.columns)});
          },
          "Values, a row for each node; a view.");
  def_array(f, "nodes", &Field::nodes,
            "Displacement block of each node, among the local blocks of all "
            "bodies; a view.");
}

void wrap_solve(nb::class_<ContactProblem>& p)
{
  p.def(
       "__init__",
       [](ContactProblem* self, int comm, const std::vector<Form>& F,
          const std::vector<Form>& J, const std::vector<Function>& u,
          const Conditions& bcs,
          const std::vector<InterfaceOptions>& interfaces,
          const std::string& prefix, const Options& petsc_options,
          std::optional<bool> condense, std::function<void()> poll,
          double stabilise)
       {
         std::vector<Body> bodies;
         for (std::size_t b = 0; b < u.size(); ++b)
           bodies.push_back({F.at(b), J.at(b), u[b]});
         new (self) ContactProblem(
             MPI_Comm_f2c(comm), std::move(bodies), bcs, interfaces,
             {prefix, petsc_options, condense, std::move(poll), stabilise});
       },
       nb::arg("comm"), nb::arg("F"), nb::arg("J"), nb::arg("u"),
       nb::arg("bcs"), nb::arg("interfaces"), nb::arg("petsc_options_prefix"),
       nb::arg("petsc_options"), nb::arg("condense").none(),
       nb::arg("poll").none(), nb::arg("stabilise"),
       "A problem; `comm` is `comm.py2f()`, `poll` is called now and then. "
       "Collective.")
      .def(
          "solve", [](ContactProblem& self) { return self.solve(); },
          "Solve from the present displacement; the number of iterations. "
          "Collective.")
      .def(
          "solve_adaptively",
          [](ContactProblem& self, std::function<void(double)> load,
             int max_cuts) { return self.solve(load, max_cuts); },
          nb::arg("load"), nb::arg("max_cuts"),
          "Solve in parts where a step does not converge as a whole. "
          "Collective.")
      .def("set_conditions", &ContactProblem::set_conditions, nb::arg("bcs"),
           "Exchange the Dirichlet conditions for others on the same dofs.")
      .def("set_friction", &ContactProblem::set_friction, nb::arg("interface"),
           nb::arg("friction"), "Change the tangential behaviour of a contact.")
      .def(
          "set_offset",
          [](ContactProblem& self, std::size_t i, In<double> offset)
          { self.set_offset(i, copy(offset)); }, nb::arg("interface"),
          nb::arg("offset"),
          "Change what is added to the gap at local slave nodes; empty for "
          "nothing. Collective.")
      .def_prop_ro("history", &ContactProblem::history, nb::rv_policy::copy,
                   "Iterates of the last solve; a copy.")
      .def_prop_ro(
          "snes", [](ContactProblem& self)
          { return nb::steal<PySnes>(PyPetscSNES_New(self.newton().snes())); },
          "PETSc's solver.")
      .def_prop_ro(
          "ksp",
          [](ContactProblem& self)
          {
            return nb::steal<PyKsp>(
                PyPetscKSP_New(self.newton().linear_solver().ksp()));
          },
          "Linear solver of the condensed, or saddle point, system.")
      .def_prop_ro(
          "inner_pc",
          [](ContactProblem& self) -> std::optional<PyPc>
          {
            PC pc = self.newton().linear_solver().inner();
            if (!pc)
              return std::nullopt;
            return nb::steal<PyPc>(PyPetscPC_New(pc));
          },
          "Preconditioner of the symmetric system, where there is one.")
      .def(
          "unread_options",
          [](ContactProblem& self) { return self.newton().options().unread(); },
          "Names of PETSc options that no solver has asked for.")
      .def(
          "check_type",
          [](ContactProblem& self) { self.newton().check_type(); },
          "Refuse a type of the SNES that cannot be used.");
}

void wrap_states(nb::class_<ContactProblem>& p)
{
  p.def_prop_ro("state", &ContactProblem::state, nb::rv_policy::copy,
                "State of the last accepted step; a copy.")
      .def_prop_ro(
          "stabilisation",
          [](const ContactProblem& self)
          {
            const Stabilisation& s = self.stabilisation();
            return std::map<std::string, double>{
                {"force", s.force},
                {"energy", s.energy},
                {"energy_share", s.energy_share}};
          },
          "What the springs that stabilise did in the last solve.")
      .def_prop_ro(
          "started", [](const ContactProblem& self)
          { return self.state().started; }, "A step has been accepted.")
      .def(
          "restore",
          [](ContactProblem& self, const State& state, In<double> u)
          {
            check_size(u, self.coupling().layout.size(), "u");
            self.restore(state, span(u));
          },
          nb::arg("state"), nb::arg("u"),
          "Go to a state, with the displacements of the owned dofs. "
          "Collective.")
      .def("resume", &ContactProblem::resume, nb::arg("state"),
           "Take a state that comes from elsewhere, as from a file. "
           "Collective.")
      .def_prop_ro("evaluation", &ContactProblem::evaluation,
                   nb::rv_policy::reference_internal,
                   nb::sig("def evaluation(self) -> Evaluation | None"),
                   "What follows from the state, None before the first solve; "
                   "a view.")
      .def_prop_ro("coupling", &ContactProblem::coupling,
                   nb::rv_policy::reference_internal,
                   "Dofs of bodies and multipliers; a view.")
      .def_prop_ro("step", &ContactProblem::step,
                   nb::rv_policy::reference_internal,
                   "What is the same for all iterates of a solve; a view.")
      .def(
          "displacements", [](const ContactProblem& self)
          { return as_array(self.bodies().displacements()); },
          "Displacements of the owned dofs.")
      .def(
          "unknowns", [](const ContactProblem& self)
          { return as_array(self.bodies().unknowns()); },
          "The unknowns in place of the displacements.")
      .def("begin", &ContactProblem::begin,
           "State and step that a solve from here would start with. "
           "Collective.")
      .def(
          "evaluate",
          [](ContactProblem& self, const State& state, const Step& step,
             In<double> x)
          {
            check_size(
                x, self.coupling().layout.size() + self.coupling().size(), "x");
            return evaluate(self.bodies(), self.coupling(), step, state,
                            span(x));
          },
          nb::arg("state"), nb::arg("step"), nb::arg("x"),
          "Bodies and interfaces at [u, z]. Collective.")
      .def(
          "linearise",
          [](ContactProblem& self, const State& state, const Step& step,
             const Iteration& iteration, bool damped)
          {
            self.bodies().forget_tangents();
            // The next call changes the values of the bodies' own matrix
            NewtonSystem s
                = linearise(self.coupling(), step, state, iteration.interfaces,
                            duplicate(self.bodies().tangent().get()), damped);
            reduce_tools(self.bodies(), iteration.interfaces, s);
            return s;
          },
          nb::arg("state"), nb::arg("step"), nb::arg("iteration"),
          nb::arg("damped") = true, "The Newton system there. Collective.");
}

void wrap_summary(nb::module_& m, nb::class_<ContactProblem>& p)
{
  nb::class_<Summary>(m, "Summary", "A contact in numbers.")
      .def_ro("force", &Summary::force, "Resultant on the slave.")
      .def_ro("centre", &Summary::centre, "Where the pressure acts.")
      .def_ro("area", &Summary::area, "Area of the nodes in contact.")
      .def_ro("mean_pressure", &Summary::mean_pressure, "Mean there.")
      .def_ro("largest_pressure", &Summary::largest_pressure,
              "Largest nodal pressure.")
      .def_ro("penetration", &Summary::penetration,
              "Deepest overlap at integration points.")
      .def_ro("open", &Summary::open, "Nodes that are open.")
      .def_ro("stick", &Summary::stick, "Nodes that stick.")
      .def_ro("slip", &Summary::slip, "Other nodes in contact.")
      .def_ro("dissipation", &Summary::dissipation,
              "Energy that friction took in the last step.");
  p.def("summarise", &summarise, nb::arg("interface"),
        "Sum up a contact. Collective.")
      .def(
          "nodal_forces", [](const ContactProblem& self, std::size_t i)
          { return as_rows(nodal_forces(self, i), 3); }, nb::arg("interface"),
          "Forces of an interface at the owned nodes of all bodies. "
          "Collective.")
      .def(
          "reactions", [](const ContactProblem& self)
          { return as_rows(reactions(self), 3); },
          "Forces of Dirichlet conditions at the owned nodes of all bodies. "
          "Collective.")
      .def(
          "space_of", [](const ContactProblem& self, const DirichletBC& bc)
          { return space_of(self.bodies().spaces(), bc); }, nb::arg("bc"),
          "Number of the body that a Dirichlet condition is on.");
}

void wrap_interface_results(nb::class_<ContactProblem>& p)
{
  p.def("resultants", &resultants, nb::arg("interface"),
        "Forces and moments of an interface. Collective.")
      .def(
          "tool_motion",
          [](const ContactProblem& self, std::shared_ptr<RigidTool> tool)
          {
            const auto& tools = self.bodies().tools();
            const auto t = std::ranges::find(tools, tool);
            if (t == tools.end())
              throw std::invalid_argument("The tool is in another problem.");
            return self.bodies().tool_motion(t - tools.begin());
          },
          nb::arg("tool"), "Translation and rotation vector of a tool.")
      .def("tool_point", &tool_point, nb::arg("interface"),
           "Where the reference point of a rigid tool is. Collective.")
      .def("num_multiplier_nodes", &num_multiplier_nodes, nb::arg("interface"),
           "Number of slave nodes that carry a multiplier. Collective.")
      .def("results", &results, nb::arg("interface"),
           "Fields of an interface, none before the first solve of a contact. "
           "Collective.")
      .def(
          "facet_multipliers", [](const ContactProblem& self, std::size_t i)
          { return as_rows(facet_multipliers(self, i), 3); },
          nb::arg("interface"),
          "The multiplier at the nodes of each slave facet. Collective.")
      .def(
          "D", [](const ContactProblem& self, std::size_t i)
          { return give(mortar_matrix(self, i, 'D')); }, nb::arg("interface"),
          "Mortar matrix of the slave side. Collective.")
      .def(
          "M", [](const ContactProblem& self, std::size_t i)
          { return give(mortar_matrix(self, i, 'M')); }, nb::arg("interface"),
          "Mortar matrix of the master side. Collective.")
      .def(
          "transformation",
          [](const ContactProblem& self, std::size_t i, bool inverse)
          { return give(transformation(self, i, inverse)); },
          nb::arg("interface"), nb::arg("inverse"),
          "Basis transformation, or its inverse. Collective.")
      .def(
          "inverse", [](const ContactProblem& self, std::size_t i)
          { return give(inverse(self, i)); }, nb::arg("interface"),
          "Inverse of D. Collective.")
      .def(
          "projection",
          [](const ContactProblem& self, std::size_t i)
          {
            return give(multiply(inverse(self, i).get(),
                                 mortar_matrix(self, i, 'M').get()));
          },
          nb::arg("interface"), "Inverse of D times M. Collective.")
      .def(
          "constraints",
          [](const ContactProblem& self, std::size_t i)
          {
            Constraints c = constraints(self, i);
            return std::tuple(
                as_array(std::move(c.slaves)), as_array(std::move(c.masters)),
                as_array(std::move(c.coefficients)),
                as_array(std::move(c.owners)), as_array(std::move(c.offsets)));
          },
          nb::arg("interface"),
          "Slave dofs that a tie determines, their masters, the coefficients "
          "and owners of these, and offsets. Collective.");
}

bool friction_is_overloaded(ContactProblem& p)
{
  auto [state, step] = p.begin();
  std::vector<double> x = p.bodies().unknowns();
  x.insert(x.end(), state.z.begin(), state.z.end());
  const Iteration it = evaluate(p.bodies(), p.coupling(), step, state, x);
  const Matrix K = p.bodies().tangent();
  const auto balance = find_balance(p.coupling(), step, state, it.interfaces,
                                    K.get(), it.free_forces);
  return balance and is_overloaded(p.coupling().comm(), *balance);
}

std::string describe_barely_covered(const ContactProblem& p)
{
  if (!p.evaluation())
    return "";
  const auto found
      = find_barely_covered(p.coupling(), p.step(), p.state(), *p.evaluation());
  if (!found)
    return "";
  return messages::barely_covered(p.coupling().interfaces[found->second],
                                  found->first);
}

void wrap_relocation(nb::module_& m)
{
  nb::class_<Relocation> r(m, "Relocation",
                           "Motion of slave nodes onto the master.");
  r.def_ro("largest", &Relocation::largest,
           "Largest motion of a node [length].");
  def_array(r, "motion", &Relocation::motion,
            "Motion of the owned blocks of all spaces, shape (n, 3); a view.",
            3);
  def_array(r, "x_slave", &Relocation::x_slave,
            "Positions of the local slave nodes before, shape (n, 3); a view.",
            3);
  def_array(r, "x_master", &Relocation::x_master,
            "Positions of the local master nodes, shape (n, 3); a view.", 3);
  m.def(
      "relocate",
      [](int comm,
         const std::vector<std::shared_ptr<const FunctionSpace>>& spaces,
         const InterfaceOptions& tie, const Conditions& bcs, double limit)
      { return relocate(MPI_Comm_f2c(comm), spaces, tie, bcs, limit); },
      nb::arg("comm"), nb::arg("spaces"), nb::arg("tie"), nb::arg("bcs"),
      nb::arg("limit"),
      "Motion of the slave nodes onto the master. Collective.");
  m.def(
      "adjust",
      [](int comm,
         const std::vector<std::shared_ptr<const FunctionSpace>>& spaces,
         const InterfaceOptions& contact, const Conditions& bcs,
         double distance, double gap)
      {
        return adjust(MPI_Comm_f2c(comm), spaces, contact, bcs, distance, gap);
      },
      nb::arg("comm"), nb::arg("spaces"), nb::arg("contact"), nb::arg("bcs"),
      nb::arg("distance"), nb::arg("gap"),
      "Motion of slave nodes that are near the master. Collective.");
}
} // namespace

void wrap_problem(nb::module_& m)
{
  import_petsc4py();
  nb::exception<ConvergenceError>(m, "ConvergenceError", PyExc_RuntimeError);
  wrap_results(m);
  nb::class_<ContactProblem> p(m, "ContactProblem",
                               "Bodies coupled by interfaces.");
  wrap_solve(p);
  wrap_states(p);
  wrap_interface_results(p);
  wrap_summary(m, p);
  wrap_relocation(m);
  m.def(
      "effective_options",
      [](const std::string& prefix, const Options& options, bool large)
      {
        return SolverOptions(prefix, options, false, [large] { return large; })
            .effective();
      },
      nb::arg("prefix"), nb::arg("options"), nb::arg("large") = false,
      "Names and values of the PETSc options that count, for a model that is "
      "large for a direct solver or not.");
  m.def("is_overloaded", &friction_is_overloaded, nb::arg("problem"),
        "Whether friction cannot balance the present loads. Collective.");
  m.def("describe_barely_covered", &describe_barely_covered, nb::arg("problem"),
        "A sentence on the slave node that masters cover least. Collective.");
  m.def(
      "distance_from_cone",
      [](int comm, const Eigen::MatrixXd& vectors, const Eigen::VectorXd& point)
      { return distance_from_cone(MPI_Comm_f2c(comm), vectors, point); },
      nb::arg("comm"), nb::arg("vectors"), nb::arg("point"),
      "Distance of a point from the cone that vectors span. Collective.");
}
