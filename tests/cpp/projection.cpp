// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "facets.h"
#include <catch2/catch_test_macros.hpp>
#include <catch2/generators/catch_generators.hpp>
#include <catch2/generators/catch_generators_range.hpp>
#include <dolfinx_mortar/geometry/projection.h>

using namespace dolfinx_mortar;

namespace
{
constexpr double step = 1e-5;

FacetType facet_type()
{
  return static_cast<FacetType>(GENERATE(range(0, num_facet_types)));
}

Vec3 position(const FacetView& f, std::array<double, 2> xi)
{
  SurfacePoint p;
  evaluate(f, xi, 1, p);
  return p.x;
}
} // namespace

TEST_CASE("tangents of a facet agree with differences")
{
  unit::Numbers number(11);
  const FacetType type = facet_type();
  const auto x = unit::distorted(type, 0.05, 0.1, number);
  const FacetView f{type, 1, x};
  const std::array<double, 2> xi = {0.3, 0.25};
  SurfacePoint p, plus, minus;
  evaluate(f, xi, 2, p);
  evaluate(f, {xi[0] + step, xi[1]}, 1, plus);
  evaluate(f, {xi[0] - step, xi[1]}, 1, minus);
  CHECK((p.a1 - (plus.x - minus.x) / (2 * step)).norm() < 1e-9);
  CHECK(
      (second_derivative(f, p.s, 0) - (plus.a1 - minus.a1) / (2 * step)).norm()
      < 1e-9);
  CHECK(
      (second_derivative(f, p.s, 1) - (plus.a2 - minus.a2) / (2 * step)).norm()
      < 1e-9);
  evaluate(f, {xi[0], xi[1] + step}, 1, plus);
  evaluate(f, {xi[0], xi[1] - step}, 1, minus);
  CHECK((p.a2 - (plus.x - minus.x) / (2 * step)).norm() < 1e-9);
  CHECK(
      (second_derivative(f, p.s, 2) - (plus.a2 - minus.a2) / (2 * step)).norm()
      < 1e-9);
}

TEST_CASE("a point above a facet is mapped back to where it came from")
{
  unit::Numbers number(12);
  const FacetType type = facet_type();
  for (int i = 0; i < 20; ++i)
  {
    const auto x = unit::distorted(type, 0.05, 0.1, number);
    const FacetView f{type, 1, x};
    const std::array<double, 2> from
        = {0.25 + 0.2 * number(), 0.25 + 0.2 * number()};
    const Vec3 n = Vec3(0.2 * number(), 0.2 * number(), 1).normalized();
    const Vec3 p = position(f, from) + 0.3 * number() * n;
    std::array<double, 2> xi = {0.3, 0.3};
    SurfacePoint point;
    Mat23 L;
    REQUIRE(project(f, p, n, xi, 1, point, L));
    CHECK(unit::close(xi[0], from[0], 1e-10));
    CHECK(unit::close(xi[1], from[1], 1e-10));
    // Where a point arrives that moves a little
    for (int c = 0; c < 3; ++c)
    {
      std::array<double, 2> plus = xi, minus = xi;
      SurfacePoint there;
      Mat23 ignored;
      REQUIRE(project(f, p + step * Vec3::Unit(c), n, plus, 1, there, ignored));
      REQUIRE(
          project(f, p - step * Vec3::Unit(c), n, minus, 1, there, ignored));
      CHECK(unit::close(L(0, c), (plus[0] - minus[0]) / (2 * step), 1e-7));
      CHECK(unit::close(L(1, c), (plus[1] - minus[1]) / (2 * step), 1e-7));
    }
  }
}

TEST_CASE("a line along a facet has no point on it")
{
  const auto nodes = node_coordinates(FacetType::tri3);
  std::vector<double> x;
  for (int k = 0; k < 3; ++k)
    x.insert(x.end(), {nodes[2 * k], nodes[2 * k + 1], 0.0});
  const FacetView f{FacetType::tri3, 1, x};
  std::array<double, 2> xi = {0.3, 0.3};
  SurfacePoint point;
  Mat23 L;
  CHECK(!project(f, Vec3(0.3, 0.3, 1), Vec3(1, 0, 0), xi, 1, point, L));
}

TEST_CASE("the pullback inverts tangents")
{
  unit::Numbers number(13);
  const Vec3 a1(1, 0.2, number()), a2(0.1, 1, number()), n(0.1, 0.2, 1);
  const Mat23 L = pullback(a1, a2, n);
  CHECK((L * a1 - Eigen::Vector2d(1, 0)).norm() < 1e-14);
  CHECK((L * a2 - Eigen::Vector2d(0, 1)).norm() < 1e-14);
  CHECK((L * n).norm() < 1e-14);
}

TEST_CASE("linear parts of a facet")
{
  unit::Numbers number(14);
  const FacetType type = facet_type();
  for (int orientation : {1, -1})
  {
    const auto x = unit::distorted(type, 0.05, 0.05, number);
    const FacetView f{type, orientation, x};
    for (const SubFacet& sub : sub_facets(type))
    {
      const LinearPart part(f, sub);
      CHECK(orientation * part.n[2] > 0.5);
      CHECK(unit::close(part.c.norm(), part.norm_c, 1e-15));
      CHECK((part.c / part.norm_c - part.n).norm() < 1e-15);
      // Counter-clockwise about the outward normal
      CHECK((part.corners[1] - part.corners[0])
                .cross(part.corners[2] - part.corners[0])
                .dot(part.n)
            > 0);
      const auto W = part.normal_derivative();
      for (int i = 0; i < part.size; ++i)
      {
        for (int c = 0; c < 3; ++c)
        {
          auto plus = x, minus = x;
          plus[3 * part.nodes[i] + c] += step;
          minus[3 * part.nodes[i] + c] -= step;
          const Vec3 change = LinearPart({type, orientation, plus}, sub).c
                              - LinearPart({type, orientation, minus}, sub).c;
          CHECK((W[i].col(c) - change / (2 * step)).norm() < 1e-8);
        }
      }
    }
  }
}

TEST_CASE("which normals oppose")
{
  std::vector<double> x = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  for (int orientation : {1, -1})
  {
    const FacetView f{FacetType::tri3, orientation, x};
    SurfacePoint point;
    evaluate(f, {0.3, 0.3}, 1, point);
    for (double degrees : {0.0, 50.0, 69.0, 71.0, 90.0, 180.0})
    {
      const double angle = degrees * std::acos(-1.0) / 180;
      const Vec3 n(std::sin(angle), 0, -orientation * std::cos(angle));
      const AngleLimits limits(70);
      CHECK(opposes(f, point, n, limits.part) == (degrees < 70));
    }
  }
}
