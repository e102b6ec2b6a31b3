// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <cmath>
#include <cstdint>

namespace unit
{
/// Numbers between -1 and 1, the same on all ranks and with all libraries.
class Numbers
{
public:
  explicit Numbers(std::uint32_t seed) : _state(seed) {}

  double operator()()
  {
    _state = 1664525 * _state + 1013904223;
    return (_state >> 8) / static_cast<double>(1 << 23) - 1;
  }

private:
  std::uint32_t _state;
};

/// True where two numbers differ by no more than a tolerance, which NaN does.
inline bool close(double a, double b, double tolerance)
{
  return std::abs(a - b) <= tolerance;
}
} // namespace unit
