// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "relocation.h"
#include <algorithm>
#include <cmath>
#include <limits>

using namespace dolfinx_mortar;

namespace
{
constexpr double unreached = std::numeric_limits<double>::infinity();

/// How far beyond a master facet its neighbour may begin: seams of facets that
/// are curved differently.
constexpr double seam = 1e-6;

/// Shortest way along a normal to where the gap to one of some facets is a
/// given one; infinite if none is met.
double way_to_facets(const Vec3& x, const Vec3& n, double gap,
                     const FacetList& list,
                     std::span<const std::int32_t> masters)
{
  double way = unreached;
  for (std::int32_t f : masters)
  {
    const std::int32_t begin = list.offsets[f], end = list.offsets[f + 1];
    const FacetView view
        = {list.types[f], list.orientation[f],
           std::span(list.x).subspan(3 * begin, 3 * (end - begin))};
    for (const SubFacet& sub : sub_facets(list.types[f]))
    {
      std::array<double, 2> xi = LinearPart(view, sub).guess(x, n);
      SurfacePoint point;
      Mat23 L;
      if (!project(view, x, n, xi, point, L)
          or !in_reference(list.types[f], xi, seam)
          or !opposes(view, point.a1, point.a2, n, 0.1))
        continue;
      const double a = (point.x - x).dot(n) - gap;
      if (std::abs(a) < std::abs(way))
        way = a;
    }
  }
  return way;
}

/// Ways along their normals of the local slave nodes to where they have a gap;
/// infinite where they are longer than a distance. Collective.
std::vector<double> ways(const Interface& data, const Configuration& c,
                         double distance, double gap)
{
  // Sums over facets, which see the same point of the master
  const Surface& s = data.slave;
  const std::size_t num = num_local_nodes(s);
  std::vector<double> sums(2 * num, 0.0);
  const auto& frame = c.candidates.master.frame;
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    for (std::int32_t k : facet_nodes(s, f))
    {
      const Vec3 x(c.x_slave.data() + 3 * k), n(c.normals.n.data() + 3 * k);
      double way = unreached;
      if (data.is_analytic())
      {
        const FrameView view(frame->x);
        const ClosestPoint p
            = closest_point(*frame->shape, view.coordinates(x));
        way = p.distance * view.axes.col(0).norm() - gap;
      }
      else
      {
        const std::int32_t begin = c.candidates.offsets[f];
        way = way_to_facets(
            x, n, gap, c.candidates.master,
            std::span(c.candidates.facets)
                .subspan(begin, c.candidates.offsets[f + 1] - begin));
      }
      if (std::abs(way) <= distance)
      {
        sums[2 * k] += way;
        sums[2 * k + 1] += 1;
      }
    }
  }
  scatter_reverse_add(s, std::span<double>(sums), 2);
  std::vector<double> out(num, unreached);
  for (std::size_t k = 0; k < num; ++k)
  {
    if (sums[2 * k + 1] > 0)
      out[k] = sums[2 * k] / sums[2 * k + 1];
  }
  return out;
}
} // namespace

//-----------------------------------------------------------------------------
Relocation dolfinx_mortar::adjust(
    MPI_Comm comm, std::span<const std::shared_ptr<const FunctionSpace>> spaces,
    const InterfaceOptions& contact,
    const std::vector<std::shared_ptr<const DirichletBC>>& bcs, double distance,
    double gap)
{
  Layout layout = create_layout(comm, spaces, tools_of({contact}));
  const std::vector<std::int8_t> prescribed
      = prescribed_dofs(layout, spaces, bcs);
  const Coupling coupling
      = create_coupling(std::move(layout), spaces, prescribed, {contact});
  const CoupledInterface& c = coupling.interfaces.front();
  const Configuration configuration
      = configure(c, interface_positions(c, nullptr));
  const std::vector<double> way = ways(c.data, configuration, distance, gap);

  Relocation out;
  out.motion.resize(coupling.layout.size(), 0.0);
  std::vector<double> shortest(coupling.layout.num_blocks(), unreached);
  for (std::int32_t k = 0; k < c.num_owned(); ++k)
  {
    const std::int8_t* fixed = c.data.fixed.data() + 3 * k;
    const std::int32_t block = coupling.own_block(c, k);
    if (!(std::abs(way[k]) < shortest[block])
        or (fixed[0] and fixed[1] and fixed[2]))
      continue;
    shortest[block] = std::abs(way[k]);
    Eigen::Map<Vec3>(out.motion.data() + 3 * block)
        = way[k] * Vec3(configuration.normals.n.data() + 3 * k);
    out.largest = std::max(out.largest, shortest[block]);
  }
  out.largest = max(comm, out.largest);
  return out;
}
