// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "pair.h"
#include "projection.h"
#include <array>
#include <cstdint>
#include <span>

namespace dolfinx_mortar
{
/// @brief An analytic surface of a rigid tool, in the coordinates of its frame.
///
/// A frame is four nodes that move with the tool: the origin and the ends of
/// three axes, right-handed, of equal lengths and at right angles. Coordinates
/// count in lengths of the axes. The plane is spanned by the first two axes,
/// the third one points out of the tool; the sphere has its centre at the
/// origin, the cylinder its axis along the third one; the radius of both is the
/// length of an axis.
struct RigidShape
{
  enum class Kind : std::int8_t
  {
    plane,
    sphere,
    cylinder
  };
  Kind kind = Kind::plane;

  /// The tool is all that lies outside of the sphere or cylinder: a socket or a
  /// bore
  bool hollow = false;
};

/// @brief The point of a shape that is nearest to another point.
struct ClosestPoint
{
  /// Coordinates
  Vec3 X;

  /// Signed distance of the other point, negative inside of the tool; outward
  /// unit normal
  double distance;
  Vec3 normal;

  /// Directions of principal curvature. A motion dX of the other point moves
  /// the closest one by Σ tangents_a stretch_a (tangents_a·dX), and turns the
  /// normal by Σ tangents_a turn_a (tangents_a·dX)
  std::array<Vec3, 2> tangents;
  std::array<double, 2> stretch, turn;
};

/// @brief Find the closest point. At the centre of a sphere and on the axis of
/// a cylinder, where there are many, it is one of them.
/// @param[in] shape Shape.
/// @param[in] X Coordinates of a point.
ClosestPoint closest_point(const RigidShape& shape, const Vec3& X);

/// @brief Where a frame is.
struct FrameView
{
  Vec3 origin;
  Eigen::Matrix3d axes, inverse; // one axis in each column

  /// @param[in] x Positions of the four nodes, shape (4, 3).
  explicit FrameView(std::span<const double> x);

  /// @brief Coordinates of a position.
  Vec3 coordinates(const Vec3& x) const { return inverse * (x - origin); }
};

/// @brief Shares of the four nodes in a point that moves with the frame:
/// x = Σ N_l x_l.
inline Eigen::Vector4d frame_functions(const Vec3& X)
{
  return {1 - X.sum(), X[0], X[1], X[2]};
}

/// @brief Derivative of frame_functions along a direction.
inline Eigen::Vector4d frame_derivatives(const Vec3& t)
{
  return {-t.sum(), t[0], t[1], t[2]};
}

/// @brief Unit normal at a slave point that a shape faces it with: that of the
/// tool at the closest point, turned round.
///
/// @param[in] shape,frame Shape, and where it is.
/// @param[in] x Position of the slave point.
/// @param[in] fixed Non-zero for components that are left out, as those of
/// compute_normals are.
/// @param[out] d If not null, derivative with respect to the positions of the
/// slave point and the four nodes of the frame.
Vec3 opposing_normal(const RigidShape& shape, const FrameView& frame,
                     const Vec3& x, std::span<const std::int8_t, 3> fixed,
                     Eigen::Matrix<double, 3, 15>* d = nullptr);

/// @brief Quadrature points of a whole slave facet, and the points of a shape
/// that are closest to them. Points where the shape does not face the facet are
/// left out.
///
/// @param[in] slave Slave facet.
/// @param[in] shape Shape.
/// @param[in] x Positions of the nodes of its frame, relative to the origin of
/// the facet, shape (4, 3).
/// @param[in] rule Rule on the reference facet of the slave.
/// @param[in] limits Where the tool is turned further than this, it does not
/// face the facet.
/// @param[in] derivatives Also compute derivatives.
/// @param[in,out] points Points are appended.
void append_shape_points(const FacetView& slave, const RigidShape& shape,
                         std::span<const double> x, const QuadratureRule& rule,
                         const AngleLimits& limits, bool derivatives,
                         PairPoints& points);
} // namespace dolfinx_mortar
