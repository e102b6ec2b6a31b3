// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

// The layers that know nothing of meshes: facets, multiplier functions, pairs
// of facets, integrals of one slave facet.

#include "arrays.h"
#include <dolfinx_mortar/geometry/clip.h>
#include <dolfinx_mortar/geometry/facet.h>
#include <dolfinx_mortar/geometry/pair.h>
#include <dolfinx_mortar/multiplier/integrals.h>
#include <dolfinx_mortar/multiplier/multiplier.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

namespace nb = nanobind;
using namespace dolfinx_mortar;
using namespace dolfinx_mortar_wrappers;

namespace
{
template <typename Derived>
auto matrix(const Eigen::MatrixBase<Derived>& A)
{
  const RowMatrix B = A;
  return as_array(
      std::vector<double>(B.data(), B.data() + B.size()),
      {static_cast<std::size_t>(B.rows()), static_cast<std::size_t>(B.cols())});
}

void check_orientation(int orientation)
{
  if (orientation != 1 and orientation != -1)
    throw std::invalid_argument("The orientation of a facet is 1 or -1.");
}

FacetView facet_view(FacetType type, int orientation, In<double> x)
{
  check_size(x, 3 * num_nodes(type), "positions");
  check_orientation(orientation);
  return {type, orientation, span(x)};
}

/// Flags of the nodes of a facet, or none.
std::span<const std::int8_t>
flags_or_none(const std::optional<In<std::int8_t>>& flags, FacetType type)
{
  if (!flags)
    return {};
  check_size(*flags, num_nodes(type), "nonnegative");
  return span(*flags);
}

void check_polygon(std::size_t size)
{
  if (size != 3 and size != 4)
    throw std::invalid_argument("A polygon has three or four corners.");
}

/// Read-only view of a vector, or of a matrix
template <typename Matrix>
void def_matrix(nb::class_<FacetIntegrals>& c, const char* name,
                Matrix FacetIntegrals::* member, const char* doc)
{
  auto get = [member](const FacetIntegrals& self)
  {
    const Matrix& A = self.*member;
    const std::size_t rows = A.rows(), columns = A.cols();
    if constexpr (Matrix::IsVectorAtCompileTime)
      return view(self, A.data(), {rows});
    else
      return view(self, A.data(), {rows, columns});
  };
  c.def_prop_ro(name, get, doc);
}

void wrap_results(nb::module_& m)
{
  nb::class_<PairPoints> p(m, "PairPoints",
                           "Quadrature points of a pair of facets; views.");
  def_array(p, "xi", &PairPoints::xi,
            "Points on the slave facet, shape (num_points, 2).", 2);
  def_array(p, "eta", &PairPoints::eta,
            "Points on the master facet, shape (num_points, 2).", 2);
  def_array(p, "w", &PairPoints::w,
            "Weights times surface measure of the slave facet.");
  p.def(
       "differentiate",
       [](const PairPoints& self, In<double> C, int num_slave, int num_master)
       {
         const std::size_t rows = 5 * self.w.size();
         const std::size_t num = rows > 0 ? C.size() / rows : 0;
         const std::size_t width = 3 * (num_slave + num_master);
         check_size(C, rows * num, "derivatives of sums");
         // The library wants a multiple of four sums
         const std::size_t padded = (num + 3) / 4 * 4;
         std::vector<double> given(rows * padded, 0.0), d(width * padded, 0.0);
         for (std::size_t i = 0; i < rows; ++i)
           std::copy_n(C.data() + num * i, num, given.begin() + padded * i);
         self.differentiate(given, padded, num_slave, num_master, d);
         for (std::size_t i = 0; i < width; ++i)
           std::copy_n(d.begin() + padded * i, num, d.begin() + num * i);
         d.resize(width * num);
         return as_array(std::move(d), {width, num});
       },
       nb::arg("C"), nb::arg("num_slave"), nb::arg("num_master"),
       "Derivatives of sums over the points by the positions of the nodes of "
       "the slave, then of the master, shape (3 (num_slave + num_master), "
       "num_sums), from those by (xi, eta, w), shape (num_points, 5, "
       "num_sums).")
      .def_ro("dropped_area", &PairPoints::dropped_area,
              "Area of parts of the overlap that are left out.");

  nb::class_<FacetIntegrals> f(
      m, "FacetIntegrals",
      "Mortar integrals of a slave facet with n nodes and its masters with m; "
      "arrays are views. Where it is not covered nothing else is set.");
  f.def_ro("covered", &FacetIntegrals::covered,
           "A master covers a part of the facet.")
      .def_ro("master_blocks", &FacetIntegrals::master_blocks,
              "Displacement blocks of the master nodes.")
      .def_ro("area", &FacetIntegrals::area, "Covered area.")
      .def_ro("dropped_area", &FacetIntegrals::dropped_area,
              "Area of overlaps left out.")
      .def_ro("lost", &FacetIntegrals::lost,
              "Share of the facet's area that is left out and that no other "
              "master covers.");
  def_matrix(f, "coverage", &FacetIntegrals::coverage,
             "Integrals of the transformed functions, shape (n).");
  def_matrix(f, "diagonal", &FacetIntegrals::diagonal,
             "Diagonal of D~ of dual spaces, shape (n).");
  def_matrix(f, "D_tilde", &FacetIntegrals::D_tilde,
             "D in the transformed basis, shape (n, n).");
  def_matrix(f, "D", &FacetIntegrals::D, "Shape (n, n).");
  def_matrix(f, "M", &FacetIntegrals::M, "Shape (n, m).");
  def_matrix(f, "gap", &FacetIntegrals::gap, "Weighted gaps, shape (n).");
  def_matrix(f, "jump", &FacetIntegrals::jump,
             "Weighted relative positions, shape (n, 3).");
  def_matrix(f, "d_force", &FacetIntegrals::d_force,
             "Derivative of the contact force with fixed multipliers, shape "
             "(3 (n + m), 3 (n + m)).");
  def_matrix(f, "d_gap", &FacetIntegrals::d_gap,
             "Derivative of the weighted gap with fixed normals, shape (n, 3 "
             "(n + m)).");
  def_matrix(f, "d_gap_normal", &FacetIntegrals::d_gap_normal,
             "Derivative of the weighted gap by the normals, shape (n, 3 n).");
  def_matrix(f, "d_jump", &FacetIntegrals::d_jump,
             "Derivative of the jump, shape (3 n, 3 (n + m)).");
}

void wrap_enums(nb::module_& m)
{
  nb::enum_<FacetType>(m, "FacetType", nb::is_arithmetic(), "Types of facets")
      .value("tri3", FacetType::tri3)
      .value("tri6", FacetType::tri6)
      .value("quad4", FacetType::quad4)
      .value("quad8", FacetType::quad8)
      .value("quad9", FacetType::quad9);
  nb::enum_<MultiplierSpace>(m, "MultiplierSpace", "Spaces of multipliers")
      .value("standard", MultiplierSpace::standard)
      .value("dual", MultiplierSpace::dual)
      .value("dual_linear", MultiplierSpace::dual_linear)
      .value("dual_reproducing", MultiplierSpace::dual_reproducing);
  nb::enum_<Integration>(m, "Integration", "How the overlap is integrated")
      .value("segment", Integration::segment)
      .value("element", Integration::element);
  nb::enum_<Derivatives>(m, "Derivatives", "Derivatives to compute")
      .value("none", Derivatives::none)
      .value("gap", Derivatives::gap)
      .value("gap_and_slip", Derivatives::gap_and_slip);
}

void wrap_shapes(nb::module_& m)
{
  m.def("num_nodes", &num_nodes, nb::arg("type"), "Number of nodes.");
  m.def("num_corners", &num_corners, nb::arg("type"), "Number of corners.");
  m.def(
      "node_coordinates",
      [](FacetType type)
      {
        auto x = node_coordinates(type);
        return as_array(std::vector<double>(x.begin(), x.end()),
                        {x.size() / 2, 2});
      },
      nb::arg("type"), "Reference coordinates of the nodes, shape (n, 2).");
  m.def(
      "sub_facets",
      [](FacetType type)
      {
        std::vector<std::vector<int>> nodes;
        for (const SubFacet& s : sub_facets(type))
          nodes.emplace_back(s.nodes.begin(), s.nodes.begin() + s.size);
        return nodes;
      },
      nb::arg("type"), "Nodes of the linear sub-facets.");
  m.def(
      "tabulate",
      [](FacetType type, std::array<double, 2> xi)
      {
        Shapes s;
        tabulate(type, xi, 2, s);
        const std::size_t n = num_nodes(type);
        std::vector<double> v;
        v.insert(v.end(), s.N.begin(), s.N.begin() + n);
        for (auto& d : s.dN)
          v.insert(v.end(), d.begin(), d.begin() + n);
        for (auto& d : s.ddN)
          v.insert(v.end(), d.begin(), d.begin() + n);
        return as_array(std::move(v), {6, n});
      },
      nb::arg("type"), nb::arg("xi"),
      "Shape functions: N, N,1, N,2, N,11, N,12, N,22; shape (6, n).");
  m.def(
      "transformation",
      [](MultiplierSpace s, FacetType t,
         std::optional<In<std::int8_t>> nonnegative)
      { return matrix(transformation(s, t, flags_or_none(nonnegative, t))); },
      nb::arg("space"), nb::arg("type"),
      nb::arg("nonnegative").none() = nb::none(),
      "Basis transformation T of a facet.");
  m.def(
      "inverse_transformation",
      [](MultiplierSpace s, FacetType t,
         std::optional<In<std::int8_t>> nonnegative)
      {
        return matrix(
            inverse_transformation(s, t, flags_or_none(nonnegative, t)));
      },
      nb::arg("space"), nb::arg("type"),
      nb::arg("nonnegative").none() = nb::none(),
      "Inverse of the basis transformation of a facet.");
  m.def("num_multipliers", &num_multipliers, nb::arg("space"), nb::arg("type"),
        "Number of multipliers of a facet.");
  m.def("default_degree", &default_degree, nb::arg("slave"), nb::arg("master"),
        "Degree of quadrature by default.");
}

void wrap_pairs(nb::module_& m)
{
  m.def(
      "clip",
      [](const std::vector<std::array<double, 2>>& slave,
         const std::vector<std::array<double, 2>>& master, double tol)
      {
        check_polygon(slave.size());
        check_polygon(master.size());
        ClipPolygon p = clip(slave, master, tol);
        std::vector<double> x;
        for (int i = 0; i < p.size; ++i)
          x.insert(x.end(), p.vertices[i].p.begin(), p.vertices[i].p.end());
        return as_array(std::move(x), {static_cast<std::size_t>(p.size), 2});
      },
      nb::arg("slave"), nb::arg("master"), nb::arg("tol"),
      "Intersection of two polygons, shape (n, 2).");

  m.def(
      "pair_points",
      [](FacetType slave_type, int slave_orientation, In<double> slave,
         FacetType master_type, int master_orientation, In<double> master,
         Integration integration, int degree, bool derivatives,
         double max_angle)
      {
        const AngleLimits limits(max_angle);
        const FacetView s = facet_view(slave_type, slave_orientation, slave);
        const FacetView t = facet_view(master_type, master_orientation, master);
        std::array<PairPoints, 1> p;
        if (integration == Integration::segment)
          append_segment_points(s, t, create_rule(3, degree), limits,
                                derivatives, p[0]);
        else
        {
          std::array<FacetView, 1> masters = {t};
          append_element_points(s, masters,
                                create_rule(num_corners(slave_type), degree),
                                limits, derivatives, p);
        }
        return std::move(p[0]);
      },
      nb::arg("slave_type"), nb::arg("slave_orientation"), nb::arg("slave"),
      nb::arg("master_type"), nb::arg("master_orientation"), nb::arg("master"),
      nb::arg("integration"), nb::arg("degree"), nb::arg("derivatives"),
      nb::arg("max_angle") = IntegrationOptions().max_angle,
      "Quadrature points of a pair of facets.");
}

void wrap_integrals(nb::module_& m)
{
  m.def(
      "integrate_facet",
      [](FacetType slave_type, int slave_orientation, In<double> slave,
         In<double> normals, In<std::int8_t> has_multiplier, In<double> z,
         const std::vector<FacetType>& types, In<std::int8_t> orientation,
         In<std::int64_t> blocks, In<double> x, MultiplierSpace space,
         Integration integration, std::optional<int> degree,
         Derivatives derivatives, std::optional<In<std::int8_t>> nonnegative,
         double max_angle, std::optional<In<double>> offset) -> FacetIntegrals
      {
        const std::size_t n = num_nodes(slave_type);
        if (offset)
          check_size(*offset, n, "offset");
        check_size(normals, 3 * n, "normals");
        check_size(has_multiplier, n, "has_multiplier");
        check_size(z, 3 * n, "z");
        check_size(orientation, types.size(), "master_orientation");
        for (std::int8_t o : span(orientation))
          check_orientation(o);
        FacetList list;
        list.types = types;
        list.orientation.assign(orientation.data(),
                                orientation.data() + orientation.size());
        for (FacetType t : types)
          list.offsets.push_back(list.offsets.back() + num_nodes(t));
        check_size(blocks, list.offsets.back(), "master_blocks");
        check_size(x, 3 * list.offsets.back(), "masters");
        list.blocks.assign(blocks.data(), blocks.data() + blocks.size());
        list.x.assign(x.data(), x.data() + x.size());
        std::vector<std::int32_t> masters(types.size());
        for (std::size_t i = 0; i < masters.size(); ++i)
          masters[i] = i;
        IntegrationOptions options;
        options.space = space;
        options.integration = integration;
        options.degree = degree;
        options.max_angle = max_angle;
        FacetIntegrator integrator(options);
        return integrator.compute(
            facet_view(slave_type, slave_orientation, slave), span(normals),
            span(has_multiplier), flags_or_none(nonnegative, slave_type),
            span(z), list, masters, derivatives,
            offset ? span(*offset) : std::span<const double>());
      },
      nb::arg("slave_type"), nb::arg("slave_orientation"), nb::arg("slave"),
      nb::arg("normals"), nb::arg("has_multiplier"), nb::arg("z"),
      nb::arg("master_types"), nb::arg("master_orientation"),
      nb::arg("master_blocks"), nb::arg("masters"), nb::arg("space"),
      nb::arg("integration"), nb::arg("degree").none(), nb::arg("derivatives"),
      nb::arg("nonnegative").none() = nb::none(),
      nb::arg("max_angle") = IntegrationOptions().max_angle,
      nb::arg("offset").none() = nb::none(),
      "Mortar integrals of one slave facet, see FacetIntegrator.");
}
} // namespace

void wrap_facets(nb::module_& m)
{
  wrap_enums(m);
  wrap_shapes(m);
  wrap_results(m);
  wrap_pairs(m);
  wrap_integrals(m);
}
