// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "facets.h"
#include <catch2/catch_test_macros.hpp>
#include <catch2/generators/catch_generators.hpp>
#include <catch2/generators/catch_generators_range.hpp>
#include <dolfinx_mortar/geometry/quadrature.h>
#include <dolfinx_mortar/multiplier/integrals.h>

using namespace dolfinx_mortar;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace
{
/// A slave facet and a master, the numbers of whose nodes are 0, 1, ...
struct Pair
{
  FacetType type, master_type;
  std::vector<double> x;
  FacetList master;

  Pair(FacetType type, const std::vector<double>& x, FacetType master_type,
       const std::vector<double>& x_master)
      : type(type), master_type(master_type), x(x)
  {
    master.types = {master_type};
    master.orientation = {-1};
    master.offsets.push_back(num_nodes(master_type));
    for (int k = 0; k < num_nodes(master_type); ++k)
      master.blocks.push_back(k);
    master.x = x_master;
  }

  const FacetIntegrals& integrate(FacetIntegrator& integrator,
                                  std::span<const std::int8_t> nonnegative
                                  = {}) const
  {
    const int n = num_nodes(type);
    std::vector<double> normals;
    for (int k = 0; k < n; ++k)
      normals.insert(normals.end(), {0.0, 0.0, 1.0});
    const std::vector<std::int8_t> carries(n, 1);
    const std::vector<std::int32_t> masters = {0};
    return integrator.compute({type, 1, x}, normals, carries, nonnegative,
                              std::vector<double>(3 * n, 0.0), master, masters,
                              Derivatives::none);
  }
};

/// ∫ N_k over a facet, by a rule of high degree.
VectorXd shape_integrals(FacetType type, const std::vector<double>& x)
{
  const QuadratureRule rule = create_rule(num_corners(type), 20);
  VectorXd integrals = VectorXd::Zero(num_nodes(type));
  for (std::size_t q = 0; q < rule.weights.size(); ++q)
  {
    SurfacePoint p;
    evaluate({type, 1, x}, {rule.points[2 * q], rule.points[2 * q + 1]}, p);
    integrals += rule.weights[q] * p.a1.cross(p.a2).norm()
                 * Eigen::Map<const VectorXd>(p.s.N.data(), num_nodes(type));
  }
  return integrals;
}

double largest(const MatrixXd& A) { return A.cwiseAbs().maxCoeff(); }
} // namespace

TEST_CASE("dual functions are biorthogonal on distorted facets")
{
  // The master is the same facet seen from the other side. M holds integrals
  // of products with the functions Φ themselves, D has the diagonal form D̃ T⁻¹
  // by construction: they agree only where Φ is biorthogonal to Ñ.
  const FacetType type
      = static_cast<FacetType>(GENERATE(range(0, num_facet_types)));
  const double height = GENERATE(0.0, 0.04);
  unit::Numbers number(31 + static_cast<int>(type));
  FacetIntegrator integrator({});
  for (int i = 0; i < 3; ++i)
  {
    const auto x = unit::distorted(type, 0.04, height, number);
    const FacetIntegrals r = Pair(type, x, type, x).integrate(integrator);
    REQUIRE(r.covered);
    MatrixXd M = MatrixXd::Zero(r.M.rows(), r.M.cols());
    for (std::size_t l = 0; l < r.master_blocks.size(); ++l)
      M.col(r.master_blocks[l]) = r.M.col(l);
    const MatrixXd T_inv = inverse_transformation(MultiplierSpace::dual, type);
    const MatrixXd D_tilde = r.coverage.asDiagonal();
    CHECK(largest(M - D_tilde * T_inv) < 1e-12);
    CHECK(largest(r.D - D_tilde * T_inv) < 1e-14);
    CHECK(largest(r.D_tilde - D_tilde) < 1e-14);
    CHECK(r.coverage.minCoeff() > 0);
    // Surfaces that lie on each other have neither gap nor jump
    CHECK(largest(r.gap) < 1e-14);
    CHECK(largest(r.jump) < 1e-14);
  }
}

TEST_CASE("weights are the integrals of the transformed functions")
{
  // On plane facets with straight edges the clipped parts fill the facet
  const FacetType type
      = static_cast<FacetType>(GENERATE(range(0, num_facet_types)));
  unit::Numbers number(41);
  IntegrationOptions options;
  options.degree = 20;
  FacetIntegrator integrator(options);
  const auto x = unit::straight(type, 0.1, number);
  const FacetIntegrals r = Pair(type, x, type, x).integrate(integrator);
  const VectorXd N = shape_integrals(type, x);
  const MatrixXd T = transformation(MultiplierSpace::dual, type);
  CHECK(largest(r.coverage - T.transpose() * N) < 1e-8);
  CHECK(unit::close(r.area, N.sum(), 1e-12));
  // Without transformation a corner of tri6 would have none
  if (type == FacetType::tri6)
    CHECK(largest(N.head(3)) < 1e-12);
}

TEST_CASE("both sides of a partly covered facet add up to the same")
{
  // Σ_k D_jk = Σ_l M_jl = ∫ Φ_j, and Σ_j over all of them is the covered area
  const FacetType type
      = static_cast<FacetType>(GENERATE(range(0, num_facet_types)));
  const FacetType other
      = static_cast<FacetType>(GENERATE(range(0, num_facet_types)));
  const MultiplierSpace space
      = static_cast<MultiplierSpace>(GENERATE(range(0, 4)));
  unit::Numbers number(51);
  IntegrationOptions options;
  options.space = space;
  FacetIntegrator integrator(options);
  const auto x = unit::straight(type, 0.0, number);
  auto x_master = unit::straight(other, 0.0, number);
  for (std::size_t i = 0; i < x_master.size(); i += 3)
  {
    x_master[i] += 0.25;
    x_master[i + 2] -= 0.125;
  }
  // Edges are flagged where functions need it
  std::vector<std::int8_t> flags;
  if (is_reproducing(space, type))
    flags.assign(num_nodes(type), 1);
  const FacetIntegrals r
      = Pair(type, x, other, x_master).integrate(integrator, flags);
  REQUIRE(r.covered);
  // The part of a triangle, or square, that the shifted one covers
  const bool s = num_corners(type) == 3, m = num_corners(other) == 3;
  const double covered = s and m ? 0.5 * 0.75 * 0.75
                         : s     ? 0.5 * 0.75 * 0.75
                         : m     ? 0.5 - 0.5 * 0.25 * 0.25
                                 : 0.75;
  CHECK(unit::close(r.area, covered, 1e-13));
  const VectorXd by_slave = r.D.rowwise().sum(),
                 by_master = r.M.rowwise().sum();
  CHECK(largest(by_slave - by_master) < 1e-12);
  // A gap of 1/8 everywhere: the slave, whose normal is +z, is above the
  // master, which is inside of it then: the gap is negative
  CHECK(unit::close(r.volume, -0.125 * covered, 1e-13));
  CHECK(largest(r.gap + 0.125 * by_slave) < 1e-12);
  CHECK(largest(r.jump.col(2) - 0.125 * by_slave) < 1e-12);
  CHECK(largest(r.jump.col(0)) < 1e-12);
  // Functions Φ of all nodes add up to one where the space has that
  CHECK(unit::close(by_slave.sum(), covered, 1e-11));
}

TEST_CASE("facets that do not meet are not covered")
{
  unit::Numbers number(61);
  FacetIntegrator integrator({});
  const auto x = unit::straight(FacetType::quad8, 0.0, number);
  auto x_master = x;
  for (std::size_t i = 0; i < x_master.size(); i += 3)
    x_master[i] += 1.5;
  CHECK(!Pair(FacetType::quad8, x, FacetType::quad8, x_master)
             .integrate(integrator)
             .covered);
}
