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

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx.common import Timer

from . import cpp, sparse
from .linearisation import NewtonSystem


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
        self._multigrid: _ReducedPreconditioner | None = None

    def set_from_options(self, x: npt.NDArray[np.float64]) -> None:
        """Take options from PETSc's database. Collective.

        An iterative solver of the condensed system is preconditioned through the symmetric
        system that is left when the constraints are eliminated; that is what ``pc_type`` is for:
        multigrid, or a Cholesky factorisation, half as large as that of the condensed system.

        Args:
            x: Positions of the owned displacement dofs, shape (n_u,), for rigid body modes.
        """
        self.ksp.setFromOptions()
        pc = self.ksp.getPC()
        direct = self.ksp.getType() == "preonly" or pc.getType() in ("none", "python")
        if self.condense and not direct:
            inner = PETSc.PC().create(self.comm)
            inner.setOptionsPrefix(self.ksp.getOptionsPrefix())
            inner.setFromOptions()
            self._multigrid = _ReducedPreconditioner(inner, x)
            pc.setType("python")
            pc.setPythonContext(self._multigrid)

    def solve(
        self, s: NewtonSystem, r_u: npt.NDArray[np.float64], r_z: npt.NDArray[np.float64]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Solve for (du, dz); entries of r_u at Dirichlet dofs are the steps of these dofs."""
        return (self._condensed if self.condense else self._saddle)(s, r_u, r_z)

    def _run(self, A: PETSc.Mat, b: PETSc.Vec) -> PETSc.Vec:
        self.ksp.setOperators(A)
        if self._multigrid is not None:
            self._multigrid.prepare(A)
        x = b.duplicate()
        with Timer("~mortar: solve"):
            self.ksp.solve(b, x)
        return x

    # -- Saddle point ---------------------------------------------------------

    def _saddle(self, s, r_u, r_z):
        n_u, n_z = s.K.getLocalSize()[0], s.C_z.getLocalSize()[0]
        Bt = s.B.transpose(PETSc.Mat())
        K = s.K.copy()
        if s.K_c is not None:
            K.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
            K.axpy(1.0, s.K_c)
        nest = PETSc.Mat().createNest([[K, Bt], [s.C_u, s.C_z]], comm=self.comm)
        A = nest.convert("aij", PETSc.Mat())
        b = A.createVecLeft()
        b.array[:n_u] = r_u
        b.array[n_u:] = r_z
        first = A.getOwnershipRange()[0]
        A.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        A.zeroRowsColumns((first + s.fixed).astype(PETSc.IntType), diag=1.0, x=b, b=b)
        x = self._run(A, b)
        du, dz = x.array[:n_u].copy(), x.array[n_u : n_u + n_z].copy()
        for obj in (Bt, K, nest, A, b, x):
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
        dz = np.where(is_active, 0.0, r_z)
        dz_vec = sparse.right(s.C_z, dz)
        r_test = sparse.left(s.K, r_u)
        if self._any(dz):
            w = s.B.createVecRight()
            s.B.multTranspose(dz_vec, w)
            r_test.axpy(-1.0, w)
        # Reactions at Dirichlet dofs are not known
        r_test.array[:] *= free

        with Timer("~mortar: condense"):
            N, E = self._row_operator(s, free)
            A = self._condensed_matrix(s, N, E)

        # Right-hand side: rows of S hold the constraints
        b = s.K.createVecLeft()
        N.mult(r_test, b)
        rows = np.ones(n_u, dtype=bool)
        rows[s.own] = False
        b.array[rows] += r_test.array[rows]
        c_rest = s.C_z.createVecLeft()
        s.C_z.mult(dz_vec, c_rest)
        b.array[s.own] += r_z[s.active] - c_rest.array[s.active]
        self._equilibrate(s, A, b)
        b.array[s.fixed] = r_u[s.fixed]
        if self._multigrid is not None:
            self._multigrid.system, self._multigrid.E = s, E
        x = self._run(A, b)
        du = x.array.copy()

        # Multipliers from the equilibrium of the slave nodes
        residual = s.K.createVecLeft()
        s.K.mult(x, residual)
        if s.K_c is not None:
            s.K_c.multAdd(x, residual, residual)
        residual.aypx(-1.0, r_test)
        residual.array[:] *= free
        if s.T is not None:
            extra = s.K.createVecLeft()
            s.T.multTranspose(residual, extra)
            residual.axpy(1.0, extra)
        dz[s.active] = residual.array[s.own] / s.diagonal
        for obj in (N, E, A, b, x, residual, r_test, dz_vec, c_rest):
            obj.destroy()
        return du, dz

    def _equilibrate(self, s, A: PETSc.Mat, b: PETSc.Vec) -> None:
        """Give constraint rows the size, and the sign, of the tangent's rows.

        Constraints are tractions, C_z = I - n nᵀ without friction: times -D̃ their tangential
        part is the equilibrium of the node again. Normal parts become as stiff as the tangent.
        """
        scale = np.ones(s.K.getLocalSize()[0])
        scale[s.own] = _row_scale(s)
        v = sparse.left(A, scale)
        A.diagonalScale(L=v)
        b.pointwiseMult(b, v)
        v.destroy()

    def _any(self, values: npt.NDArray[np.float64]) -> bool:
        return self.comm.allreduce(bool(np.any(values)), op=MPI.LOR)

    def _row_operator(self, s, free) -> tuple[PETSc.Mat, PETSc.Mat]:
        """N with condensed rows = (I_R + N) r of the residual, and E.

        E puts active multipliers on the dofs of their nodes, I_R keeps the rows that are not
        slave rows, and

            N = I_R (T - I)ᵀ - Y Eᵀ - Y Eᵀ (T - I)ᵀ,  Y = (B̃_Rᵀ + E C_z) D̃⁻¹,

        with the columns of Dirichlet dofs left out.
        """
        n_u, n_z = s.K.getLocalSize()[0], s.C_z.getLocalSize()[0]
        order = np.argsort(s.own, kind="stable")
        E = sparse.selection(self.comm, n_u, n_z, s.own[order], s.active[order])
        inverse = np.zeros(n_z)
        inverse[s.active] = 1.0 / s.diagonal
        inverse = sparse.right(s.C_z, inverse)
        Y = s.B_tilde.transpose(PETSc.Mat())
        Y.diagonalScale(R=inverse)
        Y.axpy(-1.0, E)
        EC = E.matMult(s.C_z)
        EC.diagonalScale(R=inverse)
        Y.axpy(1.0, EC)
        Et = E.transpose(PETSc.Mat())
        N = Y.matMult(Et)
        N.scale(-1.0)
        if s.T is not None:
            Tt = s.T.transpose(PETSc.Mat())
            NT = N.matMult(Tt)
            N.axpy(1.0, NT)
            keep = np.ones(n_u)
            keep[s.own] = 0.0
            Tt.diagonalScale(L=sparse.left(Tt, keep))
            N.axpy(1.0, Tt)
            Tt.destroy()
            NT.destroy()
        N.diagonalScale(R=sparse.right(N, free))
        for obj in (Y, EC, Et, inverse):
            obj.destroy()
        return N, E

    def _condensed_matrix(self, s, N, E) -> PETSc.Mat:
        """(I_R + N) (K + K_c) + E C_u, with unit rows at Dirichlet dofs."""
        Delta = N.matMult(s.K)
        EC_u = E.matMult(s.C_u)
        Delta.axpy(1.0, EC_u)
        EC_u.destroy()
        n_u = s.K.getLocalSize()[0]
        if s.K_c is not None:
            NK = N.matMult(s.K_c)
            Delta.axpy(1.0, NK)
            NK.destroy()
            rows = np.ones(n_u)
            rows[s.own] = 0.0
            K_c = s.K_c.copy()
            K_c.diagonalScale(L=sparse.left(K_c, rows))
            Delta.axpy(1.0, K_c)
            K_c.destroy()
        sources = np.zeros(n_u, dtype=np.int8)
        sources[s.own] = 1
        sources[s.fixed] = 2
        A = cpp.combine_rows(s.K, Delta, sources)
        Delta.destroy()
        return A


class _ReducedPreconditioner:
    """Preconditioner of the condensed system by multigrid on a symmetric one.

    With Π the constrained directions of the nodes of S, motions without a change of the
    constraints are, but for the turning of normals, du = Q w with Q = T (I - E Π D̃⁻¹ B̃). On
    these the tangent is Qᵀ K Q, as definite as K: that is what ``inner`` inverts. Motions in the
    directions of the constraints follow from the constraints, node by node.
    """

    def __init__(self, inner: PETSc.PC, x: npt.NDArray[np.float64]):
        self.inner = inner
        self.system: NewtonSystem | None = None
        self.E: PETSc.Mat | None = None
        comm = inner.comm.tompi4py()
        coordinates = PETSc.Vec().createMPI((len(x), None), bsize=3, comm=comm)
        coordinates.array[:] = x
        self._modes = PETSc.NullSpace().createRigidBody(coordinates)
        self._operator: PETSc.Mat | None = None

    def prepare(self, A: PETSc.Mat) -> None:
        s, E = self.system, self.E
        comm = A.comm.tompi4py()
        n_u, n_z = s.K.getLocalSize()[0], s.C_z.getLocalSize()[0]
        inverse = np.zeros(n_z)
        inverse[s.active] = 1.0 / s.diagonal
        self._projector = s.projector

        # Q = T (I - E Π D̃⁻¹ B̃)
        Pi = PETSc.Mat().createAIJ(((n_z, None), (n_z, None)), nnz=(3, 0), comm=comm)
        first = Pi.getOwnershipRange()[0]
        cpp.add_blocks(Pi, first, first, np.ascontiguousarray(s.projector))
        Pi.assemble()
        Pi.diagonalScale(R=sparse.right(Pi, inverse))
        EPi = E.matMult(Pi)
        Q = EPi.matMult(s.B_tilde)
        Q.scale(-1.0)
        everywhere = np.arange(n_u, dtype=np.int32)
        Q.axpy(1.0, sparse.selection(comm, n_u, n_u, everywhere, everywhere))
        self._T = s.T
        if s.T is not None:
            TQ = s.T.matMult(Q)
            Q.axpy(1.0, TQ)
            TQ.destroy()
        operator = s.K.PtAP(Q)
        # Unit-like rows in the constrained directions, and at Dirichlet dofs
        stiffness = s.K.getDiagonal()
        mean = stiffness.sum() / stiffness.getSize()
        Pi.destroy()
        Pi = PETSc.Mat().createAIJ(((n_z, None), (n_z, None)), nnz=(3, 0), comm=comm)
        cpp.add_blocks(Pi, first, first, mean * np.ascontiguousarray(s.projector))
        Pi.assemble()
        Et = E.transpose(PETSc.Mat())
        EPiE = E.matMult(Pi).matMult(Et)
        operator.axpy(1.0, EPiE)
        start = operator.getOwnershipRange()[0]
        operator.zeroRowsColumns((start + s.fixed).astype(PETSc.IntType), diag=mean)
        operator.setBlockSize(3)
        operator.setNearNullSpace(self._modes)
        operator.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self._mean = mean
        if self._operator is not None:
            self._operator.destroy()
        self._operator, self._Q = operator, Q
        self.inner.setOperators(operator)
        self.inner.setUp()

        # Blocks of the constraints at their own nodes, C_u T E
        C = s.C_u
        if s.T is not None:
            C = C.matMult(s.T)
            C.axpy(1.0, s.C_u)
        CE = C.matMult(E)
        blocks = np.zeros((n_z // 3, 3, 3))
        for j in range(n_z):
            columns, values = CE.getRow(first + j)
            node = (j // 3) * 3 + first
            inside = (columns >= node) & (columns < node + 3)
            blocks[j // 3, j % 3, columns[inside] - node] = values[inside]
        eye = np.eye(3)
        Pn = s.projector
        rest = eye - Pn
        self._own_blocks = np.linalg.inv(Pn @ blocks @ Pn + rest)
        self._rest = rest
        self._inverse = inverse
        CE.destroy()

    def setUp(self, pc):
        pass

    def apply(self, pc, x, y):
        s, E = self.system, self.E
        n_z = s.C_z.getLocalSize()[0]
        r = x.array_r
        scale = _row_scale(s)
        # Constraints, as tractions
        r_c = np.zeros(n_z)
        r_c[s.active] = r[s.own] / scale
        r_c = r_c.reshape(-1, 3)
        normal = np.einsum("nij,nj->ni", self._projector, r_c)
        move = np.einsum("nij,nj->ni", self._own_blocks, normal)
        move = np.einsum("nij,nj->ni", self._projector, move).ravel()

        # Equilibrium of what is not constrained
        rho = s.K.createVecLeft()
        rho.array[:] = r
        slide = np.einsum("nij,nj->ni", self._rest, r_c).ravel()
        diagonal = np.zeros(n_z)
        diagonal[s.active] = s.diagonal
        slide *= -diagonal
        rho.array[s.own] = slide[s.active]
        z = sparse.right(s.C_z, self._inverse * slide)
        w = s.K.createVecLeft()
        s.B_tilde.multTranspose(z, w)
        # Without the own entries of B̃
        w.array[s.own] = 0.0
        rho.axpy(1.0, w)

        # Motions of the constraints come first: their forces load the rest
        step = s.K.createVecRight()
        e = sparse.right(s.C_z, move)
        E.mult(e, step)
        if s.T is not None:
            extra = s.K.createVecLeft()
            s.T.mult(step, extra)
            step.axpy(1.0, extra)
        rho.array[s.fixed] *= self._mean
        self.inner.apply(rho, w)
        self._Q.mult(w, y)
        y.axpy(1.0, step)


def _row_scale(s: NewtonSystem) -> npt.NDArray[np.float64]:
    """Factors of the constraint rows, see LinearSolver._equilibrate."""
    if s.tied:
        return np.abs(s.K.getDiagonal().array[s.own]) / s.diagonal
    return -s.diagonal
