// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "projection.h"
#include "quadrature.h"
#include "segment_derivative.h"
#include <span>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Quadrature points of a pair of facets.
///
/// At a point everything depends on the positions q of the nodes of the pair
/// only through the five numbers (ξ₁, ξ₂, η₁, η₂, w), besides explicitly.
struct PairPoints
{
  /// Points on the slave facet, shape (num_points, 2)
  std::vector<double> xi;

  /// Points on the master facet, shape (num_points, 2)
  std::vector<double> eta;

  /// Weights: quadrature weight times surface measure of the slave facet,
  /// shape (num_points)
  std::vector<double> w;

  /// Derivatives of (ξ₁, ξ₂, η₁, η₂, w) with respect to the positions of the
  /// slave nodes, then of the master nodes, shape (num_points, 5, 3 (n_s +
  /// n_m)); empty unless asked for, and for segments
  std::vector<double> d;

  /// The same for segments, as what they are made of
  SegmentDerivative segments;

  /// On an analytic tool, in place of `eta`: functions of its frame at the
  /// closest point, and their derivatives along two tangents there, shape
  /// (num_points, 3, 4). ξ is fixed then, and η are lengths along the tangents
  std::vector<double> frame;

  /// Outward unit normals of the tool, shape (num_points, 3)
  std::vector<double> normals;

  /// Area of parts of the overlap that are left out: slivers, masters that are
  /// too steep, and points with no place on the master
  double dropped_area = 0;

  /// @brief Derivatives of sums over the points by the positions of the nodes,
  /// see SegmentDerivative::add.
  void differentiate(std::span<const double> C, int num_sums, int num_s,
                     int num_m, std::span<double> by_positions) const;

  void clear()
  {
    xi.clear();
    eta.clear();
    w.clear();
    d.clear();
    segments.clear();
    frame.clear();
    normals.clear();
    dropped_area = 0;
  }
};

/// @brief Quadrature points on the overlap of a pair of facets (segments).
///
/// Both facets are split into linear sub-facets. Each pair of sub-facets whose
/// normals oppose, up to an angle, is projected along the normal n₀ at the
/// centre of the slave sub-facet and clipped, the polygon is cut into
/// triangles, and each point of a triangle is mapped along n₀ to the *real*
/// slave and the *real* master facet, x(ξ) = p + α n₀. Weights are those of the
/// slave surface: plane area times |a₁ × a₂| / |(a₁ × a₂)·n₀| with the tangents
/// a of the slave facet.
///
/// @param[in] slave,master Facets.
/// @param[in] rule Rule on the reference triangle.
/// @param[in] limits Sub-facets and points of the master turned further than
/// this are left out.
/// @param[in] derivatives Also compute derivatives.
/// @param[in,out] points Points are appended.
/// @throw std::runtime_error A point cannot be mapped to a facet, which is
/// folded or inside out.
void append_segment_points(const FacetView& slave, const FacetView& master,
                           const QuadratureRule& rule,
                           const AngleLimits& limits, bool derivatives,
                           PairPoints& points);

/// @brief Quadrature points of a slave facet projected on the nearest master
/// facet along the slave facet's unit normal at the point.
///
/// Cheaper than segments, but the integrand has kinks inside of the facet
/// that the rule does not see. Points that hit no master, or none but those
/// that are too steep, are left out.
///
/// @param[in] slave Slave facet.
/// @param[in] masters Candidate master facets.
/// @param[in] rule Rule on the reference facet of the slave.
/// @param[in] limits Masters turned further than this are left out.
/// @param[in] derivatives Also compute derivatives.
/// @param[in,out] points One for each master; points are appended.
void append_element_points(const FacetView& slave,
                           std::span<const FacetView> masters,
                           const QuadratureRule& rule,
                           const AngleLimits& limits, bool derivatives,
                           std::span<PairPoints> points);
} // namespace dolfinx_mortar
