// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "blocks.h"
#include <algorithm>
#include <dolfinx_mortar/common/error.h>
#include <dolfinx_mortar/common/mpi_exchange.h>
#include <map>
#include <numeric>
#include <string>

using namespace dolfinx_mortar;

//-----------------------------------------------------------------------------
template <int R, int C>
typename BlockAccumulator<R, C>::Row&
BlockAccumulator<R, C>::row(std::int64_t number)
{
  auto [it, made] = _index.try_emplace(number, _rows.size());
  if (made)
    _rows.push_back({number, {}, {}});
  return _rows[it->second];
}
//-----------------------------------------------------------------------------
template <int R, int C>
void BlockAccumulator<R, C>::add_block(Row& row, std::int64_t column,
                                       const double* values, std::size_t width,
                                       double factor)
{
  auto c = std::find(row.columns.begin(), row.columns.end(), column);
  const std::size_t at = c - row.columns.begin();
  if (c == row.columns.end())
  {
    row.columns.push_back(column);
    row.values.resize(row.values.size() + R * C, 0.0);
  }
  double* block = row.values.data() + R * C * at;
  for (int r = 0; r < R; ++r)
  {
    for (int k = 0; k < C; ++k)
      block[C * r + k] += factor * values[r * width + k];
  }
}
//-----------------------------------------------------------------------------
template <int R, int C>
void BlockAccumulator<R, C>::add(std::span<const std::int64_t> rows,
                                 std::span<const std::int64_t> columns,
                                 const double* values, double factor)
{
  const std::size_t width = C * columns.size();
  for (std::size_t i = 0; i < rows.size(); ++i)
  {
    if (rows[i] < 0)
      continue;
    Row& to = row(rows[i]);
    for (std::size_t j = 0; j < columns.size(); ++j)
    {
      if (columns[j] >= 0)
        add_block(to, columns[j], values + R * i * width + C * j, width,
                  factor);
    }
  }
}
//-----------------------------------------------------------------------------
template <int R, int C>
void BlockAccumulator<R, C>::send_rows(MPI_Comm comm, std::int64_t first,
                                       std::int64_t size)
{
  int num_ranks;
  MPI_Comm_size(comm, &num_ranks);
  if (num_ranks == 1)
    return;
  std::vector<std::int64_t> ends(num_ranks);
  const std::int64_t end = first + size;
  MPI_Allgather(&end, 1, MPI_INT64_T, ends.data(), 1, MPI_INT64_T, comm);

  // A row travels as its number, its number of blocks, columns and values;
  // numbers are exact in double precision
  std::map<int, std::vector<double>> packed;
  std::vector<Row> kept;
  for (Row& r : _rows)
  {
    if (r.number >= first and r.number < end)
    {
      kept.push_back(std::move(r));
      continue;
    }
    const int owner = std::min<std::ptrdiff_t>(
        std::upper_bound(ends.begin(), ends.end(), r.number) - ends.begin(),
        num_ranks - 1);
    std::vector<double>& to = packed[owner];
    to.push_back(r.number);
    to.push_back(r.columns.size());
    to.insert(to.end(), r.columns.begin(), r.columns.end());
    to.insert(to.end(), r.values.begin(), r.values.end());
  }
  _rows = std::move(kept);
  _index.clear();
  for (std::size_t i = 0; i < _rows.size(); ++i)
    _index[_rows[i].number] = i;

  RankData<double> send;
  for (auto& [rank, values] : packed)
  {
    send.ranks.push_back(rank);
    send.values.insert(send.values.end(), values.begin(), values.end());
    send.offsets.push_back(send.values.size());
  }
  const RankData<double> received = exchange(comm, send);
  for (auto v = received.values.begin(); v != received.values.end();)
  {
    Row& to = row(static_cast<std::int64_t>(*v++));
    const std::size_t num = *v++;
    auto values = v + num;
    for (std::size_t j = 0; j < num; ++j, values += R * C)
      add_block(to, static_cast<std::int64_t>(*v++), &*values, C, 1);
    v = values;
  }
}
//-----------------------------------------------------------------------------
template <int R, int C>
Matrix BlockAccumulator<R, C>::assemble(MPI_Comm comm, PetscInt local_rows,
                                        PetscInt local_columns)
{
  constexpr bool scalar = R == 1 and C == 1;
  constexpr int row_size = scalar ? 3 : R, column_size = scalar ? 3 : C;
  const std::int64_t size = local_rows / row_size;
  const std::int64_t first = first_of_rank(comm, size);
  send_rows(comm, first, size);

  std::vector<Row*> rows(size, nullptr);
  std::size_t num_entries = 0;
  std::string message;
  for (Row& r : _rows)
  {
    if (r.number < first or r.number >= first + size)
    {
      message = "Row " + std::to_string(r.number)
                + " of a matrix is beyond its size.";
      continue;
    }
    rows[r.number - first] = &r;
    num_entries += r.columns.size() * (scalar ? 3 : R * C);
  }
  throw_on_all(comm, message);
  RowStorage storage(local_rows, num_entries,
                     first_of_rank(comm, local_columns), local_columns);
  std::vector<PetscInt> columns;
  std::vector<double> values;
  std::vector<std::size_t> order;
  for (Row* r : rows)
  {
    const std::size_t n = r ? r->columns.size() : 0;
    order.resize(n);
    std::iota(order.begin(), order.end(), 0);
    std::sort(order.begin(), order.end(),
              [&](auto a, auto b) { return r->columns[a] < r->columns[b]; });
    for (int c = 0; c < row_size; ++c)
    {
      columns.clear();
      values.clear();
      for (std::size_t i : order)
      {
        const PetscInt column = column_size * r->columns[i];
        if constexpr (scalar)
        {
          columns.push_back(column + c);
          values.push_back(r->values[i]);
        }
        else
        {
          for (int k = 0; k < C; ++k)
          {
            columns.push_back(column + k);
            values.push_back(r->values[R * C * i + C * c + k]);
          }
        }
      }
      storage.append(columns, values);
    }
    // Blocks and matrix are not both in memory as a whole
    if (r)
      *r = {};
  }
  _rows.clear();
  _index.clear();
  return create_from_rows(comm, std::move(storage));
}

template class dolfinx_mortar::BlockAccumulator<1, 1>;
template class dolfinx_mortar::BlockAccumulator<3, 3>;
