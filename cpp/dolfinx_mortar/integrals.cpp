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
using ConstRowMap = Eigen::Map<const RowMatrix>;

FacetView view(const FacetList& list, std::int32_t f)
{
  return {
      list.types[f], list.orientation[f],
      std::span(list.x).subspan(3 * list.offsets[f],
                                3 * (list.offsets[f + 1] - list.offsets[f]))};
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

/// Matrix X that extends values at nodes with multipliers to all multiplier
/// nodes of the space (rows): the mean of the former at the others.
RowMatrix extension(std::span<const std::int8_t> carries, int num_lambda)
{
  const int n = carries.size();
  RowMatrix X = RowMatrix::Zero(num_lambda, n);
  const int kept = std::count_if(carries.begin(), carries.begin() + num_lambda,
                                 [](auto c) { return c != 0; });
  if (kept == 0)
    return X;
  for (int j = 0; j < num_lambda; ++j)
  {
    if (carries[j])
      X(j, j) = 1;
    else
    {
      for (int k = 0; k < num_lambda; ++k)
        X(j, k) = carries[k] ? 1.0 / kept : 0.0;
    }
  }
  return X;
}

/// What the derivative of the integrals is made of, one row block for each;
/// see FacetIntegrator::compute.
struct Rows
{
  int mass, load, field, slave, master, size;

  Rows(int n_lambda, int num_m, int num_fields, bool dual, int num_generic)
  {
    mass = 0;
    load = mass + (dual ? n_lambda : 0);
    field = load + (dual ? 3 * n_lambda : 0);
    slave = field + num_fields * n_lambda;
    master = slave + 3 * num_generic;
    size = master + 3 * num_m;
  }
};
} // namespace

//-----------------------------------------------------------------------------
FacetIntegrator::FacetIntegrator(const IntegrationOptions& options)
    : _options(options)
{
  if (options.degree and *options.degree < 1)
    throw std::invalid_argument("quadrature_degree must be positive.");
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
void FacetIntegrator::tabulate_pair(const FacetView& slave,
                                    const FacetView& master,
                                    std::span<const double> normals,
                                    const FacetMatrix& T, bool derivatives,
                                    const PairPoints& points,
                                    PairShapes& out) const
{
  const int n = num_nodes(slave.type), nm = num_nodes(master.type);
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
    tabulate(slave.type, {points.xi[2 * q], points.xi[2 * q + 1]}, order, s);
    std::copy_n(s.N.begin(), n, out.N.row(q).data());
    if (derivatives)
    {
      for (int a = 0; a < 2; ++a)
        std::copy_n(s.dN[a].begin(), n, out.dN[a].row(q).data());
    }
    tabulate(master.type, {points.eta[2 * q], points.eta[2 * q + 1]}, order, s);
    std::copy_n(s.N.begin(), nm, out.Nm.row(q).data());
    if (derivatives)
    {
      for (int a = 0; a < 2; ++a)
        std::copy_n(s.dN[a].begin(), nm, out.dNm[a].row(q).data());
    }
  }

  const bool identity = T.isIdentity(0);
  auto transform = [&](const RowMatrix& A, RowMatrix& At)
  {
    if (identity)
      At = A;
    else
      At.noalias() = A * T;
  };
  transform(out.N, out.Nt);

  // Relative position r = x⁽¹⁾ - x⁽²⁾, normal field n, gap -n·r
  const ConstRowMap xs(slave.x.data(), n, 3), xm(master.x.data(), nm, 3);
  const ConstRowMap nodal(normals.data(), n, 3);
  out.field.resize(np, 4);
  out.field.rightCols<3>().noalias() = out.N * xs;
  out.field.rightCols<3>().noalias() -= out.Nm * xm;
  out.normal.noalias() = out.N * nodal;
  const Eigen::VectorXd length = out.normal.rowwise().norm();
  out.normal.array().colwise() /= length.array();
  out.field.col(0) = -(out.normal.array() * out.field.rightCols<3>().array())
                          .rowwise()
                          .sum();
  if (!derivatives)
    return;

  for (int a = 0; a < 2; ++a)
    transform(out.dN[a], out.dNt[a]);
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
const FacetIntegrals& FacetIntegrator::compute(
    const FacetView& slave, std::span<const double> normals,
    std::span<const std::int8_t> carries, std::span<const std::int8_t> positive,
    std::span<const double> z, const FacetList& list,
    std::span<const std::int32_t> masters, Derivatives derivatives)
{
  FacetIntegrals& r = _result;
  r.master_blocks.clear();
  r.covered = false;
  r.orphan = false;
  r.touches = false;
  r.area = 0;
  r.dropped_area = 0;
  const bool derive = derivatives != Derivatives::none;

  // Quadrature points
  const int num_pairs = masters.size();
  if (static_cast<int>(_points.size()) < num_pairs)
  {
    _points.resize(num_pairs);
    _shapes.resize(num_pairs);
  }
  std::vector<FacetView> views;
  for (int p = 0; p < num_pairs; ++p)
  {
    views.push_back(view(list, masters[p]));
    _points[p].clear();
  }
  if (_options.integration == Integration::segment)
  {
    for (int p = 0; p < num_pairs; ++p)
    {
      append_segment_points(slave, views[p], rule(slave.type, views[p].type),
                            derive, _points[p]);
    }
  }
  else if (num_pairs > 0)
  {
    append_element_points(slave, views, rule(slave.type, views[0].type), derive,
                          std::span(_points).first(num_pairs));
  }

  // Number the nodes of the masters met
  std::vector<int> pairs;
  std::vector<std::vector<int>> columns(num_pairs);
  for (int p = 0; p < num_pairs; ++p)
  {
    r.dropped_area += _points[p].dropped_area;
    if (_points[p].w.empty())
      continue;
    pairs.push_back(p);
    const std::int32_t f = masters[p];
    for (std::int32_t i = list.offsets[f]; i < list.offsets[f + 1]; ++i)
    {
      auto it = std::find(r.master_blocks.begin(), r.master_blocks.end(),
                          list.blocks[i]);
      columns[p].push_back(it - r.master_blocks.begin());
      if (it == r.master_blocks.end())
        r.master_blocks.push_back(list.blocks[i]);
    }
  }
  if (pairs.empty())
    return r;

  const MultiplierSpace space = _options.space;
  const bool dual = is_dual(space);
  const int n = num_nodes(slave.type), nl = num_multipliers(space, slave.type);
  const int m = r.master_blocks.size();
  const FacetMatrix T = transformation(space, slave.type, positive);
  const FacetMatrix T_inv = inverse_transformation(space, slave.type, positive);

  // ∫ Ñ_j Ñ_k, ∫ Ñ_j N_l and ∫ Ñ_j (gap, offset)
  RowMatrix S = RowMatrix::Zero(nl, n);
  RowMatrix Sm = RowMatrix::Zero(nl, m);
  RowMatrix b = RowMatrix::Zero(nl, 4);
  r.coverage.setZero(n);
  RowMatrix WN;
  double nearest = std::numeric_limits<double>::max();
  double reach = diameter(slave);
  for (int p : pairs)
  {
    PairShapes& s = _shapes[p];
    tabulate_pair(slave, views[p], normals, T, derive, _points[p], s);
    const Eigen::Map<const Eigen::VectorXd> w(_points[p].w.data(),
                                              _points[p].w.size());
    nearest = std::min(nearest, s.field.col(0).minCoeff());
    reach = std::max(reach, diameter(views[p]));
    r.area += w.sum();
    r.coverage.noalias() += s.Nt.transpose() * w;
    WN = s.Nt.leftCols(nl).array().colwise() * w.array();
    S.noalias() += WN.transpose() * s.Nt;
    b.noalias() += WN.transpose() * s.field;
    const RowMatrix part = WN.transpose() * s.Nm;
    for (int l = 0; l < s.Nm.cols(); ++l)
      Sm.col(columns[p][l]) += part.col(l);
  }

  r.touches = nearest <= 0.05 * diameter(slave);
  if (_options.leave_distant and nearest > _options.distance.value_or(reach))
  {
    r.area = 0;
    r.master_blocks.clear();
    return r;
  }

  // Multiplier functions Φ_j = Σ a_jk Ñ_k
  const Eigen::VectorXd mass = r.coverage.head(nl);
  ScaledCholesky chol;
  if (dual and !chol.compute(S.leftCols(nl)))
  {
    // Covered by a sliver that can not tell the functions apart
    r.dropped_area += r.area;
    r.area = 0;
    r.master_blocks.clear();
    return r;
  }
  const RowMatrix X = extension(carries, nl);
  if (X.isZero(0))
  {
    r.orphan = true;
    return r;
  }
  r.covered = true;
  auto apply_A = [&](RowMatrix& B)
  {
    if (dual)
    {
      chol.solve(B);
      B.array().colwise() *= mass.array();
    }
  };

  // D̃, M, gap, offset; first for all multiplier nodes of the space
  RowMatrix M = Sm, D = S, fields = b;
  apply_A(M);
  apply_A(D);
  apply_A(fields);
  r.diagonal.setZero(n);
  if (dual)
  {
    // Biorthogonality, with the row sum of M: D and M then agree on constants
    // to round-off
    D.leftCols(nl).setZero();
    D.leftCols(nl).diagonal() = M.rowwise().sum();
  }
  r.D_tilde.noalias() = X.transpose() * D;
  r.D.noalias() = r.D_tilde * T_inv;
  r.M.noalias() = X.transpose() * M;
  const RowMatrix kept = X.transpose() * fields;
  r.gap = kept.col(0);
  r.offset = kept.rightCols<3>();
  if (dual)
  {
    for (int j = 0; j < nl; ++j)
      r.diagonal[j] = carries[j] ? D(j, j) : 0.0;
  }
  if (!derive)
    return r;

  // ------------------------------------------------------------------------
  // Derivatives. λ_h = Σ c_k Ñ_k with c = M_e⁻¹ D_e z (dual), so
  //   M_e dc = Σ_q d(w Ñ_k) z_k - d(w Ñ_k λ_h)|c
  // and, with M_e h = ∫ Ñ φ for a field φ, ∫ Φ φ = D_e h,
  //   M_e dh = Σ_q d(w Ñ_k φ) - d(w Ñ_k φ_h)|h,  φ_h = Σ h_k Ñ_k.
  // At each point all of this is a linear function of the derivatives of
  // (ξ₁, ξ₂, η₁, η₂, w), plus the explicit part of φ.
  const int nf = derivatives == Derivatives::gap_and_slip ? 4 : 1;
  const int generic = dual ? n - nl : n;
  const int first_generic = n - generic;
  const int width = 3 * (n + m);
  const RowMatrix ze = X * ConstRowMap(z.data(), n, 3);
  RowMatrix c, h;
  if (dual)
  {
    c = ze.array().colwise() * mass.array();
    chol.solve(c);
    h = b.leftCols(nf);
    chol.solve(h);
  }
  else
  {
    c = ze;
    h = RowMatrix::Zero(nl, nf);
  }

  RowMatrix d_mass = RowMatrix::Zero(dual ? nl : 0, width);
  RowMatrix d_load = RowMatrix::Zero(dual ? 3 * nl : 0, width);
  RowMatrix d_field = RowMatrix::Zero(nf * nl, width);
  RowMatrix d_slave = RowMatrix::Zero(3 * generic, width);
  RowMatrix d_master = RowMatrix::Zero(3 * m, width);
  RowMatrix d_normal = RowMatrix::Zero(nl, 3 * n);

  RowMatrix C, acc;
  for (int p : pairs)
  {
    const PairShapes& s = _shapes[p];
    const PairPoints& points = _points[p];
    const int np = points.w.size();
    const int nm = s.Nm.cols();
    const int nd = 3 * (n + nm);
    const Rows rows(nl, nm, nf, dual, generic);
    const Eigen::Map<const Eigen::VectorXd> w(points.w.data(), np);

    const RowMatrix lambda = s.Nt.leftCols(nl) * c;
    const RowMatrix field_h = s.Nt.leftCols(nl) * h;
    std::array<RowMatrix, 2> d_lambda, d_field_h;
    for (int a = 0; a < 2; ++a)
    {
      d_lambda[a].noalias() = s.dNt[a].leftCols(nl) * c;
      d_field_h[a].noalias() = s.dNt[a].leftCols(nl) * h;
    }

    // Partial derivatives by (ξ₁, ξ₂, η₁, η₂, w), one row for each
    C.setZero(5 * np, rows.size);
    for (int q = 0; q < np; ++q)
    {
      for (int a = 0; a < 2; ++a)
      {
        double* C_xi = C.row(5 * q + a).data();
        double* C_eta = C.row(5 * q + 2 + a).data();
        for (int k = 0; k < nl; ++k)
        {
          const double N = w[q] * s.Nt(q, k), dN = w[q] * s.dNt[a](q, k);
          if (dual)
          {
            C_xi[rows.mass + k] = dN;
            for (int i = 0; i < 3; ++i)
            {
              C_xi[rows.load + i * nl + k]
                  = dN * (ze(k, i) - lambda(q, i)) - N * d_lambda[a](q, i);
            }
          }
          for (int f = 0; f < nf; ++f)
          {
            C_xi[rows.field + f * nl + k]
                = dN * (s.field(q, f) - field_h(q, f))
                  + N * (s.dfield[a](q, f) - d_field_h[a](q, f));
            C_eta[rows.field + f * nl + k] = N * s.dfield[2 + a](q, f);
          }
        }
        for (int i = 0; i < 3; ++i)
        {
          const double l = w[q] * lambda(q, i), dl = w[q] * d_lambda[a](q, i);
          for (int k = 0; k < generic; ++k)
          {
            C_xi[rows.slave + i * generic + k]
                = dl * s.Nt(q, first_generic + k)
                  + l * s.dNt[a](q, first_generic + k);
          }
          for (int k = 0; k < nm; ++k)
          {
            C_xi[rows.master + i * nm + k] = dl * s.Nm(q, k);
            C_eta[rows.master + i * nm + k] = l * s.dNm[a](q, k);
          }
        }
      }
      double* C_w = C.row(5 * q + 4).data();
      for (int k = 0; k < nl; ++k)
      {
        const double N = s.Nt(q, k);
        if (dual)
        {
          C_w[rows.mass + k] = N;
          for (int i = 0; i < 3; ++i)
            C_w[rows.load + i * nl + k] = N * (ze(k, i) - lambda(q, i));
        }
        for (int f = 0; f < nf; ++f)
        {
          C_w[rows.field + f * nl + k] = N * (s.field(q, f) - field_h(q, f));
        }
      }
      for (int i = 0; i < 3; ++i)
      {
        for (int k = 0; k < generic; ++k)
        {
          C_w[rows.slave + i * generic + k]
              = lambda(q, i) * s.Nt(q, first_generic + k);
        }
        for (int k = 0; k < nm; ++k)
          C_w[rows.master + i * nm + k] = lambda(q, i) * s.Nm(q, k);
      }
    }
    acc.noalias() = C.transpose() * ConstRowMap(points.d.data(), 5 * np, nd);

    // Explicit dependence of the gap (row 0) and the offset on positions, and
    // of the gap on the nodal normals
    const auto Nt = s.Nt.leftCols(nl);
    for (int i = 0; i < 3; ++i)
    {
      WN = Nt.array().colwise() * (w.array() * s.normal.col(i).array());
      const RowMatrix Gs = WN.transpose() * s.N, Gm = WN.transpose() * s.Nm;
      for (int k = 0; k < n; ++k)
        acc.block(rows.field, 3 * k + i, nl, 1) -= Gs.col(k);
      for (int k = 0; k < nm; ++k)
        acc.block(rows.field, 3 * (n + k) + i, nl, 1) += Gm.col(k);
      WN = Nt.array().colwise() * (w.array() * s.gap_normal.col(i).array());
      const RowMatrix Gn = WN.transpose() * s.N;
      for (int k = 0; k < n; ++k)
        d_normal.col(3 * k + i) += Gn.col(k);
    }
    if (nf == 4)
    {
      WN = Nt.array().colwise() * w.array();
      const RowMatrix Gs = WN.transpose() * s.N, Gm = WN.transpose() * s.Nm;
      for (int i = 0; i < 3; ++i)
      {
        const int row = rows.field + (1 + i) * nl;
        for (int k = 0; k < n; ++k)
          acc.block(row, 3 * k + i, nl, 1) += Gs.col(k);
        for (int k = 0; k < nm; ++k)
          acc.block(row, 3 * (n + k) + i, nl, 1) -= Gm.col(k);
      }
    }

    // Columns of the pair to columns of the facet
    auto add = [&](RowMatrix& A, int row_A, int row, int size)
    {
      A.block(row_A, 0, size, 3 * n) += acc.block(row, 0, size, 3 * n);
      for (int k = 0; k < nm; ++k)
      {
        A.block(row_A, 3 * (n + columns[p][k]), size, 3)
            += acc.block(row, 3 * (n + k), size, 3);
      }
    };
    if (dual)
    {
      add(d_mass, 0, rows.mass, nl);
      add(d_load, 0, rows.load, 3 * nl);
    }
    add(d_field, 0, rows.field, nf * nl);
    add(d_slave, 0, rows.slave, 3 * generic);
    for (int i = 0; i < 3; ++i)
    {
      for (int k = 0; k < nm; ++k)
        add(d_master, i * m + columns[p][k], rows.master + i * nm + k, 1);
    }
  }

  // Through the coefficients of the dual functions
  r.d_force.setZero(width, width);
  RowMatrix dF(n, width);
  for (int i = 0; i < 3; ++i)
  {
    if (generic > 0)
      dF.bottomRows(generic) = d_slave.middleRows(i * generic, generic);
    if (dual)
    {
      RowMatrix dc = d_load.middleRows(i * nl, nl);
      chol.solve(dc);
      d_master.middleRows(i * m, m).noalias() += Sm.transpose() * dc;
      if (generic > 0)
        dF.bottomRows(generic).noalias()
            += S.rightCols(generic).transpose() * dc;
      // D̃ is diagonal: its entries are ∫ Ñ_k
      dF.topRows(nl) = d_mass.array().colwise() * ze.col(i).array();
    }
    const RowMatrix dF_nodal = T_inv.transpose() * dF;
    for (int k = 0; k < n; ++k)
      r.d_force.row(3 * k + i) = dF_nodal.row(k);
    for (int k = 0; k < m; ++k)
      r.d_force.row(3 * (n + k) + i) = -d_master.row(i * m + k);
  }
  for (int f = 0; f < nf; ++f)
  {
    RowMatrix dh = d_field.middleRows(f * nl, nl);
    if (dual)
    {
      chol.solve(dh);
      dh.array().colwise() *= mass.array();
      dh.array() += d_mass.array().colwise() * h.col(f).array();
    }
    if (f == 0)
      r.d_gap.noalias() = X.transpose() * dh;
    else
    {
      if (f == 1)
        r.d_offset.resize(3 * n, width);
      const RowMatrix kept_rows = X.transpose() * dh;
      for (int k = 0; k < n; ++k)
        r.d_offset.row(3 * k + f - 1) = kept_rows.row(k);
    }
  }
  apply_A(d_normal);
  r.d_gap_normal.noalias() = X.transpose() * d_normal;
  return r;
}
