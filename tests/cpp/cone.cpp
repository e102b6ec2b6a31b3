// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "dense.h"
#include <catch2/catch_test_macros.hpp>
#include <dolfinx_mortar/solver/support.h>

using namespace dolfinx_mortar;
using unit::MatrixXd;
using unit::VectorXd;

namespace
{
/// The distance with the vectors, columns of a matrix, dealt out to the ranks.
double distance_from(const MatrixXd& vectors, const VectorXd& point)
{
  int rank, size;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  std::vector<Eigen::Index> own;
  for (Eigen::Index i = rank; i < vectors.cols(); i += size)
    own.push_back(i);
  const MatrixXd rows
      = MatrixXd(vectors(Eigen::indexing::all, own)).transpose();
  return distance_from_cone(MPI_COMM_WORLD, rows, point);
}

VectorXd point(std::initializer_list<double> values)
{
  return Eigen::Map<const VectorXd>(values.begin(), values.size());
}

/// The distance by trying all subsets of independent vectors: the nearest point
/// is on a face, where it is the projection on the span.
double distance_by_subsets(const MatrixXd& vectors, const VectorXd& p)
{
  double least = p.norm();
  for (int bits = 1; bits < 1 << vectors.cols(); ++bits)
  {
    std::vector<Eigen::Index> used;
    for (Eigen::Index i = 0; i < vectors.cols(); ++i)
    {
      if (bits >> i & 1)
        used.push_back(i);
    }
    const MatrixXd A = vectors(Eigen::indexing::all, used);
    const auto [c, pivot]
        = unit::eliminate(A.transpose() * A, A.transpose() * p);
    if (pivot > 1e-8 and c.minCoeff() >= 0)
      least = std::min(least, (p - A * c).norm());
  }
  return least;
}
} // namespace

TEST_CASE("distance from the first quadrant", "[mpi]")
{
  const MatrixXd axes = MatrixXd::Identity(2, 2);
  CHECK(unit::close(distance_from(axes, point({1, 2})), 0, 1e-12));
  CHECK(unit::close(distance_from(axes, point({3, -4})), 4, 1e-12));
  CHECK(unit::close(distance_from(axes, point({-3, -4})), 5, 1e-12));
  CHECK(unit::close(distance_from(axes, point({0, 0})), 0, 1e-12));
}

TEST_CASE("distance from nothing, a ray, a plane and everything", "[mpi]")
{
  CHECK(unit::close(distance_from(MatrixXd(3, 0), point({1, 2, 2})), 3, 1e-12));
  MatrixXd vectors(3, 1);
  vectors << 0.6, 0.8, 0;
  CHECK(unit::close(distance_from(vectors, point({1.2, 1.6, 5})), 5, 1e-12));
  CHECK(unit::close(distance_from(vectors, point({-0.6, -0.8, 0})), 1, 1e-12));
  MatrixXd plane(3, 4);
  plane << 1, -1, 0, 0, 0, 0, 1, -1, 0, 0, 0, 0;
  CHECK(unit::close(distance_from(plane, point({-7, 3, -2})), 2, 1e-12));
  MatrixXd all(3, 6);
  all << MatrixXd::Identity(3, 3), -MatrixXd::Identity(3, 3);
  CHECK(unit::close(distance_from(all, point({-7, 3, -2})), 0, 1e-12));
}

TEST_CASE("distance from a circular cone", "[mpi]")
{
  // Many edges of a cone about z with half an angle of 45 degrees
  const int num = 360;
  MatrixXd cone(3, num);
  for (int i = 0; i < num; ++i)
  {
    const double angle = 2 * std::acos(-1.0) * i / num;
    cone.col(i) << std::cos(angle), std::sin(angle), 1;
  }
  cone.colwise().normalize();
  CHECK(unit::close(distance_from(cone, point({0.3, 0.4, 1})), 0, 1e-9));
  CHECK(
      unit::close(distance_from(cone, point({1, 0, 0})), std::sqrt(0.5), 1e-9));
  CHECK(unit::close(distance_from(cone, point({0, 0, -2})), 2, 1e-9));
}

TEST_CASE("distance from random cones agrees with all subsets", "[mpi]")
{
  unit::Numbers number(71);
  for (int i = 0; i < 20; ++i)
  {
    MatrixXd vectors = unit::random(4, 6, number);
    vectors.colwise().normalize();
    const VectorXd p = unit::random(4, 1, number);
    CHECK(unit::close(distance_from(vectors, p),
                      distance_by_subsets(vectors, p), 1e-9));
  }
}

TEST_CASE("loads that friction can and cannot balance", "[mpi]")
{
  MatrixXd edges(2, 2);
  edges << 0.5, 1, -0.5, 1;
  CHECK(!is_overloaded(MPI_COMM_WORLD, {point({0.4, 1}), edges}));
  CHECK(is_overloaded(MPI_COMM_WORLD, {point({0.6, 1}), edges}));
  CHECK(is_overloaded(MPI_COMM_WORLD, {point({0, -1}), edges}));
  CHECK(!is_overloaded(MPI_COMM_WORLD, {point({0, 0}), edges}));
}
