// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#include "petsc.h"
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

using namespace dolfinx_mortar;

namespace
{
/// What PETSc has said of its last error, see PetscErrorText.
std::string error_text;

PetscErrorCode keep_error(MPI_Comm, int, const char*, const char*,
                          PetscErrorCode code, PetscErrorType type,
                          const char* message, void*)
{
  if (type == PETSC_ERROR_INITIAL and message)
    error_text = message;
  return code;
}

/// A vector that looks at the values of somebody else.
Vector view(Mat A, bool left, std::span<const double> x)
{
  MPI_Comm comm;
  check(PetscObjectGetComm(reinterpret_cast<PetscObject>(A), &comm),
        "PetscObjectGetComm");
  auto [rows, columns] = local_size(A);
  if (static_cast<PetscInt>(x.size()) != (left ? rows : columns))
    throw std::invalid_argument("A vector does not fit its matrix.");
  int size;
  MPI_Comm_size(comm, &size);
  Vector v;
  if (size == 1)
  {
    check(VecCreateSeqWithArray(comm, 1, x.size(), x.data(), v.put()),
          "VecCreateSeqWithArray");
  }
  else
  {
    check(VecCreateMPIWithArray(comm, 1, x.size(), PETSC_DETERMINE, x.data(),
                                v.put()),
          "VecCreateMPIWithArray");
  }
  return v;
}
/// Let a matrix free the memory that it uses, at its end.
void keep(Mat A, std::unique_ptr<RowStorage> rows)
{
  PetscContainer container;
  check(PetscContainerCreate(PETSC_COMM_SELF, &container),
        "PetscContainerCreate");
  check(PetscContainerSetPointer(container, rows.get()),
        "PetscContainerSetPointer");
#if PETSC_VERSION_GE(3, 23, 0)
  // The address of the pointer, as void** or, from 3.25 on, as void*
  auto destroy = [](auto p) -> PetscErrorCode
  {
    delete *static_cast<RowStorage**>(static_cast<void*>(p));
    return PETSC_SUCCESS;
  };
  check(PetscContainerSetCtxDestroy(container, destroy),
        "PetscContainerSetCtxDestroy");
#else
  auto destroy = [](void* p) -> PetscErrorCode
  {
    delete static_cast<RowStorage*>(p);
    return PETSC_SUCCESS;
  };
  check(PetscContainerSetUserDestroy(container, destroy),
        "PetscContainerSetUserDestroy");
#endif
  rows.release();
  check(PetscObjectCompose(reinterpret_cast<PetscObject>(A), "mortar_rows",
                           reinterpret_cast<PetscObject>(container)),
        "PetscObjectCompose");
  check(PetscContainerDestroy(&container), "PetscContainerDestroy");
}
} // namespace

//-----------------------------------------------------------------------------
PetscErrorText::PetscErrorText()
{
  error_text.clear();
  PetscPushErrorHandler(keep_error, nullptr);
}
//-----------------------------------------------------------------------------
PetscErrorText::~PetscErrorText() { PetscPopErrorHandler(); }
//-----------------------------------------------------------------------------
void dolfinx_mortar::check(PetscErrorCode code, const char* what)
{
  if (code == PETSC_SUCCESS)
    return;
  const char* text = nullptr;
  PetscErrorMessage(code, &text, nullptr);
  std::string message = std::string("PETSc failed in ") + what + ": ";
  message += text ? text : "error " + std::to_string(code);
  if (!error_text.empty())
    message += ", " + error_text;
  error_text.clear();
  throw std::runtime_error(message + ".");
}
//-----------------------------------------------------------------------------
std::pair<PetscInt, PetscInt> dolfinx_mortar::local_size(Mat A)
{
  PetscInt rows, columns;
  check(MatGetLocalSize(A, &rows, &columns), "MatGetLocalSize");
  return {rows, columns};
}
//-----------------------------------------------------------------------------
Matrix dolfinx_mortar::create_from_rows(MPI_Comm comm, PetscInt local_rows,
                                        PetscInt local_columns,
                                        std::span<const PetscInt> offsets,
                                        std::span<const PetscInt> columns,
                                        std::span<const double> values,
                                        int block_size)
{
  Matrix A;
  check(MatCreate(comm, A.put()), "MatCreate");
  check(MatSetSizes(A.get(), local_rows, local_columns, PETSC_DETERMINE,
                    PETSC_DETERMINE),
        "MatSetSizes");
  check(MatSetType(A.get(), MATAIJ), "MatSetType");
  if (block_size > 1)
    check(MatSetBlockSize(A.get(), block_size), "MatSetBlockSize");
  check(MatSeqAIJSetPreallocationCSR(A.get(), offsets.data(), columns.data(),
                                     values.data()),
        "MatSeqAIJSetPreallocationCSR");
  check(MatMPIAIJSetPreallocationCSR(A.get(), offsets.data(), columns.data(),
                                     values.data()),
        "MatMPIAIJSetPreallocationCSR");
  // Sums of such matrices have entries elsewhere
  check(MatSetOption(A.get(), MAT_NEW_NONZERO_ALLOCATION_ERR, PETSC_FALSE),
        "MatSetOption");
  return A;
}
//-----------------------------------------------------------------------------
RowStorage::RowStorage(std::size_t num_rows, std::size_t capacity,
                       PetscInt first_column, PetscInt num_columns)
    : _capacity_rows(num_rows), _capacity(capacity),
      _first_column(first_column), _num_columns(num_columns)
{
  for (Part* part : {&_own, &_others})
  {
    part->offsets = std::make_unique_for_overwrite<PetscInt[]>(num_rows + 1);
    part->columns = std::make_unique_for_overwrite<PetscInt[]>(capacity);
    part->values = std::make_unique_for_overwrite<double[]>(capacity);
    part->offsets[0] = 0;
  }
}
//-----------------------------------------------------------------------------
void RowStorage::append(std::span<const PetscInt> columns,
                        std::span<const double> values, double factor)
{
  std::size_t end_own = _own.offsets[_num_rows],
              end_others = _others.offsets[_num_rows];
  if (_num_rows == _capacity_rows
      or std::max(end_own, end_others) + columns.size() > _capacity)
    throw std::length_error("More entries of a matrix than were announced.");
  const PetscInt end_column = _first_column + _num_columns;
  if (!columns.empty() and columns.front() >= _first_column
      and columns.back() < end_column)
  {
    // As all rows of one rank, and nearly all of several
    std::ranges::transform(columns, _own.columns.get() + end_own,
                           [this](PetscInt c) { return c - _first_column; });
    std::ranges::transform(values, _own.values.get() + end_own,
                           [factor](double v) { return factor * v; });
    end_own += columns.size();
    columns = {};
  }
  for (std::size_t k = 0; k < columns.size(); ++k)
  {
    const PetscInt column = columns[k] - _first_column;
    const bool own = column >= 0 and column < _num_columns;
    Part& part = own ? _own : _others;
    std::size_t& end = own ? end_own : end_others;
    part.columns[end] = own ? column : columns[k];
    part.values[end++] = factor * values[k];
  }
  ++_num_rows;
  _own.offsets[_num_rows] = end_own;
  _others.offsets[_num_rows] = end_others;
}
//-----------------------------------------------------------------------------
Matrix dolfinx_mortar::create_from_rows(MPI_Comm comm, RowStorage&& rows,
                                        int block_size)
{
  auto owner = std::make_unique<RowStorage>(std::move(rows));
  RowStorage::Part &own = owner->own(), &others = owner->others();
  const PetscInt n = owner->num_rows(), columns = owner->num_columns();
  int num_ranks;
  MPI_Comm_size(comm, &num_ranks);
  Matrix A;
  if (num_ranks == 1)
  {
    check(MatCreateSeqAIJWithArrays(comm, n, columns, own.offsets.get(),
                                    own.columns.get(), own.values.get(),
                                    A.put()),
          "MatCreateSeqAIJWithArrays");
  }
  else
  {
    check(MatCreateMPIAIJWithSplitArrays(
              comm, n, columns, PETSC_DETERMINE, PETSC_DETERMINE,
              own.offsets.get(), own.columns.get(), own.values.get(),
              others.offsets.get(), others.columns.get(), others.values.get(),
              A.put()),
          "MatCreateMPIAIJWithSplitArrays");
  }
  if (block_size > 1)
    check(MatSetBlockSize(A.get(), block_size), "MatSetBlockSize");
  // Sums of such matrices have entries elsewhere
  check(MatSetOption(A.get(), MAT_NEW_NONZERO_LOCATION_ERR, PETSC_FALSE),
        "MatSetOption");
  keep(A.get(), std::move(owner));
  return A;
}
//-----------------------------------------------------------------------------
Matrix dolfinx_mortar::create_from_entries(MPI_Comm comm, PetscInt local_rows,
                                           PetscInt local_columns,
                                           std::span<const Entry> entries)
{
  std::vector<Eigen::Triplet<double, PetscInt>> triplets;
  triplets.reserve(entries.size());
  for (const Entry& e : entries)
  {
    triplets.emplace_back(e.row, e.column, e.value);
  }
  Eigen::SparseMatrix<double, Eigen::RowMajor, PetscInt> S(local_rows,
                                                           local_columns);
  S.setFromTriplets(triplets.begin(), triplets.end());
  const PetscInt first = first_of_rank(comm, local_columns);
  std::vector<PetscInt> columns(S.innerIndexPtr(),
                                S.innerIndexPtr() + S.nonZeros());
  for (PetscInt& c : columns)
    c += first;
  return create_from_rows(
      comm, local_rows, local_columns,
      {S.outerIndexPtr(), static_cast<std::size_t>(local_rows + 1)}, columns,
      {S.valuePtr(), columns.size()});
}
//-----------------------------------------------------------------------------
std::vector<double> dolfinx_mortar::multiply(Mat A, std::span<const double> x)
{
  std::vector<double> y(local_size(A).first);
  check(MatMult(A, view(A, false, x).get(), view(A, true, y).get()), "MatMult");
  return y;
}
//-----------------------------------------------------------------------------
std::vector<double>
dolfinx_mortar::multiply_transposed(Mat A, std::span<const double> x)
{
  std::vector<double> y(local_size(A).second);
  check(MatMultTranspose(A, view(A, true, x).get(), view(A, false, y).get()),
        "MatMultTranspose");
  return y;
}
//-----------------------------------------------------------------------------
Matrix dolfinx_mortar::multiply(Mat A, Mat B)
{
  Matrix C;
  check(MatMatMult(A, B, MAT_INITIAL_MATRIX, PETSC_DEFAULT, C.put()),
        "MatMatMult");
  return C;
}
//-----------------------------------------------------------------------------
Matrix dolfinx_mortar::transpose(Mat A)
{
  Matrix At;
  check(MatTranspose(A, MAT_INITIAL_MATRIX, At.put()), "MatTranspose");
  return At;
}
//-----------------------------------------------------------------------------
Matrix dolfinx_mortar::duplicate(Mat A)
{
  Matrix B;
  check(MatDuplicate(A, MAT_COPY_VALUES, B.put()), "MatDuplicate");
  return B;
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::add(Mat Y, double factor, Mat X)
{
  check(MatSetOption(Y, MAT_NEW_NONZERO_ALLOCATION_ERR, PETSC_FALSE),
        "MatSetOption");
  check(MatAXPY(Y, factor, X, DIFFERENT_NONZERO_PATTERN), "MatAXPY");
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::scale_rows(Mat A, std::span<const double> factors)
{
  check(MatDiagonalScale(A, view(A, true, factors).get(), nullptr),
        "MatDiagonalScale");
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::scale_columns(Mat A, std::span<const double> factors)
{
  check(MatDiagonalScale(A, nullptr, view(A, false, factors).get()),
        "MatDiagonalScale");
}
//-----------------------------------------------------------------------------
std::vector<double> dolfinx_mortar::diagonal(Mat A)
{
  Vector d;
  check(MatCreateVecs(A, nullptr, d.put()), "MatCreateVecs");
  check(MatGetDiagonal(A, d.get()), "MatGetDiagonal");
  return local_values(d.get());
}
//-----------------------------------------------------------------------------
Vector dolfinx_mortar::create_vector(MPI_Comm comm,
                                     std::span<const double> values,
                                     int block_size)
{
  Vector v;
  check(VecCreate(comm, v.put()), "VecCreate");
  check(VecSetSizes(v.get(), values.size(), PETSC_DETERMINE), "VecSetSizes");
  check(VecSetBlockSize(v.get(), block_size), "VecSetBlockSize");
  check(VecSetType(v.get(), VECSTANDARD), "VecSetType");
  set_values(v.get(), values);
  return v;
}
//-----------------------------------------------------------------------------
std::vector<double> dolfinx_mortar::local_values(Vec x)
{
  const VectorView view(x);
  return {view.get().begin(), view.get().end()};
}
//-----------------------------------------------------------------------------
void dolfinx_mortar::set_values(Vec x, std::span<const double> values)
{
  PetscScalar* data;
  check(VecGetArrayWrite(x, &data), "VecGetArrayWrite");
  std::ranges::copy(values, data);
  check(VecRestoreArrayWrite(x, &data), "VecRestoreArrayWrite");
}
//-----------------------------------------------------------------------------
std::int64_t dolfinx_mortar::first_of_rank(MPI_Comm comm, std::int64_t size)
{
  std::int64_t end = 0;
  MPI_Scan(&size, &end, 1, MPI_INT64_T, MPI_SUM, comm);
  return end - size;
}
//-----------------------------------------------------------------------------
double dolfinx_mortar::sum(MPI_Comm comm, double value)
{
  MPI_Allreduce(MPI_IN_PLACE, &value, 1, MPI_DOUBLE, MPI_SUM, comm);
  return value;
}
//-----------------------------------------------------------------------------
std::int64_t dolfinx_mortar::sum(MPI_Comm comm, std::int64_t value)
{
  MPI_Allreduce(MPI_IN_PLACE, &value, 1, MPI_INT64_T, MPI_SUM, comm);
  return value;
}
//-----------------------------------------------------------------------------
std::vector<double> dolfinx_mortar::sum(MPI_Comm comm,
                                        std::vector<double> values)
{
  MPI_Allreduce(MPI_IN_PLACE, values.data(), values.size(), MPI_DOUBLE, MPI_SUM,
                comm);
  return values;
}
//-----------------------------------------------------------------------------
double dolfinx_mortar::max(MPI_Comm comm, double value)
{
  MPI_Allreduce(MPI_IN_PLACE, &value, 1, MPI_DOUBLE, MPI_MAX, comm);
  return value;
}
//-----------------------------------------------------------------------------
double dolfinx_mortar::min(MPI_Comm comm, double value)
{
  MPI_Allreduce(MPI_IN_PLACE, &value, 1, MPI_DOUBLE, MPI_MIN, comm);
  return value;
}
//-----------------------------------------------------------------------------
bool dolfinx_mortar::any(MPI_Comm comm, bool value)
{
  int flag = value;
  MPI_Allreduce(MPI_IN_PLACE, &flag, 1, MPI_INT, MPI_LOR, comm);
  return flag;
}
//-----------------------------------------------------------------------------
double dolfinx_mortar::norm(MPI_Comm comm, std::span<const double> values)
{
  double square = 0;
  for (double v : values)
    square += v * v;
  return std::sqrt(sum(comm, square));
}
//-----------------------------------------------------------------------------
double dolfinx_mortar::max_norm(MPI_Comm comm, std::span<const double> values)
{
  double largest = 0;
  for (double v : values)
    largest = std::max(largest, std::abs(v));
  return max(comm, largest);
}
