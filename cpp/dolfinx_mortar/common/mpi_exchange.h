// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <algorithm>
#include <cstdint>
#include <mpi.h>
#include <type_traits>
#include <utility>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Values that go to, or come from, some other ranks.
template <typename T>
struct RankData
{
  static_assert(std::is_trivially_copyable_v<T>);

  /// Ranks, ascending
  std::vector<int> ranks;

  /// Values of `ranks[i]` are `values[offsets[i]:offsets[i + 1]]`
  std::vector<std::int32_t> offsets = {0};

  /// Values of all ranks, one after the other
  std::vector<T> values;
};

/// Tags of the messages of this library
enum class Tag : int
{
  exchange = 4711,
  scatter = 4712
};

/// @brief What this process has received from others so far by the exchanges of
/// this library [bytes].
std::int64_t& received_bytes();

/// @brief Send values to ranks that do not know yet that they will receive
/// some. Collective.
///
/// Sparse: the work of a rank grows with the number of its partners, not with
/// the size of the communicator. This is the non-blocking consensus of Hoefler,
/// Siebert and Lumsdaine (doi:10.1145/1693453.1693476): a rank enters a barrier
/// when its synchronous sends have arrived, and listens until all have entered.
///
/// @param[in] comm Communicator.
/// @param[in] send Values to send.
/// @return Values received, by ascending rank of the sender.
template <typename T>
RankData<T> exchange(MPI_Comm comm, const RankData<T>& send)
{
  constexpr int tag = static_cast<int>(Tag::exchange);
  MPI_Datatype type;
  MPI_Type_contiguous(sizeof(T), MPI_BYTE, &type);
  MPI_Type_commit(&type);
  int own;
  MPI_Comm_rank(comm, &own);

  std::vector<MPI_Request> requests(send.ranks.size());
  for (std::size_t i = 0; i < requests.size(); ++i)
  {
    MPI_Issend(send.values.data() + send.offsets[i],
               send.offsets[i + 1] - send.offsets[i], type, send.ranks[i], tag,
               comm, &requests[i]);
  }

  std::vector<std::pair<int, std::vector<T>>> received;
  MPI_Request barrier = MPI_REQUEST_NULL;
  for (bool done = false; !done;)
  {
    int found;
    MPI_Status status;
    MPI_Iprobe(MPI_ANY_SOURCE, tag, comm, &found, &status);
    if (found)
    {
      int n;
      MPI_Get_count(&status, type, &n);
      std::vector<T> values(n);
      MPI_Recv(values.data(), n, type, status.MPI_SOURCE, tag, comm,
               MPI_STATUS_IGNORE);
      if (status.MPI_SOURCE != own)
        received_bytes() += n * sizeof(T);
      received.emplace_back(status.MPI_SOURCE, std::move(values));
    }

    int flag;
    if (barrier != MPI_REQUEST_NULL)
    {
      MPI_Test(&barrier, &flag, MPI_STATUS_IGNORE);
      done = flag;
    }
    else
    {
      MPI_Testall(requests.size(), requests.data(), &flag, MPI_STATUSES_IGNORE);
      if (flag)
        MPI_Ibarrier(comm, &barrier);
    }
  }
  MPI_Type_free(&type);

  // Without this a rank that is still listening could take a message of the
  // next exchange for one of this
  MPI_Barrier(comm);

  std::ranges::sort(received, {}, [](auto& r) { return r.first; });
  RankData<T> data;
  for (auto& [rank, values] : received)
  {
    data.ranks.push_back(rank);
    data.values.insert(data.values.end(), values.begin(), values.end());
    data.offsets.push_back(data.values.size());
  }
  return data;
}
} // namespace dolfinx_mortar
