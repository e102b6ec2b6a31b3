// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

// Interfaces and their PETSc matrices.

#include "arrays.h"
#if __has_include(<dolfinx_wrappers/caster_petsc.h>)
#include <dolfinx_wrappers/caster_petsc.h>
#else
#include <caster_petsc.h>
#endif
#include <dolfinx_mortar/coupling.h>
#include <dolfinx_mortar/laws.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

namespace nb = nanobind;
using namespace dolfinx_mortar;
using namespace dolfinx_mortar_wrappers;

namespace
{
template <typename T>
std::vector<T> copy(const In<T>& a)
{
  return {a.data(), a.data() + a.size()};
}

Mat null_or(std::optional<Mat> A) { return A ? *A : nullptr; }

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

/// Refuse arrays of the wrong size.
/// @param[in] columns Values of each of n nodes.
template <typename T>
void check_nodal(const std::optional<In<T>>& a, std::size_t n, int columns,
                 const char* name)
{
  if (a)
    check_size(*a, n * columns, name);
}
} // namespace

void wrap_coupling(nb::module_& m)
{
  import_petsc4py();

  nb::class_<Interface>(m, "Interface", "A slave and a master surface")
      .def(
          "__init__",
          [](Interface* self, const Surface& slave, const Surface& master,
             MultiplierSpace space, Integration integration,
             std::optional<int> degree, std::optional<double> search_distance,
             In<std::int64_t> multipliers, In<std::int8_t> carries,
             In<std::int8_t> fixed, bool leave_distant, double max_angle)
          {
            const std::size_t n = num_local_nodes(slave);
            check_size(multipliers, n, "multipliers");
            check_size(carries, n, "carries");
            check_size(fixed, 3 * n, "fixed");
            new (self) Interface{slave,
                                 master,
                                 {space, integration, degree, max_angle,
                                  leave_distant, search_distance},
                                 copy(multipliers),
                                 copy(carries),
                                 std::vector<std::int8_t>(carries.size(), 0),
                                 std::vector<std::int8_t>(carries.size(), 0),
                                 copy(fixed)};
          },
          nb::arg("slave"), nb::arg("master"), nb::arg("space"),
          nb::arg("integration"), nb::arg("degree").none(),
          nb::arg("search_distance").none(), nb::arg("multipliers"),
          nb::arg("carries"), nb::arg("fixed"),
          nb::arg("leave_distant") = false,
          nb::arg("max_angle") = IntegrationOptions().max_angle)
      .def_prop_rw(
          "carries",
          [](const Interface& self)
          {
            return as_array(std::vector<std::int8_t>(self.carries),
                            {self.carries.size()});
          },
          [](Interface& self, In<std::int8_t> v)
          {
            check_size(v, num_slaves(self), "carries");
            self.carries = copy(v);
          },
          nb::rv_policy::automatic,
          "Flags of local slave nodes that carry a multiplier")
      .def_prop_rw(
          "idle",
          [](const Interface& self)
          {
            return as_array(std::vector<std::int8_t>(self.idle),
                            {self.idle.size()});
          },
          [](Interface& self, In<std::int8_t> v)
          {
            check_size(v, num_slaves(self), "idle");
            self.idle = copy(v);
          },
          nb::rv_policy::automatic,
          "Flags of local slave nodes that nothing acts at where they carry no "
          "multiplier")
      .def_prop_rw(
          "positive",
          [](const Interface& self)
          {
            return as_array(std::vector<std::int8_t>(self.positive),
                            {self.positive.size()});
          },
          [](Interface& self, In<std::int8_t> v)
          {
            check_size(v, num_slaves(self), "positive");
            self.positive = copy(v);
          },
          nb::rv_policy::automatic,
          "Flags of local slave nodes with positive functions")
      .def_ro("slave", &Interface::slave)
      .def_ro("master", &Interface::master);

  nb::class_<Configuration>(m, "Configuration",
                            "Positions, normals and candidate pairs")
      .def_prop_rw(
          "normals",
          [](const Configuration& self)
          {
            return as_array(std::vector<double>(self.normals.n),
                            {self.normals.n.size() / 3, 3});
          },
          [](Configuration& self, In<double> n)
          {
            check_size(n, self.normals.n.size(), "normals");
            self.normals.n = copy(n);
          },
          nb::rv_policy::automatic, "Averaged normals, shape (n, 3)")
      .def_prop_ro("num_candidates", [](const Configuration& self)
                   { return self.candidates.facets.size(); });

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
      [](const Interface& interface, const Configuration& configuration,
         std::optional<Mat> D, std::optional<Mat> M, std::optional<Mat> B,
         std::optional<Mat> B_tilde)
      {
        check(interface, configuration);
        NodalIntegrals r
            = integrate(interface, configuration,
                        {null_or(D), null_or(M), null_or(B), null_or(B_tilde)});
        const std::size_t n = r.gap.size();
        nb::dict d;
        d["coverage"] = as_array(std::move(r.coverage), {n});
        d["diagonal"] = as_array(std::move(r.diagonal), {n});
        d["weight"] = as_array(std::move(r.weight), {n});
        d["near"] = as_array(std::move(r.near), {n});
        d["distance"] = as_array(std::move(r.distance), {n});
        d["gap"] = as_array(std::move(r.gap), {n});
        d["master_normal"] = as_array(std::move(r.master_normal), {n, 3});
        d["offset"] = as_array(std::move(r.offset), {n, 3});
        d["area"] = r.area;
        d["dropped_area"] = r.dropped_area;
        d["num_covered"] = r.num_covered;
        d["num_pairs"] = r.num_pairs;
        const std::size_t facets = r.facet_area.size();
        d["facet_area"] = as_array(std::move(r.facet_area), {facets});
        d["lost"] = as_array(std::move(r.lost), {facets});
        d["beyond"] = as_array(std::move(r.beyond), {facets});
        d["num_orphans"] = r.num_orphans;
        d["orphan"] = r.orphan;
        return d;
      },
      nb::arg("interface"), nb::arg("configuration"),
      nb::arg("D").none() = nb::none(), nb::arg("M").none() = nb::none(),
      nb::arg("B").none() = nb::none(), nb::arg("B_tilde").none() = nb::none(),
      "Add the mortar matrices and integrate nodal values. Collective.");

  m.def(
      "integrate_derivatives",
      [](const Interface& interface, const Configuration& configuration,
         In<double> z, In<std::int8_t> active, std::optional<Mat> force,
         std::optional<Mat> gap, std::optional<Mat> gap_normal,
         std::optional<Mat> offset)
      {
        check(interface, configuration);
        check_size(z, 3 * num_slaves(interface), "z");
        check_size(active, num_slaves(interface), "active");
        integrate_derivatives(interface, configuration, span(z), span(active),
                              {null_or(force), null_or(gap),
                               null_or(gap_normal), null_or(offset)});
      },
      nb::arg("interface"), nb::arg("configuration"), nb::arg("z"),
      nb::arg("active"), nb::arg("force").none() = nb::none(),
      nb::arg("gap").none() = nb::none(),
      nb::arg("gap_normal").none() = nb::none(),
      nb::arg("offset").none() = nb::none(),
      "Add derivatives of contact force, gap and offset. Collective.");

  m.def(
      "differentiate_normals",
      [](const Interface& interface, const Configuration& configuration, Mat A)
      {
        check(interface, configuration);
        differentiate_normals(interface, configuration, A);
      },
      nb::arg("interface"), nb::arg("configuration"), nb::arg("A"),
      "Add the derivative of the averaged normals. Collective.");

  m.def(
      "nodal_weights",
      [](const Interface& interface, In<double> x)
      {
        check_size(x, 3 * num_slaves(interface), "x");
        std::vector<double> w = nodal_weights(interface, span(x));
        const std::size_t n = w.size();
        return as_array(std::move(w), {n});
      },
      nb::arg("interface"), nb::arg("x"),
      "Integrals of the transformed functions over the whole slave surface.");

  m.def(
      "flag_positive",
      [](const Interface& interface, In<double> beyond)
      {
        check_size(beyond, interface.slave.types.size(), "beyond");
        auto flags = flag_positive(interface, span(beyond));
        const std::size_t n = flags.size();
        return as_array(std::move(flags), {n});
      },
      nb::arg("interface"), nb::arg("beyond"),
      "Flags of nodes with positive functions. Collective.");

  m.def(
      "insert_transformation",
      [](const Interface& interface, bool inverse, Mat T)
      { insert_transformation(interface, inverse, T); }, nb::arg("interface"),
      nb::arg("inverse"), nb::arg("T"), "Insert T or its inverse. Collective.");

  m.def(
      "combine_rows",
      [](Mat K, Mat Delta, In<std::int8_t> sources)
      {
        std::vector<RowSource> rows;
        for (std::int8_t s : span(sources))
        {
          check_index(s, 3, "source");
          rows.push_back(static_cast<RowSource>(s));
        }
        return combine_rows(K, Delta, rows);
      },
      nb::rv_policy::take_ownership, nb::arg("K"), nb::arg("Delta"),
      nb::arg("sources"),
      "K + Delta (0), Delta (1) or a unit row (2) for each local row.");

  m.def(
      "create_matrix",
      [](const Surface& surface, std::int64_t rows, std::int64_t columns)
      { return create_matrix(surface.comm, rows, columns); },
      nb::rv_policy::take_ownership, nb::arg("surface"), nb::arg("local_rows"),
      nb::arg("local_columns"),
      "Empty AIJ matrix on the communicator of a surface.");

  m.def(
      "contact_residual",
      [](In<double> z, In<double> normal, In<double> gap,
         std::optional<In<double>> motion, std::optional<In<double>> scale,
         In<double> c_n, In<double> c_t, In<std::int8_t> carries,
         In<std::int8_t> fixed, double friction, std::optional<double> bound,
         std::optional<In<std::int8_t>> forced, bool damped,
         std::optional<In<std::int8_t>> near,
         std::optional<In<std::int64_t>> blocks)
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
        check_nodal(blocks, num, 1, "blocks");
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
        ContactResidual r = contact_residual(
            {span(z), span(normal), span(gap),
             motion ? span(*motion) : std::span<const double>(),
             scale ? span(*scale) : std::span<const double>(), span(c_n),
             span(c_t), span(carries), span(fixed),
             near ? span(*near) : std::span<const std::int8_t>(),
             blocks ? span(*blocks) : std::span<const std::int64_t>()},
            {friction, bound}, states, damped);
        const std::size_t n = r.status.size();
        std::vector<std::int8_t> status;
        for (Status s : r.status)
          status.push_back(static_cast<std::int8_t>(s));
        nb::dict d;
        d["status"] = as_array(std::move(status), {n});
        d["value"] = as_array(std::move(r.value), {n, 3});
        d["bound"] = as_array(std::move(r.bound), {n});
        d["dz"] = as_array(std::move(r.dz), {n, 3, 3});
        d["dn"] = as_array(std::move(r.dn), {n, 3, 3});
        d["dw"] = as_array(std::move(r.dw), {n, 3, 3});
        d["dg"] = as_array(std::move(r.dg), {n, 3});
        ContactCouplings& c = r.couplings;
        const std::size_t m = c.rows.size();
        nb::dict e;
        e["rows"] = as_array(std::move(c.rows), {m});
        e["columns"] = as_array(std::move(c.columns), {m});
        e["dz"] = as_array(std::move(c.dz), {m, 3, 3});
        e["dn"] = as_array(std::move(c.dn), {m, 3, 3});
        e["dw"] = as_array(std::move(c.dw), {m, 3, 3});
        e["dg"] = as_array(std::move(c.dg), {m, 3});
        d["couplings"] = e;
        return d;
      },
      nb::arg("z"), nb::arg("normal"), nb::arg("gap"), nb::arg("motion").none(),
      nb::arg("scale").none(), nb::arg("c_n"), nb::arg("c_t"),
      nb::arg("carries"), nb::arg("fixed"), nb::arg("friction"),
      nb::arg("bound").none(), nb::arg("forced").none() = nb::none(),
      nb::arg("damped") = false, nb::arg("near").none() = nb::none(),
      nb::arg("blocks").none() = nb::none(),
      "Contact conditions as a semi-smooth equation, for arrays of nodes.");

  m.def(
      "add_blocks",
      [](Mat A, In<std::int64_t> rows, In<std::int64_t> columns,
         In<double> blocks)
      {
        if (blocks.ndim() != 3 or rows.size() != blocks.shape(0)
            or columns.size() != blocks.shape(0))
        {
          throw std::invalid_argument("Each block needs a row and a column.");
        }
        add_blocks(A, span(rows), span(columns), blocks.shape(1),
                   blocks.shape(2), span(blocks));
      },
      nb::arg("A"), nb::arg("rows"), nb::arg("columns"), nb::arg("blocks"),
      "Add blocks of shape (n, rows, columns) at their first rows and "
      "columns.");
}
