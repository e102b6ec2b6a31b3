# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Bodies coupled by interfaces, solved by PETSc's SNES."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from . import agreement, arguments, bodies, checkpoint, checks, diagnosis, interrupts, newton, steps
from .arguments import as_list
from .contact import Contact
from .coupling import Coupling
from .diagnosis import SMALLER
from .errors import ConvergenceError
from .first_contact import initial_status
from .forms import BodyForms, check_functions
from .interfaces import Interface
from .layout import Layout
from .linearisation import NewtonSystem, linearise
from .memory import Destroyable, free_forgotten
from .petsc_options import PetscOptions
from .support import Balance, check_support


class ContactProblem(Destroyable):
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
            Newton steps and a sparse direct solver. They are in PETSc's database only while the
            problem is made and solved.
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
        self._functions = as_list(u)
        check_functions(self._functions)
        self.comm = agreement.common([f.function_space.mesh.comm for f in self._functions])
        with agreement.alike(self.comm) as same:
            F, J = checks.check_forms(F, J, self._functions, same)
            self.bcs = checks.check_conditions(bcs, same)
            self._interfaces = checks.check_interfaces(interfaces, same)
            condense = checks.choose_condensation(condense, self._interfaces, same)
            self._options = PetscOptions(petsc_options_prefix, petsc_options)
            same["petsc_options"] = self._options.effective()
        self.u = u
        self._layout = Layout([f.function_space for f in self._functions])
        self.comm = self._layout.comm  # that of all our matrices and vectors
        options = {"form_compiler_options": form_compiler_options, "jit_options": jit_options}
        options = {k: v for k, v in options.items() if v is not None}
        self._forms = BodyForms(self._layout, F, J, options)
        self._coupling = Coupling(self._layout, self._interfaces, self.bcs)
        self._size, self._cell_size = bodies.extent(self._layout), bodies.cell_size(self._layout)
        self._checksums = bodies.checksums(self._layout)
        self._n_u, self._n_z = self._layout.size_u, self._coupling.multipliers.size
        self._z = np.zeros(self._n_z)
        self._started = False
        #: What friction alone has to balance, if anything
        self._balance: Balance | None = None
        self.history: list[dict] = []
        self._system: NewtonSystem | None = None
        self.snes, self._x, self._solver = newton.create(self, self._options, condense)
        # Nothing can fail any more: before, interfaces are free for another attempt
        for i in self._interfaces:
            i._problem = self
            i._create_fields()

    @property
    def interfaces(self) -> tuple[Interface, ...]:
        """The interfaces; another set of them is another problem."""
        return self._interfaces

    def _free(self) -> None:
        self._release_system()
        self._solver.destroy()
        self._coupling.destroy()
        self._forms.destroy()
        self.snes.destroy()
        self._x.destroy()

    # -- Newton's iteration ------------------------------------------------------

    # PETSc locks vectors around its calls, and leaves them locked where these raise: what they
    # raise is kept until newton shortens the step

    def _snes_function(self, snes, x: PETSc.Vec, f: PETSc.Vec) -> None:
        try:
            f.array[:] = self._row_scale * self._evaluate(x.array_r)
        except BaseException as error:
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
        f[:n] = self._forms.residual()
        u_all = self._layout.all_local(self._functions)
        contact, f[n:] = self._coupling.evaluate(u_all, u, z, self._forced)
        f[:n] += contact
        self._contact_force = contact
        # Forces at work: reactions and contact forces
        fixed = self._coupling.fixed_dofs
        self._force_scale = self._norm(np.concatenate([f[fixed], contact]))
        f[fixed] = (u - self._layout.prescribed_values(self.bcs))[fixed]
        self._cached = (x.copy(), f)
        return f

    def _norm(self, values: npt.NDArray[np.float64]) -> float:
        return float(np.sqrt(self.comm.allreduce(float(values @ values))))

    def _max(self, values: npt.NDArray[np.float64]) -> float:
        return self.comm.allreduce(float(np.max(np.abs(values), initial=0.0)), op=MPI.MAX)

    def _snes_jacobian(self, snes, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat) -> None:
        try:
            self._linearise(x)
        except BaseException as error:
            self._raised = error

    def _linearise(self, x: PETSc.Vec) -> None:
        self._evaluate(x.array_r)
        self._release_system()
        f = self._cached[1]
        plain = f[self._n_u :].copy()
        f[self._n_u :] = self._coupling.rescale(plain)
        #: Residual of the constraints where the system belongs to, in both scales
        self._rescaled = plain, f[self._n_u :].copy()
        K = self._forms.tangent()
        # Displacements that leave no strain still have the round-off of a deformation gradient;
        # those far beyond the bodies' size are a body's that flies away, and excuse nothing
        size = np.clip(np.abs(x.array_r[: self._n_u]), 0.1 * self._cell_size, 10 * self._size)
        self._force_floor = 1e-5 * self._norm(K.getDiagonal().array * size)
        self._system = linearise(self._coupling, K, self._z)
        if self._coupling.has_contact:
            check_support(self, K)
        bare = bool(np.any(self._system.diagonal == 0)) and self._solver.condense
        if self.comm.allreduce(bare, op=MPI.LOR):
            raise ConvergenceError(
                "No master covers a slave node in contact any more, so that its multiplier can not "
                f"be condensed.{SMALLER}"
            )

    def _free_forces(self) -> npt.NDArray[np.float64]:
        """Residual forces without those of contact, zero at Dirichlet dofs."""
        free = self._cached[1][: self._n_u] - self._contact_force
        free[self._coupling.fixed_dofs] = 0.0
        return free

    def _release_system(self) -> None:
        if self._system is not None:
            self._system.destroy()
            self._system = None

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
        record["step"] = self._length_of_step() if it > 0 else 0.0
        self.history.append(record)
        small = max(m["force"], m["constraint"], m["prescribed"]) <= rtol or (
            m["residual"] <= atol and m["constraint"] <= rtol and m["prescribed"] <= rtol
        )
        settled = changes == 0 or sets.undecided(self._coupling.split(self._z), rtol)
        if small and settled and self._forced is None:
            return Reason.CONVERGED_FNORM_RELATIVE
        if it >= max_it:
            return Reason.DIVERGED_MAX_IT
        if sets.cycling():
            self._cycle_pending = True
            record["cycle"] = True
        return Reason.CONVERGED_ITERATING

    def _length_of_step(self) -> float:
        """Length of the last step, relative to Newton's. Collective."""
        x, y = self._before
        if self._options.line_search == "basic" or y == 0:
            return self._iteration_step
        return self._norm(self._cached[0] - x) / y

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
            ValueError: Friction has been changed to what it can not be, or ranks differ.

        What a function of the user raises, and KeyboardInterrupt, comes through on all ranks; the
        state is then as before the call, too.
        """
        self._check_alive()
        with agreement.alike(self.comm) as same:
            same["adaptive"] = "given" if adaptive is not None else None
            same["max_cuts"] = arguments.whole("max_cuts", max_cuts, 0)
            if adaptive is not None and not callable(adaptive):
                raise ValueError(
                    f"adaptive is {adaptive!r}, but must be a function that sets loads for a "
                    "fraction of the step."
                )
        with interrupts.deferred() as self._interrupts:
            start = self._state()
            try:
                if adaptive is None:
                    total = self._solve_once()
                else:
                    total = steps.solve_in_parts(
                        self._solve_once, adaptive, max_cuts, self.comm, self._interrupts
                    )
                self._interrupts.handle_together(self.comm)
            except BaseException:
                self._restore(start)
                self._update_fields()
                raise
        return total

    def save(self, path: str | Path) -> None:
        """Write the state of the last accepted step to a file. Collective.

        An interrupted call leaves an earlier file of that name as it was.

        Raises:
            RuntimeError: The file can not be written.
        """
        self._check_alive()
        checks.check_path(self.comm, path)
        checkpoint.save(self, path)

    def load(self, path: str | Path) -> None:
        """Continue from a file of :meth:`save`, on any number of ranks. Collective.

        Raises:
            RuntimeError: The file is missing, truncated, or of another problem; the state is
                unchanged.
        """
        self._check_alive()
        checks.check_path(self.comm, path)
        checks.check_changeable(self)
        checkpoint.load(self, path)
        self._update_fields()

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

    def _update_fields(self) -> None:
        """Let the fields of all interfaces show the present state. Collective."""
        for i in self._interfaces:
            i._update_fields()

    def _solve_once(self) -> int:
        free_forgotten(self.comm)
        checks.check_changeable(self)
        checks.check_unchanged(self)
        state = self._state()
        self._cached = None
        self._system = None
        self._forced = None
        self._failure = ""
        self._raised: BaseException | None = None
        self._cycle_pending = False
        self._iteration_step = 0.0
        self._first_residual: float | None = None
        self._force_floor = 0.0
        self.history = []
        n, iterating = self._n_u, False
        try:
            self._x.array[:n] = state[0]
            self._x.array[n:] = state[1]
            self._begin()
            self._row_scale = newton.row_scale(self)
            iterating = True
            with self._options.lent():
                self.snes.solve(None, self._x)
            agreement.raise_together(self.comm, self._raised)
            iterating = False
            self._options.warn_of_unread(self.comm)
            reason = self.snes.getConvergedReason()
            if reason <= 0:
                raise ConvergenceError(diagnosis.explain_reason(self, reason), self.history)
            self._evaluate(self._x.array_r)
            complaint = diagnosis.complain_of_solution(self)
            if complaint:
                raise ConvergenceError(complaint, self.history)
            self._interrupts.handle_together(self.comm)
        except BaseException as error:
            # What is said about the failed state must be found out before it is left
            text, cause = "", diagnosis.cause(error)
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
        self._update_fields()
        # Meshes may go before the next solve, and their communicators with them
        free_forgotten(self.comm, [V.mesh.comm for V in self._layout.spaces])
        return self.snes.getIterationNumber()

    def _begin(self) -> None:
        """Prepare parameters and the initial active set. Collective."""
        u = self._x.array_r[: self._n_u]
        self._layout.scatter(u, self._functions)
        u_all = self._layout.all_local(self._functions)
        if self._coupling.has_contact and not self._started:
            K = self._forms.tangent()
            diagonal = K.getDiagonal().array.copy()
            K.destroy()
            self._coupling.set_parameters(diagonal)
        self._coupling.begin(u_all, u)
        if self._coupling.has_contact and not self._started:
            self._coupling.check_start(u_all)
            self._evaluate(self._x.array_r)
            self._forced = initial_status(self._coupling, u, self._free_forces())
            self._cached = None

    def _resultants(self, contact: Contact):
        return self._coupling.resultants(contact, self._z, self._layout.gather(self._functions))
