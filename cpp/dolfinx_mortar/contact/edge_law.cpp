// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "edge_law.h"
#include <algorithm>
#include <cmath>
#include <unsupported/Eigen/AutoDiff>

using namespace dolfinx_mortar;

namespace
{
/// Variables: z, n and w of both patches, then their gaps
constexpr int num_variables = 20;
using Dual = Eigen::AutoDiffScalar<Eigen::Matrix<double, num_variables, 1>>;
using DualVector = Eigen::Matrix<Dual, 3, 1>;

constexpr int first_z = 0, first_n = 6, first_w = 12, first_gap = 18;

DualVector variable(const Eigen::Vector3d& v, int first)
{
  DualVector x;
  for (int c = 0; c < 3; ++c)
    x[c] = Dual(v[c], num_variables, first + c);
  return x;
}

Dual dot(const DualVector& a, const DualVector& b)
{
  Dual s = a[0] * b[0];
  s += a[1] * b[1];
  s += a[2] * b[2];
  return s;
}

DualVector cross(const DualVector& a, const DualVector& b)
{
  DualVector c;
  for (int i = 0; i < 3; ++i)
  {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    c[i] = a[j] * b[k];
    c[i] -= Dual(a[k] * b[j]);
  }
  return c;
}

Dual frozen(const Dual& x) { return Dual(x.value()); }

/// f of the patch with the larger bound, see edge_residual.
/// @param[in] z,u Traction and weighted slip along the edge.
/// @param[in] b Bound.
Dual friction_along_edge(const Dual& z, const Dual& u, const Dual& b,
                         const PatchState& patch, bool stick, bool bounded,
                         bool damped)
{
  const double c_t = patch.c_t;
  if (stick and !bounded)
    return Dual(u * -c_t);
  if (stick)
    return Dual((damped ? frozen(b) : b) * u * (-c_t / patch.sigma));
  const Dual t = z + u * c_t;
  const double sign = t.value() < 0 ? -1 : 1;
  if (t.value() == 0)
    return z;
  // Traction beyond the cone: its projection in place of z, see
  // contact_residual
  const bool beyond = damped and z.value() * sign >= b.value();
  const Dual s = beyond ? frozen(t) : t;
  return Dual((s * z * sign - b * s) / patch.sigma);
}
} // namespace

//-----------------------------------------------------------------------------
EdgeResidual
dolfinx_mortar::edge_residual(const std::array<PatchState, 2>& patches,
                              double coefficient, std::optional<double> bound,
                              std::optional<bool> forced, bool damped)
{
  std::array<DualVector, 2> z, n, w;
  std::array<Dual, 2> gap, b;
  for (int i = 0; i < 2; ++i)
  {
    const PatchState& p = patches[i];
    z[i] = variable(p.z, first_z + 3 * i);
    n[i] = variable(p.n, first_n + 3 * i);
    w[i] = variable(p.w, first_w + 3 * i);
    gap[i] = Dual(p.gap, num_variables, first_gap + i);
    if (bound)
      b[i] = Dual(*bound);
    else
    {
      b[i] = (dot(z[i], n[i]) - gap[i] * p.c_n) * coefficient;
      if (b[i].value() <= 0)
        b[i] = Dual(0.0);
    }
  }
  DualVector e = cross(n[0], n[1]);
  const Dual length = sqrt(dot(e, e));
  for (int c = 0; c < 3; ++c)
    e[c] /= length;

  const int l = b[1].value() > b[0].value() ? 1 : 0, k = 1 - l;
  const Dual z_l = dot(z[l], e), u_l = -dot(w[l], e);
  const double t = z_l.value() + patches[l].c_t * u_l.value();
  EdgeResidual r;
  r.stick = forced.value_or(std::abs(t) < b[l].value() * (1 - 1e-8));
  r.bound[l] = std::max(b[l].value(), std::abs(t));
  r.bound[k] = b[k].value();
  const bool bounded = !forced and b[l].value() > 0;
  std::array<Dual, 2> along;
  along[l] = friction_along_edge(z_l, u_l, b[l], patches[l], r.stick, bounded,
                                 damped);
  along[k] = dot(z[k], e);
  if (b[l].value() > 0)
    along[k] -= Dual(b[k] / b[l] * z_l);

  for (int i = 0; i < 2; ++i)
  {
    const DualVector across = cross(e, n[i]);
    const Dual z_across = dot(z[i], across);
    for (int c = 0; c < 3; ++c)
    {
      // In components along n and τ the turn of n does not move the gap into τ
      const Dual n_c = damped ? frozen(n[i][c]) : n[i][c];
      Dual C = n_c * gap[i] * patches[i].c_n;
      C += Dual(e[c] * along[i]);
      C += Dual(across[c] * z_across);
      r.value[i][c] = C.value();
      for (int j = 0; j < 2; ++j)
      {
        const auto& d = C.derivatives();
        r.dz[i][j].row(c) = d.segment<3>(first_z + 3 * j);
        r.dn[i][j].row(c) = d.segment<3>(first_n + 3 * j);
        r.dw[i][j].row(c) = d.segment<3>(first_w + 3 * j);
        r.dg[i][j][c] = d[first_gap + j];
      }
    }
  }
  return r;
}
