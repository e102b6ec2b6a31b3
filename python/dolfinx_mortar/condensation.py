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

and what is left is a system in du alone: no saddle point (see `elimination` for nodes with several
multipliers).
"""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx.common import Timer

from . import cpp, sparse
from .elimination import Elimination, eliminate
from .errors import ConvergenceError
from .linearisation import NewtonSystem
from .reduced import SINGULAR, CondensedOperator, ReducedPreconditioner


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
        self._reduced: ReducedPreconditioner | None = None

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
            self._reduced = ReducedPreconditioner(self.comm, self.ksp.getOptionsPrefix(), x)
            pc.setType("python")
            pc.setPythonContext(self._reduced)

    def destroy(self) -> None:
        """Free the Krylov solver and its preconditioner. Collective."""
        if self._reduced is not None:
            self._reduced.release()
        self.ksp.destroy()

    def solve(
        self, s: NewtonSystem, r_u: npt.NDArray[np.float64], r_z: npt.NDArray[np.float64]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Solve for (du, dz); entries of r_u at Dirichlet dofs are the steps of these dofs."""
        return (self._condensed if self.condense else self._saddle)(s, r_u, r_z)

    def _run(self, A: PETSc.Mat, b: PETSc.Vec) -> PETSc.Vec:
        self.ksp.setOperators(A)
        x = b.duplicate()
        with Timer("~mortar: solve"):
            self.ksp.solve(b, x)
        if self.ksp.getConvergedReason() < 0:
            raise ConvergenceError(self._complaint())
        # A factorisation is large, and of no use for the next system
        self.ksp.reset()
        return x

    def _complaint(self) -> str:
        """What became of a linear solver that failed, and what to do."""
        reasons = PETSc.KSP.ConvergedReason
        reason = self.ksp.getConvergedReason()
        names = {getattr(reasons, k): k for k in dir(reasons) if k.startswith("DIVERGED")}
        text = f"The linear solver failed ({names.get(reason, reason)}"
        if reason == reasons.DIVERGED_PCSETUP_FAILED or self.ksp.getType() == "preonly":
            return f"{text}): {SINGULAR}"
        text += f" after {self.ksp.getIterationNumber()} iterations of {self.ksp.getType()}"
        if reason == reasons.DIVERGED_MAX_IT:
            return f"{text}): allow more (ksp_max_it), or choose another preconditioner (pc_type)."
        # An iteration that stagnates does not tell whether the system or the solver is to blame
        return (
            f"{text}): the solver does not fit the system. Choose another preconditioner (pc_type) "
            "or iteration (ksp_type), or leave both options out: a direct solver tells whether "
            "the system itself is singular."
        )

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
        sparse.destroy(Bt, K, nest, A, b, x)
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
            r_test.array[:] -= sparse.product_transposed(s.B, dz)
        # Reactions at Dirichlet dofs are not known
        r_test.array[:] *= free

        with Timer("~mortar: condense"):
            e = eliminate(self.comm, s.nodes)
            N, E = self._row_operator(s, e, free)
            scale = np.ones(n_u)
            scale[s.own] = _row_scale(s, e)
            if self._reduced is None:
                A = sparse.scale_rows(self._condensed_matrix(s, N, E), scale)
            else:
                context = CondensedOperator(s, N, E, scale)
                A = PETSc.Mat().createPython(s.K.getSizes(), context, comm=self.comm)
                A.setUp()
                self._reduced.prepare(s, e, E, scale)

        # Right-hand side
        b = s.K.createVecLeft()
        N.mult(r_test, b)
        rows = np.ones(n_u, dtype=bool)
        rows[s.own] = False
        b.array[rows] += r_test.array[rows]
        c_rest = s.C_z.createVecLeft()
        s.C_z.mult(dz_vec, c_rest)
        c_rest.array[:] = np.where(is_active, r_z - c_rest.array, 0.0)
        E.multAdd(c_rest, b, b)
        b.array[:] *= scale
        b.array[s.fixed] = r_u[s.fixed]
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
            extra.destroy()
        z = s.C_z.createVecLeft()
        e.L.mult(residual, z)
        if e.L_c is not None:
            constraints = s.C_u.createVecLeft()
            s.C_u.mult(x, constraints)
            constraints.aypx(-1.0, c_rest)
            e.L_c.multAdd(constraints, z, z)
            constraints.destroy()
        dz[s.active] = z.array[s.active]
        e.destroy()
        sparse.destroy(N, E, A, b, x, z, residual, r_test, dz_vec, c_rest)
        return du, dz

    def _any(self, values: npt.NDArray[np.float64]) -> bool:
        return self.comm.allreduce(bool(np.any(values)), op=MPI.LOR)

    def _row_operator(self, s, e: Elimination, free) -> tuple[PETSc.Mat, PETSc.Mat]:
        """N and E with which the condensed rows are (I_R + N) r_u + E r_z.

        I_R keeps the rows that are not slave rows, B̃_R is B̃ without the entries of the multipliers
        at their own nodes, and

            N = I_R (T - I)ᵀ - Y - Y (T - I)ᵀ,  Y = B̃_Rᵀ L + H,
            E = G - B̃_Rᵀ L_c,

        with the columns of Dirichlet dofs left out of N.
        """
        n_u = s.K.getLocalSize()[0]
        B_R = s.B_tilde.transpose(PETSc.Mat())
        B_R.axpy(-1.0, e.D)
        N = B_R.matMult(e.L)
        N.axpy(1.0, e.H)
        N.scale(-1.0)
        if s.T is not None:
            Tt = s.T.transpose(PETSc.Mat())
            NT = N.matMult(Tt)
            N.axpy(1.0, NT)
            keep = np.ones(n_u)
            keep[s.own] = 0.0
            N.axpy(1.0, sparse.scale_rows(Tt, keep))
            sparse.destroy(Tt, NT)
        sparse.scale_columns(N, free)
        E = e.G.copy()
        if e.L_c is not None:
            BL = B_R.matMult(e.L_c)
            E.axpy(-1.0, BL)
            BL.destroy()
        B_R.destroy()
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
            K_c = sparse.scale_rows(s.K_c.copy(), rows)
            Delta.axpy(1.0, K_c)
            K_c.destroy()
        sources = np.zeros(n_u, dtype=np.int8)
        sources[s.own] = 1
        sources[s.fixed] = 2
        A = cpp.combine_rows(s.K, Delta, sources)
        Delta.destroy()
        return A


def _row_scale(s: NewtonSystem, e: Elimination) -> npt.NDArray[np.float64]:
    """Factors that give constraint rows the size, and the sign, of the tangent's rows.

    Constraints are tractions, C_z = I - n nᵀ without friction: times -D̃ their tangential part is
    the equilibrium of the node again. Normal parts become as stiff as the tangent.
    """
    if s.tied:
        return np.abs(s.K.getDiagonal().array[s.own]) / s.diagonal
    return -e.weight[s.own]
