// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include "petsc.h"
#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Sums dense blocks of facets and nodes, and makes a matrix of them.
///
/// Rows and columns are nodes, with the numbers that they have on all ranks.
/// Rows of other ranks may be added to; they go to their owners when the matrix
/// is made, so that PETSc gets all rows at once and has nothing to search for.
///
/// @tparam R,C Rows and columns of the block of a pair of nodes. A block of 1 x
/// 1 stands for its product with the 3 x 3 identity.
template <int R, int C>
class BlockAccumulator
{
public:
  /// @brief Add a dense matrix.
  /// @param[in] rows,columns Numbers of nodes; negative ones are left out.
  /// @param[in] values Row-major, shape (R rows.size(), C columns.size()).
  /// @param[in] factor Factor of the values.
  void add(std::span<const std::int64_t> rows,
           std::span<const std::int64_t> columns, const double* values,
           double factor = 1);

  /// @brief Add one block.
  /// @param[in] row,column Numbers of nodes.
  /// @param[in] values Row-major, shape (R, C).
  /// @param[in] factor Factor of the values.
  void add(std::int64_t row, std::int64_t column, const double* values,
           double factor = 1)
  {
    add(std::span(&row, 1), std::span(&column, 1), values, factor);
  }

  /// @brief Matrix of everything that all ranks have added, which is forgotten.
  /// Collective.
  /// @param[in] comm Communicator.
  /// @param[in] local_rows,local_columns Local size of the matrix, in dofs.
  Matrix assemble(MPI_Comm comm, PetscInt local_rows, PetscInt local_columns);

private:
  struct Row
  {
    std::int64_t number;
    std::vector<std::int64_t> columns;
    std::vector<double> values; // of the blocks, one after the other
  };

  /// The row of a node, made where it is not there yet.
  Row& row(std::int64_t number);

  /// Add a block to a row.
  static void add_block(Row& row, std::int64_t column, const double* values,
                        std::size_t width, double factor);

  /// Send rows to the ranks that own them. Collective.
  void send_rows(MPI_Comm comm, std::int64_t first, std::int64_t size);

  std::vector<Row> _rows;
  std::unordered_map<std::int64_t, std::size_t> _index;
};

extern template class BlockAccumulator<1, 1>;
extern template class BlockAccumulator<3, 3>;
} // namespace dolfinx_mortar
