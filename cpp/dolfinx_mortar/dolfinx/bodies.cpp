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
#include <dolfinx/fem/petsc.h>
#include <dolfinx/mesh/utils.h>
#include <limits>
#include <map>
#include <set>
#include <stdexcept>
#include <string_view>

using namespace dolfinx_mortar;

namespace
{
using Space = FunctionSpace;
using Mesh = dolfinx::mesh::Mesh<double>;

/// Union-find over the local blocks of a space: blocks of a cell are connected.
std::vector<std::int32_t> local_components(const Space& V)
{
  const auto& map = *V.dofmap()->index_map;
  std::vector<std::int32_t> parent(map.size_local() + map.num_ghosts());
  std::iota(parent.begin(), parent.end(), 0);
  auto root = [&](std::int32_t i)
  {
    while (parent[i] != i)
      i = parent[i] = parent[parent[i]];
    return i;
  };
  const auto& cells = *V.mesh()->topology()->index_map(3);
  for (std::int32_t c = 0; c < cells.size_local() + cells.num_ghosts(); ++c)
  {
    const auto dofs = V.dofmap()->cell_dofs(c);
    for (std::int32_t dof : dofs)
      parent[root(dof)] = root(dofs[0]);
  }
  for (std::size_t i = 0; i < parent.size(); ++i)
    parent[i] = root(i);
  return parent;
}

/// Connected part of the mesh that each local block is on, as the smallest
/// number of the blocks of that part. Collective.
std::vector<double> connected_parts(MPI_Comm comm, const Space& V,
                                    std::span<const std::int64_t> numbers)
{
  const std::vector<std::int32_t> component = local_components(V);
  dolfinx::la::Vector<double> v(V.dofmap()->index_map, 1);
  std::ranges::copy(numbers, compat::values(v).begin());
  for (bool changed = true; changed;)
  {
    const std::span<double> x = compat::values(v);
    const std::vector<double> before(x.begin(), x.end());
    std::vector<double> smallest(x.size(),
                                 std::numeric_limits<double>::infinity());
    for (std::size_t i = 0; i < x.size(); ++i)
      smallest[component[i]] = std::min(smallest[component[i]], x[i]);
    for (std::size_t i = 0; i < x.size(); ++i)
      x[i] = smallest[component[i]];
    v.scatter_rev([](double a, double b) { return std::min(a, b); });
    v.scatter_fwd();
    changed = any(comm, !std::ranges::equal(x, before));
  }
  const std::span<double> x = compat::values(v);
  return {x.begin(), x.end()};
}

/// Mean size of the cells of a mesh [length]. Collective.
double mean_cell_size(MPI_Comm comm, const Mesh& mesh)
{
  const std::int32_t num = mesh.topology()->index_map(3)->size_local();
  std::vector<std::int32_t> cells(num);
  std::iota(cells.begin(), cells.end(), 0);
  double total = 0;
  for (double h : dolfinx::mesh::h(mesh, std::span(std::as_const(cells)), 3))
    total += h;
  return sum(comm, total) / sum(comm, static_cast<std::int64_t>(num));
}

/// The four nodes of a frame: on rank 0, and known to all others. Collective.
std::shared_ptr<const dolfinx::common::IndexMap> create_frame_map(MPI_Comm comm)
{
  int rank;
  MPI_Comm_rank(comm, &rank);
  if (rank == 0)
  {
    return std::make_shared<dolfinx::common::IndexMap>(
        comm, 4, std::vector<std::int64_t>{}, std::vector<int>{});
  }
  return std::make_shared<dolfinx::common::IndexMap>(
      comm, 0, std::vector<std::int64_t>{0, 1, 2, 3}, std::vector<int>(4, 0));
}

/// Largest side of the box around positions of all ranks. Collective.
double extent(MPI_Comm comm, std::span<const double> x)
{
  std::array<double, 6> box;
  box.fill(std::numeric_limits<double>::infinity());
  for (std::size_t i = 0; i < x.size(); ++i)
  {
    box[i % 3] = std::min(box[i % 3], x[i]);
    box[3 + i % 3] = std::min(box[3 + i % 3], -x[i]);
  }
  MPI_Allreduce(MPI_IN_PLACE, box.data(), 6, MPI_DOUBLE, MPI_MIN, comm);
  return std::max({-box[3] - box[0], -box[4] - box[1], -box[5] - box[2]});
}

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
} // namespace

//-----------------------------------------------------------------------------
Layout dolfinx_mortar::create_layout(
    MPI_Comm comm, std::span<const std::shared_ptr<const Space>> spaces,
    std::span<const std::shared_ptr<const RigidTool>> tools)
{
  Layout layout;
  layout.comm = comm;
  std::vector<std::reference_wrapper<const dolfinx::common::IndexMap>> maps;
  for (auto& V : spaces)
  {
    check_displacements(*V);
    maps.push_back(*V->dofmap()->index_map);
  }
  const std::shared_ptr<const dolfinx::common::IndexMap> four
      = tools.empty() ? nullptr : create_frame_map(comm);
  for (std::size_t t = 0; t < tools.size(); ++t)
    maps.push_back(*four);
  layout.blocks = number_blocks(maps);
  std::vector<double> parts;
  for (std::size_t b = 0; b < spaces.size(); ++b)
  {
    const Space& V = *spaces[b];
    layout.num_owned.push_back(maps[b].get().size_local());
    layout.num_local.push_back(maps[b].get().size_local()
                               + maps[b].get().num_ghosts());
    const std::vector<double> X = V.tabulate_dof_coordinates(false);
    layout.X.insert(layout.X.end(), X.begin(),
                    X.begin() + 3 * layout.num_local[b]);
    const std::vector<double> own = connected_parts(comm, V, layout.blocks[b]);
    parts.insert(parts.end(), own.begin(), own.end());
    layout.cell_sizes.push_back(mean_cell_size(comm, *V.mesh()));
  }
  const double length = tools.empty() ? 0 : extent(comm, layout.X);
  for (std::size_t t = 0; t < tools.size(); ++t)
  {
    const std::size_t b = spaces.size() + t;
    layout.num_owned.push_back(four->size_local());
    layout.num_local.push_back(4);
    const std::array<double, 12> X = tools[t]->frame(length);
    layout.X.insert(layout.X.end(), X.begin(), X.end());
    parts.insert(parts.end(), 4, layout.blocks[b][0]);
    layout.cell_sizes.push_back(length);
  }
  layout.first_block = first_of_rank(comm, layout.num_blocks());

  // Parts by ascending number of their first block, which some rank owns
  std::vector<double> roots;
  std::set<double> mine;
  for (std::size_t i = 0; i < parts.size(); ++i)
  {
    if (parts[i] >= layout.first_block
        and parts[i] < layout.first_block + layout.num_blocks())
      mine.insert(parts[i]);
  }
  int size, count = mine.size();
  MPI_Comm_size(comm, &size);
  std::vector<int> counts(size), displacements(size + 1, 0);
  MPI_Allgather(&count, 1, MPI_INT, counts.data(), 1, MPI_INT, comm);
  std::partial_sum(counts.begin(), counts.end(), displacements.begin() + 1);
  roots.resize(displacements.back());
  const std::vector<double> sent(mine.begin(), mine.end());
  MPI_Allgatherv(sent.data(), count, MPI_DOUBLE, roots.data(), counts.data(),
                 displacements.data(), MPI_DOUBLE, comm);
  for (double part : parts)
  {
    layout.parts.push_back(std::ranges::lower_bound(roots, part)
                           - roots.begin());
  }
  layout.num_parts = roots.size();
  return layout;
}
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
    std::span<const std::shared_ptr<const DirichletBC>> bcs)
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
Surface dolfinx_mortar::create_tool_surface(std::span<const TaggedFacets> parts,
                                            std::int32_t frame)
{
  std::vector<std::shared_ptr<const Space>> spaces;
  std::vector<std::reference_wrapper<const dolfinx::common::IndexMap>> maps;
  for (const TaggedFacets& part : parts)
  {
    if (std::ranges::find(spaces, part.V) != spaces.end())
      continue;
    spaces.push_back(part.V);
    maps.push_back(*part.V->dofmap()->index_map);
  }
  Layout own;
  own.blocks = number_blocks(maps);
  for (const auto& map : maps)
  {
    own.num_owned.push_back(map.get().size_local());
    own.num_local.push_back(map.get().size_local() + map.get().num_ghosts());
  }
  Surface s = create_surface(own, spaces, parts, "master");
  std::ranges::fill(s.local_blocks, frame);
  return s;
}
//-----------------------------------------------------------------------------
Bodies::Bodies(MPI_Comm comm, std::vector<Body> bodies,
               std::vector<std::shared_ptr<const DirichletBC>> bcs,
               std::vector<std::shared_ptr<const RigidTool>> tools)
    : _bodies(std::move(bodies)), _tools(std::move(tools))
{
  _layout = create_layout(comm, spaces(), _tools);
  for (std::size_t t = 0; t < _tools.size(); ++t)
    _tool_displacements.push_back(_tools[t]->displacements(frame(t)));
  set_conditions(std::move(bcs));
  for (const Body& body : _bodies)
    _tangents.emplace_back(dolfinx::fem::petsc::create_matrix(*body.J));
  _checksums = checksums();
}
//-----------------------------------------------------------------------------
std::array<double, 12> Bodies::frame(std::size_t tool) const
{
  std::array<double, 12> X;
  const std::int32_t start = _layout.local_start(_bodies.size() + tool);
  std::copy_n(_layout.X.begin() + 3 * start, 12, X.begin());
  return X;
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
std::vector<std::array<double, 12>>
Bodies::tool_values(std::span<const double> owned) const
{
  std::vector<std::array<double, 12>> values(_tools.size());
  for (std::size_t t = 0; t < _tools.size(); ++t)
  {
    const std::size_t b = _bodies.size() + t;
    std::ranges::copy(
        owned.subspan(3 * _layout.owned_start(b), 3 * _layout.num_owned[b]),
        values[t].begin());
  }
  MPI_Bcast(values.data(), 12 * values.size(), MPI_DOUBLE, 0, _layout.comm);
  return values;
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
  f.resize(_layout.size(), 0.0); // nothing but contact acts on tools
  return f;
}
//-----------------------------------------------------------------------------
Matrix Bodies::tangent() const
{
  Timer timer("~mortar: assemble");
  for (std::size_t b = 0; b < _bodies.size(); ++b)
  {
    const Mat A = _tangents[b].get();
    check(MatZeroEntries(A), "MatZeroEntries");
    dolfinx::fem::assemble_matrix(
        dolfinx::la::petsc::Matrix::set_block_fn(A, ADD_VALUES), *_bodies[b].J,
        {});
    check(MatAssemblyBegin(A, MAT_FINAL_ASSEMBLY), "MatAssemblyBegin");
    check(MatAssemblyEnd(A, MAT_FINAL_ASSEMBLY), "MatAssemblyEnd");
  }
  if (_tangents.size() == 1 and _tools.empty())
    return _tangents.front();
  const std::size_t n = _layout.num_bodies();
  std::vector<Mat> blocks(n * n, nullptr);
  for (std::size_t b = 0; b < _tangents.size(); ++b)
    blocks[n * b + b] = _tangents[b].get();
  std::vector<Matrix> zeros;
  for (std::size_t b = _tangents.size(); b < n; ++b)
  {
    const PetscInt size = 3 * _layout.num_owned[b];
    std::vector<Entry> diagonal;
    for (PetscInt i = 0; i < size; ++i)
      diagonal.push_back({i, i, 0.0});
    zeros.push_back(create_from_entries(_layout.comm, size, size, diagonal));
    blocks[n * b + b] = zeros.back().get();
  }
  Matrix nest, K;
  check(MatCreateNest(_layout.comm, n, nullptr, n, nullptr, blocks.data(),
                      nest.put()),
        "MatCreateNest");
  check(MatConvert(nest.get(), MATAIJ, MAT_INITIAL_MATRIX, K.put()),
        "MatConvert");
  return K;
}
//-----------------------------------------------------------------------------
std::vector<std::int8_t> Bodies::prescribed() const
{
  return prescribed_dofs(_layout, spaces(), _bcs);
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
    std::ranges::copy(_tools[t]->displacements(frame(t)),
                      local.begin()
                          + 3 * _layout.local_start(_bodies.size() + t));
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
