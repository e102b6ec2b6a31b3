// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

// Problems, their states and what follows from these.

#include "arrays.h"
#include "petsc_casters.h"
#include <dolfinx_mortar/contact/state.h>
#include <dolfinx_mortar/solver/checks.h>
#include <dolfinx_mortar/solver/convergence_error.h>
#include <dolfinx_mortar/solver/interface_matrices.h>
#include <dolfinx_mortar/solver/messages.h>
#include <dolfinx_mortar/solver/problem.h>
#include <dolfinx_mortar/solver/relocation.h>
#include <dolfinx_mortar/solver/results.h>
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
using Part
    = std::tuple<std::shared_ptr<const FunctionSpace>,
                 std::shared_ptr<const dolfinx::mesh::MeshTags<std::int32_t>>,
                 std::int32_t>;

std::vector<TaggedFacets> tagged_facets(const std::vector<Part>& parts)
{
  std::vector<TaggedFacets> out;
  for (const auto& [V, tags, tag] : parts)
    out.push_back({V, tags, tag});
  return out;
}

/// Array of double, or nothing where it is empty
auto array_of(std::vector<double>&& v, std::size_t columns)
{
  const std::size_t rows = v.size() / columns;
  return as_array(std::move(v), {rows, columns});
}

void wrap_state(nb::module_& m)
{
  nb::class_<InterfaceState> i(m, "InterfaceState",
                               "What an interface remembers between solves.");
  i.def_prop_ro(
       "basis", [](const InterfaceState& s) -> const Basis& { return s.basis; },
       nb::rv_policy::reference_internal)
      .def_ro("dissipation", &InterfaceState::dissipation)
      .def_prop_rw(
          "status", [](const InterfaceState& s)
          { return as_numbers(std::span(s.status)); },
          [](InterfaceState& s, In<std::int8_t> values)
          {
            s.status.clear();
            for (std::int8_t v : span(values))
            {
              check_index(v, 3, "status");
              s.status.push_back(static_cast<Status>(v));
            }
          },
          nb::rv_policy::automatic, "State of each owned node; a copy.");
  auto values
      = [&](const char* name, std::vector<double> InterfaceState::* member,
            std::size_t columns)
  {
    i.def_prop_rw(
        name,
        [member, columns](const InterfaceState& s)
        {
          std::vector<double> v = s.*member;
          const std::size_t n = v.size();
          return columns > 1 ? nb::cast(array_of(std::move(v), columns))
                             : nb::cast(as_array(std::move(v), {n}));
        },
        [member](InterfaceState& s, In<double> v) { s.*member = copy(v); },
        nb::rv_policy::automatic, "Values of the owned nodes; a copy.");
  };
  values("slip", &InterfaceState::slip, 3);
  values("c_n", &InterfaceState::c_n, 1);
  values("c_t", &InterfaceState::c_t, 1);
  values("scale", &InterfaceState::scale, 1);

  nb::class_<State> s(m, "State", "State of a coupled problem: a value.");
  s.def(nb::init<const State&>(), nb::arg("other"))
      .def_rw("started", &State::started)
      .def_rw("interfaces", &State::interfaces)
      .def("__eq__", [](const State& a, const State& b) { return a == b; });
  auto whole = [&](const char* name, std::vector<double> State::* member)
  {
    s.def_prop_rw(
        name,
        [member](const State& state)
        {
          std::vector<double> v = state.*member;
          const std::size_t n = v.size();
          return as_array(std::move(v), {n});
        },
        [member](State& state, In<double> v) { state.*member = copy(v); },
        nb::rv_policy::automatic, "Values of the owned dofs; a copy.");
  };
  whole("u", &State::u);
  whole("z", &State::z);
}

void wrap_evaluation(nb::module_& m)
{
  nb::class_<InterfaceEvaluation> i(m, "InterfaceEvaluation",
                                    "What follows from a state.");
  def_array(i, "gap", &InterfaceEvaluation::gap, "Weighted gaps.");
  def_array(i, "motion", &InterfaceEvaluation::motion,
            "Weighted relative motions, shape (n, 3).", 3);
  def_array(i, "scale", &InterfaceEvaluation::scale,
            "Scale of the tangential equations.");
  i.def_ro("law", &InterfaceEvaluation::law)
      .def_prop_ro(
          "nodal", [](const InterfaceEvaluation& e) -> const NodalIntegrals&
          { return e.geometry->nodal; }, nb::rv_policy::reference_internal)
      .def_prop_ro(
          "configuration",
          [](const InterfaceEvaluation& e) -> const Configuration&
          { return e.geometry->configuration; },
          nb::rv_policy::reference_internal);

  nb::class_<Evaluation> e(m, "Evaluation", "Interfaces in a state.");
  e.def_ro("interfaces", &Evaluation::interfaces);
  def_array(e, "force", &Evaluation::force, "Forces of the interfaces.");
  def_array(e, "constraints", &Evaluation::constraints,
            "Residual of the constraints.");

  nb::class_<Iteration> it(m, "Iteration", "Bodies and interfaces in a state.");
  it.def_ro("interfaces", &Iteration::interfaces)
      .def_ro("force_scale", &Iteration::force_scale);
  def_array(it, "residual", &Iteration::residual,
            "Residual [forces, constraints] of this rank.");

  nb::class_<Step>(m, "Step", "What is the same for all iterates of a solve.")
      .def(nb::init<const Step&>(), nb::arg("other"))
      .def_prop_ro(
          "weights", [](const Step& s) { return s.weights; },
          "Area of each local slave node, of each interface.")
      .def_rw("scale", &Step::scale,
              "Scales of the tangential equations to be used, of each "
              "interface; empty for the nodes' own.")
      .def_prop_ro(
          "T", [](const Step& s) { return give(s.T); },
          nb::rv_policy::take_ownership)
      .def_prop_ro(
          "B_ties", [](const Step& s) { return give(s.B_ties); },
          nb::rv_policy::take_ownership)
      .def_prop_ro(
          "B_tilde_ties", [](const Step& s) { return give(s.B_tilde_ties); },
          nb::rv_policy::take_ownership);

  nb::class_<NewtonSystem> n(m, "NewtonSystem", "The linearised problem.");
  auto matrix = [&](const char* name, Matrix NewtonSystem::* member)
  {
    n.def_prop_ro(
        name,
        [member](const NewtonSystem& s) -> std::optional<Mat>
        {
          if (!(s.*member))
            return std::nullopt;
          return give(s.*member);
        },
        nb::rv_policy::take_ownership);
  };
  matrix("K", &NewtonSystem::K);
  matrix("K_c", &NewtonSystem::K_c);
  matrix("B", &NewtonSystem::B);
  matrix("C_u", &NewtonSystem::C_u);
  matrix("C_z", &NewtonSystem::C_z);
  def_array(n, "fixed", &NewtonSystem::fixed,
            "Local displacement dofs with a Dirichlet condition.");
  n.def(
      "multiply",
      [](const NewtonSystem& s, In<double> x)
      {
        check_size(x, s.size_u + s.size_z, "x");
        std::vector<double> y = s.multiply(span(x));
        const std::size_t size = y.size();
        return as_array(std::move(y), {size});
      },
      nb::arg("x"), "The left-hand sides for [du, dz]. Collective.");

  nb::class_<Iterate>(m, "Iterate", "An iterate of Newton's method.")
      .def_ro("iteration", &Iterate::iteration)
      .def_ro("force", &Iterate::force)
      .def_ro("residual", &Iterate::residual)
      .def_ro("constraint", &Iterate::constraint)
      .def_ro("prescribed", &Iterate::prescribed)
      .def_ro("active", &Iterate::active)
      .def_ro("stick", &Iterate::stick)
      .def_ro("slip", &Iterate::slip)
      .def_ro("changes", &Iterate::changes)
      .def_ro("step", &Iterate::step)
      .def_ro("cycle", &Iterate::cycle);
}

void wrap_options(nb::module_& m)
{
  nb::enum_<InitialActive::Choice>(m, "InitialActive",
                                   "Nodes in contact at first.")
      .value("gap", InitialActive::Choice::gap)
      .value("none", InitialActive::Choice::none)
      .value("all", InitialActive::Choice::all)
      .value("given", InitialActive::Choice::given);
  nb::class_<InterfaceOptions>(m, "InterfaceOptions",
                               "What a user says of a tie or a contact.")
      .def(
          "__init__",
          [](InterfaceOptions* self, const std::vector<Part>& slave,
             const std::vector<Part>& master, const IntegrationOptions& options,
             double min_coverage)
          {
            new (self) InterfaceOptions();
            self->slave = tagged_facets(slave);
            self->master = tagged_facets(master);
            self->integration = options;
            self->min_coverage = min_coverage;
          },
          nb::arg("slave"), nb::arg("master"), nb::arg("options"),
          nb::arg("min_coverage"))
      .def(
          "make_contact",
          [](InterfaceOptions& self, std::optional<double> c_n,
             std::optional<double> c_t, bool reference_geometry,
             const Friction& friction, double feature_angle,
             std::optional<std::array<double, 3>> normal,
             InitialActive::Choice choice, nb::object flags)
          {
            self.contact = ContactOptions{c_n, c_t, reference_geometry};
            self.friction = friction;
            self.feature_angle = feature_angle;
            self.normal = normal;
            self.initial_active.choice = choice;
            if (flags.is_none())
              return;
            self.initial_active.flags = [flags](std::span<const double> x)
            {
              std::vector<double> positions(x.begin(), x.end());
              const std::size_t n = positions.size() / 3;
              nb::object result = flags(as_array(std::move(positions), {n, 3}));
              return copy(nb::cast<In<std::int8_t>>(result));
            };
          },
          nb::arg("c_n").none(), nb::arg("c_t").none(),
          nb::arg("reference_geometry"), nb::arg("friction"),
          nb::arg("feature_angle"), nb::arg("normal").none(),
          nb::arg("initial_active"), nb::arg("flags").none())
      .def(
          "set_positions",
          [](InterfaceOptions& self, In<double> slave, In<double> master)
          {
            self.x_slave = copy(slave);
            self.x_master = copy(master);
          },
          nb::arg("slave"), nb::arg("master"));

  nb::class_<CoupledInterface>(m, "CoupledInterface",
                               "An interface of a problem.")
      .def_ro("data", &CoupledInterface::data)
      .def_ro("first_node", &CoupledInterface::first_node)
      .def_prop_ro("num_owned", &CoupledInterface::num_owned);
  nb::class_<Layout> l(m, "Layout", "Displacement dofs of several bodies.");
  l.def_prop_ro("size", &Layout::size)
      .def_ro("first_block", &Layout::first_block)
      .def_ro("num_owned", &Layout::num_owned)
      .def_ro("num_local", &Layout::num_local)
      .def_ro("num_parts", &Layout::num_parts)
      .def("local_start", &Layout::local_start, nb::arg("body"))
      .def("owned_start", &Layout::owned_start, nb::arg("body"));
  def_array(l, "X", &Layout::X, "Positions of local blocks, shape (n, 3).", 3);
  def_array(l, "parts", &Layout::parts, "Connected part of each local block.");
  nb::class_<Coupling> c(m, "Coupling", "All interfaces of a problem.");
  c.def_ro("layout", &Coupling::layout)
      .def_ro("interfaces", &Coupling::interfaces)
      .def_prop_ro("size", &Coupling::size)
      .def_prop_ro("has_contact", &Coupling::has_contact);
  def_array(c, "fixed_dofs", &Coupling::fixed_dofs,
            "Owned displacement dofs with a Dirichlet condition.");
}

void check_vector(const ContactProblem& p, const In<double>& x)
{
  check_size(x, p.coupling().layout.size() + p.coupling().size(), "x");
}

void wrap_contact_problem(nb::module_& m)
{
  using Bcs = std::vector<std::shared_ptr<const DirichletBC>>;
  using Form = std::shared_ptr<const dolfinx::fem::Form<double>>;
  using Function = std::shared_ptr<dolfinx::fem::Function<double>>;
  nb::class_<ContactProblem> p(m, "ContactProblem",
                               "Bodies coupled by interfaces.");
  p.def(
      "__init__",
      [](ContactProblem* self, int comm, const std::vector<Form>& F,
         const std::vector<Form>& J, const std::vector<Function>& u,
         const Bcs& bcs, const std::vector<InterfaceOptions>& interfaces,
         const std::string& prefix,
         const std::map<std::string, std::string>& petsc_options,
         std::optional<bool> condense, std::function<void()> poll)
      {
        std::vector<Body> bodies;
        for (std::size_t b = 0; b < u.size(); ++b)
          bodies.push_back({F.at(b), J.at(b), u[b]});
        new (self) ContactProblem(
            MPI_Comm_f2c(comm), std::move(bodies), bcs, interfaces,
            {prefix, petsc_options, condense, std::move(poll)});
      },
      nb::arg("comm"), nb::arg("F"), nb::arg("J"), nb::arg("u"), nb::arg("bcs"),
      nb::arg("interfaces"), nb::arg("petsc_options_prefix"),
      nb::arg("petsc_options"), nb::arg("condense").none(),
      nb::arg("poll").none());
  p.def("solve", [](ContactProblem& self) { return self.solve(); })
      .def(
          "solve_adaptively",
          [](ContactProblem& self, std::function<void(double)> load,
             int max_cuts) { return self.solve(load, max_cuts); },
          nb::arg("load"), nb::arg("max_cuts"))
      .def_prop_ro("state", &ContactProblem::state, nb::rv_policy::copy,
                   "The state; a copy.")
      .def_prop_ro("started", [](const ContactProblem& self)
                   { return self.state().started; })
      .def(
          "restore",
          [](ContactProblem& self, const State& state, In<double> u)
          {
            check_size(u, self.coupling().layout.size(), "u");
            self.restore(state, span(u));
          },
          nb::arg("state"), nb::arg("u"))
      .def("resume", &ContactProblem::resume, nb::arg("state"))
      .def_prop_ro("evaluation", &ContactProblem::evaluation,
                   nb::rv_policy::reference_internal)
      .def_prop_ro("coupling", &ContactProblem::coupling,
                   nb::rv_policy::reference_internal)
      .def_prop_ro("step", &ContactProblem::step,
                   nb::rv_policy::reference_internal)
      .def_prop_ro("history", &ContactProblem::history, nb::rv_policy::copy)
      .def("set_conditions", &ContactProblem::set_conditions, nb::arg("bcs"))
      .def("set_friction", &ContactProblem::set_friction, nb::arg("interface"),
           nb::arg("friction"))
      .def(
          "displacements",
          [](const ContactProblem& self)
          {
            std::vector<double> u = self.bodies().displacements();
            const std::size_t n = u.size();
            return as_array(std::move(u), {n});
          },
          "Displacements of the owned dofs.")
      .def(
          "resultants",
          [](const ContactProblem& self, std::size_t i)
          {
            const Resultants r = resultants(self, i);
            return std::vector<std::array<double, 3>>{
                r.slave_force, r.master_force, r.slave_moment, r.master_moment};
          },
          nb::arg("interface"))
      .def(
          "mortar_matrix",
          [](const ContactProblem& self, std::size_t i, const std::string& name)
          { return give(mortar_matrix(self, i, name.at(0))); },
          nb::rv_policy::take_ownership, nb::arg("interface"), nb::arg("name"))
      .def(
          "transformation",
          [](const ContactProblem& self, std::size_t i, bool inverse)
          { return give(transformation(self, i, inverse)); },
          nb::rv_policy::take_ownership, nb::arg("interface"),
          nb::arg("inverse"))
      .def(
          "inverse", [](const ContactProblem& self, std::size_t i)
          { return give(inverse(self, i)); }, nb::rv_policy::take_ownership,
          nb::arg("interface"))
      .def(
          "constraints",
          [](const ContactProblem& self, std::size_t i)
          {
            Constraints c = constraints(self, i);
            const std::size_t n = c.slaves.size(), m = c.masters.size();
            return nb::make_tuple(as_array(std::move(c.slaves), {n}),
                                  as_array(std::move(c.masters), {m}),
                                  as_array(std::move(c.coefficients), {m}),
                                  as_array(std::move(c.owners), {m}),
                                  as_array(std::move(c.offsets), {n + 1}));
          },
          nb::arg("interface"), "Fields of Constraints, in their order.")
      .def("num_multiplier_nodes", &num_multiplier_nodes, nb::arg("interface"))
      .def(
          "results",
          [](const ContactProblem& self, std::size_t i)
          {
            nb::dict d;
            for (Field& f : results(self, i))
            {
              const std::size_t rows = f.values.size() / f.columns;
              d[f.name.c_str()]
                  = nb::make_tuple(as_array(std::move(f.nodes), {rows}),
                                   array_of(std::move(f.values), f.columns));
            }
            return d;
          },
          nb::arg("interface"),
          "Nodal values of the fields: local blocks, and a row for each.")
      .def_prop_ro("snes", [](ContactProblem& self)
                   { return nb::steal(PyPetscSNES_New(self.newton().snes())); })
      .def_prop_ro("ksp",
                   [](ContactProblem& self)
                   {
                     return nb::steal(
                         PyPetscKSP_New(self.newton().linear_solver().ksp()));
                   })
      .def_prop_ro("inner_pc",
                   [](ContactProblem& self) -> nb::object
                   {
                     PC pc = self.newton().linear_solver().inner();
                     return pc ? nb::steal(PyPetscPC_New(pc)) : nb::none();
                   })
      .def("unread_options", [](ContactProblem& self)
           { return self.newton().options().unread(); })
      .def("check_type",
           [](ContactProblem& self) { self.newton().check_type(); })
      .def("begin", &ContactProblem::begin,
           "State and step that a solve from here would start with.")
      .def(
          "evaluate",
          [](ContactProblem& self, const State& state, const Step& step,
             In<double> x)
          {
            check_vector(self, x);
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
            return linearise(self.coupling(), step, state, iteration.interfaces,
                             self.bodies().tangent(), damped);
          },
          nb::arg("state"), nb::arg("step"), nb::arg("iteration"),
          nb::arg("damped") = true, "The Newton system there. Collective.");
}
} // namespace

void wrap_problem(nb::module_& m)
{
  import_petsc4py();
  nb::exception<ConvergenceError>(m, "ConvergenceError", PyExc_RuntimeError);
  wrap_options(m);
  wrap_state(m);
  wrap_evaluation(m);
  wrap_contact_problem(m);
  m.def(
      "effective_options",
      [](const std::string& prefix,
         const std::map<std::string, std::string>& options)
      { return SolverOptions(prefix, options).effective(); },
      nb::arg("prefix"), nb::arg("options"),
      "Names and values of the PETSc options that count.");
  m.def(
      "is_overloaded",
      [](ContactProblem& p)
      {
        auto [state, step] = p.begin();
        std::vector<double> x = p.bodies().displacements();
        x.insert(x.end(), state.z.begin(), state.z.end());
        const Iteration it = evaluate(p.bodies(), p.coupling(), step, state, x);
        const Matrix K = p.bodies().tangent();
        const auto balance = find_balance(
            p.coupling(), step, state, it.interfaces, K.get(), it.free_forces);
        return balance and is_overloaded(p.coupling().comm(), *balance);
      },
      nb::arg("problem"),
      "Whether friction cannot balance the present loads. Collective.");
  m.def(
      "describe_barely_covered",
      [](const ContactProblem& p) -> std::string
      {
        if (!p.evaluation())
          return "";
        const auto found = find_barely_covered(p.coupling(), p.step(),
                                               p.state(), *p.evaluation());
        if (!found)
          return "";
        return messages::barely_covered(p.coupling().interfaces[found->second],
                                        found->first);
      },
      nb::arg("problem"),
      "A sentence on the slave node that masters cover least. Collective.");
  m.def(
      "distance_from_cone",
      [](int comm, const Eigen::MatrixXd& vectors, const Eigen::VectorXd& point)
      { return distance_from_cone(MPI_Comm_f2c(comm), vectors, point); },
      nb::arg("comm"), nb::arg("vectors"), nb::arg("point"),
      "Distance of a point from the cone that vectors span. Collective.");
  m.def(
      "relocate",
      [](int comm,
         const std::vector<std::shared_ptr<const FunctionSpace>>& spaces,
         const InterfaceOptions& tie,
         const std::vector<std::shared_ptr<const DirichletBC>>& bcs,
         double limit)
      {
        Relocation r = relocate(MPI_Comm_f2c(comm), spaces, tie, bcs, limit);
        const std::size_t n = r.motion.size() / 3;
        return nb::make_tuple(r.largest, as_array(std::move(r.motion), {n, 3}),
                              array_of(std::move(r.x_slave), 3),
                              array_of(std::move(r.x_master), 3));
      },
      nb::arg("comm"), nb::arg("spaces"), nb::arg("tie"), nb::arg("bcs"),
      nb::arg("limit"),
      "Motion of the slave nodes onto the master. Collective.");
}
