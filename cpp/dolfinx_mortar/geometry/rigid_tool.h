// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "rigid_shape.h"
#include <array>
#include <optional>

namespace dolfinx_mortar
{
/// @brief Matrix of the product v × a.
Eigen::Matrix3d cross_matrix(const Vec3& v);

/// @brief Rotation matrix of a rotation vector: about its direction, by its
/// length [rad].
Eigen::Matrix3d rotation_matrix(const Vec3& vector);

/// @brief Rotation vector of a matrix, of a length up to π.
Vec3 rotation_vector(const Eigen::Matrix3d& R);

/// @brief Matrix T of a rotation vector θ: a change dθ turns the rotated body
/// by T dθ.
Eigen::Matrix3d rotation_tangent(const Vec3& vector);

/// @brief Derivative of Tᵀ v by the rotation vector, v fixed.
Eigen::Matrix3d rotation_tangent_derivative(const Vec3& vector, const Vec3& v);

/// @brief A rigid tool: where its surface is, and how it has moved.
///
/// A point X of the tool is at c + d + R (X - c) with the reference point c,
/// the translation d and the rotation R by the rotation vector, whose length
/// may be beyond 2π. Each of the six is prescribed, or free: then a force, or a
/// moment about the reference point, acts there.
class RigidTool
{
public:
  /// @brief A tool whose surface has facets.
  /// @param[in] reference_point Reference point c.
  explicit RigidTool(const Vec3& reference_point);

  /// @brief A tool with an analytic surface.
  /// @param[in] shape Shape.
  /// @param[in] origin Point of the plane, centre, or point of the axis; the
  /// reference point, too.
  /// @param[in] direction Outward normal of a plane, direction of an axis; of
  /// any length above zero, and not read for spheres.
  /// @param[in] radius Radius [length]; not read for planes.
  /// @throw std::invalid_argument The direction is zero, or the radius is not
  /// positive.
  RigidTool(const RigidShape& shape, const Vec3& origin, const Vec3& direction,
            double radius);

  const std::optional<RigidShape>& shape() const { return _shape; }

  /// @brief Reference positions of the nodes of the frame, shape (4, 3).
  /// @param[in] size Length of the axes, unless the shape says it.
  std::array<double, 12> frame(double size) const;

  /// @brief Displacements of points by the present motion.
  /// @param[in] X Reference positions, shape (4, 3).
  std::array<double, 12> displacements(const std::array<double, 12>& X) const;

  /// @brief Some component is free.
  bool is_loaded() const;

  /// Reference point, translation and rotation vector; where these are free,
  /// what the tool begins with
  Vec3 reference_point, translation = Vec3::Zero(), rotation = Vec3::Zero();

  /// Non-zero for free components, of translation and rotation
  std::array<std::int8_t, 6> free = {0, 0, 0, 0, 0, 0};

  /// Force on the reference point, and moment about it, of directions that do
  /// not turn with the tool; read where components are free
  Vec3 force = Vec3::Zero(), moment = Vec3::Zero();

private:
  std::optional<RigidShape> _shape;
  Vec3 _origin;
  Eigen::Matrix3d _axes = Eigen::Matrix3d::Identity(); // unit vectors
  std::optional<double> _length;                       // of the axes
};
} // namespace dolfinx_mortar
