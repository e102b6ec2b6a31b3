# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""What PETSc's SNES calls, and how it is set up."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from . import agreement, diagnosis
from .condensation import LinearSolver
from .diagnosis import SMALLER
from .errors import ConvergenceError
from .petsc_options import PetscOptions

if TYPE_CHECKING:
    from .problem import ContactProblem


def weak(method: Callable) -> Callable:
    """A method that does not keep its object alive.

    Python's garbage collector does not see the references that PETSc holds.
    """
    reference = weakref.WeakMethod(method)
    return lambda *args: reference()(*args)


def create(
    problem: ContactProblem, options: PetscOptions, condense: bool
) -> tuple[PETSc.SNES, PETSc.Vec, LinearSolver]:
    """Newton's iteration of a problem, a vector for its iterates, and its linear solver.

    Args:
        problem: Problem.
        options: PETSc options.
        condense: Condense the multipliers.

    Raises:
        ValueError: PETSc does not accept the options.
    """
    try:
        with options.lent():
            solver = LinearSolver(problem.comm, options.prefix, condense)
            solver.set_from_options(problem._layout.positions())
            snes, x = _create_snes(problem, options.prefix)
    except PETSc.Error as error:
        reason = str(error).splitlines()[-1].partition("] ")[2] or str(error)
        raise ValueError(
            f"PETSc does not accept petsc_options={options.given}: {reason}."
        ) from error
    options.check_names()
    return snes, x, solver


def _create_snes(problem: ContactProblem, prefix: str) -> tuple[PETSc.SNES, PETSc.Vec]:
    comm, size = problem.comm, problem._n_u + problem._n_z
    x = PETSc.Vec().createMPI((size, None), comm=comm)
    f = x.duplicate()
    context = _NewtonMatrix(weakref.proxy(problem))
    matrix = PETSc.Mat().createPython(2 * ((size, None),), context=context, comm=comm)
    matrix.setUp()
    snes = PETSc.SNES().create(comm)
    snes.setOptionsPrefix(prefix)
    snes.setType("newtonls")
    snes.setFunction(weak(problem._snes_function), f)
    snes.setJacobian(weak(problem._snes_jacobian), matrix)
    snes.setConvergenceTest(weak(problem._converged))
    proxy = weakref.proxy(problem)
    snes.setLineSearchPreCheck(lambda x, y: _shorten(proxy, x, y))
    ksp = snes.getKSP()
    ksp.setOptionsPrefix(prefix + "newton_")
    ksp.setType("preonly")
    pc = ksp.getPC()
    pc.setType("python")
    pc.setPythonContext(_NewtonSolver(weakref.proxy(problem)))
    snes.setFromOptions()
    check_type(snes, problem._coupling.has_contact)
    if PETSc.Options().hasName(prefix + "snes_monitor"):
        reference = weakref.ref(problem)
        snes.setMonitor(lambda *_: _print_sets(reference()))
    return snes, x


def check_type(snes: PETSc.SNES, has_contact: bool) -> None:
    """Refuse iterations that do not know what contact needs.

    Raises:
        ValueError: The type is not Newton's iteration with a line search, nor the one linear solve
            that bodies need which are linear and tied.
    """
    if snes.getType() != "newtonls" and (has_contact or snes.getType() != "ksponly"):
        raise ValueError(
            f"snes_type is {snes.getType()!r}, but must be 'newtonls', Newton's iteration with a "
            "line search: active sets settle in several such steps. To change the steps choose "
            "snes_linesearch_type. Without contact a linear problem may have 'ksponly'."
        )


def row_scale(problem: ContactProblem) -> npt.NDArray[np.float64] | float:
    """Factors that make forces of all residuals. Collective.

    A line search looks at the norm of all residuals together, full steps do not.
    """
    if problem._options.line_search == "basic":
        return 1.0
    K = problem._forms.tangent()
    stiffness = np.abs(K.getDiagonal().array)
    K.destroy()
    fixed = problem._coupling.fixed_dofs
    scale = np.ones(len(stiffness))
    scale[fixed] = stiffness[fixed]
    return np.concatenate([scale, problem._coupling.force_scale(stiffness)])


def _shorten(p: ContactProblem, x: PETSc.Vec, y: PETSc.Vec) -> None:
    """Shorten the step until the residual is finite (no cell is inside out).

    Raises:
        ConvergenceError: It never is; the message says what is not finite.
    """
    with agreement.alike(p.comm):
        if p._raised is not None:
            raise p._raised
        p._interrupts.handle()
    if not np.isfinite(p._norm(y.array_r)):
        raise ConvergenceError(
            "The linear solver found no finite solution. The system may be singular, as where "
            "a body is not held (check the Dirichlet conditions); a saddle point needs a "
            "solver that chooses its pivots (MUMPS)."
        )
    p._iteration_step = 1.0
    #: Where the step begins, and the length of Newton's
    p._before = x.array_r.copy(), p._norm(y.array_r)
    if p._cycle_pending:
        # A cycle of active sets: a shorter step leads out of it
        y.scale(0.5)
        p._iteration_step = 0.5
        p._cycle_pending = False
    p._forced = None
    p._failure = ""
    for _ in range(10):
        try:
            f = p._evaluate(x.array_r - y.array_r)
            failure = diagnosis.find_infinite(p, f)
        except RuntimeError as error:
            failure = str(error)
        if not failure:
            return
        p._failure = failure
        p._cached = None
        y.scale(0.5)
        p._iteration_step *= 0.5
    raise ConvergenceError(
        f"However short the step ({p._iteration_step:.0e} of Newton's), it leads to no "
        f"admissible state. {p._failure}{SMALLER}"
    )


def _print_sets(problem: ContactProblem) -> None:
    if problem.history and problem.comm.rank == 0:
        r = problem.history[-1]
        sets = ""
        if problem._coupling.has_contact:
            sets = f"active {r['active']} (stick {r['stick']}, slip {r['slip']}), "
            sets += f"{r['changes']} changed, "
        PETSc.Sys.Print(
            f"      {sets}force {r['force']:.3e}, constraint {r['constraint']:.3e}",
            comm=MPI.COMM_SELF,
        )


class _NewtonMatrix:
    """Jacobian of the coupled problem, for matrix-vector products."""

    def __init__(self, problem: ContactProblem):
        self._problem = problem

    def mult(self, mat, x, y):
        n = self._problem._n_u
        f_u, f_z = self._problem._system.multiply(x.array_r[:n], x.array_r[n:])
        y.array[:] = self._problem._row_scale * np.concatenate([f_u, f_z])


class _NewtonSolver:
    """Preconditioner of SNES's Krylov solver: solves the Newton system."""

    def __init__(self, problem: ContactProblem):
        self._problem = problem

    def setUp(self, pc):
        pass

    def apply(self, pc, x, y):
        p, n = self._problem, self._problem._n_u
        if p.comm.allreduce(p._raised is not None, op=MPI.LOR):
            y.set(0)
            return
        try:
            if p._system is None:
                raise RuntimeError("The SNES asks for no Jacobian: let it form one in each solve.")
            r = x.array_r / p._row_scale
            r_u, r_z = r[:n], r[n:]
            # The residual at the point of linearisation has another scale there
            plain, scaled = p._rescaled
            if p.comm.allreduce(np.allclose(r_z, plain, rtol=1e-12, atol=0), op=MPI.LAND):
                r_z = scaled.copy()
            du, dz = p._solver.solve(p._system, r_u, r_z)
        except BaseException as error:
            p._raised = error
            y.set(0)
            return
        y.array[:n] = du
        y.array[n:] = dz
