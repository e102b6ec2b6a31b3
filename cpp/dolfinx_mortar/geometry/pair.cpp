// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "pair.h"

using namespace dolfinx_mortar;

//-----------------------------------------------------------------------------
void PairPoints::differentiate(std::span<const double> C, int num_sums,
                               int num_s, int num_m,
                               std::span<double> by_positions) const
{
  if (d.empty())
    return segments.add(C, num_sums, num_s, num_m, by_positions);
  using Matrix
      = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const Eigen::Index rows = 5 * w.size(), width = 3 * (num_s + num_m);
  const Eigen::Map<const Matrix> by_numbers(C.data(), rows, num_sums),
      numbers(d.data(), rows, width);
  Eigen::Map<Matrix>(by_positions.data(), width, num_sums).noalias()
      += numbers.transpose() * by_numbers;
}
