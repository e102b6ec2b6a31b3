// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "active_sets.h"
#include <algorithm>
#include <array>

using namespace dolfinx_mortar;

namespace
{
bool on_all(MPI_Comm comm, bool value)
{
  int flag = value;
  MPI_Allreduce(MPI_IN_PLACE, &flag, 1, MPI_INT, MPI_LAND, comm);
  return flag;
}
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
  for (std::size_t period = 2; period < 6; ++period)
  {
    bool repeats = n > 2 * period, moves = false;
    for (std::size_t k = 0; repeats and k < period; ++k)
    {
      repeats = _records[n - 1 - k] == _records[n - 1 - k - period];
      moves = moves or _records[n - 1 - k] != _records[n - 2 - k];
    }
    // The states of all ranks together have the period
    const bool all_repeat = on_all(_comm, repeats);
    if (!on_all(_comm, !moves) and all_repeat)
      return true;
  }
  return false;
}
