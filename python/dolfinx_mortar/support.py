# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Whether anything holds bodies against their loads.

Where friction can not, there is no static solution, and Newton's iteration wanders about with all
nodes slipping. It is given up where three things come together: nothing but friction holds a body;
no pressure and friction of its surfaces, where they are when the solve starts, balance the loads as
if bodies were rigid; and the residual does not fall.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog

from . import arguments, first_contact
from .errors import ConvergenceError

if TYPE_CHECKING:
    from .contact import Contact
    from .coupling import Coupling
    from .problem import ContactProblem

#: Share of the loads that must be left over: bodies are not rigid
_LEFT = 0.01

#: Sides of the pyramid around the cone of friction
_SIDES = 16

#: Edges of each rank that are taken in at once, and how often; it takes some 20 times
_TAKEN, _ROUNDS = 20, 200


def find_sliding(problem: ContactProblem) -> str:
    """Whether a failure looks like that of a body that slides away. Collective.

    The iteration ends with all nodes slipping, before contact may be lost altogether, and only
    contact holds a body.

    Args:
        problem: Problem.

    Returns:
        A sentence; empty where it does not.
    """
    history, coupling = problem.history, problem._coupling
    stuck = [i for i, h in enumerate(history) if h["stick"] > 0]
    end = history[stuck[-1] + 1 if stuck else 0 :]
    slipping = sum(h["slip"] > 0 for h in end)
    frictional = coupling.has_contact and all(c.is_frictional for c in coupling.contacts)
    if slipping < 2 or not frictional or coupling.is_held():
        return ""
    return (
        " All nodes in contact slip, and nothing but friction holds a body along the surface: "
        "where loads exceed friction the body slides away, and there is no static solution. "
        "Lower these loads, raise the friction or prescribe a displacement of the body; close "
        "to the limit smaller load steps help. The state is as before the step."
    )


def check_support(problem: ContactProblem, K: PETSc.Mat) -> None:
    """Do not solve for the flight of a body that nothing holds, or friction does not. Collective.

    Args:
        problem: Problem, at an iterate that its history ends with.
        K: Tangent of the bodies.

    Raises:
        ConvergenceError: Loads act on such a body.
    """
    p, history = problem, problem.history
    u, force = p._cached[0][: p._n_u], p._free_forces()
    if history[-1]["active"] == 0 and _is_flying(p._coupling, K, u, force):
        raise ConvergenceError("Nothing holds a body against its loads.")
    if len(history) == 1:
        p._balance = _find_balance(p._coupling, K, u, force)
    elif _wanders(history) and find_sliding(p) and is_overloaded(p):
        raise ConvergenceError("Friction does not hold a body against its loads.")


def _is_flying(coupling: Coupling, K: PETSc.Mat, u, force) -> bool:
    """Whether a body moves freely under its loads where no contact is active. Collective."""
    loose = coupling.loose_motions(K, u)
    work, size = coupling.comm.allreduce(np.array([force @ loose, np.sum(loose**2, axis=0)]))
    total = coupling.comm.allreduce(float(force @ force))
    return bool(np.any(np.abs(work) > 1e-8 * np.sqrt(total * size)))


def _wanders(history: Sequence[dict]) -> bool:
    """All nodes have slipped for four iterations, and the residual does not fall."""
    last = history[-4:]
    if len(last) < 4 or any(h["stick"] > 0 or h["slip"] == 0 for h in last):
        return False
    residuals = [max(h["force"], h["constraint"]) for h in last]
    return min(residuals[2:]) > max(0.5 * min(residuals[:2]), 1e-3)


class Balance(NamedTuple):
    """Rates of work in motions of unit length, at the start of a solve.

    Attributes:
        loads: What acts on the bodies, shape (motions,), alike on all ranks.
        edges: Tractions along the edges of the pyramids of friction of this rank's nodes, shape
            (number of edges, motions).
    """

    loads: npt.NDArray[np.float64]
    edges: npt.NDArray[np.float64]


def _find_balance(coupling: Coupling, K: PETSc.Mat, u, force) -> Balance | None:
    """What must be in balance; None where more than Coulomb's friction holds bodies. Collective."""
    contacts = coupling.contacts
    if any(c.tresca is not None or not c.is_frictional for c in contacts):
        return None
    motions = coupling.loose_motions(K, u)
    if motions.shape[1] == 0:
        return None
    sums = np.vstack([motions.T @ motions, -force @ motions])
    *gram, work = coupling.comm.allreduce(sums)
    values, vectors = np.linalg.eigh(np.array(gram))
    scaled = vectors / np.sqrt(values)
    relative = first_contact.relative_motions(coupling, motions)
    edges = [_edges(c, r) @ scaled for c, r in zip(contacts, relative, strict=True)]
    return Balance(scaled.T @ work, np.concatenate(edges))


def is_overloaded(problem: ContactProblem) -> bool:
    """Whether contact can not balance the loads, as of the start of the last solve. Collective."""
    if problem._balance is None:
        return False
    loads, edges = problem._balance
    if not np.any(loads) or not np.all(np.isfinite(loads)):
        return False
    size = np.linalg.norm(edges, axis=1)
    edges, size = edges[size > 0], size[size > 0]
    left = _unbalanced(problem.comm, edges / size[:, None], loads / np.linalg.norm(loads))
    return left > _LEFT


def _unbalanced(
    comm: MPI.Comm, edges: npt.NDArray[np.float64], work: npt.NDArray[np.float64]
) -> float:
    """Least sum of what no combination of edges, with factors ≥ 0, leaves over of work. Collective.

    That is the most work of the loads in a motion, no component of it larger than one, in which no
    edge does any: few unknowns, and of the many edges few matter. Those that do most work in a
    motion are taken in, until none is left that does any.

    Args:
        comm: Communicator.
        edges: Edges of this rank, of unit length, shape (n, motions).
        work: That of the loads, alike on all ranks, shape (motions,).
    """
    taken = np.empty((0, len(work)))
    for _ in range(_ROUNDS):
        motion = comm.bcast(_freest(taken, work) if comm.rank == 0 else None)
        if motion is None:
            break
        rates = edges @ motion
        # Above the tolerance of the solver, so that no edge is taken in twice
        worst = np.flatnonzero(rates > 1e-6)
        worst = worst[np.argsort(-rates[worst])[:_TAKEN]]
        more = np.concatenate(comm.allgather(edges[worst]))
        if len(more) == 0:
            return float(work @ motion)
        taken = np.concatenate([taken, more])
    return 0.0  # not known: nothing is said of loads then


def _freest(
    edges: npt.NDArray[np.float64], work: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64] | None:
    """Motion of most work in which no edge does any; None where there is trouble finding it."""
    bounds = np.zeros(len(edges))
    result = linprog(-work, A_ub=edges, b_ub=bounds, bounds=(-1.0, 1.0), method="highs")
    return result.x if result.status == 0 else None


def _edges(contact: Contact, relative: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Rates of work that tractions along the edges of the nodes' pyramids of friction do.

    Args:
        contact: Contact.
        relative: Relative motions of its surfaces at owned nodes, shape (n, 3, motions).

    Returns:
        Rates, shape (number of edges, motions).
    """
    n = contact.num_owned
    carries = contact._data.carries[:n].astype(bool)
    normals = contact._configuration.normals[:n][carries]
    # Any tangent will do: that of the axis the normal is furthest from
    axis = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    first = np.cross(normals, axis)
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = np.cross(normals, first)
    bound = arguments.value(contact.friction) / np.cos(np.pi / _SIDES)
    angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
    tractions = [normals + bound * (np.cos(a) * first + np.sin(a) * second) for a in angles]
    rates = [np.einsum("nc,nci->ni", t, relative[carries]) for t in tractions]
    return np.concatenate(rates)
