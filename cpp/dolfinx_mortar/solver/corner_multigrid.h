// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "diagonal_blocks.h"
#include "reduced_operator.h"
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Local dofs of the corners, in the order of the columns of this rank.
/// @param[in] P Displacements by those of corners.
std::vector<std::int32_t> corner_dofs(Mat P);

/// @brief Projection on the directions that are not constrained. Collective.
/// @param[in] constrained Projections on the constrained directions of the
/// nodes of this rank.
Matrix create_free_directions(MPI_Comm comm,
                              std::span<const Eigen::Matrix3d> constrained);

/// @brief Motions of nodes that follow from those of the corners of cells, for
/// the motions w of a reduced system. Collective.
///
/// Corners that are slaves follow their masters, other nodes the corners of
/// their edge, facet or cell, u = P (I + J W P) w_c with J that picks the
/// corners, and motions w = (I + R)⁻¹ T⁻¹ u; without what constraints and
/// Dirichlet conditions hold. Nor do edges move against the masters that they
/// follow: corners would move several times as far.
/// @param[in] P Displacements by those of corners, see
/// create_corner_interpolation; rows are displacement dofs, columns dofs of
/// corners, and so they are of the result.
/// @param[in] s,e Newton system and its elimination.
/// @param[in] W,R Motions of slave nodes, and change of basis (may be null),
/// see ReducedPreconditioner.
Matrix interpolate_motions(Mat P, const NewtonSystem& s, const Elimination& e,
                           Mat W, Mat R);

/// @brief Multigrid for second-order elements: a level of all nodes, the
/// corners of cells below it, and another preconditioner for these.
///
/// Linear functions on the same cells are the best coarse space there is for
/// quadratic ones, and their matrix has a tenth of the entries. The level of
/// all nodes needs products with the operator, and blocks at its diagonal: one
/// for each node, and one for nodes that are coupled by more than these tell.
/// Options of its smoother have the prefix `mg_nodes_`; all others are those of
/// the corners' preconditioner.
class CornerMultigrid
{
public:
  /// @brief Collective.
  /// @param[in] comm Communicator.
  /// @param[in] prefix Prefix of the options.
  /// @param[in] A Operator.
  /// @param[in] P Motions by those of the corners, from interpolate_motions:
  /// rows are displacement dofs, columns dofs of corners.
  /// @param[in] A_corners Pᵀ A P, made regular; it gets the near null space.
  /// @param[in] modes Rigid body modes of the corners.
  /// @param[in] together Owned dofs that share a block, see DiagonalBlocks.
  /// @param[in] levels Interpolations of the corners' multigrid, see
  /// set_levels; empty where it has its own.
  CornerMultigrid(MPI_Comm comm, const std::string& prefix,
                  std::unique_ptr<ReducedOperator> A, Matrix P,
                  Matrix A_corners, MatNullSpace modes,
                  std::vector<std::int32_t> together,
                  const std::vector<Matrix>& levels = {});

  // PETSc's objects point to this one
  CornerMultigrid(const CornerMultigrid&) = delete;
  CornerMultigrid& operator=(const CornerMultigrid&) = delete;

  /// @brief Another operator, with what the corners have been set up for.
  /// Collective.
  void update(std::unique_ptr<ReducedOperator> A);

  PC pc() const { return _pc.get(); }

private:
  static PetscErrorCode multiply(Mat A, Vec x, Vec y);
  static PetscErrorCode apply_blocks(PC pc, Vec x, Vec y);

  MPI_Comm _comm;
  std::vector<std::int32_t> _together;
  std::unique_ptr<ReducedOperator> _operator;
  std::unique_ptr<DiagonalBlocks> _blocks;
  Matrix _shell;
  PetscHandle<PC, PCDestroy> _pc;
};
} // namespace dolfinx_mortar
