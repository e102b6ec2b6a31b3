// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <cstdint>
#include <dolfinx_mortar/assembly/petsc.h>
#include <span>

namespace dolfinx_mortar
{
/// @brief Where a row of combine_rows comes from.
enum class RowSource : std::int8_t
{
  all = 0,     ///< K and the other matrices
  without = 1, ///< the other matrices, without K
  unit = 2     ///< one on the diagonal
};

/// @brief Sum of matrices, row by row: K with few rows changed. Collective.
///
/// Rows in which only K has entries are copied.
/// @param[in] K Square AIJ matrix, rows in blocks of three.
/// @param[in] others Matrices of the same layout, with few rows that are not
/// empty.
/// @param[in] sources Source of each local row; empty for RowSource::all.
Matrix combine_rows(Mat K, std::span<const Mat> others,
                    std::span<const RowSource> sources);
} // namespace dolfinx_mortar
