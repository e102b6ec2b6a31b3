// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "facets.h"
#include <catch2/catch_test_macros.hpp>
#include <catch2/generators/catch_generators.hpp>
#include <catch2/generators/catch_generators_range.hpp>
#include <dolfinx_mortar/geometry/packed_points.h>
#include <dolfinx_mortar/geometry/projection.h>
#include <limits>

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
  evaluate(f, xi, p);
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
  evaluate(f, xi, p);
  evaluate(f, {xi[0] + step, xi[1]}, plus);
  evaluate(f, {xi[0] - step, xi[1]}, minus);
  CHECK((p.a1 - (plus.x - minus.x) / (2 * step)).norm() < 1e-9);
  evaluate(f, {xi[0], xi[1] + step}, plus);
  evaluate(f, {xi[0], xi[1] - step}, minus);
  CHECK((p.a2 - (plus.x - minus.x) / (2 * step)).norm() < 1e-9);
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
    REQUIRE(project(f, p, n, xi, point, L));
    CHECK(unit::close(xi[0], from[0], 1e-10));
    CHECK(unit::close(xi[1], from[1], 1e-10));
    // Where a point arrives that moves a little
    for (int c = 0; c < 3; ++c)
    {
      std::array<double, 2> plus = xi, minus = xi;
      SurfacePoint there;
      Mat23 ignored;
      REQUIRE(project(f, p + step * Vec3::Unit(c), n, plus, there, ignored));
      REQUIRE(project(f, p - step * Vec3::Unit(c), n, minus, there, ignored));
      CHECK(unit::close(L(0, c), (plus[0] - minus[0]) / (2 * step), 1e-7));
      CHECK(unit::close(L(1, c), (plus[1] - minus[1]) / (2 * step), 1e-7));
    }
  }
}

TEST_CASE("four points at a time are mapped as one is")
{
  unit::Numbers number(15);
  const FacetType type = facet_type();
  const int num = num_nodes(type);
  for (int i = 0; i < 20; ++i)
  {
    const auto x = unit::distorted(type, 0.05, 0.1, number);
    const FacetView f{type, 1, x};
    const Vec3 n = Vec3(0.2 * number(), 0.2 * number(), 1).normalized();
    std::array<Vec3, pack_size> p;
    PackVec3 packed;
    PackedPoint four;
    for (int l = 0; l < pack_size; ++l)
    {
      p[l] = position(f, {0.25 + 0.2 * number(), 0.25 + 0.2 * number()})
             + 0.3 * number() * n;
      for (int c = 0; c < 3; ++c)
        packed[c][l] = p[l][c];
    }
    four.xi = {constant<Pack>(0.3), constant<Pack>(0.3)};
    project_pack(f, packed, n, 2, four);
    for (int l = 0; l < pack_size; ++l)
    {
      auto at
          = [l](const PackVec3& v) { return Vec3(v[0][l], v[1][l], v[2][l]); };
      std::array<double, 2> xi = {0.3, 0.3};
      SurfacePoint point, plus, minus;
      Mat23 L;
      REQUIRE(project(f, p[l], n, xi, point, L));
      REQUIRE(four.found[l]);
      for (int a = 0; a < 2; ++a)
      {
        CHECK(unit::close(four.xi[a][l], xi[a], 1e-13));
        CHECK((at(four.L[a]) - L.row(a).transpose()).norm() < 1e-12);
        for (int k = 0; k < num; ++k)
          CHECK(unit::close(four.s.dN[a][k][l], point.s.dN[a][k], 1e-12));
      }
      CHECK((at(four.x) - point.x).norm() < 1e-13);
      CHECK((at(four.a1) - point.a1).norm() < 1e-12);
      CHECK((at(four.a2) - point.a2).norm() < 1e-12);
      evaluate(f, {xi[0] + step, xi[1]}, plus);
      evaluate(f, {xi[0] - step, xi[1]}, minus);
      CHECK((at(four.a11) - (plus.a1 - minus.a1) / (2 * step)).norm() < 1e-9);
      CHECK((at(four.a12) - (plus.a2 - minus.a2) / (2 * step)).norm() < 1e-9);
      evaluate(f, {xi[0], xi[1] + step}, plus);
      evaluate(f, {xi[0], xi[1] - step}, minus);
      CHECK((at(four.a22) - (plus.a2 - minus.a2) / (2 * step)).norm() < 1e-9);
    }
  }
}

TEST_CASE("one of four points without a place leaves the others alone")
{
  const auto nodes = node_coordinates(FacetType::tri6);
  std::vector<double> x;
  for (int k = 0; k < 6; ++k)
    x.insert(x.end(), {nodes[2 * k], nodes[2 * k + 1], 0.0});
  const FacetView f{FacetType::tri6, 1, x};
  PackVec3 p = {constant<Pack>(0.25), constant<Pack>(0.5), constant<Pack>(1)};
  p[0][2] = 1e9;
  p[1][3] = std::numeric_limits<double>::quiet_NaN();
  PackedPoint four;
  four.xi = {constant<Pack>(0.3), constant<Pack>(0.3)};
  project_pack(f, p, Vec3(0, 0, 1), 1, four);
  CHECK(four.found == std::array<bool, pack_size>{true, true, false, false});
  CHECK(unit::close(four.xi[0][1], 0.25, 1e-15));
  CHECK(unit::close(four.xi[1][1], 0.5, 1e-15));
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
  CHECK(!project(f, Vec3(0.3, 0.3, 1), Vec3(1, 0, 0), xi, point, L));
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
    evaluate(f, {0.3, 0.3}, point);
    for (double degrees : {0.0, 50.0, 69.0, 71.0, 90.0, 180.0})
    {
      const double angle = degrees * std::acos(-1.0) / 180;
      const Vec3 n(std::sin(angle), 0, -orientation * std::cos(angle));
      const AngleLimits limits(70);
      CHECK(opposes(f, point.a1, point.a2, n, limits.part) == (degrees < 70));
    }
  }
}
