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
  auto difference = [](const Matrix& A, const MatrixXd& expected)
  { return (unit::to_dense(A.get()) - expected).cwiseAbs().maxCoeff(); };
  std::vector<RowTerm> terms;
  for (const Matrix& A : sparse)
    terms.push_back({A.get()});
  CHECK(difference(combine_rows(terms), dense[0] + dense[1] + dense[2])
        < 1e-15);

  // Some rows of one matrix only, times a factor; some unit rows
  std::vector<std::int8_t> flags;
  std::vector<double> factors;
  std::vector<std::int32_t> units;
  MatrixXd expected = MatrixXd::Zero(num * size, num * size);
  for (int i = 0; i < num * size; ++i)
  {
    const bool take = i % 5 > 1, unit = i % 7 == 3;
    const double factor = 1 + i % 2;
    if (unit)
      expected(i, i) = 1;
    else
    {
      expected.row(i) = dense[1].row(i) + dense[2].row(i);
      if (take)
        expected.row(i) += dense[0].row(i);
      expected.row(i) *= factor;
    }
    if (i / num != rank)
      continue;
    flags.push_back(take);
    factors.push_back(factor);
    if (unit)
      units.push_back(i % num);
  }
  terms[0].rows = flags;
  const Matrix some = combine_rows(terms, factors, units);
  CHECK(difference(some, expected) < 1e-15);
  PetscInt block_size;
  MatGetBlockSize(some.get(), &block_size);
  CHECK(block_size == 3);

  factors.pop_back();
  CHECK_THROWS_AS(combine_rows(terms, factors, units), std::invalid_argument);
}
