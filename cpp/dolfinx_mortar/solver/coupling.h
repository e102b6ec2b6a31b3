// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <array>
#include <cstdint>
#include <dolfinx_mortar/assembly/layout.h>
#include <dolfinx_mortar/assembly/mortar.h>
#include <dolfinx_mortar/contact/evaluation.h>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Which of its conditions an interface has: a tie, or a contact.
struct CoupledInterface
{
  /// Surfaces, options, candidates for multipliers
  Interface data;

  /// What makes it a contact; a tie has none
  std::optional<ContactOptions> contact;

  /// Space of the multipliers that a user has asked for
  std::optional<MultiplierSpace> space;

  /// Share of its surroundings that masters must cover for a slave node to
  /// carry a multiplier
  double min_coverage = 0.15;

  /// Angle [rad] from which on masters that meet a node on an edge face
  /// different ways
  double feature_angle = 0;

  /// Positions of local slave and master nodes that ties are integrated at,
  /// where they are not those of the mesh (relocated ties), shapes (n, 3)
  std::vector<double> x_slave, x_master;

  /// "facet tag 3", of slave and master
  std::string slave_name, master_name;

  /// Displacement block of each owned slave node; empty where no two nodes are
  /// at the same
  std::vector<std::int64_t> blocks;

  /// First multiplier node of this interface among those of this rank
  std::int32_t first_node = 0;

  bool is_tie() const { return !contact; }

  /// Geometry moves with the bodies
  bool is_current() const { return contact and !contact->reference_geometry; }

  std::int32_t num_owned() const { return data.slave.num_owned; }
};

/// @brief A rigid tool some of whose six components are free.
struct LoadedTool
{
  /// Its frame
  Tool frame;

  /// Part of the layout that the frame is
  std::int32_t part = 0;

  /// Non-zero for free components, of translation and rotation
  std::array<std::int8_t, 6> free = {};

  /// First of the twelve owned dofs of the frame; negative where another rank
  /// owns them
  std::int32_t first_dof = -1;
};

/// @brief All interfaces of a problem, and where their multipliers are in its
/// vectors: a description, which does not change.
///
/// The multipliers of a rank are those of the owned slave nodes of interface 0,
/// then of interface 1, and so on; three dofs each.
struct Coupling
{
  /// Displacement dofs of the bodies
  Layout layout;

  std::vector<CoupledInterface> interfaces;

  /// Number of multiplier nodes of this rank, and the first of them
  std::int32_t num_nodes = 0;
  std::int64_t first_node = 0;

  /// Owned displacement dofs (local) with a Dirichlet condition, ascending; of
  /// loaded tools they are those of the unknowns, see Bodies::unknowns
  std::vector<std::int32_t> fixed_dofs;

  /// Tools that are carried by a load
  std::vector<LoadedTool> loaded_tools;

  /// Some node is slave of one interface and master of another
  bool chained = false;

  /// Some node is a slave of several interfaces
  bool shared = false;

  MPI_Comm comm() const { return layout.comm; }

  /// Number of multiplier dofs of this rank
  std::int32_t size() const { return 3 * num_nodes; }

  bool has_contact() const;
  bool has_ties() const;

  /// Part of an interface in an array over multiplier nodes.
  /// @param[in] bs Number of values of a node.
  template <typename T>
  std::span<T> part(std::span<T> values, std::size_t i, int bs) const
  {
    const CoupledInterface& c = interfaces[i];
    return values.subspan(bs * c.first_node, bs * c.num_owned());
  }

  /// Local displacement block of an owned slave node, among owned ones
  std::int32_t own_block(const CoupledInterface& c, std::int32_t node) const
  {
    return c.data.slave.blocks[node] - layout.first_block;
  }
};

/// @brief Number the multipliers of interfaces, and decide which nodes may
/// carry one. Collective.
///
/// None may at nodes that are slaves of two interfaces, slave here and master
/// there, or fixed in every component: their functions are shared among their
/// neighbours.
/// @param[in] layout Displacement dofs.
/// @param[in] interfaces Interfaces, from create_interface; numbers, candidates
/// and fixed components are set.
/// @param[in] prescribed Non-zero for displacements with a Dirichlet condition,
/// shape (num_local_blocks, 3).
/// @throw std::runtime_error On all ranks: interfaces with different multiplier
/// spaces share slave nodes, no node of a contact can carry a traction, or a
/// given normal leads away from the master.
Coupling create_coupling(Layout layout,
                         std::vector<CoupledInterface> interfaces,
                         std::span<const std::int8_t> prescribed);

/// @brief Multipliers of the local slave nodes of an interface, shape (n, 3).
/// Collective.
/// @param[in] coupling Interfaces.
/// @param[in] i Interface.
/// @param[in] z Multipliers of this rank.
std::vector<double> local_multipliers(const Coupling& coupling, std::size_t i,
                                      std::span<const double> z);

/// @brief Where an interface is.
struct Positions
{
  /// Local slave and master nodes, shapes (n, 3)
  std::vector<double> slave, master;

  /// Nodes of the frame of a tool, shape (4, 3); where there is one
  std::array<double, 12> frame = {};
};

/// @brief Positions of the nodes of an interface. Collective.
/// @param[in] interface Interface.
/// @param[in] u Displacements of the local blocks of all bodies; null for the
/// reference configuration.
Positions interface_positions(const CoupledInterface& interface,
                              const std::vector<double>* u);

/// @brief Find what meets at some positions, see configure. Collective.
Configuration configure(const CoupledInterface& interface, Positions positions,
                        std::vector<double> offset = {});

/// @brief Non-zero for the multiplier dofs of a tie whose condition is that of
/// the tie, shape (num_owned, 3).
std::vector<std::int8_t> tied_dofs(const CoupledInterface& tie,
                                   const Basis& basis);

/// @brief T, or its inverse, of the slave nodes of some interfaces less the
/// identity. Collective.
/// @param[in] coupling Interfaces.
/// @param[in] which Interfaces to take.
/// @param[in] nonnegative See Basis; of all interfaces.
/// @param[in] inverse T⁻¹.
Matrix transformation_minus_one(
    const Coupling& coupling, std::span<const std::size_t> which,
    std::span<const std::vector<std::int8_t>* const> nonnegative, bool inverse);

/// @brief Matrix plus the identity. Collective.
Matrix plus_identity(Mat A);
} // namespace dolfinx_mortar
