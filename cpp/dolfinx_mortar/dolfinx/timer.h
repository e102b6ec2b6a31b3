// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <dolfinx/common/Timer.h>
#include <dolfinx/common/log.h>
#include <string>

namespace dolfinx_mortar
{
/// Time of a phase of the work, in DOLFINx's table of timings
using Timer = decltype(dolfinx::common::Timer("task"));

/// @brief Write a warning into DOLFINx's log.
inline void log_warning(const std::string& message) { spdlog::warn(message); }

/// @brief Write a message of the level "info" into DOLFINx's log.
inline void log_info(const std::string& message) { spdlog::info(message); }
} // namespace dolfinx_mortar
