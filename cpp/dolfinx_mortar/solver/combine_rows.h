// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <cstdint>
#include <dolfinx_mortar/assembly/petsc.h>
#include <span>

namespace dolfinx_mortar
{
/// @brief A matrix of which some rows are part of a sum.
struct RowTerm
{
  /// AIJ matrix
  Mat A;

  /// Non-zero for the local rows that are part of it; empty for all
  std::span<const std::int8_t> rows = {};
};

/// @brief Sum of rows of several matrices. Collective.
///
/// A row that is one matrix's alone is copied, once: a large matrix with few
/// rows changed costs little more than a copy.
/// @param[in] terms At least one; different matrices of the same layout, rows
/// in blocks of three.
/// @param[in] scale Factor of each local row; empty for ones.
/// @param[in] unit Local rows to replace by unit rows.
Matrix combine_rows(std::span<const RowTerm> terms,
                    std::span<const double> scale = {},
                    std::span<const std::int32_t> unit = {});
} // namespace dolfinx_mortar
