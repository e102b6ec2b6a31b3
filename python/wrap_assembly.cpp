// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

// Interfaces, their integrals and matrices.

#include "arrays.h"
#include "petsc_objects.h"
#include <dolfinx_mortar/assembly/basis.h>
#include <dolfinx_mortar/assembly/mortar.h>
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

void wrap_interfaces(nb::module_& m)
{
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
      .def_ro("space", &IntegrationOptions::space, "Multiplier space.")
      .def_ro("integration", &IntegrationOptions::integration,
              "How the overlap is integrated.")
      .def_ro("degree", &IntegrationOptions::degree,
              "Degree of quadrature; None for the default.")
      .def_ro("max_angle", &IntegrationOptions::max_angle,
              "Largest angle [degrees] of facets from opposing each other.")
      .def_ro("leave_distant", &IntegrationOptions::leave_distant,
              "Slave facets nowhere nearer to a master than `distance` are "
              "left out.")
      .def_ro("distance", &IntegrationOptions::distance,
              "Search distance [length]; None for the larger diameter.");

  nb::class_<Interface> i(m, "Interface",
                          "A slave and a master surface: a description.");
  i.def(
       "__init__",
       [](Interface* self, const Surface& slave, const Surface& master,
          const IntegrationOptions& options)
       { new (self) Interface(create_interface(slave, master, options)); },
       nb::arg("slave"), nb::arg("master"), nb::arg("options"))
      .def_ro("slave", &Interface::slave, "Slave surface; a view.")
      .def_ro("master", &Interface::master, "Master surface; a view.")
      .def_ro("options", &Interface::options, "Options of the integrals.");
  def_array(i, "multipliers", &Interface::multipliers,
            "Multiplier number of each local slave node.");
  def_array(i, "candidates", &Interface::candidates,
            "Flags of local slave nodes that may carry a multiplier.");
  def_array(i, "fixed", &Interface::fixed,
            "Flags of prescribed components, shape (n, 3).", 3);

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
            return view(self, n.data(), {n.size() / 3, 3});
          },
          "Averaged normals of local slave nodes, shape (n, 3); a view.")
      .def_prop_ro(
          "num_candidates", [](const Configuration& self)
          { return self.candidates.facets.size(); },
          "Number of pairs of facets that may meet, of this rank.");
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
  def_array(n, "jump", &NodalIntegrals::jump,
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
  n.def_ro("area", &NodalIntegrals::area, "Covered area of this rank.")
      .def_ro("dropped_area", &NodalIntegrals::dropped_area,
              "Area of overlaps left out, of this rank.")
      .def_ro("num_covered", &NodalIntegrals::num_covered,
              "Number of facets of this rank that some master covers.")
      .def_ro("num_pairs", &NodalIntegrals::num_pairs,
              "Number of pairs of this rank.")
      .def_ro("num_points", &NodalIntegrals::num_points,
              "Number of quadrature points of this rank.")
      .def_ro("num_without_multipliers",
              &NodalIntegrals::num_without_multipliers,
              "Covered facets none of whose nodes carries a multiplier.")
      .def_ro("without_multipliers", &NodalIntegrals::without_multipliers,
              "Midpoint of the first of them.");
}

void wrap_integration(nb::module_& m)
{
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
      nb::arg("interface"), nb::arg("basis"), nb::arg("configuration"),
      nb::arg("local_rows"), nb::arg("local_columns"), nb::arg("name"),
      "D or M of an interface. Collective.");
  m.def(
      "nodal_weights",
      [](const Interface& interface, In<std::int8_t> nonnegative, In<double> x)
      {
        check_size(x, 3 * num_slaves(interface), "x");
        check_size(nonnegative, num_slaves(interface), "nonnegative");
        return as_array(nodal_weights(interface, span(nonnegative), span(x)));
      },
      nb::arg("interface"), nb::arg("nonnegative"), nb::arg("x"),
      "Integrals of the transformed functions over the whole slave surface. "
      "Collective.");
  m.def(
      "flag_nonnegative",
      [](const Interface& interface, In<double> beyond)
      {
        check_size(beyond, interface.slave.types.size(), "beyond");
        return as_array(flag_nonnegative(interface, span(beyond)));
      },
      nb::arg("interface"), nb::arg("beyond"),
      "Flags of nodes with functions that are nowhere negative. Collective.");
}
} // namespace

void wrap_assembly(nb::module_& m)
{
  import_petsc4py();
  wrap_interfaces(m);
  wrap_integrals(m);
  wrap_integration(m);
}
