// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "dense.h"
#include <catch2/catch_test_macros.hpp>
#include <dolfinx_mortar/assembly/petsc.h>
#include <stdexcept>
#include <string>

using namespace dolfinx_mortar;
using unit::MatrixXd;
using unit::VectorXd;

namespace
{
PetscInt references(Vec x)
{
  PetscInt count;
  PetscObjectGetReference(reinterpret_cast<PetscObject>(x), &count);
  return count;
}

int rank_of(MPI_Comm comm)
{
  int rank;
  MPI_Comm_rank(comm, &rank);
  return rank;
}

int size_of(MPI_Comm comm)
{
  int size;
  MPI_Comm_size(comm, &size);
  return size;
}

/// Rows and columns of each rank.
constexpr int m = 4, n = 3;

/// A matrix, dense and distributed, with some zeros.
std::pair<MatrixXd, Matrix> example(int rows, int columns, unsigned seed)
{
  const MPI_Comm comm = MPI_COMM_WORLD;
  unit::Numbers number(seed);
  MatrixXd dense
      = unit::random(rows * size_of(comm), columns * size_of(comm), number);
  dense = (dense.array().abs() < 0.4).select(0, dense);
  Matrix A = unit::from_dense(comm, dense, rows * rank_of(comm), rows, columns);
  return {dense, A};
}

/// The part of this rank.
std::vector<double> local(const VectorXd& v)
{
  const int size = v.size() / size_of(MPI_COMM_WORLD);
  const double* begin = v.data() + size * rank_of(MPI_COMM_WORLD);
  return {begin, begin + size};
}

double distance(const MatrixXd& A, const Matrix& B)
{
  return (A - unit::to_dense(B.get())).cwiseAbs().maxCoeff();
}

double distance(const VectorXd& v, const std::vector<double>& w)
{
  const std::vector<double> own = local(v);
  REQUIRE(own.size() == w.size());
  double d = 0;
  for (std::size_t i = 0; i < w.size(); ++i)
    d = std::max(d, std::abs(own[i] - w[i]));
  return d;
}
} // namespace

TEST_CASE("handles share and give up objects", "[mpi]")
{
  Vector x = create_vector(MPI_COMM_WORLD, std::vector<double>{1, 2});
  REQUIRE(x);
  CHECK(references(x.get()) == 1);
  {
    Vector copy = x;
    CHECK(copy.get() == x.get());
    CHECK(references(x.get()) == 2);
    Vector moved = std::move(copy);
    CHECK(!copy);
    CHECK(references(x.get()) == 2);
    copy = moved;
    CHECK(references(x.get()) == 3);
    copy = copy;
    CHECK(references(x.get()) == 3);
    moved.reset();
    CHECK(!moved);
    CHECK(references(x.get()) == 2);
    // A new object takes the place of the last one
    REQUIRE(VecDuplicate(x.get(), copy.put()) == PETSC_SUCCESS);
    CHECK(copy.get() != x.get());
    CHECK(references(x.get()) == 1);
  }
  CHECK(references(x.get()) == 1);
  CHECK(local_values(x.get()) == std::vector<double>{1, 2});
}

TEST_CASE("errors of PETSc become exceptions", "[mpi]")
{
  const PetscErrorText quiet;
  Vector x = create_vector(MPI_COMM_WORLD, std::vector<double>{1, 2});
  Vector y = create_vector(MPI_COMM_WORLD, std::vector<double>{1});
  try
  {
    check(VecAXPY(x.get(), 1.0, y.get()), "VecAXPY");
    FAIL("no error");
  }
  catch (const std::runtime_error& e)
  {
    CHECK(std::string(e.what()).find("VecAXPY") != std::string::npos);
  }
}

TEST_CASE("operations on matrices agree with dense ones", "[mpi]")
{
  const auto [dense_A, A] = example(m, n, 1);
  const auto [dense_B, B] = example(n, m, 2);
  const auto [dense_C, C] = example(m, n, 3);
  CHECK(distance(dense_A, A) == 0);
  CHECK(local_size(A.get()) == std::pair<PetscInt, PetscInt>(m, n));
  CHECK(distance(dense_A * dense_B, multiply(A.get(), B.get())) < 1e-13);
  CHECK(distance(dense_A.transpose(), transpose(A.get())) == 0);

  unit::Numbers number(4);
  const VectorXd x = unit::random(dense_A.cols(), 1, number),
                 y = unit::random(dense_A.rows(), 1, number);
  CHECK(distance(dense_A * x, multiply(A.get(), local(x))) < 1e-13);
  CHECK(
      distance(dense_A.transpose() * y, multiply_transposed(A.get(), local(y)))
      < 1e-13);

  Matrix sum = duplicate(A.get());
  add(sum.get(), -2.0, C.get());
  CHECK(distance(dense_A - 2 * dense_C, sum) < 1e-14);
  scale_rows(sum.get(), local(y));
  scale_columns(sum.get(), local(x));
  CHECK(distance(y.asDiagonal() * (dense_A - 2 * dense_C) * x.asDiagonal(), sum)
        < 1e-14);
  CHECK(distance(dense_A, A) == 0);

  const Matrix square = multiply(A.get(), B.get());
  CHECK(
      distance(VectorXd((dense_A * dense_B).diagonal()), diagonal(square.get()))
      < 1e-13);
}

TEST_CASE("entries of one place are added up", "[mpi]")
{
  const MPI_Comm comm = MPI_COMM_WORLD;
  const std::vector<Entry> entries
      = {{1, 2, 3.0}, {0, 1, 1.0}, {1, 2, -0.5}, {1, 0, 2.0}};
  const Matrix A = create_from_entries(comm, 2, 3, entries);
  MatrixXd dense = MatrixXd::Zero(2 * size_of(comm), 3 * size_of(comm));
  for (int r = 0; r < size_of(comm); ++r)
    dense.block(2 * r, 3 * r, 2, 3) << 0, 1, 0, 2, 0, 2.5;
  CHECK(distance(dense, A) == 0);
}

TEST_CASE("sums and extremes over all ranks", "[mpi]")
{
  const MPI_Comm comm = MPI_COMM_WORLD;
  const int rank = rank_of(comm), size = size_of(comm);
  CHECK(sum(comm, 1.5) == 1.5 * size);
  CHECK(sum(comm, std::int64_t{1} << 40) == (std::int64_t{1} << 40) * size);
  CHECK(sum(comm, std::vector<double>{1, double(rank)})
        == std::vector<double>{double(size), size * (size - 1) / 2.0});
  CHECK(max(comm, double(rank)) == size - 1);
  CHECK(min(comm, double(rank)) == 0);
  CHECK(any(comm, rank == size - 1));
  CHECK(!any(comm, false));
  CHECK(first_of_rank(comm, rank + 1) == rank * (rank + 1) / 2);
  const std::vector<double> values = {3, rank == 0 ? -4.0 : 0};
  CHECK(unit::close(norm(comm, values), std::sqrt(16 + 9.0 * size), 1e-14));
  CHECK(max_norm(comm, values) == 4);
}
