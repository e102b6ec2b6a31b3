// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

// What is said of interfaces, and the dofs that a problem has.

#include "arrays.h"
#include <dolfinx_mortar/solver/problem.h>
#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
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

std::array<double, 3> array_of(const Vec3& v) { return {v[0], v[1], v[2]}; }

using Triple = std::array<double, 3>;

void wrap_tool(nb::module_& m)
{
  m.def("rotation_matrix", &rotation_matrix, nb::arg("vector"),
        "Rotation matrix, shape (3, 3), of a rotation vector [rad].");
  nb::class_<RigidTool> t(m, "RigidTool", "A rigid tool, and its motion.");
  t.def(
       "__init__", [](RigidTool* self, const Triple& reference_point)
       { new (self) RigidTool(Vec3(reference_point.data())); },
       nb::arg("reference_point"), "A tool whose surface has facets.")
      .def_static(
          "plane",
          [](const Triple& point, const Triple& normal)
          {
            return std::make_shared<RigidTool>(
                RigidShape{RigidShape::Kind::plane, false}, Vec3(point.data()),
                Vec3(normal.data()), 0.0);
          },
          nb::arg("point"), nb::arg("normal"), "A half-space.")
      .def_static(
          "sphere",
          [](const Triple& centre, double radius, bool hollow)
          {
            return std::make_shared<RigidTool>(
                RigidShape{RigidShape::Kind::sphere, hollow},
                Vec3(centre.data()), Vec3::Zero(), radius);
          },
          nb::arg("centre"), nb::arg("radius"), nb::arg("hollow"),
          "A ball, or a socket.")
      .def_static(
          "cylinder",
          [](const Triple& point, const Triple& axis, double radius,
             bool hollow)
          {
            return std::make_shared<RigidTool>(
                RigidShape{RigidShape::Kind::cylinder, hollow},
                Vec3(point.data()), Vec3(axis.data()), radius);
          },
          nb::arg("point"), nb::arg("axis"), nb::arg("radius"),
          nb::arg("hollow"), "A roller, or a bore.")
      .def("frame", &RigidTool::frame, nb::arg("size"),
           "Reference positions of the nodes of the frame, 12 numbers.");
  auto def_vector
      = [&](const char* name, Vec3 RigidTool::* member, const char* doc)
  {
    t.def_prop_rw(
        name,
        [member](const RigidTool& self) { return array_of(self.*member); },
        [member](RigidTool& self, const Triple& v)
        { self.*member = Vec3(v.data()); }, nb::rv_policy::automatic, doc);
  };
  def_vector("reference_point", &RigidTool::reference_point,
             "Point that rotations and moments are about.");
  def_vector("translation", &RigidTool::translation, "Translation [length].");
  def_vector("rotation", &RigidTool::rotation, "Rotation vector [rad].");
  def_vector("force", &RigidTool::force, "Force where it is free.");
  def_vector("moment", &RigidTool::moment, "Moment where it is free.");
  t.def_rw("free", &RigidTool::free,
           "Non-zero for free components, of translation and rotation.");
}

void wrap_options(nb::module_& m)
{
  nb::enum_<InitialActive::Choice>(m, "InitialActive",
                                   "Nodes in contact at first.")
      .value("gap", InitialActive::Choice::gap,
             "Those that penetrate or touch, and those that hold a loose body")
      .value("none", InitialActive::Choice::none)
      .value("all", InitialActive::Choice::all)
      .value("given", InitialActive::Choice::given,
             "Those that a function chooses");
  nb::class_<InterfaceOptions>(m, "InterfaceOptions",
                               "What a user says of a tie or a contact.")
      .def(
          "__init__",
          [](InterfaceOptions* self, const std::vector<Part>& slave,
             const std::vector<Part>& master,
             std::optional<MultiplierSpace> space,
             const IntegrationOptions& options, double min_coverage,
             std::shared_ptr<RigidTool> tool)
          {
            new (self) InterfaceOptions();
            self->slave = tagged_facets(slave);
            self->master = tagged_facets(master);
            self->space = space;
            self->integration = options;
            self->min_coverage = min_coverage;
            self->tool = tool;
          },
          nb::arg("slave"), nb::arg("master"), nb::arg("space").none(),
          nb::arg("options"), nb::arg("min_coverage"),
          nb::arg("tool").none() = nb::none(), "A tie.")
      .def(
          "make_contact",
          [](InterfaceOptions& self, std::optional<double> c_n,
             std::optional<double> c_t, bool reference_geometry,
             const Friction& friction, double feature_angle,
             std::optional<std::array<double, 3>> normal,
             InitialActive::Choice choice, std::optional<nb::callable> flags)
          {
            self.contact = ContactOptions{c_n, c_t, reference_geometry};
            self.friction = friction;
            self.feature_angle = feature_angle;
            self.normal = normal;
            self.initial_active.choice = choice;
            if (!flags)
              return;
            self.initial_active.flags
                = [flags = *flags](std::span<const double> x)
            {
              std::vector<double> positions(x.begin(), x.end());
              nb::object chosen = flags(as_rows(std::move(positions), 3));
              return copy(nb::cast<In<std::int8_t>>(chosen));
            };
          },
          nb::arg("c_n").none(), nb::arg("c_t").none(),
          nb::arg("reference_geometry"), nb::arg("friction"),
          nb::arg("feature_angle"), nb::arg("normal").none(),
          nb::arg("initial_active"), nb::arg("flags").none(),
          "Make it a contact; `flags` of positions, shape (n, 3), chooses the "
          "nodes where `initial_active` is `given`.")
      .def(
          "set_positions",
          [](InterfaceOptions& self, In<double> slave, In<double> master)
          {
            self.x_slave = copy(slave);
            self.x_master = copy(master);
          },
          nb::arg("slave"), nb::arg("master"),
          "Integrate a tie at these positions of the local nodes, shapes "
          "(n, 3), instead of those of the mesh.")
      .def_rw("balance", &InterfaceOptions::balance, nb::arg().none(),
              "Spread the integration over all ranks; None where it pays.")
      .def_ro("space", &InterfaceOptions::space,
              "Space of the multipliers; None for the default.")
      .def_ro("integration", &InterfaceOptions::integration,
              "Integration and what the search reaches.")
      .def_ro("min_coverage", &InterfaceOptions::min_coverage,
              "Share of its surroundings that must be covered for a slave node "
              "to carry a multiplier.")
      .def_ro("friction", &InterfaceOptions::friction,
              "Tangential behaviour of a contact, at first.")
      .def_ro("feature_angle", &InterfaceOptions::feature_angle,
              "Angle [degrees] between slave facets from which on they meet at "
              "an edge.")
      .def_ro("normal", &InterfaceOptions::normal,
              "Unit normal to be used at all slave nodes, or None.");
}
} // namespace

void wrap_coupling(nb::module_& m)
{
  wrap_tool(m);
  wrap_options(m);

  nb::class_<CoupledInterface>(m, "CoupledInterface",
                               "An interface of a problem.")
      .def_ro("data", &CoupledInterface::data,
              "Surfaces, options, candidates for multipliers; a view.")
      .def_ro("first_node", &CoupledInterface::first_node,
              "Its first multiplier node among those of this rank.")
      .def_prop_ro("num_owned", &CoupledInterface::num_owned,
                   "Number of slave nodes that this rank owns.");

  nb::class_<Layout> l(m, "Layout", "Displacement dofs of several bodies.");
  l.def_prop_ro("size", &Layout::size, "Number of dofs of this rank.")
      .def_ro("first_block", &Layout::first_block, "First block of this rank.")
      .def_ro("num_owned", &Layout::num_owned,
              "Number of owned blocks of each body.")
      .def_ro("num_local", &Layout::num_local,
              "Number of owned and ghost blocks of each body.")
      .def_ro("num_parts", &Layout::num_parts,
              "Number of connected parts of the meshes, on all ranks.")
      .def("local_start", &Layout::local_start, nb::arg("body"),
           "First of the local blocks of a body, among those of all bodies.")
      .def("owned_start", &Layout::owned_start, nb::arg("body"),
           "First of the owned blocks of a body, among those of all bodies.");
  def_array(l, "X", &Layout::X,
            "Reference positions of the local blocks, shape (n, 3); a view.",
            3);
  def_array(l, "parts", &Layout::parts,
            "Connected part of the meshes that each local block is on; a "
            "view.");

  nb::class_<Coupling> c(m, "Coupling", "All interfaces of a problem.");
  c.def_ro("layout", &Coupling::layout, "Displacement dofs; a view.")
      .def_ro("interfaces", &Coupling::interfaces,
              "The interfaces; a list of views.")
      .def_prop_ro("size", &Coupling::size,
                   "Number of multiplier dofs of this rank.")
      .def_prop_ro("has_contact", &Coupling::has_contact,
                   "Not all interfaces are ties.");
  def_array(c, "fixed_dofs", &Coupling::fixed_dofs,
            "Owned displacement dofs with a Dirichlet condition; a view.");
}
