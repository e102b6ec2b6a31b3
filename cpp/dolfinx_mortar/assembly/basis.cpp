// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "basis.h"
#include "facet_loop.h"
#include <dolfinx_mortar/geometry/quadrature.h>
#include <dolfinx_mortar/multiplier/multiplier.h>
#include <dolfinx_mortar/surface/patches.h>
#include <map>

using namespace dolfinx_mortar;

namespace
{
/// Share of the area from which on a facet counts as covered as a whole.
/// Segments on curved facets leave seams of some per mille; 0.9 and 0.995 give
/// the same iterations in the demo of sliding shells.
constexpr double covered_as_a_whole = 0.97;

/// Integrals over single facets of a surface, with one rule for each type.
class WholeFacets
{
public:
  WholeFacets(const Surface& s, std::span<const double> x) : _s(s), _x(x) {}

  /// ∫ N_k over facet `f` for its nodes k; the area is their sum
  std::span<const double> shape_integrals(std::int32_t f)
  {
    const FacetType type = _s.types[f];
    auto [it, made] = _rules.try_emplace(type);
    if (made)
      it->second = create_rule(num_corners(type), 2 * total_degree(type));
    const QuadratureRule& rule = it->second;
    auto nodes = facet_nodes(_s, f);
    _integrals.assign(nodes.size(), 0.0);
    for (std::size_t q = 0; q < rule.weights.size(); ++q)
    {
      tabulate(type, {rule.points[2 * q], rule.points[2 * q + 1]}, 1, _shapes);
      Eigen::Vector3d a1 = Eigen::Vector3d::Zero(), a2 = a1;
      for (std::size_t k = 0; k < nodes.size(); ++k)
      {
        const Eigen::Map<const Eigen::Vector3d> xk(_x.data() + 3 * nodes[k]);
        a1 += _shapes.dN[0][k] * xk;
        a2 += _shapes.dN[1][k] * xk;
      }
      const double w = rule.weights[q] * a1.cross(a2).norm();
      for (std::size_t k = 0; k < nodes.size(); ++k)
        _integrals[k] += w * _shapes.N[k];
    }
    return _integrals;
  }

private:
  const Surface& _s;
  std::span<const double> _x;
  std::map<FacetType, QuadratureRule> _rules;
  Shapes _shapes;
  std::vector<double> _integrals;
};

/// Let owners, and then ghosts, know what is flagged on any rank.
void share(const Surface& s, std::vector<std::int32_t>& flags)
{
  scatter_reverse_add(s, std::span<std::int32_t>(flags), 1);
  share_largest(s, flags);
  scatter_forward(s, std::span<std::int32_t>(flags), 1);
}
} // namespace

//-----------------------------------------------------------------------------
std::vector<double>
dolfinx_mortar::nodal_weights(const Interface& interface,
                              std::span<const std::int8_t> nonnegative,
                              std::span<const double> x)
{
  return nodal_weights(interface.slave, interface.options.space, nonnegative,
                       x);
}
//-----------------------------------------------------------------------------
std::vector<double>
dolfinx_mortar::nodal_weights(const Surface& s, MultiplierSpace space,
                              std::span<const std::int8_t> nonnegative,
                              std::span<const double> x)
{
  std::vector<double> weights(num_local_nodes(s), 0.0);
  std::vector<std::int8_t> flags;
  WholeFacets facets(s, x);
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    auto nodes = facet_nodes(s, f);
    gather(nodes, nonnegative, 1, flags);
    // All edges flagged: Ñ_c = ψ_c
    if (is_reproducing(space, s.types[f]))
      std::ranges::fill(flags, 1);
    const FacetMatrix T = transformation(space, s.types[f], flags);
    const std::span<const double> N = facets.shape_integrals(f);
    for (std::size_t k = 0; k < nodes.size(); ++k)
    {
      for (std::size_t i = 0; i < nodes.size(); ++i)
        weights[nodes[k]] += N[i] * T(i, k);
    }
  }
  scatter_reverse_add(s, std::span<double>(weights), 1);
  scatter_forward(s, std::span<double>(weights), 1);
  return weights;
}
//-----------------------------------------------------------------------------
std::vector<std::int8_t>
dolfinx_mortar::flag_nonnegative(const Interface& interface,
                                 std::span<const double> beyond)
{
  const Surface& s = interface.slave;
  const std::int32_t num = num_local_nodes(s);
  std::vector<std::int8_t> flags(num, 0);
  const MultiplierSpace space = interface.options.space;
  if (space != MultiplierSpace::dual
      and space != MultiplierSpace::dual_reproducing)
    return flags;

  // Nodes of facets that are not covered as a whole
  std::vector<std::int32_t> partly(num, 0);
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    if (beyond[f] > 1 - covered_as_a_whole)
    {
      for (auto k : facet_nodes(s, f))
        partly[k] = 1;
    }
  }
  share(s, partly);
  std::ranges::transform(partly, flags.begin(), [](auto n) { return n > 0; });
  return flags;
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::insert_transformation(
    const Interface& interface, std::span<const std::int8_t> nonnegative,
    bool inverse, Mat T)
{
  const Surface& s = interface.slave;
  const MultiplierSpace space = interface.options.space;
  std::vector<std::int8_t> flags;
  for (std::int32_t f = 0; f < static_cast<std::int32_t>(s.types.size()); ++f)
  {
    auto nodes = facet_nodes(s, f);
    gather(nodes, nonnegative, 1, flags);
    const FacetMatrix Te
        = inverse ? inverse_transformation(space, s.types[f], flags)
                  : transformation(space, s.types[f], flags);
    for (std::size_t i = 0; i < nodes.size(); ++i)
    {
      for (std::size_t j = 0; j < nodes.size(); ++j)
      {
        if (Te(i, j) == 0)
          continue;
        for (int c = 0; c < 3; ++c)
        {
          // Facets that share an edge insert the same values
          check(MatSetValue(T, 3 * s.blocks[nodes[i]] + c,
                            3 * s.blocks[nodes[j]] + c, Te(i, j),
                            INSERT_VALUES),
                "MatSetValue");
        }
      }
    }
  }
}
//-----------------------------------------------------------------------------
Matrix dolfinx_mortar::create_matrix(MPI_Comm comm, std::int64_t local_rows,
                                     std::int64_t local_columns)
{
  Matrix A;
  check(MatCreate(comm, A.put()), "MatCreate");
  check(MatSetSizes(A.get(), local_rows, local_columns, PETSC_DETERMINE,
                    PETSC_DETERMINE),
        "MatSetSizes");
  check(MatSetType(A.get(), MATAIJ), "MatSetType");
  check(MatSetUp(A.get()), "MatSetUp");
  check(MatSetOption(A.get(), MAT_NEW_NONZERO_ALLOCATION_ERR, PETSC_FALSE),
        "MatSetOption");
  return A;
}
