# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Slave nodes that are moved onto the master surface."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from scipy.spatial import cKDTree

from . import agreement, arguments, cpp, memory
from .contact import Contact
from .interfaces import Interface, Tie


def relocate(tie: Tie, bcs: Sequence[fem.DirichletBC] = (), limit: float = 0.8) -> float:
    """Move the slave nodes of *your* mesh onto the master surface, X_s := D⁻¹ M X_m. Collective.

    A tie constrains displacements. Where the discretised surfaces of a curved interface do not
    coincide, forces that balance have a small moment left, and a rigid rotation creates a small
    stress. Both vanish when D X_s = M X_m holds. Call this before forms are assembled and before
    the problem is created.

    D and M stay those of the positions before: the tie keeps these, since the condition is exact
    only with the matrices that gave the new positions.

    Only geometry nodes at slave nodes that carry a multiplier, and those on edges between them,
    move. With multipliers on edges, straight cells under a second-order displacement cannot
    follow: give the mesh the order of the displacement, or only a part of the stress goes.

    Args:
        tie: Interface, not yet part of a problem.
        bcs: Dirichlet conditions of the problem; nodes they fix entirely do not move.
        limit: Largest motion allowed, as a share of the size of the adjacent facets.

    Returns:
        Largest motion of a node [length].

    Raises:
        RuntimeError: A node would move further than ``limit`` allows; nothing has been moved.
    """
    if not isinstance(tie, Tie):
        raise ValueError(
            f"relocate moves the slave nodes of a Tie, not of a {type(tie).__name__}: bodies in "
            "contact have a gap that is meant. To close small ones there is adjust."
        )
    bcs = _check(tie, bcs, "limit", limit)
    spaces = _spaces(tie)
    comm = memory.communicator(tie.comm).py2f()
    motion = cpp.relocate(comm, [V._cpp_object for V in spaces], tie.describe(), bcs, limit)
    tie.positions = motion.x_slave, motion.x_master
    _move_meshes(spaces, motion)
    return motion.largest


def adjust(
    contact: Contact,
    distance: float,
    bcs: Sequence[fem.DirichletBC] = (),
    gap: float = 0.0,
) -> float:
    """Move slave nodes of *your* mesh that nearly touch the master onto it. Collective.

    Along their normals, without any stress: small gaps and overlaps of surfaces that are meant to
    touch, as those of curved surfaces with different meshes, are gone. With a ``gap`` nodes come
    to lie that far from the master: surfaces that are meshed with a clearance, or with the overlap
    of a press fit, have the same one everywhere. Call this before forms are assembled and before
    the problem is created. Only geometry nodes move: straight cells under a second-order
    displacement follow at their corners.

    Args:
        contact: Contact, not yet part of a problem; its offset is not looked at.
        distance: Nodes that would move further [length], along their normals, stay.
        bcs: Dirichlet conditions of the problem; nodes they fix entirely do not move.
        gap: Gap that the nodes are to have [length], negative for an overlap.

    Returns:
        Largest motion of a node [length].
    """
    if not isinstance(contact, Contact):
        raise ValueError(
            f"adjust moves the slave nodes of a Contact, not of a {type(contact).__name__}: for "
            "ties there is relocate."
        )
    with agreement.alike(contact.comm) as same:
        same["gap"] = arguments.number("gap", gap)
    bcs = _check(contact, bcs, "distance", distance)
    spaces = _spaces(contact)
    comm = memory.communicator(contact.comm).py2f()
    spaces_ = [V._cpp_object for V in spaces]
    motion = cpp.adjust(comm, spaces_, contact.describe(), bcs, distance, gap)
    _move_meshes(spaces, motion)
    return motion.largest


def _check(interface: Interface, bcs: Any, name: str, length: Any) -> list:
    """Refuse what cannot be; Dirichlet conditions as the C++ library takes them. Collective."""
    with agreement.alike(interface.comm) as same:
        if length is None:
            raise ValueError(f"{name} is None, but must be a positive number.")
        same[name] = arguments.positive(name, length)
        bcs = arguments.as_list(bcs)
        same["number of bcs"] = len(bcs)
        if interface.problem is not None:
            kind = type(interface).__name__.lower()
            raise ValueError(
                f"The {kind} is part of a ContactProblem already: move its nodes before the "
                "problem is made."
            )
    return [bc._cpp_object for bc in bcs]


def _spaces(interface: Interface) -> list[fem.FunctionSpace]:
    """Spaces of the bodies of an interface."""
    spaces: list[fem.FunctionSpace] = []
    for part in [*interface.slave, *([] if interface.tool else interface.master)]:
        if part.V not in spaces:
            spaces.append(part.V)
    return spaces


def _move_meshes(spaces: Sequence[fem.FunctionSpace], motion: cpp.Relocation) -> None:
    """Move the meshes of spaces, the owned nodes of one after the other. Collective."""
    start = 0
    for V in spaces:
        end = start + V.dofmap.index_map.size_local
        _move_mesh(V, motion.motion[start:end])
        start = end


def _move_mesh(V: fem.FunctionSpace, motion: npt.NDArray[np.float64]) -> None:
    """Move the geometry nodes of a mesh that are at nodes of a space. Collective.

    Args:
        V: Space.
        motion: Motion of the owned nodes, shape (n, 3).
    """
    f = fem.Function(V)
    f.x.array[: motion.size] = motion.ravel()
    f.x.scatter_forward()
    values = f.x.array.reshape(-1, 3)
    moved = np.flatnonzero(np.any(values != 0, axis=1))
    if len(moved) == 0:
        return
    points, geometry = V.tabulate_dof_coordinates()[moved], V.mesh.geometry
    distance, node = cKDTree(geometry.x).query(points)
    same = distance < 1e-10 * np.max(np.abs(geometry.x), initial=1e-300)
    geometry.x[node[same]] += values[moved[same]]
