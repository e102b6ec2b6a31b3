// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "coupling.h"
#include <memory>
#include <span>
#include <utility>
#include <vector>

namespace dolfinx_mortar
{
/// @brief What may be changed between solves, of each interface.
struct Settings
{
  /// Tangential behaviour
  std::vector<Friction> friction;

  /// What is added to the gap at local slave nodes, ghosts up to date; empty
  /// for nothing
  std::vector<std::vector<double>> offset;
};

/// @brief What is the same for all iterates of a solve, and follows from the
/// state that it starts with. Copies share matrices.
struct Step
{
  /// Basis transformation of all interfaces (equations 4.5, 4.13), and the same
  /// less the identity; null where it is the identity
  Matrix T, T_minus_one;

  /// B and B̃ of the ties; null without ties
  Matrix B_ties, B_tilde_ties;

  /// Geometry of each tie, and of contacts that keep the reference geometry;
  /// null for others
  std::vector<std::shared_ptr<const InterfaceGeometry>> geometry;

  /// B and B̃ of the contacts, where all of them keep the reference geometry
  Matrix B_frozen, B_tilde_frozen;

  /// Area that belongs to each local slave node [length²], of each interface
  std::vector<std::vector<double>> weights;

  /// Non-zero for owned slave nodes that another patch at the same place stands
  /// for, of each interface
  std::vector<std::vector<std::int8_t>> barred;

  Settings settings;

  /// B of the contacts at the last accepted step; null without friction
  Matrix B_old;

  /// Owned displacements of the last accepted step
  std::vector<double> u_old;

  /// Springs [force per length] from the owned displacement dofs to where they
  /// were when the step began, and where that is; empty for none
  std::vector<double> springs, spring_origin;

  /// States to use instead of those that follow from the values, of each
  /// interface: those that the first solve begins with
  std::vector<std::vector<Status>> forced;

  /// Factor of c_n where that is the default
  double normal_share = 1;

  /// Scales of the tangential equations to use, of each interface, instead of
  /// those of the nodes themselves; empty for these
  std::vector<std::vector<double>> scale;

  bool is_frictional(std::size_t i) const
  {
    const Friction& f = settings.friction[i];
    return f.coefficient > 0 or f.bound;
  }
};

/// @brief What follows from state and displacement.
struct Evaluation
{
  /// Owned displacements and multipliers that it is of
  std::vector<double> u, z;

  /// Of each interface
  std::vector<InterfaceEvaluation> interfaces;

  /// Mortar matrix [D, -M] of all interfaces, the same in the transformed
  /// basis, and that of contacts alone; multipliers by displacements
  Matrix B, B_tilde, B_contact;

  /// Forces Bᵀz, shape (size of the layout)
  std::vector<double> force;

  /// Residual of the constraints, shape (size of the coupling)
  std::vector<double> constraints;
};

/// @brief Integrate the ties of a problem in the reference configuration, and
/// decide on their multipliers. Collective.
/// @param[in] coupling Interfaces.
/// @param[out] state State of the problem, made here.
/// @return Step without contacts.
/// @throw std::runtime_error On all ranks, where the surfaces of a tie do not
/// meet, or some of its facets have no multiplier.
Step create_step(const Coupling& coupling, State& state);

/// @brief Decide on the multipliers of contacts for a solve that starts from a
/// displacement. Collective.
/// @param[in] coupling Interfaces.
/// @param[in] before The last step.
/// @param[in] settings What may have been changed since.
/// @param[in] u Present displacements of the local blocks.
/// @param[in] u_old Displacements of the local blocks at the last accepted
/// step.
/// @param[in,out] state Bases are set; `u` is that of the last accepted step.
Step begin_step(const Coupling& coupling, const Step& before,
                const Settings& settings, const std::vector<double>& u,
                const std::vector<double>& u_old, State& state);

/// @brief Step of a state whose bases are decided already, and whose
/// displacement is the present one. Collective.
/// @param[in] coupling,before,settings,u See begin_step.
/// @param[in] state State.
Step resume_step(const Coupling& coupling, const Step& before,
                 const Settings& settings, const std::vector<double>& u,
                 const State& state);

/// @brief Forces and constraints of all interfaces (equations 3.3, 5.1 and the
/// law of friction). Collective.
///
/// A tangential equation is scaled by the bound, or the trial traction, of the
/// node itself: Newton's steps do not depend on this scale, the accuracy of
/// linear solvers does.
/// @param[in] coupling,step,state What does not change in a solve.
/// @param[in] u_local Displacements of the local blocks of all bodies.
/// @param[in] u,z Displacements and multipliers of the owned dofs.
Evaluation evaluate(const Coupling& coupling, const Step& step,
                    const State& state, const std::vector<double>& u_local,
                    std::span<const double> u, std::span<const double> z);

/// @brief B and B̃ of some interfaces. Collective.
/// @param[in] coupling,step,state What does not change in a solve.
/// @param[in] which Interfaces.
/// @param[in] configurations Configuration of each of these.
/// @param[out] nodal Nodal integrals of each of these.
/// @return B and B̃, the same matrix where T is the identity.
std::pair<Matrix, Matrix>
assemble_mortar(const Coupling& coupling, const Step& step, const State& state,
                std::span<const std::size_t> which,
                std::span<const Configuration* const> configurations,
                std::vector<NodalIntegrals>& nodal);

/// @brief Accept the end of a step. Collective.
/// @param[in] coupling,step What does not change in a solve.
/// @param[in] evaluation Evaluation of the solution.
/// @param[in,out] state State, which becomes that of the solution.
void accept(const Coupling& coupling, const Step& step,
            const Evaluation& evaluation, State& state);

/// @brief Largest violation of a constraint, relative to displacements or
/// tractions. Collective.
/// @param[in] coupling,step,state,evaluation State and what follows from it.
/// @param[in] length Largest displacement on any rank.
double constraint_measure(const Coupling& coupling, const Step& step,
                          const State& state, const Evaluation& evaluation,
                          double length);

/// @brief Factors that make forces of the constraints, shape (size of the
/// coupling).
/// @param[in] coupling,step What does not change in a solve.
/// @param[in] stiffness Diagonal of the tangent.
std::vector<double> force_scale(const Coupling& coupling, const Step& step,
                                std::span<const double> stiffness);
} // namespace dolfinx_mortar
