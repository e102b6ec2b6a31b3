// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "facet.h"
#include "shape_functions.h"

using namespace dolfinx_mortar;

//-----------------------------------------------------------------------------
std::span<const double> dolfinx_mortar::node_coordinates(FacetType type)
{
  static constexpr std::array<double, 12> tri
      = {0, 0, 1, 0, 0, 1, 0.5, 0.5, 0, 0.5, 0.5, 0};
  static constexpr std::array<double, 18> quad
      = {0, 0, 1, 0, 0, 1, 1, 1, 0.5, 0, 0, 0.5, 1, 0.5, 0.5, 1, 0.5, 0.5};
  std::size_t n = 2 * num_nodes(type);
  if (num_corners(type) == 3)
    return std::span(tri).first(n);
  else
    return std::span(quad).first(n);
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::tabulate(FacetType type, std::array<double, 2> xi,
                              int order, Shapes& s)
{
  const double x = xi[0], y = xi[1];
  switch (type)
  {
  case FacetType::tri3:
    return tabulate_functions<FacetType::tri3>(x, y, order, s);
  case FacetType::tri6:
    return tabulate_functions<FacetType::tri6>(x, y, order, s);
  case FacetType::quad4:
    return tabulate_functions<FacetType::quad4>(x, y, order, s);
  case FacetType::quad8:
    return tabulate_functions<FacetType::quad8>(x, y, order, s);
  case FacetType::quad9:
    return tabulate_functions<FacetType::quad9>(x, y, order, s);
  }
}
//-----------------------------------------------------------------------------
std::span<const SubFacet> dolfinx_mortar::sub_facets(FacetType type)
{
  static constexpr std::array<SubFacet, 1> tri3 = {{{3, {0, 1, 2, -1}}}};
  static constexpr std::array<SubFacet, 4> tri6 = {{{3, {0, 5, 4, -1}},
                                                    {3, {5, 1, 3, -1}},
                                                    {3, {4, 3, 2, -1}},
                                                    {3, {3, 4, 5, -1}}}};
  static constexpr std::array<SubFacet, 1> quad4 = {{{4, {0, 1, 2, 3}}}};
  static constexpr std::array<SubFacet, 5> quad8 = {{{3, {0, 4, 5, -1}},
                                                     {3, {4, 1, 6, -1}},
                                                     {3, {5, 7, 2, -1}},
                                                     {3, {6, 3, 7, -1}},
                                                     {4, {4, 6, 5, 7}}}};
  static constexpr std::array<SubFacet, 4> quad9 = {{{4, {0, 4, 5, 8}},
                                                     {4, {4, 1, 8, 6}},
                                                     {4, {5, 8, 2, 7}},
                                                     {4, {8, 6, 7, 3}}}};
  switch (type)
  {
  case FacetType::tri3:
    return tri3;
  case FacetType::tri6:
    return tri6;
  case FacetType::quad4:
    return quad4;
  case FacetType::quad8:
    return quad8;
  default:
    return quad9;
  }
}
//-----------------------------------------------------------------------------
bool dolfinx_mortar::in_reference(FacetType type, std::array<double, 2> xi,
                                  double tol)
{
  if (xi[0] < -tol or xi[1] < -tol)
    return false;
  if (num_corners(type) == 3)
    return xi[0] + xi[1] <= 1 + tol;
  else
    return xi[0] <= 1 + tol and xi[1] <= 1 + tol;
}
