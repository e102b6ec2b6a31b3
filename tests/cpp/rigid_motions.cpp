// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "dense.h"
#include <catch2/catch_test_macros.hpp>
#include <dolfinx_mortar/solver/rigid_motions.h>
#include <dolfinx_mortar/solver/support.h>

using namespace dolfinx_mortar;
using unit::MatrixXd;
using unit::VectorXd;

namespace
{
/// Two bodies in one mesh: the corners of two boxes, dealt out to the ranks.
/// Corner k of box p is at (p + bit 0 of k, bit 1, bit 2).
struct Boxes
{
  Coupling coupling;
  std::vector<std::array<int, 2>> own; // box and corner of each owned node
  std::vector<double> u;

  Boxes()
  {
    int rank, size;
    Layout& l = coupling.layout;
    l.comm = MPI_COMM_WORLD;
    MPI_Comm_rank(l.comm, &rank);
    MPI_Comm_size(l.comm, &size);
    for (int i = rank; i < 16; i += size)
    {
      const int box = i / 8, k = i % 8;
      own.push_back({box, k});
      l.parts.push_back(box);
      for (int x : {2 * box + (k & 1), k >> 1 & 1, k >> 2})
        l.X.push_back(x);
    }
    l.num_parts = 2;
    l.num_owned = l.num_local = {static_cast<std::int32_t>(own.size())};
    l.first_block = first_of_rank(l.comm, own.size());
    l.blocks.resize(1);
    for (std::size_t k = 0; k < own.size(); ++k)
      l.blocks[0].push_back(l.first_block + k);
    l.cell_sizes = {1};
    u.resize(3 * own.size(), 0.0);
  }

  /// Hold components of a corner of a box.
  void hold(int box, int corner, std::initializer_list<int> components)
  {
    for (std::size_t k = 0; k < own.size(); ++k)
    {
      if (own[k] == std::array{box, corner})
      {
        for (int c : components)
          coupling.fixed_dofs.push_back(3 * k + c);
      }
    }
    std::ranges::sort(coupling.fixed_dofs);
  }

  Eigen::Index num_free() const { return free_motions(coupling, u).cols(); }
};
} // namespace

TEST_CASE("motions that conditions leave free are counted", "[mpi]")
{
  Boxes boxes;
  CHECK(boxes.num_free() == 12);
  CHECK(!is_held(boxes.coupling));
  // A point held: rotations about it. An edge: one. A third point: none.
  boxes.hold(0, 0, {0, 1, 2});
  CHECK(boxes.num_free() == 6 + 3);
  boxes.hold(0, 1, {0, 1, 2});
  CHECK(boxes.num_free() == 6 + 1);
  boxes.hold(0, 2, {2});
  CHECK(boxes.num_free() == 6);
  // A plane of the other one held in its normal direction: it slides and turns
  for (int corner : {0, 1, 2, 3})
    boxes.hold(1, corner, {2});
  CHECK(boxes.num_free() == 3);
  boxes.hold(1, 0, {0});
  boxes.hold(1, 0, {1});
  CHECK(boxes.num_free() == 1);
  boxes.hold(1, 3, {1});
  CHECK(boxes.num_free() == 0);
  CHECK(is_held(boxes.coupling));
}

TEST_CASE("free motions are rigid, of one body each, and hold what is held",
          "[mpi]")
{
  Boxes boxes;
  boxes.hold(0, 0, {0, 1, 2});
  // From a configuration that is deformed
  for (std::size_t k = 0; k < boxes.own.size(); ++k)
  {
    const double* X = boxes.coupling.layout.X.data() + 3 * k;
    boxes.u[3 * k] = 0.5 * X[1];
    boxes.u[3 * k + 2] = X[0] * X[2];
  }
  const MatrixXd motions = free_motions(boxes.coupling, boxes.u);
  REQUIRE(motions.cols() == 9);
  for (std::int32_t dof : boxes.coupling.fixed_dofs)
    CHECK(motions.row(dof).norm() < 1e-12);
  // All of them are linear combinations of u = a + b × x of a body
  MatrixXd rigid = MatrixXd::Zero(boxes.u.size(), 12);
  for (std::size_t k = 0; k < boxes.own.size(); ++k)
  {
    const Eigen::Vector3d x
        = Eigen::Vector3d(boxes.coupling.layout.X.data() + 3 * k)
          + Eigen::Vector3d(boxes.u.data() + 3 * k);
    for (int d = 0; d < 3; ++d)
    {
      rigid.block<3, 1>(3 * k, 6 * boxes.own[k][0] + d)
          = Eigen::Vector3d::Unit(d);
      rigid.block<3, 1>(3 * k, 6 * boxes.own[k][0] + 3 + d)
          = Eigen::Vector3d::Unit(d).cross(x);
    }
  }
  const MatrixXd gram
      = sum(MPI_COMM_WORLD, MatrixXd(rigid.transpose() * rigid)),
      product = sum(MPI_COMM_WORLD, MatrixXd(rigid.transpose() * motions));
  CHECK((rigid * unit::solve(gram, product) - motions).cwiseAbs().maxCoeff()
        < 1e-11);
  // Independent of each other
  const MatrixXd own
      = sum(MPI_COMM_WORLD, MatrixXd(motions.transpose() * motions));
  CHECK(unit::eliminate(own, own).second > 1e-3);
  for (int j = 0; j < motions.cols(); ++j)
  {
    double size[2] = {0, 0};
    for (std::size_t k = 0; k < boxes.own.size(); ++k)
    {
      size[boxes.own[k][0]] += motions.block<3, 1>(3 * k, j).squaredNorm();
    }
    const double first = sum(MPI_COMM_WORLD, size[0]),
                 second = sum(MPI_COMM_WORLD, size[1]);
    CHECK(std::min(first, second) == 0);
  }
}

TEST_CASE("springs leave some motions without resistance", "[mpi]")
{
  Boxes boxes;
  const MatrixXd motions = free_motions(boxes.coupling, boxes.u);
  const MPI_Comm comm = MPI_COMM_WORLD;
  // Springs along z at all corners of the first box; the second is rigid but
  // for a stiffness that no rigid motion feels
  std::vector<Entry> entries;
  for (std::size_t k = 0; k < boxes.own.size(); ++k)
  {
    const std::int32_t dof = 3 * k + 2;
    for (int c = 0; c < 3; ++c)
      entries.push_back({static_cast<std::int32_t>(3 * k + c),
                         static_cast<std::int32_t>(3 * k + c), 0.0});
    if (boxes.own[k][0] == 0)
      entries.push_back({dof, dof, 5.0});
  }
  const std::int32_t size = boxes.u.size();
  const Matrix springs = create_from_entries(comm, size, size, entries);
  // A stiffness everywhere, I less its projection on the rigid motions
  const MatrixXd gram = sum(comm, MatrixXd(motions.transpose() * motions));
  MatrixXd all = MatrixXd::Zero(48, motions.cols());
  const std::int64_t first = 3 * boxes.coupling.layout.first_block;
  all.middleRows(first, size) = motions;
  all = sum(comm, all);
  MatrixXd dense
      = MatrixXd::Identity(48, 48) - all * unit::solve(gram, all.transpose());
  dense += unit::to_dense(springs.get());
  const Matrix K = unit::from_dense(comm, dense, first, size, size);
  // Six of the second box; of the first one along x, along y, about z
  const MatrixXd loose = unresisted(boxes.coupling, motions, K.get());
  REQUIRE(loose.cols() == 9);
  for (int j = 0; j < loose.cols(); ++j)
  {
    const std::vector<double> f = multiply(
        K.get(), {loose.col(j).data(), static_cast<std::size_t>(size)});
    CHECK(max_norm(comm, f)
          < 1e-9
                * max_norm(comm, {loose.col(j).data(),
                                  static_cast<std::size_t>(size)}));
  }
}

TEST_CASE("small dense matrices are summed over ranks", "[mpi]")
{
  int rank, size;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  MatrixXd A(2, 3);
  A << 1, 2, 3, 4, 5, rank;
  MatrixXd total = size * A;
  total(1, 2) = size * (size - 1) / 2;
  CHECK(sum(MPI_COMM_WORLD, A) == total);
}
