# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Bodies coupled by interfaces, solved by PETSc's SNES."""

from __future__ import annotations

import os
import warnings
import weakref
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from . import agreement, arguments, checkpoint, cpp, forms, interrupts, memory
from .arguments import as_list
from .contact import Contact
from .errors import ConvergenceError
from .interfaces import Interface
from .progress import progress_clock, report


class ContactProblem(memory.Destroyable):
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
            Newton steps, and a sparse direct solver, or multigrid for large models (above 30 000
            displacements, where these are not thin). They are in PETSc's database only while the
            problem is made and solved.
        condense: Condense the multipliers (default where all are dual); False keeps a saddle
            point.
        stabilise: Weak springs for bodies that nothing holds but contact, at their nodes, and for
            free components of rigid tools, to where a solve begins: stiffness as a share of that
            of the nodes, or of all slave nodes of a tool, such as 1e-3. From one solution to the
            next they are weakened to a millionth of this; see :attr:`stabilisation`.
        form_compiler_options, jit_options: Passed on to ``fem.form``.

    Raises:
        ValueError, RuntimeError: Something does not fit; the message says what to do. On all
            ranks alike.

    Attributes:
        spaces: Displacement space of each body.
        history: Of the last solve, one dictionary per Newton iteration: ``iteration``, ``force``
            (norm of the residual force relative to the forces at work), ``residual`` (absolute),
            ``constraint``, ``prescribed`` (distance to prescribed displacements), ``active``,
            ``stick``, ``slip``, ``changes`` (nodes that changed state), ``step`` (length of the
            step taken); ``cycle`` where the active sets have been found to cycle.
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
        stabilise: float | None = None,
        form_compiler_options: dict | None = None,
        jit_options: dict | None = None,
    ):
        self._functions = as_list(u)
        forms.check_functions(self._functions)
        comm = agreement.common([f.function_space.mesh.comm for f in self._functions])
        with agreement.alike(comm) as same:
            F, J = _check_forms(F, J, self._functions, same)
            self.bcs = _check_conditions(bcs, same)
            self._interfaces = _check_interfaces(interfaces, same)
            same["condense"] = condense
            same["stabilise"] = arguments.positive("stabilise", stabilise, "a share of stiffness")
            options = arguments.petsc_options(petsc_options_prefix, petsc_options)
            same["petsc_options"] = sorted(
                cpp.effective_options(petsc_options_prefix, options).items()
            )
        self.u = u
        self.spaces = [f.function_space for f in self._functions]
        self.comm = memory.communicator(comm)
        memory.free_forgotten(self.comm)
        form_options = {"form_compiler_options": form_compiler_options, "jit_options": jit_options}
        form_options = {k: v for k, v in form_options.items() if v is not None}
        self._prefix, self._warned, this = petsc_options_prefix, False, weakref.ref(self)
        self.interrupts: interrupts.Interrupts | None = None
        try:
            problem = cpp.ContactProblem(
                self.comm.py2f(),
                [fem.form(f, **form_options)._cpp_object for f in F],
                [fem.form(f, **form_options)._cpp_object for f in J],
                [f._cpp_object for f in self._functions],
                [bc._cpp_object for bc in self.bcs],
                [i.describe() for i in self._interfaces],
                petsc_options_prefix,
                options,
                condense,
                lambda: _poll(this()),
                0.0 if stabilise is None else float(stabilise),
            )
        except RuntimeError as error:
            if not str(error).startswith("PETSc failed"):
                raise
            raise ValueError(
                f"PETSc does not accept petsc_options={petsc_options}: {error}"
            ) from error
        self._handle = memory.keep(self, self.comm, problem)
        # Nothing can fail any more: before, interfaces are free for another attempt
        for index, i in enumerate(self._interfaces):
            i.attach(self, index)

    @property
    def _cpp_object(self) -> cpp.ContactProblem:
        self._check_alive()
        return self._handle.object

    def _free(self) -> None:
        self._handle.destroy()

    @property
    def interfaces(self) -> tuple[Interface, ...]:
        """The interfaces; another set of them is another problem."""
        return self._interfaces

    @property
    def snes(self) -> PETSc.SNES:
        """The PETSc SNES."""
        return self._cpp_object.snes

    @property
    def history(self) -> list[dict]:
        """See the class."""
        return [_as_dict(i) for i in self._cpp_object.history]

    @property
    def stabilisation(self) -> dict[str, float]:
        """What the springs of ``stabilise`` did at the end of the last solve.

        ``force`` relative to that of contact, ``energy``, and ``energy_share`` of the work of
        contact. A solve at whose end a share is above 1e-3 fails.
        """
        return self._cpp_object.stabilisation

    @property
    def coupling(self) -> cpp.Coupling:
        """Dofs of bodies and multipliers, as the C++ library has them."""
        return self._cpp_object.coupling

    @property
    def state(self) -> cpp.State:
        """State of the last accepted step: a copy that stays as it is."""
        return self._cpp_object.state

    def body(self, V: fem.FunctionSpace) -> int:
        """Number of the body that a space belongs to."""
        return next(b for b, W in enumerate(self.spaces) if W is V or W == V)

    # -- Solve -------------------------------------------------------------------

    def solve(self, adaptive: Callable[[float], None] | None = None, max_cuts: int = 6) -> int:
        """Solve from the present displacement. Collective.

        Args:
            adaptive: Function that sets loads and boundary values for a fraction t in (0, 1] of
                this step. If the step does not converge it is cut in halves and tried again.
            max_cuts: How often a step may be halved.

        Returns:
            Number of Newton iterations; of a cut step, of all parts that converged.

        Raises:
            ConvergenceError: Not converged, or to a state that cannot be meant: bodies that have
                passed through each other, cells inside out, Dirichlet conditions that hold slave
                nodes inside a master. The state is as before the call.
            RuntimeError: Bodies are deep inside each other when the first solve begins; or a
                mesh, a displacement or the Dirichlet dofs are not those of the problem any more.
            ValueError: Friction has been changed to what it cannot be, or ranks differ.

        What a function of the user raises, and KeyboardInterrupt, comes through on all ranks; the
        state is then as before the call, too.
        """
        problem = self._cpp_object
        with agreement.alike(self.comm) as same:
            same["adaptive"] = "given" if adaptive is not None else None
            same["max_cuts"] = arguments.whole("max_cuts", max_cuts, 0)
            if adaptive is not None and not callable(adaptive):
                raise ValueError(
                    f"adaptive is {adaptive!r}, but must be a function that sets loads for a "
                    "fraction of the step."
                )
        with interrupts.deferred() as self.interrupts:
            try:
                memory.free_forgotten(self.comm)
                self._prepare()
                if adaptive is None:
                    total = problem.solve()
                else:
                    total = problem.solve_adaptively(self._loader(adaptive), max_cuts)
                self._warn_of_unread()
                self.interrupts.handle_together(self.comm)
            except cpp.ConvergenceError as error:
                raise ConvergenceError(str(error), self.history) from None
            finally:
                self._update_fields()
        # Meshes may go before the next solve, and their communicators with them
        memory.free_forgotten(self.comm, [V.mesh.comm for V in self.spaces])
        return total

    def steps(
        self, n: int, load: Callable[[float], None], max_cuts: int = 6, progress: bool = True
    ) -> Iterator[float]:
        """Solve n load steps; each is cut in halves where it does not converge. Collective.

        ::

            for t in problem.steps(20, load):
                file.write(t)

        Args:
            n: Number of steps.
            load: Function that sets loads and boundary values for t in (0, 1].
            max_cuts: How often a step may be halved.
            progress: Print a line for each step, with the time left, on rank 0.

        Yields:
            t at the end of each step: k / n.

        Raises:
            ConvergenceError: See :meth:`solve`; steps before are as they were yielded.
        """
        with agreement.alike(self.comm) as same:
            same["n"] = arguments.whole("n", n, 1)
        clock = progress_clock(n)
        for k in range(1, n + 1):
            part = _Part(load, (k - 1) / n, 1 / n)
            iterations = self.solve(adaptive=part, max_cuts=max_cuts)
            if progress and self.comm.rank == 0:
                print(clock(k, iterations, part.tried, self.history[-1]), flush=True)
            yield k / n

    def reaction(self, bc: fem.DirichletBC) -> npt.NDArray[np.float64]:
        """Resultant of the forces with which a Dirichlet condition holds a body, (3,). Collective.

        Args:
            bc: Condition on a displacement space, or on a component of it, of this problem.

        Raises:
            RuntimeError: There is no solution yet.
        """
        forces, layout = self._cpp_object.reactions(), self.coupling.layout
        body = self._cpp_object.space_of(bc._cpp_object)
        own = forces[layout.owned_start(body) :][: layout.num_owned[body]].ravel()
        dofs = bc._cpp_object.dof_indices()[0]
        dofs = dofs[dofs < own.size]  # ghosts come last
        sums = [own[dofs[dofs % 3 == c]].sum() for c in range(3)]
        return np.array(self.comm.allreduce(np.array(sums)))

    def report(self) -> str:
        """A table of all contacts, see :meth:`Contact.summary`. Collective."""
        return report(
            [(k, i.summary()) for k, i in enumerate(self._interfaces) if isinstance(i, Contact)]
        )

    def as_functions(self, values: npt.NDArray, name: str) -> fem.Function | list[fem.Function]:
        """Values of the owned nodes of all bodies, (n, 3), as the displacement. Collective."""
        functions, start = [], 0
        sizes = self.coupling.layout.num_owned[: len(self.spaces)]  # frames of tools follow
        for V, size in zip(self.spaces, sizes, strict=True):
            f = fem.Function(V, name=name)
            f.x.array.reshape(-1, 3)[:size] = values[start : start + size]
            f.x.scatter_forward()
            functions.append(f)
            start += size
        return functions if isinstance(self.u, list | tuple) else functions[0]

    def _prepare(self) -> None:
        """Take over what a user may have changed since the last solve. Collective.

        Raises:
            ValueError: A coefficient of friction, or the SNES, cannot be as it is; or ranks
                differ.
            RuntimeError: Another displacement has been put into the problem.
        """
        problem = self._cpp_object
        with agreement.alike(self.comm) as same:
            problem.check_type()
            same["tolerances of snes"] = problem.snes.getTolerances()
            for k, i in enumerate(self._interfaces):
                for name, value in i.present_values().items():
                    same[f"{name} of {type(i).__name__.lower()} {k}"] = value
            functions = as_list(self.u)
            if len(functions) != len(self._functions) or any(
                f is not g for f, g in zip(functions, self._functions, strict=True)
            ):
                raise RuntimeError(
                    "Another displacement has been put into the problem: make new interfaces and "
                    "a new ContactProblem."
                )
        for k, i in enumerate(self._interfaces):
            if isinstance(i, Contact):
                problem.set_friction(k, i.present_friction())
                problem.set_offset(k, i.present_offset())
        problem.set_conditions([bc._cpp_object for bc in self.bcs])

    def _loader(self, adaptive: Callable[[float], None]) -> Callable[[float], None]:
        """The user's function, which all ranks leave alike and interrupts do not wait for."""
        assert self.interrupts is not None
        pending, comm = self.interrupts, self.comm

        def load(t: float) -> None:
            self._update_fields()
            self._prepare()
            with agreement.alike(comm), pending.at_once():
                adaptive(t)
            self._prepare()

        return load

    def _warn_of_unread(self) -> None:
        """Warn, once, of options that nothing has asked for in the first solve. Collective."""
        if self._warned:
            return
        self._warned = True
        names = self._cpp_object.unread_options()
        with agreement.alike(self.comm):
            if names and self.comm.rank == 0:
                warnings.warn(
                    f"No solver has asked for the PETSc options {', '.join(sorted(names))} (prefix "
                    f"{self._prefix!r}): they are misspelt, or belong to solvers that are not in "
                    "use.",
                    stacklevel=3,
                )

    def _update_fields(self) -> None:
        """Let the fields of all interfaces show the present state. Collective."""
        for i in self._interfaces:
            i.update_fields()

    # -- States --------------------------------------------------------------------

    def restore(self, state: cpp.State) -> None:
        """Go back to a state, with its displacements. Collective.

        Args:
            state: From :attr:`state`.
        """
        problem = self._cpp_object
        problem.restore(state, state.u if len(state.u) else problem.displacements())
        self._update_fields()

    def save(self, path: str | Path) -> None:
        """Write the state of the last accepted step to a file. Collective.

        An interrupted call leaves an earlier file of that name as it was.

        Raises:
            RuntimeError: The file cannot be written.
        """
        self._check_alive()
        _check_path(self.comm, path)
        checkpoint.save(self, path)

    def load(self, path: str | Path) -> None:
        """Continue from a file of :meth:`save`, on any number of ranks. Collective.

        Rigid tools get the motion that they had.

        Raises:
            RuntimeError: The file is missing, truncated, or of another problem; the state is
                unchanged.
        """
        self._check_alive()
        _check_path(self.comm, path)
        self._prepare()
        state = checkpoint.load(self, path)
        before, u = self.state, self._cpp_object.displacements()
        try:
            self._cpp_object.resume(state)
        except Exception:
            self._cpp_object.restore(before, u)
            raise
        self._update_fields()
        for tool in {i.tool for i in self._interfaces if i.tool is not None}:
            tool.update(self._cpp_object, every=True)


# -- What a problem is given: checked, or a ValueError says what does not fit --------------


class _Part:
    """Sets the loads of a part of a step, and counts how often."""

    def __init__(self, load: Callable[[float], None], begin: float, length: float):
        self._load, self._begin, self._length = load, begin, length
        self.tried = 0

    def __call__(self, fraction: float) -> None:
        self.tried += 1
        self._load(self._begin + fraction * self._length)


def _poll(problem: ContactProblem | None) -> None:
    """Handle interrupts while PETSc is at work. Collective."""
    if problem is not None and problem.interrupts is not None:
        problem.interrupts.handle_together(problem.comm)


def _as_dict(i: cpp.Iterate) -> dict[str, Any]:
    names = "iteration force residual constraint prescribed active stick slip changes step"
    return {name: getattr(i, name) for name in names.split()} | ({"cycle": True} if i.cycle else {})


def _check_forms(
    F: Any, J: Any, functions: Sequence[fem.Function], same: dict[str, Any]
) -> tuple[list, list]:
    """Return residual and Jacobian forms, one of each for each body."""
    residuals = as_list(F)
    same["form F (its signature)"] = forms.check("F", residuals, functions)
    tangents = forms.derivatives(residuals, functions) if J is None else as_list(J)
    same["form J (its signature)"] = forms.check("J", tangents, functions)
    return residuals, tangents


def _check_conditions(bcs: Any, same: dict[str, Any]) -> list[fem.DirichletBC]:
    """Return Dirichlet conditions."""
    bcs = [] if bcs is None else as_list(bcs)
    for bc in bcs:
        if not isinstance(bc, fem.DirichletBC):
            raise ValueError(
                f"bcs hold a {type(bc).__name__}, but must be a list of what fem.dirichletbc "
                "returns."
            )
    same["number of bcs"] = len(bcs)
    return bcs


def _check_interfaces(interfaces: Any, same: dict[str, Any]) -> tuple[Interface, ...]:
    """Return interfaces that are in no problem yet."""
    interfaces = as_list(interfaces)
    for k, i in enumerate(interfaces):
        if not isinstance(i, Interface):
            raise ValueError(
                f"interfaces hold a {type(i).__name__}, but must be Tie and Contact objects."
            )
        if any(i is j for j in interfaces[:k]):
            raise ValueError("An interface is named twice in interfaces.")
        if i.problem is not None:
            raise ValueError(
                "An interface is part of another ContactProblem already: make a new Tie or "
                "Contact for each problem."
            )
        if i.tool is not None:
            i.tool.check_free()
    same["interfaces"] = [
        (type(i).__name__, [[p.tag for p in side] for side in (i.slave, i.master)])
        for i in interfaces
    ]
    return tuple(interfaces)


def _check_path(comm: MPI.Intracomm, path: Any) -> None:
    """Refuse what names no file, or not the same one on all ranks. Collective."""
    with agreement.alike(comm) as same:
        if not isinstance(path, str | os.PathLike):
            raise ValueError(f"path is {path!r}, but must be a string or a Path.")
        same["path"] = os.fspath(path)
