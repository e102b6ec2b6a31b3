// Copyright (C) 2026 the dolfinx_mortar developers
// SPDX-License-Identifier: MIT

#pragma once

#include <cstdint>
#include <memory>
#include <petscksp.h>
#include <petscmat.h>
#include <petscsnes.h>
#include <petscvec.h>
#include <span>
#include <utility>
#include <vector>

namespace dolfinx_mortar
{
/// @brief Turn an error code of PETSc into an exception.
/// @param[in] what Name of the function that was called.
/// @throw std::runtime_error The code is that of an error.
void check(PetscErrorCode code, const char* what);

/// @brief While one of these lives PETSc prints no errors; what it says of them
/// is in the exceptions of check.
class PetscErrorText
{
public:
  PetscErrorText();
  PetscErrorText(const PetscErrorText&) = delete;
  PetscErrorText& operator=(const PetscErrorText&) = delete;
  ~PetscErrorText();
};

/// @brief Owner of a reference to a PETSc object.
///
/// Copies share the object. All ranks of its communicator give up the last
/// reference together.
template <typename T, PetscErrorCode (*destroy)(T*)>
class PetscHandle
{
public:
  PetscHandle() = default;

  /// @brief Take over a reference.
  explicit PetscHandle(T object) : _object(object) {}

  PetscHandle(const PetscHandle& other) : _object(other._object)
  {
    if (_object)
      PetscObjectReference(reinterpret_cast<PetscObject>(_object));
  }

  PetscHandle(PetscHandle&& other) noexcept
      : _object(std::exchange(other._object, nullptr))
  {
  }

  PetscHandle& operator=(PetscHandle other) noexcept
  {
    std::swap(_object, other._object);
    return *this;
  }

  ~PetscHandle() { reset(); }

  /// @brief Give up the reference.
  void reset()
  {
    if (_object)
      destroy(&_object);
    _object = nullptr;
  }

  /// @brief The object; it stays with this owner.
  T get() const { return _object; }

  explicit operator bool() const { return _object != nullptr; }

  /// @brief Where a function of PETSc puts a new object.
  T* put()
  {
    reset();
    return &_object;
  }

private:
  T _object = nullptr;
};

using Matrix = PetscHandle<Mat, MatDestroy>;
using Vector = PetscHandle<Vec, VecDestroy>;

/// Entry of a matrix, with local row and local column.
struct Entry
{
  std::int32_t row, column;
  double value;
};

/// @brief Local number of rows and of columns of a matrix.
std::pair<PetscInt, PetscInt> local_size(Mat A);

/// @brief Matrix from the rows of this rank. Collective.
/// @param[in] comm Communicator.
/// @param[in] local_rows,local_columns Local size.
/// @param[in] offsets Where the entries of each local row begin, shape
/// (local_rows + 1).
/// @param[in] columns Global columns, ascending within a row.
/// @param[in] values Entries.
/// @param[in] block_size Size of the blocks that rows come in.
Matrix create_from_rows(MPI_Comm comm, PetscInt local_rows,
                        PetscInt local_columns,
                        std::span<const PetscInt> offsets,
                        std::span<const PetscInt> columns,
                        std::span<const double> values, int block_size = 1);

/// @brief Rows of a matrix, one after the other, in memory that a matrix can
/// take over. As in such a matrix, entries in columns of this rank and in those
/// of others are apart.
class RowStorage
{
public:
  /// Entries in some of the columns
  struct Part
  {
    std::unique_ptr<PetscInt[]> offsets, columns;
    std::unique_ptr<double[]> values;
  };

  /// @param[in] num_rows Number of rows.
  /// @param[in] capacity Number of entries there can be; memory that is never
  /// written costs nothing.
  /// @param[in] first_column,num_columns Columns of this rank.
  RowStorage(std::size_t num_rows, std::size_t capacity, PetscInt first_column,
             PetscInt num_columns);

  /// @brief Append a row, times a factor.
  /// @param[in] columns Global columns, ascending.
  /// @param[in] values Entries.
  void append(std::span<const PetscInt> columns, std::span<const double> values,
              double factor = 1);

  std::size_t num_rows() const { return _num_rows; }
  PetscInt num_columns() const { return _num_columns; }

  /// Entries in columns of this rank, numbered from its first one
  Part& own() { return _own; }

  /// Entries in columns of other ranks
  Part& others() { return _others; }

private:
  std::size_t _num_rows = 0, _capacity_rows, _capacity;
  PetscInt _first_column, _num_columns;
  Part _own, _others;
};

/// @brief Matrix from the rows of this rank, which are not copied. Collective.
/// @param[in] comm Communicator.
/// @param[in] rows All rows of this rank.
/// @param[in] block_size Size of the blocks that rows come in.
Matrix create_from_rows(MPI_Comm comm, RowStorage&& rows, int block_size = 1);

/// @brief Matrix all of whose entries are in the rank's own columns.
/// Collective.
/// @param[in] comm Communicator.
/// @param[in] local_rows,local_columns Local size.
/// @param[in] entries Entries, in any order; those of one place are added up.
Matrix create_from_entries(MPI_Comm comm, PetscInt local_rows,
                           PetscInt local_columns,
                           std::span<const Entry> entries);

/// @brief A x for the values of this rank. Collective.
std::vector<double> multiply(Mat A, std::span<const double> x);

/// @brief Aᵀ x for the values of this rank. Collective.
std::vector<double> multiply_transposed(Mat A, std::span<const double> x);

/// @brief A B. Collective.
Matrix multiply(Mat A, Mat B);

/// @brief Aᵀ as a matrix of its own. Collective.
Matrix transpose(Mat A);

/// @brief A copy with its own values. Collective.
Matrix duplicate(Mat A);

/// @brief Y += factor X, of any patterns. Collective.
void add(Mat Y, double factor, Mat X);

/// @brief Scale rows in place. Collective.
/// @param[in] factors Factors of this rank's rows.
void scale_rows(Mat A, std::span<const double> factors);

/// @brief Scale columns in place. Collective.
/// @param[in] factors Factors of this rank's columns.
void scale_columns(Mat A, std::span<const double> factors);

/// @brief Diagonal of this rank's rows. Collective.
std::vector<double> diagonal(Mat A);

/// @brief Entries of a local row of an assembled AIJ matrix.
class MatrixRow
{
public:
  /// @param[in] A Matrix.
  /// @param[in] row Global row, one of this rank's.
  MatrixRow(Mat A, PetscInt row) : _A(A), _row(row)
  {
    check(MatGetRow(_A, _row, &_size, &_columns, &_values), "MatGetRow");
  }
  MatrixRow(const MatrixRow&) = delete;
  MatrixRow& operator=(const MatrixRow&) = delete;
  ~MatrixRow() { MatRestoreRow(_A, _row, &_size, &_columns, &_values); }

  /// Global columns, ascending
  std::span<const PetscInt> columns() const
  {
    return {_columns, static_cast<std::size_t>(_size)};
  }

  std::span<const PetscScalar> values() const
  {
    return {_values, static_cast<std::size_t>(_size)};
  }

private:
  Mat _A;
  PetscInt _row, _size = 0;
  const PetscInt* _columns = nullptr;
  const PetscScalar* _values = nullptr;
};

/// @brief Vector with a copy of the values of this rank. Collective.
/// @param[in] block_size Size of the blocks that values come in.
Vector create_vector(MPI_Comm comm, std::span<const double> values,
                     int block_size = 1);

/// @brief Copy of the values of this rank.
std::vector<double> local_values(Vec x);

/// @brief Set the values of this rank.
void set_values(Vec x, std::span<const double> values);

/// @brief Values of this rank, read-only, as long as this lives.
class VectorView
{
public:
  explicit VectorView(Vec x) : _x(x)
  {
    check(VecGetLocalSize(x, &_size), "VecGetLocalSize");
    check(VecGetArrayRead(x, &_data), "VecGetArrayRead");
  }
  VectorView(const VectorView&) = delete;
  VectorView& operator=(const VectorView&) = delete;
  ~VectorView() { VecRestoreArrayRead(_x, &_data); }

  std::span<const double> get() const
  {
    return {_data, static_cast<std::size_t>(_size)};
  }

private:
  Vec _x;
  PetscInt _size = 0;
  const PetscScalar* _data = nullptr;
};

/// @brief First of this rank's `size` consecutive numbers. Collective.
std::int64_t first_of_rank(MPI_Comm comm, std::int64_t size);

/// @brief Sum over all ranks. Collective.
double sum(MPI_Comm comm, double value);
std::int64_t sum(MPI_Comm comm, std::int64_t value);
std::vector<double> sum(MPI_Comm comm, std::vector<double> values);

/// @brief Largest value of all ranks. Collective.
double max(MPI_Comm comm, double value);

/// @brief Smallest value of all ranks. Collective.
double min(MPI_Comm comm, double value);

/// @brief Whether something is true on any rank. Collective.
bool any(MPI_Comm comm, bool value);

/// @brief Euclidean norm of distributed values. Collective.
double norm(MPI_Comm comm, std::span<const double> values);

/// @brief Largest absolute value of distributed values. Collective.
double max_norm(MPI_Comm comm, std::span<const double> values);
} // namespace dolfinx_mortar
