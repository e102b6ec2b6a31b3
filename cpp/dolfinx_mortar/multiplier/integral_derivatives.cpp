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
// part of φ. So partial derivatives by these five numbers are all that is
// computed here; the points take them on to the positions.
// For standard functions A_e = I and c = z: nothing is left of (a), and of (b)
// the first term.

#include "integrals.h"
#include <dolfinx_mortar/common/pack.h>

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

  /// The size, rounded up to packs
  int width;

  Rows(int nl, int nm, int num_fields, bool dual, int num_other)
  {
    mass = 0;
    load = mass + (dual ? nl : 0);
    field = load + (dual ? 3 * nl : 0);
    slave = field + num_fields * nl;
    master = slave + 3 * num_other;
    size = master + 3 * nm;
    width = (size + pack_size - 1) / pack_size * pack_size;
  }
};

/// out = a x + b y, in packs and then one by one
MORTAR_INLINE void set_sum(int size, double a, const double* x, double b,
                           const double* y, double* out)
{
  int k = 0;
  for (; k + pack_size <= size; k += pack_size)
    store(out + k, a * load(x + k) + b * load(y + k));
  for (; k < size; ++k)
    out[k] = a * x[k] + b * y[k];
}

/// out = a x (z - l) + b y
MORTAR_INLINE void set_difference(int size, double a, const double* x,
                                  const double* z, double l, double b,
                                  const double* y, double* out)
{
  int k = 0;
  for (; k + pack_size <= size; k += pack_size)
    store(out + k, a * load(x + k) * (load(z + k) - l) + b * load(y + k));
  for (; k < size; ++k)
    out[k] = a * x[k] * (z[k] - l) + b * y[k];
}
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

  /// @brief Partial derivatives of the sums by (ξ₁, ξ₂, η₁, η₂, w) at all
  /// points: five rows of `_C` for each.
  static void fill_points(Linearisation* self, const Rows* rows,
                          const PairShapes* s, const double* w);

  /// @brief The rows of point q by coordinate a of both facets.
  void fill_by_coordinate(const Rows& rows, const PairShapes& s, int q, int a,
                          double w);

  /// @brief The row of point q by its weight.
  void fill_by_weight(const Rows& rows, const PairShapes& s, int q);

  /// @brief Explicit dependence of the gap on positions and nodal normals at
  /// fixed points, d(-n·r) = -n·dr + ∂(-n·r)/∂n dn.
  void add_explicit_gap(const Rows& rows, const PairPoints& points,
                        const PairShapes& s);

  /// @brief Explicit dependence of the jump on positions at fixed points, dr;
  /// after that of the gap.
  void add_explicit_jump(const Rows& rows, const PairPoints& points,
                         const PairShapes& s);

  /// @brief Add the table of a pair: its columns to the columns of the facet.
  void scatter(const Rows& rows, std::span<const int> columns);

  const Facet& _facet;
  int _num_fields;              // 1: gap; 4: and jump
  int _first_other, _num_other; // slave nodes outside of the biorthogonality

  RowMatrix _z;      // multipliers after sharing, shape (nl, 3)
  RowMatrix _z_rows; // the same, shape (3, nl)
  RowMatrix _c, _h;  // coefficients of λ_h and φ_h, shape (nl, 3 or num_fields)
  RowMatrix _d_mass; // sums over all pairs, in the order of Rows
  RowMatrix _d_load, _d_field, _d_slave, _d_master;
  RowMatrix _d_normal; // gap by nodal normals, shape (nl, 3 n)

  // Buffers for one pair
  RowMatrix _lambda, _field_h;
  std::array<RowMatrix, 2> _d_lambda, _d_field_h;
  RowMatrix _C;     // partial derivatives, shape (5 num_points, rows.width)
  RowMatrix _sums;  // sums by positions, shape (3 (n + nm), rows.width)
  RowMatrix _table; // the same, shape (rows.size, 3 (n + nm))
  RowMatrix _WN, _functions, _products;
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
  _z_rows = _z.transpose();
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
  _C.resize(5 * np, rows.width);
  call_packed<&Linearisation::fill_points>(this, &rows, &s, points.w.data());
  _sums.setZero(3 * (_facet.n + nm), rows.width);
  points.differentiate(std::span(_C.data(), _C.size()), rows.width, _facet.n,
                       nm, std::span(_sums.data(), _sums.size()));
  _table = _sums.leftCols(rows.size).transpose();
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
MORTAR_INLINE void FacetIntegrator::Linearisation::fill_by_coordinate(
    const Rows& rows, const PairShapes& s, int q, int a, double w)
{
  const int nl = _facet.nl, nm = s.Nm.cols(), other = _num_other;
  const double *N = s.Nt.row(q).data(), *dN = s.dNt[a].row(q).data();
  const bool own = s.psi.size() > 0;
  const double* nu = own ? s.psi.row(q).data() : N;
  const double* dnu = own ? s.dpsi[a].row(q).data() : dN;
  const double *Nm = s.Nm.row(q).data(), *dNm = s.dNm[a].row(q).data();
  double* C_xi = _C.row(5 * q + a).data();
  double* C_eta = _C.row(5 * q + 2 + a).data();
  std::fill(C_eta, C_eta + rows.field, 0.0);
  std::fill(C_eta + rows.slave, C_eta + rows.master, 0.0);
  std::fill(C_eta + rows.size, C_eta + rows.width, 0.0);
  std::fill(C_xi + rows.size, C_xi + rows.width, 0.0);

  if (_facet.dual)
    set_sum(nl, w, dN, 0, dN, C_xi + rows.mass);
  for (int i = 0; i < 3; ++i)
  {
    const double l = _lambda(q, i), dl = w * _d_lambda[a](q, i);
    if (_facet.dual)
    {
      set_difference(nl, w, dN, _z_rows.row(i).data(), l, -dl, N,
                     C_xi + rows.load + i * nl);
    }
    set_sum(other, dl, N + _first_other, w * l, dN + _first_other,
            C_xi + rows.slave + i * other);
    set_sum(nm, dl, Nm, 0, Nm, C_xi + rows.master + i * nm);
    set_sum(nm, w * l, dNm, 0, dNm, C_eta + rows.master + i * nm);
  }
  for (int f = 0; f < _num_fields; ++f)
  {
    set_sum(nl, w * (s.field(q, f) - _field_h(q, f)), dnu,
            w * (s.dfield[a](q, f) - _d_field_h[a](q, f)), nu,
            C_xi + rows.field + f * nl);
    set_sum(nl, w * s.dfield[2 + a](q, f), nu, 0, nu,
            C_eta + rows.field + f * nl);
  }
}
//-----------------------------------------------------------------------------
MORTAR_INLINE void
FacetIntegrator::Linearisation::fill_by_weight(const Rows& rows,
                                               const PairShapes& s, int q)
{
  const int nl = _facet.nl, nm = s.Nm.cols(), other = _num_other;
  const double *N = s.Nt.row(q).data(), *Nm = s.Nm.row(q).data();
  const double* nu = s.psi.size() > 0 ? s.psi.row(q).data() : N;
  double* C_w = _C.row(5 * q + 4).data();
  std::fill(C_w + rows.size, C_w + rows.width, 0.0);
  if (_facet.dual)
    set_sum(nl, 1, N, 0, N, C_w + rows.mass);
  for (int i = 0; i < 3; ++i)
  {
    const double l = _lambda(q, i);
    if (_facet.dual)
    {
      set_difference(nl, 1, N, _z_rows.row(i).data(), l, 0, N,
                     C_w + rows.load + i * nl);
    }
    set_sum(other, l, N + _first_other, 0, N, C_w + rows.slave + i * other);
    set_sum(nm, l, Nm, 0, Nm, C_w + rows.master + i * nm);
  }
  for (int f = 0; f < _num_fields; ++f)
  {
    set_sum(nl, s.field(q, f) - _field_h(q, f), nu, 0, nu,
            C_w + rows.field + f * nl);
  }
}
//-----------------------------------------------------------------------------
MORTAR_INLINE void FacetIntegrator::Linearisation::fill_points(
    Linearisation* self, const Rows* rows, const PairShapes* s, const double* w)
{
  const int num = s->N.rows();
  for (int q = 0; q < num; ++q)
  {
    for (int a = 0; a < 2; ++a)
      self->fill_by_coordinate(*rows, *s, q, a, w[q]);
    self->fill_by_weight(*rows, *s, q);
  }
}
//-----------------------------------------------------------------------------
void FacetIntegrator::Linearisation::add_explicit_gap(const Rows& rows,
                                                      const PairPoints& points,
                                                      const PairShapes& s)
{
  const int n = _facet.n, nl = _facet.nl, nm = s.Nm.cols(), np = s.N.rows();
  const Eigen::Map<const Eigen::VectorXd> w(points.w.data(), points.w.size());
  const auto base = s.base(nl);
  auto weigh = [&](const RowMatrix& vectors)
  {
    _WN.resize(np, 3 * nl);
    for (int i = 0; i < 3; ++i)
    {
      _WN.middleCols(i * nl, nl)
          = base.array().colwise() * (w.array() * vectors.col(i).array());
    }
  };
  weigh(s.normal);
  _functions.resize(np, n + nm);
  _functions << s.N, s.Nm;
  _products.noalias() = _WN.transpose() * _functions;
  for (int i = 0; i < 3; ++i)
  {
    for (int k = 0; k < n + nm; ++k)
    {
      _table.block(rows.field, 3 * k + i, nl, 1)
          += (k < n ? -1 : 1) * _products.block(i * nl, k, nl, 1);
    }
  }
  weigh(s.gap_normal);
  _products.noalias() = _WN.transpose() * s.N;
  for (int i = 0; i < 3; ++i)
  {
    for (int k = 0; k < n; ++k)
      _d_normal.col(3 * k + i) += _products.block(i * nl, k, nl, 1);
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
  _products.noalias() = _WN.transpose() * _functions;
  for (int i = 0; i < 3; ++i)
  {
    const int row = rows.field + (1 + i) * nl;
    for (int k = 0; k < n + nm; ++k)
    {
      _table.block(row, 3 * k + i, nl, 1)
          += (k < n ? 1 : -1) * _products.col(k);
    }
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
