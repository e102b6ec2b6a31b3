// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "interface.h"
#include <algorithm>
#include <dolfinx_mortar/common/error.h>
#include <dolfinx_mortar/multiplier/integrals.h>
#include <string>

namespace dolfinx_mortar
{
/// @brief Values of the nodes of a facet, from values of all local nodes.
/// @param[in] bs Number of values of a node.
template <typename T>
void gather(std::span<const std::int32_t> nodes, std::span<const T> values,
            int bs, std::vector<T>& out)
{
  out.resize(nodes.size() * bs);
  for (std::size_t i = 0; i < nodes.size(); ++i)
    std::copy_n(values.begin() + bs * nodes[i], bs, out.begin() + bs * i);
}

/// @brief Integrate over one slave facet after the other. Collective.
/// @param[in] interface,basis,configuration See integrate.
/// @param[in] z Multipliers of the local slave nodes, shape (n, 3); used for
/// derivatives only.
/// @param[in] wanted Flags of local slave nodes: facets without such a node and
/// with z = 0 are left out. Empty for all facets.
/// @param[in] derivatives Derivatives to compute.
/// @param[in] use Called with the number of the facet, its nodes and its
/// integrals.
/// @throw std::runtime_error On all ranks, see FacetIntegrator::compute.
template <typename Use>
void for_each_facet(const Interface& interface, const Basis& basis,
                    const Configuration& configuration,
                    std::span<const double> z,
                    std::span<const std::int8_t> wanted,
                    Derivatives derivatives, Use&& use)
{
  const Surface& s = interface.slave;
  const Candidates& candidates = configuration.candidates;
  FacetIntegrator integrator(interface.options);
  std::vector<double> x, n, zf, offset;
  std::vector<std::int8_t> has_multiplier, nonnegative;
  auto zero = [](auto v) { return v == 0; };
  std::string message;
  try
  {
    for (std::int32_t f = 0; f < static_cast<std::int32_t>(s.types.size()); ++f)
    {
      const std::int32_t begin = candidates.offsets[f];
      const std::int32_t end = candidates.offsets[f + 1];
      if (begin == end)
        continue;
      auto nodes = facet_nodes(s, f);
      gather(nodes, z, 3, zf);
      if (!wanted.empty() and std::ranges::all_of(zf, zero)
          and std::ranges::none_of(nodes, [&](auto k) { return wanted[k]; }))
      {
        continue;
      }
      gather(nodes, std::span<const double>(configuration.x_slave), 3, x);
      gather(nodes, std::span<const double>(configuration.normals.n), 3, n);
      if (!configuration.offset.empty())
        gather(nodes, std::span<const double>(configuration.offset), 1, offset);
      gather(nodes, std::span<const std::int8_t>(basis.has_multiplier), 1,
             has_multiplier);
      for (std::size_t i = 0; i < nodes.size(); ++i)
      {
        if (has_multiplier[i] == 0 and basis.idle[nodes[i]] != 0)
          has_multiplier[i] = -1;
      }
      gather(nodes, std::span<const std::int8_t>(basis.nonnegative), 1,
             nonnegative);
      const FacetIntegrals& r = integrator.compute(
          {s.types[f], s.orientation[f], x}, n, has_multiplier, nonnegative, zf,
          candidates.master,
          std::span(candidates.facets).subspan(begin, end - begin), derivatives,
          offset);
      use(f, nodes, r);
    }
  }
  catch (const std::exception& e)
  {
    message = e.what();
  }
  throw_on_all(s.comm, message);
}
} // namespace dolfinx_mortar
