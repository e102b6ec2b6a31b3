// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "coupling.h"
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <dolfinx_mortar/assembly/basis.h>
#include <dolfinx_mortar/common/error.h>
#include <dolfinx_mortar/surface/patches.h>
#include <iomanip>
#include <set>
#include <sstream>
#include <stdexcept>

using namespace dolfinx_mortar;

namespace
{
std::string to_string(MultiplierSpace space)
{
  switch (space)
  {
  case MultiplierSpace::standard:
    return "standard";
  case MultiplierSpace::dual:
    return "dual";
  case MultiplierSpace::dual_linear:
    return "dual-linear";
  default:
    return "dual-reproducing";
  }
}

/// What each displacement node takes part in.
struct Uses
{
  std::vector<std::int32_t> slave; // number of interfaces
  std::vector<std::int8_t> master;
};

Uses count_uses(const Coupling& c)
{
  const std::size_t num = c.layout.num_local_blocks();
  Uses uses{std::vector<std::int32_t>(num, 0),
            std::vector<std::int8_t>(num, 0)};
  for (const CoupledInterface& i : c.interfaces)
  {
    // Several nodes of one interface may be at one displacement node
    const Surface& s = i.data.slave;
    std::set<std::int32_t> blocks(s.local_blocks.begin(),
                                  s.local_blocks.begin() + s.num_owned);
    for (std::int32_t b : blocks)
      ++uses.slave[b];
    const Surface& m = i.data.master;
    for (std::int32_t k = 0; k < m.num_owned; ++k)
      uses.master[m.local_blocks[k]] = 1;
  }
  return uses;
}

/// Interfaces that share slave nodes with others. Collective.
std::vector<std::int8_t> sharing(const Coupling& c, const Uses& uses)
{
  std::vector<std::int8_t> shares;
  for (const CoupledInterface& i : c.interfaces)
  {
    const Surface& s = i.data.slave;
    const bool here = std::any_of(s.local_blocks.begin(),
                                  s.local_blocks.begin() + s.num_owned,
                                  [&](auto b) { return uses.slave[b] > 1; });
    shares.push_back(any(c.comm(), here));
  }
  return shares;
}

/// Space of a tie, or of a contact, that no space was given for: what the
/// pressures of press fits, rollers and spheres speak for (docs/multipliers.md)
MultiplierSpace usual_space(bool is_tie, bool tri6_on_curved)
{
  if (is_tie)
    return MultiplierSpace::dual_reproducing;
  return tri6_on_curved ? MultiplierSpace::dual_linear : MultiplierSpace::dual;
}

/// True where a slave facet on any rank is tri6, and the master is curved.
/// Collective.
bool is_tri6_on_curved(const Coupling& c, const CoupledInterface& i)
{
  if (i.data.is_analytic())
    return false; // an exact surface has no kinks
  const std::vector<FacetType>& types = i.data.slave.types;
  const bool here = std::ranges::find(types, FacetType::tri6) != types.end();
  return any(c.comm(), here)
         and !has_plane_patches(i.data.master, i.feature_angle);
}

/// Give each interface the space that was asked for, or the default: one for
/// all interfaces that share slave nodes. Collective.
void choose_spaces(Coupling& c, const Uses& uses)
{
  const std::vector<std::int8_t> shares = sharing(c, uses);
  std::vector<std::int8_t> curved;
  std::optional<MultiplierSpace> common;
  bool all_ties = true, any_curved = false;
  for (std::size_t i = 0; i < shares.size(); ++i)
  {
    const CoupledInterface& own = c.interfaces[i];
    curved.push_back(!own.is_tie() and is_tri6_on_curved(c, own));
    if (!shares[i])
      continue;
    if (!common)
      common = own.space;
    all_ties = all_ties and own.is_tie();
    any_curved = any_curved or curved[i];
  }
  if (!common)
    common = usual_space(all_ties, any_curved);
  for (std::size_t i = 0; i < shares.size(); ++i)
  {
    CoupledInterface& own = c.interfaces[i];
    const MultiplierSpace usual
        = shares[i] ? *common : usual_space(own.is_tie(), curved[i]);
    own.data.options.space = own.space.value_or(usual);
    own.data.candidates
        = multiplier_nodes(own.data.slave, own.data.options.space);
  }
}

/// Interfaces that share slave nodes have one transformation there.
void check_spaces(const Coupling& c, const Uses& uses)
{
  int spaces = 0;
  for (const CoupledInterface& i : c.interfaces)
  {
    for (std::int32_t k = 0; k < i.num_owned(); ++k)
    {
      if (uses.slave[i.data.slave.local_blocks[k]] > 1)
        spaces |= 1 << static_cast<int>(i.data.options.space);
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, &spaces, 1, MPI_INT, MPI_BOR, c.comm());
  std::string names;
  int count = 0;
  for (auto s : {MultiplierSpace::dual, MultiplierSpace::dual_linear,
                 MultiplierSpace::dual_reproducing, MultiplierSpace::standard})
  {
    if (spaces & (1 << static_cast<int>(s)))
      names += (count++ ? " and " : "") + to_string(s);
  }
  if (count > 1)
  {
    throw std::invalid_argument(
        "Interfaces that share slave nodes must have the same multiplier "
        "space, not "
        + names + ".");
  }
}

/// Set numbers, candidates and fixed components of an interface.
void assign(const Coupling& c, CoupledInterface& i, const Uses& uses,
            std::span<const std::int8_t> prescribed)
{
  const Surface& s = i.data.slave;
  const std::size_t num = num_local_nodes(s);
  i.data.fixed.resize(3 * num);
  i.data.multipliers.assign(num, 0);
  std::vector<std::int8_t> candidates(num, 0);
  for (std::int32_t k = 0; k < s.num_owned; ++k)
  {
    std::copy_n(prescribed.begin() + 3 * s.local_blocks[k], 3,
                i.data.fixed.begin() + 3 * k);
  }
  scatter_forward(s, std::span(i.data.fixed), 3);
  for (std::int32_t k = 0; k < s.num_owned; ++k)
  {
    const std::int32_t b = s.local_blocks[k];
    const std::int8_t* fixed = i.data.fixed.data() + 3 * k;
    candidates[k] = i.data.candidates[k] and uses.slave[b] == 1
                    and !uses.master[b]
                    and !(fixed[0] and fixed[1] and fixed[2]);
    i.data.multipliers[k] = c.first_node + i.first_node + k;
  }
  scatter_forward(s, std::span(candidates), 1);
  scatter_forward(s, std::span(i.data.multipliers), 1);
  i.data.candidates = std::move(candidates);
}

/// Refuse a slave surface on which contact could not act anywhere. Collective.
void check_candidates(const Coupling& c, const CoupledInterface& i)
{
  std::int64_t num = 0;
  for (std::int32_t k = 0; k < i.num_owned(); ++k)
    num += i.data.candidates[k] != 0;
  if (sum(c.comm(), num) == 0)
  {
    throw std::runtime_error(
        "No node of the slave surface (" + i.slave_name
        + ") can carry a contact traction: the displacements of all of them "
          "are prescribed, or they belong to other interfaces as well. Let the "
          "other surface be the slave, or tag facets of its own for each "
          "interface.");
  }
}

std::string to_string(const Eigen::Vector3d& v)
{
  std::ostringstream s;
  s << std::setprecision(3) << "[" << v[0] << " " << v[1] << " " << v[2] << "]";
  return s.str();
}

/// Refuse a given normal that does not lead from the slave to the master, by
/// the slave's own normals where it faces the master. Collective.
void check_normal(const Coupling& c, const CoupledInterface& i)
{
  if (!i.data.normal)
    return;
  Interface own = i.data;
  own.normal.reset();
  const Configuration conf
      = configure(own, own.slave.X, own.master.X, {},
                  own.tool ? own.tool->X : std::array<double, 12>{});
  const Basis basis = create_basis(own);
  const NodalIntegrals nodal = integrate(own, basis, conf);
  const std::vector<double> weights
      = nodal_weights(own, basis.nonnegative, own.slave.X);
  std::vector<double> sums(6, 0.0);
  for (std::int32_t k = 0; k < i.num_owned(); ++k)
  {
    for (int d = 0; d < 3; ++d)
    {
      sums[d] += nodal.coverage[k] * conf.normals.n[3 * k + d];
      sums[3 + d] += weights[k] * conf.normals.n[3 * k + d];
    }
  }
  sums = sum(c.comm(), std::move(sums));
  // Surfaces that are far from each other do not face anything yet
  Eigen::Vector3d mean(sums.data());
  if (mean.isZero(0))
    mean = Eigen::Vector3d(sums.data() + 3);
  mean /= std::max(mean.norm(), 1e-300);
  const Eigen::Vector3d given(i.data.normal->data());
  if (mean.dot(given) < 0.1)
  {
    throw std::invalid_argument("normal is " + to_string(given)
                                + ", but the slave's own normal is about "
                                + to_string(mean)
                                + " where it faces the master: give the "
                                  "direction from the slave to the master.");
  }
}

/// Positions of the nodes of a tool's surface.
std::vector<double> carried_positions(const Tool& tool,
                                      const std::vector<double>& X,
                                      const std::array<double, 12>& x_frame)
{
  const FrameView reference(tool.X), current(x_frame);
  std::vector<double> x(X.size());
  for (std::size_t k = 0; k < X.size(); k += 3)
  {
    Eigen::Map<Vec3>(x.data() + k)
        = current.origin
          + current.axes * reference.coordinates(Vec3(X.data() + k));
  }
  return x;
}

/// Displacement blocks of the owned nodes, where some are the same on any rank.
std::vector<std::int64_t> repeated_blocks(const Surface& s)
{
  std::vector<std::int64_t> blocks(s.blocks.begin(),
                                   s.blocks.begin() + s.num_owned);
  const std::set<std::int64_t> different(blocks.begin(), blocks.end());
  if (different.size() == blocks.size())
    blocks.clear();
  return blocks;
}
} // namespace

//-----------------------------------------------------------------------------
bool Coupling::has_contact() const
{
  return std::ranges::any_of(interfaces, [](auto& i) { return !i.is_tie(); });
}
//-----------------------------------------------------------------------------
bool Coupling::has_ties() const
{
  return std::ranges::any_of(interfaces, [](auto& i) { return i.is_tie(); });
}
//-----------------------------------------------------------------------------
Coupling
dolfinx_mortar::create_coupling(Layout layout,
                                std::vector<CoupledInterface> interfaces,
                                std::span<const std::int8_t> prescribed)
{
  Coupling c;
  c.layout = std::move(layout);
  c.interfaces = std::move(interfaces);
  for (CoupledInterface& i : c.interfaces)
  {
    i.first_node = c.num_nodes;
    c.num_nodes += i.num_owned();
    i.blocks = repeated_blocks(i.data.slave);
  }
  c.first_node = first_of_rank(c.comm(), c.num_nodes);
  const std::vector<std::int8_t> flags = c.layout.owned(
      std::vector<std::int8_t>(prescribed.begin(), prescribed.end()), 3);
  for (std::size_t dof = 0; dof < flags.size(); ++dof)
  {
    if (flags[dof])
      c.fixed_dofs.push_back(dof);
  }

  const Uses uses = count_uses(c);
  for (const CoupledInterface& i : c.interfaces)
  {
    for (std::int32_t k = 0; k < i.num_owned(); ++k)
      c.chained |= uses.master[i.data.slave.local_blocks[k]] != 0;
  }
  c.chained = any(c.comm(), c.chained);
  c.shared = any(c.comm(),
                 std::ranges::any_of(uses.slave, [](auto n) { return n > 1; }));
  choose_spaces(c, uses);
  check_spaces(c, uses);
  for (CoupledInterface& i : c.interfaces)
    assign(c, i, uses, prescribed);
  for (const CoupledInterface& i : c.interfaces)
  {
    if (!i.is_tie())
    {
      check_candidates(c, i);
      check_normal(c, i);
    }
  }
  return c;
}
//-----------------------------------------------------------------------------
std::vector<double> dolfinx_mortar::local_multipliers(const Coupling& coupling,
                                                      std::size_t i,
                                                      std::span<const double> z)
{
  const Surface& s = coupling.interfaces[i].data.slave;
  std::vector<double> local(3 * num_local_nodes(s), 0.0);
  std::ranges::copy(coupling.part(z, i, 3), local.begin());
  scatter_forward(s, std::span(local), 3);
  return local;
}
//-----------------------------------------------------------------------------
Positions dolfinx_mortar::interface_positions(const CoupledInterface& interface,
                                              const std::vector<double>* u)
{
  const Interface& i = interface.data;
  Positions p;
  if (i.tool)
  {
    p.frame = i.tool->X;
    for (int l = 0; u and l < 4; ++l)
    {
      for (int c = 0; c < 3; ++c)
        p.frame[3 * l + c] += (*u)[3 * i.tool->local_blocks[l] + c];
    }
  }
  if (u)
  {
    p.slave = current_positions(i.slave, *u);
    p.master = i.tool ? carried_positions(*i.tool, i.master.X, p.frame)
                      : current_positions(i.master, *u);
  }
  else if (!interface.x_slave.empty())
  {
    p.slave = interface.x_slave;
    p.master = interface.x_master;
  }
  else
  {
    p.slave = i.slave.X;
    p.master = i.master.X;
  }
  return p;
}
//-----------------------------------------------------------------------------
Configuration dolfinx_mortar::configure(const CoupledInterface& interface,
                                        Positions positions,
                                        std::vector<double> offset)
{
  return configure(interface.data, std::move(positions.slave),
                   std::move(positions.master), std::move(offset),
                   positions.frame);
}
//-----------------------------------------------------------------------------
std::vector<std::int8_t> dolfinx_mortar::tied_dofs(const CoupledInterface& tie,
                                                   const Basis& basis)
{
  std::vector<std::int8_t> flags(3 * tie.num_owned());
  for (std::size_t dof = 0; dof < flags.size(); ++dof)
    flags[dof] = basis.has_multiplier[dof / 3] and !tie.data.fixed[dof];
  return flags;
}
//-----------------------------------------------------------------------------
Matrix dolfinx_mortar::transformation_minus_one(
    const Coupling& coupling, std::span<const std::size_t> which,
    std::span<const std::vector<std::int8_t>* const> nonnegative, bool inverse)
{
  const std::int32_t size = coupling.layout.size();
  Matrix T = create_matrix(coupling.comm(), size, size);
  std::vector<std::int8_t> slaves(coupling.layout.num_blocks(), 0);
  for (std::size_t i : which)
  {
    const CoupledInterface& c = coupling.interfaces[i];
    for (std::int32_t k = 0; k < c.num_owned(); ++k)
      slaves[coupling.own_block(c, k)] = 1;
    insert_transformation(c.data, *nonnegative[i], inverse, T.get());
  }
  check(MatAssemblyBegin(T.get(), MAT_FINAL_ASSEMBLY), "MatAssemblyBegin");
  check(MatAssemblyEnd(T.get(), MAT_FINAL_ASSEMBLY), "MatAssemblyEnd");
  // Products with T - I are to cost no more than its few entries
  std::vector<PetscInt> offsets = {0}, columns;
  std::vector<double> values;
  const PetscInt first = 3 * coupling.layout.first_block;
  for (PetscInt row = first; row < first + size; ++row)
  {
    if (slaves[(row - first) / 3])
    {
      const MatrixRow t(T.get(), row);
      for (std::size_t j = 0; j < t.columns().size(); ++j)
      {
        const double value = t.values()[j] - (t.columns()[j] == row);
        if (value != 0)
        {
          columns.push_back(t.columns()[j]);
          values.push_back(value);
        }
      }
    }
    offsets.push_back(columns.size());
  }
  return create_from_rows(coupling.comm(), size, size, offsets, columns,
                          values);
}
//-----------------------------------------------------------------------------
Matrix dolfinx_mortar::plus_identity(Mat A)
{
  MPI_Comm comm;
  check(PetscObjectGetComm(reinterpret_cast<PetscObject>(A), &comm),
        "PetscObjectGetComm");
  const PetscInt n = local_size(A).first;
  std::vector<Entry> entries;
  for (PetscInt i = 0; i < n; ++i)
    entries.push_back({i, i, 1.0});
  Matrix sum = create_from_entries(comm, n, n, entries);
  add(sum.get(), 1.0, A);
  return sum;
}
