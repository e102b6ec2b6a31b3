// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "laws.h"
#include "edge_law.h"
#include <Eigen/Dense>
#include <algorithm>
#include <array>

using namespace dolfinx_mortar;

namespace
{
using Vec3 = Eigen::Vector3d;
using Mat3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

/// Normals of patches in contact at one node: each must have a part of at least
/// this length that is not in the span of the others.
constexpr double independent = 0.3;

Vec3 vector(std::span<const double> v, std::size_t j)
{
  return Eigen::Map<const Vec3>(v.data() + 3 * j);
}

/// Residual and derivatives of a node, in the arrays of all.
struct NodeResidual
{
  Eigen::Map<Vec3> C, Cg;
  Eigen::Map<Mat3> Cz, Cn, Cw;

  NodeResidual(ContactResidual& r, std::size_t j)
      : C(r.value.data() + 3 * j), Cg(r.dg.data() + 3 * j),
        Cz(r.dz.data() + 9 * j), Cn(r.dn.data() + 9 * j),
        Cw(r.dw.data() + 9 * j)
  {
  }
};

/// p = z_n - c_n g̃
double trial_pressure(const ContactState& s, std::size_t j)
{
  return vector(s.normal, j).dot(vector(s.z, j)) - s.c_n[j] * s.gap[j];
}

/// A node closes only near a master. One that is pressed stays closed: its
/// weighted gap can vanish while the surfaces around it are slightly apart.
bool can_close(const ContactState& s, std::size_t j)
{
  return s.near.empty() or s.near[j]
         or vector(s.normal, j).dot(vector(s.z, j)) > 0;
}

/// Let a node be in contact on no more patches than it can be.
/// @param[in] nodes Nodes of one block that are closed.
/// @param[in,out] closed Flags of all nodes.
void open_dependent(const ContactState& s, std::vector<std::size_t> nodes,
                    std::vector<std::int8_t>& closed)
{
  std::ranges::stable_sort(nodes, std::greater{},
                           [&](std::size_t j) { return trial_pressure(s, j); });
  std::vector<Vec3> basis;
  for (std::size_t j : nodes)
  {
    Vec3 n = vector(s.normal, j);
    for (const Vec3& e : basis)
      n -= n.dot(e) * e;
    if (n.norm() < independent)
      closed[j] = 0;
    else
      basis.push_back(n.normalized());
  }
}

/// Nodes with the block of node j, from j on.
std::size_t end_of_block(const ContactState& s, std::size_t j)
{
  std::size_t end = j + 1;
  while (!s.blocks.empty() and end < s.blocks.size()
         and s.blocks[end] == s.blocks[j])
  {
    ++end;
  }
  return end;
}

/// Closed nodes among [begin, end).
std::vector<std::size_t> closed_nodes(std::size_t begin, std::size_t end,
                                      std::span<const std::int8_t> closed)
{
  std::vector<std::size_t> nodes;
  for (std::size_t j = begin; j < end; ++j)
    if (closed[j])
      nodes.push_back(j);
  return nodes;
}

/// Flags of nodes in contact.
std::vector<std::int8_t> find_closed(const ContactState& s,
                                     std::span<const Status> forced)
{
  const std::size_t num = s.has_multiplier.size();
  std::vector<std::int8_t> closed(num);
  for (std::size_t j = 0; j < num; ++j)
  {
    closed[j]
        = s.has_multiplier[j]
          and (forced.empty() ? trial_pressure(s, j) > 0 and can_close(s, j)
                              : forced[j] != Status::open);
  }
  for (std::size_t j = 0; j < num;)
  {
    const std::size_t end = end_of_block(s, j);
    if (end > j + 1)
      open_dependent(s, closed_nodes(j, end, closed), closed);
    j = end;
  }
  return closed;
}

/// Traction vanishes by symmetry where the displacement is prescribed.
void release_fixed(const ContactState& s, std::size_t j, NodeResidual& r)
{
  for (int c = 0; c < 3; ++c)
  {
    if (s.fixed[3 * j + c])
    {
      r.C[c] = s.z[3 * j + c];
      r.Cg[c] = 0;
      r.Cz.row(c) = Vec3::Unit(c).transpose();
      r.Cn.row(c).setZero();
      r.Cw.row(c).setZero();
    }
  }
}

/// Normal part n c_n g̃ of a closed node.
void add_normal_part(const ContactState& s, std::size_t j, bool damped,
                     NodeResidual& r)
{
  const Vec3 n = vector(s.normal, j);
  r.C += s.c_n[j] * s.gap[j] * n;
  r.Cg += s.c_n[j] * n;
  // In components along n and τ the turn of n does not move the gap into τ
  if (!damped)
    r.Cn += s.c_n[j] * s.gap[j] * Mat3::Identity();
}

/// Tangential part z_τ of a closed node without friction.
void add_no_friction(const ContactState& s, std::size_t j, NodeResidual& r)
{
  const Vec3 z = vector(s.z, j), n = vector(s.normal, j);
  const double zn = n.dot(z);
  r.C += z - zn * n;
  r.Cz += Mat3::Identity() - n * n.transpose();
  r.Cn += -zn * Mat3::Identity() - n * z.transpose();
}

/// Tangential part of a closed node with friction.
/// @param[in] forced Whether the node sticks, instead of what follows from the
/// values.
/// @param[out] bound See ContactResidual.
Status add_friction(const ContactState& s, const Friction& friction,
                    std::optional<bool> forced, bool damped, std::size_t j,
                    NodeResidual& r, double& bound)
{
  const Vec3 z = vector(s.z, j), n = vector(s.normal, j);
  const Mat3 P = Mat3::Identity() - n * n.transpose();
  const double zn = n.dot(z), p = trial_pressure(s, j), ct = s.c_t[j];
  const Vec3 z_tau = z - zn * n;
  const Mat3 dz_tau = -zn * Mat3::Identity() - n * z.transpose();
  const Vec3 w = vector(s.weighted_slip, j);
  Vec3 free;
  for (int c = 0; c < 3; ++c)
    free[c] = s.fixed[3 * j + c] ? 0.0 : 1.0;
  const auto F = free.asDiagonal();
  const Vec3 u = F * (n.dot(w) * n - w);
  const Mat3 du = F * (n.dot(w) * Mat3::Identity() + n * w.transpose());
  const Vec3 t = F * z_tau + ct * u;
  const double norm_t = t.norm();
  const double b = friction.bound ? *friction.bound
                                  : friction.coefficient * std::max(p, 0.0);
  const double sigma = s.scale[j];
  bound = std::max(b, norm_t);
  // Derivatives of the bound
  const double db = friction.bound or p <= 0 ? 0.0 : friction.coefficient;
  // A node that slid in the last step starts with ‖t‖ = b up to round-off: it
  // goes on to slide
  if (forced.value_or(norm_t < b * (1 - 1e-8)))
  {
    // b z_τ - b t = -b c_t u; without the factor where a node is told to stick
    // before it touches: b is zero or round-off, and it would have no equation
    const bool bounded = !forced and b > 0;
    const double c = bounded ? ct / sigma : ct;
    const double factor = bounded ? b : 1.0;
    const double dfactor = bounded and !damped ? db : 0.0;
    r.C -= c * factor * u;
    r.Cz += -c * dfactor * u * n.transpose();
    r.Cg += c * dfactor * s.c_n[j] * u;
    r.Cn -= c * (factor * du + dfactor * u * z.transpose());
    r.Cw += c * factor * F * P;
    return Status::stick;
  }
  if (!(norm_t > 0))
  {
    // Neither traction nor slip: the direction of slip is not known yet
    add_no_friction(s, j, r);
    return Status::slip;
  }
  // ‖t‖ z_τ - b t
  const Vec3 e = t / norm_t;
  // (z eᵀ - b I) / σ; where the traction reaches beyond the cone, with its
  // projection b e in place of z
  const bool beyond = damped and z_tau.dot(e) >= b;
  const Vec3 direction = beyond ? Vec3(b * e) : z_tau;
  const Mat3 A = (direction * e.transpose() - b * Mat3::Identity()) / sigma;
  const Mat3 At = A * F + (norm_t / sigma) * Mat3::Identity(); // by z_τ
  const double c = db / sigma;
  r.C += (norm_t * z_tau - b * t) / sigma;
  r.Cz += At * P - c * t * n.transpose();
  r.Cg += c * s.c_n[j] * t;
  r.Cn += At * dz_tau + ct * A * du - c * t * z.transpose();
  r.Cw += -ct * A * F * P;
  return Status::slip;
}

/// Friction of a node that is in contact on two patches.
void apply_edge_law(const ContactState& s, const Friction& friction,
                    std::span<const Status> forced, bool damped,
                    std::array<std::size_t, 2> nodes, ContactResidual& r)
{
  std::array<PatchState, 2> patches;
  for (int i = 0; i < 2; ++i)
  {
    const std::size_t j = nodes[i];
    patches[i] = {vector(s.z, j),
                  vector(s.normal, j),
                  vector(s.weighted_slip, j),
                  s.gap[j],
                  s.c_n[j],
                  s.c_t[j],
                  s.scale[j]};
  }
  std::optional<bool> stick;
  if (!forced.empty())
  {
    stick = forced[nodes[0]] == Status::stick
            or forced[nodes[1]] == Status::stick;
  }
  const EdgeResidual e = edge_residual(patches, friction.coefficient,
                                       friction.bound, stick, damped);
  auto append = [](std::vector<double>& to, const Mat3& block)
  { to.insert(to.end(), block.data(), block.data() + 9); };
  for (int i = 0; i < 2; ++i)
  {
    const int k = 1 - i;
    NodeResidual node(r, nodes[i]);
    node.C = e.value[i];
    node.Cg = e.dg[i][i];
    node.Cz = e.dz[i][i];
    node.Cn = e.dn[i][i];
    node.Cw = e.dw[i][i];
    r.status[nodes[i]] = e.stick ? Status::stick : Status::slip;
    r.bound[nodes[i]] = e.bound[i];
    ContactCouplings& c = r.couplings;
    c.rows.push_back(nodes[i]);
    c.columns.push_back(nodes[k]);
    append(c.dz, e.dz[i][k]);
    append(c.dn, e.dn[i][k]);
    append(c.dw, e.dw[i][k]);
    c.dg.insert(c.dg.end(), e.dg[i][k].data(), e.dg[i][k].data() + 3);
  }
}

/// Zero residual of all nodes.
ContactResidual create_residual(std::size_t num)
{
  ContactResidual r;
  r.status.resize(num, Status::open);
  r.value.resize(3 * num);
  r.dz.resize(9 * num);
  r.dn.resize(9 * num);
  r.dw.resize(9 * num);
  r.dg.resize(3 * num);
  r.bound.resize(num, 0.0);
  return r;
}
} // namespace

//-----------------------------------------------------------------------------
ContactResidual dolfinx_mortar::contact_residual(const ContactState& state,
                                                 const Friction& friction,
                                                 std::span<const Status> forced,
                                                 bool damped)
{
  const std::size_t num = state.has_multiplier.size();
  const bool rough = friction.coefficient > 0 or friction.bound;
  ContactResidual r = create_residual(num);
  const std::vector<std::int8_t> closed = find_closed(state, forced);
  for (std::size_t begin = 0; begin < num;)
  {
    const std::size_t end = end_of_block(state, begin);
    const std::vector<std::size_t> nodes = closed_nodes(begin, end, closed);
    // On an edge in a symmetry plane, as on three patches, a node cannot slide
    bool fixed = false;
    for (int c = 0; c < 3; ++c)
      fixed = fixed or state.fixed[3 * begin + c];
    const bool edge = nodes.size() > 1;
    const bool slides = nodes.size() < 3 and !(edge and fixed);
    for (std::size_t j = begin; j < end; ++j)
    {
      NodeResidual node(r, j);
      if (!closed[j])
      {
        node.C = vector(state.z, j);
        node.Cz.setIdentity();
        continue;
      }
      if (rough and edge and slides)
        continue;
      add_normal_part(state, j, damped, node);
      if (rough and slides)
      {
        std::optional<bool> stick;
        if (!forced.empty())
          stick = forced[j] == Status::stick;
        r.status[j]
            = add_friction(state, friction, stick, damped, j, node, r.bound[j]);
      }
      else
      {
        add_no_friction(state, j, node);
        r.status[j] = rough ? Status::stick : Status::slip;
      }
      release_fixed(state, j, node);
    }
    if (rough and edge and slides)
    {
      apply_edge_law(state, friction, forced, damped, {nodes[0], nodes[1]}, r);
    }
    begin = end;
  }
  return r;
}
