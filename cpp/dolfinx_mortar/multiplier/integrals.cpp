// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "integrals.h"
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

using namespace dolfinx_mortar;

namespace
{
/// Share of its diameter within which a facet touches a master. Where functions
/// have negative parts weighted gaps can be negative without any penetration,
/// and distant facets would be drawn into contact. The demo of sliding shells
/// takes the same iterations with 0.01 and 0.2, and fails without (measured
/// when the rule was one for facets, not for nodes).
constexpr double touching = 0.05;

/// Share of its largest value that the function of a node has at points around
/// the node.
constexpr double around = 0.75;

using ConstRowMap = Eigen::Map<const RowMatrix>;

/// Positions relative to an origin, appended to `out`.
void append_relative(std::span<const double> x,
                     const std::array<double, 3>& origin,
                     std::vector<double>& out)
{
  for (std::size_t i = 0; i < x.size(); ++i)
  {
    if (!(std::abs(x[i]) <= largest_position))
    {
      throw std::runtime_error(
          "The position of a node of a slave or master facet is not finite "
          "(NaN, infinite or beyond 1e75): the solver has diverged. Take a "
          "smaller load step.");
    }
    out.push_back(x[i] - origin[i % 3]);
  }
}

/// Mean of the positions of nodes.
std::array<double, 3> centre(std::span<const double> x)
{
  std::array<double, 3> c = {0, 0, 0};
  for (std::size_t i = 0; i < x.size(); ++i)
    c[i % 3] += 3 * x[i] / x.size();
  return c;
}

/// Area of a facet.
double facet_area(const FacetView& f, const QuadratureRule& rule)
{
  SurfacePoint p;
  double area = 0;
  for (std::size_t q = 0; q < rule.weights.size(); ++q)
  {
    evaluate(f, {rule.points[2 * q], rule.points[2 * q + 1]}, 1, p);
    area += rule.weights[q] * p.a1.cross(p.a2).norm();
  }
  return area;
}

/// Largest distance between two nodes of a facet.
double diameter(const FacetView& f)
{
  const ConstRowMap x(f.x.data(), num_nodes(f.type), 3);
  double d = 0;
  for (int i = 0; i < x.rows(); ++i)
    d = std::max(d,
                 (x.rowwise() - x.row(i)).rowwise().squaredNorm().maxCoeff());
  return std::sqrt(d);
}

/// Unit outward normal of a facet in the plane of its corners.
Eigen::Vector3d normal(const FacetView& f)
{
  auto x = [&](int k)
  { return Eigen::Map<const Eigen::Vector3d>(f.x.data() + 3 * k); };
  const Eigen::Vector3d c = num_corners(f.type) == 3
                                ? (x(1) - x(0)).cross(x(2) - x(0))
                                : (x(3) - x(0)).cross(x(2) - x(1));
  return f.orientation * c.normalized();
}

/// Matrix X that extends values at nodes with multipliers to all multiplier
/// nodes of the space (rows): the mean of the former at the others, zero at
/// those that are left out.
RowMatrix extension(std::span<const std::int8_t> carries, int num_lambda)
{
  const int n = carries.size();
  RowMatrix X = RowMatrix::Zero(num_lambda, n);
  const int kept = std::count_if(carries.begin(), carries.begin() + num_lambda,
                                 [](auto c) { return c > 0; });
  if (kept == 0)
    return X;
  for (int j = 0; j < num_lambda; ++j)
  {
    if (carries[j] > 0)
      X(j, j) = 1;
    else if (carries[j] == 0)
    {
      for (int k = 0; k < num_lambda; ++k)
        X(j, k) = carries[k] > 0 ? 1.0 / kept : 0.0;
    }
  }
  return X;
}
} // namespace

//-----------------------------------------------------------------------------
FacetIntegrator::FacetIntegrator(const IntegrationOptions& options)
    : _options(options)
{
  if (options.degree and *options.degree < 1)
    throw std::invalid_argument("quadrature_degree must be positive.");
  if (!(options.max_angle > 0 and options.max_angle < 90))
    throw std::invalid_argument("max_angle must be between 0 and 90 degrees.");
}
//-----------------------------------------------------------------------------
const QuadratureRule& FacetIntegrator::rule(FacetType slave, FacetType master)
{
  const bool segment = _options.integration == Integration::segment;
  const int corners = segment ? 3 : num_corners(slave);
  // Kinks inside of the facet call for more points than smooth integrands
  int degree = default_degree(slave, master);
  if (!segment)
    degree = 2 * degree + 4;
  degree = _options.degree.value_or(degree);
  const std::array<int, 3> key = {corners, degree, 0};
  auto it = _rules.find(key);
  if (it == _rules.end())
    it = _rules.emplace(key, create_rule(corners, degree)).first;
  return it->second;
}
//-----------------------------------------------------------------------------
void FacetIntegrator::Facet::apply_coefficients(RowMatrix& B) const
{
  if (dual)
  {
    chol.solve(B);
    B.array().colwise() *= mass.array();
  }
}
//-----------------------------------------------------------------------------
void FacetIntegrator::start(const FacetView& slave,
                            std::span<const double> normals)
{
  _result.master_blocks.clear();
  _result.covered = false;
  _result.orphan = false;
  _result.touches.fill(0);
  _result.area = 0;
  _result.volume = 0;
  _result.dropped_area = 0;
  _result.lost = 0;
  _result.beyond = 0;

  _facet.slave = slave;
  _facet.slave.origin = centre(slave.x);
  _facet.x_slave.clear();
  append_relative(slave.x, _facet.slave.origin, _facet.x_slave);
  _facet.slave.x = _facet.x_slave;
  _facet.normals = normals;
  _facet.dual = is_dual(_options.space);
  _facet.n = num_nodes(slave.type);
  _facet.nl = num_multipliers(_options.space, slave.type);
}
//-----------------------------------------------------------------------------
void FacetIntegrator::leave_out()
{
  _result.area = 0;
  _result.master_blocks.clear();
}
//-----------------------------------------------------------------------------
void FacetIntegrator::drop()
{
  _result.dropped_area += _result.area;
  leave_out();
  _result.lost = lost_share();
}
//-----------------------------------------------------------------------------
void FacetIntegrator::copy_masters(const FacetList& list,
                                   std::span<const std::int32_t> masters)
{
  std::vector<double>& x = _facet.x_masters;
  x.clear();
  for (std::int32_t f : masters)
  {
    const std::int32_t begin = list.offsets[f];
    append_relative(
        std::span(list.x).subspan(3 * begin, 3 * (list.offsets[f + 1] - begin)),
        _facet.slave.origin, x);
  }
  // Views of `x`, which grows no more
  _facet.masters.clear();
  std::size_t at = 0;
  for (std::int32_t f : masters)
  {
    const std::size_t size = 3 * (list.offsets[f + 1] - list.offsets[f]);
    _facet.masters.push_back({list.types[f], list.orientation[f],
                              std::span(x).subspan(at, size),
                              _facet.slave.origin});
    at += size;
  }
}
//-----------------------------------------------------------------------------
double FacetIntegrator::lost_share()
{
  if (_result.dropped_area == 0)
    return 0;
  const FacetType type = _facet.slave.type;
  const int corners = num_corners(type), degree = 2 * total_degree(type);
  auto [it, made] = _rules.try_emplace({corners, degree, 0});
  if (made)
    it->second = create_rule(corners, degree);
  const double area = facet_area(_facet.slave, it->second);
  return std::clamp(std::min(_result.dropped_area, area - _result.area) / area,
                    0.0, 1.0);
}
//-----------------------------------------------------------------------------
void FacetIntegrator::sample(const FacetList& list,
                             std::span<const std::int32_t> masters,
                             bool derivatives)
{
  const std::size_t num_pairs = masters.size();
  if (_points.size() < num_pairs)
  {
    _points.resize(num_pairs);
    _shapes.resize(num_pairs);
  }
  copy_masters(list, masters);
  const std::vector<FacetView>& views = _facet.masters;
  for (std::size_t p = 0; p < num_pairs; ++p)
    _points[p].clear();

  const FacetView& slave = _facet.slave;
  if (_options.integration == Integration::segment)
  {
    for (std::size_t p = 0; p < num_pairs; ++p)
    {
      append_segment_points(slave, views[p], rule(slave.type, views[p].type),
                            AngleLimits(_options.max_angle), derivatives,
                            _points[p]);
    }
  }
  else if (num_pairs > 0)
  {
    append_element_points(slave, views, rule(slave.type, views[0].type),
                          AngleLimits(_options.max_angle), derivatives,
                          std::span(_points).first(num_pairs));
  }
}
//-----------------------------------------------------------------------------
void FacetIntegrator::number_masters(const FacetList& list,
                                     std::span<const std::int32_t> masters)
{
  std::vector<std::int64_t>& blocks = _result.master_blocks;
  blocks.clear();
  _result.dropped_area = 0;
  _facet.pairs.clear();
  _facet.columns.resize(std::max(_facet.columns.size(), masters.size()));
  for (std::size_t p = 0; p < masters.size(); ++p)
  {
    _result.dropped_area += _points[p].dropped_area;
    if (_points[p].w.empty())
      continue;
    _facet.pairs.push_back(p);
    _facet.columns[p].clear();
    const std::int32_t f = masters[p];
    for (std::int32_t i = list.offsets[f]; i < list.offsets[f + 1]; ++i)
    {
      auto it = std::find(blocks.begin(), blocks.end(), list.blocks[i]);
      _facet.columns[p].push_back(it - blocks.begin());
      if (it == blocks.end())
        blocks.push_back(list.blocks[i]);
    }
  }
  _facet.m = blocks.size();
}
//-----------------------------------------------------------------------------
void FacetIntegrator::keep_inside()
{
  for (int p : _facet.pairs)
  {
    PairPoints& points = _points[p];
    const std::size_t before = points.w.size(), nd = points.d.size() / before;
    auto move = [](std::vector<double>& v, std::size_t size, std::size_t from,
                   std::size_t to)
    { std::copy_n(v.begin() + size * from, size, v.begin() + size * to); };
    std::size_t after = 0;
    for (std::size_t q = 0; q < before; ++q)
    {
      if (!in_reference(_facet.slave.type,
                        {points.xi[2 * q], points.xi[2 * q + 1]}, 0))
      {
        points.dropped_area += points.w[q];
        continue;
      }
      if (after < q)
      {
        move(points.xi, 2, q, after);
        move(points.eta, 2, q, after);
        move(points.w, 1, q, after);
        move(points.d, nd, q, after);
      }
      ++after;
    }
    points.xi.resize(2 * after);
    points.eta.resize(2 * after);
    points.w.resize(after);
    points.d.resize(nd * after);
  }
}
//-----------------------------------------------------------------------------
void FacetIntegrator::tabulate_shapes(FacetType master,
                                      const PairPoints& points,
                                      bool derivatives, PairShapes& out) const
{
  const int n = _facet.n, nm = num_nodes(master);
  const int np = points.w.size();
  const int order = derivatives ? 1 : 0;
  out.N.resize(np, n);
  out.Nm.resize(np, nm);
  if (derivatives)
  {
    for (int a = 0; a < 2; ++a)
    {
      out.dN[a].resize(np, n);
      out.dNm[a].resize(np, nm);
    }
  }
  Shapes s;
  for (int q = 0; q < np; ++q)
  {
    tabulate(_facet.slave.type, {points.xi[2 * q], points.xi[2 * q + 1]}, order,
             s);
    std::copy_n(s.N.begin(), n, out.N.row(q).data());
    if (derivatives)
    {
      for (int a = 0; a < 2; ++a)
        std::copy_n(s.dN[a].begin(), n, out.dN[a].row(q).data());
    }
    tabulate(master, {points.eta[2 * q], points.eta[2 * q + 1]}, order, s);
    std::copy_n(s.N.begin(), nm, out.Nm.row(q).data());
    if (derivatives)
    {
      for (int a = 0; a < 2; ++a)
        std::copy_n(s.dN[a].begin(), nm, out.dNm[a].row(q).data());
    }
  }

  const bool identity = _facet.T.isIdentity(0);
  auto transform = [&](const RowMatrix& A, RowMatrix& At)
  {
    if (identity)
      At = A;
    else
      At.noalias() = A * _facet.T;
  };
  transform(out.N, out.Nt);
  if (derivatives)
  {
    for (int a = 0; a < 2; ++a)
      transform(out.dN[a], out.dNt[a]);
  }
}
//-----------------------------------------------------------------------------
void FacetIntegrator::tabulate_fields(const FacetView& master, bool derivatives,
                                      PairShapes& out) const
{
  const int np = out.N.rows();
  const ConstRowMap xs(_facet.slave.x.data(), _facet.n, 3),
      xm(master.x.data(), out.Nm.cols(), 3);
  const ConstRowMap nodal(_facet.normals.data(), _facet.n, 3);
  out.field.resize(np, 4);
  out.field.rightCols<3>().noalias() = out.N * xs;
  out.field.rightCols<3>().noalias() -= out.Nm * xm;
  out.normal.noalias() = out.N * nodal;
  const Eigen::VectorXd length = out.normal.rowwise().norm();
  if (!(length.minCoeff() > 1e-6))
    throw_folded(_facet.slave, Vec3::Zero());
  out.normal.array().colwise() /= length.array();
  out.field.col(0) = -(out.normal.array() * out.field.rightCols<3>().array())
                          .rowwise()
                          .sum();
  if (!derivatives)
    return;

  // ∂gap/∂m = -(I - n nᵀ) r / |m| for the non-normalised normal m
  out.gap_normal = out.field.rightCols<3>();
  out.gap_normal.array()
      += out.normal.array().colwise() * out.field.col(0).array();
  out.gap_normal.array().colwise() /= -length.array();
  for (int a = 0; a < 2; ++a)
  {
    RowMatrix& ds = out.dfield[a];
    ds.resize(np, 4);
    ds.rightCols<3>().noalias() = out.dN[a] * xs;
    const RowMatrix dm = out.dN[a] * nodal;
    ds.col(0) = (out.gap_normal.array() * dm.array()
                 - out.normal.array() * ds.rightCols<3>().array())
                    .rowwise()
                    .sum();
    RowMatrix& de = out.dfield[2 + a];
    de.resize(np, 4);
    de.rightCols<3>().noalias() = -(out.dNm[a] * xm);
    de.col(0)
        = -(out.normal.array() * de.rightCols<3>().array()).rowwise().sum();
  }
}
//-----------------------------------------------------------------------------
double FacetIntegrator::integrate_products(bool derivatives)
{
  const int nl = _facet.nl;
  _facet.S.setZero(nl, _facet.n);
  _facet.Sm.setZero(nl, _facet.m);
  _facet.b.setZero(nl, 4);
  _result.coverage.setZero(_facet.n);
  _result.master_normal.setZero(_facet.n, 3);
  _result.area = 0;
  _result.volume = 0;
  double nearest = std::numeric_limits<double>::max();
  RowMatrix WN;
  for (int p : _facet.pairs)
  {
    const FacetView& master = _facet.masters[p];
    PairShapes& s = _shapes[p];
    tabulate_shapes(master.type, _points[p], derivatives, s);
    tabulate_fields(master, derivatives, s);
    nearest = std::min(nearest, s.field.col(0).minCoeff());

    const Eigen::Map<const Eigen::VectorXd> w(_points[p].w.data(),
                                              _points[p].w.size());
    _result.area += w.sum();
    _result.volume += w.dot(s.field.col(0));
    const Eigen::VectorXd coverage = s.Nt.transpose() * w;
    _result.coverage += coverage;
    _result.master_normal.noalias() += coverage * normal(master).transpose();
    WN = s.Nt.leftCols(nl).array().colwise() * w.array();
    _facet.S.noalias() += WN.transpose() * s.Nt;
    _facet.b.noalias() += WN.transpose() * s.field;
    const RowMatrix part = WN.transpose() * s.Nm;
    for (int l = 0; l < s.Nm.cols(); ++l)
      _facet.Sm.col(_facet.columns[p][l]) += part.col(l);
  }
  return nearest;
}
//-----------------------------------------------------------------------------
bool FacetIntegrator::distant(double nearest) const
{
  if (!_options.leave_distant)
    return false;
  double reach = diameter(_facet.slave);
  for (int p : _facet.pairs)
    reach = std::max(reach, diameter(_facet.masters[p]));
  return nearest > _options.distance.value_or(reach);
}
//-----------------------------------------------------------------------------
void FacetIntegrator::find_touching()
{
  Eigen::RowVectorXd largest = Eigen::RowVectorXd::Zero(_facet.n);
  for (int p : _facet.pairs)
    largest = largest.cwiseMax(_shapes[p].Nt.colwise().maxCoeff());
  const double reach = touching * diameter(_facet.slave);
  for (int p : _facet.pairs)
  {
    const PairShapes& s = _shapes[p];
    for (int q = 0; q < s.field.rows(); ++q)
    {
      if (s.field(q, 0) > reach)
        continue;
      for (int k = 0; k < _facet.n; ++k)
        if (s.Nt(q, k) >= around * largest[k])
          _result.touches[k] = 1;
    }
  }
}
//-----------------------------------------------------------------------------
double FacetIntegrator::beyond_share() const
{
  const Vec3 normal = _result.master_normal.colwise().sum();
  const double limit = AngleLimits(_options.max_angle).part * normal.norm();
  double facing = 0;
  for (const SubFacet& sub : sub_facets(_facet.slave.type))
  {
    const LinearPart part(_facet.slave, sub);
    if (-normal.dot(part.n) >= limit)
      facing += part.size == 3 ? 0.5 * part.norm_c : part.norm_c;
  }
  return facing > 0 ? std::clamp(1 - _result.area / facing, 0.0, 1.0) : 0.0;
}
//-----------------------------------------------------------------------------
bool FacetIntegrator::factorise()
{
  _facet.mass = _result.coverage.head(_facet.nl);
  return !_facet.dual or _facet.chol.compute(_facet.S.leftCols(_facet.nl));
}
//-----------------------------------------------------------------------------
bool FacetIntegrator::weigh(std::span<const std::int8_t> carries)
{
  FacetIntegrals& r = _result;
  const int nl = _facet.nl;
  const RowMatrix& X = _facet.X;

  // First for all multiplier nodes of the space
  RowMatrix M = _facet.Sm, D = _facet.S, fields = _facet.b;
  _facet.apply_coefficients(M);
  _facet.apply_coefficients(D);
  _facet.apply_coefficients(fields);
  r.diagonal.setZero(_facet.n);
  if (_facet.dual)
  {
    // Biorthogonality, with the row sum of M: D and M then agree on constants
    // to round-off
    D.leftCols(nl).setZero();
    D.leftCols(nl).diagonal() = M.rowwise().sum();
    const Eigen::ArrayXd d = D.diagonal().head(nl);
    if ((d * _facet.mass.array() < 0).any()
        or (_facet.nonnegative and !(d.minCoeff() > 0)))
      return false;
    for (int j = 0; j < nl; ++j)
      r.diagonal[j] = carries[j] > 0 ? D(j, j) : 0.0;
  }

  // Then for those that carry a multiplier
  r.D_tilde.noalias() = X.transpose() * D;
  r.D.noalias() = r.D_tilde * _facet.T_inv;
  r.M.noalias() = X.transpose() * M;
  const RowMatrix kept = X.transpose() * fields;
  r.gap = kept.col(0);
  r.offset = kept.rightCols<3>();
  return true;
}
//-----------------------------------------------------------------------------
const FacetIntegrals& FacetIntegrator::compute(
    const FacetView& slave, std::span<const double> normals,
    std::span<const std::int8_t> carries, std::span<const std::int8_t> positive,
    std::span<const double> z, const FacetList& list,
    std::span<const std::int32_t> masters, Derivatives derivatives)
{
  const bool derive = derivatives != Derivatives::none;
  start(slave, normals);
  sample(list, masters, derive);
  number_masters(list, masters);
  if (_facet.pairs.empty())
  {
    _result.lost = lost_share();
    return _result;
  }

  _facet.T = transformation(_options.space, slave.type, positive);
  _facet.T_inv = inverse_transformation(_options.space, slave.type, positive);
  _facet.nonnegative = is_nonnegative(_options.space, slave.type, positive);
  double nearest = integrate_products(derive);
  // A linear part reaches beyond a facet whose edge is curved inwards. What
  // lies there is kept as a rule, since a neighbour lacks it, although
  // functions change their sign there. Where nothing else is covered, or too
  // little to outweigh it, the weight of a node would be negative.
  if (_facet.nonnegative and !(_result.coverage.head(_facet.nl).minCoeff() > 0))
  {
    keep_inside();
    number_masters(list, masters);
    if (_facet.pairs.empty())
    {
      leave_out();
      _result.lost = lost_share();
      return _result;
    }
    nearest = integrate_products(derive);
  }
  if (distant(nearest))
  {
    _result.dropped_area = 0;
    leave_out();
    return _result;
  }
  if (!factorise())
  {
    drop();
    return _result;
  }
  _result.lost = lost_share();
  _result.beyond = beyond_share();
  find_touching();
  _facet.X = extension(carries, _facet.nl);
  if (_facet.X.isZero(0))
  {
    _result.orphan = true;
    return _result;
  }

  if (!weigh(carries))
  {
    drop();
    return _result;
  }
  _result.covered = true;
  if (derive)
    differentiate(z, derivatives);
  return _result;
}
