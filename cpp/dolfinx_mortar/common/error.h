// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <mpi.h>
#include <span>
#include <string>

namespace dolfinx_mortar
{
/// @brief Raise an error on all ranks if there is one on any rank. Collective.
///
/// A rank that throws alone leaves the others waiting in their next
/// communication: errors that depend on local data go through this function.
///
/// @param[in] comm Communicator.
/// @param[in] message What is wrong on this rank and what to do; empty if all
/// is well.
/// @throw std::runtime_error On all ranks alike, with the message of the lowest
/// rank that has one.
void throw_on_all(MPI_Comm comm, const std::string& message);

/// @brief A point for use in a message, "(0.25, 1, -3)".
std::string to_string(std::span<const double, 3> x);
} // namespace dolfinx_mortar
