// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <Eigen/Core>

/// Decompositions of small dense matrices of any size. Each of Eigen's takes up
/// to half a minute to compile in every file that uses it: here is the one.

namespace dolfinx_mortar
{
/// @brief Eigenvalues, increasing, and the eigenvectors as columns.
struct Eigenpairs
{
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};

/// @brief Solutions of A v = lambda v with |v| = 1, where A is symmetric.
Eigenpairs eigenpairs(const Eigen::MatrixXd& A);

/// @brief Solutions of A v = lambda B v with v . B v = 1, where A is symmetric,
/// B symmetric and positive definite.
Eigenpairs eigenpairs(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);

/// @brief The Moore-Penrose inverse of A.
Eigen::MatrixXd pseudo_inverse(const Eigen::MatrixXd& A);

/// @brief The x of least norm among those of least |A x - b|.
Eigen::VectorXd least_squares(const Eigen::MatrixXd& A,
                              const Eigen::VectorXd& b);

/// @brief The solution X of A X = B, where A is square and regular.
Eigen::MatrixXd lu_solve(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);

/// @brief An orthonormal basis, by rows, of the y with y A = 0.
/// @param[in] A Matrix of full column rank, with more rows than columns.
Eigen::MatrixXd left_null_space(const Eigen::MatrixXd& A);
} // namespace dolfinx_mortar
