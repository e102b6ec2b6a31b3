// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "first_contact.h"
#include "newton.h"
#include "stabilisation.h"
#include <dolfinx_mortar/dolfinx/bodies.h>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace dolfinx_mortar
{
/// @brief A tie, or a contact: what a user says of it.
struct InterfaceOptions
{
  /// Parts of both surfaces; the master of a tool that has facets is on spaces
  /// of the tool's own
  std::vector<TaggedFacets> slave, master;

  /// Rigid tool that the master surface is on; null where that is on bodies.
  /// Interfaces may share a tool
  std::shared_ptr<const RigidTool> tool;

  /// Space of the multipliers; by default dual_reproducing for a tie,
  /// dual_linear for a contact with tri6 among its slave facets and
  /// a curved master (see has_plane_patches), dual for other contacts.
  /// Interfaces that share slave nodes have one space: the one that is given
  /// for any, else that of contacts
  std::optional<MultiplierSpace> space;

  /// Integration, degree, search distance, largest angle; its `space` is not
  /// read
  IntegrationOptions integration;

  /// Share of its surroundings that masters must cover for a slave node to
  /// carry a multiplier
  double min_coverage = 0.15;

  /// What makes it a contact; a tie has none
  std::optional<ContactOptions> contact;

  /// Tangential behaviour of a contact, at first
  Friction friction;

  /// Angle [degrees] between slave facets from which on they meet at an edge;
  /// of contacts
  double feature_angle = 40;

  /// With reference geometry: unit normal to be used at all slave nodes
  std::optional<std::array<double, 3>> normal;

  /// Nodes in contact when the first solve starts
  InitialActive initial_active;

  /// Spread the integration of a contact evenly over all ranks, whatever the
  /// partition of the bodies (see spread_facets); by default where it pays.
  /// Contacts with reference geometry, which is integrated once, are left as
  /// they are
  std::optional<bool> balance;

  /// Positions of local slave and master nodes that a tie is integrated at,
  /// where they are not those of the mesh; shapes (n, 3)
  std::vector<double> x_slave, x_master;
};

/// @brief Options of a problem.
struct ProblemOptions
{
  /// Prefix of PETSc options
  std::string petsc_options_prefix = "mortar_";

  /// PETSc options without the prefix: `snes_*` for Newton's iteration, `ksp_*`
  /// and `pc_*` for the condensed (or saddle point) system
  std::map<std::string, std::string> petsc_options;

  /// Condense the multipliers; by default where all are dual
  std::optional<bool> condense = std::nullopt;

  /// Called by all ranks together once in each iteration, and may throw: a
  /// place to look for interrupts
  std::function<void()> poll = nullptr;

  /// Springs that hold bodies which nothing holds but contact, where they were
  /// when a solve began: stiffness of those at each node as a share of its own
  /// (the diagonal of the tangent). A solve begins with these and goes on, from
  /// one solution to the next, with weaker ones down to a millionth, so that
  /// contact finds the bodies before they fly off, and what has no stiffness in
  /// the end, as a body that slides on a plane, does not move without a force.
  /// Zero for none
  double stabilise = 0;
};

/// @brief The different tools of some interfaces, in their order.
std::vector<std::shared_ptr<const RigidTool>>
tools_of(const std::vector<InterfaceOptions>& interfaces);

/// @brief Numbers and tables of a coupled problem: surfaces of all interfaces,
/// multipliers, candidates. Collective.
/// @param[in] layout Displacement dofs of the bodies, and of the tools of the
/// interfaces after them.
/// @param[in] spaces Displacement space of each body.
/// @param[in] prescribed See create_coupling.
/// @param[in] interfaces Interfaces.
Coupling
create_coupling(Layout layout,
                std::span<const std::shared_ptr<const FunctionSpace>> spaces,
                std::span<const std::int8_t> prescribed,
                const std::vector<InterfaceOptions>& interfaces);

/// @brief Bodies coupled by interfaces, solved by PETSc's SNES: find u (and λ)
/// such that F(u; v) + ∫ λ·(v⁽¹⁾ - v⁽²⁾∘P) = 0 under the interfaces'
/// conditions.
///
/// The unknowns of the SNES are the displacements of all bodies and the
/// multipliers of all interfaces; its linear solver condenses the multipliers.
/// All functions but those that return references are collective.
class ContactProblem
{
public:
  /// @param[in] comm Communicator of matrices and vectors, of the ranks of all
  /// meshes in their order; it must live as long as the problem.
  /// @param[in] bodies Forms and displacement of each body.
  /// @param[in] bcs Dirichlet conditions of all bodies.
  /// @param[in] interfaces Ties and contacts.
  /// @param[in] options PETSc options, condensation.
  /// @throw std::invalid_argument, std::runtime_error On all ranks, where
  /// something does not fit; the message says what to do.
  ContactProblem(MPI_Comm comm, std::vector<Body> bodies,
                 std::vector<std::shared_ptr<const DirichletBC>> bcs,
                 const std::vector<InterfaceOptions>& interfaces,
                 ProblemOptions options = {});

  ContactProblem(const ContactProblem&) = delete;
  ContactProblem& operator=(const ContactProblem&) = delete;
  ~ContactProblem();

  /// @brief Solve from the present displacement.
  /// @return Number of Newton iterations.
  /// @throw ConvergenceError Not converged, or to a state that cannot be meant:
  /// bodies that have passed through each other, cells inside out, Dirichlet
  /// conditions that hold slave nodes inside a master; or springs that
  /// stabilise hold a body at the end. The state is as before the call.
  int solve();

  /// @brief Solve a step, in parts where it does not converge as a whole.
  /// @param[in] load Sets loads and boundary values for a fraction in (0, 1] of
  /// the step.
  /// @param[in] max_cuts How often a step may be halved.
  /// @return Number of Newton iterations of the parts that converged.
  /// @throw ConvergenceError The smallest part does not converge; the state is
  /// as before the call.
  int solve(const std::function<void(double)>& load, int max_cuts = 6);

  /// @brief State of the last accepted step.
  const State& state() const { return _state; }

  /// @brief Restore a state; displacements become those of `u`.
  /// @param[in] state State of this problem.
  /// @param[in] u Displacements of the owned dofs; of the state, unless a solve
  /// is to start from others.
  /// @throw std::invalid_argument On all ranks, where the state is that of
  /// another problem.
  void restore(const State& state, std::span<const double> u);

  /// @brief Take a state that comes from elsewhere, as from a file: bases are
  /// decided anew.
  void resume(const State& state);

  /// @brief What the springs of `stabilise` did in the last solve.
  const Stabilisation& stabilisation() const { return _stabilisation; }

  /// @brief What follows from the state; null before the first solve.
  const Evaluation* evaluation() const { return _evaluation.get(); }

  const Coupling& coupling() const { return _coupling; }
  const Step& step() const { return _step; }
  const Bodies& bodies() const { return _bodies; }
  Bodies& bodies() { return _bodies; }

  /// @brief Iterates of the last solve.
  const History& history() const { return _newton->history(); }

  /// @brief Exchange the Dirichlet conditions for others on the same dofs.
  void set_conditions(std::vector<std::shared_ptr<const DirichletBC>> bcs)
  {
    _bodies.set_conditions(std::move(bcs));
  }

  /// @brief Change the tangential behaviour of a contact, from the next solve
  /// on.
  void set_friction(std::size_t interface, const Friction& friction);

  /// @brief The tangential behaviour of an interface.
  const Friction& friction(std::size_t interface) const
  {
    return _settings.friction.at(interface);
  }

  /// @brief Change what is added to the gap of a contact, from the next solve
  /// on: an interference below zero, a clearance above. Collective.
  /// @param[in] interface Number of the contact.
  /// @param[in] offset Values of the local slave nodes [length], those of
  /// ghosts are not read; empty for nothing, on all ranks or on none.
  /// @throw std::runtime_error On all ranks, where there are more or fewer
  /// values than nodes, one of them is not finite, or the interface is a tie.
  void set_offset(std::size_t interface, std::vector<double> offset);

  /// @brief Newton's iteration.
  Newton& newton() { return *_newton; }

  /// @brief Decide on the multipliers of a solve that starts from the present
  /// displacement, as solve does.
  /// @return State and step that it starts with.
  std::pair<State, Step> begin() const;

private:
  /// Solve with weaker and weaker springs; which nodes carry a multiplier is
  /// decided anew for each. Collective.
  std::shared_ptr<const Evaluation> solve_stabilised(State& state, Step& step,
                                                     std::span<const double> x,
                                                     double overlap);

  void warn_of_lost_area(const Step& step) const;
  void check_unchanged() const;

  Bodies _bodies;
  Coupling _coupling;
  Settings _settings;
  std::vector<InitialActive> _initial_active;
  mutable std::vector<std::int8_t> _warned;
  State _state;
  Step _step;
  std::shared_ptr<const Evaluation> _evaluation;
  ProblemOptions _options;
  std::unique_ptr<Newton> _newton;
  Stabilisation _stabilisation;
  int _num_iterations = 0; // of all stages of the last solve
};
} // namespace dolfinx_mortar
