// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "multiplier.h"
#include <algorithm>

using namespace dolfinx_mortar;

namespace
{
/// Shares of functions: Ñ_c gets `corner` of an edge function, which keeps
/// `edge`.
struct EdgeShare
{
  double corner, edge;
};

/// The space that a facet has: away from tri6 and quad8 dual reproduces linear
/// tractions as it is, or is as good as first-order elements are.
MultiplierSpace space_on(MultiplierSpace space, FacetType type)
{
  return space == MultiplierSpace::dual_reproducing
                 and !is_reproducing(space, type)
             ? MultiplierSpace::dual
             : space;
}

EdgeShare edge_share(MultiplierSpace space, FacetType type, bool nonnegative)
{
  if (!is_second_order(type))
    return {0, 1};
  else if (is_reproducing(space, type))
  {
    const double alpha = type == FacetType::tri6 ? 1.0 / 12 : 1.0 / 5;
    return {nonnegative ? 0.5 : alpha, 1};
  }
  else if (space == MultiplierSpace::dual)
  {
    // Tetrahedra and hexahedra share no nodes, so each type has its own value
    double alpha = 0;
    switch (type)
    {
    case FacetType::tri6:
      alpha = nonnegative ? 3.0 / 8 : 1.0 / 12;
      break;
    case FacetType::quad8:
      alpha = nonnegative ? 3.0 / 8 : 1.0 / 5;
      break;
    default:
      alpha = nonnegative ? 1.0 / 4 : 0;
    }
    return {alpha, 1 - 2 * alpha};
  }
  else if (space == MultiplierSpace::standard and type == FacetType::quad9)
    return {0, 1};
  else
    return {0.5, 1};
}

/// Shares of the centre function of a quad9 that go to each corner and to each
/// edge, and what it keeps.
struct CentreShare
{
  double corner, edge, centre;
};

CentreShare centre_share(MultiplierSpace space, bool nonnegative)
{
  switch (space)
  {
  case MultiplierSpace::dual_linear:
    // Bilinear functions are one quarter at the centre
    return {0.25, 0, 1};
  case MultiplierSpace::dual:
    if (nonnegative)
      return {1.0 / 16, 1.0 / 8, 1.0 / 4};
    return {0, 0, 1};
  default:
    return {0, 0, 1};
  }
}
} // namespace

//-----------------------------------------------------------------------------
int dolfinx_mortar::num_multipliers(MultiplierSpace space, FacetType type)
{
  switch (space_on(space, type))
  {
  case MultiplierSpace::dual:
    return num_nodes(type);
  case MultiplierSpace::dual_linear:
  case MultiplierSpace::dual_reproducing:
    return num_corners(type);
  default:
    return type == FacetType::quad9 ? 9 : num_corners(type);
  }
}
//-----------------------------------------------------------------------------
FacetMatrix
dolfinx_mortar::transformation(MultiplierSpace space, FacetType type,
                               std::span<const std::int8_t> nonnegative)
{
  space = space_on(space, type);
  const int n = num_nodes(type), nc = num_corners(type);
  FacetMatrix T = FacetMatrix::Identity(n, n);
  if (!is_second_order(type))
    return T;
  const auto edges = edge_corners(type);
  for (int e = 0; e < nc; ++e)
  {
    const EdgeShare s
        = edge_share(space, type, !nonnegative.empty() and nonnegative[nc + e]);
    for (int c : edges[e])
      T(nc + e, c) = s.corner;
    T(nc + e, nc + e) = s.edge;
  }
  if (type == FacetType::quad9)
  {
    const CentreShare s
        = centre_share(space, !nonnegative.empty() and nonnegative[8]);
    T.block(8, 0, 1, 4).setConstant(s.corner);
    T.block(8, 4, 1, 4).setConstant(s.edge);
    T(8, 8) = s.centre;
  }
  return T;
}
//-----------------------------------------------------------------------------
FacetMatrix
dolfinx_mortar::inverse_transformation(MultiplierSpace space, FacetType type,
                                       std::span<const std::int8_t> nonnegative)
{
  // Corners, then edges, then the centre: T is lower triangular, so this is
  // d̃_e = (d_e - α (d_a + d_b)) / (1 - 2 α)
  const FacetMatrix T = transformation(space, type, nonnegative);
  FacetMatrix inverse = FacetMatrix::Identity(T.rows(), T.cols());
  for (int i = 0; i < T.rows(); ++i)
  {
    for (int j = 0; j < i; ++j)
      inverse.row(i) -= T(i, j) * inverse.row(j);
    inverse.row(i) /= T(i, i);
  }
  return inverse;
}
//-----------------------------------------------------------------------------
bool dolfinx_mortar::is_nonnegative(MultiplierSpace space, FacetType type,
                                    std::span<const std::int8_t> nonnegative)
{
  if (!is_second_order(type) or space == MultiplierSpace::dual_linear)
    return true;
  // On tri6 and quad8 these are the (bi)linear functions of the corners
  if (space == MultiplierSpace::standard)
    return type != FacetType::quad9;
  return !nonnegative.empty()
         and std::all_of(nonnegative.begin() + num_corners(type),
                         nonnegative.end(),
                         [](auto flag) { return flag != 0; });
}
//-----------------------------------------------------------------------------
bool ScaledFactors::compute(const FacetMatrix& M, bool symmetric)
{
  if (!(M.diagonal().minCoeff() > 0))
    return false;
  _symmetric = symmetric;
  _scale = M.diagonal().array().rsqrt();
  FacetMatrix S = _scale.asDiagonal() * M * _scale.asDiagonal();
  if (!symmetric)
  {
    // Such matrices pass through singular ones where less and less is covered:
    // functions get large before
    _lu.compute(S);
    return _lu.matrixLU().diagonal().cwiseAbs().minCoeff() > 1e-3;
  }
  // A pivot at the level of round-off carries no information
  _llt.compute(S);
  return _llt.info() == Eigen::Success
         and _llt.matrixLLT().diagonal().minCoeff() > 1e-6;
}
