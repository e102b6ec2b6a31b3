// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "surface.h"
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <dolfinx_mortar/common/error.h>
#include <dolfinx_mortar/common/mpi_exchange.h>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>

using namespace dolfinx_mortar;

namespace
{
using Vector = Eigen::Vector3d;

/// Row of a list of positions, normals or the like.
Vector row(std::span<const double> x, std::int32_t i)
{
  return Eigen::Map<const Vector>(x.data() + 3 * i);
}
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

/// Exchange values along the plan of a surface: send those of `send_nodes` to
/// `dest`, receive those of `recv_nodes` from `source`.
template <typename T>
std::vector<T> exchange_values(MPI_Comm comm, std::span<const T> values, int bs,
                               std::span<const int> dest,
                               std::span<const std::int32_t> send_offsets,
                               std::span<const std::int32_t> send_nodes,
                               std::span<const int> source,
                               std::span<const std::int32_t> recv_offsets)
{
  constexpr int tag = static_cast<int>(Tag::scatter);
  std::vector<T> send(bs * send_nodes.size());
  for (std::size_t i = 0; i < send_nodes.size(); ++i)
    std::copy_n(values.data() + bs * send_nodes[i], bs, send.data() + bs * i);
  std::vector<T> recv(bs * recv_offsets.back());

  // Point-to-point messages need no communicator of the surface's own, which
  // somebody would have to free collectively
  const int size = bs * sizeof(T);
  std::vector<MPI_Request> requests(source.size() + dest.size());
  for (std::size_t i = 0; i < source.size(); ++i)
  {
    MPI_Irecv(recv.data() + bs * recv_offsets[i],
              size * (recv_offsets[i + 1] - recv_offsets[i]), MPI_BYTE,
              source[i], tag, comm, &requests[i]);
  }
  for (std::size_t i = 0; i < dest.size(); ++i)
  {
    MPI_Isend(send.data() + bs * send_offsets[i],
              size * (send_offsets[i + 1] - send_offsets[i]), MPI_BYTE, dest[i],
              tag, comm, &requests[source.size() + i]);
  }
  MPI_Waitall(requests.size(), requests.data(), MPI_STATUSES_IGNORE);
  return recv;
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
Surface dolfinx_mortar::create_surface(
    MPI_Comm comm, std::vector<FacetType> types,
    std::span<const std::int32_t> facet_blocks,
    std::vector<std::int8_t> orientation,
    std::span<const std::int64_t> block_numbers, std::int32_t num_owned_blocks,
    std::span<const int> block_owners, std::span<const double> X)
{
  Surface s;
  s.comm = comm;
  s.types = std::move(types);
  s.orientation = std::move(orientation);
  s.offsets.reserve(s.types.size() + 1);
  for (FacetType type : s.types)
    s.offsets.push_back(s.offsets.back() + num_nodes(type));

  const std::int32_t num_blocks = block_numbers.size();
  std::string message;
  if (static_cast<std::size_t>(s.offsets.back()) != facet_blocks.size()
      or s.orientation.size() != s.types.size() or num_owned_blocks < 0
      or num_owned_blocks > num_blocks
      or block_owners.size()
             != static_cast<std::size_t>(num_blocks - num_owned_blocks)
      or X.size() != 3 * static_cast<std::size_t>(num_blocks))
  {
    message = "The arrays that describe a surface do not fit together: check "
              "their lengths.";
  }
  else if (std::ranges::any_of(facet_blocks, [=](auto b)
                               { return b < 0 or b >= num_blocks; }))
  {
    message = "A facet refers to a block that its function space does not "
              "have.";
  }
  else if (!std::ranges::is_sorted(block_numbers.first(num_owned_blocks)))
  {
    message = "The numbers of the blocks that a rank owns must ascend.";
  }
  throw_on_all(comm, message);

  // Local blocks that the facets touch; ghosts by owner, then by number
  std::vector<std::int32_t> owned(facet_blocks.begin(), facet_blocks.end());
  std::ranges::sort(owned);
  owned.erase(std::ranges::unique(owned).begin(), owned.end());
  const auto split = std::ranges::lower_bound(owned, num_owned_blocks);
  std::vector<std::int32_t> ghosts(split, owned.end());
  owned.erase(split, owned.end());
  auto owner = [&](std::int32_t block)
  { return block_owners[block - num_owned_blocks]; };
  std::ranges::sort(ghosts, {}, [&](std::int32_t b)
                    { return std::tuple(owner(b), block_numbers[b]); });

  // Tell the owners of the ghosts
  RankData<std::int64_t> ghost_data;
  for (std::int32_t block : ghosts)
  {
    if (ghost_data.ranks.empty() or ghost_data.ranks.back() != owner(block))
    {
      ghost_data.ranks.push_back(owner(block));
      ghost_data.offsets.push_back(ghost_data.offsets.back());
    }
    ghost_data.values.push_back(block_numbers[block]);
    ++ghost_data.offsets.back();
  }
  const RankData<std::int64_t> requests = exchange(comm, ghost_data);

  // Owned nodes: those of this rank's facets and those asked for
  std::vector<std::int32_t> requested;
  requested.reserve(requests.values.size());
  auto owned_numbers = block_numbers.first(num_owned_blocks);
  for (std::int64_t number : requests.values)
  {
    auto it = std::ranges::lower_bound(owned_numbers, number);
    if (it == owned_numbers.end() or *it != number)
    {
      message = "Block " + std::to_string(number)
                + " is not owned by the rank that is said to own it.";
    }
    requested.push_back(std::distance(owned_numbers.begin(), it));
  }
  throw_on_all(comm, message);
  owned.insert(owned.end(), requested.begin(), requested.end());
  std::ranges::sort(owned);
  owned.erase(std::ranges::unique(owned).begin(), owned.end());

  s.num_owned = owned.size();
  const std::int64_t n = s.num_owned;
  MPI_Exscan(&n, &s.first_owned, 1, MPI_INT64_T, MPI_SUM, comm);
  MPI_Allreduce(&n, &s.num_global, 1, MPI_INT64_T, MPI_SUM, comm);
  int rank;
  MPI_Comm_rank(comm, &rank);
  if (rank == 0)
    s.first_owned = 0;

  // Exchange plan
  s.owner_ranks = ghost_data.ranks;
  s.recv_offsets = ghost_data.offsets;
  s.recv_nodes.resize(ghosts.size());
  for (std::size_t i = 0; i < ghosts.size(); ++i)
    s.recv_nodes[i] = s.num_owned + i;
  s.ghost_ranks = requests.ranks;
  s.send_offsets = requests.offsets;
  auto owned_node = [&](std::int32_t block) -> std::int32_t
  {
    return std::distance(owned.begin(), std::ranges::lower_bound(owned, block));
  };
  s.send_nodes.resize(requested.size());
  std::ranges::transform(requested, s.send_nodes.begin(), owned_node);

  // Data of nodes
  s.local_blocks = owned;
  s.local_blocks.insert(s.local_blocks.end(), ghosts.begin(), ghosts.end());
  s.numbers.resize(s.local_blocks.size());
  s.blocks.resize(s.local_blocks.size());
  s.X.resize(3 * s.local_blocks.size());
  for (std::size_t i = 0; i < s.local_blocks.size(); ++i)
  {
    s.numbers[i] = s.first_owned + i;
    s.blocks[i] = block_numbers[s.local_blocks[i]];
    std::copy_n(X.data() + 3 * s.local_blocks[i], 3, s.X.data() + 3 * i);
  }
  scatter_forward(s, std::span(s.numbers), 1);
  // Cells of different ranks agree on X up to round-off only
  scatter_forward(s, std::span(s.X), 3);

  // Nodes of facets
  std::vector<std::pair<std::int32_t, std::int32_t>> ghost_nodes(ghosts.size());
  for (std::size_t i = 0; i < ghosts.size(); ++i)
    ghost_nodes[i] = {ghosts[i], s.num_owned + i};
  std::ranges::sort(ghost_nodes);
  s.nodes.resize(facet_blocks.size());
  std::ranges::transform(
      facet_blocks, s.nodes.begin(),
      [&](std::int32_t block)
      {
        return block < num_owned_blocks
                   ? owned_node(block)
                   : std::ranges::lower_bound(
                         ghost_nodes, block, {},
                         &std::pair<std::int32_t, std::int32_t>::first)
                         ->second;
      });
  return s;
}
//-----------------------------------------------------------------------------
template <typename T>
void dolfinx_mortar::scatter_forward(const Surface& s, std::span<T> values,
                                     int bs)
{
  if (values.size() != static_cast<std::size_t>(bs) * s.numbers.size())
    throw std::runtime_error("Wrong number of nodal values.");
  std::vector<T> recv
      = exchange_values<T>(s.comm, values, bs, s.ghost_ranks, s.send_offsets,
                           s.send_nodes, s.owner_ranks, s.recv_offsets);
  for (std::size_t i = 0; i < s.recv_nodes.size(); ++i)
    std::copy_n(recv.data() + bs * i, bs, values.data() + bs * s.recv_nodes[i]);
}
//-----------------------------------------------------------------------------
template <typename T>
void dolfinx_mortar::scatter_reverse_add(const Surface& s, std::span<T> values,
                                         int bs)
{
  if (values.size() != static_cast<std::size_t>(bs) * s.numbers.size())
    throw std::runtime_error("Wrong number of nodal values.");
  std::vector<T> recv
      = exchange_values<T>(s.comm, values, bs, s.owner_ranks, s.recv_offsets,
                           s.recv_nodes, s.ghost_ranks, s.send_offsets);
  for (std::size_t i = 0; i < s.send_nodes.size(); ++i)
    for (int c = 0; c < bs; ++c)
      values[bs * s.send_nodes[i] + c] += recv[bs * i + c];
}
//-----------------------------------------------------------------------------
template void dolfinx_mortar::scatter_forward(const Surface&, std::span<double>,
                                              int);
template void dolfinx_mortar::scatter_forward(const Surface&,
                                              std::span<std::int8_t>, int);
template void dolfinx_mortar::scatter_forward(const Surface&,
                                              std::span<std::int32_t>, int);
template void dolfinx_mortar::scatter_forward(const Surface&,
                                              std::span<std::int64_t>, int);
template void dolfinx_mortar::scatter_reverse_add(const Surface&,
                                                  std::span<double>, int);
template void dolfinx_mortar::scatter_reverse_add(const Surface&,
                                                  std::span<std::int8_t>, int);
template void dolfinx_mortar::scatter_reverse_add(const Surface&,
                                                  std::span<std::int32_t>, int);
template void dolfinx_mortar::scatter_reverse_add(const Surface&,
                                                  std::span<std::int64_t>, int);
//-----------------------------------------------------------------------------
std::vector<double> dolfinx_mortar::current_positions(const Surface& s,
                                                      std::span<const double> u)
{
  std::string message;
  std::vector<double> x = s.X;
  for (std::size_t i = 0; i < s.local_blocks.size() and message.empty(); ++i)
  {
    const std::size_t block = s.local_blocks[i];
    if (3 * block + 3 > u.size())
    {
      message = "The displacement has too few values for the function space of "
                "the surface.";
      break;
    }
    for (int c = 0; c < 3; ++c)
      x[3 * i + c] += u[3 * block + c];
    if (!std::isfinite(x[3 * i] + x[3 * i + 1] + x[3 * i + 2]))
    {
      message = "The displacement of the surface node at "
                + to_string(std::span(s.X).subspan(3 * i).first<3>())
                + " is not finite (NaN or infinite): the solver has diverged, "
                  "or the displacement was never set.";
    }
  }
  throw_on_all(s.comm, message);
  return x;
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::check_areas(const Surface& s, std::span<const double> x,
                                 const std::string& name)
{
  std::string message;
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    std::span<const std::int32_t> nodes = facet_nodes(s, f);
    const NodeDerivatives& dN = node_derivatives(s.types[f]);
    const double tol = no_area * squared_size(nodes, x);
    for (std::size_t k = 0; k < nodes.size(); ++k)
    {
      auto [t0, t1] = tangents(nodes, x, dN[k]);
      // Not ≤, which is false for NaN
      if (!(t0.cross(t1).norm() > tol))
        message = no_area_message(s.types[f], nodes, k, x, name);
    }
  }
  throw_on_all(s.comm, message);
}
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
    if (length > tol)
      nk = s.orientation[f] * c / length;
    else
      nk.setZero();
  }
}
//-----------------------------------------------------------------------------
Normals dolfinx_mortar::compute_normals(const Surface& s,
                                        std::span<const double> x,
                                        std::span<const std::int8_t> fixed)
{
  const std::int32_t n = num_local_nodes(s);
  std::string message;
  if (x.size() != 3 * s.numbers.size()
      or (!fixed.empty() and fixed.size() != x.size()))
  {
    message = "Positions and fixed components need three values for each node "
              "of the surface.";
    throw_on_all(s.comm, message);
  }

  Normals normals;
  normals.n.resize(3 * n);
  normals.length.resize(n);
  for (std::size_t f = 0; f < s.types.size(); ++f)
  {
    std::span<const std::int32_t> nodes = facet_nodes(s, f);
    const NodeDerivatives& dN = node_derivatives(s.types[f]);
    const double tol = no_area * squared_size(nodes, x);
    for (std::size_t k = 0; k < nodes.size(); ++k)
    {
      auto [t0, t1] = tangents(nodes, x, dN[k]);
      const Vector c = t0.cross(t1);
      const double length = c.norm();
      // Not ≤, which is false for NaN
      if (!(length > tol))
      {
        message = no_area_message(s.types[f], nodes, k, x, "surface");
        continue;
      }
      Eigen::Map<Vector>(normals.n.data() + 3 * nodes[k])
          += s.orientation[f] * c / length;
    }
  }
  throw_on_all(s.comm, message);
  scatter_reverse_add(s, std::span(normals.n), 3);

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
//-----------------------------------------------------------------------------
