// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "combine_rows.h"
#include <algorithm>
#include <optional>
#include <stdexcept>
#include <vector>

using namespace dolfinx_mortar;

namespace
{
/// Sum of rows, each with ascending columns.
class RowSum
{
public:
  void clear()
  {
    _columns.clear();
    _values.clear();
  }

  void add(const MatrixRow& row)
  {
    const auto columns = row.columns();
    const auto values = row.values();
    _merged_columns.clear();
    _merged_values.clear();
    std::size_t i = 0, j = 0;
    while (i < _columns.size() or j < columns.size())
    {
      const bool ours = j == columns.size()
                        or (i < _columns.size() and _columns[i] <= columns[j]);
      const bool both
          = ours and j < columns.size() and _columns[i] == columns[j];
      _merged_columns.push_back(ours ? _columns[i] : columns[j]);
      _merged_values.push_back((ours ? _values[i] : 0)
                               + (both or !ours ? values[j] : 0));
      i += ours;
      j += both or !ours;
    }
    std::swap(_columns, _merged_columns);
    std::swap(_values, _merged_values);
  }

  std::span<const PetscInt> columns() const { return _columns; }
  std::span<const double> values() const { return _values; }

private:
  std::vector<PetscInt> _columns, _merged_columns;
  std::vector<double> _values, _merged_values;
};

/// The number of entries there can be.
std::size_t capacity(std::span<const RowTerm> terms, std::size_t num_unit)
{
  std::size_t size = num_unit;
  for (const RowTerm& t : terms)
  {
    if (t.rows.empty())
    {
      MatInfo info;
      check(MatGetInfo(t.A, MAT_LOCAL, &info), "MatGetInfo");
      size += static_cast<std::size_t>(info.nz_used);
      continue;
    }
    PetscInt begin;
    check(MatGetOwnershipRange(t.A, &begin, nullptr), "MatGetOwnershipRange");
    for (std::size_t row = 0; row < t.rows.size(); ++row)
    {
      if (t.rows[row])
        size += MatrixRow(t.A, begin + row).columns().size();
    }
  }
  return size;
}
} // namespace

//-----------------------------------------------------------------------------
Matrix dolfinx_mortar::combine_rows(std::span<const RowTerm> terms,
                                    std::span<const double> scale,
                                    std::span<const std::int32_t> unit)
{
  if (terms.empty())
    throw std::invalid_argument("There is no matrix to take rows of.");
  const auto [num_rows, num_columns] = local_size(terms.front().A);
  const std::size_t n = num_rows;
  bool fits = num_rows % 3 == 0 and (scale.empty() or scale.size() == n);
  for (const RowTerm& t : terms)
  {
    fits = fits and local_size(t.A) == std::pair(num_rows, num_columns)
           and (t.rows.empty() or t.rows.size() == n);
  }
  if (!fits)
  {
    throw std::invalid_argument("Matrices, flags and factors need the same "
                                "rows, in blocks of three.");
  }
  std::vector<std::int8_t> is_unit(n, 0);
  for (std::int32_t row : unit)
    is_unit.at(row) = 1;

  PetscInt begin;
  check(MatGetOwnershipRange(terms.front().A, &begin, nullptr),
        "MatGetOwnershipRange");
  PetscInt first_column;
  check(MatGetOwnershipRangeColumn(terms.front().A, &first_column, nullptr),
        "MatGetOwnershipRangeColumn");
  RowStorage out(n, capacity(terms, unit.size()), first_column, num_columns);
  RowSum sum;
  for (std::size_t row = 0; row < n; ++row)
  {
    const double factor = scale.empty() ? 1.0 : scale[row];
    if (is_unit[row])
    {
      const PetscInt column = begin + row;
      const double one = 1;
      out.append(std::span(&column, 1), std::span(&one, 1), 1);
      continue;
    }
    // The first row that is not empty waits for a second one
    std::optional<MatrixRow> first;
    sum.clear();
    for (const RowTerm& t : terms)
    {
      if (!t.rows.empty() and !t.rows[row])
        continue;
      if (!first)
      {
        first.emplace(t.A, begin + row);
        if (first->columns().empty())
          first.reset();
        continue;
      }
      const MatrixRow more(t.A, begin + row);
      if (more.columns().empty())
        continue;
      if (sum.columns().empty())
        sum.add(*first);
      sum.add(more);
    }
    if (first and sum.columns().empty())
    {
      out.append(first->columns(), first->values(), factor);
      continue;
    }
    out.append(sum.columns(), sum.values(), factor);
  }
  MPI_Comm comm;
  check(
      PetscObjectGetComm(reinterpret_cast<PetscObject>(terms.front().A), &comm),
      "PetscObjectGetComm");
  return create_from_rows(comm, std::move(out), 3);
}
