// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "facet.h"
#include <Eigen/Dense>
#include <array>
#include <span>

namespace dolfinx_mortar
{
/// @brief A facet in its current position.
struct FacetView
{
  FacetType type;

  /// +1 where x,ξ₁ × x,ξ₂ points out of the body, -1 where it points into it
  int orientation;

  /// Positions of the nodes relative to `origin`, shape (num_nodes, 3)
  std::span<const double> x;

  /// Where the positions are relative to: messages name places by the sum
  std::array<double, 3> origin = {0, 0, 0};
};

using Vec3 = Eigen::Vector3d;
using Mat23 = Eigen::Matrix<double, 2, 3>;

/// @brief Position of a node.
inline Vec3 node(const FacetView& f, int k)
{
  return Eigen::Map<const Vec3>(f.x.data() + 3 * k);
}

/// @brief Position and tangents x,ξ₁ and x,ξ₂ of a point of a facet.
struct SurfacePoint
{
  Shapes s;
  Vec3 x, a1, a2;
};

/// @brief Evaluate a point of a facet.
void evaluate(const FacetView& f, std::array<double, 2> xi, SurfacePoint& p);

/// @brief First two rows of the inverse of [a₁ a₂ -n]: the map from a change of
/// position to the change of (ξ₁, ξ₂) along n.
Mat23 pullback(const Vec3& a1, const Vec3& a2, const Vec3& n);

/// @brief Corners, centre and linear guess for the inverse map of a sub-facet.
struct LinearPart
{
  int size;
  std::array<int, 4> nodes;    // counter-clockwise about the outward normal
  std::array<Vec3, 4> corners; // in that order
  Vec3 centre, c, n;           // c = non-normalised normal
  double norm_c;
  Vec3 t1, t2;                // tangents at the centre
  Eigen::Vector2d xi, r1, r2; // reference centre and tangents

  LinearPart(const FacetView& f, const SubFacet& sub);

  /// @brief Change of the non-normalised normal c for a change of each corner,
  /// as matrices W with dc = W dx
  std::array<Eigen::Matrix3d, 4> normal_derivative() const;

  /// @brief Point of the reference facet below p along n, on the linear part.
  std::array<double, 2> guess(const Vec3& p, const Vec3& n) const;
};

/// @brief How far a master facet may be turned away from the slave.
struct AngleLimits
{
  /// Cosine of the largest angle between the slave's normal and that of a
  /// linear part of the master, turned round
  double part;

  /// The same at points of the real master, which may be curved: halfway
  /// between the angle above and a right one
  double point;

  /// @param[in] max_angle Largest angle of linear parts [degrees].
  explicit AngleLimits(double max_angle);
};

/// @brief Map a point p along n to a facet: x(ξ) = p + α n.
/// @param[in,out] xi Starting point, and where the point arrives.
/// @return False where the iteration does not converge. It may arrive beyond
/// the facet, even on another sheet of its surface.
bool project(const FacetView& f, const Vec3& p, const Vec3& n,
             std::array<double, 2>& xi, SurfacePoint& point, Mat23& L);

/// @brief True where the outward normal of a facet, at a point with tangents a₁
/// and a₂, opposes n, up to an angle whose cosine is given.
bool opposes(const FacetView& f, const Vec3& a1, const Vec3& a2, const Vec3& n,
             double cosine);

/// @throw std::runtime_error Always: slave facet `f` is folded near x.
[[noreturn]] void throw_folded(const FacetView& f, const Vec3& x);
} // namespace dolfinx_mortar
