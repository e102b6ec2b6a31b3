// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "dense.h"
#include <catch2/catch_test_macros.hpp>
#include <catch2/generators/catch_generators.hpp>
#include <dolfinx_mortar/solver/convergence_error.h>
#include <dolfinx_mortar/solver/elimination.h>
#include <dolfinx_mortar/solver/linear_solver.h>
#include <dolfinx_mortar/solver/solver_options.h>

using namespace dolfinx_mortar;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using unit::MatrixXd;
using unit::VectorXd;

namespace
{
/// Displacement nodes and multipliers of a rank: nodes 0 to 3 are masters or
/// within the body, node 4 has the multipliers `multipliers_at_4`, nodes 5 to 9
/// one each.
constexpr int num_nodes_of_rank = 10;

/// A small linearised problem with all kinds of nodes, as dense matrices that
/// all ranks have, and as the system of the library.
struct SmallProblem
{
  NewtonSystem system;
  MatrixXd K, K_c, B, C_u, C_z;
  VectorXd r;
  std::vector<int> fixed; // on all ranks
  int size_u, size_z;     // on all ranks
  std::vector<double> x;  // positions of this rank's nodes

  /// @param[in] at_edge Number of multipliers at the node on an edge.
  /// @param[in] coupled Whether these depend on each other.
  /// @param[in] tied Ties instead of contacts.
  SmallProblem(int at_edge, bool coupled, bool tied);

  /// Solution of the saddle point problem.
  VectorXd solve() const
  {
    MatrixXd A(size_u + size_z, size_u + size_z);
    A << K + K_c, B.transpose(), C_u, C_z;
    for (int dof : fixed)
    {
      A.row(dof).setZero();
      A(dof, dof) = 1;
    }
    return unit::solve(A, r);
  }

  /// [r_u, r_z] of this rank.
  std::vector<double> local(const VectorXd& v) const
  {
    int rank;
    MPI_Comm_rank(system.comm, &rank);
    std::vector<double> part(v.data() + rank * system.size_u,
                             v.data() + (rank + 1) * system.size_u);
    const double* z = v.data() + size_u + rank * system.size_z;
    part.insert(part.end(), z, z + system.size_z);
    return part;
  }
};

SmallProblem::SmallProblem(int at_edge, bool coupled, bool tied)
{
  const MPI_Comm comm = MPI_COMM_WORLD;
  int rank, size;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &size);
  unit::Numbers number(100 + 10 * at_edge + coupled);
  const int n = num_nodes_of_rank, m = at_edge + 5;
  size_u = 3 * n * size;
  size_z = 3 * m * size;
  NewtonSystem& s = system;
  s.comm = comm;
  s.size_u = 3 * n;
  s.size_z = 3 * m;
  s.tied = tied;

  // Not symmetric: condensation may not need that
  K = 0.3 * unit::random(size_u, size_u, number);
  K.diagonal().array() += 6;
  K_c = 0.2 * unit::random(size_u, size_u, number);
  MatrixXd B_tilde = MatrixXd::Zero(size_z, size_u),
           T = MatrixXd::Identity(size_u, size_u);
  C_u = MatrixXd::Zero(size_z, size_u);
  C_z = MatrixXd::Zero(size_z, size_z);
  r = unit::random(size_u + size_z, 1, number);
  for (int q = 0; q < size; ++q)
  {
    const int u0 = n * q, z0 = m * q;
    // Nodes 8 and 9 are on edges between 5, 6 and 7, as in quadratic facets
    for (auto [edge, a, b, alpha] :
         {std::tuple(8, 5, 6, 0.2), std::tuple(9, 6, 7, 1.0 / 12)})
    {
      for (int c = 0; c < 3; ++c)
      {
        const int e = 3 * (u0 + edge) + c;
        T(e, 3 * (u0 + a) + c) = T(e, 3 * (u0 + b) + c) = alpha;
        T(e, e) = 1 - 2 * alpha;
      }
    }
    std::vector<int> own_fixed = {3 * u0 + 1, 3 * (u0 + 9) + 2};
    if (!coupled)
      own_fixed.push_back(3 * (u0 + 6));
    for (int j = 0; j < m; ++j)
    {
      const int own = j < at_edge ? 4 : 5 + j - at_edge;
      const double d = 0.4 + 0.1 * j;
      Vector3d normal = Vector3d(number(), number(), number());
      // Normals at an edge are not alike
      if (j < at_edge)
        normal = 0.2 * normal + Vector3d::Unit(j);
      normal.normalize();
      const Matrix3d nn = normal * normal.transpose(),
                     P = Matrix3d::Identity() - nn;
      // The last node is open; others slide, stick, or rub
      const bool open = own == 7;
      Matrix3d dz = Matrix3d::Zero(), directions = Matrix3d::Identity();
      bool stick = true;
      if (!tied and own != 8 and !open and !(coupled and own == 4))
      {
        dz = P;
        directions = nn;
        stick = false;
        if (own == 6)
          dz += 0.1 * unit::random(3, 3, number);
      }
      if (coupled and own == 4)
        dz = P + 0.1 * unit::random(3, 3, number);
      if (open)
        dz.setIdentity();

      // Masters are the inner nodes of all ranks
      for (int c = 0; c < 3; ++c)
        B_tilde(3 * (z0 + j) + c, 3 * (u0 + own) + c) = d;
      for (int p = 0; p < size; ++p)
      {
        for (int k = 0; k < 4; ++k)
        {
          const double value = 0.2 * number();
          for (int c = 0; c < 3; ++c)
            B_tilde(3 * (z0 + j) + c, 3 * (n * p + k) + c) = value;
        }
      }
      std::array<std::int8_t, 3> active;
      for (int c = 0; c < 3; ++c)
      {
        active[c] = !open
                    and std::ranges::find(own_fixed, 3 * (u0 + own) + c)
                            == own_fixed.end();
        if (!active[c])
          dz.row(c) = Vector3d::Unit(c);
      }
      for (int c = 0; c < 3; ++c)
      {
        const int row = 3 * (z0 + j) + c;
        if (active[c])
        {
          // Mostly the normal, or all of the motion
          C_u.row(row) = 0.05 * unit::random(1, size_u, number);
          const Matrix3d toward = tied or stick ? Matrix3d::Identity() : nn;
          for (int e = 0; e < 3; ++e)
          {
            C_u(row, 3 * (u0 + own) + e) += toward(c, e);
            C_u(row, 3 * u0 + e) -= toward(c, e);
          }
        }
        C_z.block<1, 3>(row, 3 * (z0 + j)) = dz.row(c);
      }
      if (q == rank)
      {
        MultiplierNodes& nodes = s.nodes;
        nodes.active.insert(nodes.active.end(), active.begin(), active.end());
        nodes.own.push_back(own);
        nodes.diagonal.push_back(d);
        nodes.dz.push_back(dz);
        nodes.directions.push_back(directions);
        nodes.across.push_back(Matrix3d::Zero());
        nodes.normals.push_back(normal);
        nodes.stick.push_back(stick);
      }
    }
    if (coupled)
    {
      for (int i = 0; i < at_edge; ++i)
      {
        for (int k = 0; k < at_edge; ++k)
        {
          if (i == k)
            continue;
          const Matrix3d block = 0.1 * unit::random(3, 3, number);
          C_z.block<3, 3>(3 * (z0 + i), 3 * (z0 + k)) = block;
          if (q == rank)
            s.nodes.coupled.push_back({i, k, block});
        }
      }
    }
    for (int dof : own_fixed)
    {
      fixed.push_back(dof);
      if (q == rank)
        s.fixed.push_back(dof - 3 * u0);
    }
  }
  std::ranges::sort(s.fixed);
  B = B_tilde * unit::solve(T, MatrixXd::Identity(size_u, size_u));
  B = (B.array().abs() < 1e-14).select(0, B);
  const MatrixXd T_minus_one = T - MatrixXd::Identity(size_u, size_u);
  auto rows = [&](const MatrixXd& A, bool of_z, bool by_z)
  {
    const int own = of_z ? s.size_z : s.size_u;
    // PETSc wants a diagonal for unit rows, as the library's own matrices have
    return unit::from_dense(comm, A, own * rank, own,
                            by_z ? s.size_z : s.size_u, of_z and by_z);
  };
  s.K = rows(K, false, false);
  s.K_c = rows(K_c, false, false);
  s.B = rows(B, true, false);
  s.B_tilde = rows(B_tilde, true, false);
  s.T_minus_one = rows(T_minus_one, false, false);
  s.C_u = rows(C_u, true, false);
  s.C_z = rows(C_z, true, true);
  for (int i = 0; i < 3 * n; ++i)
    x.push_back(number());
}

/// Largest difference of the entries of this rank, relative to the largest of
/// these.
double difference(const std::vector<double>& a, const std::vector<double>& b)
{
  REQUIRE(a.size() == b.size());
  double d = 0, size = 1;
  for (std::size_t i = 0; i < a.size(); ++i)
  {
    d = std::abs(a[i] - b[i]) <= d ? d : std::abs(a[i] - b[i]);
    size = std::max(size, std::abs(b[i]));
  }
  return d / size;
}

std::vector<double> solution(const SmallProblem& p, bool condense,
                             std::map<std::string, std::string> given = {})
{
  SolverOptions options("unit_condensation_", std::move(given));
  const SolverOptions::Loan loan(options);
  LinearSolver solver(p.system.comm, options.prefix(), condense, p.x);
  return solver.solve(p.system, p.local(p.r));
}
} // namespace

TEST_CASE("condensed and saddle point systems have the dense solution", "[mpi]")
{
  // Up to three multipliers at a displacement node, as where patches meet
  const auto [at_edge, coupled, tied]
      = GENERATE(std::tuple(1, false, true), std::tuple(1, false, false),
                 std::tuple(2, false, false), std::tuple(2, true, false),
                 std::tuple(3, false, false));
  CAPTURE(at_edge, coupled, tied);
  const SmallProblem p(at_edge, coupled, tied);
  const VectorXd exact = p.solve();
  REQUIRE(exact.allFinite());
  INFO("largest value " << exact.cwiseAbs().maxCoeff());
  const std::vector<double> expected = p.local(exact), r = p.local(p.r);
  CHECK(difference(solution(p, true), expected) < 1e-9);
  CHECK(difference(solution(p, false), expected) < 1e-9);
  CHECK(difference(p.system.multiply(expected), r) < 1e-11);
}

TEST_CASE("a Krylov solver of products has the dense solution", "[mpi]")
{
  const SmallProblem p(2, false, false);
  const std::vector<double> expected = p.local(p.solve());
  CHECK(difference(solution(p, true,
                            {{"ksp_type", "gmres"},
                             {"ksp_rtol", "1e-12"},
                             {"pc_type", "none"}}),
                   expected)
        < 1e-7);
}

TEST_CASE("equations of a node determine its multipliers", "[mpi]")
{
  // For a ρ and c that fit: dz = L ρ + L_c c, and G c - H ρ = 0
  const int at_edge = GENERATE(1, 2, 3);
  const SmallProblem p(at_edge, at_edge == 2, false);
  const MultiplierNodes& nodes = p.system.nodes;
  const Elimination e = eliminate(p.system.comm, nodes, p.system.size_u);
  unit::Numbers number(9);
  VectorXd dz = unit::random(p.system.size_z, 1, number);
  for (int i = 0; i < dz.size(); ++i)
    dz[i] *= nodes.active[i];
  VectorXd rho = VectorXd::Zero(p.system.size_u),
           c = VectorXd::Zero(p.system.size_z);
  for (std::size_t j = 0; j < nodes.size(); ++j)
  {
    rho.segment<3>(3 * nodes.own[j])
        += nodes.diagonal[j] * dz.segment<3>(3 * j);
    c.segment<3>(3 * j) += nodes.dz[j] * dz.segment<3>(3 * j);
  }
  for (const auto& other : nodes.coupled)
    c.segment<3>(3 * other.row) += other.dz * dz.segment<3>(3 * other.column);
  auto product = [](const Matrix& A, const VectorXd& x)
  {
    if (!A)
      return VectorXd(VectorXd::Zero(x.size()));
    const std::vector<double> y = multiply(
        A.get(), std::span(x.data(), static_cast<std::size_t>(x.size())));
    return VectorXd(Eigen::Map<const VectorXd>(y.data(), y.size()));
  };
  CHECK(bool(e.L_c) == (at_edge > 1));
  CHECK((product(e.L, rho) + product(e.L_c, c) - dz).norm() < 1e-11);
  CHECK((product(e.G, c) - product(e.H, rho)).norm() < 1e-11);
  // The weight of a node is the sum of its multipliers'
  for (int i = 0; i < p.system.size_u; ++i)
  {
    double weight = 0;
    for (std::size_t j = 0; j < nodes.size(); ++j)
    {
      if (nodes.own[j] == i / 3 and nodes.active[3 * j + i % 3])
        weight += nodes.diagonal[j];
    }
    CHECK(unit::close(e.weight[i], weight, 1e-14));
    CHECK((e.own[i] != 0) == (weight > 0));
  }
}

TEST_CASE("a multiplier without weight is refused on all ranks", "[mpi]")
{
  // As of a node in contact that no master covers
  SmallProblem p(1, false, false);
  int rank;
  MPI_Comm_rank(p.system.comm, &rank);
  if (rank == 0)
    p.system.nodes.diagonal[0] = 0;
  std::string message;
  try
  {
    solution(p, true);
  }
  catch (const ConvergenceError& e)
  {
    message = e.what();
  }
  CHECK(message.starts_with("No master covers a slave node"));
}
