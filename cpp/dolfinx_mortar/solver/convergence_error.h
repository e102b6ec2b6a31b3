// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <stdexcept>

namespace dolfinx_mortar
{
/// @brief A solve did not converge; the state of the problem is as before it.
class ConvergenceError : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};
} // namespace dolfinx_mortar
