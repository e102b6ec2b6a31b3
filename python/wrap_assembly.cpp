// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

// Interfaces, their integrals and matrices, and contact laws.

#include "arrays.h"
#include "petsc_casters.h"
#include <dolfinx_mortar/assembly/basis.h>
#include <dolfinx_mortar/assembly/mortar.h>
#include <dolfinx_mortar/contact/laws.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

namespace nb = nanobind;
using namespace dolfinx_mortar;
using namespace dolfinx_mortar_wrappers;

namespace
{
std::size_t num_slaves(const Interface& interface)
{
  return num_local_nodes(interface.slave);
}

/// Refuse a configuration of other surfaces.
void check(const Interface& interface, const Configuration& c)
{
  if (c.x_slave.size() != 3 * num_slaves(interface)
      or c.normals.n.size() != c.x_slave.size()
      or c.x_master.size() != 3 * interface.master.numbers.size()
      or c.candidates.offsets.size() != interface.slave.types.size() + 1)
    throw std::invalid_argument("The configuration is of another interface.");
}

void check(const Interface& interface, const Basis& basis)
{
  check_size(basis.has_multiplier, num_slaves(interface), "has_multiplier");
  check_size(basis.nonnegative, num_slaves(interface), "nonnegative");
  check_size(basis.idle, num_slaves(interface), "idle");
}

/// Refuse arrays of the wrong size.
/// @param[in] columns Values of each of n nodes.
template <typename T>
void check_nodal(const std::optional<In<T>>& a, std::size_t n, int columns,
                 const char* name)
{
  if (a)
    check_size(*a, n * columns, name);
}

void wrap_interfaces(nb::module_& m)
{
  nb::class_<Interface> i(m, "Interface",
                          "A slave and a master surface: a description.");
  i.def(
       "__init__",
       [](Interface* self, const Surface& slave, const Surface& master,
          const IntegrationOptions& options)
       { new (self) Interface(create_interface(slave, master, options)); },
       nb::arg("slave"), nb::arg("master"), nb::arg("options"))
      .def_ro("slave", &Interface::slave)
      .def_ro("master", &Interface::master)
      .def_ro("options", &Interface::options);
  def_array(i, "multipliers", &Interface::multipliers,
            "Multiplier number of each local slave node.");
  def_array(i, "candidates", &Interface::candidates,
            "Flags of local slave nodes that may carry a multiplier.");
  def_array(i, "fixed", &Interface::fixed,
            "Flags of prescribed components, shape (n, 3).", 3);

  nb::class_<IntegrationOptions>(m, "IntegrationOptions",
                                 "Options of the mortar integrals.")
      .def(
          "__init__",
          [](IntegrationOptions* self, MultiplierSpace space,
             Integration integration, std::optional<int> degree,
             double max_angle, bool leave_distant,
             std::optional<double> distance)
          {
            new (self) IntegrationOptions{space,     integration,   degree,
                                          max_angle, leave_distant, distance};
          },
          nb::arg("space") = MultiplierSpace::dual,
          nb::arg("integration") = Integration::segment,
          nb::arg("degree").none() = nb::none(),
          nb::arg("max_angle") = IntegrationOptions().max_angle,
          nb::arg("leave_distant") = false,
          nb::arg("distance").none() = nb::none())
      .def_ro("space", &IntegrationOptions::space)
      .def_ro("integration", &IntegrationOptions::integration)
      .def_ro("degree", &IntegrationOptions::degree)
      .def_ro("max_angle", &IntegrationOptions::max_angle)
      .def_ro("leave_distant", &IntegrationOptions::leave_distant)
      .def_ro("distance", &IntegrationOptions::distance);

  nb::class_<Basis> b(m, "Basis",
                      "Nodes that carry multipliers, and the basis there.");
  b.def(
      "__init__",
      [](Basis* self, In<std::int8_t> has_multiplier,
         In<std::int8_t> nonnegative, In<std::int8_t> idle)
      {
        new (self) Basis{copy(has_multiplier), copy(nonnegative), copy(idle)};
      },
      nb::arg("has_multiplier"), nb::arg("nonnegative"), nb::arg("idle"));
  def_array(b, "has_multiplier", &Basis::has_multiplier,
            "Flags of local slave nodes that carry a multiplier.");
  def_array(b, "idle", &Basis::idle,
            "Flags of local slave nodes at which nothing acts.");
  def_array(b, "nonnegative", &Basis::nonnegative,
            "Flags of local slave nodes whose functions are nowhere negative.");

  nb::class_<Configuration>(m, "Configuration",
                            "Positions, normals and candidate pairs.")
      .def_prop_ro(
          "normals",
          [](const Configuration& self)
          {
            const std::vector<double>& n = self.normals.n;
            const std::array<std::size_t, 2> shape = {n.size() / 3, 3};
            return nb::ndarray<const double, nb::numpy>(
                n.data(), 2, shape.data(), nb::handle());
          },
          nb::rv_policy::reference_internal,
          "Averaged normals of local slave nodes, shape (n, 3); a view.")
      .def_prop_ro("num_candidates", [](const Configuration& self)
                   { return self.candidates.facets.size(); });
}

void wrap_integrals(nb::module_& m)
{
  nb::class_<NodalIntegrals> n(m, "NodalIntegrals",
                               "What the integrals leave on the slave nodes.");
  def_array(n, "coverage", &NodalIntegrals::coverage,
            "Integral of the transformed functions over the covered part.");
  def_array(n, "diagonal", &NodalIntegrals::diagonal, "Diagonal of D~.");
  def_array(n, "weight", &NodalIntegrals::weight, "Integral of Phi_j.");
  def_array(n, "gap", &NodalIntegrals::gap, "Weighted gaps.");
  def_array(n, "offset", &NodalIntegrals::offset,
            "Weighted relative positions, shape (n, 3).", 3);
  def_array(n, "master_normal", &NodalIntegrals::master_normal,
            "Which way the master faces, times area, shape (n, 3).", 3);
  def_array(n, "near", &NodalIntegrals::near,
            "Flags of nodes around which some point is nearly in contact.");
  def_array(n, "distance", &NodalIntegrals::distance,
            "Mean gap over the covered parts around each node.");
  def_array(n, "facet_area", &NodalIntegrals::facet_area,
            "Covered area of each facet.");
  def_array(n, "beyond", &NodalIntegrals::beyond,
            "Share of each facet beyond the masters' edges.");
  def_array(n, "lost", &NodalIntegrals::lost,
            "Share of each facet that is left out.");
  n.def_ro("area", &NodalIntegrals::area)
      .def_ro("dropped_area", &NodalIntegrals::dropped_area)
      .def_ro("num_covered", &NodalIntegrals::num_covered)
      .def_ro("num_pairs", &NodalIntegrals::num_pairs)
      .def_ro("num_orphans", &NodalIntegrals::num_orphans)
      .def_ro("orphan", &NodalIntegrals::orphan);

  m.def("create_basis", &create_basis, nb::arg("interface"),
        "The basis in which all candidates carry a multiplier.");
  m.def(
      "configure",
      [](const Interface& interface, In<double> x_slave, In<double> x_master)
      {
        check_size(x_slave, 3 * num_slaves(interface), "x_slave");
        check_size(x_master, 3 * interface.master.numbers.size(), "x_master");
        return configure(interface, copy(x_slave), copy(x_master));
      },
      nb::arg("interface"), nb::arg("x_slave"), nb::arg("x_master"),
      "Find what meets in a configuration. Collective.");
  m.def(
      "integrate",
      [](const Interface& interface, const Basis& basis,
         const Configuration& configuration)
      {
        check(interface, configuration);
        check(interface, basis);
        return integrate(interface, basis, configuration);
      },
      nb::arg("interface"), nb::arg("basis"), nb::arg("configuration"),
      "Nodal integrals of an interface. Collective.");
  m.def(
      "mortar_matrix",
      [](const Interface& interface, const Basis& basis,
         const Configuration& configuration, std::int64_t local_rows,
         std::int64_t local_columns, const std::string& name)
      {
        check(interface, configuration);
        check(interface, basis);
        BlockAccumulator<1, 1> blocks;
        MortarBlocks wanted;
        if (name == "D")
          wanted.D = &blocks;
        else if (name == "M")
          wanted.M = &blocks;
        else
          throw std::invalid_argument("The mortar matrices are D and M.");
        integrate(interface, basis, configuration, wanted);
        return give(
            blocks.assemble(interface.slave.comm, local_rows, local_columns));
      },
      nb::rv_policy::take_ownership, nb::arg("interface"), nb::arg("basis"),
      nb::arg("configuration"), nb::arg("local_rows"), nb::arg("local_columns"),
      nb::arg("name"), "D or M of an interface. Collective.");
  m.def(
      "nodal_weights",
      [](const Interface& interface, In<std::int8_t> nonnegative, In<double> x)
      {
        check_size(x, 3 * num_slaves(interface), "x");
        check_size(nonnegative, num_slaves(interface), "nonnegative");
        std::vector<double> w
            = nodal_weights(interface, span(nonnegative), span(x));
        const std::size_t n = w.size();
        return as_array(std::move(w), {n});
      },
      nb::arg("interface"), nb::arg("nonnegative"), nb::arg("x"),
      "Integrals of the transformed functions over the whole slave surface. "
      "Collective.");
  m.def(
      "flag_nonnegative",
      [](const Interface& interface, In<double> beyond)
      {
        check_size(beyond, interface.slave.types.size(), "beyond");
        auto flags = flag_nonnegative(interface, span(beyond));
        const std::size_t n = flags.size();
        return as_array(std::move(flags), {n});
      },
      nb::arg("interface"), nb::arg("beyond"),
      "Flags of nodes with functions that are nowhere negative. Collective.");
}

void wrap_laws(nb::module_& m)
{
  nb::enum_<Status>(m, "Status", nb::is_arithmetic(), "State of a slave node.")
      .value("open", Status::open)
      .value("stick", Status::stick)
      .value("slip", Status::slip);
  nb::class_<Friction>(m, "Friction", "Tangential behaviour.")
      .def(
          "__init__",
          [](Friction* self, double coefficient, std::optional<double> bound)
          { new (self) Friction{coefficient, bound}; },
          nb::arg("coefficient") = 0.0, nb::arg("bound").none() = nb::none())
      .def_ro("coefficient", &Friction::coefficient)
      .def_ro("bound", &Friction::bound);

  nb::class_<ContactCouplings> c(
      m, "ContactCouplings",
      "Derivatives by the values of other nodes at the same place.");
  def_array(c, "rows", &ContactCouplings::rows, "Nodes of the residuals.");
  def_array(c, "columns", &ContactCouplings::columns, "Nodes of the values.");
  auto blocks = [](auto& cls, const char* name, auto member)
  {
    using C = typename std::remove_cvref_t<decltype(cls)>::Type;
    cls.def_prop_ro(
        name,
        [member](const C& self)
        {
          const std::vector<double>& v = self.*member;
          const std::array<std::size_t, 3> shape = {v.size() / 9, 3, 3};
          return nb::ndarray<const double, nb::numpy>(v.data(), 3, shape.data(),
                                                      nb::handle());
        },
        nb::rv_policy::reference_internal, "Shape (n, 3, 3); a view.");
  };
  blocks(c, "dz", &ContactCouplings::dz);
  blocks(c, "dn", &ContactCouplings::dn);
  blocks(c, "dw", &ContactCouplings::dw);
  def_array(c, "dg", &ContactCouplings::dg, "Shape (n, 3); a view.", 3);

  nb::class_<ContactResidual> r(
      m, "ContactResidual", "Complementarity function and its derivatives.");
  def_array(r, "value", &ContactResidual::value, "Residual, shape (n, 3).", 3);
  def_array(r, "bound", &ContactResidual::bound,
            "Bound, or trial traction, of nodes in frictional contact.");
  blocks(r, "dz", &ContactResidual::dz);
  blocks(r, "dn", &ContactResidual::dn);
  blocks(r, "dw", &ContactResidual::dw);
  def_array(r, "dg", &ContactResidual::dg, "Shape (n, 3); a view.", 3);
  r.def_prop_ro(
       "status", [](const ContactResidual& self)
       { return as_numbers(std::span(self.status)); }, nb::rv_policy::automatic,
       "State of each node, as numbers of Status.")
      .def_ro("couplings", &ContactResidual::couplings);

  m.def(
      "contact_residual",
      [](In<double> z, In<double> normal, In<double> gap,
         std::optional<In<double>> motion, std::optional<In<double>> scale,
         In<double> c_n, In<double> c_t, In<std::int8_t> carries,
         In<std::int8_t> fixed, double friction, std::optional<double> bound,
         std::optional<In<std::int8_t>> forced, bool damped,
         std::optional<In<std::int8_t>> near,
         std::optional<In<std::int64_t>> patches)
      {
        const std::size_t num = carries.size();
        check_size(z, 3 * num, "z");
        check_size(normal, 3 * num, "normal");
        check_size(gap, num, "gap");
        check_nodal(motion, num, 3, "motion");
        check_nodal(scale, num, 1, "scale");
        check_size(c_n, num, "c_n");
        check_size(c_t, num, "c_t");
        check_size(fixed, 3 * num, "fixed");
        check_nodal(forced, num, 1, "forced");
        check_nodal(near, num, 1, "near");
        check_nodal(patches, num, 1, "blocks");
        if ((friction > 0 or bound) and !(motion and scale))
          throw std::invalid_argument("Friction needs motion and scale.");
        std::vector<Status> states;
        if (forced)
        {
          for (std::int8_t s : span(*forced))
          {
            check_index(s, 3, "state");
            states.push_back(static_cast<Status>(s));
          }
        }
        return contact_residual(
            {span(z), span(normal), span(gap),
             motion ? span(*motion) : std::span<const double>(),
             scale ? span(*scale) : std::span<const double>(), span(c_n),
             span(c_t), span(carries), span(fixed),
             near ? span(*near) : std::span<const std::int8_t>(),
             patches ? span(*patches) : std::span<const std::int64_t>()},
            {friction, bound}, states, damped);
      },
      nb::arg("z"), nb::arg("normal"), nb::arg("gap"), nb::arg("motion").none(),
      nb::arg("scale").none(), nb::arg("c_n"), nb::arg("c_t"),
      nb::arg("carries"), nb::arg("fixed"), nb::arg("friction"),
      nb::arg("bound").none(), nb::arg("forced").none() = nb::none(),
      nb::arg("damped") = false, nb::arg("near").none() = nb::none(),
      nb::arg("blocks").none() = nb::none(),
      "Contact conditions as a semi-smooth equation, for arrays of nodes.");
}
} // namespace

void wrap_assembly(nb::module_& m)
{
  import_petsc4py();
  wrap_interfaces(m);
  wrap_integrals(m);
  wrap_laws(m);
}
