// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "unused_memory.h"
#ifdef __GLIBC__
#include <malloc.h>
#endif

//-----------------------------------------------------------------------------
void dolfinx_mortar::give_back_memory()
{
#ifdef __GLIBC__
  malloc_trim(0);
#endif
}
