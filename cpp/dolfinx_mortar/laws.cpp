// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "laws.h"
#include <Eigen/Dense>
#include <algorithm>

using namespace dolfinx_mortar;

namespace
{
using Vec3 = Eigen::Vector3d;
using Mat3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
} // namespace

//-----------------------------------------------------------------------------
ContactResidual dolfinx_mortar::contact_residual(const ContactState& state,
                                                 const Friction& friction,
                                                 std::span<const Status> forced,
                                                 bool damped)
{
  const std::size_t num = state.carries.size();
  const bool rough = friction.coefficient > 0 or friction.bound;
  ContactResidual r;
  r.status.resize(num, Status::open);
  r.value.resize(3 * num);
  r.dz.resize(9 * num);
  r.dn.resize(9 * num);
  r.dw.resize(9 * num);
  r.dg.resize(3 * num);
  r.bound.resize(num, 0.0);
  for (std::size_t j = 0; j < num; ++j)
  {
    const Vec3 z = Eigen::Map<const Vec3>(state.z.data() + 3 * j);
    const Vec3 n = Eigen::Map<const Vec3>(state.normal.data() + 3 * j);
    Eigen::Map<Vec3> C(r.value.data() + 3 * j), Cg(r.dg.data() + 3 * j);
    Eigen::Map<Mat3> Cz(r.dz.data() + 9 * j), Cn(r.dn.data() + 9 * j),
        Cw(r.dw.data() + 9 * j);
    Cg.setZero();
    Cn.setZero();
    Cw.setZero();

    const double zn = n.dot(z);
    const double cg = state.c_n[j] * state.gap[j];
    const double p = zn - cg;
    bool closed
        = state.carries[j] and p > 0 and (state.near.empty() or state.near[j]);
    if (!forced.empty())
      closed = state.carries[j] and forced[j] != Status::open;
    if (!closed)
    {
      C = z;
      Cz.setIdentity();
      continue;
    }

    // Normal part n c_n g̃ and tangential multiplier z_τ = z - n (n·z)
    const Mat3 P = Mat3::Identity() - n * n.transpose();
    const Vec3 z_tau = z - zn * n;
    const Mat3 dz_tau = -zn * Mat3::Identity() - n * z.transpose();
    C = cg * n;
    Cg = state.c_n[j] * n;
    // In components along n and τ the turn of n does not move the gap into τ
    if (!damped)
      Cn = cg * Mat3::Identity();
    // Traction vanishes by symmetry where the displacement is prescribed
    auto release_fixed = [&]()
    {
      for (int c = 0; c < 3; ++c)
      {
        if (state.fixed[3 * j + c])
        {
          C[c] = z[c];
          Cg[c] = 0;
          Cz.row(c) = Vec3::Unit(c).transpose();
          Cn.row(c).setZero();
          Cw.row(c).setZero();
        }
      }
    };
    if (!rough)
    {
      C += z_tau;
      Cz = P;
      Cn += dz_tau;
      r.status[j] = Status::slip;
      release_fixed();
      continue;
    }

    const double ct = state.c_t[j];
    const Vec3 w = Eigen::Map<const Vec3>(state.motion.data() + 3 * j);
    Vec3 free;
    for (int c = 0; c < 3; ++c)
      free[c] = state.fixed[3 * j + c] ? 0.0 : 1.0;
    const auto F = free.asDiagonal();
    const Vec3 u = F * (n.dot(w) * n - w);
    const Mat3 du = F * (n.dot(w) * Mat3::Identity() + n * w.transpose());
    const Vec3 t = F * z_tau + ct * u;
    const double norm_t = t.norm();
    const double b = friction.bound ? *friction.bound
                                    : friction.coefficient * std::max(p, 0.0);
    const double sigma = state.scale[j];
    r.bound[j] = std::max(b, norm_t);
    // A node that slid in the last step starts with ‖t‖ = b up to round-off: it
    // goes on to slide
    bool stick = norm_t < b * (1 - 1e-8);
    if (!forced.empty())
      stick = forced[j] == Status::stick;
    // Derivatives of the bound
    const double db = friction.bound or p <= 0 ? 0.0 : friction.coefficient;
    if (stick)
    {
      // b z_τ - b t = -b c_t u; without the factor where a node is told to
      // stick before it touches: b is zero or round-off, and it would have no
      // equation
      r.status[j] = Status::stick;
      const bool bounded = forced.empty() and b > 0;
      const double s = bounded ? ct / sigma : ct;
      const double factor = bounded ? b : 1.0;
      const double dfactor = bounded and !damped ? db : 0.0;
      C -= s * factor * u;
      Cz = -s * dfactor * u * n.transpose();
      Cg += s * dfactor * state.c_n[j] * u;
      Cn -= s * (factor * du + dfactor * u * z.transpose());
      Cw = s * factor * F * P;
      release_fixed();
      continue;
    }

    r.status[j] = Status::slip;
    if (!(norm_t > 0))
    {
      // Neither traction nor motion: the direction of slip is not known yet
      C += z_tau;
      Cz = P;
      Cn += dz_tau;
      release_fixed();
      continue;
    }
    // ‖t‖ z_τ - b t
    const Vec3 e = t / norm_t;
    // (z eᵀ - b I) / σ; where the traction reaches beyond the cone, with its
    // projection b e in place of z
    const bool beyond = damped and z_tau.dot(e) >= b;
    const Vec3 direction = beyond ? Vec3(b * e) : z_tau;
    const Mat3 A = (direction * e.transpose() - b * Mat3::Identity()) / sigma;
    const Mat3 At = A * F + (norm_t / sigma) * Mat3::Identity(); // by z_τ
    const double s = db / sigma;
    C += (norm_t * z_tau - b * t) / sigma;
    Cz = At * P - s * t * n.transpose();
    Cg += s * state.c_n[j] * t;
    Cn += At * dz_tau + ct * A * du - s * t * z.transpose();
    Cw = -ct * A * F * P;
    release_fixed();
  }
  return r;
}
