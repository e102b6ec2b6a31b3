// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "combine_rows.h"
#include <algorithm>
#include <stdexcept>
#include <utility>
#include <vector>

using namespace dolfinx_mortar;

namespace
{
/// Sums entries of a row, and appends them to a matrix.
class RowSum
{
public:
  void add(const MatrixRow& row)
  {
    for (std::size_t i = 0; i < row.columns().size(); ++i)
      _entries.emplace_back(row.columns()[i], row.values()[i]);
    _sorted = _entries.size() == row.columns().size();
  }

  void append(std::vector<PetscInt>& columns, std::vector<double>& values)
  {
    if (!_sorted)
    {
      std::ranges::stable_sort(_entries, {}, [](auto& e) { return e.first; });
    }
    const std::size_t first = columns.size();
    for (auto [column, value] : _entries)
    {
      if (columns.size() > first and columns.back() == column)
        values.back() += value;
      else
      {
        columns.push_back(column);
        values.push_back(value);
      }
    }
    _entries.clear();
    _sorted = true;
  }

private:
  std::vector<std::pair<PetscInt, double>> _entries;
  bool _sorted = true; // entries are those of one row
};
} // namespace

//-----------------------------------------------------------------------------
Matrix dolfinx_mortar::combine_rows(Mat K, std::span<const Mat> others,
                                    std::span<const RowSource> sources)
{
  const auto [num_rows, num_columns] = local_size(K);
  if ((!sources.empty() and static_cast<PetscInt>(sources.size()) != num_rows)
      or num_rows % 3 != 0)
  {
    throw std::invalid_argument(
        "Each local row needs a source, and rows are blocks of three.");
  }
  PetscInt begin;
  check(MatGetOwnershipRange(K, &begin, nullptr), "MatGetOwnershipRange");
  MatInfo info;
  check(MatGetInfo(K, MAT_LOCAL, &info), "MatGetInfo");
  std::vector<PetscInt> offsets = {0}, columns;
  std::vector<double> values;
  offsets.reserve(num_rows + 1);
  columns.reserve(static_cast<std::size_t>(1.1 * info.nz_used));
  values.reserve(columns.capacity());
  RowSum row_sum;
  for (PetscInt row = 0; row < num_rows; ++row)
  {
    const RowSource source = sources.empty() ? RowSource::all : sources[row];
    if (source == RowSource::unit)
    {
      columns.push_back(begin + row);
      values.push_back(1);
      offsets.push_back(columns.size());
      continue;
    }
    if (source == RowSource::all)
      row_sum.add(MatrixRow(K, begin + row));
    for (Mat A : others)
    {
      const MatrixRow more(A, begin + row);
      if (!more.columns().empty())
        row_sum.add(more);
    }
    row_sum.append(columns, values);
    offsets.push_back(columns.size());
  }
  MPI_Comm comm;
  check(PetscObjectGetComm(reinterpret_cast<PetscObject>(K), &comm),
        "PetscObjectGetComm");
  return create_from_rows(comm, num_rows, num_columns, offsets, columns, values,
                          3);
}
