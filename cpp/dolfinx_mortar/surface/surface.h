// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <cstdint>
#include <dolfinx_mortar/geometry/facet.h>
#include <mpi.h>
#include <span>
#include <string>
#include <vector>

namespace dolfinx_mortar
{
/// @brief One side of an interface: facets with their nodes, distributed over
/// the ranks of a communicator.
///
/// A facet belongs to the rank that owns its cell, but for surfaces from
/// spread_facets. Nodes are the nodes of the
/// displacement space on the facets; at edges there may be one for each of the
/// smooth patches that meet there, see split_at_edges. The nodes a rank owns
/// come first, the
/// nodes of its facets that other ranks own (ghosts) follow. A rank may own
/// nodes that none of its own facets touches.
struct Surface
{
  /// Communicator of the coupled problem; it must live as long as the surface
  MPI_Comm comm = MPI_COMM_NULL;

  /// Type of each facet
  std::vector<FacetType> types;

  /// Nodes of facet `f` are `nodes[offsets[f]:offsets[f + 1]]` (local node
  /// indices, in the order of facet.h)
  std::vector<std::int32_t> offsets = {0}, nodes;

  /// +1 where x,ξ₁ × x,ξ₂ points out of the body, -1 where it points into it
  std::vector<std::int8_t> orientation;

  /// Compact parts: facets of part `p` are those from `parts[p]` to
  /// `parts[p + 1]`. Empty where all facets of a rank are one part
  std::vector<std::int32_t> parts;

  /// Number of nodes owned by this rank
  std::int32_t num_owned = 0;

  /// Surface number of the first owned node; owned nodes are numbered
  /// contiguously, rank after rank
  std::int64_t first_owned = 0;

  /// Number of nodes on all ranks
  std::int64_t num_global = 0;

  /// Surface number of each local node
  std::vector<std::int64_t> numbers;

  /// Number of each local node's displacement block in the coupled problem
  /// (dof = 3 * block + component)
  std::vector<std::int64_t> blocks;

  /// Index of each local node's block among the local blocks of the function
  /// space of its body; -1 where the rank does not have it, as it happens to
  /// ghosts of surfaces from spread_facets
  std::vector<std::int32_t> local_blocks;

  /// Reference position of each local node, shape (num_nodes, 3)
  std::vector<double> X;

  /// Exchange plan: ranks this one receives ghost values from, and sends owned
  /// values to; positions in the list of local nodes, grouped by rank (CSR).
  /// With rank 1 owning nodes 4 and 5, and rank 2 node 6 of a rank that owns
  /// 4 nodes:
  ///
  ///     owner_ranks  = [1, 2]
  ///     recv_offsets = [0, 2, 3]
  ///     recv_nodes   = [4, 5, 6]
  std::vector<int> owner_ranks, ghost_ranks;
  std::vector<std::int32_t> recv_offsets = {0}, recv_nodes, send_offsets = {0},
                            send_nodes;
};

/// @brief Number of local nodes, owned and ghost.
inline std::int32_t num_local_nodes(const Surface& s)
{
  return s.numbers.size();
}

/// @brief Local nodes of facet `f`.
inline std::span<const std::int32_t> facet_nodes(const Surface& s,
                                                 std::int32_t f)
{
  return std::span(s.nodes).subspan(s.offsets[f],
                                    s.offsets[f + 1] - s.offsets[f]);
}

/// @brief Create a surface from facets given by the local blocks of a
/// function space. Collective.
///
/// Owned nodes are sorted by block number, ghosts by their owner and then by
/// block number. Owners learn of nodes that only other ranks' facets touch from
/// those ranks; X of a ghost is the owner's.
///
/// @param[in] comm Communicator.
/// @param[in] types Type of each facet of this rank.
/// @param[in] facet_blocks Local blocks (of the function space) of the nodes
/// of all facets, one facet after the other, in the order of facet.h.
/// @param[in] orientation +1 or -1 for each facet, see Surface.
/// @param[in] block_numbers Number in the coupled problem of each local block
/// of the function space; the blocks that this rank owns come first, in
/// ascending order.
/// @param[in] num_owned_blocks Number of local blocks that this rank owns.
/// @param[in] block_owners Owning rank of each ghost block (blocks from
/// `num_owned_blocks` on).
/// @param[in] X Reference position of each local block, shape (n, 3).
/// @throw std::runtime_error On all ranks, where the arrays do not fit
/// together or have wrong entries.
Surface create_surface(MPI_Comm comm, std::vector<FacetType> types,
                       std::span<const std::int32_t> facet_blocks,
                       std::vector<std::int8_t> orientation,
                       std::span<const std::int64_t> block_numbers,
                       std::int32_t num_owned_blocks,
                       std::span<const int> block_owners,
                       std::span<const double> X);

/// @brief Number the nodes of all ranks, rank after rank. Collective.
/// @param[in,out] s Surface that has its `num_owned` and its exchange plan; its
/// `first_owned`, `num_global` and `numbers` are set.
void number_nodes(Surface& s);

/// @brief Copy the values of owned nodes to their ghosts. Collective.
/// @param[in] s Surface.
/// @param[in,out] values Shape (num_local_nodes, bs).
/// @param[in] bs Number of values of a node, the same on all ranks.
/// @throw std::runtime_error On all ranks, where there are more or fewer values
/// than these.
template <typename T>
void scatter_forward(const Surface& s, std::span<T> values, int bs);

/// @brief Add the values of ghosts to the values of their owners (ghost
/// values are left unchanged). Collective.
/// @param[in] s Surface.
/// @param[in,out] values Shape (num_local_nodes, bs).
/// @param[in] bs Number of values of a node, the same on all ranks.
/// @throw std::runtime_error As above.
template <typename T>
void scatter_reverse_add(const Surface& s, std::span<T> values, int bs);

/// @brief Current positions X + u of the local nodes. Collective.
/// @param[in] s Surface.
/// @param[in] u Displacement of the local blocks of the function space of the
/// surface's body, shape (n, 3); those of ghosts are not read.
/// @return Positions, shape (num_local_nodes, 3).
/// @throw std::runtime_error On all ranks, where a position is not finite or u
/// is too short.
std::vector<double> current_positions(const Surface& s,
                                      std::span<const double> u);

/// @brief Check that every facet has an area at each of its nodes. Collective.
/// @param[in] s Surface.
/// @param[in] x Position of each local node, shape (n, 3).
/// @param[in] name What to call the surface in a message.
/// @throw std::runtime_error On all ranks, where a facet has none or x is of
/// the wrong size.
void check_areas(const Surface& s, std::span<const double> x,
                 const std::string& name = "surface");

/// @brief Unit outward normals of a facet at its nodes.
/// @param[in] s Surface.
/// @param[in] x Position of each local node, shape (n, 3).
/// @param[in] f Facet.
/// @param[out] n Shape (nodes of the facet, 3); zero where the facet has no
/// area.
void facet_normals(const Surface& s, std::span<const double> x, std::int32_t f,
                   std::span<double> n);

/// @brief Averaged nodal normals.
struct Normals
{
  /// Unit outward normals, shape (num_local_nodes, 3); ghosts are up to date
  std::vector<double> n;

  /// Length of what is normalised: of the sum of the facets' unit normals,
  /// without its dropped components; shape (num_local_nodes)
  std::vector<double> length;
};

/// @brief Averaged nodal normals: the normalised sum of the *unit* outward
/// normals, taken at the node, of the facets that meet there. Collective.
///
/// On a symmetry plane the facets beyond the plane are missing from the sum;
/// their share cancels the component along the plane's normal, which is a
/// fixed one. So fixed components are dropped. Where less than a tenth of the
/// sum is left the fixed components are not those of a symmetry plane but of
/// the surface's own normal (the node cannot move towards the other surface),
/// and nothing is dropped: a normal never has length zero.
///
/// @param[in] s Surface.
/// @param[in] x Current position of each local node, shape (n, 3).
/// @param[in] fixed Components to drop from the sum before normalising
/// (non-zero: the displacement component of the node is prescribed), shape
/// (num_local_nodes, 3) with ghosts up to date, or empty.
/// @throw std::runtime_error On all ranks, where a facet has no area at a
/// node, the sum vanishes, or an array is of the wrong size.
Normals compute_normals(const Surface& s, std::span<const double> x,
                        std::span<const std::int8_t> fixed);

/// @brief Share of one facet in the derivative of the averaged normals of its
/// nodes with respect to the positions of its nodes.
///
/// The full derivative of n_k is the sum over the facets that meet at k.
/// @param[in] s Surface.
/// @param[in] x,fixed,normals As given to and returned by compute_normals.
/// @param[in] f Facet.
/// @param[out] dn Shape (3 n, 3 n) with n the nodes of the facet, row-major:
/// rows are components of normals, columns components of positions.
void normal_derivative(const Surface& s, std::span<const double> x,
                       std::span<const std::int8_t> fixed,
                       const Normals& normals, std::int32_t f,
                       std::span<double> dn);
} // namespace dolfinx_mortar
