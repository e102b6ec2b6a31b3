# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""What a problem is given, and what is done to it between solves.

Functions with an argument ``same`` are called inside :func:`agreement.alike` and put into ``same``
what ranks must agree on.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
from dolfinx import fem

from . import agreement, bodies, forms, newton
from .arguments import as_list
from .interfaces import Interface
from .multipliers import find_fixed_dofs

if TYPE_CHECKING:
    from .problem import ContactProblem


def check_forms(
    F: Any, J: Any, functions: Sequence[fem.Function], same: dict[str, Any]
) -> tuple[list, list]:
    """Residual and Jacobian forms, one of each for each body.

    Raises:
        ValueError: They do not fit.
    """
    residuals = as_list(F)
    same["form F (its signature)"] = forms.check("F", residuals, functions)
    tangents = forms.derivatives(residuals, functions) if J is None else as_list(J)
    same["form J (its signature)"] = forms.check("J", tangents, functions)
    return residuals, tangents


def check_conditions(bcs: Any, same: dict[str, Any]) -> list[fem.DirichletBC]:
    """Dirichlet conditions.

    Raises:
        ValueError: They are something else.
    """
    bcs = [] if bcs is None else as_list(bcs)
    for bc in bcs:
        if not isinstance(bc, fem.DirichletBC):
            raise ValueError(
                f"bcs hold a {type(bc).__name__}, but must be a list of what fem.dirichletbc "
                "returns."
            )
    same["number of bcs"] = len(bcs)
    return bcs


def check_interfaces(interfaces: Any, same: dict[str, Any]) -> tuple[Interface, ...]:
    """Interfaces that are in no problem yet.

    Raises:
        ValueError: They are something else, or taken.
    """
    interfaces = as_list(interfaces)
    for k, i in enumerate(interfaces):
        if not isinstance(i, Interface):
            raise ValueError(
                f"interfaces hold a {type(i).__name__}, but must be Tie and Contact objects."
            )
        if any(i is j for j in interfaces[:k]):
            raise ValueError("An interface is named twice in interfaces.")
        if i._problem is not None:
            raise ValueError(
                "An interface is part of another ContactProblem already: make a new Tie or "
                "Contact for each problem."
            )
    same["interfaces"] = [
        (type(i).__name__, [[p.tag for p in side] for side in (i.slave, i.master)])
        for i in interfaces
    ]
    return tuple(interfaces)


def choose_condensation(
    condense: bool | None, interfaces: Sequence[Interface], same: dict[str, Any]
) -> bool:
    """Whether to condense the multipliers.

    Raises:
        ValueError: They can not be condensed, but should be.
    """
    same["condense"] = condense
    dual = all(i.is_dual for i in interfaces)
    if condense and not dual:
        raise ValueError(
            "Standard multipliers can not be condensed: leave condense out, or use "
            "multiplier='dual'."
        )
    return dual if condense is None else bool(condense)


def check_path(comm: MPI.Comm, path: Any) -> None:
    """Refuse what names no file, or not the same one on all ranks. Collective.

    Raises:
        ValueError: It does.
    """
    with agreement.alike(comm) as same:
        if not isinstance(path, str | os.PathLike):
            raise ValueError(f"path is {path!r}, but must be a string or a Path.")
        same["path"] = os.fspath(path)


def check_changeable(problem: ContactProblem) -> None:
    """Refuse what a user may change between solves and can not mean. Collective.

    Raises:
        ValueError: A coefficient of friction, or the SNES; or ranks differ.
    """
    with agreement.alike(problem.comm) as same:
        newton.check_type(problem.snes, problem._coupling.has_contact)
        same["tolerances of snes"] = problem.snes.getTolerances()
        for k, contact in enumerate(problem._coupling.contacts):
            for name, value in contact._friction_arguments().items():
                same[f"{name} of contact {k}"] = value


def check_unchanged(problem: ContactProblem) -> None:
    """Refuse to go on with other bodies than the problem was made for. Collective.

    Raises:
        RuntimeError: Displacements, meshes or Dirichlet dofs have been exchanged or moved.
    """
    message, layout = "", problem._layout
    functions = as_list(problem.u)
    if len(functions) != len(problem._functions) or any(
        f is not g for f, g in zip(functions, problem._functions)
    ):
        message = "Another displacement has been put into the problem"
    elif problem.comm.allreduce(bodies.checksums(layout) != problem._checksums, op=MPI.LOR):
        message = "A mesh has been moved since the problem was made"
    else:
        fixed = find_fixed_dofs(layout, layout.prescribed(problem.bcs))
        changed = not np.array_equal(fixed, problem._coupling.fixed_dofs)
        if problem.comm.allreduce(changed, op=MPI.LOR):
            message = "The Dirichlet conditions are not on the dofs they were on"
    if message:
        raise RuntimeError(
            f"{message}: the interfaces are still those of before. Make new interfaces and a "
            "new ContactProblem. Motions belong into the displacement, changing loads and "
            "boundary values into a fem.Constant or fem.Function."
        )
