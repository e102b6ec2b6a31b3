# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Linear solvers of the coupled Newton system.

The system in displacements and multipliers is

    K du + Bᵀ dz = r_u
    C_u du + C_z dz = r_z

Dual multipliers are condensed exactly: with the rows of the slave nodes in the transformed basis
B T = [D̃, …], D̃ diagonal, the multipliers of the nodes *S* in contact (or tied) follow from their
nodes' own equilibrium,

    dz_S = D̃⁻¹ [Tᵀ (r_u - K du)]_S,

and what is left is a system in du alone: no saddle point.
"""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt


@dataclass
class NewtonSystem:
    """Blocks of the linearised system, rows of Dirichlet dofs not yet treated.

    Attributes:
        K: Tangent with the derivative of the contact forces, n_u by n_u.
        B: Mortar matrix [D, -M], n_z by n_u.
        B_tilde: The same with slave columns in the transformed basis.
        T: Basis transformation, n_u by n_u, or None where it is the identity.
        C_u: Derivative of the constraints by displacements, n_z by n_u; rows outside ``active``
            are empty.
        C_z: Derivative of the constraints by multipliers, n_z by n_z.
        active: Local multiplier dofs (ascending) whose constraint involves displacements.
        own: Local displacement dof of the node of each of ``active``.
        diagonal: Entry of D̃ of each of ``active``.
        fixed: Local displacement dofs with a Dirichlet condition.
        tied: True where all active constraints are ties (then K may be kept symmetric).
    """

    K: PETSc.Mat
    B: PETSc.Mat
    B_tilde: PETSc.Mat
    T: PETSc.Mat | None
    C_u: PETSc.Mat
    C_z: PETSc.Mat
    active: npt.NDArray[np.int32]
    own: npt.NDArray[np.int32]
    diagonal: npt.NDArray[np.float64]
    fixed: npt.NDArray[np.int32]
    tied: bool


def _vector(A: PETSc.Mat, values: npt.NDArray[np.float64], side: str) -> PETSc.Vec:
    v = A.createVecLeft() if side == "left" else A.createVecRight()
    v.array[:] = values
    return v


def _selection(
    comm, rows: int, columns: int, i: npt.NDArray[np.int32], j: npt.NDArray[np.int32]
) -> PETSc.Mat:
    """Matrix of local sizes (rows, columns) with ones at the rank's own (i, j), i ascending."""
    first = comm.exscan(columns) or 0
    indptr = np.zeros(rows + 1, dtype=PETSc.IntType)
    indptr[1 + i] = 1
    indptr = np.cumsum(indptr, dtype=PETSc.IntType)
    return PETSc.Mat().createAIJ(
        ((rows, None), (columns, None)),
        csr=(indptr, (first + j).astype(PETSc.IntType), np.ones(len(i))),
        comm=comm,
    )


class LinearSolver:
    """Solver of the condensed, or of the saddle point, system.

    Args:
        comm: Communicator.
        prefix: Prefix of the PETSc options of the Krylov solver.
        condense: Condense the multipliers.
    """

    def __init__(self, comm, prefix: str, condense: bool):
        self.ksp = PETSc.KSP().create(comm)
        self.ksp.setOptionsPrefix(prefix)
        self.condense = condense
        self.comm = comm
        self._near_nullspace: list[PETSc.Vec] | None = None

    def set_near_nullspace(self, vectors: list[PETSc.Vec]) -> None:
        """Rigid body modes of each body, for algebraic multigrid on the condensed system."""
        self._near_nullspace = vectors

    def solve(
        self, s: NewtonSystem, r_u: npt.NDArray[np.float64], r_z: npt.NDArray[np.float64]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Solve for (du, dz); entries of r_u at Dirichlet dofs are the steps of these dofs."""
        return (self._condensed if self.condense else self._saddle)(s, r_u, r_z)

    def _run(self, A: PETSc.Mat, b: PETSc.Vec) -> PETSc.Vec:
        A.setBlockSize(1)
        self.ksp.setOperators(A)
        x = b.duplicate()
        self.ksp.solve(b, x)
        return x

    # -- Saddle point ---------------------------------------------------------

    def _saddle(self, s, r_u, r_z):
        n_u, n_z = s.K.getLocalSize()[0], s.C_z.getLocalSize()[0]
        Bt = s.B.transpose(PETSc.Mat())
        nest = PETSc.Mat().createNest([[s.K, Bt], [s.C_u, s.C_z]], comm=self.comm)
        A = nest.convert("aij", PETSc.Mat())
        b = A.createVecLeft()
        b.array[:n_u] = r_u
        b.array[n_u:] = r_z
        first = A.getOwnershipRange()[0]
        A.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        A.zeroRowsColumns((first + s.fixed).astype(PETSc.IntType), diag=1.0, x=b, b=b)
        x = self._run(A, b)
        du, dz = x.array[:n_u].copy(), x.array[n_u : n_u + n_z].copy()
        for obj in (Bt, nest, A, b, x):
            obj.destroy()
        return du, dz

    # -- Condensation -----------------------------------------------------------

    def _condensed(self, s, r_u, r_z):
        n_u, n_z = s.K.getLocalSize()[0], s.C_z.getLocalSize()[0]
        free = np.ones(n_u)
        free[s.fixed] = 0.0
        is_active = np.zeros(n_z, dtype=bool)
        is_active[s.active] = True

        # Multipliers that are not active: C_z is the identity
        dz_rest = np.where(is_active, 0.0, r_z)
        v = _vector(s.B, dz_rest, "left")
        w = s.B.createVecRight()
        s.B.multTranspose(v, w)
        r_1 = r_u - w.array * free
        r_test = r_1 * free

        # E puts active multipliers on their nodes, Y = (B̃_Rᵀ + E C_z) D̃⁻¹
        E = _selection(self.comm, n_u, n_z, *_sorted(s.own, s.active))
        inverse = np.zeros(n_z)
        inverse[s.active] = 1.0 / s.diagonal
        Et = E.transpose(PETSc.Mat())
        Y = s.B_tilde.transpose(PETSc.Mat())
        inverse_vec = _vector(s.C_z, inverse, "right")
        Y.diagonalScale(R=inverse_vec)
        Y.axpy(-1.0, E)
        EC = E.matMult(s.C_z)
        EC.diagonalScale(R=inverse_vec)
        Y.axpy(1.0, EC)

        # L = (I - E Eᵀ - Y Eᵀ) Tᵀ, with the unknown reactions at Dirichlet dofs left out
        L = Y.matMult(Et)
        L.scale(-1.0)
        diagonal = np.ones(n_u)
        diagonal[s.own] = 0.0
        keep = np.flatnonzero(diagonal).astype(np.int32)
        identity = _selection(self.comm, n_u, n_u, keep, keep)
        L.axpy(1.0, identity)
        if s.T is not None:
            Tt = s.T.transpose(PETSc.Mat())
            L_new = L.matMult(Tt)
            L.destroy()
            Tt.destroy()
            L = L_new
        L.diagonalScale(R=_vector(L, free, "right"))

        A = L.matMult(s.K)
        EC_u = E.matMult(s.C_u)
        A.axpy(1.0, EC_u)
        t = _vector(L, r_test, "right")
        b = L.createVecLeft()
        L.mult(t, b)
        Cz_rest = s.C_z.createVecLeft()
        s.C_z.mult(v, Cz_rest)
        b.array[s.own] += r_z[s.active] - Cz_rest.array[s.active]
        b.array[s.fixed] = r_u[s.fixed]
        first = A.getOwnershipRange()[0]
        fixed = (first + s.fixed).astype(PETSc.IntType)
        A.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        A.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        A.zeroRowsColumns(fixed, diag=1.0, x=b, b=b)
        x = self._run(A, b)
        du = x.array.copy()

        # Multipliers from the equilibrium of the slave nodes
        s.K.mult(x, b)
        t.array[:] = r_test - b.array * free
        if s.T is not None:
            w = t.duplicate()
            s.T.multTranspose(t, w)
        else:
            w = t
        dz = dz_rest
        dz[s.active] = w.array[s.own] / s.diagonal
        for obj in (E, Et, Y, EC, L, identity, A, EC_u, t, b, x, v):
            obj.destroy()
        return du, dz


def _sorted(i, j):
    order = np.argsort(i, kind="stable")
    return i[order].astype(np.int32), j[order].astype(np.int32)
