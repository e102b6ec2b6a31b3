// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "numbers.h"
#include <catch2/catch_test_macros.hpp>
#include <dolfinx_mortar/geometry/clip.h>
#include <vector>

using namespace dolfinx_mortar;
using unit::close;

namespace
{
using Polygon = std::vector<std::array<double, 2>>;

constexpr double tol = 1e-12;

double area(const ClipPolygon& p)
{
  double twice = 0;
  for (int i = 0; i < p.size and p.size > 2; ++i)
  {
    const auto &a = p.vertices[i].p, &b = p.vertices[(i + 1) % p.size].p;
    twice += a[0] * b[1] - a[1] * b[0];
  }
  return twice / 2;
}

Polygon box(double x0, double y0, double x1, double y1)
{
  return {{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}};
}

const Polygon square = box(0, 0, 1, 1);
} // namespace

TEST_CASE("areas of known intersections")
{
  // A corner, a strip, one within the other either way, the same
  CHECK(close(area(clip(square, box(0.5, 0.75, 2, 2), tol)), 0.125, 1e-14));
  CHECK(close(area(clip(square, box(-1, 0.2, 2, 0.5), tol)), 0.3, 1e-14));
  CHECK(close(area(clip(square, box(0.2, 0.3, 0.4, 0.6), tol)), 0.06, 1e-14));
  CHECK(close(area(clip(square, box(-1, -1, 2, 3), tol)), 1, 1e-14));
  CHECK(close(area(clip(square, square, tol)), 1, 1e-14));
  // Two squares, one turned by 45 degrees about their centre: an octagon
  const double r = std::sqrt(0.5);
  const Polygon turned
      = {{0.5 + r, 0.5}, {0.5, 0.5 + r}, {0.5 - r, 0.5}, {0.5, 0.5 - r}};
  const ClipPolygon octagon = clip(square, turned, tol);
  CHECK(octagon.size == 8);
  CHECK(close(area(octagon), 2 * (std::sqrt(2.0) - 1), 1e-13));
  // Triangles: a star of two has a hexagon with two thirds of the area
  const double h = std::sqrt(3.0) / 2;
  const Polygon up = {{-h, -0.5}, {h, -0.5}, {0, 1}},
                down = {{h, 0.5}, {-h, 0.5}, {0, -1}};
  const ClipPolygon hexagon = clip(up, down, tol);
  CHECK(hexagon.size == 6);
  CHECK(close(area(hexagon), 2.0 / 3 * 1.5 * h, 1e-14));
  // The master need not be convex: the part of an arrow head within the square
  const Polygon arrow = {{-1, 0.5}, {0.5, 0.75}, {2, 0.5}, {0.5, 2}};
  CHECK(close(area(clip(square, arrow, tol)), 7.0 / 24, 1e-14));
}

TEST_CASE("polygons that only touch do not overlap")
{
  CHECK(close(area(clip(square, box(1, 0, 2, 1), tol)), 0, 1e-12));
  CHECK(close(area(clip(square, box(1, 1, 2, 2), tol)), 0, 1e-12));
  CHECK(clip(square, box(1.5, 0, 2, 1), tol).size < 3);
  CHECK(clip(square, box(0, 3, 1, 4), tol).size < 3);
  // No area of their own
  const Polygon line = {{0.2, 0.2}, {0.8, 0.8}, {0.5, 0.5}};
  CHECK(close(area(clip(square, line, tol)), 0, 1e-12));
}

TEST_CASE("corners of an intersection know what they were made of")
{
  const Polygon master = box(0.5, 0.75, 2, 2);
  const ClipPolygon p = clip(square, master, tol);
  REQUIRE(p.size == 4);
  auto on = [](const Polygon& q, int edge, const std::array<double, 2>& x)
  {
    const auto &a = q[edge], &b = q[(edge + 1) % q.size()];
    return close((b[0] - a[0]) * (x[1] - a[1]), (b[1] - a[1]) * (x[0] - a[0]),
                 1e-13);
  };
  int kinds[3] = {0, 0, 0};
  for (int i = 0; i < p.size; ++i)
  {
    const ClipVertex& v = p.vertices[i];
    const auto& next = p.vertices[(i + 1) % p.size].p;
    ++kinds[static_cast<int>(v.kind)];
    switch (v.kind)
    {
    case ClipVertex::Kind::slave:
      CHECK(v.p == square[v.slave]);
      break;
    case ClipVertex::Kind::master:
      CHECK(v.p == master[v.master]);
      break;
    default:
      CHECK(on(square, v.slave, v.p));
      CHECK(on(master, v.master, v.p));
    }
    const Polygon& of = v.line < 4 ? master : square;
    CHECK(on(of, v.line % 4, v.p));
    CHECK(on(of, v.line % 4, next));
  }
  CHECK(kinds[0] == 1);
  CHECK(kinds[1] == 1);
  CHECK(kinds[2] == 2);
}

TEST_CASE("intersections of random convex polygons add up")
{
  // Two halves of a master have together what the master has
  unit::Numbers number(3);
  for (int i = 0; i < 200; ++i)
  {
    Polygon q = square;
    for (auto& x : q)
    {
      x[0] += 0.4 * number() + 0.5 * number();
      x[1] += 0.4 * number();
    }
    const Polygon first = {q[0], q[1], q[2]}, second = {q[0], q[2], q[3]};
    auto signed_area = [](const Polygon& t)
    {
      return (t[1][0] - t[0][0]) * (t[2][1] - t[0][1])
             - (t[1][1] - t[0][1]) * (t[2][0] - t[0][0]);
    };
    if (signed_area(first) < 0.01 or signed_area(second) < 0.01)
      continue;
    CHECK(
        close(area(clip(square, q, tol)),
              area(clip(square, first, tol)) + area(clip(square, second, tol)),
              1e-11));
  }
}
