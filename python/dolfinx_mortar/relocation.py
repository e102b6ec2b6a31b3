# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Relocation of slave nodes onto the master surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from scipy.spatial import cKDTree

from . import agreement, arguments, cpp, memory
from .interfaces import Tie


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
            "contact have a gap that is meant."
        )
    with agreement.alike(tie.comm) as same:
        same["limit"] = arguments.positive("limit", limit)
        bcs = arguments.as_list(bcs)
        same["number of bcs"] = len(bcs)
        if tie.problem is not None:
            raise ValueError(
                "The tie is part of a ContactProblem already: relocate it before the problem is "
                "made."
            )
    spaces: list[fem.FunctionSpace] = []
    for part in [*tie.slave, *tie.master]:
        if part.V not in spaces:
            spaces.append(part.V)
    relocation = cpp.relocate(
        memory.communicator(tie.comm).py2f(),
        [V._cpp_object for V in spaces],
        tie.describe(),
        [bc._cpp_object for bc in bcs],
        limit,
    )
    tie.positions = relocation.x_slave, relocation.x_master
    start = 0
    for V in spaces:
        end = start + V.dofmap.index_map.size_local
        _move_mesh(V, relocation.motion[start:end])
        start = end
    return relocation.largest


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
