// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "dense.h"
#include <catch2/catch_test_macros.hpp>
#include <dolfinx_mortar/assembly/blocks.h>
#include <stdexcept>

using namespace dolfinx_mortar;
using unit::MatrixXd;

namespace
{
/// Number of rows, or columns, in nodes of each rank.
constexpr int own_rows = 2, own_columns = 3;

/// Let each rank add blocks anywhere, and compare with dense sums.
/// @return Largest difference.
template <int R, int C>
double difference_from_dense(std::uint32_t seed)
{
  constexpr bool scalar = R == 1 and C == 1;
  constexpr int m = scalar ? 3 : R, n = scalar ? 3 : C;
  int rank, size;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  MatrixXd dense = MatrixXd::Zero(m * own_rows * size, n * own_columns * size);
  BlockAccumulator<R, C> blocks;
  // All ranks do the additions of all ranks to the dense matrix
  for (int r = 0; r < size; ++r)
  {
    unit::Numbers number(seed + r);
    auto any = [&](int limit)
    { return static_cast<std::int64_t>((number() + 1) / 2 * limit); };
    for (int i = 0; i < 10; ++i)
    {
      // A negative number is left out, one node may be there twice
      std::vector<std::int64_t> rows
          = {any(own_rows * size), -1, any(own_rows * size)};
      std::vector<std::int64_t> columns
          = {any(own_columns * size), any(own_columns * size), -1,
             any(own_columns * size)};
      std::vector<double> values(R * rows.size() * C * columns.size());
      for (double& v : values)
        v = number();
      const double factor = i % 2 ? 1 : number();
      for (std::size_t a = 0; a < rows.size(); ++a)
      {
        for (std::size_t b = 0; b < columns.size(); ++b)
        {
          if (rows[a] < 0 or columns[b] < 0)
            continue;
          for (int c = 0; c < m; ++c)
          {
            for (int d = 0; d < n; ++d)
            {
              const double value
                  = scalar
                        ? (c == d ? values[a * columns.size() + b] : 0.0)
                        : values[(R * a + c) * C * columns.size() + C * b + d];
              dense(m * rows[a] + c, n * columns[b] + d) += factor * value;
            }
          }
        }
      }
      if (r == rank)
        blocks.add(rows, columns, values.data(), factor);
    }
  }
  const Matrix A
      = blocks.assemble(MPI_COMM_WORLD, m * own_rows, n * own_columns);
  const double difference
      = (unit::to_dense(A.get()) - dense).cwiseAbs().maxCoeff();
  // What was added is forgotten
  const Matrix none
      = blocks.assemble(MPI_COMM_WORLD, m * own_rows, n * own_columns);
  return std::max(difference, unit::to_dense(none.get()).norm());
}
} // namespace

TEST_CASE("blocks of all ranks are added up", "[mpi]")
{
  for (std::uint32_t seed : {1, 100, 200})
  {
    CHECK(difference_from_dense<3, 3>(seed) < 1e-13);
    CHECK(difference_from_dense<1, 1>(seed) < 1e-13);
  }
}

TEST_CASE("a row beyond the matrix is refused on all ranks", "[mpi]")
{
  int rank, size;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  BlockAccumulator<1, 1> blocks;
  const double one = 1;
  if (rank == 0)
    blocks.add(2 * size, 0, &one);
  CHECK_THROWS_AS(blocks.assemble(MPI_COMM_WORLD, 6, 6), std::runtime_error);
}
