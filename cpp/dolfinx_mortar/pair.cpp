// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "pair.h"
#include "clip.h"
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <stdexcept>

using namespace dolfinx_mortar;

namespace
{
using Vec3 = Eigen::Vector3d;
using Row24 = Eigen::Matrix<double, 1, 24>;
using Mat24 = Eigen::Matrix<double, 3, 24>;
using Mat23 = Eigen::Matrix<double, 2, 3>;

/// Corners closer to an edge than this, relative to the size of the slave
/// sub-facet, lie on it.
constexpr double clip_tolerance = 1e-9;

/// Overlaps smaller than this, relative to the area of the slave sub-facet,
/// are left out.
constexpr double sliver = 1e-10;

/// Normals oppose if their scalar product is below this.
constexpr double opposing = -1e-3;

Vec3 node(const FacetView& f, int k)
{
  return Eigen::Map<const Vec3>(f.x.data() + 3 * k);
}

/// Position and derivatives of a point of a facet.
struct SurfacePoint
{
  Shapes s;
  Vec3 x, a1, a2;
};

void evaluate(const FacetView& f, std::array<double, 2> xi, int order,
              SurfacePoint& p)
{
  tabulate(f.type, xi, order, p.s);
  p.x.setZero();
  p.a1.setZero();
  p.a2.setZero();
  for (int k = 0; k < num_nodes(f.type); ++k)
  {
    const Vec3 xk = node(f, k);
    p.x += p.s.N[k] * xk;
    p.a1 += p.s.dN[0][k] * xk;
    p.a2 += p.s.dN[1][k] * xk;
  }
}

/// x,ξ_iξ_j with i + j = `ij`
Vec3 second_derivative(const FacetView& f, const Shapes& s, int ij)
{
  Vec3 x = Vec3::Zero();
  for (int k = 0; k < num_nodes(f.type); ++k)
    x += s.ddN[ij][k] * node(f, k);
  return x;
}

/// First two rows of the inverse of [a₁ a₂ -n]: the map from a change of
/// position to the change of (ξ₁, ξ₂) along n.
Mat23 pullback(const Vec3& a1, const Vec3& a2, const Vec3& n)
{
  const double det = a1.cross(a2).dot(n);
  Mat23 L;
  L.row(0) = a2.cross(n) / det;
  L.row(1) = n.cross(a1) / det;
  return L;
}

/// Corners, centre and linear guess for the inverse map of a sub-facet.
struct LinearPart
{
  int size;
  std::array<int, 4> nodes;    // counter-clockwise about the outward normal
  std::array<Vec3, 4> corners; // in that order
  Vec3 centre, c, n;           // c = non-normalised normal
  double norm_c;
  Vec3 t1, t2;                // tangents at the centre
  Eigen::Vector2d xi, r1, r2; // reference centre and tangents

  LinearPart(const FacetView& f, const SubFacet& sub) : size(sub.size)
  {
    auto ref = node_coordinates(f.type);
    auto R = [&](int i)
    {
      return Eigen::Vector2d(ref[2 * sub.nodes[i]], ref[2 * sub.nodes[i] + 1]);
    };
    auto x = [&](int i) { return node(f, sub.nodes[i]); };
    if (size == 3)
    {
      t1 = x(1) - x(0);
      t2 = x(2) - x(0);
      r1 = R(1) - R(0);
      r2 = R(2) - R(0);
      centre = (x(0) + x(1) + x(2)) / 3;
      xi = (R(0) + R(1) + R(2)) / 3;
      c = t1.cross(t2);
      nodes = sub.nodes;
    }
    else
    {
      t1 = 0.5 * (x(1) - x(0) + x(3) - x(2));
      t2 = 0.5 * (x(2) - x(0) + x(3) - x(1));
      r1 = 0.5 * (R(1) - R(0) + R(3) - R(2));
      r2 = 0.5 * (R(2) - R(0) + R(3) - R(1));
      centre = 0.25 * (x(0) + x(1) + x(2) + x(3));
      xi = 0.25 * (R(0) + R(1) + R(2) + R(3));
      c = t1.cross(t2);
      nodes = {sub.nodes[0], sub.nodes[1], sub.nodes[3], sub.nodes[2]};
    }
    if (f.orientation < 0)
    {
      c = -c;
      std::reverse(nodes.begin(), nodes.begin() + size);
    }
    for (int i = 0; i < size; ++i)
      corners[i] = node(f, nodes[i]);
    norm_c = c.norm();
    n = c / norm_c;
  }

  /// Change of the non-normalised normal c for a change of each corner, as
  /// matrices W with dc = W dx
  std::array<Eigen::Matrix3d, 4> normal_derivative() const
  {
    auto cross_matrix = [](const Vec3& v)
    {
      Eigen::Matrix3d W;
      W << 0, -v[2], v[1], v[2], 0, -v[0], -v[1], v[0], 0;
      return W;
    };
    std::array<Eigen::Matrix3d, 4> W;
    // In counter-clockwise order c is (x₁-x₀)×(x₂-x₀) or ½(x₂-x₀)×(x₃-x₁),
    // whatever the orientation of the facet
    if (size == 3)
    {
      for (int i = 0; i < 3; ++i)
        W[i] = cross_matrix(corners[(i + 2) % 3] - corners[(i + 1) % 3]);
    }
    else
    {
      const Vec3 u = 0.5 * (corners[2] - corners[0]);
      const Vec3 v = 0.5 * (corners[3] - corners[1]);
      W[2] = -cross_matrix(v);
      W[0] = cross_matrix(v);
      W[3] = cross_matrix(u);
      W[1] = -cross_matrix(u);
    }
    return W;
  }
};

/// Map a point p along n to a facet: x(ξ) = p + α n.
/// @param[in] guess Starting point.
/// @return False where the iteration does not converge.
bool project(const FacetView& f, const Vec3& p, const Vec3& n,
             std::array<double, 2>& xi, int order, SurfacePoint& point,
             Mat23& L)
{
  for (int it = 0; it < 25; ++it)
  {
    evaluate(f, xi, 1, point);
    L = pullback(point.a1, point.a2, n);
    const Eigen::Vector2d step = L * (p - point.x);
    const double size = step.lpNorm<Eigen::Infinity>();
    if (!(size < 10))
      return false;
    xi[0] += step[0];
    xi[1] += step[1];
    if (size < 1e-8)
    {
      if (size > 1e-15 or order > 1)
      {
        evaluate(f, xi, order, point);
        L = pullback(point.a1, point.a2, n);
      }
      return true;
    }
  }
  return false;
}

std::string position(const Vec3& x)
{
  std::stringstream s;
  s << "(" << x[0] << ", " << x[1] << ", " << x[2] << ")";
  return s.str();
}

[[noreturn]] void throw_folded(const Vec3& x)
{
  throw std::runtime_error("Slave facet near " + position(x)
                           + " is folded or inside out: refine the surface, or "
                             "take a smaller load step.");
}

/// Derivative with respect to the corners of a pair of sub-facets (slave, then
/// master, 3 columns each) of the corners of their overlap.
Mat24 vertex_derivative(const ClipVertex& v, const LinearPart& s,
                        const LinearPart& m, const Vec3& n, const Mat24& dn,
                        Vec3& V)
{
  Mat24 dV = Mat24::Zero();
  const int offset = 3 * s.size;
  if (v.kind == ClipVertex::Kind::slave)
  {
    V = s.corners[v.slave];
    dV.block<3, 3>(0, 3 * v.slave).setIdentity();
  }
  else if (v.kind == ClipVertex::Kind::master)
  {
    V = m.corners[v.master];
    dV.block<3, 3>(0, offset + 3 * v.master).setIdentity();
  }
  else
  {
    // Point y_c + t (y_d - y_c) of the master edge in the plane through the
    // slave edge x_a, x_b and n: (y_c + t (y_d - y_c) - x_a)·e = 0 with
    // e = n × (x_b - x_a)
    const int a = v.slave, b = (v.slave + 1) % s.size;
    const int c = v.master, d = (v.master + 1) % m.size;
    const Vec3 ab = s.corners[b] - s.corners[a];
    const Vec3 cd = m.corners[d] - m.corners[c];
    const Vec3 e = n.cross(ab);
    const double denominator = cd.dot(e);
    const double t = (s.corners[a] - m.corners[c]).dot(e) / denominator;
    V = m.corners[c] + t * cd;
    // dt (cd·e) = (dx_a - (1-t) dy_c - t dy_d)·e - (V - x_a)·de
    const Vec3 r = V - s.corners[a];
    Row24 dt = Row24::Zero();
    // de = dn × ab + n × (dx_b - dx_a);  r·(dn × ab) = dn·(ab × r),
    // r·(n × dx) = dx·(r × n)
    dt.noalias() -= ab.cross(r).transpose() * dn;
    const Vec3 rn = r.cross(n);
    dt.segment<3>(3 * a) += (e + rn).transpose();
    dt.segment<3>(3 * b) -= rn.transpose();
    dt.segment<3>(offset + 3 * c) -= (1 - t) * e.transpose();
    dt.segment<3>(offset + 3 * d) -= t * e.transpose();
    dt /= denominator;
    dV.noalias() = cd * dt;
    dV.block<3, 3>(0, offset + 3 * c).diagonal().array() += 1 - t;
    dV.block<3, 3>(0, offset + 3 * d).diagonal().array() += t;
  }
  return dV;
}

Vec3 vertex_position(const ClipVertex& v, const LinearPart& s,
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

/// The derivative of log(|c| / |c·n|), c = a₁ × a₂.
struct MeasureDerivative
{
  Vec3 A, B, C; // d = A·da₁ + B·da₂ - C·dn

  MeasureDerivative(const SurfacePoint& p, const Vec3& n)
  {
    const Vec3 c = p.a1.cross(p.a2);
    const double cn = c.dot(n);
    const Vec3 r = c / c.squaredNorm() - n / cn;
    A = p.a2.cross(r);
    B = r.cross(p.a1);
    C = c / cn;
  }
};

using RowMajor
    = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Points of one pair of sub-facets.
void sub_pair_points(const FacetView& slave, const FacetView& master,
                     const LinearPart& s, const LinearPart& m,
                     const Mat24* dn_s, const QuadratureRule& rule,
                     PairPoints& points)
{
  const Vec3& n = s.n;

  // Coordinates in the plane, relative to the centre
  Vec3 e1 = (s.corners[1] - s.corners[0]);
  e1 = (e1 - e1.dot(n) * n).normalized();
  const Vec3 e2 = n.cross(e1);
  auto plane = [&](const Vec3& x) -> std::array<double, 2>
  { return {(x - s.centre).dot(e1), (x - s.centre).dot(e2)}; };
  std::array<std::array<double, 2>, 4> ps, pm;
  std::array<double, 4> box_s, box_m;
  auto fill = [&](const LinearPart& part, auto& p, auto& box)
  {
    constexpr double inf = std::numeric_limits<double>::max();
    box = {inf, inf, -inf, -inf};
    for (int i = 0; i < part.size; ++i)
    {
      p[i] = plane(part.corners[i]);
      for (int c = 0; c < 2; ++c)
      {
        box[c] = std::min(box[c], p[i][c]);
        box[2 + c] = std::max(box[2 + c], p[i][c]);
      }
    }
  };
  fill(s, ps, box_s);
  fill(m, pm, box_m);
  if (box_s[0] > box_m[2] or box_m[0] > box_s[2] or box_s[1] > box_m[3]
      or box_m[1] > box_s[3])
    return;

  // The master's corners run clockwise about the slave's normal: turn them,
  // without losing track of their edges
  LinearPart mr = m;
  std::reverse(mr.corners.begin(), mr.corners.begin() + m.size);
  std::reverse(mr.nodes.begin(), mr.nodes.begin() + m.size);
  std::reverse(pm.begin(), pm.begin() + m.size);

  const double size = std::max(box_s[2] - box_s[0], box_s[3] - box_s[1]);
  const ClipPolygon polygon
      = clip(std::span(ps).first(s.size), std::span(pm).first(m.size),
             clip_tolerance * size);
  if (polygon.size < 3)
    return;
  double area = 0;
  for (int i = 1; i + 1 < polygon.size; ++i)
  {
    const auto& a = polygon.vertices[0].p;
    const auto& b = polygon.vertices[i].p;
    const auto& c = polygon.vertices[i + 1].p;
    area += 0.5
            * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]));
  }
  const double area_s = s.size == 3 ? 0.5 * s.norm_c : s.norm_c;
  if (!(area > sliver * area_s))
  {
    points.dropped_area += std::max(area, 0.0);
    return;
  }

  const bool derivatives = dn_s != nullptr;
  std::array<Vec3, 16> V;
  std::array<Mat24, 16> dV;
  for (int i = 0; i < polygon.size; ++i)
  {
    if (derivatives)
      dV[i] = vertex_derivative(polygon.vertices[i], s, mr, n, *dn_s, V[i]);
    else
      V[i] = vertex_position(polygon.vertices[i], s, mr, n);
  }

  // Linear guesses for the points on the real facets
  auto guess_map = [&n](const LinearPart& part)
  {
    const Mat23 L = pullback(part.t1, part.t2, n);
    Eigen::Matrix2d R;
    R.col(0) = part.r1;
    R.col(1) = part.r2;
    return Mat23(R * L);
  };
  const Mat23 Gs = guess_map(s), Gm = guess_map(m);

  const int num_s = num_nodes(slave.type), num_m = num_nodes(master.type);
  const int nd = 3 * (num_s + num_m);
  const int nsub = 3 * (s.size + m.size);
  SurfacePoint qs, qm;
  Mat23 Ls, Lm;
  for (int i = 1; i + 1 < polygon.size; ++i)
  {
    const Vec3 E1 = V[i] - V[0], E2 = V[i + 1] - V[0];
    const Vec3 E12 = E1.cross(E2);
    const double area2 = E12.dot(n);
    Row24 darea2;
    if (derivatives)
    {
      darea2 = E12.transpose() * *dn_s
               + E2.cross(n).transpose() * (dV[i] - dV[0])
               + n.cross(E1).transpose() * (dV[i + 1] - dV[0]);
    }
    // Find all points of the triangle before any is appended
    const std::size_t num_rule = rule.weights.size();
    for (std::size_t q = 0; q < num_rule; ++q)
    {
      const double b1 = rule.points[2 * q], b2 = rule.points[2 * q + 1];
      const Vec3 p = V[0] + b1 * E1 + b2 * E2;
      auto start = [&p](const LinearPart& part, const Mat23& G)
      {
        const Eigen::Vector2d x = part.xi + G * (p - part.centre);
        return std::array<double, 2>{x[0], x[1]};
      };
      std::array<double, 2> xi = start(s, Gs);
      std::array<double, 2> eta = start(m, Gm);
      if (!project(slave, p, n, xi, derivatives ? 2 : 1, qs, Ls))
        throw_folded(p);
      if (!project(master, p, n, eta, 1, qm, Lm))
      {
        points.dropped_area += rule.weights[q] * area2;
        continue;
      }

      const Vec3 c = qs.a1.cross(qs.a2);
      const double cn = std::abs(c.dot(n));
      const double measure = c.norm() / cn;
      const double w = rule.weights[q] * area2 * measure;
      points.xi.insert(points.xi.end(), xi.begin(), xi.end());
      points.eta.insert(points.eta.end(), eta.begin(), eta.end());
      points.w.push_back(w);
      if (!derivatives)
        continue;

      const std::size_t at = points.d.size();
      points.d.resize(at + 5 * nd, 0.0);
      Eigen::Map<Eigen::Matrix<double, 5, Eigen::Dynamic, Eigen::RowMajor>> T(
          points.d.data() + at, 5, nd);

      const double alpha = n.dot(qs.x - p), beta = n.dot(qm.x - p);
      const Mat24 dp = (1 - b1 - b2) * dV[0] + b1 * dV[i] + b2 * dV[i + 1];
      Eigen::Matrix<double, 5, 24> S;
      S.topRows<2>().noalias() = Ls * (dp + alpha * *dn_s);
      S.middleRows<2>(2).noalias() = Lm * (dp + beta * *dn_s);
      const MeasureDerivative dm(qs, n);
      S.row(4) = (rule.weights[q] * measure) * darea2
                 - w * (dm.C.transpose() * *dn_s);
      for (int j = 0; j < nsub / 3; ++j)
      {
        const int k = j < s.size ? s.nodes[j] : num_s + mr.nodes[j - s.size];
        T.middleCols<3>(3 * k) += S.middleCols<3>(3 * j);
      }
      // The facets themselves move
      for (int k = 0; k < num_s; ++k)
      {
        T.block<2, 3>(0, 3 * k) -= qs.s.N[k] * Ls;
        T.block<1, 3>(4, 3 * k)
            += w * (qs.s.dN[0][k] * dm.A + qs.s.dN[1][k] * dm.B).transpose();
      }
      for (int k = 0; k < num_m; ++k)
        T.block<2, 3>(2, 3 * (num_s + k)) -= qm.s.N[k] * Lm;
      const Vec3 a11 = second_derivative(slave, qs.s, 0);
      const Vec3 a12 = second_derivative(slave, qs.s, 1);
      const Vec3 a22 = second_derivative(slave, qs.s, 2);
      T.row(4) += w * (dm.A.dot(a11) + dm.B.dot(a12)) * T.row(0)
                  + w * (dm.A.dot(a12) + dm.B.dot(a22)) * T.row(1);
    }
  }
}
} // namespace

//-----------------------------------------------------------------------------
void dolfinx_mortar::append_segment_points(const FacetView& slave,
                                           const FacetView& master,
                                           const QuadratureRule& rule,
                                           bool derivatives, PairPoints& points)
{
  for (const SubFacet& sub_s : sub_facets(slave.type))
  {
    const LinearPart s(slave, sub_s);
    if (!(s.norm_c > 0))
      throw_folded(s.centre);
    Mat24 dn;
    if (derivatives)
    {
      dn.setZero();
      auto W = s.normal_derivative();
      for (int i = 0; i < s.size; ++i)
      {
        dn.block<3, 3>(0, 3 * i)
            = (Eigen::Matrix3d::Identity() - s.n * s.n.transpose()) * W[i]
              / s.norm_c;
      }
    }
    for (const SubFacet& sub_m : sub_facets(master.type))
    {
      const LinearPart m(master, sub_m);
      if (m.norm_c > 0 and s.n.dot(m.n) < opposing)
      {
        sub_pair_points(slave, master, s, m, derivatives ? &dn : nullptr, rule,
                        points);
      }
    }
  }
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::append_element_points(const FacetView& slave,
                                           std::span<const FacetView> masters,
                                           const QuadratureRule& rule,
                                           bool derivatives,
                                           std::span<PairPoints> points)
{
  const int num_s = num_nodes(slave.type);
  SurfacePoint qs, qm, best;
  for (std::size_t q = 0; q < rule.weights.size(); ++q)
  {
    const std::array<double, 2> xi
        = {rule.points[2 * q], rule.points[2 * q + 1]};
    evaluate(slave, xi, 1, qs);
    const Vec3 c = qs.a1.cross(qs.a2);
    const double norm_c = c.norm();
    if (!(norm_c > 0))
      throw_folded(qs.x);
    const Vec3 n = slave.orientation * c / norm_c;

    // Nearest hit
    int hit = -1;
    double distance = std::numeric_limits<double>::max();
    std::array<double, 2> eta_hit{};
    Mat23 Lm, L;
    for (std::size_t i = 0; i < masters.size(); ++i)
    {
      const FacetView& master = masters[i];
      for (const SubFacet& sub : sub_facets(master.type))
      {
        const LinearPart m(master, sub);
        if (!(m.norm_c > 0) or n.dot(m.n) > opposing)
          continue;
        const Mat23 P = pullback(m.t1, m.t2, n);
        const Eigen::Vector2d st = P * (qs.x - m.centre);
        if (st.lpNorm<Eigen::Infinity>() > 1.5)
          continue;
        std::array<double, 2> eta
            = {m.xi[0] + m.r1[0] * st[0] + m.r2[0] * st[1],
               m.xi[1] + m.r1[1] * st[0] + m.r2[1] * st[1]};
        if (project(master, qs.x, n, eta, 1, qm, L)
            and in_reference(master.type, eta, 1e-10))
        {
          const double beta = std::abs(n.dot(qm.x - qs.x));
          if (beta < distance)
          {
            hit = i;
            distance = beta;
            eta_hit = eta;
            best = qm;
            Lm = L;
          }
          break;
        }
      }
    }
    if (hit < 0)
      continue;

    PairPoints& out = points[hit];
    const double w = rule.weights[q] * norm_c;
    out.xi.insert(out.xi.end(), xi.begin(), xi.end());
    out.eta.insert(out.eta.end(), eta_hit.begin(), eta_hit.end());
    out.w.push_back(w);
    if (!derivatives)
      continue;

    const int num_m = num_nodes(masters[hit].type);
    const int nd = 3 * (num_s + num_m);
    const std::size_t at = out.d.size();
    out.d.resize(at + 5 * nd, 0.0);
    Eigen::Map<RowMajor> T(out.d.data() + at, 5, nd);
    const double beta = n.dot(best.x - qs.x);
    const Eigen::Matrix3d Pn = (Eigen::Matrix3d::Identity() - n * n.transpose())
                               * (slave.orientation / norm_c);
    for (int k = 0; k < num_s; ++k)
    {
      // dc = dN₁ dx × a₂ + dN₂ a₁ × dx
      const Vec3 v = qs.s.dN[0][k] * qs.a2 - qs.s.dN[1][k] * qs.a1;
      Eigen::Matrix3d dc; // dc = dx × v
      dc << 0, v[2], -v[1], -v[2], 0, v[0], v[1], -v[0], 0;
      T.block<2, 3>(2, 3 * k)
          = Lm * (qs.s.N[k] * Eigen::Matrix3d::Identity() + beta * (Pn * dc));
      T.block<1, 3>(4, 3 * k)
          = (rule.weights[q] / norm_c) * (c.transpose() * dc);
    }
    for (int k = 0; k < num_m; ++k)
      T.block<2, 3>(2, 3 * (num_s + k)) = -best.s.N[k] * Lm;
  }
}
