// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "projected_tangent.h"
#include <algorithm>
#include <span>

using namespace dolfinx_mortar;

namespace
{
/// Non-zero for the local rows that have entries which do not vanish.
std::vector<std::int8_t> nonzero_rows(Mat A)
{
  PetscInt begin, end;
  check(MatGetOwnershipRange(A, &begin, &end), "MatGetOwnershipRange");
  std::vector<std::int8_t> flags(end - begin);
  for (PetscInt row = begin; row < end; ++row)
  {
    const MatrixRow entries(A, row);
    flags[row - begin] = std::ranges::any_of(entries.values(), [](double value)
                                             { return value != 0; });
  }
  return flags;
}

PetscObjectState state(Mat A)
{
  PetscObjectState state;
  check(MatGetState(A, &state), "MatGetState");
  return state;
}

/// A without the rows that are not flagged. Collective.
Matrix keep_rows(Mat A, std::span<const std::int8_t> rows)
{
  const std::vector<RowTerm> terms = {{A, rows}};
  return combine_rows(terms);
}
} // namespace

//-----------------------------------------------------------------------------
void ProjectedTangent::update(Mat K)
{
  PetscObjectId id;
  check(PetscObjectGetId(reinterpret_cast<PetscObject>(K), &id),
        "PetscObjectGetId");
  if (_last and id == _id and state(K) == _state
      and state(_last.get()) == _last_state)
  {
    return;
  }
  _others.reset();
  check(MatPtAP(K, _P0.get(), MAT_INITIAL_MATRIX, PETSC_DEFAULT, _last.put()),
        "MatPtAP");
  check(MatProductClear(_last.get()), "MatProductClear");
  _id = id;
  _state = state(K);
  _last_state = state(_last.get());
}
//-----------------------------------------------------------------------------
std::vector<RowTerm> ProjectedTangent::constant() const
{
  if (!_others)
    return {{_last.get()}};
  return {{_last.get(), _same}, {_others.get()}};
}
//-----------------------------------------------------------------------------
Matrix ProjectedTangent::project(Mat K)
{
  update(K);
  return combine_rows(constant());
}
//-----------------------------------------------------------------------------
Matrix ProjectedTangent::project(Mat K, Mat P, Mat more)
{
  update(K);
  const Matrix changes = duplicate(P), mean = duplicate(P);
  add(changes.get(), -1.0, _P0.get());
  add(mean.get(), 1.0, _P0.get());
  check(MatScale(mean.get(), 0.5), "MatScale");
  const std::vector<std::int8_t> moved = nonzero_rows(changes.get());
  const Matrix forces = multiply(keep_rows(K, moved).get(), mean.get());
  Matrix H;
  check(MatTransposeMatMult(keep_rows(changes.get(), moved).get(), forces.get(),
                            MAT_INITIAL_MATRIX, PETSC_DEFAULT, H.put()),
        "MatTransposeMatMult");
  const Matrix Ht = transpose(H.get());
  const Matrix D
      = combine_rows(std::vector<RowTerm>{{H.get()}, {Ht.get()}, {more}});

  const std::vector<std::int8_t> changed = nonzero_rows(D.get());
  std::vector<std::int8_t> same = changed, from_last = changed;
  for (std::size_t row = 0; row < same.size(); ++row)
  {
    same[row] = !changed[row];
    if (_others)
      from_last[row] = changed[row] and _same[row];
  }
  std::vector<RowTerm> sum = constant(), rest = {{_last.get(), from_last}};
  sum.push_back({D.get(), changed});
  if (_others)
    rest.push_back({_others.get(), changed});
  Matrix others = combine_rows(rest);
  _last = combine_rows(sum);
  _last_state = state(_last.get());
  _others = std::move(others);
  _same = std::move(same);
  return _last;
}
