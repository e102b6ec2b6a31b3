// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "laws.h"
#include "state.h"
#include <dolfinx_mortar/assembly/mortar.h>
#include <memory>
#include <optional>
#include <span>
#include <vector>

namespace dolfinx_mortar
{
/// @brief What makes an interface a contact: a description.
struct ContactOptions
{
  /// Complementarity parameters [traction per length]; they change the path of
  /// the iteration, not its result. By default the stiffness of the slave nodes
  /// per area, of which c_n is a share in the first iterations of a solve
  std::optional<double> c_n, c_t;

  /// Keep D, M and normals of the reference configuration (small deformation)
  bool reference_geometry = false;
};

/// @brief Where the surfaces of an interface are, and what the integrals leave
/// on the slave nodes there.
struct InterfaceGeometry
{
  Configuration configuration;
  NodalIntegrals nodal;
};

/// @brief What follows, at an interface, from state and displacement. Arrays
/// are over the owned slave nodes.
struct InterfaceEvaluation
{
  /// Shared by all evaluations where geometry is frozen
  std::shared_ptr<const InterfaceGeometry> geometry;

  /// Weighted gaps [length³], shape (n)
  std::vector<double> gap;

  /// Weighted slip of the master since the last accepted step [length³], shape
  /// (n, 3); empty without friction
  std::vector<double> weighted_slip;

  /// Scale of the tangential equations [traction], shape (n)
  std::vector<double> scale;

  /// Non-zero for nodes that can be in contact, shape (n)
  std::vector<std::int8_t> usable;

  /// Contact conditions with exact derivatives
  ContactResidual law;
};

/// @brief Contact conditions of an interface.
/// @param[in] interface Interface.
/// @param[in] options What makes it a contact.
/// @param[in] friction Tangential behaviour.
/// @param[in] state State of the interface.
/// @param[in] evaluation Geometry, gap, weighted slip, scale and usable nodes.
/// @param[in] z Multipliers [traction] of the owned nodes, shape (n, 3).
/// @param[in] blocks See ContactState.
/// @param[in] forced,damped See contact_residual.
/// @param[in] normal_share Factor of c_n where that is the default.
ContactResidual
evaluate_law(const Interface& interface, const ContactOptions& options,
             const Friction& friction, const InterfaceState& state,
             const InterfaceEvaluation& evaluation, std::span<const double> z,
             std::span<const std::int64_t> blocks,
             std::span<const Status> forced, bool damped, double normal_share);

/// @brief Set the complementarity parameters and the scale of a contact.
/// @param[in] options What makes it a contact.
/// @param[in] weights Area of each owned node [length²], shape (n).
/// @param[in] stiffness Stiffness of each owned node [force per length], shape
/// (n).
/// @param[out] state State of the interface.
void set_parameters(const ContactOptions& options,
                    std::span<const double> weights,
                    std::span<const double> stiffness, InterfaceState& state);

/// @brief Largest traction at work in a contact, for relative tolerances: of no
/// less than round-off. Collective.
/// @param[in] interface Interface.
/// @param[in] state Its state.
/// @param[in] weights Area of each owned node [length²], shape (n).
/// @param[in] z Multipliers of the owned nodes [traction], shape (n, 3).
double largest_traction(const Interface& interface, const InterfaceState& state,
                        std::span<const double> weights,
                        std::span<const double> z);

/// @brief Accept the slip of the step that ends with an evaluated state.
/// @param[in] interface Interface.
/// @param[in] evaluation Evaluation of the end of the step.
/// @param[in] z Multipliers of the owned nodes [traction], shape (n, 3).
/// @param[in,out] state Slip and dissipation are set.
void accept_slip(const Interface& interface,
                 const InterfaceEvaluation& evaluation,
                 std::span<const double> z, InterfaceState& state);

/// @brief Gap of the owned nodes [length], infinite at nodes that carry no
/// multiplier.
std::vector<double> nodal_gaps(const Interface& interface, const Basis& basis,
                               const InterfaceEvaluation& evaluation);
} // namespace dolfinx_mortar
