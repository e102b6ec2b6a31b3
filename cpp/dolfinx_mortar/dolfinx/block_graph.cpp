// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "bodies.h"
#include <algorithm>
#include <dolfinx/fem/utils.h>

using namespace dolfinx_mortar;

//-----------------------------------------------------------------------------
Matrix dolfinx_mortar::create_block_graph(MPI_Comm comm, const Body& body)
{
  auto pattern = dolfinx::fem::create_sparsity_pattern(*body.J);
  pattern.finalize();
  const auto [columns, offsets] = pattern.graph();
  const std::vector<std::int64_t> numbers = pattern.column_indices();
  const std::int32_t size = pattern.index_map(0)->size_local();
  std::vector<PetscInt> from(size + 1), to;
  for (std::int32_t row = 0; row < size; ++row)
  {
    // Columns of other ranks come last, whatever their numbers are
    for (auto k = offsets[row]; k < offsets[row + 1]; ++k)
      to.push_back(numbers[columns[k]]);
    std::sort(to.begin() + from[row], to.end());
    from[row + 1] = to.size();
  }
  const std::vector<double> zeros(to.size(), 0.0);
  return create_from_rows(comm, size, size, from, to, zeros);
}
