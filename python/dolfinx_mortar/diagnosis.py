# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""What to say of a solve that failed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from . import coverage, plausibility
from .errors import ConvergenceError
from .support import find_sliding

if TYPE_CHECKING:
    from .problem import ContactProblem

#: The cure that is always worth a try
SMALLER = (
    " Take smaller load steps, or let solve(adaptive=...) cut them; the state is as before the "
    "step."
)

_MEANING = {
    "force": "the residual force",
    "constraint": "the interface constraint",
    "prescribed": "the distance to prescribed displacements",
}


def find_infinite(problem: ContactProblem, f: npt.NDArray[np.float64]) -> str:
    """Say where a residual is not finite; empty where it is. Collective.

    Args:
        problem: Problem.
        f: Residual [forces, constraints] of this rank.
    """
    p = problem
    n, comm = p._n_u, p.comm
    bad = ~np.isfinite(f)
    prescribed, tractions = bad[p._coupling.fixed_dofs].any(), bad[n:].any()
    nodes = p._layout.positions().reshape(-1, 3)[bad[:n].reshape(-1, 3).any(axis=1)]
    at = min(comm.allgather(min(map(tuple, nodes), default=(np.inf,))))
    if comm.allreduce(bool(prescribed), op=MPI.LOR):
        return "A prescribed displacement is not a finite number."
    if at[0] < np.inf:
        text = f"The residual force is not finite near X = {plausibility.point(at)}"
        barely = coverage.find_barely_covered(p._coupling.interfaces)
        if barely:
            return f"{text}. {barely}"
        return f"{text}: a load is not a finite number, or a cell is inside out."
    if comm.allreduce(bool(tractions), op=MPI.LOR):
        return "A contact traction is not a finite number."
    return ""


def explain_reason(problem: ContactProblem, reason: int) -> str:
    """What became of an iteration that ended with one of PETSc's reasons. Collective."""
    p = problem
    reasons = PETSc.SNES.ConvergedReason
    names = {getattr(reasons, k): k for k in dir(reasons) if k.startswith("DIVERGED")}
    text = f"The solve did not converge ({names.get(reason, reason)})"
    if not p.history:
        infinite = "" if p._cached is None else find_infinite(p, p._cached[1])
        return f"{text} at its start. {infinite or 'The residual is too large.'}{SMALLER}"
    last = p.history[-1]
    measures = {k: last[k] for k in _MEANING}
    worst = max(measures, key=measures.get)
    text += (
        f" after {last['iteration']} Newton iterations. Largest is {_MEANING[worst]}, "
        f"{measures[worst]:.2e} relative"
    )
    if p._coupling.has_contact:
        moves = ", ".join(f"{h['active']} (±{h['changes']})" for h in p.history[-5:])
        text += f"; nodes in contact (changed) in the last iterations: {moves}"
    text += "."
    if any(h.get("cycle") for h in p.history):
        text += " The active set cycled."
    found = hint(p)
    if p._failure and not found:
        text += f" The last step had to be shortened: {p._failure}"
    return text + (found or f"{_barely_covered(p)}{SMALLER}")


def explain_error(problem: ContactProblem, error: RuntimeError) -> str:
    """What became of an iteration that ended with an error. Collective."""
    if isinstance(error, ConvergenceError):
        reason = str(error)
    elif isinstance(error, PETSc.Error):
        reason = f"PETSc: {str(error).splitlines()[0]}.{SMALLER}"
    else:
        reason = f"{error}{SMALLER}"
    text = f"The solve failed in Newton iteration {len(problem.history)}."
    return text + (hint(problem) or f" {reason}{_barely_covered(problem)}")


def hint(problem: ContactProblem) -> str:
    """What may be behind a failure; empty where nothing is known. Collective."""
    p = problem
    lost = any(h["active"] == 0 for h in p.history[-5:])
    text = find_sliding(p)
    if not text and lost:
        text = p._coupling.diagnose()
    if not text and p._cached is not None:
        text = p._coupling.find_blocked()
        text = text and f" {text}"
    if not text and not p._started:
        text = p._coupling.start_overlap
    return text


def _barely_covered(problem: ContactProblem) -> str:
    """Nodes that may be behind a failure, to be said after its reason. Collective."""
    if problem._cached is None:
        return ""
    text = coverage.find_barely_covered(problem._coupling.interfaces)
    return text and f" {text}"


def complain_of_solution(problem: ContactProblem) -> str:
    """A sentence on a solution that can not be meant; empty where it can. Collective."""
    text = problem._coupling.find_implausible(problem._functions)
    text = f"{text}{SMALLER}" if text else problem._coupling.find_blocked()
    return text and f"The solve converged to a state that can not be meant. {text}"


def cause(error: BaseException) -> BaseException:
    """What a function has raised that PETSc called, else the error itself."""
    while isinstance(error, PETSc.Error) and error.__cause__ is not None:
        error = error.__cause__
    return error
