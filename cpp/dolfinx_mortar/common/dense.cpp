// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "dense.h"
#include <Eigen/Dense>

using namespace dolfinx_mortar;
using Eigen::MatrixXd;
using Eigen::VectorXd;

//-----------------------------------------------------------------------------
Eigenpairs dolfinx_mortar::eigenpairs(const MatrixXd& A)
{
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(A);
  return {solver.eigenvalues(), solver.eigenvectors()};
}
//-----------------------------------------------------------------------------
Eigenpairs dolfinx_mortar::eigenpairs(const MatrixXd& A, const MatrixXd& B)
{
  const Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd> solver(A, B);
  return {solver.eigenvalues(), solver.eigenvectors()};
}
//-----------------------------------------------------------------------------
MatrixXd dolfinx_mortar::pseudo_inverse(const MatrixXd& A)
{
  return A.completeOrthogonalDecomposition().pseudoInverse();
}
//-----------------------------------------------------------------------------
VectorXd dolfinx_mortar::least_squares(const MatrixXd& A, const VectorXd& b)
{
  return A.completeOrthogonalDecomposition().solve(b);
}
//-----------------------------------------------------------------------------
MatrixXd dolfinx_mortar::lu_solve(const MatrixXd& A, const MatrixXd& B)
{
  return A.partialPivLu().solve(B);
}
//-----------------------------------------------------------------------------
MatrixXd dolfinx_mortar::left_null_space(const MatrixXd& A)
{
  const Eigen::JacobiSVD<MatrixXd> svd(A, Eigen::ComputeFullU);
  return svd.matrixU().rightCols(A.rows() - A.cols()).transpose();
}
