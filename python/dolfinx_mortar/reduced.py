# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Krylov solution of the condensed system through a symmetric one."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from . import cpp, sparse
from .elimination import Elimination
from .errors import ConvergenceError
from .linearisation import NewtonSystem

#: What to say of a factorisation that fails
SINGULAR = "the system is singular. A body may not be held: check the Dirichlet conditions."


class CondensedOperator:
    """The condensed system as products: A x = (I_R + N)(K + K_c) x + E C_u x.

    Args:
        s: Newton system.
        N, E: See :meth:`LinearSolver._row_operator`.
        scale: Factors of the owned rows, shape (n_u,).
    """

    def __init__(self, s: NewtonSystem, N: PETSc.Mat, E: PETSc.Mat, scale: npt.NDArray[np.float64]):
        self._s, self._N, self._E, self._scale = s, N, E, scale
        self._kept = np.ones(len(scale))
        self._kept[s.own] = 0.0
        self._f, self._c = s.K.createVecLeft(), s.C_u.createVecLeft()

    def mult(self, mat: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Form y = A x, with unit rows at Dirichlet dofs."""
        s = self._s
        s.K.mult(x, self._f)
        if s.K_c is not None:
            s.K_c.multAdd(x, self._f, self._f)
        self._N.mult(self._f, y)
        s.C_u.mult(x, self._c)
        self._E.multAdd(self._c, y, y)
        y.array[:] += self._kept * self._f.array_r
        y.array[:] *= self._scale
        y.array[s.fixed] = x.array_r[s.fixed]


class ReducedPreconditioner:
    """Preconditioner of the condensed system by one of a symmetric system.

    With Π the constrained directions of the nodes of S and Q the matrix that satisfies constraints
    at their own nodes (``Elimination.solve_constraints``; Π D̃⁻¹ where a node has one multiplier),
    motions without a change of the constraints are, but for the turning of normals, du = (I + W) w
    with

        I + W = T (I - Q B̃).

    On these the tangent is (I + W)ᵀ (K + Bᵀ S B) (I + W), as definite as K: that is what ``inner``
    inverts. S is what friction resists across the direction of slip, which turns with the motion;
    that friction along it follows the pressure is left out, for it is not symmetric. Motions in
    the directions of the constraints follow from the constraints, node by node. Dirichlet dofs are
    outside of all this: their rows are unit rows of the condensed system, and of the preconditioner
    too.

    Args:
        comm: Communicator.
        prefix: Prefix of the options of ``inner``.
        x: Positions of the owned displacement dofs, shape (n_u,), for rigid body modes.
    """

    def __init__(self, comm, prefix: str, x: npt.NDArray[np.float64]):
        self._comm, self._prefix = comm, prefix
        self._inner: PETSc.PC | None = None
        coordinates = PETSc.Vec().createMPI((len(x), None), bsize=3, comm=comm)
        coordinates.array[:] = x
        self._modes = PETSc.NullSpace().createRigidBody(coordinates)
        self._W: PETSc.Mat | None = None

    def release(self) -> None:
        """Free what belongs to the last system. Collective."""
        sparse.destroy(self._inner, self._W)
        self._inner = self._W = None

    def prepare(
        self, s: NewtonSystem, e: Elimination, E: PETSc.Mat, scale: npt.NDArray[np.float64]
    ) -> None:
        """Set up for a system. Collective.

        Args:
            s: Newton system.
            e: Elimination of its multipliers.
            E: See :meth:`LinearSolver._row_operator`.
            scale: Factors of the owned rows, shape (n_u,).
        """
        self._s, self._e, self._E, self._scale = s, e, E, scale
        self._free = np.eye(3) - e.constrained
        stiffness = s.K.getDiagonal()
        self._mean = stiffness.sum() / stiffness.getSize()
        # What belongs to the last system is large
        self.release()
        self._W = self._form_W()
        A = self._form_operator()
        self._inner = PETSc.PC().create(self._comm)
        self._inner.setOptionsPrefix(self._prefix)
        self._inner.setOperators(A)
        self._inner.setFromOptions()
        self._inner.setUp()
        A.destroy()
        # PETSc leaves it to the caller to ask
        if sparse.any_rank(self._comm, bool(self._inner.getFailedReason())):
            raise ConvergenceError(f"The preconditioner could not be set up: {SINGULAR}")
        self._blocks = self._invert_constraints()

    def _form_W(self) -> PETSc.Mat:
        """See the class."""
        s = self._s
        W = self._e.solve_constraints.matMult(s.B_tilde)
        W.scale(-1.0)
        if s.T is not None:
            TW = s.T.matMult(W)
            W.axpy(1.0, TW)
            W.axpy(1.0, s.T)
            TW.destroy()
        return W

    def _form_operator(self) -> PETSc.Mat:
        """(I + W)ᵀ (K + Bᵀ S B) (I + W), as K and the few entries that are to be added to it."""
        s = self._s
        delta = s.K.matMult(self._W)
        more = self._W.transposeMatMult(s.K)
        WKW = self._W.transposeMatMult(delta)
        delta.axpy(1.0, more)
        delta.axpy(1.0, WKW)
        self._add_friction(delta)
        # Unit-like entries in the constrained directions
        units = self._constrained_units()
        delta.axpy(1.0, units)
        A = cpp.combine_rows(s.K, delta, np.zeros(s.K.getLocalSize()[0], dtype=np.int8))
        sparse.destroy(more, WKW, delta, units)
        start = A.getOwnershipRange()[0]
        A.zeroRowsColumns((start + s.fixed).astype(PETSc.IntType), diag=self._mean)
        A.setNearNullSpace(self._modes)
        A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        return A

    def _add_friction(self, A: PETSc.Mat) -> None:
        """Add what friction resists across the directions of slip, (I + W)ᵀ Bᵀ S B (I + W)."""
        s, nodes = self._s, self._s.nodes
        # Springs that are stiffer than the bodies would leave out of account that pressures, and
        # friction with them, follow the motion too
        size = np.linalg.norm(nodes.across, axis=(1, 2)) * nodes.diagonal**2
        most = np.abs(s.K.getDiagonal().array[nodes.own])
        S = nodes.across * np.minimum(1.0, most / np.maximum(size, 1e-300))[:, None, None]
        node, i, j = np.nonzero(S)
        if not sparse.any_rank(self._comm, len(node) > 0):
            return
        n_z, values = nodes.size_z, S[node, i, j]
        springs = sparse.local_entries(self._comm, n_z, n_z, 3 * node + i, 3 * node + j, values)
        motion = s.B.matMult(self._W)
        motion.axpy(1.0, s.B)
        traction = springs.matMult(motion)
        forces = motion.transposeMatMult(traction)
        A.axpy(1.0, forces)
        sparse.destroy(springs, motion, traction, forces)

    def _constrained_units(self) -> PETSc.Mat:
        """Π times the mean stiffness."""
        n_u = self._s.K.getLocalSize()[0]
        blocks = self._e.constrained
        node, i, j = np.nonzero(blocks)
        values = self._mean * blocks[node, i, j]
        return sparse.local_entries(self._comm, n_u, n_u, 3 * node + i, 3 * node + j, values)

    def _invert_constraints(self) -> npt.NDArray[np.float64]:
        """Invert the blocks of the constraints at their own nodes, Π E C_u T Π."""
        s, Pi = self._s, self._e.constrained
        C = self._E.matMult(s.C_u)
        if s.T is not None:
            CT = C.matMult(s.T)
            C.axpy(1.0, CT)
            CT.destroy()
        indptr, columns, values = C.getDiagonalBlock().getValuesCSR()
        rows = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
        own = rows // 3 == columns // 3
        rows, columns = rows[own], columns[own]
        blocks = np.zeros_like(Pi)
        blocks[rows // 3, rows % 3, columns % 3] = values[own]
        C.destroy()
        return np.linalg.inv(Pi @ blocks @ Pi + self._free)

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Approximate solution y of the condensed system for the right-hand side x."""
        s, e = self._s, self._e
        r = x.array_r
        r_c = np.zeros(len(r))
        r_c[s.own] = r[s.own] / self._scale[s.own]
        r_c = r_c.reshape(-1, 3)
        # Motions in the directions of the constraints
        step = np.einsum("nij,njk,nkl,nl->ni", e.constrained, self._blocks, e.constrained, r_c)
        step = step.ravel()
        if s.T is not None:
            step += sparse.product(s.T, step)

        # Equilibrium of what is not constrained: the rows of S hold that of their own nodes
        across = -e.weight * np.einsum("nij,nj->ni", self._free, r_c).ravel()
        moved = sparse.product_transposed(s.B_tilde, sparse.product(e.L, across))
        moved[s.own] = 0.0  # without the own entries of B̃
        rho, w = s.K.createVecLeft(), s.K.createVecRight()
        rho.array[:] = r
        rho.array[s.own] = across[s.own]
        rho.array[:] += moved
        # Where Dirichlet dofs meet the contact, as at planes of symmetry, `moved` is their reaction
        rho.array[s.fixed] = 0.0
        self._inner.apply(rho, w)
        self._W.multAdd(w, w, y)
        y.array[:] += step
        y.array[s.fixed] = r[s.fixed]
