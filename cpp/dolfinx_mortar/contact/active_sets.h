// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "laws.h"
#include <cstdint>
#include <mpi.h>
#include <span>
#include <vector>

namespace dolfinx_mortar
{
/// Numbers of nodes in contact, on all ranks.
struct ContactCounts
{
  std::int64_t active = 0, stick = 0, slip = 0;
};

/// @brief Count nodes by their states. Collective.
ContactCounts count_nodes(MPI_Comm comm, std::span<const Status> status);

/// @brief States of all contact nodes of this rank in the course of Newton's
/// iteration.
class ActiveSets
{
public:
  explicit ActiveSets(MPI_Comm comm) : _comm(comm) {}

  /// @brief Note the states of an iterate. Collective.
  /// @return Number of nodes, on all ranks, that changed; before the first
  /// iterate all are open.
  std::int64_t record(std::vector<Status> status);

  /// @brief Whether the states come back to earlier ones, with a period of 2 to
  /// 12. Collective.
  bool cycling() const;

  /// @brief States of the last iterate, and of the one before it.
  /// @param[in] back 0 for the last.
  std::span<const Status> status(std::size_t back) const
  {
    return _records[_records.size() - 1 - back];
  }

  std::size_t size() const { return _records.size(); }

private:
  MPI_Comm _comm;
  std::vector<std::vector<Status>> _records;
};
} // namespace dolfinx_mortar
