// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "integrals.h"
#include <algorithm>
#include <dolfinx_mortar/geometry/measures.h>
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

/// Matrix X that extends values at nodes with multipliers to all multiplier
/// nodes of the space (rows): the mean of the former at the others, zero at
/// those that are left out.
RowMatrix extension(std::span<const std::int8_t> has_multiplier, int num_lambda)
{
  const int n = has_multiplier.size();
  RowMatrix X = RowMatrix::Zero(num_lambda, n);
  const int kept = std::count_if(has_multiplier.begin(),
                                 has_multiplier.begin() + num_lambda,
                                 [](auto c) { return c > 0; });
  if (kept == 0)
    return X;
  for (int j = 0; j < num_lambda; ++j)
  {
    if (has_multiplier[j] > 0)
      X(j, j) = 1;
    else if (has_multiplier[j] == 0)
    {
      for (int k = 0; k < num_lambda; ++k)
        X(j, k) = has_multiplier[k] > 0 ? 1.0 / kept : 0.0;
    }
  }
  return X;
}

/// Mean of the normals of an analytic tool at the points of a facet.
Vec3 mean_normal(const PairPoints& points)
{
  Vec3 sum = Vec3::Zero();
  for (std::size_t q = 0; q < points.w.size(); ++q)
    sum += points.w[q] * Vec3(points.normals.data() + 3 * q);
  return sum.normalized();
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
const QuadratureRule& FacetIntegrator::whole_rule(FacetType type, int degree)
{
  const int corners = num_corners(type);
  auto [it, made] = _rules.try_emplace({corners, degree, 0});
  if (made)
    it->second = create_rule(corners, degree);
  return it->second;
}
//-----------------------------------------------------------------------------
void FacetIntegrator::Facet::apply_coefficients(RowMatrix& B) const
{
  if (dual)
  {
    factors.solve(B);
    B.array().colwise() *= mass.array();
  }
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
double FacetIntegrator::lost_share()
{
  if (_result.dropped_area == 0)
    return 0;
  const FacetType type = _facet.slave.type;
  const double area
      = facet_area(_facet.slave, whole_rule(type, 2 * total_degree(type)));
  return std::clamp(std::min(_result.dropped_area, area - _result.area) / area,
                    0.0, 1.0);
}
//-----------------------------------------------------------------------------
void FacetIntegrator::number_masters(const FacetList& list,
                                     std::span<const std::int32_t> masters)
{
  std::vector<std::int64_t>& blocks = _result.master_blocks;
  blocks.clear();
  _result.dropped_area = 0;
  _result.num_points = 0;
  _facet.pairs.clear();
  _facet.columns.resize(std::max(_facet.columns.size(), masters.size()));
  for (std::size_t p = 0; p < masters.size(); ++p)
  {
    _result.dropped_area += _points[p].dropped_area;
    if (_points[p].w.empty())
      continue;
    _result.num_points += _points[p].w.size();
    _facet.pairs.push_back(p);
    _facet.columns[p].clear();
    if (_facet.analytic)
    {
      blocks.assign(list.frame->blocks.begin(), list.frame->blocks.end());
      _facet.columns[p] = {0, 1, 2, 3};
      continue;
    }
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
double FacetIntegrator::integrate_products(bool derivatives)
{
  const int nl = _facet.nl;
  _facet.S.setZero(nl, _facet.n);
  _facet.Sm.setZero(nl, _facet.m);
  _facet.b.setZero(nl, 4);
  _facet.mass.setZero(nl);
  _result.coverage.setZero(_facet.n);
  _result.master_normal.setZero(_facet.n, 3);
  _result.area = 0;
  _result.volume = 0;
  double nearest = std::numeric_limits<double>::max();
  RowMatrix WN, functions, products;
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
    const auto base = s.base(nl);
    Eigen::VectorXd coverage = s.Nt.transpose() * w;
    _facet.mass += coverage.head(nl);
    if (_facet.reproducing)
      coverage.head(nl) = base.transpose() * w;
    _result.coverage += coverage;
    const Vec3 normal
        = _facet.analytic ? mean_normal(_points[p]) : corner_normal(master);
    _result.master_normal.noalias() += coverage * normal.transpose();
    WN = base.array().colwise() * w.array();
    const int n = _facet.n, nm = s.Nm.cols();
    functions.resize(w.size(), n + 4 + nm);
    functions << s.Nt, s.field, s.Nm;
    products.noalias() = WN.transpose() * functions;
    _facet.S += products.leftCols(n);
    _facet.b += products.middleCols(n, 4);
    for (int l = 0; l < nm; ++l)
      _facet.Sm.col(_facet.columns[p][l]) += products.col(n + 4 + l);
  }
  return nearest;
}
//-----------------------------------------------------------------------------
bool FacetIntegrator::distant(double nearest) const
{
  if (!_options.leave_distant or (_facet.analytic and !_options.distance))
    return false;
  double reach = diameter(_facet.slave);
  for (int p : _facet.pairs)
    reach = std::max(reach, _facet.analytic ? 0 : diameter(_facet.masters[p]));
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
  return !_facet.dual
         or _facet.factors.compute(_facet.S.leftCols(_facet.nl),
                                   !_facet.reproducing);
}
//-----------------------------------------------------------------------------
bool FacetIntegrator::weigh(std::span<const std::int8_t> has_multiplier)
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
    // Biorthogonality, with the row sum of M: D and M then agree on constants,
    // which are Σ t_k Ñ_k with t = T⁻¹ 1, to round-off
    const int other = _facet.n - nl;
    const Eigen::VectorXd t = _facet.T_inv.rowwise().sum().tail(other);
    D.leftCols(nl).setZero();
    D.leftCols(nl).diagonal() = M.rowwise().sum() - D.rightCols(other) * t;
    const Eigen::ArrayXd d = D.diagonal().head(nl);
    if ((d * _facet.mass.array() < 0).any()
        or (_facet.nonnegative and !(d.minCoeff() > 0)))
      return false;
    for (int j = 0; j < nl; ++j)
      r.diagonal[j] = has_multiplier[j] > 0 ? D(j, j) : 0.0;
  }

  // Then for those that have a multiplier
  RowMatrix functions
      = (_facet.reproducing
             ? transformation(MultiplierSpace::dual_linear, _facet.slave.type)
             : _facet.T)
            .leftCols(nl)
            .transpose();
  _facet.apply_coefficients(functions);
  r.functions.noalias() = X.transpose() * functions;
  r.D_tilde.noalias() = X.transpose() * D;
  r.D.noalias() = r.D_tilde * _facet.T_inv;
  r.M.noalias() = X.transpose() * M;
  const RowMatrix kept = X.transpose() * fields;
  r.gap = kept.col(0);
  r.jump = kept.rightCols<3>();
  return true;
}
//-----------------------------------------------------------------------------
void FacetIntegrator::carry_by_frame(const FacetList& list,
                                     std::span<const std::int32_t> masters,
                                     Derivatives derivatives)
{
  FacetIntegrals& r = _result;
  const int n = _facet.n, m = _facet.m;
  const FrameView frame(list.frame->x);
  RowMatrix W = RowMatrix::Zero(m, 4); // x_l = Σ W_lf x_f
  for (int p : _facet.pairs)
  {
    const std::int32_t begin = list.offsets[masters[p]];
    for (std::size_t i = 0; i < _facet.columns[p].size(); ++i)
    {
      const Vec3 x(list.x.data() + 3 * (begin + i));
      W.row(_facet.columns[p][i])
          = frame_functions(frame.coordinates(x)).transpose();
    }
  }
  r.master_blocks.assign(list.frame->blocks.begin(), list.frame->blocks.end());
  r.M = RowMatrix(r.M * W);
  if (derivatives == Derivatives::none)
    return;
  auto gather_columns = [&](RowMatrix& A)
  {
    RowMatrix B = RowMatrix::Zero(A.rows(), 3 * (n + 4));
    B.leftCols(3 * n) = A.leftCols(3 * n);
    for (int l = 0; l < m; ++l)
    {
      for (int f = 0; f < 4; ++f)
      {
        B.middleCols(3 * (n + f), 3) += W(l, f) * A.middleCols(3 * (n + l), 3);
      }
    }
    A = std::move(B);
  };
  gather_columns(r.d_gap);
  if (derivatives == Derivatives::gap_and_slip)
    gather_columns(r.d_jump);
  gather_columns(r.d_force);
  RowMatrix by_rows = r.d_force.transpose();
  gather_columns(by_rows);
  r.d_force = by_rows.transpose();
}
//-----------------------------------------------------------------------------
const FacetIntegrals& FacetIntegrator::compute(
    const FacetView& slave, std::span<const double> normals,
    std::span<const std::int8_t> has_multiplier,
    std::span<const std::int8_t> nonnegative, std::span<const double> z,
    const FacetList& list, std::span<const std::int32_t> masters,
    Derivatives derivatives, std::span<const double> offset)
{
  const bool derive = derivatives != Derivatives::none;
  start(slave, normals);
  _facet.offset = offset;
  _facet.analytic = list.frame and list.frame->shape;
  sample(list, masters, derive);
  number_masters(list, masters);
  if (_facet.pairs.empty())
  {
    _result.lost = lost_share();
    return _result;
  }

  _facet.T = transformation(_options.space, slave.type, nonnegative);
  _facet.T_inv
      = inverse_transformation(_options.space, slave.type, nonnegative);
  _facet.nonnegative = is_nonnegative(_options.space, slave.type, nonnegative);
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
  // What lies beyond counts where functions fail, too: it can change these
  _result.beyond = beyond_share();
  if (!factorise())
  {
    drop();
    return _result;
  }
  _result.lost = lost_share();
  find_touching();
  _facet.X = extension(has_multiplier, _facet.nl);
  if (_facet.X.isZero(0))
  {
    _result.without_multipliers = true;
    return _result;
  }

  if (!weigh(has_multiplier))
  {
    drop();
    return _result;
  }
  _result.covered = true;
  _result.nearest = nearest;
  if (derive)
    differentiate(z, derivatives);
  if (list.frame and !_facet.analytic)
    carry_by_frame(list, masters, derivatives);
  return _result;
}
