// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "active_sets.h"
#include <algorithm>
#include <array>

using namespace dolfinx_mortar;

namespace
{
/// Longest period of a cycle; the default limit of iterations sees two of them
constexpr std::size_t longest_period = 12;
} // namespace

//-----------------------------------------------------------------------------
ContactCounts dolfinx_mortar::count_nodes(MPI_Comm comm,
                                          std::span<const Status> status)
{
  std::array<std::int64_t, 3> n = {0, 0, 0};
  for (Status s : status)
    ++n[static_cast<int>(s)];
  MPI_Allreduce(MPI_IN_PLACE, n.data(), 3, MPI_INT64_T, MPI_SUM, comm);
  return {n[1] + n[2], n[1], n[2]};
}
//-----------------------------------------------------------------------------
std::int64_t ActiveSets::record(std::vector<Status> status)
{
  std::int64_t changes = 0;
  for (std::size_t j = 0; j < status.size(); ++j)
  {
    changes
        += status[j] != (_records.empty() ? Status::open : _records.back()[j]);
  }
  _records.push_back(std::move(status));
  MPI_Allreduce(MPI_IN_PLACE, &changes, 1, MPI_INT64_T, MPI_SUM, _comm);
  return changes;
}
//-----------------------------------------------------------------------------
bool ActiveSets::cycling() const
{
  const std::size_t n = _records.size();
  // For each period whether the states of this rank repeat, and whether they
  // stay the same
  std::array<std::array<int, 2>, longest_period + 1> flags{};
  for (std::size_t period = 2; period <= longest_period; ++period)
  {
    bool repeats = n > 2 * period, moves = false;
    for (std::size_t k = 0; repeats and k < period; ++k)
    {
      repeats = _records[n - 1 - k] == _records[n - 1 - k - period];
      moves = moves or _records[n - 1 - k] != _records[n - 2 - k];
    }
    flags[period] = {repeats, !moves};
  }
  // The states of all ranks together have the period
  MPI_Allreduce(MPI_IN_PLACE, flags.data(), 2 * flags.size(), MPI_INT, MPI_LAND,
                _comm);
  return std::ranges::any_of(flags,
                             [](const auto& f) { return f[0] and !f[1]; });
}
