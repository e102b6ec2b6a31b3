// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "mpi_exchange.h"

//-----------------------------------------------------------------------------
std::int64_t& dolfinx_mortar::received_bytes()
{
  static std::int64_t bytes = 0;
  return bytes;
}
