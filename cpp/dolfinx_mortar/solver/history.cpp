// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "history.h"
#include <algorithm>
#include <array>

using namespace dolfinx_mortar;

//-----------------------------------------------------------------------------
bool dolfinx_mortar::ends_slipping(const History& history)
{
  int slipping = 0;
  for (const Iterate& i : history)
  {
    if (i.stick > 0)
      slipping = 0;
    else if (i.slip > 0)
      ++slipping;
  }
  return slipping >= 2;
}
//-----------------------------------------------------------------------------
bool dolfinx_mortar::stagnates(const History& history)
{
  if (history.size() < 4)
    return false;
  std::array<double, 4> residuals;
  for (int k = 0; k < 4; ++k)
  {
    const Iterate& i = history[history.size() - 4 + k];
    if (i.stick > 0 or i.slip == 0)
      return false;
    residuals[k] = std::max(i.force, i.constraint);
  }
  const double earlier = std::min(residuals[0], residuals[1]);
  return std::min(residuals[2], residuals[3]) > std::max(0.5 * earlier, 1e-3);
}
