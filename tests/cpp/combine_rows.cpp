// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "dense.h"
#include <array>
#include <catch2/catch_test_macros.hpp>
#include <dolfinx_mortar/solver/combine_rows.h>
#include <stdexcept>

using namespace dolfinx_mortar;
using unit::MatrixXd;

namespace
{
/// Rows of each rank: two nodes.
constexpr int num = 6;
} // namespace

TEST_CASE("rows of several matrices are combined", "[mpi]")
{
  const MPI_Comm comm = MPI_COMM_WORLD;
  int rank, size;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &size);
  unit::Numbers number(5);
  // Sparse rows of all, and rows that are empty in the others
  std::array<MatrixXd, 3> dense;
  std::array<Matrix, 3> sparse;
  for (int k = 0; k < 3; ++k)
  {
    dense[k] = unit::random(num * size, num * size, number);
    dense[k] = (dense[k].array().abs() < 0.5).select(0, dense[k]);
    for (int i = 0; i < num * size; ++i)
    {
      if (k > 0 and (i + k) % 3 == 0)
        dense[k].row(i).setZero();
    }
    sparse[k] = unit::from_dense(comm, dense[k], num * rank, num, num);
  }
  const std::array<Mat, 2> others = {sparse[1].get(), sparse[2].get()};

  const Matrix all = combine_rows(sparse[0].get(), others, {});
  CHECK((unit::to_dense(all.get()) - dense[0] - dense[1] - dense[2])
            .cwiseAbs()
            .maxCoeff()
        < 1e-15);

  std::vector<RowSource> sources;
  MatrixXd expected = MatrixXd::Zero(num * size, num * size);
  for (int i = 0; i < num * size; ++i)
  {
    const RowSource source = static_cast<RowSource>(i % 5 % 3);
    if (i / num == rank)
      sources.push_back(source);
    if (source == RowSource::unit)
      expected(i, i) = 1;
    else
      expected.row(i) = dense[1].row(i) + dense[2].row(i);
    if (source == RowSource::all)
      expected.row(i) += dense[0].row(i);
  }
  const Matrix some = combine_rows(sparse[0].get(), others, sources);
  CHECK((unit::to_dense(some.get()) - expected).cwiseAbs().maxCoeff() < 1e-15);
  PetscInt block_size;
  MatGetBlockSize(some.get(), &block_size);
  CHECK(block_size == 3);

  sources.pop_back();
  CHECK_THROWS_AS(combine_rows(sparse[0].get(), others, sources),
                  std::invalid_argument);
}
