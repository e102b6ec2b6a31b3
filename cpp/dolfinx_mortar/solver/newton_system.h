// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "evaluation.h"
#include <Eigen/Dense>
#include <array>
#include <cstdint>
#include <dolfinx_mortar/dolfinx/bodies.h>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Multiplier nodes and the displacement nodes they are at, as the
/// elimination of multipliers sees them. Arrays are over the multiplier nodes
/// of this rank.
struct MultiplierNodes
{
  /// Non-zero for dofs whose constraint involves displacements: in contact, or
  /// tied, and not prescribed; shape (n, 3)
  std::vector<std::int8_t> active;

  /// Local (owned) displacement block of each node
  std::vector<std::int32_t> own;

  /// Entry of D̃
  std::vector<double> diagonal;

  /// ∫ Φ
  std::vector<double> weight;

  /// Derivative of the constraints by the multipliers of the same node
  std::vector<Eigen::Matrix3d> dz;

  /// The same by those of another patch at the same displacement node
  struct Coupled
  {
    std::int32_t row, column;
    Eigen::Matrix3d dz;
  };
  std::vector<Coupled> coupled;

  /// Projection on the directions that are constrained
  std::vector<Eigen::Matrix3d> directions;

  /// What friction resists across the direction of slip: traction per weighted
  /// relative motion, symmetric and not negative
  std::vector<Eigen::Matrix3d> across;

  /// Unit normals
  std::vector<Eigen::Vector3d> normals;

  /// Non-zero for nodes that stick
  std::vector<std::int8_t> stick;

  std::size_t size() const { return own.size(); }
};

/// @brief The linearised problem, rows of Dirichlet dofs not yet treated,
///
///     (K + K_c) du + Bᵀ dz = r_u
///     C_u du + C_z dz = r_z
struct NewtonSystem
{
  /// Tangent of the bodies, and derivative of the contact forces (null where
  /// there is none)
  Matrix K, K_c;

  /// Mortar matrix [D, -M], the same with slave columns in the transformed
  /// basis, and the basis transformation less the identity (null where it
  /// vanishes)
  Matrix B, B_tilde, T_minus_one;

  /// Derivatives of the constraints by displacements and by multipliers; rows
  /// of C_u are empty where nothing is active
  Matrix C_u, C_z;

  /// The multipliers node by node
  MultiplierNodes nodes;

  /// Local displacement dofs with a Dirichlet condition
  std::vector<std::int32_t> fixed;

  /// All constraints are those of ties
  bool tied = false;

  MPI_Comm comm = MPI_COMM_NULL;

  /// Numbers of displacement and multiplier dofs of this rank
  std::int32_t size_u = 0, size_z = 0;

  /// @brief The left-hand sides for (du, dz); rows of Dirichlet dofs are unit
  /// rows. Collective.
  /// @param[in] x [du, dz] of this rank.
  std::vector<double> multiply(std::span<const double> x) const;
};

/// @brief Linearise the interfaces. Collective.
///
/// Contact conditions have the derivative that leads Newton's method from
/// furthest away (see contact_residual, damped), or the exact one.
/// @param[in] coupling,step,state,evaluation State and what follows from it.
/// @param[in] K Tangent of the bodies.
/// @param[in] damped Which derivative the contact conditions have.
NewtonSystem linearise(const Coupling& coupling, const Step& step,
                       const State& state, const Evaluation& evaluation,
                       Matrix K, bool damped = true);

/// @brief Let the unknowns of loaded tools stand for the displacements of their
/// frames. Collective.
/// @param[in] bodies Bodies, at the iterate.
/// @param[in] evaluation Evaluation there.
/// @param[in,out] system From linearise.
void reduce_tools(const Bodies& bodies, const Evaluation& evaluation,
                  NewtonSystem& system);
} // namespace dolfinx_mortar
