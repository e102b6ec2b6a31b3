// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <petscmat.h>
#include <span>
#include <stdexcept>
#include <unordered_map>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Sums dense blocks of facets before they go to a PETSc matrix.
///
/// Neighbouring facets share most of their entries; summing them here, by
/// pairs of nodes, leaves PETSc one insertion for each row.
///
/// @tparam R,C Rows and columns of the block of a pair of nodes. A block of 1 x
/// 1 stands for its product with the 3 x 3 identity.
template <int R, int C>
class BlockAccumulator
{
public:
  /// @brief Add a dense matrix.
  /// @param[in] rows,columns Numbers of nodes; negative ones are left out.
  /// @param[in] values Row-major, shape (R rows.size(), C columns.size()).
  /// @param[in] factor Factor of the values.
  void add(std::span<const std::int64_t> rows,
           std::span<const std::int64_t> columns, const double* values,
           double factor = 1)
  {
    const std::size_t width = C * columns.size();
    for (std::size_t i = 0; i < rows.size(); ++i)
    {
      if (rows[i] < 0)
        continue;
      auto [it, made] = _index.try_emplace(rows[i], _rows.size());
      if (made)
        _rows.push_back({rows[i], {}, {}});
      Row& row = _rows[it->second];
      for (std::size_t j = 0; j < columns.size(); ++j)
      {
        auto c = std::find(row.columns.begin(), row.columns.end(), columns[j]);
        const std::size_t at = c - row.columns.begin();
        if (c == row.columns.end())
        {
          row.columns.push_back(columns[j]);
          row.values.resize(row.values.size() + R * C, 0.0);
        }
        const double* v = values + R * i * width + C * j;
        double* block = row.values.data() + R * C * at;
        for (int r = 0; r < R; ++r)
        {
          for (int k = 0; k < C; ++k)
            block[C * r + k] += factor * v[r * width + k];
        }
      }
    }
  }

  /// @brief Add everything to a matrix, and forget it.
  /// @param[in] A Matrix, or null for nothing.
  void flush(Mat A)
  {
    constexpr bool scalar = R == 1 and C == 1;
    constexpr int repeat = scalar ? 3 : 1;
    constexpr int row_size = scalar ? 3 : R, column_size = scalar ? 3 : C;
    std::vector<std::size_t> order;
    std::vector<PetscInt> columns;
    std::vector<double> values;
    for (const Row& row : _rows)
    {
      if (!A)
        break;
      const std::size_t n = row.columns.size();
      order.resize(n);
      std::iota(order.begin(), order.end(), 0);
      std::sort(order.begin(), order.end(),
                [&](auto a, auto b)
                { return row.columns[a] < row.columns[b]; });
      for (int c = 0; c < repeat; ++c)
      {
        columns.clear();
        values.resize(R * C * n);
        for (std::size_t i = 0; i < n; ++i)
        {
          for (int k = 0; k < C; ++k)
          {
            columns.push_back(column_size * row.columns[order[i]] + k + c);
            for (int r = 0; r < R; ++r)
            {
              values[r * C * n + C * i + k]
                  = row.values[R * C * order[i] + C * r + k];
            }
          }
        }
        std::array<PetscInt, R> rows;
        for (int r = 0; r < R; ++r)
          rows[r] = row_size * row.number + r + c;
        if (MatSetValues(A, R, rows.data(), columns.size(), columns.data(),
                         values.data(), ADD_VALUES)
            != PETSC_SUCCESS)
        {
          throw std::runtime_error("PETSc failed in MatSetValues");
        }
      }
    }
    _rows.clear();
    _index.clear();
  }

private:
  struct Row
  {
    std::int64_t number;
    std::vector<std::int64_t> columns;
    std::vector<double> values;
  };

  std::vector<Row> _rows;
  std::unordered_map<std::int64_t, std::size_t> _index;
};
} // namespace dolfinx_mortar
