// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "elimination.h"
#include "newton_system.h"
#include <Eigen/Dense>
#include <span>
#include <vector>

namespace dolfinx_mortar
{
class ProjectedTangent;

/// @brief Tangent of motions that do not change the constraints,
///
///     A = (I + W)ᵀ (K + Bᵀ S B) (I + W),
///
/// see ReducedPreconditioner, with the multiple of the identity that K has on
/// the average in the directions that are constrained and at Dirichlet dofs.
///
/// W moves few nodes, so that A is K and a small matrix: it is K where K is,
/// and not a second matrix of that size.
class ReducedOperator
{
public:
  /// @brief Collective.
  /// @param[in] s,e Newton system and its elimination; they must live as long
  /// as this is used.
  /// @param[in] W Motions of slave nodes by those of others.
  ReducedOperator(const NewtonSystem& s, const Elimination& e, Mat W);

  /// @brief y = A x. Collective.
  void apply(Vec x, Vec y) const;

  /// @brief A, as a matrix. Collective.
  Matrix assemble() const;

  /// @brief Pᵀ A P + more. Collective.
  /// @param[in] P Interpolation, without entries in rows of Dirichlet dofs.
  /// @param[in] W The motions again.
  /// @param[in,out] tangent Projects K.
  /// @param[in] more Added to it.
  Matrix project(Mat P, Mat W, ProjectedTangent& tangent, Mat more) const;

  /// @brief Blocks of A at the diagonal, 3 x 3, of the owned nodes.
  std::vector<Eigen::Matrix3d> blocks() const;

  /// @brief A in the rows and columns of some dofs that are not prescribed, of
  /// all ranks. Collective.
  /// @param[in] dofs Some owned dofs, ascending.
  Matrix part(std::span<const std::int32_t> dofs) const;

  /// What stands in for K in directions that do not move
  double unit() const { return _unit; }

private:
  /// Bᵀ S B in terms of the motions; null without friction.
  Matrix create_friction(Mat W) const;

  const NewtonSystem* _s;
  double _unit;
  Matrix _springs; // A - (I + W)ᵀ K (I + W), but for Dirichlet dofs
  Matrix _changes; // A - K, but for Dirichlet dofs
  Vector _free;    // x, zero at Dirichlet dofs
};
} // namespace dolfinx_mortar
