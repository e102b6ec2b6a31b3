# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""PETSc matrices and vectors, in as few words as the coupling needs."""

from __future__ import annotations

import copy

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix


def empty(comm, rows: int, columns: int) -> PETSc.Mat:
    """AIJ matrix with local sizes (rows, columns), to be filled with any pattern."""
    A = PETSc.Mat().create(comm)
    A.setSizes(((rows, None), (columns, None)))
    A.setType("aij")
    A.setUp()
    return A


def selection(
    comm,
    rows: int,
    columns: int,
    i: npt.NDArray[np.int32],
    j: npt.NDArray[np.int32],
    values: npt.NDArray[np.float64] | None = None,
) -> PETSc.Mat:
    """Matrix of local sizes (rows, columns) with one entry at each of the rank's own (i, j).

    Args:
        comm: Communicator.
        rows: Local number of rows.
        columns: Local number of columns.
        i: Local rows of the entries, ascending, each once.
        j: Local columns of the entries.
        values: Entries; ones by default.
    """
    first = comm.exscan(columns) or 0
    indptr = np.zeros(rows + 1, dtype=PETSc.IntType)
    indptr[1 + i] = 1
    indptr = np.cumsum(indptr, dtype=PETSc.IntType)
    if values is None:
        values = np.ones(len(i))
    return PETSc.Mat().createAIJ(
        ((rows, None), (columns, None)),
        csr=(indptr, (first + j).astype(PETSc.IntType), values),
        comm=comm,
    )


def local_entries(
    comm,
    rows: int,
    columns: int,
    i: npt.NDArray[np.integer],
    j: npt.NDArray[np.integer],
    values: npt.NDArray[np.float64],
) -> PETSc.Mat:
    """Matrix of local sizes (rows, columns) with entries in the rank's own columns only.

    Args:
        comm: Communicator.
        rows: Local number of rows.
        columns: Local number of columns.
        i: Local rows of the entries.
        j: Local columns; values of equal rows and columns are added.
        values: Entries.
    """
    first = comm.exscan(columns) or 0
    A = csr_matrix((values, (i, j)), shape=(rows, columns))
    A.sum_duplicates()
    return PETSc.Mat().createAIJ(
        ((rows, None), (columns, None)),
        csr=(
            A.indptr.astype(PETSc.IntType),
            (first + A.indices).astype(PETSc.IntType),
            A.data,
        ),
        comm=comm,
    )


def any_rank(comm, value: bool) -> bool:
    """Whether a value is true on any rank. Collective."""
    return comm.allreduce(bool(value), op=MPI.LOR)


def left(A: PETSc.Mat, values: npt.NDArray[np.float64]) -> PETSc.Vec:
    """Vector for the rows of a matrix with the values of this rank."""
    v = A.createVecLeft()
    v.array[:] = values
    return v


def right(A: PETSc.Mat, values: npt.NDArray[np.float64]) -> PETSc.Vec:
    """Vector for the columns of a matrix with the values of this rank."""
    v = A.createVecRight()
    v.array[:] = values
    return v


def product(A: PETSc.Mat, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """A times the vector with these values, this rank's part of both. Collective."""
    x, y = right(A, values), A.createVecLeft()
    A.mult(x, y)
    result = y.array.copy()
    destroy(x, y)
    return result


def product_transposed(A: PETSc.Mat, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Aᵀ times the vector with these values, this rank's part of both. Collective."""
    x, y = left(A, values), A.createVecRight()
    A.multTranspose(x, y)
    result = y.array.copy()
    destroy(x, y)
    return result


def scale_rows(A: PETSc.Mat, factors: npt.NDArray) -> PETSc.Mat:
    """Scale the rows of a matrix, in place. Collective."""
    v = left(A, factors)
    A.diagonalScale(L=v)
    v.destroy()
    return A


def scale_columns(A: PETSc.Mat, factors: npt.NDArray) -> PETSc.Mat:
    """Scale the columns of a matrix, in place. Collective."""
    v = right(A, factors)
    A.diagonalScale(R=v)
    v.destroy()
    return A


def share(A: PETSc.Mat | None) -> PETSc.Mat | None:
    """The same matrix once more: it lives until both have been destroyed."""
    # petsc4py's shallow copy is a new reference
    return copy.copy(A)


def destroy(*objects: PETSc.Object | None) -> None:
    """Free PETSc objects, each once. Collective."""
    for obj in {id(o): o for o in objects if o is not None}.values():
        obj.destroy()
