// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "multiplier.h"
#include <array>
#include <cstdint>
#include <dolfinx_mortar/geometry/pair.h>
#include <dolfinx_mortar/surface/search.h>
#include <map>
#include <optional>
#include <span>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Which derivatives to compute.
enum class Derivatives : std::int8_t
{
  none,
  gap,         ///< of the contact force and the weighted gap
  gap_and_slip ///< and of the weighted relative position
};

using RowMatrix
    = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// @brief Mortar integrals of one slave facet with all its masters.
///
/// n is the number of its nodes, m the number of different nodes of its
/// masters. Rows of nodes without multiplier are zero. Derivatives are with
/// respect to the positions of the n slave nodes, then of the m master nodes.
struct FacetIntegrals
{
  /// Displacement blocks of the m master nodes; of the four nodes of its frame,
  /// where the master is a rigid tool
  std::vector<std::int64_t> master_blocks;

  /// False where no master covers any part of the facet (nothing else is set)
  bool covered = false;

  /// True where masters cover the facet but none of its nodes has a
  /// multiplier (then nothing else is set)
  bool without_multipliers = false;

  /// Covered area; area of overlaps left out, see PairPoints
  double area = 0, dropped_area = 0;

  /// Number of quadrature points
  std::int64_t num_points = 0;

  /// Share of the facet's area that is left out and that no other master covers
  double lost = 0;

  /// Share of the parts of the facet that face the masters (see max_angle) that
  /// lies beyond the edge of these
  double beyond = 0;

  /// Smallest gap at the points of the covered part
  double nearest = 0;

  /// Integral of the gap over the covered part: the volume between the surfaces
  double volume = 0;

  /// Non-zero for nodes around which the gap is below 5 % of the facet's
  /// diameter at some point: where Ñ_k is at least three quarters of its
  /// largest value at all points. Shape (n)
  std::array<std::int8_t, max_facet_nodes> touches = {};

  /// ∫ Ñ_k over the covered part, shape (n); where multipliers are made of ψ
  /// (see is_reproducing) ∫ ψ_k at corners
  Eigen::VectorXd coverage;

  /// ∫ Ñ_k n⁽²⁾ with the unit outward normals of the masters' facets, shape (n,
  /// 3)
  RowMatrix master_normal;

  /// Diagonal of D̃ (dual spaces), shape (n)
  Eigen::VectorXd diagonal;

  /// D̃_jk = ∫ Φ_j Ñ_k and D_jk = ∫ Φ_j N_k (D = D̃ T⁻¹), shape (n, n)
  RowMatrix D_tilde, D;

  /// M_jl = ∫ Φ_j N_l∘P, shape (n, m)
  RowMatrix M;

  /// Φ_j at the nodes of the facet, shape (n, n): Φ_j = Σ_k Φ_j(x_k) N_k
  RowMatrix functions;

  /// Weighted gap g̃_j = -∫ Φ_j (n·(x⁽¹⁾ - x⁽²⁾∘P) - offset), shape (n)
  Eigen::VectorXd gap;

  /// Weighted relative position ∫ Φ_j (x⁽¹⁾ - x⁽²⁾∘P), shape (n, 3)
  RowMatrix jump;

  /// Derivative of the contact force Bᵀz, B = [D, -M], with z fixed, shape
  /// (3 (n + m), 3 (n + m))
  RowMatrix d_force;

  /// Derivative of the weighted gap with fixed nodal normals, shape (n, 3 (n +
  /// m)), and with respect to the nodal normals, shape (n, 3 n)
  RowMatrix d_gap, d_gap_normal;

  /// Derivative of `jump`, shape (3 n, 3 (n + m))
  RowMatrix d_jump;
};

/// @brief Computes the mortar integrals of one slave facet after the other.
///
/// Dual functions are built on the covered part of the facet, with the same
/// quadrature points as everything else: A_e = D_e M_e⁻¹, D_e = diag ∫ Ñ_k,
/// M_e = ∫ Ñ_j Ñ_k (∫ ψ_j Ñ_k where they are made of ψ). They are biorthogonal
/// to round-off for any quadrature and any overlap, and their derivatives
/// include master positions.
class FacetIntegrator
{
public:
  explicit FacetIntegrator(const IntegrationOptions& options);

  /// @brief Integrate over one slave facet.
  ///
  /// @param[in] slave Slave facet.
  /// @param[in] normals Averaged normals of its nodes, shape (n, 3).
  /// @param[in] has_multiplier Shape (n): 1 for nodes that have a multiplier, 0
  /// for those whose function the others share, -1 for those that nothing acts
  /// at. The functions Φ of the other multiplier nodes of the space are shared
  /// equally among those.
  /// @param[in] nonnegative Flags of nodes for the basis transformation, see
  /// transformation; shape (n) or empty.
  /// @param[in] z Nodal multipliers, shape (n, 3); used for derivatives only.
  /// @param[in] list Facets that `masters` refers to.
  /// @param[in] masters Candidate master facets; one index where the list is an
  /// analytic tool.
  /// @param[in] derivatives Derivatives to compute.
  /// @param[in] offset What is added to the gap, Σ N_k offset_k; shape (n), or
  /// empty for nothing.
  /// @return Integrals, valid until the next call.
  /// @throw std::runtime_error The facet is folded, or a position is not finite
  /// or beyond 1e75.
  const FacetIntegrals&
  compute(const FacetView& slave, std::span<const double> normals,
          std::span<const std::int8_t> has_multiplier,
          std::span<const std::int8_t> nonnegative, std::span<const double> z,
          const FacetList& list, std::span<const std::int32_t> masters,
          Derivatives derivatives, std::span<const double> offset = {});

private:
  /// Shape functions and fields at the points of a pair, one row for each point
  struct PairShapes
  {
    RowMatrix N, Nt; // slave functions N and Ñ
    std::array<RowMatrix, 2> dN, dNt;
    RowMatrix psi; // ψ of the corners, where Φ is made of them, else empty
    std::array<RowMatrix, 2> dpsi;
    RowMatrix Nm; // master functions
    std::array<RowMatrix, 2> dNm;
    RowMatrix field;                 // gap and jump, shape (num_points, 4)
    std::array<RowMatrix, 4> dfield; // ∂/∂ξ₁, ∂/∂ξ₂, ∂/∂η₁, ∂/∂η₂
    RowMatrix normal;                // unit normal, shape (num_points, 3)
    RowMatrix gap_normal;            // ∂gap/∂(Σ N_k n_k), shape (num_points, 3)

    using Functions = Eigen::Ref<const RowMatrix, 0, Eigen::OuterStride<>>;

    /// Functions that the Φ are made of, shape (num_points, nl): Ñ, or ψ
    Functions base(int nl) const
    {
      return psi.size() > 0 ? Functions(psi) : Functions(Nt.leftCols(nl));
    }

    /// Their derivatives by a coordinate
    Functions dbase(int a, int nl) const
    {
      return psi.size() > 0 ? Functions(dpsi[a])
                            : Functions(dNt[a].leftCols(nl));
    }
  };

  /// The slave facet at hand: what the parts of `compute` share. Positions are
  /// relative to its centre, so that far from the origin no digits are lost.
  struct Facet
  {
    std::vector<double> x_slave, x_masters; // positions of nodes
    FacetView slave = {};
    std::span<const double> normals; // of its nodes
    std::span<const double> offset;  // of the gap at its nodes
    bool dual = false;               // Φ biorthogonal to Ñ
    bool reproducing = false;        // Φ made of ψ, see is_reproducing
    bool nonnegative = false;        // no Ñ_k is negative on the facet
    int n = 0, nl = 0, m = 0; // its nodes, those with a Φ, nodes of masters
    FacetMatrix T, T_inv;     // basis transformation

    bool analytic = false;                 // master is an analytic tool
    std::vector<FacetView> masters;        // all candidates
    std::vector<int> pairs;                // candidates that have points
    std::vector<std::vector<int>> columns; // of M, for the nodes of each

    // Of the functions ν that the Φ are made of: Ñ, or ψ
    RowMatrix S;           // ∫ ν_j Ñ_k, shape (nl, n); its first columns: M_e
    RowMatrix Sm;          // ∫ ν_j N_l∘P, shape (nl, m)
    RowMatrix b;           // ∫ ν_j (gap, jump), shape (nl, 4)
    Eigen::VectorXd mass;  // diagonal of D_e, ∫ Ñ_j, shape (nl)
    ScaledFactors factors; // of M_e, dual spaces only
    RowMatrix X; // shares of nodes with multiplier in the Φ, shape (nl, n)

    /// @brief From integrals with Ñ to integrals with Φ: multiply by A_e (dual
    /// functions, equations 4.7 and 4.15) or do nothing (standard, Φ = Ñ).
    void apply_coefficients(RowMatrix& B) const;
  };

  /// Derivatives of the integrals of one facet, see integral_derivatives.cpp
  class Linearisation;

  /// @brief Rule for a pair, made once.
  const QuadratureRule& rule(FacetType slave, FacetType master);

  /// @brief Rule for a whole facet, made once.
  const QuadratureRule& whole_rule(FacetType type, int degree);

  /// @brief Forget the last facet.
  void start(const FacetView& slave, std::span<const double> normals);

  /// @brief Report the facet as one that no master covers.
  void leave_out();

  /// @brief Leave out a sliver that cannot tell the functions apart.
  void drop();

  /// @brief Copy the positions of all candidates.
  void copy_masters(const FacetList& list,
                    std::span<const std::int32_t> masters);

  /// @brief What is lost for the part of the facet that is covered.
  double lost_share();

  /// @brief Quadrature points of the facet and an analytic tool.
  void sample_shape(const Frame& frame, bool derivatives);

  /// @brief Let the frame of a rigid tool stand for the nodes of its facets;
  /// after everything else.
  void carry_by_frame(const FacetList& list,
                      std::span<const std::int32_t> masters,
                      Derivatives derivatives);

  /// @brief Quadrature points of all pairs (γ_c, where the integrals of
  /// equations 3.5 to 3.7 are taken).
  void sample(const FacetList& list, std::span<const std::int32_t> masters,
              bool derivatives);

  /// @brief Number the different nodes of the masters that have points: the
  /// columns of M.
  void number_masters(const FacetList& list,
                      std::span<const std::int32_t> masters);

  /// @brief Drop the points that lie beyond the slave facet.
  void keep_inside();

  /// @brief N, Ñᵀ = Nᵀ T (equations 4.5, 4.13) and the master's N at the points
  /// of a pair.
  void tabulate_shapes(FacetType master, const PairPoints& points,
                       bool derivatives, PairShapes& shapes) const;

  /// @brief Normal n = Σ N_k n_k / |Σ N_k n_k|, relative position r = x⁽¹⁾ -
  /// x⁽²⁾∘P and gap -n·r at the points of a pair; after tabulate_shapes.
  void tabulate_fields(const FacetView& master, bool derivatives,
                       PairShapes& shapes) const;

  /// @brief Integrals of products with ν = Ñ or ψ: the right-hand sides of
  /// equations 3.5 to 3.7 with ν in place of Φ (S, Sm, b), ∫ Ñ_k, area and
  /// volume.
  /// @return Smallest gap of all points.
  double integrate_products(bool derivatives);

  /// @brief True where masters are too far away to matter.
  bool distant(double nearest) const;

  /// @brief Find the nodes around which the facet touches a master; after
  /// integrate_products.
  void find_touching();

  /// @brief Share of the parts that face the masters that no master covers;
  /// after integrate_products.
  double beyond_share() const;

  /// @brief Coefficients A_e = D_e M_e⁻¹ of the dual functions (equations 4.7,
  /// 4.15), as D_e and the factors of M_e.
  /// @return False where M_e is singular.
  bool factorise();

  /// @brief D̃ and D = D̃ T⁻¹ (equations 3.5, 4.12), M (3.6), weighted gap
  /// (3.7) and jump.
  /// @return False where the signs of D̃ are lost in round-off.
  bool weigh(std::span<const std::int8_t> has_multiplier);

  /// @brief Derivatives of Bᵀz (equation 3.4, z fixed), weighted gap and
  /// jump; after all others.
  void differentiate(std::span<const double> z, Derivatives derivatives);

  IntegrationOptions _options;
  std::map<std::array<int, 3>, QuadratureRule> _rules;
  std::vector<PairPoints> _points;
  std::vector<PairShapes> _shapes;
  Facet _facet;
  FacetIntegrals _result;
};
} // namespace dolfinx_mortar
