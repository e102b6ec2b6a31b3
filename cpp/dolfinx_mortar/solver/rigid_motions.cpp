// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "rigid_motions.h"
#include <algorithm>
#include <cmath>
#include <dolfinx_mortar/common/dense.h>
#include <numeric>

using namespace dolfinx_mortar;
using Eigen::MatrixXd;

namespace
{
/// Group of parts that ties hold together, of each part. Collective.
std::vector<std::int32_t> tied_groups(const Coupling& coupling)
{
  const Layout& layout = coupling.layout;
  std::vector<std::int32_t> group(layout.num_parts);
  std::iota(group.begin(), group.end(), 0);
  for (const CoupledInterface& c : coupling.interfaces)
  {
    if (!c.is_tie())
      continue;
    std::vector<std::int8_t> touched(layout.num_parts, 0);
    for (const Surface* s : {&c.data.slave, &c.data.master})
    {
      for (std::int32_t k = 0; k < s->num_owned; ++k)
        touched[layout.parts[s->local_blocks[k]]] = 1;
    }
    MPI_Allreduce(MPI_IN_PLACE, touched.data(), touched.size(), MPI_INT8_T,
                  MPI_MAX, coupling.comm());
    std::int32_t together = layout.num_parts;
    for (std::int32_t p = 0; p < layout.num_parts; ++p)
    {
      if (touched[p])
        together = std::min(together, group[p]);
    }
    std::vector<std::int8_t> joined(layout.num_parts, 0);
    for (std::int32_t p = 0; p < layout.num_parts; ++p)
    {
      if (touched[p])
        joined[group[p]] = 1;
    }
    for (std::int32_t& g : group)
    {
      if (joined[g])
        g = together;
    }
  }
  return group;
}

/// Translations and infinitesimal rotations at points, shape (3 n, 6).
MatrixXd rigid_modes(std::span<const double> x, double scale)
{
  MatrixXd modes = MatrixXd::Zero(x.size(), 6);
  for (std::size_t i = 0; i < x.size(); i += 3)
  {
    const double a = x[i] / scale, b = x[i + 1] / scale, c = x[i + 2] / scale;
    modes.block(i, 0, 3, 3).setIdentity();
    modes.block(i, 3, 3, 3) << 0, c, -b, -c, 0, a, b, -a, 0;
  }
  return modes;
}
/// Non-zero for the dofs of loaded tools, which are not those of unknowns.
std::vector<std::int8_t> loaded_dofs(const Coupling& coupling)
{
  std::vector<std::int8_t> flags(coupling.layout.size(), 0);
  for (const LoadedTool& tool : coupling.loaded_tools)
  {
    if (tool.first_dof >= 0)
      std::fill_n(flags.begin() + tool.first_dof, 12, 1);
  }
  return flags;
}
} // namespace

//-----------------------------------------------------------------------------
MatrixXd dolfinx_mortar::sum(MPI_Comm comm, const MatrixXd& A)
{
  MatrixXd total = A;
  MPI_Allreduce(MPI_IN_PLACE, total.data(), total.size(), MPI_DOUBLE, MPI_SUM,
                comm);
  return total;
}
//-----------------------------------------------------------------------------
MatrixXd dolfinx_mortar::free_motions(const Coupling& coupling,
                                      std::span<const double> u)
{
  const Layout& layout = coupling.layout;
  const std::vector<std::int32_t> group = tied_groups(coupling);
  std::vector<std::int32_t> label = layout.owned(layout.parts, 1);
  for (std::int32_t& l : label)
    l = group[l];
  std::vector<double> x = layout.owned(layout.X, 3);
  for (std::size_t i = 0; i < x.size(); ++i)
    x[i] += u[i];
  const double scale = max_norm(layout.comm, x);
  const MatrixXd modes = rigid_modes(x, scale > 0 ? scale : 1.0);

  std::vector<MatrixXd> grams(layout.num_parts, MatrixXd::Zero(6, 6));
  const std::vector<std::int8_t> of_load = loaded_dofs(coupling);
  for (std::int32_t dof : coupling.fixed_dofs)
  {
    if (!of_load[dof])
      grams[label[dof / 3]] += modes.row(dof).transpose() * modes.row(dof);
  }
  for (const LoadedTool& tool : coupling.loaded_tools)
  {
    if (tool.first_dof < 0)
      continue;
    // Motions of the reference point, and rotations
    const Eigen::Vector4d N = frame_functions(
        FrameView(tool.frame.X).coordinates(Vec3(tool.frame.point.data())));
    MatrixXd motion = MatrixXd::Zero(6, 6);
    for (int l = 0; l < 4; ++l)
      motion.topRows(3) += N[l] * modes.middleRows(tool.first_dof + 3 * l, 3);
    motion.block(3, 3, 3, 3).setIdentity();
    for (int c = 0; c < 6; ++c)
    {
      if (!tool.free[c])
      {
        grams[group[tool.part]] += motion.row(c).transpose() * motion.row(c);
      }
    }
  }
  std::vector<MatrixXd> free;
  Eigen::Index count = 0;
  for (std::int32_t g = 0; g < layout.num_parts; ++g)
  {
    if (group[g] != g)
      continue;
    const MatrixXd gram = sum(layout.comm, grams[g]);
    const Eigenpairs eigen = eigenpairs(gram);
    const double tolerance = 1e-10 * std::max(1.0, gram.trace());
    const Eigen::Index n = (eigen.values.array() <= tolerance).count();
    MatrixXd own = modes * eigen.vectors.leftCols(n);
    for (std::size_t b = 0; b < label.size(); ++b)
    {
      if (label[b] != g)
        own.middleRows(3 * b, 3).setZero();
    }
    count += n;
    free.push_back(std::move(own));
  }
  MatrixXd all(layout.size(), count);
  count = 0;
  for (const MatrixXd& own : free)
  {
    all.middleCols(count, own.cols()) = own;
    count += own.cols();
  }
  return all;
}
//-----------------------------------------------------------------------------
bool dolfinx_mortar::is_held(const Coupling& coupling)
{
  const std::vector<double> zero(coupling.layout.size(), 0.0);
  return free_motions(coupling, zero).cols() == 0;
}
//-----------------------------------------------------------------------------
MatrixXd dolfinx_mortar::unresisted(const Coupling& coupling,
                                    const MatrixXd& motions, Mat K)
{
  if (motions.cols() == 0)
    return motions;
  const std::vector<double> stiffness = diagonal(K);
  MatrixXd scale = motions, resistance(motions.rows(), motions.cols());
  for (Eigen::Index i = 0; i < scale.rows(); ++i)
    scale.row(i) *= std::abs(stiffness[i]);
  for (Eigen::Index j = 0; j < motions.cols(); ++j)
  {
    const std::vector<double> f = multiply(
        K, {motions.col(j).data(), static_cast<std::size_t>(motions.rows())});
    resistance.col(j) = Eigen::Map<const Eigen::VectorXd>(f.data(), f.size());
  }
  const std::vector<std::int8_t> of_load = loaded_dofs(coupling);
  for (std::int32_t dof : coupling.fixed_dofs)
  {
    if (!of_load[dof])
      resistance.row(dof).setZero();
  }
  const Eigenpairs eigen
      = eigenpairs(sum(coupling.comm(), resistance.transpose() * resistance),
                   sum(coupling.comm(), scale.transpose() * scale));
  const Eigen::Index n = (eigen.values.array() < 1e-14).count();
  return motions * eigen.vectors.leftCols(n);
}
