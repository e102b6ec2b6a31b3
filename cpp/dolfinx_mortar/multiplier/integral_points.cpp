// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT
//
// Quadrature points of a slave facet and its masters, and what integrands are
// made of at these points.

#include "integrals.h"
#include <algorithm>
#include <cmath>
#include <dolfinx_mortar/geometry/measures.h>
#include <dolfinx_mortar/geometry/packed_points.h>
#include <stdexcept>

using namespace dolfinx_mortar;

namespace
{
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

/// Shape functions of a facet at points, one row for each.
/// @param[in] xi Points, shape (n, 2).
/// @param[out] dN Derivatives by the two coordinates, where they are wanted.
void tabulate_at(FacetType type, std::span<const double> xi, bool derivatives,
                 RowMatrix& N, std::array<RowMatrix, 2>& dN)
{
  const int size = num_nodes(type), num_points = xi.size() / 2;
  N.resize(num_points, size);
  if (!derivatives)
    return tabulate_points(type, xi, N.data(), {nullptr, nullptr});
  for (int a = 0; a < 2; ++a)
    dN[a].resize(num_points, size);
  tabulate_points(type, xi, N.data(), {dN[0].data(), dN[1].data()});
}
} // namespace

//-----------------------------------------------------------------------------
void FacetIntegrator::start(const FacetView& slave,
                            std::span<const double> normals)
{
  _result.master_blocks.clear();
  _result.covered = false;
  _result.without_multipliers = false;
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
  _facet.reproducing = is_reproducing(_options.space, slave.type);
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
void FacetIntegrator::sample_shape(const Frame& frame, bool derivatives)
{
  const FacetView& slave = _facet.slave;
  _facet.x_masters.clear();
  append_relative(frame.x, slave.origin, _facet.x_masters);
  // What is asked of it are positions, not the type
  _facet.masters.assign(1,
                        {FacetType::quad4, 1, _facet.x_masters, slave.origin});
  _points[0].clear();
  const int degree
      = _options.degree.value_or(default_degree(slave.type, slave.type));
  append_shape_points(slave, *frame.shape, _facet.x_masters,
                      whole_rule(slave.type, degree),
                      AngleLimits(_options.max_angle), derivatives, _points[0]);
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
  if (_facet.analytic)
  {
    sample_shape(*list.frame, derivatives);
    return;
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
        if (!points.segments.points.empty())
          points.segments.points[after] = points.segments.points[q];
      }
      ++after;
    }
    points.xi.resize(2 * after);
    points.eta.resize(2 * after);
    points.w.resize(after);
    points.d.resize(nd * after);
    if (!points.segments.points.empty())
      points.segments.points.resize(after);
  }
}
//-----------------------------------------------------------------------------
void FacetIntegrator::tabulate_shapes(FacetType master,
                                      const PairPoints& points,
                                      bool derivatives, PairShapes& out) const
{
  tabulate_at(_facet.slave.type, points.xi, derivatives, out.N, out.dN);
  if (_facet.analytic)
  {
    using Rows = Eigen::Map<const RowMatrix, 0, Eigen::OuterStride<12>>;
    const Eigen::Index size = points.w.size();
    out.Nm = Rows(points.frame.data(), size, 4);
    for (int a = 0; a < 2; ++a)
      out.dNm[a] = Rows(points.frame.data() + 4 * (a + 1), size, 4);
  }
  else
    tabulate_at(master, points.eta, derivatives, out.Nm, out.dNm);
  out.psi.resize(0, 0);
  if (_facet.reproducing)
  {
    const FacetType corners
        = _facet.nl == 3 ? FacetType::tri3 : FacetType::quad4;
    tabulate_at(corners, points.xi, derivatives, out.psi, out.dpsi);
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
  const Eigen::Map<const Eigen::VectorXd> offset(_facet.offset.data(),
                                                 _facet.offset.size());
  if (!derivatives)
  {
    if (offset.size() > 0)
      out.field.col(0) += out.N * offset;
    return;
  }

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
  if (offset.size() > 0)
  {
    out.field.col(0) += out.N * offset;
    for (int a = 0; a < 2; ++a)
      out.dfield[a].col(0) += out.dN[a] * offset;
  }
}
