// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "interface_matrices.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <dolfinx_mortar/common/error.h>
#include <dolfinx_mortar/multiplier/multiplier.h>
#include <stdexcept>

using namespace dolfinx_mortar;

namespace
{
/// The tie as u_slave = C u, in the rows of the slave dofs that it determines.
/// Collective.
/// @param[out] determined Flags of the owned displacement dofs: those.
Matrix constraint_matrix(const ContactProblem& problem, std::size_t interface,
                         std::vector<std::int8_t>& determined)
{
  const Coupling& coupling = problem.coupling();
  // Rows T (I_R - E D̃⁻¹ B̃_R) T⁻¹ of the slave dofs
  const CoupledInterface& c = coupling.interfaces.at(interface);
  const std::int32_t n = coupling.layout.size();
  const auto tied = tied_dofs(c, problem.state().interfaces[interface].basis);
  std::vector<double> kept(n, 1.0), rows(coupling.size(), 0.0);
  determined.assign(n, 0);
  for (std::size_t dof = 0; dof < tied.size(); ++dof)
  {
    rows[3 * c.first_node + dof] = 1;
    if (!tied[dof])
      continue;
    const std::int32_t own = 3 * coupling.own_block(c, dof / 3) + dof % 3;
    kept[own] = 0;
    determined[own] = 1;
  }
  const Matrix B = duplicate(problem.step().B_tilde_ties.get());
  scale_rows(B.get(), rows);
  scale_columns(B.get(), kept);
  const Matrix DB = multiply(inverse(problem, interface).get(), B.get());
  std::vector<Entry> entries;
  for (std::int32_t dof = 0; dof < n; ++dof)
  {
    if (kept[dof] != 0)
      entries.push_back({dof, dof, 1.0});
  }
  const Matrix I_R = create_from_entries(coupling.comm(), n, n, entries);
  const Matrix R
      = multiply(transformation(problem, interface, false).get(), I_R.get());
  add(R.get(), -1.0, DB.get());
  return multiply(R.get(), transformation(problem, interface, true).get());
}
} // namespace

//-----------------------------------------------------------------------------
Matrix dolfinx_mortar::mortar_matrix(const ContactProblem& problem,
                                     std::size_t interface, char which)
{
  const Coupling& coupling = problem.coupling();
  const CoupledInterface& c = coupling.interfaces.at(interface);
  const std::vector<double> u = problem.bodies().local_displacements();
  const Configuration configuration
      = configure(c, interface_positions(c, c.is_current() ? &u : nullptr));
  BlockAccumulator<1, 1> blocks;
  MortarBlocks wanted;
  (which == 'D' ? wanted.D : wanted.M) = &blocks;
  integrate(c.data, problem.state().interfaces[interface].basis, configuration,
            wanted);
  return blocks.assemble(coupling.comm(), coupling.size(),
                         coupling.layout.size());
}
//-----------------------------------------------------------------------------
Matrix dolfinx_mortar::transformation(const ContactProblem& problem,
                                      std::size_t interface, bool inverse)
{
  const Coupling& coupling = problem.coupling();
  std::vector<const std::vector<std::int8_t>*> flags;
  for (const InterfaceState& i : problem.state().interfaces)
    flags.push_back(&i.basis.nonnegative);
  const std::array<std::size_t, 1> which = {interface};
  return plus_identity(
      transformation_minus_one(coupling, which, flags, inverse).get());
}
//-----------------------------------------------------------------------------
Matrix dolfinx_mortar::inverse(const ContactProblem& problem,
                               std::size_t interface)
{
  const Coupling& coupling = problem.coupling();
  const Evaluation* evaluation = problem.evaluation();
  const CoupledInterface& c = coupling.interfaces.at(interface);
  const MultiplierSpace space = c.data.options.space;
  const bool all_nodes = std::ranges::all_of(
      c.data.slave.types, [&](auto type)
      { return num_multipliers(space, type) == num_nodes(type); });
  if (any(coupling.comm(), !is_dual(space) or !all_nodes))
  {
    throw std::runtime_error(
        "D has a sparse inverse where dual multipliers are at all nodes. With "
        "others D⁻¹, P and constraints are not available: make the interface "
        "with multiplier='dual'.");
  }
  const auto& geometry = evaluation ? evaluation->interfaces[interface].geometry
                                    : problem.step().geometry[interface];
  std::vector<Entry> entries;
  std::vector<std::int8_t> used(coupling.layout.num_blocks(), 0);
  bool several = false;
  for (std::int32_t k = 0; k < c.num_owned(); ++k)
  {
    if (!problem.state().interfaces[interface].basis.has_multiplier[k])
      continue;
    const std::int32_t own = coupling.own_block(c, k);
    several = several or used[own]++;
    for (int d = 0; d < 3; ++d)
    {
      entries.push_back({3 * own + d, 3 * (c.first_node + k) + d,
                         1 / geometry->nodal.diagonal[k]});
    }
  }
  if (any(coupling.comm(), several))
  {
    throw std::runtime_error(
        "D has no inverse where slave nodes on an edge carry one multiplier "
        "for each of the patches that meet there: D⁻¹ and P are not available. "
        "Tag one smooth side of the edge, or average normals over edges with "
        "feature_angle=180.");
  }
  const Matrix E = create_from_entries(coupling.comm(), coupling.layout.size(),
                                       coupling.size(), entries);
  return multiply(transformation(problem, interface, false).get(), E.get());
}
//-----------------------------------------------------------------------------
Constraints dolfinx_mortar::constraints(const ContactProblem& problem,
                                        std::size_t interface)
{
  MPI_Comm comm = problem.coupling().comm();
  std::vector<std::int8_t> determined;
  const Matrix C = constraint_matrix(problem, interface, determined);
  int size;
  MPI_Comm_size(comm, &size);
  const PetscInt* ranges;
  check(MatGetOwnershipRangesColumn(C.get(), &ranges),
        "MatGetOwnershipRangesColumn");
  PetscInt begin;
  check(MatGetOwnershipRange(C.get(), &begin, nullptr), "MatGetOwnershipRange");
  Constraints out;
  for (std::size_t dof = 0; dof < determined.size(); ++dof)
  {
    if (!determined[dof])
      continue;
    const MatrixRow row(C.get(), begin + dof);
    double largest = 0;
    for (double v : row.values())
      largest = std::max(largest, std::abs(v));
    for (std::size_t i = 0; i < row.columns().size(); ++i)
    {
      if (!(std::abs(row.values()[i]) > 1e-14 * largest))
        continue;
      out.masters.push_back(row.columns()[i]);
      out.coefficients.push_back(row.values()[i]);
      out.owners.push_back(
          std::upper_bound(ranges, ranges + size, row.columns()[i]) - ranges
          - 1);
    }
    out.slaves.push_back(dof);
    out.offsets.push_back(out.masters.size());
  }
  return out;
}
