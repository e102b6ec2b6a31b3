// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <algorithm>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Sort values and keep each once.
template <typename T>
void sort_unique(std::vector<T>& values)
{
  std::ranges::sort(values);
  values.erase(std::ranges::unique(values).begin(), values.end());
}
} // namespace dolfinx_mortar
