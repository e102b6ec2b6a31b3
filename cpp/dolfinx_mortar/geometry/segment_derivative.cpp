// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "segment_derivative.h"
#include <Eigen/Dense>
#include <algorithm>
#include <dolfinx_mortar/common/pack.h>

using namespace dolfinx_mortar;

namespace
{
/// Numbers of a point that products are made of, for each sum: two by the place
/// on the slave, two by the place on the master, one by the weight. A step
/// along n₀ changes no place: two components in the plane are all there are.
constexpr int num_factors = 5;

/// Axes in the plane of a linear part, and its normal.
struct Axes
{
  Vec3 e1, e2, n;

  explicit Axes(const LinearPart& s) : n(s.n)
  {
    e1 = s.corners[1] - s.corners[0];
    e1 = (e1 - e1.dot(n) * n).normalized();
    e2 = n.cross(e1);
  }

  const Vec3& operator[](int j) const { return j == 0 ? e1 : j == 1 ? e2 : n; }

  Vec3 components(const Vec3& v) const
  {
    return {v.dot(e1), v.dot(e2), v.dot(n)};
  }
};

/// Points of a triangle that are taken together
constexpr int most_points = 16;

/// Corners of an overlap
constexpr int most_corners = 16;

/// Of the nodes of a facet, three corners of a triangle and the normal.
constexpr int most_columns = max_facet_nodes + 4;
using Columns = std::array<double, most_columns>;

/// y += a x
MORTAR_INLINE void add_multiple(double a, const double* x, double* y, int size)
{
  for (int r = 0; r < size; r += pack_size)
    store(y + r, load(y + r) + a * load(x + r));
}

/// out_c += Σ_k A_kc x_k + B_kc y_k for a block of columns and a few packs of
/// sums; no B where it is null.
template <int columns, int packs, bool two>
MORTAR_INLINE void add_block(int num, const double* A, const double* X,
                             const double* B, const double* Y,
                             double* const* out, int r)
{
  constexpr int stride = num_factors * packs * pack_size;
  Pack sum[columns][packs];
#pragma GCC unroll 5
  for (int c = 0; c < columns; ++c)
  {
#pragma GCC unroll 2
    for (int p = 0; p < packs; ++p)
      sum[c][p] = load(out[c] + r + pack_size * p);
  }
  for (int k = 0; k < num; ++k)
  {
    const double *a = A + k * most_columns, *x = X + k * stride;
#pragma GCC unroll 5
    for (int c = 0; c < columns; ++c)
    {
#pragma GCC unroll 2
      for (int p = 0; p < packs; ++p)
        sum[c][p] += a[c] * load(x + pack_size * p);
    }
    if constexpr (two)
    {
      const double *b = B + k * most_columns, *y = Y + k * stride;
#pragma GCC unroll 5
      for (int c = 0; c < columns; ++c)
      {
#pragma GCC unroll 2
        for (int p = 0; p < packs; ++p)
          sum[c][p] += b[c] * load(y + pack_size * p);
      }
    }
  }
#pragma GCC unroll 5
  for (int c = 0; c < columns; ++c)
  {
#pragma GCC unroll 2
    for (int p = 0; p < packs; ++p)
      store(out[c] + r + pack_size * p, sum[c][p]);
  }
}

/// The same for all columns, in blocks of three to five.
template <int packs, bool two>
MORTAR_INLINE void add_columns(int num, int columns, const Columns* A,
                               const double* X, const Columns* B,
                               const double* Y, double* const* out, int r)
{
  for (int c = 0, blocks = (columns + 4) / 5; blocks > 0; --blocks)
  {
    const int size = (columns - c + blocks - 1) / blocks;
    const double *a = A->data() + c, *b = two ? B->data() + c : nullptr;
    if (size == 5)
      add_block<5, packs, two>(num, a, X, b, Y, out + c, r);
    else if (size == 4)
      add_block<4, packs, two>(num, a, X, b, Y, out + c, r);
    else
      add_block<3, packs, two>(num, a, X, b, Y, out + c, r);
    c += size;
  }
}

/// Derivatives of sums, on their way back from the points to the nodes. Those
/// of one overlap are components along its axes first.
struct Sweep
{
  const SegmentDerivative& derivative;
  const double* C;
  int num_sums, num_s, num_m;
  double* by_positions;
  std::vector<double> by_nodes;    // shape (num_s + num_m, 3, num_sums)
  std::vector<double> by_corners;  // shape (most_corners, 3, num_sums)
  std::vector<double> by_normal;   // shape (3, num_sums)
  std::vector<double> by_crossing; // shape (num_sums)

  MORTAR_INLINE double* position(int k, int j)
  {
    return by_positions + (3 * k + j) * num_sums;
  }

  MORTAR_INLINE double* node(int k, int j)
  {
    return by_nodes.data() + (3 * k + j) * num_sums;
  }

  MORTAR_INLINE double* corner(int i, int j)
  {
    return by_corners.data() + (3 * i + j) * num_sums;
  }

  MORTAR_INLINE double* normal(int j)
  {
    return by_normal.data() + j * num_sums;
  }
};

/// Components along axes are added to those along x, y and z, or replaced by
/// them.
/// @param[in] along Components along the axes, shape (3, num_sums).
template <bool add>
MORTAR_INLINE void turn_back(const Axes& axes, const double* along, double* out,
                             int num_sums)
{
  const Vec3 e1 = axes.e1, e2 = axes.e2, n = axes.n;
  for (int r = 0; r < num_sums; r += pack_size)
  {
    const Pack v1 = load(along + r), v2 = load(along + num_sums + r),
               v3 = load(along + 2 * num_sums + r);
#pragma GCC unroll 3
    for (int j = 0; j < 3; ++j)
    {
      double* to = out + j * num_sums + r;
      const Pack v = e1[j] * v1 + e2[j] * v2 + n[j] * v3;
      store(to, add ? load(to) + v : v);
    }
  }
}

/// What makes factors of derivatives by (ξ, η, w) at a point.
struct Factors
{
  std::array<double, 2> xi1, xi2, xi_weight, eta1, eta2;
  double weight;

  Factors() = default;

  Factors(const SegmentDerivative::Point& q, const Axes& axes) : weight(q.w)
  {
    for (int j = 0; j < 2; ++j)
    {
      xi1[j] = q.Ls.row(0).dot(axes[j]);
      xi2[j] = q.Ls.row(1).dot(axes[j]);
      xi_weight[j] = q.w * (q.kappa[0] * xi1[j] + q.kappa[1] * xi2[j]);
      eta1[j] = q.Lm.row(0).dot(axes[j]);
      eta2[j] = q.Lm.row(1).dot(axes[j]);
    }
  }
};

/// From the derivatives of a few packs of sums by (ξ, η, w) at a point to those
/// by a step of its places and by the logarithm of its weight.
/// @param[in] C The former, five with this many sums between them.
template <int packs>
MORTAR_INLINE void set_factors(const Factors& q, const double* C, int num_sums,
                               double* X)
{
  constexpr int size = packs * pack_size;
#pragma GCC unroll 2
  for (int r = 0; r < size; r += pack_size)
  {
    const double* c = C + r;
    double* x = X + r;
    const Pack xi1 = load(c), xi2 = load(c + num_sums),
               eta1 = load(c + 2 * num_sums), eta2 = load(c + 3 * num_sums),
               weight = load(c + 4 * num_sums);
#pragma GCC unroll 2
    for (int j = 0; j < 2; ++j)
    {
      store(x + j * size,
            q.xi1[j] * xi1 + q.xi2[j] * xi2 + q.xi_weight[j] * weight);
      store(x + (2 + j) * size, q.eta1[j] * eta1 + q.eta2[j] * eta2);
    }
    store(x + 4 * size, q.weight * weight);
  }
}

/// What the products of points of one triangle are made of.
struct Tables
{
  int num;
  std::array<Factors, most_points> factors;
  std::array<Columns, most_points> slave, master;
  std::array<std::array<Columns, most_points>, 3> weight;
  std::array<std::array<double*, most_columns>, 3> to_slave, to_master;
};

/// The products at a few packs of sums from r on.
template <int packs>
MORTAR_INLINE void add_packs(const Sweep& sweep, int first, const Tables& t,
                             int r)
{
  constexpr int size = packs * pack_size;
  alignas(32) double X[most_points * num_factors * size];
  for (int q = 0; q < t.num; ++q)
  {
    set_factors<packs>(t.factors[q],
                       sweep.C + 5 * (first + q) * sweep.num_sums + r,
                       sweep.num_sums, X + q * num_factors * size);
  }
  const double* by_weight = X + 4 * size;
  for (int j = 0; j < 2; ++j)
  {
    add_columns<packs, true>(t.num, sweep.num_s + 4, t.slave.data(),
                             X + j * size, t.weight[j].data(), by_weight,
                             t.to_slave[j].data(), r);
    add_columns<packs, false>(t.num, sweep.num_m + 4, t.master.data(),
                              X + (2 + j) * size, nullptr, nullptr,
                              t.to_master[j].data(), r);
  }
  add_columns<packs, false>(t.num, sweep.num_s + 4, t.weight[2].data(),
                            by_weight, nullptr, nullptr, t.to_slave[2].data(),
                            r);
}

/// What points of one triangle add, to the nodes and to its corners.
MORTAR_INLINE void add_points(Sweep& sweep, const Axes& axes, int first,
                              int num)
{
  const SegmentDerivative& d = sweep.derivative;
  const auto& triangle = d.triangles[d.points[first].triangle];
  const auto& overlap = d.overlaps[triangle.overlap];
  const std::array<int, 3> corners = {0, triangle.i, triangle.i + 1};
  const Vec3 &n = overlap.s.n, E1 = overlap.edge(corners[1]),
             E2 = overlap.edge(corners[2]), E12 = E1.cross(E2);
  const double area2 = E12.dot(n);
  std::array<Vec3, 3> by_corner;
  by_corner[1] = E2.cross(n) / area2;
  by_corner[2] = n.cross(E1) / area2;
  by_corner[0] = -by_corner[1] - by_corner[2];
  for (Vec3& v : by_corner)
    v = axes.components(v);

  const int ns = sweep.num_s, nm = sweep.num_m;
  Tables t;
  t.num = num;
  for (int q = 0; q < num; ++q)
  {
    const auto& point = d.points[first + q];
    t.factors[q] = Factors(point, axes);
    const Vec3 a1 = axes.components(point.a1), a2 = axes.components(point.a2);
    const Vec3 by_n = axes.components(E12 / area2 - point.c);
    for (int k = 0; k < ns; ++k)
      t.slave[q][k] = -point.N[k];
    for (int k = 0; k < nm; ++k)
      t.master[q][k] = -point.Nm[k];
    for (int i = 0; i < 3; ++i)
      t.slave[q][ns + i] = t.master[q][nm + i] = point.b[i];
    t.slave[q][ns + 3] = point.alpha;
    t.master[q][nm + 3] = point.beta;
    for (int j = 0; j < 3; ++j)
    {
      Columns& weight = t.weight[j][q];
      for (int k = 0; k < ns; ++k)
        weight[k] = a1[j] * point.dN1[k] + a2[j] * point.dN2[k];
      for (int i = 0; i < 3; ++i)
        weight[ns + i] = by_corner[i][j];
      weight[ns + 3] = by_n[j];
    }
  }
  for (int j = 0; j < 3; ++j)
  {
    for (int k = 0; k < ns; ++k)
      t.to_slave[j][k] = sweep.node(k, j);
    for (int k = 0; k < nm; ++k)
      t.to_master[j][k] = sweep.node(ns + k, j);
    for (int i = 0; i < 3; ++i)
    {
      t.to_slave[j][ns + i] = t.to_master[j][nm + i]
          = sweep.corner(corners[i], j);
    }
    t.to_slave[j][ns + 3] = t.to_master[j][nm + 3] = sweep.normal(j);
  }

  int r = 0;
  for (; r + 2 * pack_size <= sweep.num_sums; r += 2 * pack_size)
    add_packs<2>(sweep, first, t, r);
  if (r < sweep.num_sums)
    add_packs<1>(sweep, first, t, r);
}

/// From a corner of an overlap to those of the parts and the normal. Where
/// edges cross it is V = y_c + t (y_d - y_c) with (V - x_a)·e = 0, e = n × (x_b
/// - x_a), so that dt (y_d - y_c)·e = (dx_a - (1 - t) dy_c - t dy_d)·e - (V -
/// x_a)·de.
MORTAR_INLINE void add_corner(Sweep& sweep,
                              const SegmentDerivative::Overlap& overlap, int i)
{
  const int size = sweep.num_sums;
  const LinearPart &s = overlap.s, &m = overlap.m;
  const ClipVertex& v = overlap.polygon.vertices[i];
  const int ns = sweep.num_s;
  if (v.kind != ClipVertex::Kind::intersection)
  {
    const int k = v.kind == ClipVertex::Kind::slave ? s.nodes[v.slave]
                                                    : ns + m.nodes[v.master];
    for (int j = 0; j < 3; ++j)
      add_multiple(1, sweep.corner(i, j), sweep.position(k, j), size);
    return;
  }

  const int a = v.slave, b = (v.slave + 1) % s.size;
  const int c = v.master, d = (v.master + 1) % m.size;
  const Vec3 ab = s.corners[b] - s.corners[a], cd = m.corners[d] - m.corners[c];
  const Vec3 e = s.n.cross(ab), r = overlap.V[i] - s.corners[a];
  const double scale = 1 / cd.dot(e);
  const double t = (s.corners[a] - m.corners[c]).dot(e) * scale;
  // r·(dn × ab) = dn·(ab × r) and r·(n × dx) = dx·(r × n)
  const Vec3 by_n = ab.cross(r), rn = r.cross(s.n);
  double* by_t = sweep.by_crossing.data();
  std::fill_n(by_t, size, 0.0);
  for (int j = 0; j < 3; ++j)
    add_multiple(cd[j] * scale, sweep.corner(i, j), by_t, size);
  const int ka = s.nodes[a], kb = s.nodes[b];
  const int kc = ns + m.nodes[c], kd = ns + m.nodes[d];
  for (int j = 0; j < 3; ++j)
  {
    add_multiple(-by_n[j], by_t, sweep.normal(j), size);
    add_multiple(e[j] + rn[j], by_t, sweep.position(ka, j), size);
    add_multiple(-rn[j], by_t, sweep.position(kb, j), size);
    double* by_V = sweep.corner(i, j);
    add_multiple(-e[j], by_t, by_V, size);
    add_multiple(1 - t, by_V, sweep.position(kc, j), size);
    add_multiple(t, by_V, sweep.position(kd, j), size);
  }
}

/// From the normal of the slave's part to its corners.
MORTAR_INLINE void add_normal(Sweep& sweep, const LinearPart& s)
{
  const auto W = s.normal_derivative();
  const Eigen::Matrix3d P
      = (Eigen::Matrix3d::Identity() - s.n * s.n.transpose()) / s.norm_c;
  for (int i = 0; i < s.size; ++i)
  {
    const Eigen::Matrix3d dn = P * W[i];
    for (int l = 0; l < 3; ++l)
    {
      for (int j = 0; j < 3; ++j)
      {
        add_multiple(dn(l, j), sweep.normal(l), sweep.position(s.nodes[i], j),
                     sweep.num_sums);
      }
    }
  }
}

MORTAR_INLINE void sweep_overlaps(Sweep* sweep)
{
  const SegmentDerivative& d = sweep->derivative;
  const int num_points = d.points.size();
  for (int q = 0; q < num_points;)
  {
    const int index = d.triangles[d.points[q].triangle].overlap;
    const auto& overlap = d.overlaps[index];
    const Axes axes(overlap.s);
    const int num = sweep->num_sums, num_nodes = sweep->num_s + sweep->num_m;
    std::ranges::fill(sweep->by_nodes, 0.0);
    std::fill_n(sweep->by_corners.begin(), 3 * overlap.polygon.size * num, 0.0);
    std::ranges::fill(sweep->by_normal, 0.0);
    while (q < num_points
           and d.triangles[d.points[q].triangle].overlap == index)
    {
      const int first = q, triangle = d.points[q].triangle;
      while (q < num_points and q < first + most_points
             and d.points[q].triangle == triangle)
        ++q;
      add_points(*sweep, axes, first, q - first);
    }
    for (int k = 0; k < num_nodes; ++k)
      turn_back<true>(axes, sweep->node(k, 0), sweep->position(k, 0), num);
    for (int i = 0; i < overlap.polygon.size; ++i)
      turn_back<false>(axes, sweep->corner(i, 0), sweep->corner(i, 0), num);
    turn_back<false>(axes, sweep->normal(0), sweep->normal(0), num);
    for (int i = 0; i < overlap.polygon.size; ++i)
      add_corner(*sweep, overlap, i);
    add_normal(*sweep, overlap.s);
  }
}
} // namespace

//-----------------------------------------------------------------------------
void SegmentDerivative::clear()
{
  overlaps.clear();
  triangles.clear();
  points.clear();
}
//-----------------------------------------------------------------------------
void SegmentDerivative::add(std::span<const double> C, int num_sums, int num_s,
                            int num_m, std::span<double> by_positions) const
{
  Sweep sweep = {*this,
                 C.data(),
                 num_sums,
                 num_s,
                 num_m,
                 by_positions.data(),
                 std::vector<double>((num_s + num_m) * 3 * num_sums),
                 std::vector<double>(most_corners * 3 * num_sums),
                 std::vector<double>(3 * num_sums),
                 std::vector<double>(num_sums)};
  call_packed<sweep_overlaps>(&sweep);
}
//-----------------------------------------------------------------------------
Vec3 dolfinx_mortar::overlap_corner(const ClipVertex& v, const LinearPart& s,
                                    const LinearPart& m, const Vec3& n)
{
  if (v.kind == ClipVertex::Kind::slave)
    return s.corners[v.slave];
  if (v.kind == ClipVertex::Kind::master)
    return m.corners[v.master];
  const Vec3& xa = s.corners[v.slave];
  const Vec3& yc = m.corners[v.master];
  const Vec3 cd = m.corners[(v.master + 1) % m.size] - yc;
  const Vec3 e = n.cross(s.corners[(v.slave + 1) % s.size] - xa);
  return yc + ((xa - yc).dot(e) / cd.dot(e)) * cd;
}
