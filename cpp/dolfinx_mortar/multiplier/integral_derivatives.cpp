// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT
//
// Derivatives of the integrals of one slave facet with respect to the positions
// of its nodes and those of its masters.
//
// Dual functions Φ_j = Σ a_jk ν_k are made of ν = Ñ, or of the corners' ν = ψ
// (see is_reproducing). They depend on positions by their coefficients A_e =
// D_e M_e⁻¹, M_e = ∫ ν_j Ñ_k, which are not differentiated one by one. The
// multiplier is λ_h = Σ c_k ν_k with M_eᵀ c = D_e z, so that
//
//   M_eᵀ dc = Σ_q d(w Ñ_k) z_k - d(w Ñ_k λ_h)|c,                          (a)
//
// and, with M_e h = ∫ ν φ for a field φ (gap or jump), ∫ Φ φ = D_e h and
//
//   M_e dh = Σ_q d(w ν_k φ) - d(w ν_k φ_h)|h,  φ_h = Σ h_k Ñ_k.           (b)
//
// Positions enter a point by (ξ₁, ξ₂, η₁, η₂, w) alone, besides the explicit
// part of φ. So each pair takes one product: partial derivatives by these five
// numbers times the derivatives of the five, which come with the points.
// For standard functions A_e = I and c = z: nothing is left of (a), and of (b)
// the first term.

#include "integrals.h"

using namespace dolfinx_mortar;

namespace
{
using ConstRowMap = Eigen::Map<const RowMatrix>;

/// Where the sums over the points of a pair start among the rows of its table.
struct Rows
{
  /// ∫ Ñ_k (dual functions only)
  int mass;

  /// Right-hand side of (a), one component after the other (dual only)
  int load;

  /// Right-hand side of (b), one field after the other
  int field;

  /// ∫ λ_h Ñ_k for slave nodes k outside of the biorthogonality
  int slave;

  /// ∫ λ_h N_l∘P
  int master;

  int size;

  Rows(int nl, int nm, int num_fields, bool dual, int num_other)
  {
    mass = 0;
    load = mass + (dual ? nl : 0);
    field = load + (dual ? 3 * nl : 0);
    slave = field + num_fields * nl;
    master = slave + 3 * num_other;
    size = master + 3 * nm;
  }
};
} // namespace

/// @brief Sums over the pairs of a facet, and what follows from them.
class FacetIntegrator::Linearisation
{
public:
  /// @param[in] z Nodal multipliers, shape (n, 3).
  /// @param[in] num_fields 1: gap; 4: and jump.
  Linearisation(const Facet& facet, std::span<const double> z, int num_fields);

  /// @brief Add the points of a pair.
  /// @param[in] columns Column of M for each node of the master.
  void add_pair(const PairPoints& points, const PairShapes& s,
                std::span<const int> columns);

  /// @brief Derivative of Bᵀz = [D, -M]ᵀ z (equation 3.4), z fixed.
  void differentiate_force(RowMatrix& d_force);

  /// @brief Derivatives of the weighted gap (equation 3.7) and jump.
  void differentiate_fields(FacetIntegrals& r);

private:
  /// @brief λ_h, φ_h and their derivatives by (ξ₁, ξ₂) at the points of a pair.
  void interpolate(const PairShapes& s);

  /// @brief Partial derivatives of the sums by (ξ₁, ξ₂, η₁, η₂) at point q, of
  /// weight w: four rows of `_C`.
  void fill_by_coordinates(const Rows& rows, const PairShapes& s, int q,
                           double w);

  /// @brief Partial derivatives by the weight at point q: the fifth row.
  void fill_by_weight(const Rows& rows, const PairShapes& s, int q);

  /// @brief Explicit dependence of the gap on positions and nodal normals at
  /// fixed points, d(-n·r) = -n·dr + ∂(-n·r)/∂n dn.
  void add_explicit_gap(const Rows& rows, const PairPoints& points,
                        const PairShapes& s);

  /// @brief Explicit dependence of the jump on positions at fixed points, dr.
  void add_explicit_jump(const Rows& rows, const PairPoints& points,
                         const PairShapes& s);

  /// @brief Add the table of a pair: its columns to the columns of the facet.
  void scatter(const Rows& rows, std::span<const int> columns);

  const Facet& _facet;
  int _num_fields;              // 1: gap; 4: and jump
  int _first_other, _num_other; // slave nodes outside of the biorthogonality

  RowMatrix _z;      // multipliers after sharing, shape (nl, 3)
  RowMatrix _c, _h;  // coefficients of λ_h and φ_h, shape (nl, 3 or num_fields)
  RowMatrix _d_mass; // sums over all pairs, in the order of Rows
  RowMatrix _d_load, _d_field, _d_slave, _d_master;
  RowMatrix _d_normal; // gap by nodal normals, shape (nl, 3 n)

  // Buffers for one pair
  RowMatrix _lambda, _field_h;
  std::array<RowMatrix, 2> _d_lambda, _d_field_h;
  RowMatrix _C;     // partial derivatives, shape (5 num_points, rows.size)
  RowMatrix _table; // sums by positions, shape (rows.size, 3 (n + nm))
  RowMatrix _WN;
};
//-----------------------------------------------------------------------------
FacetIntegrator::Linearisation::Linearisation(const Facet& facet,
                                              std::span<const double> z,
                                              int num_fields)
    : _facet(facet), _num_fields(num_fields)
{
  const int n = facet.n, nl = facet.nl, width = 3 * (n + facet.m);
  const bool dual = facet.dual;
  _num_other = dual ? n - nl : n;
  _first_other = n - _num_other;
  _z = facet.X * ConstRowMap(z.data(), n, 3);
  if (dual)
  {
    _c = _z.array().colwise() * facet.mass.array();
    facet.factors.solve_transposed(_c);
    _h = facet.b.leftCols(num_fields);
    facet.factors.solve(_h);
  }
  else
  {
    _c = _z;
    _h.setZero(nl, num_fields);
  }

  _d_mass.setZero(dual ? nl : 0, width);
  _d_load.setZero(dual ? 3 * nl : 0, width);
  _d_field.setZero(num_fields * nl, width);
  _d_slave.setZero(3 * _num_other, width);
  _d_master.setZero(3 * facet.m, width);
  _d_normal.setZero(nl, 3 * n);
}
//-----------------------------------------------------------------------------
void FacetIntegrator::Linearisation::add_pair(const PairPoints& points,
                                              const PairShapes& s,
                                              std::span<const int> columns)
{
  const int np = points.w.size(), nm = columns.size();
  const Rows rows(_facet.nl, nm, _num_fields, _facet.dual, _num_other);
  interpolate(s);
  _C.setZero(5 * np, rows.size);
  for (int q = 0; q < np; ++q)
  {
    fill_by_coordinates(rows, s, q, points.w[q]);
    fill_by_weight(rows, s, q);
  }
  const ConstRowMap d(points.d.data(), 5 * np, 3 * (_facet.n + nm));
  _table.noalias() = _C.transpose() * d;
  add_explicit_gap(rows, points, s);
  if (_num_fields == 4)
    add_explicit_jump(rows, points, s);
  scatter(rows, columns);
}
//-----------------------------------------------------------------------------
void FacetIntegrator::Linearisation::interpolate(const PairShapes& s)
{
  const int nl = _facet.nl;
  _lambda.noalias() = s.base(nl) * _c;
  _field_h.noalias() = s.Nt.leftCols(nl) * _h;
  for (int a = 0; a < 2; ++a)
  {
    _d_lambda[a].noalias() = s.dbase(a, nl) * _c;
    _d_field_h[a].noalias() = s.dNt[a].leftCols(nl) * _h;
  }
}
//-----------------------------------------------------------------------------
void FacetIntegrator::Linearisation::fill_by_coordinates(const Rows& rows,
                                                         const PairShapes& s,
                                                         int q, double w)
{
  const int nl = _facet.nl, nm = s.Nm.cols();
  const int first = _first_other, other = _num_other;
  const auto base = s.base(nl);
  for (int a = 0; a < 2; ++a)
  {
    const auto dbase = s.dbase(a, nl);
    double* C_xi = _C.row(5 * q + a).data();
    double* C_eta = _C.row(5 * q + 2 + a).data();
    for (int k = 0; k < nl; ++k)
    {
      const double N = w * s.Nt(q, k), dN = w * s.dNt[a](q, k);
      if (_facet.dual)
      {
        C_xi[rows.mass + k] = dN;
        for (int i = 0; i < 3; ++i)
        {
          C_xi[rows.load + i * nl + k]
              = dN * (_z(k, i) - _lambda(q, i)) - N * _d_lambda[a](q, i);
        }
      }
      const double nu = w * base(q, k), dnu = w * dbase(q, k);
      for (int f = 0; f < _num_fields; ++f)
      {
        C_xi[rows.field + f * nl + k]
            = dnu * (s.field(q, f) - _field_h(q, f))
              + nu * (s.dfield[a](q, f) - _d_field_h[a](q, f));
        C_eta[rows.field + f * nl + k] = nu * s.dfield[2 + a](q, f);
      }
    }
    for (int i = 0; i < 3; ++i)
    {
      const double l = w * _lambda(q, i), dl = w * _d_lambda[a](q, i);
      for (int k = 0; k < other; ++k)
      {
        C_xi[rows.slave + i * other + k]
            = dl * s.Nt(q, first + k) + l * s.dNt[a](q, first + k);
      }
      for (int k = 0; k < nm; ++k)
      {
        C_xi[rows.master + i * nm + k] = dl * s.Nm(q, k);
        C_eta[rows.master + i * nm + k] = l * s.dNm[a](q, k);
      }
    }
  }
}
//-----------------------------------------------------------------------------
void FacetIntegrator::Linearisation::fill_by_weight(const Rows& rows,
                                                    const PairShapes& s, int q)
{
  const int nl = _facet.nl, nm = s.Nm.cols();
  const int first = _first_other, other = _num_other;
  const auto base = s.base(nl);
  double* C_w = _C.row(5 * q + 4).data();
  for (int k = 0; k < nl; ++k)
  {
    const double N = s.Nt(q, k);
    if (_facet.dual)
    {
      C_w[rows.mass + k] = N;
      for (int i = 0; i < 3; ++i)
        C_w[rows.load + i * nl + k] = N * (_z(k, i) - _lambda(q, i));
    }
    for (int f = 0; f < _num_fields; ++f)
    {
      C_w[rows.field + f * nl + k]
          = base(q, k) * (s.field(q, f) - _field_h(q, f));
    }
  }
  for (int i = 0; i < 3; ++i)
  {
    for (int k = 0; k < other; ++k)
      C_w[rows.slave + i * other + k] = _lambda(q, i) * s.Nt(q, first + k);
    for (int k = 0; k < nm; ++k)
      C_w[rows.master + i * nm + k] = _lambda(q, i) * s.Nm(q, k);
  }
}
//-----------------------------------------------------------------------------
void FacetIntegrator::Linearisation::add_explicit_gap(const Rows& rows,
                                                      const PairPoints& points,
                                                      const PairShapes& s)
{
  const int n = _facet.n, nl = _facet.nl, nm = s.Nm.cols();
  const Eigen::Map<const Eigen::VectorXd> w(points.w.data(), points.w.size());
  const auto base = s.base(nl);
  for (int i = 0; i < 3; ++i)
  {
    _WN = base.array().colwise() * (w.array() * s.normal.col(i).array());
    const RowMatrix Gs = _WN.transpose() * s.N, Gm = _WN.transpose() * s.Nm;
    for (int k = 0; k < n; ++k)
      _table.block(rows.field, 3 * k + i, nl, 1) -= Gs.col(k);
    for (int k = 0; k < nm; ++k)
      _table.block(rows.field, 3 * (n + k) + i, nl, 1) += Gm.col(k);
    _WN = base.array().colwise() * (w.array() * s.gap_normal.col(i).array());
    const RowMatrix Gn = _WN.transpose() * s.N;
    for (int k = 0; k < n; ++k)
      _d_normal.col(3 * k + i) += Gn.col(k);
  }
}
//-----------------------------------------------------------------------------
void FacetIntegrator::Linearisation::add_explicit_jump(const Rows& rows,
                                                       const PairPoints& points,
                                                       const PairShapes& s)
{
  const int n = _facet.n, nl = _facet.nl, nm = s.Nm.cols();
  const Eigen::Map<const Eigen::VectorXd> w(points.w.data(), points.w.size());
  _WN = s.base(nl).array().colwise() * w.array();
  const RowMatrix Gs = _WN.transpose() * s.N, Gm = _WN.transpose() * s.Nm;
  for (int i = 0; i < 3; ++i)
  {
    const int row = rows.field + (1 + i) * nl;
    for (int k = 0; k < n; ++k)
      _table.block(row, 3 * k + i, nl, 1) += Gs.col(k);
    for (int k = 0; k < nm; ++k)
      _table.block(row, 3 * (n + k) + i, nl, 1) -= Gm.col(k);
  }
}
//-----------------------------------------------------------------------------
void FacetIntegrator::Linearisation::scatter(const Rows& rows,
                                             std::span<const int> columns)
{
  const int n = _facet.n, nl = _facet.nl, m = _facet.m, nm = columns.size();
  auto add = [&](RowMatrix& A, int row_A, int row, int size)
  {
    A.block(row_A, 0, size, 3 * n) += _table.block(row, 0, size, 3 * n);
    for (int k = 0; k < nm; ++k)
    {
      A.block(row_A, 3 * (n + columns[k]), size, 3)
          += _table.block(row, 3 * (n + k), size, 3);
    }
  };
  if (_facet.dual)
  {
    add(_d_mass, 0, rows.mass, nl);
    add(_d_load, 0, rows.load, 3 * nl);
  }
  add(_d_field, 0, rows.field, _num_fields * nl);
  add(_d_slave, 0, rows.slave, 3 * _num_other);
  for (int i = 0; i < 3; ++i)
  {
    for (int k = 0; k < nm; ++k)
      add(_d_master, i * m + columns[k], rows.master + i * nm + k, 1);
  }
}
//-----------------------------------------------------------------------------
void FacetIntegrator::Linearisation::differentiate_force(RowMatrix& d_force)
{
  const int n = _facet.n, nl = _facet.nl, m = _facet.m, other = _num_other;
  const int width = 3 * (n + m);
  d_force.setZero(width, width);
  RowMatrix dF(n, width); // derivative of D̃ᵀz, one component
  for (int i = 0; i < 3; ++i)
  {
    if (other > 0)
      dF.bottomRows(other) = _d_slave.middleRows(i * other, other);
    if (_facet.dual)
    {
      RowMatrix dc = _d_load.middleRows(i * nl, nl);
      _facet.factors.solve_transposed(dc);
      _d_master.middleRows(i * m, m).noalias() += _facet.Sm.transpose() * dc;
      if (other > 0)
      {
        dF.bottomRows(other).noalias()
            += _facet.S.rightCols(other).transpose() * dc;
      }
      // D̃ is diagonal: its entries are ∫ Ñ_k
      dF.topRows(nl) = _d_mass.array().colwise() * _z.col(i).array();
    }
    const RowMatrix dF_nodal = _facet.T_inv.transpose() * dF;
    for (int k = 0; k < n; ++k)
      d_force.row(3 * k + i) = dF_nodal.row(k);
    for (int k = 0; k < m; ++k)
      d_force.row(3 * (n + k) + i) = -_d_master.row(i * m + k);
  }
}
//-----------------------------------------------------------------------------
void FacetIntegrator::Linearisation::differentiate_fields(FacetIntegrals& r)
{
  const int n = _facet.n, nl = _facet.nl;
  if (_num_fields == 4)
    r.d_jump.resize(3 * n, 3 * (n + _facet.m));
  for (int f = 0; f < _num_fields; ++f)
  {
    // ∫ Φ φ = D_e h, and D_e changes too
    RowMatrix dh = _d_field.middleRows(f * nl, nl);
    _facet.apply_coefficients(dh);
    if (_facet.dual)
      dh.array() += _d_mass.array().colwise() * _h.col(f).array();
    if (f == 0)
      r.d_gap.noalias() = _facet.X.transpose() * dh;
    else
    {
      const RowMatrix kept = _facet.X.transpose() * dh;
      for (int k = 0; k < n; ++k)
        r.d_jump.row(3 * k + f - 1) = kept.row(k);
    }
  }
  _facet.apply_coefficients(_d_normal);
  r.d_gap_normal.noalias() = _facet.X.transpose() * _d_normal;
}
//-----------------------------------------------------------------------------
void FacetIntegrator::differentiate(std::span<const double> z,
                                    Derivatives derivatives)
{
  Linearisation d(_facet, z, derivatives == Derivatives::gap_and_slip ? 4 : 1);
  for (int p : _facet.pairs)
    d.add_pair(_points[p], _shapes[p], _facet.columns[p]);
  d.differentiate_force(_result.d_force);
  d.differentiate_fields(_result);
}
