// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "combine_rows.h"
#include <cstdint>
#include <dolfinx_mortar/assembly/petsc.h>
#include <utility>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Pᵀ K P for interpolations P that differ in few rows, of one tangent.
///
/// With an interpolation P₀ that stays, Δ = P - P₀ and a symmetric K,
///
///     Pᵀ K P = P₀ᵀ K P₀ + H + Hᵀ,    H = ½ Δᵀ K (P₀ + P),
///
/// of which the first term is computed once for each K, and H takes but few
/// rows of K: a tenth of the work. Of the first term only the rows are stored
/// that differ in the last result. Where K is not symmetric, the result is that
/// for P₀ with the changes of a symmetric matrix: near enough for a
/// preconditioner.
class ProjectedTangent
{
public:
  /// @param[in] P0 Interpolation P₀.
  explicit ProjectedTangent(Matrix P0) : _P0(std::move(P0)) {}

  /// @brief Pᵀ K P + more. Collective.
  /// @param[in] K Tangent. What is known of the last one is used if
  /// it is that, unchanged.
  /// @param[in] P Interpolation, of the layout of P₀.
  /// @param[in] more Added to it, with few rows.
  /// @return The sum, shared with this object: where its values are changed,
  /// the next call computes all of it anew.
  Matrix project(Mat K, Mat P, Mat more);

  /// @brief P₀ᵀ K P₀. Collective.
  Matrix project(Mat K);

private:
  /// Compute P₀ᵀ K P₀, unless the last result is of this K.
  void update(Mat K);

  /// Rows of matrices that are P₀ᵀ K P₀ together.
  std::vector<RowTerm> constant() const;

  // The last result; where it differs from P₀ᵀ K P₀, which rows are the same,
  // and the others of this
  Matrix _P0, _last, _others;
  std::vector<std::int8_t> _same;

  // The tangent that the last result is of, and the states of both
  PetscObjectId _id = 0;
  PetscObjectState _state = 0, _last_state = 0;
};
} // namespace dolfinx_mortar
