// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "quadrature.h"
#include <algorithm>
#include <basix/cell.h>
#include <basix/polyset.h>
#include <basix/quadrature.h>
#include <stdexcept>
#include <string>

using namespace dolfinx_mortar;

//-----------------------------------------------------------------------------
QuadratureRule dolfinx_mortar::create_rule(int num_corners, int degree)
{
  // Beyond that rules take more memory than sense
  if (degree < 0 or degree > 100)
  {
    throw std::invalid_argument("The degree of quadrature is "
                                + std::to_string(degree)
                                + ", but must be between 0 and 100.");
  }
  auto cell = num_corners == 3 ? basix::cell::type::triangle
                               : basix::cell::type::quadrilateral;
  auto rule = basix::quadrature::make_quadrature<double>(
      basix::quadrature::type::Default, cell, basix::polyset::type::standard,
      degree);
  return {{rule[0].begin(), rule[0].end()}, {rule[1].begin(), rule[1].end()}};
}
//-----------------------------------------------------------------------------
int dolfinx_mortar::default_degree(FacetType slave, FacetType master)
{
  const int p = total_degree(slave);
  return std::max({3 * p > 8 ? 8 : 3 * p, p + total_degree(master), 4});
}
