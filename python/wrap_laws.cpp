// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

// Contact laws.

#include "arrays.h"
#include <dolfinx_mortar/contact/laws.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

namespace nb = nanobind;
using namespace dolfinx_mortar;
using namespace dolfinx_mortar_wrappers;

namespace
{
/// Refuse arrays of the wrong size.
/// @param[in] columns Values of each of n nodes.
template <typename T>
void check_nodal(const std::optional<In<T>>& a, std::size_t n, int columns,
                 const char* name)
{
  if (a)
    check_size(*a, n * columns, name);
}
void wrap_residuals(nb::module_& m)
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
      .def_ro("coefficient", &Friction::coefficient, "Coulomb's coefficient.")
      .def_ro("bound", &Friction::bound,
              "Tresca's bound of the tangential traction, or None.");

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
          return view(self, v.data(), {v.size() / 9, 3, 3});
        },
        "Shape (n, 3, 3); a view.");
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
       "State of each node, values of Status; a copy.")
      .def_ro("couplings", &ContactResidual::couplings,
              "Derivatives by the values of other nodes; a view.");
}
} // namespace

void wrap_laws(nb::module_& m)
{
  wrap_residuals(m);
  m.def(
      "contact_residual",
      [](In<double> z, In<double> normal, In<double> gap,
         std::optional<In<double>> weighted_slip,
         std::optional<In<double>> scale, In<double> c_n, In<double> c_t,
         In<std::int8_t> has_multiplier, In<std::int8_t> fixed, double friction,
         std::optional<double> bound, const std::vector<Status>& forced,
         bool damped, std::optional<In<std::int8_t>> near,
         std::optional<In<std::int64_t>> patches)
      {
        const std::size_t num = has_multiplier.size();
        check_size(z, 3 * num, "z");
        check_size(normal, 3 * num, "normal");
        check_size(gap, num, "gap");
        check_nodal(weighted_slip, num, 3, "weighted_slip");
        check_nodal(scale, num, 1, "scale");
        check_size(c_n, num, "c_n");
        check_size(c_t, num, "c_t");
        check_size(fixed, 3 * num, "fixed");
        if (!forced.empty())
          check_size(forced, num, "forced");
        check_nodal(near, num, 1, "near");
        check_nodal(patches, num, 1, "blocks");
        if ((friction > 0 or bound) and !(weighted_slip and scale))
          throw std::invalid_argument(
              "Friction needs weighted_slip and scale.");
        return contact_residual(
            {span(z), span(normal), span(gap),
             weighted_slip ? span(*weighted_slip) : std::span<const double>(),
             scale ? span(*scale) : std::span<const double>(), span(c_n),
             span(c_t), span(has_multiplier), span(fixed),
             near ? span(*near) : std::span<const std::int8_t>(),
             patches ? span(*patches) : std::span<const std::int64_t>()},
            {friction, bound}, forced, damped);
      },
      nb::arg("z"), nb::arg("normal"), nb::arg("gap"),
      nb::arg("weighted_slip").none(), nb::arg("scale").none(), nb::arg("c_n"),
      nb::arg("c_t"), nb::arg("has_multiplier"), nb::arg("fixed"),
      nb::arg("friction"), nb::arg("bound").none(),
      nb::arg("forced") = std::vector<Status>(), nb::arg("damped") = false,
      nb::arg("near").none() = nb::none(),
      nb::arg("blocks").none() = nb::none(),
      "Contact conditions as a semi-smooth equation, for arrays of nodes.");
}
