// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

namespace dolfinx_mortar
{
/// @brief Give memory that has been freed back to the operating system.
///
/// MPI libraries may keep the C library from asking for large arrays one by one
/// (Open MPI's hooks do), so that what temporary matrices leave lies between
/// what stays: a fifth of all memory of large problems.
void give_back_memory();
} // namespace dolfinx_mortar
