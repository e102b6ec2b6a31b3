// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "bodies.h"
#include "adapter.h"
#include "compat.h"
#include "timer.h"
#include <Eigen/Dense>
#include <algorithm>
#include <basix/cell.h>
#include <basix/finite-element.h>
#include <dolfinx/fem/assembler.h>
#include <dolfinx/fem/utils.h>
#include <limits>
#include <stdexcept>
#include <string_view>

using namespace dolfinx_mortar;

namespace
{
using Space = FunctionSpace;
using Mesh = dolfinx::mesh::Mesh<double>;

/// Values of a function's local blocks.
std::span<double> values_of(const Body& body)
{
  return compat::values(*body.u->x());
}

/// Midpoints of the cell and of its facets, shape (n, 3).
std::vector<double> midpoints(basix::cell::type cell)
{
  const std::vector<double> x = basix::cell::geometry<double>(cell).first;
  const auto topology = basix::cell::topology(cell);
  std::vector<double> points;
  for (int dim : {3, 2})
  {
    for (const std::vector<int>& vertices : topology[dim])
    {
      for (int c = 0; c < 3; ++c)
      {
        double mean = 0;
        for (int v : vertices)
          mean += x[3 * v + c] / vertices.size();
        points.push_back(mean);
      }
    }
  }
  return points;
}

/// Derivatives of functions at points, each of shape (3, number of functions).
std::vector<Eigen::MatrixXd> gradients(std::span<const double> table,
                                       std::size_t num_points,
                                       std::size_t num_functions)
{
  std::vector<Eigen::MatrixXd> out(num_points,
                                   Eigen::MatrixXd(3, num_functions));
  for (std::size_t p = 0; p < num_points; ++p)
  {
    for (int d = 0; d < 3; ++d)
    {
      for (std::size_t k = 0; k < num_functions; ++k)
      {
        out[p](d, k) = table[((d + 1) * num_points + p) * num_functions + k];
      }
    }
  }
  return out;
}

/// Gradients of geometry and displacement at the points of find_inverted.
std::pair<std::vector<Eigen::MatrixXd>, std::vector<Eigen::MatrixXd>>
tabulate_cell(const Space& V)
{
  const basix::FiniteElement<double>& e = V.element()->basix_element();
  const std::vector<double> points = midpoints(e.cell_type());
  const std::size_t num = points.size() / 3;
  const auto& cmap = compat::coordinate_element(*V.mesh());
  const std::array<std::size_t, 4> shape = cmap.tabulate_shape(1, num);
  std::vector<double> phi(shape[0] * shape[1] * shape[2] * shape[3]);
  cmap.tabulate(1, points, {num, 3}, phi);
  const std::vector<double> psi = e.tabulate(1, points, {num, 3}).first;
  return {gradients(phi, num, shape[2]), gradients(psi, num, e.dim())};
}

/// @brief Matrix for the tangents of all bodies, one after the other, with room
/// for diagonal blocks of the frames of tools. Collective.
Matrix create_tangent(const Layout& layout, std::span<const Body> bodies)
{
  std::vector<PetscInt> diagonal, other; // entries by owned block
  for (std::size_t b = 0; b < layout.num_bodies(); ++b)
  {
    if (b >= bodies.size())
    {
      diagonal.resize(diagonal.size() + layout.num_owned[b], 1);
      other.resize(diagonal.size(), 0);
      continue;
    }
    auto pattern = dolfinx::fem::create_sparsity_pattern(*bodies[b].J);
    pattern.finalize();
    for (std::int32_t i = 0; i < layout.num_owned[b]; ++i)
    {
      diagonal.push_back(pattern.nnz_diag(i));
      other.push_back(pattern.nnz_off_diag(i));
    }
  }
  Matrix K;
  check(MatCreate(layout.comm, K.put()), "MatCreate");
  check(MatSetSizes(K.get(), layout.size(), layout.size(), PETSC_DETERMINE,
                    PETSC_DETERMINE),
        "MatSetSizes");
  check(MatSetType(K.get(), MATAIJ), "MatSetType");
  check(MatXAIJSetPreallocation(K.get(), 3, diagonal.data(), other.data(),
                                nullptr, nullptr),
        "MatXAIJSetPreallocation");
  std::vector<PetscInt> numbers;
  for (const std::vector<std::int64_t>& blocks : layout.blocks)
    numbers.insert(numbers.end(), blocks.begin(), blocks.end());
  PetscHandle<ISLocalToGlobalMapping, ISLocalToGlobalMappingDestroy> map;
  check(ISLocalToGlobalMappingCreate(layout.comm, 3, numbers.size(),
                                     numbers.data(), PETSC_COPY_VALUES,
                                     map.put()),
        "ISLocalToGlobalMappingCreate");
  check(MatSetLocalToGlobalMapping(K.get(), map.get(), map.get()),
        "MatSetLocalToGlobalMapping");
  for (auto option : {MAT_KEEP_NONZERO_PATTERN, MAT_NEW_NONZERO_ALLOCATION_ERR})
    check(MatSetOption(K.get(), option, PETSC_TRUE), "MatSetOption");
  return K;
}
} // namespace

//-----------------------------------------------------------------------------
std::size_t
dolfinx_mortar::space_of(std::span<const std::shared_ptr<const Space>> spaces,
                         const DirichletBC& bc)
{
  const auto V = bc.function_space();
  for (std::size_t b = 0; b < spaces.size(); ++b)
  {
    if (spaces[b] == V or spaces[b]->contains(*V))
      return b;
  }
  throw std::invalid_argument("A Dirichlet condition is on a space of none of "
                              "the problem's unknowns.");
}
//-----------------------------------------------------------------------------
std::vector<std::int8_t> dolfinx_mortar::prescribed_dofs(
    const Layout& layout, std::span<const std::shared_ptr<const Space>> spaces,
    std::span<const std::shared_ptr<const DirichletBC>> bcs,
    std::span<const std::shared_ptr<const RigidTool>> tools)
{
  std::vector<std::int8_t> flags(3 * layout.num_local_blocks(), 0);
  for (const auto& bc : bcs)
  {
    const std::int32_t start = 3 * layout.local_start(space_of(spaces, *bc));
    for (std::int32_t dof : bc->dof_indices().first)
      flags[start + dof] = 1;
  }
  std::fill(flags.begin() + 3 * layout.local_start(spaces.size()), flags.end(),
            1);
  for (std::size_t t = 0; t < tools.size(); ++t)
  {
    std::int8_t* own = flags.data() + 3 * layout.local_start(spaces.size() + t);
    for (int c = 0; c < 6; ++c)
      own[c] = !tools[t]->free[c];
  }
  return flags;
}
//-----------------------------------------------------------------------------
Surface dolfinx_mortar::create_surface(
    const Layout& layout, std::span<const std::shared_ptr<const Space>> spaces,
    std::span<const TaggedFacets> parts, const std::string& side)
{
  std::vector<SurfacePart> found;
  for (const TaggedFacets& part : parts)
  {
    const auto V = std::ranges::find(spaces, part.V);
    if (V == spaces.end())
    {
      throw std::invalid_argument(
          "An interface is on a function space that is not the space of one of "
          "the problem's unknowns: give it the space of u.");
    }
    const std::size_t b = V - spaces.begin();
    found.push_back(tagged_part(*part.V, *part.tags, part.tag, side,
                                layout.blocks[b], layout.local_start(b)));
  }
  return create_surface(found);
}
//-----------------------------------------------------------------------------
Bodies::Bodies(MPI_Comm comm, std::vector<Body> bodies,
               std::vector<std::shared_ptr<const DirichletBC>> bcs,
               std::vector<std::shared_ptr<const RigidTool>> tools)
    : _bodies(std::move(bodies)), _tools(std::move(tools))
{
  _layout = create_layout(comm, spaces(), _tools);
  for (std::size_t t = 0; t < _tools.size(); ++t)
  {
    _tool_displacements.push_back(_tools[t]->displacements(frame(t)));
    std::array<double, 6> q;
    Eigen::Map<Vec3>(q.data()) = _tools[t]->translation;
    Eigen::Map<Vec3>(q.data() + 3) = axis(t) * _tools[t]->rotation;
    _tool_motions.push_back(q);
  }
  set_conditions(std::move(bcs));
  for (const Body& body : _bodies)
  {
    const bool constant
        = std::ranges::none_of(body.J->coefficients(), [this](const auto& f)
                               { return is_displacement(*f); });
    _assembled.push_back({.constant = constant, .present = false, .u = {}});
  }
  _tangent = create_tangent(_layout, _bodies);
  _checksums = checksums();
}
//-----------------------------------------------------------------------------
std::vector<std::shared_ptr<const FunctionSpace>> Bodies::spaces() const
{
  std::vector<std::shared_ptr<const Space>> spaces;
  for (const Body& body : _bodies)
    spaces.push_back(body.u->function_space());
  return spaces;
}
//-----------------------------------------------------------------------------
void Bodies::set_conditions(std::vector<std::shared_ptr<const DirichletBC>> bcs)
{
  for (const auto& bc : bcs)
    space_of(spaces(), *bc);
  _bcs = std::move(bcs);
}
//-----------------------------------------------------------------------------
std::vector<double> Bodies::displacements() const
{
  return _layout.owned(local_displacements(), 3);
}
//-----------------------------------------------------------------------------
std::vector<double> Bodies::local_displacements() const
{
  std::vector<double> u;
  for (std::size_t b = 0; b < _bodies.size(); ++b)
  {
    const std::span<double> x = values_of(_bodies[b]);
    u.insert(u.end(), x.begin(), x.begin() + 3 * _layout.num_local[b]);
  }
  for (const std::array<double, 12>& d : _tool_displacements)
    u.insert(u.end(), d.begin(), d.end());
  return u;
}
//-----------------------------------------------------------------------------
std::vector<double> Bodies::extend(std::span<const double> owned) const
{
  std::vector<double> local;
  for (std::size_t b = 0; b < _bodies.size(); ++b)
  {
    const auto& dofmap = *_bodies[b].u->function_space()->dofmap();
    dolfinx::la::Vector<double> v(dofmap.index_map, 3);
    const std::span<double> x = compat::values(v);
    std::ranges::copy(
        owned.subspan(3 * _layout.owned_start(b), 3 * _layout.num_owned[b]),
        x.begin());
    v.scatter_fwd();
    local.insert(local.end(), x.begin(), x.end());
  }
  for (const auto& d : tool_values(owned))
    local.insert(local.end(), d.begin(), d.end());
  return local;
}
//-----------------------------------------------------------------------------
void Bodies::set_displacements(std::span<const double> owned)
{
  for (std::size_t b = 0; b < _bodies.size(); ++b)
  {
    std::ranges::copy(
        owned.subspan(3 * _layout.owned_start(b), 3 * _layout.num_owned[b]),
        values_of(_bodies[b]).begin());
    _bodies[b].u->x()->scatter_fwd();
  }
  _tool_displacements = tool_values(owned);
  for (std::size_t t = 0; t < _tools.size(); ++t)
    _tool_motions[t] = motion_of(t);
}
//-----------------------------------------------------------------------------
std::vector<double> Bodies::residual() const
{
  std::vector<double> f;
  for (std::size_t b = 0; b < _bodies.size(); ++b)
  {
    const auto& dofmap = *_bodies[b].u->function_space()->dofmap();
    dolfinx::la::Vector<double> v(dofmap.index_map, 3);
    std::span<double> x = compat::values(v);
    std::ranges::fill(x, 0.0);
    dolfinx::fem::assemble_vector(x, *_bodies[b].F);
    v.scatter_rev(std::plus<double>());
    f.insert(f.end(), x.begin(), x.begin() + 3 * _layout.num_owned[b]);
  }
  f.resize(_layout.size(), 0.0);
  subtract_loads(f);
  return f;
}
//-----------------------------------------------------------------------------
bool Bodies::is_displacement(const dolfinx::fem::Function<double>& f) const
{
  return std::ranges::any_of(_bodies, [&f](const Body& body)
                             { return body.u->x() == f.x(); });
}
//-----------------------------------------------------------------------------
void Bodies::forget_tangents() const
{
  for (Assembled& a : _assembled)
    a.present = false;
}
//-----------------------------------------------------------------------------
void Bodies::assemble(std::size_t body, const std::vector<double>& u) const
{
  Timer timer("~mortar: assemble");
  const Mat K = _tangent.get();
  const PetscInt start = _layout.local_start(body);
  std::vector<PetscInt> rows, columns;
  auto add
      = [&](std::span<const std::int32_t> r, std::span<const std::int32_t> c,
            std::span<const double> values)
  {
    auto shift = [start](std::int32_t i) { return start + i; };
    rows.resize(r.size());
    columns.resize(c.size());
    std::ranges::transform(r, rows.begin(), shift);
    std::ranges::transform(c, columns.begin(), shift);
    const PetscErrorCode error
        = MatSetValuesBlockedLocal(K, rows.size(), rows.data(), columns.size(),
                                   columns.data(), values.data(), ADD_VALUES);
    check(error, "MatSetValuesBlockedLocal");
    return 0;
  };
  dolfinx::fem::assemble_matrix(add, *_bodies[body].J, {});
  if (!_assembled[body].constant)
    _assembled[body].u = u;
}
//-----------------------------------------------------------------------------
Matrix Bodies::tangent() const
{
  const std::vector<double> u = local_displacements();
  std::vector<std::size_t> changed;
  for (std::size_t b = 0; b < _bodies.size(); ++b)
  {
    const Assembled& a = _assembled[b];
    if (any(_layout.comm, !a.present or (!a.constant and a.u != u)))
      changed.push_back(b);
  }
  if (changed.empty())
    return _tangent;
  const Mat K = _tangent.get();
  for (std::size_t b : changed)
    _assembled[b].present = false;
  if (changed.size() == _bodies.size())
    check(MatZeroEntries(K), "MatZeroEntries");
  else
  {
    std::vector<PetscInt> rows;
    for (std::size_t b : changed)
    {
      const PetscInt first = 3 * (_layout.first_block + _layout.owned_start(b));
      for (PetscInt i = 0; i < 3 * _layout.num_owned[b]; ++i)
        rows.push_back(first + i);
    }
    check(MatZeroRows(K, rows.size(), rows.data(), 0.0, nullptr, nullptr),
          "MatZeroRows");
  }
  for (std::size_t b : changed)
    assemble(b, u);
  // Sums have entries at the frames of tools: without these there would be no
  // room for them
  const std::array<double, 9> zeros{};
  for (std::size_t b = _bodies.size(); b < _layout.num_bodies(); ++b)
  {
    for (PetscInt i = 0; i < _layout.num_owned[b]; ++i)
    {
      const PetscInt row = _layout.first_block + _layout.owned_start(b) + i;
      check(MatSetValuesBlocked(K, 1, &row, 1, &row, zeros.data(), ADD_VALUES),
            "MatSetValuesBlocked");
    }
  }
  check(MatAssemblyBegin(K, MAT_FINAL_ASSEMBLY), "MatAssemblyBegin");
  check(MatAssemblyEnd(K, MAT_FINAL_ASSEMBLY), "MatAssemblyEnd");
  for (std::size_t b : changed)
    _assembled[b].present = true;
  return _tangent;
}
//-----------------------------------------------------------------------------
std::vector<std::int8_t> Bodies::prescribed() const
{
  return prescribed_dofs(_layout, spaces(), _bcs, _tools);
}
//-----------------------------------------------------------------------------
std::vector<double> Bodies::prescribed_values() const
{
  std::vector<double> local(3 * _layout.num_local_blocks(), 0.0);
  for (const auto& bc : _bcs)
  {
    const std::size_t b = space_of(spaces(), *bc);
    const std::span<double> own = std::span(local).subspan(
        3 * _layout.local_start(b), 3 * _layout.num_local[b]);
    bc->set(own, std::nullopt, 1.0);
  }
  for (std::size_t t = 0; t < _tools.size(); ++t)
  {
    double* own = local.data() + 3 * _layout.local_start(_bodies.size() + t);
    if (_tools[t]->is_loaded())
    {
      Eigen::Map<Vec3>(own, 3) = _tools[t]->translation;
      Eigen::Map<Vec3>(own + 3, 3) = axis(t) * _tools[t]->rotation;
    }
    else
      std::ranges::copy(_tools[t]->displacements(frame(t)), own);
  }
  return _layout.owned(local, 3);
}
//-----------------------------------------------------------------------------
Bodies::Inverted Bodies::find_inverted() const
{
  constexpr double infinity = std::numeric_limits<double>::infinity();
  Inverted found{0, {infinity, infinity, infinity}};
  for (const Body& body : _bodies)
  {
    const Space& V = *body.u->function_space();
    const Mesh& mesh = *V.mesh();
    const std::span<const double> x = mesh.geometry().x();
    const std::span<double> u = values_of(body);
    const auto [dphi, dpsi] = tabulate_cell(V);
    const std::int32_t num = mesh.topology()->index_map(3)->size_local();
    for (std::int32_t c = 0; c < num; ++c)
    {
      const auto nodes = compat::geometry_nodes(mesh, c);
      const auto dofs = V.dofmap()->cell_dofs(c);
      Eigen::MatrixXd X(nodes.size(), 3), d(dofs.size(), 3);
      for (std::size_t k = 0; k < nodes.size(); ++k)
        X.row(k)
            = Eigen::Map<const Eigen::RowVector3d>(x.data() + 3 * nodes[k]);
      for (std::size_t k = 0; k < dofs.size(); ++k)
        d.row(k) = Eigen::Map<const Eigen::RowVector3d>(u.data() + 3 * dofs[k]);
      bool inverted = false;
      for (std::size_t p = 0; p < dphi.size() and !inverted; ++p)
      {
        const Eigen::Matrix3d J = dphi[p] * X;
        const Eigen::Matrix3d j = J + dpsi[p] * d;
        inverted = j.determinant() * J.determinant() <= 0;
      }
      if (inverted)
      {
        const Eigen::RowVector3d mean = X.colwise().mean();
        ++found.number;
        found.x = std::min(found.x, {mean[0], mean[1], mean[2]});
      }
    }
  }
  found.number = sum(_layout.comm, found.number);
  int size;
  MPI_Comm_size(_layout.comm, &size);
  std::vector<std::array<double, 3>> all(size);
  MPI_Allgather(found.x.data(), 3, MPI_DOUBLE, all.data(), 3, MPI_DOUBLE,
                _layout.comm);
  found.x = *std::ranges::min_element(all);
  return found;
}
//-----------------------------------------------------------------------------
std::vector<std::size_t> Bodies::checksums() const
{
  std::vector<std::size_t> sums;
  for (const Body& body : _bodies)
  {
    const std::span<const double> x
        = body.u->function_space()->mesh()->geometry().x();
    sums.push_back(std::hash<std::string_view>{}(
        {reinterpret_cast<const char*>(x.data()), x.size_bytes()}));
  }
  return sums;
}
//-----------------------------------------------------------------------------
bool Bodies::meshes_moved() const
{
  return any(_layout.comm, checksums() != _checksums);
}
