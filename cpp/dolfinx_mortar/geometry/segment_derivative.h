// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "clip.h"
#include "projection.h"
#include <array>
#include <span>
#include <vector>

namespace dolfinx_mortar
{
/// @brief How the points of segments follow the nodes of their two facets.
///
/// A point p = Σ b_i V_i of a triangle of an overlap is mapped along the normal
/// n₀ of the slave's part to x(ξ) = p + α n₀ on the slave and y(η) = p + β n₀
/// on the master. With the pullbacks L of both and twice the area A of the
/// triangle
///
///   dξ = L_s (dp + α dn₀ - Σ N_k dx_k),  dη = L_m (dp + β dn₀ - Σ N_l dy_l),
///   dw / w = dA / A + a₁·Σ N_k,₁ dx_k + a₂·Σ N_k,₂ dx_k - c·dn₀ + κ·dξ.
///
/// What is wanted are derivatives of sums over the points, and these are taken
/// backwards: from the places and weights of the points to the corners V and
/// n₀, which are few, from there to the nodes; and directly to the nodes.
struct SegmentDerivative
{
  /// Two linear parts that overlap
  struct Overlap
  {
    LinearPart s, m; // corners counter-clockwise about the slave's normal
    ClipPolygon polygon;
    std::array<Vec3, 16> V; // its corners

    /// @brief First edges of the triangle of corners 0, i and i + 1.
    Vec3 edge(int i) const { return V[i] - V[0]; }
  };

  /// Triangle of the corners 0, i and i + 1 of an overlap
  struct Triangle
  {
    int overlap, i;
  };

  /// Place of a point, and what is left of the formulae there
  struct Point
  {
    int triangle;
    std::array<double, 3> b;
    double w, alpha, beta;
    Mat23 Ls, Lm;
    Vec3 a1, a2, c;
    std::array<double, 2> kappa;
    std::array<double, max_facet_nodes> N, dN1, dN2, Nm;
  };

  std::vector<Overlap> overlaps;
  std::vector<Triangle> triangles;
  std::vector<Point> points;

  void clear();

  /// @brief Add the derivatives of sums over the points by the positions of the
  /// nodes.
  ///
  /// @param[in] C Derivatives of the sums by (ξ₁, ξ₂, η₁, η₂, w) at the points,
  /// shape (num_points, 5, num_sums).
  /// @param[in] num_sums Number of sums, a multiple of 4.
  /// @param[in] num_s,num_m Numbers of nodes of both facets.
  /// @param[in,out] by_positions Derivatives by the positions of the slave
  /// nodes, then of the master nodes, shape (3 (num_s + num_m), num_sums).
  void add(std::span<const double> C, int num_sums, int num_s, int num_m,
           std::span<double> by_positions) const;
};

/// @brief Position of a corner of an overlap: a corner of one of the parts, or
/// the place of a master edge in the plane through a slave edge along n.
Vec3 overlap_corner(const ClipVertex& v, const LinearPart& s,
                    const LinearPart& m, const Vec3& n);
} // namespace dolfinx_mortar
