// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <array>
#include <cstdint>
#include <dolfinx_mortar/multiplier/options.h>
#include <dolfinx_mortar/surface/search.h>
#include <dolfinx_mortar/surface/surface.h>
#include <optional>
#include <span>
#include <vector>

namespace dolfinx_mortar
{
/// @brief The rigid tool that a master surface is on.
struct Tool
{
  /// Displacement blocks of the nodes of its frame (see RigidShape): numbers in
  /// the coupled problem, and indices among the local blocks of all bodies
  std::array<std::int64_t, 4> blocks;
  std::array<std::int32_t, 4> local_blocks;

  /// Reference positions of these nodes, shape (4, 3), and of the reference
  /// point of the tool
  std::array<double, 12> X;
  std::array<double, 3> point;

  /// Analytic surface; the master surface has no nodes and facets then
  std::optional<RigidShape> shape;
};

/// @brief An interface between a slave and a master surface, as the assembly
/// sees it: a description, which does not change.
///
/// Matrices have rows and columns of two kinds. *Displacement* dofs are those
/// of the coupled problem, `3 * block + component`. *Multiplier* dofs are
/// `3 * multiplier + component`, with one multiplier for every slave node of
/// every interface, whether it carries one or not: rows of nodes that do not
/// carry a multiplier stay empty.
struct Interface
{
  /// Surfaces; all ranks of their communicator take part in every call
  Surface slave, master;

  /// Space, integration, degree, search distance
  IntegrationOptions options;

  /// Multiplier number of each local slave node (owned and ghost)
  std::vector<std::int64_t> multipliers;

  /// Non-zero for local slave nodes that may carry a multiplier
  std::vector<std::int8_t> candidates;

  /// Non-zero for components of local slave nodes whose displacement is
  /// prescribed, shape (n, 3)
  std::vector<std::int8_t> fixed;

  /// Unit normal at all slave nodes, in place of their own
  std::optional<std::array<double, 3>> normal;

  /// What carries the master surface, if that is not a body
  std::optional<Tool> tool;

  /// The master is an analytic surface, whose normals count in place of the
  /// slave's
  bool is_analytic() const { return tool and tool->shape; }
};

/// @brief What a solve decides about the multipliers of an interface: a part of
/// its state. Ghosts are up to date.
struct Basis
{
  /// Non-zero for local slave nodes that carry a multiplier
  std::vector<std::int8_t> has_multiplier;

  /// Non-zero for local slave nodes whose functions are nowhere negative, see
  /// transformation
  std::vector<std::int8_t> nonnegative;

  /// Non-zero for local slave nodes without a multiplier at which nothing acts;
  /// the functions of others without one are shared among their neighbours
  std::vector<std::int8_t> idle;

  bool operator==(const Basis&) const = default;
};

/// @brief An interface on its own, all of whose slave nodes take part: the
/// corners carry multipliers, and the other nodes too where the space has
/// functions for them. No displacement is prescribed. Collective.
///
/// Multipliers have the numbers of the slave nodes, so that a matrix has
/// `3 * slave.num_owned` rows on each rank.
/// @param[in] slave,master Surfaces.
/// @param[in] options Space, integration, degree, search distance.
Interface create_interface(Surface slave, Surface master,
                           const IntegrationOptions& options = {});

/// @brief The basis in which all candidates carry a multiplier, and no function
/// is changed for being covered in part.
Basis create_basis(const Interface& interface);

/// @brief Flags of the local slave nodes that a multiplier space has a function
/// at. Collective.
std::vector<std::int8_t> multiplier_nodes(const Surface& slave,
                                          MultiplierSpace space);

/// @brief Current positions and averaged normals of an interface.
struct Configuration
{
  /// Positions of local slave and master nodes, shapes (n, 3)
  std::vector<double> x_slave, x_master;

  /// Normals of the slave nodes
  Normals normals;

  /// Facets that may meet
  Candidates candidates;

  /// What is added to the gap at local slave nodes [length], shape (n); empty
  /// for nothing
  std::vector<double> offset;
};

/// @brief Find what meets in a configuration. Collective.
/// @param[in] interface Interface.
/// @param[in] x_slave,x_master Positions of local slave and master nodes,
/// shapes (n, 3).
/// @param[in] offset See Configuration.
/// @param[in] x_frame Positions of the nodes of a tool's frame, where there is
/// a tool.
Configuration configure(const Interface& interface, std::vector<double> x_slave,
                        std::vector<double> x_master,
                        std::vector<double> offset = {},
                        const std::array<double, 12>& x_frame = {});
} // namespace dolfinx_mortar
