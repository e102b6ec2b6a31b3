// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "numbers.h"
#include <Eigen/Core>
#include <algorithm>
#include <dolfinx_mortar/assembly/petsc.h>
#include <limits>
#include <utility>
#include <vector>

// Distributed matrices and vectors as dense ones, the same on all ranks.

namespace unit
{
using Eigen::MatrixXd;
using Eigen::VectorXd;

inline MatrixXd random(Eigen::Index rows, Eigen::Index columns, Numbers& number)
{
  MatrixXd A(rows, columns);
  for (Eigen::Index i = 0; i < A.size(); ++i)
    A.data()[i] = number();
  return A;
}

/// @brief Solve A X = B by Gaussian elimination: plain, as this is what others
/// are compared with, and soon compiled.
/// @return X and the smallest pivot, by which one sees whether A is singular.
inline std::pair<MatrixXd, double> eliminate(MatrixXd A, MatrixXd B)
{
  const int n = A.rows(), m = B.cols();
  double smallest = std::numeric_limits<double>::infinity();
  for (int k = 0; k < n; ++k)
  {
    int pivot = k;
    for (int i = k; i < n; ++i)
      pivot = std::abs(A(i, k)) > std::abs(A(pivot, k)) ? i : pivot;
    A.row(k).swap(A.row(pivot));
    B.row(k).swap(B.row(pivot));
    smallest = std::min(smallest, std::abs(A(k, k)));
    for (int i = 0; i < n; ++i)
    {
      const double factor = A(i, k) / A(k, k);
      if (i == k or factor == 0)
        continue;
      for (int j = k; j < n; ++j)
        A(i, j) -= factor * A(k, j);
      for (int j = 0; j < m; ++j)
        B(i, j) -= factor * B(k, j);
    }
  }
  for (int i = 0; i < n; ++i)
    B.row(i) /= A(i, i);
  return {B, smallest};
}

inline MatrixXd solve(const MatrixXd& A, const MatrixXd& B)
{
  return eliminate(A, B).first;
}

/// All entries of a distributed matrix. Collective.
inline MatrixXd to_dense(Mat A)
{
  PetscInt rows, columns, begin, end;
  MatGetSize(A, &rows, &columns);
  MatGetOwnershipRange(A, &begin, &end);
  MatrixXd dense = MatrixXd::Zero(rows, columns);
  for (PetscInt i = begin; i < end; ++i)
  {
    const dolfinx_mortar::MatrixRow row(A, i);
    for (std::size_t k = 0; k < row.columns().size(); ++k)
      dense(i, row.columns()[k]) = row.values()[k];
  }
  MPI_Allreduce(MPI_IN_PLACE, dense.data(), dense.size(), MPI_DOUBLE, MPI_SUM,
                PetscObjectComm(reinterpret_cast<PetscObject>(A)));
  return dense;
}

/// Rows [row, row + num_rows) of a dense matrix as those of this rank; zeros
/// are left out, but for those on the diagonal where this is wanted.
/// Collective.
inline dolfinx_mortar::Matrix from_dense(MPI_Comm comm, const MatrixXd& dense,
                                         Eigen::Index row,
                                         Eigen::Index num_rows,
                                         Eigen::Index num_columns,
                                         bool diagonal = false)
{
  std::vector<PetscInt> offsets = {0}, columns;
  std::vector<double> values;
  for (Eigen::Index i = row; i < row + num_rows; ++i)
  {
    for (Eigen::Index k = 0; k < dense.cols(); ++k)
    {
      if (dense(i, k) != 0 or (diagonal and i == k))
      {
        columns.push_back(k);
        values.push_back(dense(i, k));
      }
    }
    offsets.push_back(columns.size());
  }
  return dolfinx_mortar::create_from_rows(comm, num_rows, num_columns, offsets,
                                          columns, values);
}
} // namespace unit
