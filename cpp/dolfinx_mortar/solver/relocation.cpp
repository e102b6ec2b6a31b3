// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "relocation.h"
#include "messages.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <dolfinx_mortar/common/error.h>
#include <dolfinx_mortar/multiplier/multiplier.h>
#include <sstream>

using namespace dolfinx_mortar;

namespace
{
/// Solve a square system with a direct solver. Collective.
std::vector<double> solve(Mat A, std::span<const double> b)
{
  MPI_Comm comm;
  check(PetscObjectGetComm(reinterpret_cast<PetscObject>(A), &comm),
        "PetscObjectGetComm");
  PetscHandle<KSP, KSPDestroy> ksp;
  PC pc;
  check(KSPCreate(comm, ksp.put()), "KSPCreate");
  check(KSPSetOperators(ksp.get(), A, A), "KSPSetOperators");
  check(KSPSetType(ksp.get(), KSPPREONLY), "KSPSetType");
  check(KSPGetPC(ksp.get(), &pc), "KSPGetPC");
  check(PCSetType(pc, PCLU), "PCSetType");
  check(PCFactorSetMatSolverType(pc, MATSOLVERMUMPS),
        "PCFactorSetMatSolverType");
  const Vector right = create_vector(comm, b);
  Vector x;
  check(VecDuplicate(right.get(), x.put()), "VecDuplicate");
  check(KSPSolve(ksp.get(), right.get(), x.get()), "KSPSolve");
  return local_values(x.get());
}

PetscHandle<IS, ISDestroy> index_set(MPI_Comm comm,
                                     const std::vector<PetscInt>& indices)
{
  PetscHandle<IS, ISDestroy> set;
  check(ISCreateGeneral(comm, indices.size(), indices.data(), PETSC_COPY_VALUES,
                        set.put()),
        "ISCreateGeneral");
  return set;
}

/// Refuse motions that are too large; the largest. Collective.
double check_motion(const CoupledInterface& c, const Coupling& coupling,
                    std::span<const double> weights,
                    std::span<const double> motion, double limit)
{
  double largest = 0, worst = 0;
  std::string message;
  for (std::int32_t k = 0; k < c.num_owned(); ++k)
  {
    const double* m = motion.data() + 3 * coupling.own_block(c, k);
    const double length = std::hypot(m[0], m[1], m[2]);
    const double size = std::sqrt(std::max(weights[k], 0.0));
    largest = std::max(largest, length);
    if (length - limit * size > worst)
    {
      worst = length - limit * size;
      std::ostringstream text;
      text.precision(3);
      text << "The slave node at "
           << messages::point({c.data.slave.X[3 * k], c.data.slave.X[3 * k + 1],
                               c.data.slave.X[3 * k + 2]})
           << " would move by " << length << ", but facets there have the size "
           << size << ": the surfaces are too far apart to be relocated.";
      message = text.str();
    }
  }
  throw_on_all(coupling.comm(), message);
  return max(coupling.comm(), largest);
}
} // namespace

//-----------------------------------------------------------------------------
Relocation dolfinx_mortar::relocate(
    MPI_Comm comm, std::span<const std::shared_ptr<const FunctionSpace>> spaces,
    const InterfaceOptions& tie,
    const std::vector<std::shared_ptr<const DirichletBC>>& bcs, double limit)
{
  Layout layout = create_layout(comm, spaces, tools_of({tie}));
  const std::vector<std::int8_t> prescribed
      = prescribed_dofs(layout, spaces, bcs);
  const Coupling coupling
      = create_coupling(std::move(layout), spaces, prescribed, {tie});
  State state;
  const Step step = create_step(coupling, state);
  const CoupledInterface& c = coupling.interfaces.front();
  const Layout& own = coupling.layout;

  // Motion of the nodes that carry multipliers such that B (X + dX) = 0, in a
  // basis in which edges follow their corners: corner functions of tri6 and
  // quad8 have no positive integral. With multipliers at corners it is that of
  // the (bi)linear functions, so that corners move no further than the surface.
  const Basis& basis = state.interfaces[0].basis;
  const std::vector<std::int8_t> all(basis.nonnegative.size(), 1);
  const bool corners = std::ranges::any_of(
      c.data.slave.types,
      [&](auto type) { return is_reproducing(c.data.options.space, type); });
  const std::array<std::size_t, 1> which = {0};
  const std::array flags = {corners ? &all : &basis.nonnegative};
  const Matrix T = plus_identity(
      transformation_minus_one(coupling, which, flags, false).get());
  const Matrix B_tilde = multiply(step.B_ties.get(), T.get());
  const std::vector<double> r
      = multiply(step.B_ties.get(), own.owned(own.X, 3));
  std::vector<PetscInt> rows, columns;
  std::vector<double> b;
  for (std::int32_t k = 0; k < c.num_owned(); ++k)
  {
    for (int d = 0; d < 3 and basis.has_multiplier[k]; ++d)
    {
      rows.push_back(3 * (coupling.first_node + k) + d);
      columns.push_back(3 * (own.first_block + coupling.own_block(c, k)) + d);
      b.push_back(-r[3 * k + d]);
    }
  }
  Matrix D;
  check(MatCreateSubMatrix(B_tilde.get(), index_set(comm, rows).get(),
                           index_set(comm, columns).get(), MAT_INITIAL_MATRIX,
                           D.put()),
        "MatCreateSubMatrix");
  const std::vector<double> dx = solve(D.get(), b);
  Relocation out;
  out.motion.resize(own.size(), 0.0);
  for (std::size_t i = 0; i < dx.size(); ++i)
    out.motion[columns[i] - 3 * own.first_block] = dx[i];
  out.motion = multiply(T.get(), out.motion);
  out.largest = check_motion(c, coupling, step.weights[0], out.motion, limit);
  Positions positions = interface_positions(c, nullptr);
  out.x_slave = std::move(positions.slave);
  out.x_master = std::move(positions.master);
  return out;
}
