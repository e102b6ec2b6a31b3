// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "multiplier.h"

using namespace dolfinx_mortar;

namespace
{
/// Share of an edge function that goes to each corner, and what the edge
/// function keeps.
struct EdgeShare
{
  double corner, edge;
};

EdgeShare edge_share(MultiplierSpace space, FacetType type)
{
  if (!is_second_order(type))
    return {0, 1};
  else if (space == MultiplierSpace::dual)
  {
    // One value for tri6 and quad8 keeps mixed surfaces continuous
    constexpr double alpha = 0.2;
    if (type == FacetType::quad9)
      return {0, 1};
    else
      return {alpha, 1 - 2 * alpha};
  }
  else if (space == MultiplierSpace::standard and type == FacetType::quad9)
    return {0, 1};
  else
    return {0.5, 1};
}
} // namespace

//-----------------------------------------------------------------------------
int dolfinx_mortar::num_multipliers(MultiplierSpace space, FacetType type)
{
  switch (space)
  {
  case MultiplierSpace::dual:
    return num_nodes(type);
  case MultiplierSpace::dual_linear:
    return num_corners(type);
  default:
    return type == FacetType::quad9 ? 9 : num_corners(type);
  }
}
//-----------------------------------------------------------------------------
FacetMatrix dolfinx_mortar::transformation(MultiplierSpace space,
                                           FacetType type)
{
  const int n = num_nodes(type), nc = num_corners(type);
  const EdgeShare share = edge_share(space, type);
  FacetMatrix T = FacetMatrix::Identity(n, n);
  if (is_second_order(type))
  {
    const auto edges = edge_corners(type);
    for (int e = 0; e < nc; ++e)
    {
      for (int c : edges[e])
        T(nc + e, c) = share.corner;
      T(nc + e, nc + e) = share.edge;
    }
    // Bilinear functions are one quarter at the centre
    if (type == FacetType::quad9 and share.corner > 0)
      T.block(8, 0, 1, 4).setConstant(0.25);
  }
  return T;
}
//-----------------------------------------------------------------------------
FacetMatrix dolfinx_mortar::inverse_transformation(MultiplierSpace space,
                                                   FacetType type)
{
  const int n = num_nodes(type), nc = num_corners(type);
  const EdgeShare share = edge_share(space, type);
  FacetMatrix T = FacetMatrix::Identity(n, n);
  if (is_second_order(type))
  {
    const auto edges = edge_corners(type);
    for (int e = 0; e < nc; ++e)
    {
      for (int c : edges[e])
        T(nc + e, c) = -share.corner / share.edge;
      T(nc + e, nc + e) = 1 / share.edge;
    }
    if (type == FacetType::quad9 and share.corner > 0)
      T.block(8, 0, 1, 4).setConstant(-0.25);
  }
  return T;
}
//-----------------------------------------------------------------------------
bool ScaledCholesky::compute(const FacetMatrix& M)
{
  if (!(M.diagonal().minCoeff() > 0))
    return false;
  _scale = M.diagonal().array().rsqrt();
  FacetMatrix S = _scale.asDiagonal() * M * _scale.asDiagonal();
  _llt.compute(S);
  // A pivot at the level of round-off carries no information
  return _llt.info() == Eigen::Success
         and _llt.matrixLLT().diagonal().minCoeff() > 1e-6;
}
