// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

// Where surfaces have passed through each other.

#include "arrays.h"
#include <dolfinx_mortar/surface/crossing.h>
#include <dolfinx_mortar/surface/overlap.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <optional>
#include <stdexcept>
#include <utility>

namespace nb = nanobind;
using namespace dolfinx_mortar;
using namespace dolfinx_mortar_wrappers;

namespace
{
void check(const Surface& s, const In<double>& x)
{
  if (x.size() != 3 * s.numbers.size())
    throw std::invalid_argument("One position is needed for each node.");
}

std::pair<double, std::array<double, 3>> as_pair(const Depth& d)
{
  return {d.depth, d.x};
}
} // namespace

void wrap_passage(nb::module_& m)
{
  m.def(
      "find_crossing",
      [](const Surface& slave, In<double> slave_before, In<double> slave_after,
         const Surface& master, In<double> master_before,
         In<double> master_after, std::optional<double> distance)
      {
        check(slave, slave_before);
        check(slave, slave_after);
        check(master, master_before);
        check(master, master_after);
        return as_pair(
            find_crossing(slave, span(slave_before), span(slave_after), master,
                          span(master_before), span(master_after), distance));
      },
      nb::arg("slave"), nb::arg("slave_before"), nb::arg("slave_after"),
      nb::arg("master"), nb::arg("master_before"), nb::arg("master_after"),
      nb::arg("distance").none() = nb::none(),
      "Depth and position of the point that has passed furthest through a "
      "surface; depth 0 where there is none. Collective.");
  m.def(
      "find_overlap",
      [](const Surface& slave, In<double> x_slave, In<std::int8_t> test,
         In<std::int64_t> slave_bodies, const Surface& master,
         In<double> x_master, In<std::int64_t> master_bodies, In<double> boxes)
      {
        check(slave, x_slave);
        check(master, x_master);
        return as_pair(find_overlap(slave, span(x_slave), span(test),
                                    span(slave_bodies), master, span(x_master),
                                    span(master_bodies), span(boxes)));
      },
      nb::arg("slave"), nb::arg("x_slave"), nb::arg("test"),
      nb::arg("slave_bodies"), nb::arg("master"), nb::arg("x_master"),
      nb::arg("master_bodies"), nb::arg("boxes"),
      "Depth and position of the slave facet that is deepest inside a master "
      "body; depth 0 where there is none. Collective.");
}
