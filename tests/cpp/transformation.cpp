// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "numbers.h"
#include <catch2/catch_test_macros.hpp>
#include <catch2/generators/catch_generators.hpp>
#include <catch2/generators/catch_generators_range.hpp>
#include <dolfinx_mortar/geometry/quadrature.h>
#include <dolfinx_mortar/multiplier/multiplier.h>
#include <vector>

using namespace dolfinx_mortar;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace
{
FacetType type_of_facet()
{
  return static_cast<FacetType>(GENERATE(range(0, num_facet_types)));
}

MultiplierSpace any_space()
{
  return static_cast<MultiplierSpace>(GENERATE(range(0, 4)));
}

/// Transformed functions Ñᵀ = Nᵀ T at a point.
VectorXd transformed(FacetType type, const FacetMatrix& T,
                     std::array<double, 2> xi)
{
  Shapes s;
  tabulate(type, xi, 0, s);
  return T.transpose()
         * Eigen::Map<const VectorXd>(s.N.data(), num_nodes(type));
}

/// Flags of all nodes that are not corners, as the bits of a number say.
std::vector<std::int8_t> flags_of(FacetType type, int bits)
{
  std::vector<std::int8_t> flags(num_nodes(type), 0);
  for (int k = num_corners(type); k < num_nodes(type); ++k)
    flags[k] = bits >> (k - num_corners(type)) & 1;
  return flags;
}

/// Smallest values that the functions of multipliers have on a facet.
double smallest(MultiplierSpace space, FacetType type, const FacetMatrix& T)
{
  const int n = num_multipliers(space, type), steps = 20;
  double least = 1;
  for (int i = 0; i <= steps; ++i)
  {
    for (int j = 0; j <= steps; ++j)
    {
      const std::array<double, 2> xi
          = {static_cast<double>(i) / steps, static_cast<double>(j) / steps};
      if (in_reference(type, xi, 0))
        least = std::min(least, transformed(type, T, xi).head(n).minCoeff());
    }
  }
  return least;
}
} // namespace

TEST_CASE("transformed functions have positive integrals")
{
  const FacetType type = type_of_facet();
  const int n = num_nodes(type);
  const QuadratureRule rule = create_rule(num_corners(type), 6);
  // Without transformation those of corners of tri6 vanish, of quad8 are
  // negative
  for (MultiplierSpace space :
       {MultiplierSpace::dual, MultiplierSpace::dual_linear,
        MultiplierSpace::dual_reproducing})
  {
    const FacetMatrix T = transformation(space, type);
    VectorXd integral = VectorXd::Zero(n);
    MatrixXd moment = MatrixXd::Zero(n, 2);
    for (std::size_t q = 0; q < rule.weights.size(); ++q)
    {
      const std::array<double, 2> xi
          = {rule.points[2 * q], rule.points[2 * q + 1]};
      const VectorXd N = rule.weights[q] * transformed(type, T, xi);
      integral += N;
      moment += N * Eigen::RowVector2d(xi[0], xi[1]);
    }
    CHECK(integral.head(num_multipliers(space, type)).minCoeff() > 1e-3);
    // The centroid of a corner's function is on its node (tri6, quad8)
    if (space != MultiplierSpace::dual_linear
        and (type == FacetType::tri6 or type == FacetType::quad8))
    {
      const auto nodes = node_coordinates(type);
      for (int k = 0; k < num_corners(type); ++k)
      {
        CHECK(unit::close(moment(k, 0), nodes[2 * k] * integral[k], 1e-14));
        CHECK(unit::close(moment(k, 1), nodes[2 * k + 1] * integral[k], 1e-14));
      }
    }
  }
}

TEST_CASE("functions that multipliers are dual to add up to one")
{
  const FacetType type = type_of_facet();
  const MultiplierSpace space = any_space();
  if (is_reproducing(space, type))
    return; // multipliers are made of ψ, which do
  for (int bits : {0, 1, 6, 31})
  {
    const FacetMatrix T = transformation(space, type, flags_of(type, bits));
    for (std::array<double, 2> xi :
         {std::array{0.1, 0.2}, {0.4, 0.5}, {0.7, 0.1}})
    {
      const VectorXd N = transformed(type, T, xi);
      CHECK(unit::close(N.head(num_multipliers(space, type)).sum(), 1, 1e-14));
    }
  }
}

TEST_CASE("the inverse of the basis transformation is its inverse")
{
  const FacetType type = type_of_facet();
  const MultiplierSpace space = any_space();
  const int n = num_nodes(type);
  for (int bits = 0; bits < 1 << (n - num_corners(type)); ++bits)
  {
    const auto flags = flags_of(type, bits);
    const MatrixXd product = transformation(space, type, flags)
                             * inverse_transformation(space, type, flags);
    CHECK((product - MatrixXd::Identity(n, n)).cwiseAbs().maxCoeff() < 1e-14);
  }
}

TEST_CASE("functions that are called nonnegative are")
{
  const FacetType type = type_of_facet();
  const MultiplierSpace space = any_space();
  const int all = (1 << (num_nodes(type) - num_corners(type))) - 1;
  for (int bits = 0; bits <= all; ++bits)
  {
    const auto flags = flags_of(type, bits);
    const double least
        = smallest(space, type, transformation(space, type, flags));
    if (is_nonnegative(space, type, flags))
      CHECK(least > -1e-14);
  }
  // What is changed where masters end: the dual space of second order
  if (space == MultiplierSpace::dual
      or space == MultiplierSpace::dual_reproducing)
  {
    CHECK(is_nonnegative(space, type, flags_of(type, all)));
    CHECK(is_nonnegative(space, type, {}) == !is_second_order(type));
    const double plain = smallest(space, type, transformation(space, type));
    CHECK((plain < -0.01) == is_second_order(type));
  }
}

TEST_CASE("which matrices can be factorised")
{
  // Badly scaled, as where a facet is barely covered
  const double scale[3] = {1, 1e-8, 1e3};
  FacetMatrix M(3, 3);
  for (int i = 0; i < 3; ++i)
  {
    for (int j = 0; j < 3; ++j)
      M(i, j) = (i == j ? 2 : 1) * scale[i] * scale[j];
  }
  ScaledFactors factors;
  CHECK(factors.compute(M, true));
  // Not definite; two rows that are the same but for their scale; no diagonal
  FacetMatrix other = M;
  other(0, 2) = other(2, 0) = 3 * scale[0] * scale[2];
  CHECK(!factors.compute(other, true));
  other = M;
  for (int j = 0; j < 3; ++j)
    other(1, j) = other(j, 1) = M(0, j) * scale[1];
  other(1, 1) = M(0, 0) * scale[1] * scale[1];
  CHECK(!factors.compute(other, true));
  other = M;
  other(2, 2) = 0;
  CHECK(!factors.compute(other, true));

  // Matrices that are not symmetric: so is this one, and its transpose
  other = M;
  other(0, 2) = 0.5 * scale[0] * scale[2];
  REQUIRE(factors.compute(other, false));
  for (bool transposed : {false, true})
  {
    MatrixXd A = other;
    if (transposed)
      A.transposeInPlace();
    const Eigen::Vector3d x(1, 2, 3);
    const Eigen::Vector3d scaled
        = x.array() / Eigen::Array3d(scale[0], scale[1], scale[2]);
    Eigen::VectorXd b = A * scaled;
    if (transposed)
      factors.solve_transposed(b);
    else
      factors.solve(b);
    for (int i = 0; i < 3; ++i)
      CHECK(unit::close(b[i] * scale[i], x[i], 1e-13));
  }
  // Two rows that are the same but for their scale
  other = M;
  for (int j = 0; j < 3; ++j)
    other(1, j) = M(0, j) * scale[1];
  CHECK(!factors.compute(other, false));
}
