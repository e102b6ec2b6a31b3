// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "measures.h"
#include <algorithm>
#include <cmath>

using namespace dolfinx_mortar;

namespace
{
using RowMatrix
    = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
} // namespace

//-----------------------------------------------------------------------------
std::array<double, 3> dolfinx_mortar::centre(std::span<const double> x)
{
  std::array<double, 3> c = {0, 0, 0};
  for (std::size_t i = 0; i < x.size(); ++i)
    c[i % 3] += 3 * x[i] / x.size();
  return c;
}
//-----------------------------------------------------------------------------
double dolfinx_mortar::facet_area(const FacetView& f,
                                  const QuadratureRule& rule)
{
  SurfacePoint p;
  double area = 0;
  for (std::size_t q = 0; q < rule.weights.size(); ++q)
  {
    evaluate(f, {rule.points[2 * q], rule.points[2 * q + 1]}, p);
    area += rule.weights[q] * p.a1.cross(p.a2).norm();
  }
  return area;
}
//-----------------------------------------------------------------------------
double dolfinx_mortar::diameter(const FacetView& f)
{
  const Eigen::Map<const RowMatrix> x(f.x.data(), num_nodes(f.type), 3);
  double d = 0;
  for (int i = 0; i < x.rows(); ++i)
    d = std::max(d,
                 (x.rowwise() - x.row(i)).rowwise().squaredNorm().maxCoeff());
  return std::sqrt(d);
}
//-----------------------------------------------------------------------------
Vec3 dolfinx_mortar::corner_normal(const FacetView& f)
{
  auto x = [&](int k) { return node(f, k); };
  const Vec3 c = num_corners(f.type) == 3 ? (x(1) - x(0)).cross(x(2) - x(0))
                                          : (x(3) - x(0)).cross(x(2) - x(1));
  return f.orientation * c.normalized();
}
