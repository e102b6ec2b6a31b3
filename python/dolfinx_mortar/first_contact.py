# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Nodes that the first solve begins with, where contact alone holds a body.

A body that nothing touches moves rigidly where its loads drive it. The nodes that meet a master
first on this way hold it, if they can: a pin with clearance all around touches its bore on one
side. Where loads drive no node towards a master, or those that meet it first would let the body
tilt, it is the nodes that are nearest.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import scipy.linalg

from . import rigidity, sparse

if TYPE_CHECKING:
    from .contact import Contact
    from .coupling import Coupling

Flags = list[npt.NDArray[np.bool_]]

#: How much further away [size of a node's area] than the first node others may be
_PATCH = 0.2

#: The same, for nodes that a body meets first on its way; the smallest that holds it, so that
#: those nodes are few which contact, in a bore, has to let go again
_FIRST = (0.005, 0.02, 0.05, 0.2)


def initial_status(
    coupling: Coupling, u: npt.NDArray[np.float64], force: npt.NDArray[np.float64]
) -> dict[int, npt.NDArray[np.int8]]:
    """States that the first solve begins with, at the last evaluated state. Collective.

    Args:
        coupling: Interfaces.
        u: Owned displacements.
        force: Residual forces without those of contact, zero at Dirichlet dofs.

    Returns:
        States of the owned nodes, by the id of each contact.
    """
    first = find_first_nodes(coupling, u, force)
    return {
        id(c): c._initial_status(None if first is None else first[i])
        for i, c in enumerate(coupling.contacts)
    }


def find_first_nodes(
    coupling: Coupling, u: npt.NDArray[np.float64], force: npt.NDArray[np.float64]
) -> Flags | None:
    """Nodes that hold bodies which nothing else holds, at the last evaluated state. Collective.

    Args:
        coupling: Interfaces.
        u: Owned displacements.
        force: Residual forces without those of contact, zero at Dirichlet dofs.

    Returns:
        Flags of the owned nodes of each contact; None where all bodies are held.
    """
    motions = rigidity.free_motions(
        coupling.layout, coupling.ties, coupling.fixed_dofs, coupling.positions(u)
    )
    if motions.shape[1] == 0:
        return None
    near = [_nearest(c) for c in coupling.contacts]
    gram = coupling.comm.allreduce(motions.T @ motions)
    relative = relative_motions(coupling, motions)
    drive = _drive(coupling.comm, motions, gram, force)
    rates = [
        np.einsum("nc,nci,i->n", c._configuration.normals[: c.num_owned], r, drive)
        for c, r in zip(coupling.contacts, relative)
    ]
    contacts = coupling.contacts
    choices = [
        [_first(c, rate, n, patch) for c, rate, n in zip(contacts, rates, near)] for patch in _FIRST
    ]
    choices += [[n & _approaching(c, rate) for c, rate, n in zip(contacts, rates, near)]]
    needed = _rank(coupling, relative, gram, near)
    for flags in choices:
        if _rank(coupling, relative, gram, flags) >= needed:
            return flags
    return near


def relative_motions(
    coupling: Coupling, motions: npt.NDArray[np.float64]
) -> list[npt.NDArray[np.float64]]:
    """Motions of slaves relative to masters, at the last evaluated state. Collective.

    Args:
        coupling: Interfaces.
        motions: Motions of the owned displacement dofs, shape (size_u, number of motions).

    Returns:
        Means at the owned nodes of each contact, shape (num_owned, 3, number of motions).
    """
    moved = [sparse.product(coupling.B_contact, m) for m in motions.T]
    return [
        np.stack([m[coupling.multipliers.slice(c)].reshape(-1, 3) for m in moved], axis=-1)
        / np.maximum(c._nodal["weight"][: c.num_owned], 1e-300)[:, None, None]
        for c in coupling.contacts
    ]


def _drive(comm, motions, gram, force) -> npt.NDArray[np.float64]:
    """Coefficients of the free motion that forces drive, per force; zero in balance."""
    total = comm.allreduce(float(np.abs(force).sum()))
    if total == 0 or not np.isfinite(total):  # the iteration says what is wrong
        return np.zeros(len(gram))
    force = force / total
    work = comm.allreduce(motions.T @ -force)
    size = np.sqrt(comm.allreduce(float(force @ force)))
    if np.all(np.abs(work) <= 1e-8 * size * np.sqrt(np.diag(gram))):
        return np.zeros(len(work))
    return np.linalg.lstsq(gram, work, rcond=None)[0]


def _usable(contact: Contact) -> tuple[npt.NDArray[np.bool_], npt.NDArray, npt.NDArray]:
    """Nodes that carry a multiplier, their gaps and sizes."""
    n = contact.num_owned
    carries = contact._data.carries[:n].astype(bool)
    return carries, np.maximum(contact._nodal_gap(), 0.0), np.sqrt(contact._weights[:n])


def _nearest(contact: Contact) -> npt.NDArray[np.bool_]:
    """Those nodes that are nearest to a master: a patch, that keeps a body from tilting."""
    carries, gap, size = _usable(contact)
    nearest = contact._layout.comm.allreduce(float(gap.min(initial=np.inf)), op=MPI.MIN)
    if not np.isfinite(nearest):
        return np.zeros_like(carries)
    return carries & (gap <= nearest + _PATCH * size)


def _approaching(contact: Contact, rate: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Nodes that come nearer to a master; those of a contact where none does all count."""
    largest = contact._layout.comm.allreduce(float(rate.max(initial=0.0)), op=MPI.MAX)
    return rate > 0.01 * largest if largest > 0 else np.ones(len(rate), dtype=bool)


def _first(contact, rate, near, patch) -> npt.NDArray[np.bool_]:
    """Nodes that meet a master first where gaps close at these rates; else the nearest."""
    comm = contact._layout.comm
    carries, gap, size = _usable(contact)
    closing = carries & np.isfinite(gap) & (rate > 0) & _approaching(contact, rate)
    times = gap[closing] / rate[closing]
    time = comm.allreduce(float(times.min(initial=np.inf)), op=MPI.MIN)
    if not np.isfinite(time):
        return near
    left = np.where(closing, gap - rate * time, np.inf)
    return closing & (left <= patch * size)


def _rank(coupling: Coupling, relative, gram, flags: Flags) -> int:
    """Number of free motions that nodes resist: sticking ones all, others along the normal."""
    resisted = np.zeros_like(gram)
    for c, r, f in zip(coupling.contacts, relative, flags, strict=True):
        rows = r[f]
        if not c.is_frictional:
            rows = np.einsum("nc,nci->ni", c._configuration.normals[: c.num_owned][f], rows)
        rows = rows.reshape(-1, gram.shape[0])
        resisted += rows.T @ rows
    values = scipy.linalg.eigh(coupling.comm.allreduce(resisted), gram, eigvals_only=True)
    return int(np.sum(values > 1e-5 * values.max(initial=0.0)))
