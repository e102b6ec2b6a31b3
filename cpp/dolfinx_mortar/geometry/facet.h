// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <array>
#include <cstdint>
#include <span>

/// @brief Mortar coupling of finite element surfaces.
namespace dolfinx_mortar
{
/// @brief Facets of the supported cells and spaces: tet P1, tet P2, hex Q1,
/// hex serendipity (hex20) and hex Q2 (hex27).
enum class FacetType : std::int8_t
{
  tri3 = 0,
  tri6 = 1,
  quad4 = 2,
  quad8 = 3,
  quad9 = 4
};

/// Number of types.
constexpr int num_facet_types = 5;

/// Largest number of nodes of a facet.
constexpr int max_facet_nodes = 9;

/// Largest coordinate of a position: products of a few must not overflow.
constexpr double largest_position = 1e75;

/// @brief Number of nodes.
constexpr int num_nodes(FacetType type)
{
  constexpr std::array<int, 5> n = {3, 6, 4, 8, 9};
  return n[static_cast<int>(type)];
}

/// @brief Number of corner nodes; corners come first, then edge nodes, then
/// the centre.
constexpr int num_corners(FacetType type)
{
  return type == FacetType::tri3 or type == FacetType::tri6 ? 3 : 4;
}

/// @brief True where the facet has nodes besides its corners.
constexpr bool is_second_order(FacetType type) { return num_nodes(type) > 4; }

/// @brief Total polynomial degree of the shape functions.
constexpr int total_degree(FacetType type)
{
  constexpr std::array<int, 5> d = {1, 2, 2, 3, 4};
  return d[static_cast<int>(type)];
}

/// @brief Corners at the ends of each edge.
///
/// Edge `e` carries node `num_corners + e` of a second-order facet. The
/// reference facets are those of Basix:
///
///      2                 2---7---3
///      | \               |       |
///      4   3             5   8   6
///      |     \           |       |
///      0---5---1         0---4---1
///
/// @return Pairs of corners; a triangle uses the first three.
constexpr std::array<std::array<int, 2>, 4> edge_corners(FacetType type)
{
  if (num_corners(type) == 3)
    return {{{1, 2}, {0, 2}, {0, 1}, {-1, -1}}};
  else
    return {{{0, 1}, {0, 2}, {1, 3}, {2, 3}}};
}

/// @brief Coordinates of the nodes on the reference facet, triangle
/// {ξ ≥ 0, ξ₁ + ξ₂ ≤ 1} or square [0, 1]².
/// @return Array of shape (num_nodes, 2), row-major.
std::span<const double> node_coordinates(FacetType type);

/// @brief Shape functions and their derivatives at a point, or at several (T).
template <typename T>
struct ShapesOf
{
  /// Values N_k
  std::array<T, max_facet_nodes> N;

  /// First derivatives ∂N_k/∂ξ₁, ∂N_k/∂ξ₂
  std::array<std::array<T, max_facet_nodes>, 2> dN;

  /// Second derivatives ∂²N_k/∂ξ₁², ∂²N_k/∂ξ₁∂ξ₂, ∂²N_k/∂ξ₂²
  std::array<std::array<T, max_facet_nodes>, 3> ddN;
};

/// @brief The same at one point.
using Shapes = ShapesOf<double>;

/// @brief Evaluate the shape functions of a facet.
/// @param[in] type Facet type.
/// @param[in] xi Reference coordinates (ξ₁, ξ₂).
/// @param[in] order Highest derivative to evaluate: 0, 1 or 2.
/// @param[out] s Entries of the first `num_nodes` functions are set.
void tabulate(FacetType type, std::array<double, 2> xi, int order, Shapes& s);

/// @brief A linear part (triangle or quadrilateral) of a facet.
struct SubFacet
{
  /// Number of corners, 3 or 4
  int size;

  /// Nodes of the facet at the corners; quadrilaterals in tensor order
  std::array<int, 4> nodes;
};

/// @brief Split of a facet into linear sub-facets, all with the orientation of
/// the facet: tri6 into 4 triangles, quad8 into 4 triangles and a
/// quadrilateral, quad9 into 4 quadrilaterals.
std::span<const SubFacet> sub_facets(FacetType type);

/// @brief True where a point lies in the reference facet, up to `tol`.
bool in_reference(FacetType type, std::array<double, 2> xi, double tol);
} // namespace dolfinx_mortar
