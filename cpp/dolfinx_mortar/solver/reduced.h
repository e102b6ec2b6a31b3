// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "corner_multigrid.h"
#include "elimination.h"
#include "newton_system.h"
#include "projected_tangent.h"
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace dolfinx_mortar
{
/// @brief The condensed rows are (I_R + N) r_u + E r_z.
///
/// I_R keeps the rows that are not slave rows, B̃_R is B̃ without the entries of
/// the multipliers at their own nodes, and
///
///     N = I_R (T - I)ᵀ - Y - Y (T - I)ᵀ,  Y = B̃_Rᵀ L + H,
///     E = G - B̃_Rᵀ L_c,
///
/// with the columns of Dirichlet dofs left out of N. The condensed matrix is
/// (I_R + N)(K + K_c) + E C_u, with unit rows at Dirichlet dofs.
struct RowOperator
{
  Matrix N, E;

  /// Factors of the rows, which give those of constraints the size of the
  /// tangent's
  std::vector<double> scale;
};

/// @brief Preconditioner of the condensed system by one of a symmetric system.
///
/// With Π the constrained directions of the nodes of S and Q the matrix that
/// satisfies constraints at their own nodes (Elimination::solve_constraints; Π
/// D̃⁻¹ where a node has one multiplier), motions without a change of the
/// constraints are, but for the turning of normals, du = (I + W) w with
///
///     I + W = T (I - Q B̃).
///
/// On these the tangent is (I + W)ᵀ (K + Bᵀ S B) (I + W), as definite as K:
/// that is what the inner preconditioner inverts, in a basis in which motions
/// of single dofs stay small (see follow_masters). S is what friction resists
/// across the direction of slip, which turns with the motion; that friction
/// along it follows the pressure is left out, for it is not symmetric. Motions
/// in the directions of the constraints follow from the constraints, node by
/// node. Dirichlet dofs are outside of all this: their rows are unit rows of
/// the condensed system, and of the preconditioner too.
///
/// Algebraic multigrid of second-order elements is one of the corners of cells,
/// below a level of all nodes (see CornerMultigrid).
class ReducedPreconditioner
{
public:
  /// @param[in] comm Communicator.
  /// @param[in] prefix Prefix of the options of the inner preconditioner.
  /// @param[in] x Positions of the owned displacement dofs, for rigid body
  /// modes.
  /// @param[in] interpolate_corners Makes the matrix of displacements by those
  /// of the corners of cells, null where it is the identity; collective.
  ReducedPreconditioner(MPI_Comm comm, const std::string& prefix,
                        std::span<const double> x,
                        std::function<Matrix()> interpolate_corners);

  /// @brief Set up for a system. Collective.
  ///
  /// The inner preconditioner is the last one where the system differs in few
  /// constraints from the one that it was made for, and its iterations have not
  /// grown. With the option `pc_mortar_reuse false` it is always a new one.
  /// Multigrid has no level of the corners with `pc_mortar_corners false`.
  /// @param[in] s,e,rows Newton system, its elimination and its rows; they must
  /// live until the last call of apply.
  /// @throw ConvergenceError On all ranks, where the system is singular.
  void prepare(const NewtonSystem& s, const Elimination& e,
               const RowOperator& rows);

  /// @brief Approximate solution y of the condensed system for the right-hand
  /// side x. Collective.
  void apply(Vec x, Vec y) const;

  /// Iterations after which an inner preconditioner of an earlier system is to
  /// be given up.
  int patience(double rtol) const;

  /// @brief Take note of how a solution went. Collective.
  /// @param[in] converged,iterations,rtol What the Krylov solver says.
  /// @return False where there was none, and the inner preconditioner has been
  /// made anew, for the present system: to be tried again.
  /// @throw ConvergenceError As prepare.
  bool judge(bool converged, int iterations, double rtol);

  /// The inner preconditioner; null before the first system
  PC inner() const { return _multigrid ? _multigrid->pc() : _inner.get(); }

private:
  /// Whether the constraints of many nodes are not those that the inner
  /// preconditioner was made for. Collective.
  bool has_changed() const;

  /// Make the inner preconditioner for the present system.
  void set_up();

  void forget();

  /// A level of all nodes above one of the corners.
  void create_multigrid(std::unique_ptr<ReducedOperator> A);

  /// Whether bodies, both of them free to move, slide on each other.
  /// Collective.
  bool slides() const;

  /// @brief Interpolations below the corners, or below all nodes where there is
  /// no such level, with aggregates that are each of one body, without the
  /// directions of constraints and Dirichlet conditions. Collective.
  /// @param[in] unit Size of the diagonal of the tangent.
  /// @param[in] modes Rigid body modes of the corners or nodes.
  std::vector<Matrix> body_levels(double unit, MatNullSpace modes);

  /// W; with (I + W) (I + R) in place of I + W, see follow_masters
  Matrix create_W() const;

  /// @brief Change of basis I + R of the motions w.
  ///
  /// Where edges keep their displacements, D̃ of a corner is a small part of its
  /// weight ∫ Φ, and a corner moves by D̃⁻¹ (M u_m - D_ce w_e): several times
  /// as far as masters around it, and back with the edges. An edge that follows
  /// the mean motion of the masters at its corners takes care of that,
  ///
  ///     w_e = s_e + Σ_c (½ - T_ec) (∫ Φ_c)⁻¹ M_c u_m
  ///
  /// (¼ at a centre), as if it lay between them: to d_e = w_e + Σ T_ec d_c that
  /// adds what is missing. Null where nothing is, as with T_ec = ½.
  Matrix follow_masters() const;

  /// Rigid body modes as values w
  PetscHandle<MatNullSpace, MatNullSpaceDestroy> create_modes() const;

  std::vector<Eigen::Matrix3d> invert_constraints() const;

  MPI_Comm _comm;
  std::string _prefix;
  std::vector<double> _x;

  const NewtonSystem* _s = nullptr;
  const Elimination* _e = nullptr;
  const RowOperator* _rows = nullptr;
  Matrix _W, _R;

  // Displacements by those of corners, null where multigrid has no such level
  Matrix _P;
  std::unique_ptr<ProjectedTangent> _projected; // of the corners
  PetscHandle<PC, PCDestroy> _inner;
  std::unique_ptr<CornerMultigrid> _multigrid; // or this in place of it
  std::vector<Matrix> _aggregates; // of bodies; empty before they are needed
  bool _aggregation = false;
  bool _kept_aggregates = false; // of an earlier system
  // Of the system that it was made for, numbers of constraints of all nodes;
  // iterations that a digit took with the aggregates when they were new
  std::vector<std::int8_t> _constraints;
  double _iterations_per_digit = 0;
  bool _is_new = false, _worn = false;
  bool _reuse = true; // as the options say
  std::vector<Eigen::Matrix3d> _blocks;
};
} // namespace dolfinx_mortar
