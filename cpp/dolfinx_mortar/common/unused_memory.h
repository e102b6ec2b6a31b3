// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

namespace dolfinx_mortar
{
/// @brief Give memory that has been freed back to the operating system, where
/// it is much.
///
/// A library may have all arrays come from one heap, however large they are, as
/// one that Debian's PETSc loads does. What temporary matrices leave lies
/// between what stays then: a tenth of all memory of large problems.
void give_back_memory();
} // namespace dolfinx_mortar
