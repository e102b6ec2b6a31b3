// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT
//
// Normals of a surface at its nodes.

#include "surface.h"
#include "triangles.h"
#include <algorithm>
#include <array>
#include <dolfinx_mortar/common/error.h>
#include <string>

using namespace dolfinx_mortar;

namespace
{
using Vector = Eigen::Vector3d;

/// Derivatives of the shape functions at the nodes, `[node][direction][k]`
using NodeDerivatives
    = std::array<std::array<std::array<double, max_facet_nodes>, 2>,
                 max_facet_nodes>;

const NodeDerivatives& node_derivatives(FacetType type)
{
  static const std::array<NodeDerivatives, 5> tables = []
  {
    std::array<NodeDerivatives, 5> t = {};
    for (int i = 0; i < 5; ++i)
    {
      const FacetType type = static_cast<FacetType>(i);
      std::span<const double> xi = node_coordinates(type);
      for (int k = 0; k < num_nodes(type); ++k)
      {
        Shapes s = {};
        tabulate(type, {xi[2 * k], xi[2 * k + 1]}, 1, s);
        t[i][k] = s.dN;
      }
    }
    return t;
  }();
  return tables[static_cast<int>(type)];
}

/// Tangents x,ξ₁ and x,ξ₂ of a facet at one of its nodes.
std::array<Vector, 2>
tangents(std::span<const std::int32_t> nodes, std::span<const double> x,
         const std::array<std::array<double, max_facet_nodes>, 2>& dN)
{
  std::array<Vector, 2> t = {Vector::Zero(), Vector::Zero()};
  for (std::size_t l = 0; l < nodes.size(); ++l)
    for (int i = 0; i < 2; ++i)
      t[i] += dN[i][l] * row(x, nodes[l]);
  return t;
}

/// Areas |x,ξ₁ × x,ξ₂| up to this part of the squared size of a facet are none.
constexpr double no_area = 1e-12;

/// Square of the largest distance of a node from the first.
double squared_size(std::span<const std::int32_t> nodes,
                    std::span<const double> x)
{
  double size = 0;
  for (std::int32_t n : nodes)
    size = std::max(size, (row(x, n) - row(x, nodes[0])).squaredNorm());
  return size;
}

std::string no_area_message(FacetType type, std::span<const std::int32_t> nodes,
                            std::size_t k, std::span<const double> x,
                            const std::string& name)
{
  const int n = num_corners(type);
  Vector midpoint = Vector::Zero();
  for (int l = 0; l < n; ++l)
    midpoint += row(x, nodes[l]) / n;
  return "The facet of the " + name + " with midpoint "
         + to_string(std::span<const double, 3>(midpoint.data(), 3))
         + " has no area at its node "
         + to_string(x.subspan(3 * nodes[k]).first<3>())
         + ": look for collapsed cells in the mesh, or for a step that "
           "diverged.";
}

/// Say so where a facet has no area at a node, and nothing has been said yet.
/// @param[in] n Its normals, see facet_normals.
void note_no_area(const Surface& s, std::span<const double> x, std::int32_t f,
                  std::span<const double> n, const std::string& name,
                  std::string& message)
{
  const std::span<const std::int32_t> nodes = facet_nodes(s, f);
  for (std::size_t k = 0; k < nodes.size(); ++k)
    if (message.empty() and row(n, k).isZero(0))
      message = no_area_message(s.types[f], nodes, k, x, name);
}

/// Sum of the unit normals of the facets that meet at a node, for all owned
/// nodes. Collective.
std::vector<double> sum_of_normals(const Surface& s, std::span<const double> x)
{
  std::string message;
  std::vector<double> sum(x.size(), 0.0);
  std::array<double, 3 * max_facet_nodes> n;
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    facet_normals(s, x, f, n);
    note_no_area(s, x, f, n, "surface", message);
    const std::span<const std::int32_t> nodes = facet_nodes(s, f);
    for (std::size_t k = 0; k < nodes.size(); ++k)
      Eigen::Map<Vector>(sum.data() + 3 * nodes[k]) += row(n, k);
  }
  throw_on_all(s.comm, message);
  scatter_reverse_add(s, std::span(sum), 3);
  return sum;
}

/// The projection that drops the fixed components of a node, as three factors
/// 0 or 1. Where the normal kept a fixed component nothing was dropped.
Vector dropped(std::span<const std::int8_t> fixed, std::span<const double> n,
               std::int32_t node)
{
  if (fixed.empty())
    return Vector::Ones();
  Vector keep;
  for (int c = 0; c < 3; ++c)
  {
    keep[c] = fixed[3 * node + c] ? 0 : 1;
    if (fixed[3 * node + c] and n[3 * node + c] != 0)
      return Vector::Ones();
  }
  return keep;
}
} // namespace

//-----------------------------------------------------------------------------
void dolfinx_mortar::facet_normals(const Surface& s, std::span<const double> x,
                                   std::int32_t f, std::span<double> n)
{
  std::span<const std::int32_t> nodes = facet_nodes(s, f);
  const NodeDerivatives& dN = node_derivatives(s.types[f]);
  const double tol = no_area * squared_size(nodes, x);
  for (std::size_t k = 0; k < nodes.size(); ++k)
  {
    auto [t0, t1] = tangents(nodes, x, dN[k]);
    const Vector c = t0.cross(t1);
    const double length = c.norm();
    Eigen::Map<Vector> nk(n.data() + 3 * k);
    // False for NaN
    if (length > tol)
      nk = s.orientation[f] * c / length;
    else
      nk.setZero();
  }
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::check_areas(const Surface& s, std::span<const double> x,
                                 const std::string& name)
{
  std::string message;
  if (x.size() != 3 * s.numbers.size())
    message = "Positions need three values for each node of the " + name + ".";
  std::array<double, 3 * max_facet_nodes> n;
  for (std::size_t f = 0; f < s.types.size() and message.empty(); ++f)
  {
    facet_normals(s, x, f, n);
    note_no_area(s, x, f, n, name, message);
  }
  throw_on_all(s.comm, message);
}
//-----------------------------------------------------------------------------
Normals dolfinx_mortar::compute_normals(const Surface& s,
                                        std::span<const double> x,
                                        std::span<const std::int8_t> fixed)
{
  std::string message;
  if (x.size() != 3 * s.numbers.size()
      or (!fixed.empty() and fixed.size() != x.size()))
  {
    message = "Positions and fixed components need three values for each node "
              "of the surface.";
  }
  throw_on_all(s.comm, message);

  Normals normals;
  normals.n = sum_of_normals(s, x);
  normals.length.resize(num_local_nodes(s));
  for (std::int32_t k = 0; k < s.num_owned; ++k)
  {
    Eigen::Map<Vector> n(normals.n.data() + 3 * k);
    double length = n.norm();
    if (!(length > 1e-8) and message.empty())
    {
      message = "The normals of the facets that meet at the surface node "
                + to_string(x.subspan(3 * k).first<3>())
                + " (current position) cancel: facets there are folded back, "
                  "or both sides of a thin body are in one surface.";
    }
    if (!fixed.empty())
    {
      Vector kept;
      for (int c = 0; c < 3; ++c)
        kept[c] = fixed[3 * k + c] ? 0 : n[c];
      if (kept.norm() > 0.1 * length)
      {
        n = kept;
        length = kept.norm();
      }
    }
    n /= length;
    normals.length[k] = length;
  }
  throw_on_all(s.comm, message);

  scatter_forward(s, std::span(normals.n), 3);
  scatter_forward(s, std::span(normals.length), 1);
  return normals;
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::normal_derivative(const Surface& s,
                                       std::span<const double> x,
                                       std::span<const std::int8_t> fixed,
                                       const Normals& normals, std::int32_t f,
                                       std::span<double> dn)
{
  std::span<const std::int32_t> nodes = facet_nodes(s, f);
  const std::size_t num = nodes.size();
  const NodeDerivatives& dN = node_derivatives(s.types[f]);
  for (std::size_t k = 0; k < num; ++k)
  {
    // n = P s / |P s|, s = Σ m, m = c / |c|, c = ± t₀ × t₁: Q = ∂n/∂c of this
    // facet is (I - n nᵀ) / |P s| · P · (I - m mᵀ) / |c|
    auto [t0, t1] = tangents(nodes, x, dN[k]);
    const Vector c = t0.cross(t1);
    const double length = c.norm();
    const Vector m = s.orientation[f] * c / length,
                 n = row(normals.n, nodes[k]);
    const Vector keep = dropped(fixed, normals.n, nodes[k]);
    const double scale = s.orientation[f] / (length * normals.length[nodes[k]]);
    const Eigen::Matrix3d I = Eigen::Matrix3d::Identity(),
                          P = keep.asDiagonal();
    const Eigen::Matrix3d Q
        = scale * (I - n * n.transpose()) * P * (I - m * m.transpose());

    // Row i of Q times dc = dN₀ (dx × t₁) + dN₁ (t₀ × dx) is
    // (dN₀ t₁ × q - dN₁ t₀ × q) · dx
    for (int i = 0; i < 3; ++i)
    {
      const Vector q = Q.row(i), a = t1.cross(q), b = t0.cross(q);
      double* out = dn.data() + (3 * k + i) * 3 * num;
      for (std::size_t l = 0; l < num; ++l)
        for (int c = 0; c < 3; ++c)
          out[3 * l + c] = dN[k][0][l] * a[c] - dN[k][1][l] * b[c];
    }
  }
}
