// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

// Surfaces, normals and search. Users meet these through Python classes; here
// they are as the tests want them.

#include "arrays.h"
#include <cstdint>
#include <dolfinx_mortar/common/mpi_exchange.h>
#include <dolfinx_mortar/dolfinx/adapter.h>
#include <dolfinx_mortar/surface/patches.h>
#include <dolfinx_mortar/surface/search.h>
#include <dolfinx_mortar/surface/spread.h>
#include <dolfinx_mortar/surface/surface.h>
#include <memory>
#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>
#include <optional>
#include <stdexcept>
#include <string>

namespace nb = nanobind;
using namespace dolfinx_mortar;
using namespace dolfinx_mortar_wrappers;

namespace
{
/// Array of one value, or a row of values, per node, that is written to
using InOut = nb::ndarray<nb::numpy, nb::c_contig>;

/// Types of facets
template <typename C>
void types(nb::class_<C>& c)
{
  c.def_prop_ro(
      "types", [](const C& self) { return as_numbers(std::span(self.types)); },
      nb::rv_policy::automatic,
      "Type of each facet, values of FacetType; a copy.");
}

/// Number of values of a node. Whether there is a row for each node is for the
/// library to say, on all ranks.
int block_size(const InOut& a) { return a.ndim() < 2 ? 1 : a.shape(1); }

/// Call a function with the values of an array, if they are of type T.
template <typename T, typename F>
bool apply_as(const InOut& a, F&& f)
{
  if (a.dtype() != nb::dtype<T>())
    return false;
  f(std::span(static_cast<T*>(a.data()), a.size()));
  return true;
}

template <typename F>
void apply(const InOut& a, F&& f)
{
  if (!apply_as<double>(a, f) and !apply_as<std::int8_t>(a, f)
      and !apply_as<std::int32_t>(a, f) and !apply_as<std::int64_t>(a, f))
    throw nb::type_error("Values are float64, int8, int32 or int64.");
}

void wrap_scatter(nb::module_& m)
{
  m.def(
      "scatter_forward",
      [](const Surface& s, const InOut& a)
      {
        const int bs = block_size(a);
        apply(a, [&](auto values) { scatter_forward(s, values, bs); });
      },
      nb::arg("surface"), nb::arg("values").noconvert(),
      "Copy the values of owned nodes to their ghosts. Collective.");
  m.def(
      "scatter_reverse_add",
      [](const Surface& s, const InOut& a)
      {
        const int bs = block_size(a);
        apply(a, [&](auto values) { scatter_reverse_add(s, values, bs); });
      },
      nb::arg("surface"), nb::arg("values").noconvert(),
      "Add the values of ghosts to those of their owners. Collective.");
}

void wrap_surfaces(nb::module_& m)
{
  nb::class_<Surface> s(m, "Surface", "One side of an interface.");
  types(s);
  def_array(s, "offsets", &Surface::offsets,
            "Where the nodes of a facet begin.");
  def_array(s, "nodes", &Surface::nodes, "Local nodes of all facets.");
  def_array(s, "orientation", &Surface::orientation,
            "+1 or -1 for each facet.");
  def_array(s, "parts", &Surface::parts,
            "Where the compact parts of the facets begin; empty for one part.");
  def_array(s, "numbers", &Surface::numbers,
            "Surface number of each local node.");
  def_array(s, "blocks", &Surface::blocks, "Block number of each local node.");
  def_array(s, "local_blocks", &Surface::local_blocks,
            "Local block of the function space of each local node.");
  def_array(s, "X", &Surface::X, "Reference positions, shape (num_nodes, 3).",
            3);
  def_array(s, "owner_ranks", &Surface::owner_ranks, "Ranks that own ghosts.");
  def_array(s, "ghost_ranks", &Surface::ghost_ranks,
            "Ranks that have ghosts of owned nodes.");
  s.def_ro("num_owned", &Surface::num_owned,
           "Number of nodes that this rank owns.")
      .def_ro("first_owned", &Surface::first_owned,
              "Surface number of the first owned node.")
      .def_ro("num_global", &Surface::num_global,
              "Number of nodes on all ranks.")
      .def_prop_ro("num_nodes", &num_local_nodes,
                   "Number of owned and ghost nodes.")
      .def_prop_ro(
          "num_facets", [](const Surface& self) { return self.types.size(); },
          "Number of facets of this rank.");
}

void wrap_surfaces_of_arrays(nb::module_& m)
{
  m.def(
      "create_surface",
      [](int comm, std::vector<FacetType> types, In<std::int32_t> facet_blocks,
         In<std::int8_t> orientation, In<std::int64_t> block_numbers,
         std::int32_t num_owned_blocks, In<std::int32_t> block_owners,
         In<double> X)
      {
        // Whether entries make sense is checked on all ranks together
        return create_surface(
            MPI_Comm_f2c(comm), std::move(types), span(facet_blocks),
            {orientation.data(), orientation.data() + orientation.size()},
            span(block_numbers), num_owned_blocks, span(block_owners), span(X));
      },
      nb::arg("comm"), nb::arg("types"), nb::arg("facet_blocks"),
      nb::arg("orientation"), nb::arg("block_numbers"),
      nb::arg("num_owned_blocks"), nb::arg("block_owners"), nb::arg("X"),
      "Create a surface from arrays; `comm` is `comm.py2f()`. Collective.");
  m.def("spread_facets", &spread_facets, nb::arg("surface"),
        "The same surface, its facets spread evenly over the ranks. "
        "Collective.");
  m.def(
      "received_bytes", []() { return received_bytes(); },
      "What this process has received from others so far by the exchanges of "
      "the library.");
  m.def("split_at_edges", &split_at_edges, nb::arg("surface"),
        nb::arg("feature_angle"),
        "Give each smooth patch that meets at a node a node of its own. "
        "Collective.");
}

void wrap_surfaces_of_spaces(nb::module_& m)
{
  m.def(
      "create_surface",
      [](std::shared_ptr<const dolfinx::fem::FunctionSpace<double>> V,
         In<std::int32_t> facets, In<std::int64_t> block_numbers,
         const std::string& name)
      { return create_surface(*V, span(facets), span(block_numbers), name); },
      nb::arg("V"), nb::arg("facets"), nb::arg("block_numbers"),
      nb::arg("name") = "surface",
      "The surface of a displacement space on some facets. Collective.");
  m.def(
      "create_surface",
      [](std::shared_ptr<const dolfinx::fem::FunctionSpace<double>> V,
         std::shared_ptr<const dolfinx::mesh::MeshTags<std::int32_t>> tags,
         std::int32_t tag, const std::string& side,
         In<std::int64_t> block_numbers)
      { return create_surface(*V, *tags, tag, side, span(block_numbers)); },
      nb::arg("V"), nb::arg("tags"), nb::arg("tag"), nb::arg("side"),
      nb::arg("block_numbers"),
      "The surface of a displacement space on tagged facets. Collective.");
  m.def(
      "create_surface",
      [](const std::vector<
             std::shared_ptr<const dolfinx::fem::FunctionSpace<double>>>& V,
         const std::vector<std::shared_ptr<
             const dolfinx::mesh::MeshTags<std::int32_t>>>& tags,
         const std::vector<std::int32_t>& tag, const std::string& side,
         const std::vector<In<std::int64_t>>& block_numbers,
         const std::vector<std::int32_t>& first_blocks)
      {
        std::vector<SurfacePart> parts;
        if (tags.size() != V.size() or tag.size() != V.size()
            or block_numbers.size() != V.size()
            or first_blocks.size() != V.size())
          throw std::invalid_argument("Each part needs one of everything.");
        for (std::size_t i = 0; i < V.size(); ++i)
        {
          parts.push_back(tagged_part(*V[i], *tags[i], tag[i], side,
                                      span(block_numbers[i]), first_blocks[i]));
        }
        return create_surface(parts);
      },
      nb::arg("V"), nb::arg("tags"), nb::arg("tag"), nb::arg("side"),
      nb::arg("block_numbers"), nb::arg("first_blocks"),
      "A surface of tagged facets of several bodies. Collective.");
  m.def(
      "number_blocks",
      [](const std::vector<std::shared_ptr<const dolfinx::common::IndexMap>>&
             maps)
      {
        std::vector<std::reference_wrapper<const dolfinx::common::IndexMap>> r;
        for (auto& map : maps)
          r.emplace_back(*map);
        std::vector<Array<std::int64_t>> numbers;
        for (std::vector<std::int64_t>& n : number_blocks(r))
          numbers.push_back(as_array(std::move(n)));
        return numbers;
      },
      nb::arg("maps"),
      "Number the blocks of several bodies in one vector. Collective.");
}

void wrap_values(nb::module_& m)
{
  m.def(
      "current_positions",
      [](const Surface& s, In<double> u)
      {
        const std::size_t n = num_local_nodes(s);
        return as_array(current_positions(s, span(u)), {n, 3});
      },
      nb::arg("surface"), nb::arg("u"),
      "Positions X + u, shape (num_nodes, 3). Collective.");
  m.def(
      "check_areas", [](const Surface& s, In<double> x, const std::string& name)
      { check_areas(s, span(x), name); }, nb::arg("surface"), nb::arg("x"),
      nb::arg("name") = "surface",
      "Check that every facet has an area. Collective.");
}

void wrap_normals(nb::module_& m)
{
  nb::class_<Normals> n(m, "Normals", "Averaged nodal normals.");
  def_array(n, "n", &Normals::n, "Unit normals, shape (num_nodes, 3).", 3);
  def_array(n, "length", &Normals::length, "Length of the sums.");
  m.def(
      "compute_normals",
      [](const Surface& s, In<double> x, std::optional<In<std::int8_t>> fixed)
      {
        return compute_normals(
            s, span(x), fixed ? span(*fixed) : std::span<const std::int8_t>());
      },
      nb::arg("surface"), nb::arg("x"), nb::arg("fixed").none() = nb::none(),
      "Averaged nodal normals. Collective.");
  m.def(
      "normal_derivative",
      [](const Surface& s, In<double> x, std::optional<In<std::int8_t>> fixed,
         const Normals& normals, std::int32_t f)
      {
        const std::size_t size = 3 * s.numbers.size();
        check_index(f, s.types.size(), "facet");
        check_size(x, size, "x");
        check_size(normals.n, size, "normals");
        if (fixed)
          check_size(*fixed, size, "fixed");
        const std::size_t n = 3 * facet_nodes(s, f).size();
        std::vector<double> dn(n * n);
        normal_derivative(s, span(x),
                          fixed ? span(*fixed) : std::span<const std::int8_t>(),
                          normals, f, dn);
        return as_array(std::move(dn), {n, n});
      },
      nb::arg("surface"), nb::arg("x"), nb::arg("fixed").none(),
      nb::arg("normals"), nb::arg("facet"),
      "Share of a facet in the derivative of its nodes' normals.");
}

void wrap_search(nb::module_& m)
{
  nb::class_<FacetList> l(m, "FacetList", "Facets with their positions.");
  types(l);
  def_array(l, "orientation", &FacetList::orientation,
            "+1 or -1 for each facet.");
  def_array(l, "offsets", &FacetList::offsets,
            "Where the nodes of a facet begin.");
  def_array(l, "blocks", &FacetList::blocks, "Block number of each node.");
  def_array(l, "x", &FacetList::x, "Positions of the nodes, shape (n, 3).", 3);
  nb::class_<Candidates> c(m, "Candidates", "Pairs of facets that may meet.");
  c.def_ro("master", &Candidates::master,
           "Master facets of the pairs; a view.");
  def_array(c, "offsets", &Candidates::offsets,
            "Where the masters of a slave facet begin.");
  def_array(c, "facets", &Candidates::facets, "Master facets of all pairs.");
  m.def(
      "find_candidates",
      [](const Surface& slave, In<double> x_slave, const Surface& master,
         In<double> x_master, std::optional<double> distance)
      {
        return find_candidates(slave, span(x_slave), master, span(x_master),
                               distance);
      },
      nb::arg("slave"), nb::arg("x_slave"), nb::arg("master"),
      nb::arg("x_master"), nb::arg("distance").none() = nb::none(),
      "Find the master facets near each slave facet. Collective.");
}
} // namespace

void wrap_surface(nb::module_& m)
{
  wrap_surfaces(m);
  wrap_surfaces_of_arrays(m);
  wrap_surfaces_of_spaces(m);
  wrap_scatter(m);
  wrap_values(m);
  wrap_normals(m);
  wrap_search(m);
}
