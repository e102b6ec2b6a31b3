// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "problem.h"

namespace dolfinx_mortar
{
/// @brief Motion of slave nodes onto the master surface.
struct Relocation
{
  /// Motion of the owned displacement blocks, shape (n, 3)
  std::vector<double> motion;

  /// Largest motion of a node [length]
  double largest = 0;

  /// Positions of local slave and master nodes before, with which the tie is to
  /// be integrated, shapes (n, 3)
  std::vector<double> x_slave, x_master;
};

/// @brief Motion of the slave nodes of a tie such that D X_s = M X_m.
/// Collective.
/// @param[in] comm Communicator.
/// @param[in] spaces Displacement spaces of the bodies of the tie.
/// @param[in] tie The tie.
/// @param[in] bcs Dirichlet conditions; nodes they fix entirely do not move.
/// @param[in] limit Largest motion allowed, as a share of the size of the
/// adjacent facets.
/// @throw std::runtime_error On all ranks, where a node would move further.
Relocation relocate(
    MPI_Comm comm, std::span<const std::shared_ptr<const FunctionSpace>> spaces,
    const InterfaceOptions& tie,
    const std::vector<std::shared_ptr<const DirichletBC>>& bcs, double limit);

/// @brief Motion that gives the slave nodes of a contact which are near the
/// master a gap to it, along their normals (on an analytic tool to the closest
/// point). Collective.
/// @param[in] comm,spaces,bcs See relocate.
/// @param[in] contact Contact.
/// @param[in] distance Nodes that would move further [length] stay.
/// @param[in] gap Gap that nodes are to have [length]; negative for an overlap.
/// @return `motion` and `largest`.
Relocation adjust(MPI_Comm comm,
                  std::span<const std::shared_ptr<const FunctionSpace>> spaces,
                  const InterfaceOptions& contact,
                  const std::vector<std::shared_ptr<const DirichletBC>>& bcs,
                  double distance, double gap = 0);
} // namespace dolfinx_mortar
