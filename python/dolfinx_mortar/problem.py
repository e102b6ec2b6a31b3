# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Bodies coupled by interfaces, solved by PETSc's SNES."""

from __future__ import annotations

import weakref
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.common import Timer

from . import checkpoint, compat, diagnosis
from .condensation import LinearSolver
from .contact import Contact
from .coupling import Coupling
from .diagnosis import SMALLER
from .errors import ConvergenceError
from .interfaces import Interface
from .layout import Layout
from .linearisation import linearise
from .multipliers import find_fixed_dofs
from .petsc_options import PetscOptions


def _list(x: Any) -> list:
    return list(x) if isinstance(x, list | tuple) else [x]


class ContactProblem:
    """Find u (and λ) such that F(u; v) + ∫ λ·(v⁽¹⁾ - v⁽²⁾∘P) = 0 under the interfaces' conditions.

    Shaped like DOLFINx's ``NonlinearProblem``: any UFL form of a displacement, one SNES. The
    unknowns of the SNES are the displacements of all bodies and the multipliers of all interfaces;
    its linear solver condenses the multipliers.

    Args:
        F: Residual form, or a list with one form for each body (one mesh each).
        u: Displacement, or one for each body; holds the start of the iteration and the solution.
        bcs: Dirichlet conditions of all bodies.
        J: Jacobian form(s); by default the derivative of ``F``.
        interfaces: :class:`Tie` and :class:`Contact` objects.
        petsc_options_prefix: Prefix of PETSc options.
        petsc_options: PETSc options without the prefix: ``snes_*`` for Newton's iteration,
            ``ksp_*`` and ``pc_*`` for the condensed (or saddle point) system. Defaults: full
            Newton steps and a sparse direct solver.
        condense: Condense the multipliers (default where all are dual); False keeps a saddle
            point.
        form_compiler_options, jit_options: Passed on to ``fem.form``.

    Raises:
        ValueError, RuntimeError: Something does not fit; the message says what to do. On all
            ranks alike.

    Attributes:
        snes: The PETSc SNES.
        history: Of the last solve, one dictionary per Newton iteration: ``force`` (norm of the
            residual force relative to the forces at work), ``constraint``, ``active``, ``stick``,
            ``slip``, ``changes`` (nodes that changed state), ``step`` (length of the step taken).
    """

    def __init__(
        self,
        F: ufl.Form | Sequence[ufl.Form],
        u: fem.Function | Sequence[fem.Function],
        *,
        bcs: Sequence[fem.DirichletBC] | None = None,
        J: ufl.Form | Sequence[ufl.Form] | None = None,
        interfaces: Sequence[Interface] = (),
        petsc_options_prefix: str = "mortar_",
        petsc_options: dict[str, Any] | None = None,
        condense: bool | None = None,
        form_compiler_options: dict | None = None,
        jit_options: dict | None = None,
    ):
        forms, self._functions = _list(F), _list(u)
        if len(forms) != len(self._functions):
            raise ValueError(
                f"There are {len(forms)} forms for {len(self._functions)} displacements: each body "
                "needs one of both."
            )
        self.u = u
        self.bcs = list(bcs or [])
        self.interfaces = list(interfaces)
        if any(i._problem is not None for i in self.interfaces):
            raise ValueError(
                "An interface is part of another ContactProblem already: make a new Tie or Contact "
                "for each problem."
            )
        self._layout = Layout([f.function_space for f in self._functions])
        self.comm = self._layout.comm
        if condense is None:
            condense = all(i.is_dual for i in self.interfaces)
        elif condense and not all(i.is_dual for i in self.interfaces):
            raise ValueError(
                "Standard multipliers can not be condensed: leave condense out, or use "
                "multiplier='dual'."
            )

        options = {"form_compiler_options": form_compiler_options, "jit_options": jit_options}
        options = {k: v for k, v in options.items() if v is not None}
        jacobians = (
            [
                ufl.derivative(f, w, ufl.TrialFunction(w.function_space))
                for f, w in zip(forms, self._functions)
            ]
            if J is None
            else _list(J)
        )
        self._residual_forms = [fem.form(f, **options) for f in forms]
        self._jacobian_forms = [fem.form(j, **options) for j in jacobians]
        self._tangents = [compat.create_matrix(j) for j in self._jacobian_forms]

        self._coupling = Coupling(self._layout, self.interfaces, self.bcs)
        for i in self.interfaces:
            i._problem = self
        self._measure_bodies()
        self._checksums = self._sum_meshes()
        self._n_u, self._n_z = self._layout.size_u, self._coupling.multipliers.size
        self._z = np.zeros(self._n_z)
        self._started = False
        self.history: list[dict] = []
        self._options = PetscOptions(petsc_options_prefix, petsc_options or {})
        with self._options.lent():
            self._create_solver(petsc_options_prefix, condense)

    # -- Set-up ---------------------------------------------------------------

    def _measure_bodies(self) -> None:
        """Extent of the bodies, and mean cell size at each owned displacement dof [length]."""
        x = self._layout.positions().reshape(-1, 3)
        low, high = x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)
        self.comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
        self.comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
        self._size = float(np.max(high - low))
        self._cell_size = np.empty(self._layout.size_u)
        for b, V in enumerate(self._layout.spaces):
            dim = V.mesh.topology.dim
            num = V.mesh.topology.index_map(dim).size_local
            h = V.mesh.h(dim, np.arange(num, dtype=np.int32))
            total = self.comm.allreduce(np.array([h.sum(), num]))
            self._cell_size[self._layout.starts[b] : self._layout.starts[b + 1]] = (
                total[0] / total[1]
            )

    def _create_solver(self, prefix: str, condense: bool) -> None:
        self._monitor = PETSc.Options().hasName(prefix + "snes_monitor")
        n = self._n_u + self._n_z
        self._x = PETSc.Vec().createMPI((n, None), comm=self.comm)
        self._f = self._x.duplicate()
        matrix = PETSc.Mat().createPython(
            ((n, None), (n, None)), context=_NewtonMatrix(weakref.proxy(self)), comm=self.comm
        )
        matrix.setUp()
        self.snes = PETSc.SNES().create(self.comm)
        self.snes.setOptionsPrefix(prefix)
        self.snes.setType("newtonls")
        self.snes.setFunction(_weak(self._snes_function), self._f)
        self.snes.setJacobian(_weak(self._snes_jacobian), matrix)
        self.snes.setConvergenceTest(_weak(self._converged))
        self.snes.setLineSearchPreCheck(_weak(self._precheck))
        self._solver = LinearSolver(self.comm, prefix, condense)
        self._solver.set_from_options(self._layout.positions())
        ksp = self.snes.getKSP()
        ksp.setOptionsPrefix(prefix + "newton_")
        ksp.setType("preonly")
        pc = ksp.getPC()
        pc.setType("python")
        pc.setPythonContext(_NewtonSolver(weakref.proxy(self)))
        self.snes.setFromOptions()
        if self._monitor:
            self.snes.setMonitor(_weak(self._print_monitor))

    # -- Newton's iteration ------------------------------------------------------

    # PETSc locks vectors around its calls, and leaves them locked where these raise: what they
    # raise is kept until _precheck

    def _snes_function(self, snes, x: PETSc.Vec, f: PETSc.Vec) -> None:
        try:
            f.array[:] = self._evaluate(x.array_r)
        except Exception as error:
            self._raised, self._cached = error, None
            f.array[:] = np.nan

    def _evaluate(self, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Residual at x = [u, z] of this rank. Collective; keeps the last result."""
        same = self._cached is not None and np.array_equal(x, self._cached[0])
        if self.comm.allreduce(same, op=MPI.LAND):
            return self._cached[1]
        n = self._n_u
        u, z = x[:n], x[n:]
        self._layout.scatter(u, self._functions)
        self._z[:] = z
        f = np.empty_like(x)
        for b, form in enumerate(self._residual_forms):
            vector = fem.assemble_vector(form)
            vector.scatter_reverse(compat.INSERT_ADD)
            start, end = self._layout.starts[b : b + 2]
            f[start:end] = vector.array[: end - start]
        u_all = self._layout.all_local(self._functions)
        contact, f[n:] = self._coupling.evaluate(u_all, u, z, self._forced)
        f[:n] += contact
        self._contact_force = contact
        # Forces at work: reactions and contact forces
        fixed = self._coupling.fixed_dofs
        self._force_scale = self._norm(np.concatenate([f[fixed], contact]))
        f[fixed] = (u - self._prescribed_values())[fixed]
        self._cached = (x.copy(), f)
        return f

    def _prescribed_values(self) -> npt.NDArray[np.float64]:
        values = []
        for b in range(len(self._layout.spaces)):
            array = np.zeros(3 * self._layout.num_local[b])
            for bc in self.bcs:
                if self._layout.body_of_bc(bc) == b:
                    compat.set_bc_values(bc, array)
            values.append(array[: 3 * self._layout.num_owned[b]])
        return np.concatenate(values)

    def _norm(self, values: npt.NDArray[np.float64]) -> float:
        return float(np.sqrt(self.comm.allreduce(float(values @ values))))

    def _max(self, values: npt.NDArray[np.float64]) -> float:
        return self.comm.allreduce(float(np.max(np.abs(values), initial=0.0)), op=MPI.MAX)

    def _assemble_tangent(self) -> PETSc.Mat:
        with Timer("~mortar: assemble"):
            for A, form in zip(self._tangents, self._jacobian_forms):
                compat.assemble_matrix(A, form)
        if len(self._tangents) == 1:
            return self._tangents[0]
        rows = [
            [A if i == j else None for j in range(len(self._tangents))]
            for i, A in enumerate(self._tangents)
        ]
        nest = PETSc.Mat().createNest(rows, comm=self.comm)
        K = nest.convert("aij", PETSc.Mat())
        nest.destroy()
        return K

    def _snes_jacobian(self, snes, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat) -> None:
        try:
            self._linearise(x)
        except Exception as error:
            self._raised = error

    def _linearise(self, x: PETSc.Vec) -> None:
        self._evaluate(x.array_r)
        self._release_system()
        f = self._cached[1]
        f[self._n_u :] = self._coupling.rescale(f[self._n_u :])
        K = self._assemble_tangent()
        # Displacements that leave no strain still have the round-off of a deformation gradient;
        # those far beyond the bodies' size are a body's that flies away, and excuse nothing
        size = np.clip(np.abs(x.array_r[: self._n_u]), 0.1 * self._cell_size, 10 * self._size)
        self._force_floor = 1e-5 * self._norm(K.getDiagonal().array * size)
        self._system = linearise(self._coupling, K, self._z)
        if self._coupling.has_contact and self.history[-1]["active"] == 0:
            self._check_held(K)
        bare = bool(np.any(self._system.diagonal == 0)) and self._solver.condense
        if self.comm.allreduce(bare, op=MPI.LOR):
            raise ConvergenceError(
                "No master covers a slave node in contact any more, so that its multiplier can not "
                f"be condensed.{SMALLER}"
            )

    def _check_held(self, K: PETSc.Mat) -> None:
        """Do not solve for the flight of a body that nothing holds. Collective.

        Raises:
            ConvergenceError: Loads act on such a body.
        """
        x, f = self._cached
        u, free = x[: self._n_u], f[: self._n_u] - self._contact_force
        free[self._coupling.fixed_dofs] = 0.0
        if self._coupling.is_flying(K, u, free):
            raise ConvergenceError("Nothing holds a body against its loads.")

    def _release_system(self) -> None:
        if self._system is not None:
            self._system.destroy()
            if self._system.K is not self._tangents[0]:
                self._system.K.destroy()
            self._system = None

    def _precheck(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Shorten the step until the residual is finite (no cell is inside out).

        Raises:
            ConvergenceError: It never is; the message says what is not finite.
        """
        if self._raised is not None:
            raise self._raised
        if not np.isfinite(self._norm(y.array_r)):
            raise ConvergenceError(
                "The linear solver found no finite solution. The system may be singular, as where "
                "a body is not held (check the Dirichlet conditions); a saddle point needs a "
                "solver that chooses its pivots (MUMPS)."
            )
        self._iteration_step = 1.0
        if self._cycle_pending:
            # A cycle of active sets: a shorter step leads out of it
            y.scale(0.5)
            self._iteration_step = 0.5
            self._cycle_pending = False
        self._forced = None
        self._failure = ""
        for _ in range(10):
            try:
                f = self._evaluate(x.array_r - y.array_r)
                failure = diagnosis.find_infinite(self, f)
            except RuntimeError as error:
                failure = str(error)
            if not failure:
                return
            self._failure = failure
            self._cached = None
            y.scale(0.5)
            self._iteration_step *= 0.5
        raise ConvergenceError(
            f"However short the step ({self._iteration_step:.0e} of Newton's), it leads to no "
            f"admissible state. {self._failure}{SMALLER}"
        )

    def _measures(self) -> dict:
        """Norms that decide on convergence. Collective."""
        x, f = self._cached
        n = self._n_u
        free = f[:n].copy()
        free[self._coupling.fixed_dofs] = 0.0
        bc = self._max(f[:n][self._coupling.fixed_dofs])
        residual = self._norm(free)
        if self._first_residual is None:
            self._first_residual = residual
        # Forces below the round-off of stiffness times displacement are no forces. What forces
        # an iterate on the way had is no measure: it may have been far off.
        reference = max(self._first_residual, self._force_scale, self._force_floor)
        length = max(self._max(x[:n]), bc)
        return {
            "force": residual / reference if reference > 0 else 0.0,
            "residual": residual,
            "constraint": self._coupling.constraint_measure(f[n:], x[n:], length),
            "prescribed": bc / length if length > 0 else 0.0,
        }

    def _converged(self, snes, it: int, norms) -> int | None:
        Reason = PETSc.SNES.ConvergedReason
        rtol, atol, _, max_it = snes.getTolerances()
        if self._raised is not None or self._cached is None or not np.isfinite(norms[2]):
            return Reason.DIVERGED_FNORM_NAN
        m = self._measures()
        sets = self._coupling.active_sets
        counts, changes = sets.counts(), sets.record()
        if it > 0 and not self._coupling.has_contact:
            changes = 0
        record = {"iteration": it, **m, **counts, "changes": changes}
        record["step"] = self._iteration_step if it > 0 else 0.0
        self.history.append(record)
        small = max(m["force"], m["constraint"], m["prescribed"]) <= rtol or (
            m["residual"] <= atol and m["constraint"] <= rtol and m["prescribed"] <= rtol
        )
        settled = changes == 0 or sets.undecided(self._contact_multipliers(), rtol)
        if small and settled and self._forced is None:
            return Reason.CONVERGED_FNORM_RELATIVE
        if it >= max_it:
            return Reason.DIVERGED_MAX_IT
        if sets.cycling():
            self._cycle_pending = True
            record["cycle"] = True
        return Reason.CONVERGED_ITERATING

    def _contact_multipliers(self) -> list[npt.NDArray[np.float64]]:
        """Multipliers of the owned nodes of each contact, shape (num_owned, 3)."""
        c = self._coupling
        return [self._z[c.multipliers.slice(i)].reshape(-1, 3) for i in c.contacts]

    def _print_monitor(self, snes, it: int, norm: float) -> None:
        if self.history and self.comm.rank == 0:
            r = self.history[-1]
            if self._coupling.has_contact:
                sets = f"active {r['active']} (stick {r['stick']}, slip {r['slip']}), "
                sets += f"{r['changes']} changed, "
            else:
                sets = ""
            PETSc.Sys.Print(
                f"      {sets}force {r['force']:.3e}, constraint {r['constraint']:.3e}",
                comm=MPI.COMM_SELF,
            )

    # -- Solve -------------------------------------------------------------------

    def solve(self, adaptive: Callable[[float], None] | None = None, max_cuts: int = 6) -> int:
        """Solve from the present displacement. Collective.

        Args:
            adaptive: Function that sets loads and boundary values for a fraction t in (0, 1] of
                this step. If the step does not converge it is cut in halves and tried again.
            max_cuts: How often a step may be halved.

        Returns:
            Number of Newton iterations (of all parts of a cut step).

        Raises:
            ConvergenceError: Not converged, or to a state that can not be meant: bodies that have
                passed through each other, cells inside out, Dirichlet conditions that hold slave
                nodes inside a master. The state is as before the call.
            RuntimeError: Bodies are deep inside each other when the first solve begins; or a
                mesh, a displacement or the Dirichlet dofs are not those of the problem any more.
        """
        if adaptive is None:
            return self._solve_once()
        done, part, total = 0.0, 1.0, 0
        start = self._state()
        while done < 1.0:
            target = min(1.0, done + part)
            adaptive(target)
            try:
                total += self._solve_once()
            except ConvergenceError:
                part /= 2
                if part < 0.5**max_cuts:
                    self._restore(start)
                    raise
                continue
            done = target
            part = min(2 * part, 1.0 - done) if done < 1.0 else part
        return total

    def save(self, path: str | Path) -> None:
        """Write the state of the last accepted step to a file. Collective.

        An interrupted call leaves an earlier file of that name as it was.

        Raises:
            RuntimeError: The file can not be written.
        """
        checkpoint.save(self, path)

    def load(self, path: str | Path) -> None:
        """Continue from a file of :meth:`save`, on any number of ranks. Collective.

        Raises:
            RuntimeError: The file is missing, truncated, or of another problem; the state is
                unchanged.
        """
        checkpoint.load(self, path)

    def _state(self):
        return (
            self._layout.gather(self._functions).copy(),
            self._z.copy(),
            self._coupling.state(),
            self._started,
        )

    def _restore(self, state) -> None:
        u, z, coupling, self._started = state
        self._layout.scatter(u, self._functions)
        self._z[:] = z
        self._coupling.restore(coupling)

    def _sum_meshes(self) -> list[int]:
        """Checksums of this rank's part of the bodies' meshes."""
        meshes = [V.mesh for V in self._layout.spaces]
        return [zlib.crc32(np.ascontiguousarray(m.geometry.x)) for m in meshes]

    def _check_unchanged(self) -> None:
        """Refuse to go on with other bodies than the problem was made for. Collective.

        Raises:
            RuntimeError: Displacements, meshes or Dirichlet dofs have been exchanged or moved.
        """
        message = ""
        functions = _list(self.u)
        if len(functions) != len(self._functions) or any(
            f is not g for f, g in zip(functions, self._functions)
        ):
            message = "Another displacement has been put into the problem"
        elif self.comm.allreduce(self._sum_meshes() != self._checksums, op=MPI.LOR):
            message = "A mesh has been moved since the problem was made"
        else:
            fixed = find_fixed_dofs(self._layout, self._layout.prescribed(self.bcs))
            changed = not np.array_equal(fixed, self._coupling.fixed_dofs)
            if self.comm.allreduce(changed, op=MPI.LOR):
                message = "The Dirichlet conditions are not on the dofs they were on"
        if message:
            raise RuntimeError(
                f"{message}: the interfaces are still those of before. Make new interfaces and a "
                "new ContactProblem. Motions belong into the displacement, changing loads and "
                "boundary values into a fem.Constant or fem.Function."
            )

    def _solve_once(self) -> int:
        self._check_unchanged()
        state = self._state()
        self._cached = None
        self._system = None
        self._forced = None
        self._failure = ""
        self._raised: Exception | None = None
        self._cycle_pending = False
        self._iteration_step = 0.0
        self._first_residual: float | None = None
        self._force_floor = 0.0
        self.history = []
        n = self._n_u
        try:
            self._x.array[:n] = state[0]
            self._x.array[n:] = state[1]
            self._begin()
            with self._options.lent():
                self.snes.solve(None, self._x)
            reason = self.snes.getConvergedReason()
            if self._raised is not None:
                raise self._raised
            if reason <= 0:
                raise ConvergenceError(diagnosis.explain_reason(self, reason), self.history)
            self._evaluate(self._x.array_r)
            complaint = diagnosis.complain_of_solution(self)
            if complaint:
                raise ConvergenceError(complaint, self.history)
        except Exception as error:
            # What is said about the failed state must be found out before it is left
            text, cause = "", diagnosis.cause(error)
            iterating = self._raised is not None or isinstance(error, PETSc.Error)
            if iterating and isinstance(cause, RuntimeError):
                text = diagnosis.explain_error(self, cause)
            self._release_system()
            self._cached = None
            self._restore(state)
            if text:
                cause = None if isinstance(cause, ConvergenceError) else cause
                raise ConvergenceError(text, self.history) from cause
            if cause is not error:
                raise cause from None
            raise
        self._release_system()
        self._coupling.accept(self._layout.all_local(self._functions))
        self._started = True
        return self.snes.getIterationNumber()

    def _begin(self) -> None:
        """Prepare parameters and the initial active set. Collective."""
        u = self._x.array_r[: self._n_u]
        self._layout.scatter(u, self._functions)
        u_all = self._layout.all_local(self._functions)
        if self._coupling.has_contact and not self._started:
            K = self._assemble_tangent()
            diagonal = K.getDiagonal().array.copy()
            if K is not self._tangents[0]:
                K.destroy()
            self._coupling.set_parameters(diagonal)
        self._coupling.begin(u_all, u)
        if self._coupling.has_contact and not self._started:
            self._coupling.check_start(u_all)
            self._evaluate(self._x.array_r)
            self._forced = self._coupling.initial_status()
            if self._forced is not None:
                self._cached = None

    def _resultants(self, contact: Contact):
        return self._coupling.resultants(contact, self._z, self._layout.gather(self._functions))


def _weak(method: Callable) -> Callable:
    """A method that does not keep its object alive.

    Python's garbage collector does not see the references that PETSc holds.
    """
    reference = weakref.WeakMethod(method)
    return lambda *args: reference()(*args)


class _NewtonMatrix:
    """Jacobian of the coupled problem, for matrix-vector products."""

    def __init__(self, problem: ContactProblem):
        self._problem = problem

    def mult(self, mat, x, y):
        n = self._problem._n_u
        y.array[:n], y.array[n:] = self._problem._system.multiply(x.array_r[:n], x.array_r[n:])


class _NewtonSolver:
    """Preconditioner of SNES's Krylov solver: solves the Newton system."""

    def __init__(self, problem: ContactProblem):
        self._problem = problem

    def setUp(self, pc):
        pass

    def apply(self, pc, x, y):
        p = self._problem
        if p._raised is not None:
            y.set(0)
            return
        try:
            # The residual in the scale of the system, see Coupling.rescale
            r_z = p._cached[1][p._n_u :].copy()
            du, dz = p._solver.solve(p._system, x.array_r[: p._n_u].copy(), r_z)
        except Exception as error:
            p._raised = error
            y.set(0)
            return
        y.array[: p._n_u] = du
        y.array[p._n_u :] = dz
