// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "dense.h"
#include <catch2/catch_test_macros.hpp>
#include <catch2/generators/catch_generators.hpp>
#include <dolfinx_mortar/solver/body_levels.h>
#include <dolfinx_mortar/solver/corner_multigrid.h>
#include <dolfinx_mortar/solver/diagonal_blocks.h>
#include <dolfinx_mortar/solver/projected_tangent.h>

using namespace dolfinx_mortar;
using Eigen::Matrix3d;
using unit::MatrixXd;
using unit::VectorXd;

namespace
{
constexpr int nodes_of_rank = 5; // of a rank

/// SmallBodies of five nodes on each rank: the last but one is constrained
/// along a direction and the last one altogether, they follow nodes of all
/// ranks; one component of the first is prescribed.
struct SmallBodies
{
  NewtonSystem system;
  Elimination elimination;
  MatrixXd K, W, A; // A without what stands in for the fixed dofs
  Matrix W_rows;
  int rank, size, num_dofs;

  SmallBodies()
  {
    const MPI_Comm comm = MPI_COMM_WORLD;
    MPI_Comm_rank(comm, &rank);
    MPI_Comm_size(comm, &size);
    num_dofs = 3 * nodes_of_rank * size;
    unit::Numbers number(7);
    K = 0.2 * unit::random(num_dofs, num_dofs, number);
    K = (K + K.transpose()).eval();
    K.diagonal().array() += 5;
    W = MatrixXd::Zero(num_dofs, num_dofs);
    const Eigen::Vector3d n = Eigen::Vector3d(1, 2, -2) / 3;
    const double unit = K.diagonal().mean();
    MatrixXd units = MatrixXd::Zero(num_dofs, num_dofs);
    for (int q = 0; q < size; ++q)
    {
      for (int node : {3, 4})
      {
        const Matrix3d Pi
            = node == 3 ? Matrix3d(n * n.transpose()) : Matrix3d::Identity();
        const int row = 3 * (nodes_of_rank * q + node);
        for (int p = 0; p < size; ++p)
        {
          for (int k = 0; k < 2; ++k)
          {
            W.block<3, 3>(row, 3 * (nodes_of_rank * p + k))
                = Pi * unit::random(3, 3, number);
          }
        }
        W.block<3, 3>(row, row) = -Pi;
        units.block<3, 3>(row, row) = unit * Pi;
        if (q == rank)
          elimination.constrained.push_back(Pi);
      }
      if (q == rank)
      {
        elimination.constrained.insert(elimination.constrained.begin(), 3,
                                       Matrix3d::Zero());
      }
    }
    const MatrixXd motion = MatrixXd::Identity(num_dofs, num_dofs) + W;
    A = motion.transpose() * K * motion + units;
    for (int q = 0; q < size; ++q)
    {
      const int dof = 3 * nodes_of_rank * q + 1;
      A.row(dof).setZero();
      A.col(dof).setZero();
      A(dof, dof) = unit;
    }
    system.comm = comm;
    system.size_u = 3 * nodes_of_rank;
    system.fixed = {1};
    system.K = rows(K);
    W_rows = rows(W);
  }

  int first() const { return 3 * nodes_of_rank * rank; }

  Matrix rows(const MatrixXd& M) const
  {
    const int own = 3 * nodes_of_rank;
    return unit::from_dense(MPI_COMM_WORLD, M, own * rank, own, own, true);
  }

  std::vector<double> part(const VectorXd& v) const
  {
    return {v.data() + first(), v.data() + first() + 3 * nodes_of_rank};
  }
};

double difference(const std::vector<double>& a, const std::vector<double>& b)
{
  double d = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    d = std::max(d, std::abs(a[i] - b[i]));
  return d;
}
} // namespace

TEST_CASE("the operator of motions is the same as products and as a matrix",
          "[mpi]")
{
  const SmallBodies b;
  const ReducedOperator A(b.system, b.elimination, b.W_rows.get());
  CHECK(unit::close(A.unit(), b.K.diagonal().mean(), 1e-13));
  unit::Numbers number(3);
  const VectorXd v = unit::random(b.num_dofs, 1, number), Av = b.A * v;
  const Vector x = create_vector(MPI_COMM_WORLD, b.part(v));
  Vector y;
  check(VecDuplicate(x.get(), y.put()), "VecDuplicate");
  A.apply(x.get(), y.get());
  CHECK(difference(local_values(y.get()), b.part(Av)) < 1e-12);
  CHECK(difference(multiply(A.assemble().get(), b.part(v)), b.part(Av))
        < 1e-12);

  // Two coarse nodes of each rank; none moves what is fixed
  MatrixXd P = unit::random(b.num_dofs, 6 * b.size, number);
  for (int q = 0; q < b.size; ++q)
    P.row(3 * nodes_of_rank * q + 1).setZero();
  const Matrix rows = unit::from_dense(MPI_COMM_WORLD, P, b.first(),
                                       3 * nodes_of_rank, 6, false);
  const VectorXd w = unit::random(6 * b.size, 1, number);
  const std::vector<Entry> entries = {{0, 0, 2.0}, {1, 3, 0.5}};
  const Matrix more = create_from_entries(MPI_COMM_WORLD, 6, 6, entries);
  MatrixXd PAP = P.transpose() * b.A * P;
  for (int q = 0; q < b.size; ++q)
  {
    PAP(6 * q, 6 * q) += 2;
    PAP(6 * q + 1, 6 * q + 3) += 0.5;
  }
  const VectorXd PAPw = PAP * w;
  const std::vector<double> own(w.data() + 6 * b.rank,
                                w.data() + 6 * b.rank + 6),
      expected(PAPw.data() + 6 * b.rank, PAPw.data() + 6 * b.rank + 6);
  const MatrixXd P0 = unit::random(b.num_dofs, 6 * b.size, number);
  ProjectedTangent tangent(unit::from_dense(MPI_COMM_WORLD, P0, b.first(),
                                            3 * nodes_of_rank, 6, false));
  const Matrix projected
      = A.project(rows.get(), b.W_rows.get(), tangent, more.get());
  CHECK(difference(multiply(projected.get(), own), expected)
        < 1e-11 * PAP.cwiseAbs().maxCoeff());
}

TEST_CASE("a projected tangent, rows of the interpolation changed", "[mpi]")
{
  const SmallBodies b;
  unit::Numbers number(5);
  auto interpolation = [&](const MatrixXd& P)
  {
    return unit::from_dense(MPI_COMM_WORLD, P, b.first(), 3 * nodes_of_rank, 6,
                            false);
  };
  const MatrixXd P0 = unit::random(b.num_dofs, 6 * b.size, number);
  MatrixXd P = P0;
  for (int q = 0; q < b.size; ++q)
  {
    P.middleRows(3 * nodes_of_rank * q + 2, 4)
        = unit::random(4, 6 * b.size, number);
  }
  const VectorXd w = unit::random(6 * b.size, 1, number);
  const std::vector<double> own(w.data() + 6 * b.rank,
                                w.data() + 6 * b.rank + 6);
  std::vector<Entry> entries;
  for (std::int32_t i = 0; i < 6; ++i)
    entries.push_back({i, i, 2.0});
  const Matrix twice = create_from_entries(MPI_COMM_WORLD, 6, 6, entries);
  ProjectedTangent tangent(interpolation(P0));
  auto error = [&](const MatrixXd& K, Mat K_rows, const MatrixXd& Q)
  {
    const VectorXd expected = Q.transpose() * K * Q * w + 2 * w;
    const Matrix A
        = tangent.project(K_rows, interpolation(Q).get(), twice.get());
    return difference(
               multiply(A.get(), own),
               {expected.data() + 6 * b.rank, expected.data() + 6 * b.rank + 6})
           / expected.cwiseAbs().maxCoeff();
  };
  const Mat K = b.system.K.get();
  CHECK(error(b.K, K, P0) < 1e-13);
  CHECK(error(b.K, K, P) < 1e-13);
  CHECK(error(b.K, K, 2 * P) < 1e-13);
  // The same matrix with other values, and another one
  check(MatScale(K, 3), "MatScale");
  CHECK(error(3 * b.K, K, P) < 1e-13);
  const Matrix other = b.rows(7 * b.K);
  CHECK(error(7 * b.K, other.get(), P) < 1e-13);
  // P0' K P0 is as it was
  const VectorXd expected = 7 * P0.transpose() * b.K * P0 * w;
  CHECK(difference(
            multiply(tangent.project(other.get()).get(), own),
            {expected.data() + 6 * b.rank, expected.data() + 6 * b.rank + 6})
        < 1e-13 * expected.cwiseAbs().maxCoeff());
}

TEST_CASE("a projected tangent, few rows of which change", "[mpi]")
{
  // A chain of nodes, the first three and the last two of a rank with a corner
  const SmallBodies b;
  unit::Numbers number(6);
  MatrixXd K = b.K, P0 = MatrixXd::Zero(b.num_dofs, 6 * b.size);
  for (int i = 0; i < b.num_dofs; ++i)
  {
    const int node = i / 3,
              corner = 2 * (node / nodes_of_rank) + (node % nodes_of_rank > 2);
    for (int j = 0; j < b.num_dofs; ++j)
      K(i, j) *= std::abs(node - j / 3) <= 1;
    P0.block<1, 3>(i, 3 * corner) = unit::random(1, 3, number);
  }
  // Nodes of the first rank change; its last one is next to one of another
  MatrixXd first = P0, last = P0;
  first.topRows(3) *= -1;
  last.middleRows(3 * nodes_of_rank - 3, 3).setZero();
  const Matrix K_rows = b.rows(K);
  auto interpolation = [&](const MatrixXd& P)
  {
    return unit::from_dense(MPI_COMM_WORLD, P, b.first(), 3 * nodes_of_rank, 6,
                            false);
  };
  std::vector<Entry> entries;
  if (b.rank == 0)
    entries.push_back({1, 1, 2.0});
  const Matrix more = create_from_entries(MPI_COMM_WORLD, 6, 6, entries);
  ProjectedTangent tangent(interpolation(P0));
  const MatrixXd constant = P0.transpose() * K * P0;
  for (const MatrixXd& P : {first, last, P0, last, first, first, P0})
  {
    MatrixXd expected = P.transpose() * K * P;
    expected(1, 1) += 2;
    const Matrix A
        = tangent.project(K_rows.get(), interpolation(P).get(), more.get());
    CHECK((unit::to_dense(A.get()) - expected).cwiseAbs().maxCoeff() < 1e-13);
    const Matrix again = tangent.project(K_rows.get());
    CHECK((unit::to_dense(again.get()) - constant).cwiseAbs().maxCoeff()
          < 1e-13);
    // Whoever changes the sum costs time, and no more
    if (P == first)
      check(MatScale(A.get(), 2), "MatScale");
  }
}

TEST_CASE("blocks at the diagonal, of nodes and of several together", "[mpi]")
{
  const SmallBodies b;
  const ReducedOperator A(b.system, b.elimination, b.W_rows.get());
  // Components of the first and the last but one node of all ranks; where
  // nodes share no block that of each is its own
  const bool share = GENERATE(true, false);
  const std::vector<std::int32_t> together
      = share ? std::vector<std::int32_t>{0, 2, 9, 10, 11}
              : std::vector<std::int32_t>();
  const DiagonalBlocks blocks(MPI_COMM_WORLD, A, together);
  unit::Numbers number(4);
  const VectorXd v = unit::random(b.num_dofs, 1, number);
  const Vector x = create_vector(MPI_COMM_WORLD, b.part(v));
  Vector y;
  check(VecDuplicate(x.get(), y.put()), "VecDuplicate");
  blocks.apply(x.get(), y.get());
  MatrixXd inverse = MatrixXd::Zero(b.num_dofs, b.num_dofs);
  for (int i = 0; i < b.num_dofs; i += 3)
  {
    inverse.block<3, 3>(i, i)
        = unit::solve(b.A.block<3, 3>(i, i), MatrixXd::Identity(3, 3));
  }
  std::vector<int> all;
  for (int q = 0; q < b.size; ++q)
  {
    for (std::int32_t dof : together)
      all.push_back(3 * nodes_of_rank * q + dof);
  }
  const int n = all.size();
  const MatrixXd part = b.A(all, all);
  const MatrixXd part_inverse
      = n == 0 ? part : unit::solve(part, MatrixXd::Identity(n, n));
  for (int i = 0; i < n; ++i)
  {
    inverse.row(all[i]).setZero();
    for (int j = 0; j < n; ++j)
      inverse(all[i], all[j]) = part_inverse(i, j);
  }
  CHECK(difference(local_values(y.get()), b.part(inverse * v)) < 1e-12);
}

TEST_CASE("motions by those of corners", "[mpi]")
{
  // Node 2 is between 0 and 1 of its rank; 3 and 4 are corners, too, but follow
  SmallBodies b;
  MatrixXd P = MatrixXd::Zero(b.num_dofs, 12 * b.size);
  MatrixXd expected = P;
  for (int q = 0; q < b.size; ++q)
  {
    for (int c = 0; c < 3; ++c)
    {
      const int row = 3 * nodes_of_rank * q + c, column = 12 * q + c;
      int corner = 0;
      for (int node : {0, 1, 3, 4})
        P(row + 3 * node, column + 3 * corner++) = 1;
      P(row + 6, column) = P(row + 6, column + 3) = 0.5;
    }
  }
  const int own = 3 * nodes_of_rank;
  const Matrix rows
      = unit::from_dense(MPI_COMM_WORLD, P, own * b.rank, own, 12, false);
  CHECK(corner_dofs(rows.get())
        == std::vector<std::int32_t>{0, 1, 2, 3, 4, 5, 9, 10, 11, 12, 13, 14});
  const Matrix found = interpolate_motions(rows.get(), b.system, b.elimination,
                                           b.W_rows.get(), nullptr);
  // Without T a node has the motion of P, but for what it is held in
  for (int q = 0; q < b.size; ++q)
  {
    const Matrix3d Pi = -b.W.block<3, 3>(3 * (nodes_of_rank * q + 3),
                                         3 * (nodes_of_rank * q + 3));
    expected.middleRows(own * q, own) = P.middleRows(own * q, own);
    expected.middleRows(own * q + 9, 3)
        = (Matrix3d::Identity() - Pi) * P.middleRows(own * q + 9, 3);
    expected.middleRows(own * q + 12, 3).setZero();
    expected.row(own * q + 1).setZero();
    expected.col(12 * q + 1).setZero();
  }
  unit::Numbers number(5);
  const VectorXd w = unit::random(12 * b.size, 1, number), u = expected * w;
  const std::vector<double> mine(w.data() + 12 * b.rank,
                                 w.data() + 12 * b.rank + 12);
  CHECK(difference(multiply(found.get(), mine), b.part(u)) < 1e-13);
}

TEST_CASE("levels with given interpolations", "[mpi]")
{
  const SmallBodies s;
  // Without smoothing PCApply is the correction of the coarse level; its last
  // dof of each rank moves nothing
  constexpr int coarse_of_rank = 3;
  const int num_coarse = coarse_of_rank * s.size;
  unit::Numbers number(11);
  MatrixXd P = unit::random(s.num_dofs, num_coarse, number);
  const double unit = s.K.diagonal().mean();
  for (int q = 0; q < s.size; ++q)
    P.col(coarse_of_rank * (q + 1) - 1).setZero();
  MatrixXd coarse = P.transpose() * s.A * P;
  coarse.diagonal().array() += 1e-12 * unit;
  const int own = 3 * nodes_of_rank;
  const Matrix A = s.rows(s.A);
  const Matrix P_rows = unit::from_dense(MPI_COMM_WORLD, P, own * s.rank, own,
                                         coarse_of_rank, true);
  const std::string max_it = "-levels_mg_levels_ksp_max_it";
  REQUIRE(PetscOptionsSetValue(nullptr, max_it.c_str(), "0") == PETSC_SUCCESS);
  PetscHandle<PC, PCDestroy> pc;
  check(PCCreate(MPI_COMM_WORLD, pc.put()), "PCCreate");
  check(PCSetOperators(pc.get(), A.get(), A.get()), "PCSetOperators");
  set_levels(pc.get(), "levels_", A, {P_rows}, unit);
  check(PCSetUp(pc.get()), "PCSetUp");
  const VectorXd b = unit::random(s.num_dofs, 1, number);
  const Vector right = create_vector(MPI_COMM_WORLD, s.part(b));
  Vector x;
  check(VecDuplicate(right.get(), x.put()), "VecDuplicate");
  check(PCApply(pc.get(), right.get(), x.get()), "PCApply");
  check(PetscOptionsClearValue(nullptr, max_it.c_str()), "PetscOptions");
  const VectorXd expected = P * coarse.ldlt().solve(P.transpose() * b);
  CHECK(difference(local_values(x.get()), s.part(expected)) < 1e-10);
}
