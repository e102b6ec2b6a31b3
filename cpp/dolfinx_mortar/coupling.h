// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "options.h"
#include "search.h"
#include "surface.h"
#include <array>
#include <cstdint>
#include <optional>
#include <petscmat.h>
#include <span>
#include <vector>

namespace dolfinx_mortar
{
/// @brief An interface between a slave and a master surface, as the assembly
/// sees it.
///
/// Matrices have rows and columns of two kinds. *Displacement* dofs are those
/// of the coupled problem, `3 * block + component`. *Multiplier* dofs are
/// `3 * multiplier + component`, with one multiplier for every slave node of
/// every interface, whether it carries one or not: rows of nodes that do not
/// carry a multiplier stay empty.
struct Interface
{
  /// Surfaces; all ranks of their communicator take part in every call
  Surface slave, master;

  /// Space, integration, degree, search distance
  IntegrationOptions options;

  /// Multiplier number of each local slave node (owned and ghost)
  std::vector<std::int64_t> multipliers;

  /// Non-zero for local slave nodes that carry a multiplier
  std::vector<std::int8_t> carries;

  /// Non-zero for local slave nodes at which nothing acts if they carry no
  /// multiplier; the functions of others without one are shared among their
  /// neighbours
  std::vector<std::int8_t> idle;

  /// Non-zero for local slave nodes with positive functions, see
  /// transformation
  std::vector<std::int8_t> positive;

  /// Non-zero for components of local slave nodes whose displacement is
  /// prescribed, shape (n, 3)
  std::vector<std::int8_t> fixed;
};

/// @brief An interface on its own, all of whose slave nodes take part: the
/// corners carry multipliers, and the other nodes too where the space has
/// functions for them. No displacement is prescribed.
///
/// Multipliers have the numbers of the slave nodes, so that a matrix has
/// `3 * slave.num_owned` rows on each rank. Where some slave nodes are on
/// Dirichlet boundaries or on other interfaces as well, change `fixed` and
/// `carries`; where the masters cover the slave surface only in part, set
/// `positive` from flag_positive after a first integrate. Collective.
/// @param[in] slave,master Surfaces.
/// @param[in] options Space, integration, degree, search distance.
Interface create_interface(Surface slave, Surface master,
                           const IntegrationOptions& options = {});

/// @brief Current positions and averaged normals of an interface.
struct Configuration
{
  /// Positions of local slave and master nodes, shapes (n, 3)
  std::vector<double> x_slave, x_master;

  /// Normals of the slave nodes
  Normals normals;

  /// Facets that may meet
  Candidates candidates;
};

/// @brief Find what meets in a configuration. Collective.
/// @param[in] interface Interface.
/// @param[in] x_slave,x_master Positions of local slave and master nodes,
/// shapes (n, 3).
Configuration configure(const Interface& interface, std::vector<double> x_slave,
                        std::vector<double> x_master);

/// @brief Nodal values that the integrals leave on the slave nodes; local nodes
/// with ghosts up to date.
struct NodalIntegrals
{
  /// ∫ Ñ_j over the part of the surface that a master covers, shape (n)
  std::vector<double> coverage;

  /// ∫ Ñ_j n⁽²⁾ with the unit outward normals of the masters' facets: the way
  /// the master faces there, shape (n, 3)
  std::vector<double> master_normal;

  /// Diagonal of D̃ for dual multipliers, shape (n)
  std::vector<double> diagonal;

  /// ∫ Φ_j, the row sums of D and of M, shape (n)
  std::vector<double> weight;

  /// Weighted gap g̃_j, shape (n)
  std::vector<double> gap;

  /// Weighted relative position ∫ Φ_j (x⁽¹⁾ - x⁽²⁾∘P), shape (n, 3)
  std::vector<double> offset;

  /// Covered area, and area of overlaps left out (see PairPoints), of the
  /// facets of this rank
  double area = 0, dropped_area = 0;

  /// Share of each facet of this rank that is left out and that no other master
  /// covers, shape (num_facets)
  std::vector<double> lost;

  /// Share of the parts of each facet of this rank that face the masters that
  /// lies beyond the edge of these, shape (num_facets)
  std::vector<double> beyond;

  /// Non-zero for nodes around which some point is nearly in contact. The
  /// weighted gap of other nodes can be negative all the same, as Φ is in
  /// places; that is no contact. Shape (n)
  std::vector<std::int8_t> near;

  /// Mean gap over the covered parts of the facets around each node, zero where
  /// there are none: no penetration can come from functions that are negative
  /// in places. Shape (n)
  std::vector<double> distance;

  /// Covered area of each facet of this rank, shape (num_facets)
  std::vector<double> facet_area;

  /// Number of facets of this rank that some master covers, and of pairs
  std::int64_t num_covered = 0, num_pairs = 0;

  /// Covered facets none of whose nodes carries a multiplier (left out), and
  /// the midpoint of the first of them
  std::int64_t num_orphans = 0;
  std::array<double, 3> orphan = {0, 0, 0};
};

/// @brief Matrices to add to; null for those not wanted.
struct CouplingMatrices
{
  /// D_jk = ∫ Φ_j N_k and M_jl = ∫ Φ_j N_l∘P; rows are multipliers, columns
  /// displacements (equations 3.5, 3.6)
  Mat D = nullptr, M = nullptr;

  /// B = [D, -M] (equation 3.4)
  Mat B = nullptr;

  /// B with its slave columns in the transformed basis, [D̃, -M] = B T
  Mat B_tilde = nullptr;
};

/// @brief Add the mortar matrices of an interface, and integrate the nodal
/// values. Collective.
///
/// The caller assembles the matrices when all interfaces have been added.
/// @throw std::runtime_error On all ranks, see FacetIntegrator::compute.
NodalIntegrals integrate(const Interface& interface,
                         const Configuration& configuration,
                         const CouplingMatrices& matrices);

/// @brief Derivatives to add to; null for those not wanted.
struct DerivativeMatrices
{
  /// Derivative of Bᵀz with z fixed; displacements by displacements
  Mat force = nullptr;

  /// Derivative of the weighted gaps; one row for each *multiplier*,
  /// columns are displacements, and multipliers times components for the nodal
  /// normals
  Mat gap = nullptr, gap_normal = nullptr;

  /// Derivative of the offsets; multiplier dofs by displacements
  Mat offset = nullptr;
};

/// @brief Add the derivatives of an interface. Collective.
///
/// @param[in] interface,configuration See integrate.
/// @param[in] z Multipliers at the local slave nodes, shape (n, 3).
/// @param[in] active Non-zero for the local slave nodes whose gap and offset
/// rows matter; facets without such a node and with z = 0 are left out.
/// @param[in] matrices Matrices to add to.
void integrate_derivatives(const Interface& interface,
                           const Configuration& configuration,
                           std::span<const double> z,
                           std::span<const std::int8_t> active,
                           const DerivativeMatrices& matrices);

/// @brief Add the derivative of the averaged normals (multiplier dofs by
/// displacements). Collective.
void differentiate_normals(const Interface& interface,
                           const Configuration& configuration, Mat A);

/// @brief Insert the basis transformation T, or its inverse, of the slave nodes
/// (displacements by displacements); other rows are not touched. Collective.
void insert_transformation(const Interface& interface, bool inverse, Mat T);

/// @brief ∫ Ñ_j dγ over the whole slave surface, whether covered or not.
/// Collective.
/// @param[in] interface Interface.
/// @param[in] x Positions of the local slave nodes, shape (n, 3).
/// @return Weight (area) of each local slave node, shape (n).
std::vector<double> nodal_weights(const Interface& interface,
                                  std::span<const double> x);

/// @brief Flag the nodes that get positive functions: those of facets that the
/// edge of a master crosses, and of all facets around them. Collective.
///
/// Parts that are too steep for the masters do not count. They are off contact,
/// as on the side of a fillet, but the facets around them may be in contact,
/// and a change of their functions is a jump of forces and gaps.
/// @param[in] interface Interface.
/// @param[in] beyond Share of each facet beyond the masters' edges, see
/// NodalIntegrals.
/// @return Flag of each local slave node, shape (n).
std::vector<std::int8_t> flag_positive(const Interface& interface,
                                       std::span<const double> beyond);

/// @brief Add dense blocks to a matrix.
/// @param[in,out] A Matrix.
/// @param[in] first_rows,first_columns First row and first column (global) of
/// each block, shape (n).
/// @param[in] rows,columns Shape of a block.
/// @param[in] blocks Row-major blocks, shape (n, rows, columns).
void add_blocks(Mat A, std::span<const std::int64_t> first_rows,
                std::span<const std::int64_t> first_columns, int rows,
                int columns, std::span<const double> blocks);

/// @brief Where a row of combine_rows comes from.
enum class RowSource : std::int8_t
{
  both = 0,  ///< K + Δ
  delta = 1, ///< Δ alone
  unit = 2   ///< one on the diagonal
};

/// @brief Sum of two matrices, row by row: K with few rows changed. Collective.
/// @param[in] K,Delta Square AIJ matrices of the same layout.
/// @param[in] sources Source of each local row.
/// @return New matrix; the caller destroys it.
Mat combine_rows(Mat K, Mat Delta, std::span<const RowSource> sources);

/// @brief Create an empty parallel AIJ matrix, to be filled with any pattern.
/// @return Matrix; the caller destroys it.
Mat create_matrix(MPI_Comm comm, std::int64_t local_rows,
                  std::int64_t local_columns);
} // namespace dolfinx_mortar
