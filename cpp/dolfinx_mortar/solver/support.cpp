// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "support.h"
#include "first_contact.h"
#include "rigid_motions.h"
#include <algorithm>
#include <cmath>
#include <dolfinx_mortar/common/dense.h>
#include <numbers>
#include <numeric>

using namespace dolfinx_mortar;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace
{
/// Share of the loads that must be left over: bodies are not rigid.
constexpr double left_over = 0.01;

/// Sides of the pyramid around the cone of friction.
constexpr int num_sides = 16;

/// Rates of work that tractions along the edges of the nodes' pyramids do.
/// @param[in] relative Relative motions at owned nodes, shape (3 n, motions).
void append_edges(const CoupledInterface& c, const Basis& basis,
                  std::span<const double> normals, double friction,
                  const MatrixXd& relative, std::vector<VectorXd>& edges)
{
  const double bound = friction / std::cos(std::numbers::pi / num_sides);
  for (std::int32_t k = 0; k < c.num_owned(); ++k)
  {
    if (!basis.has_multiplier[k])
      continue;
    const Vector3d n(normals.data() + 3 * k);
    // Any tangent will do: that of the axis the normal is furthest from
    Eigen::Index axis;
    n.cwiseAbs().minCoeff(&axis);
    const Vector3d first = n.cross(Vector3d(Vector3d::Unit(axis))).normalized();
    const Vector3d second = n.cross(first);
    for (int side = 0; side < num_sides; ++side)
    {
      const double angle = 2 * std::numbers::pi * side / num_sides;
      const Vector3d t
          = n + bound * (std::cos(angle) * first + std::sin(angle) * second);
      edges.push_back(relative.middleRows(3 * k, 3).transpose() * t);
    }
  }
}

/// The vector, of those of all ranks, with the largest product with another
/// one. Collective.
/// @return Zero where no product is above a tolerance.
VectorXd find_steepest(MPI_Comm comm, const MatrixXd& vectors,
                       const VectorXd& direction, double tolerance)
{
  struct
  {
    double value;
    int rank;
  } mine, best;
  MPI_Comm_rank(comm, &mine.rank);
  mine.value = tolerance;
  Eigen::Index at = -1;
  if (vectors.rows() > 0)
  {
    const double largest = (vectors * direction).maxCoeff(&at);
    if (largest > tolerance)
      mine.value = largest;
  }
  MPI_Allreduce(&mine, &best, 1, MPI_DOUBLE_INT, MPI_MAXLOC, comm);
  VectorXd v = VectorXd::Zero(direction.size());
  if (!(best.value > tolerance))
    return v;
  if (mine.rank == best.rank)
    v = vectors.row(at).transpose();
  MPI_Bcast(v.data(), v.size(), MPI_DOUBLE, best.rank, comm);
  return v;
}
} // namespace

//-----------------------------------------------------------------------------
double dolfinx_mortar::distance_from_cone(MPI_Comm comm,
                                          const MatrixXd& vectors,
                                          const VectorXd& point)
{
  const Eigen::Index m = point.size();
  MatrixXd used(m, 0);
  VectorXd c(0), left = point;
  for (int iteration = 0; iteration < 200; ++iteration)
  {
    const VectorXd next = find_steepest(comm, vectors, left, 1e-10);
    if (next.isZero(0))
      break;
    used.conservativeResize(m, used.cols() + 1);
    used.col(used.cols() - 1) = next;
    c.conservativeResize(used.cols());
    c[c.size() - 1] = 0;
    // All that follows is done by all ranks alike
    while (used.cols() > 0)
    {
      const VectorXd s = least_squares(used, point);
      if (s.minCoeff() > 0)
      {
        c = s;
        break;
      }
      // As far as all factors stay positive; the one that does not any more
      // goes
      double alpha = 1;
      Eigen::Index last = c.size() - 1;
      for (Eigen::Index i = 0; i < s.size(); ++i)
      {
        if (s[i] <= 0 and c[i] <= alpha * (c[i] - s[i]))
        {
          alpha = c[i] > 0 ? c[i] / (c[i] - s[i]) : 0.0;
          last = i;
        }
      }
      c += alpha * (s - c);
      std::vector<Eigen::Index> kept;
      for (Eigen::Index i = 0; i < c.size(); ++i)
      {
        if (i != last)
          kept.push_back(i);
      }
      used = MatrixXd(used(Eigen::indexing::all, kept));
      c = VectorXd(c(kept));
    }
    left = point - used * c;
  }
  return left.norm();
}
//-----------------------------------------------------------------------------
std::optional<Balance>
dolfinx_mortar::find_balance(const Coupling& coupling, const Step& step,
                             const State& state, const Evaluation& evaluation,
                             Mat K, std::span<const double> force)
{
  for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
  {
    if (!coupling.interfaces[i].is_tie()
        and (step.settings.friction[i].bound or !step.is_frictional(i)))
      return std::nullopt;
  }
  const MatrixXd motions
      = unresisted(coupling, free_motions(coupling, evaluation.u), K);
  if (motions.cols() == 0)
    return std::nullopt;
  const Eigenpairs eigen = eigenpairs(
      sum(coupling.comm(), MatrixXd(motions.transpose() * motions)));
  const MatrixXd scaled
      = eigen.vectors * eigen.values.cwiseSqrt().cwiseInverse().asDiagonal();
  const Eigen::Map<const VectorXd> f(force.data(), force.size());
  const MatrixXd work
      = sum(coupling.comm(), MatrixXd(-(motions.transpose() * f)));
  const std::vector<MatrixXd> relative
      = relative_motions(coupling, evaluation, motions);
  std::vector<VectorXd> edges;
  for (std::size_t i = 0; i < coupling.interfaces.size(); ++i)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    if (!c.is_tie())
    {
      append_edges(c, state.interfaces[i].basis,
                   evaluation.interfaces[i].geometry->configuration.normals.n,
                   step.settings.friction[i].coefficient, relative[i] * scaled,
                   edges);
    }
  }
  Balance balance{scaled.transpose() * work,
                  MatrixXd(edges.size(), motions.cols())};
  for (std::size_t i = 0; i < edges.size(); ++i)
    balance.edges.row(i) = edges[i].transpose();
  return balance;
}
//-----------------------------------------------------------------------------
bool dolfinx_mortar::is_overloaded(MPI_Comm comm, const Balance& balance)
{
  const double size = balance.loads.norm();
  if (!(size > 0) or !std::isfinite(size))
    return false;
  std::vector<Eigen::Index> used;
  for (Eigen::Index i = 0; i < balance.edges.rows(); ++i)
  {
    if (balance.edges.row(i).norm() > 0)
      used.push_back(i);
  }
  MatrixXd edges = balance.edges(used, Eigen::indexing::all);
  edges.rowwise().normalize();
  return distance_from_cone(comm, edges, balance.loads / size) > left_over;
}
//-----------------------------------------------------------------------------
bool dolfinx_mortar::is_unsupported(const Coupling& coupling,
                                    const Evaluation& evaluation, Mat K,
                                    std::span<const double> force)
{
  const MatrixXd loose
      = unresisted(coupling, free_motions(coupling, evaluation.u), K);
  const Eigen::Map<const VectorXd> f(force.data(), force.size());
  const VectorXd work = sum(coupling.comm(), MatrixXd(loose.transpose() * f));
  const VectorXd size = sum(
      coupling.comm(), MatrixXd(loose.colwise().squaredNorm().transpose()));
  const double total = sum(coupling.comm(), f.squaredNorm());
  return (work.cwiseAbs().array() > 1e-8 * (total * size).cwiseSqrt().array())
      .any();
}
