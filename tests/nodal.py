# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Values of the slave nodes that this rank owns, in the last accepted state."""

from __future__ import annotations

import dolfinx_mortar as dm
import numpy as np
from dolfinx import fem


def number(interface: dm.Interface) -> int:
    """Number of owned slave nodes."""
    return interface.data.slave.num_owned


def multipliers(interface: dm.Interface, z: np.ndarray | None = None) -> np.ndarray:
    """Multipliers, shape (n, 3); of an array of all multipliers, by default the state's."""
    z = interface.problem.state.z if z is None else z
    first = interface.first_node
    return z.reshape(-1, 3)[first : first + number(interface)]


def has_multiplier(interface: dm.Interface) -> np.ndarray:
    """Flags of nodes that carry a multiplier."""
    return interface.state.basis.has_multiplier[: number(interface)].astype(bool)


def normals(contact: dm.Contact) -> np.ndarray:
    """Averaged normals, shape (n, 3)."""
    return contact.evaluation.configuration.normals[: number(contact)]


def weights(interface: dm.Interface) -> np.ndarray:
    """Integrals of the multipliers' functions [area]."""
    return interface.evaluation.nodal.weight[: number(interface)]


def positions(interface: dm.Interface) -> np.ndarray:
    """Reference positions, shape (n, 3)."""
    return interface.data.slave.X[: number(interface)]


def displacements(problem: dm.ContactProblem) -> np.ndarray:
    """Displacements of the owned dofs of all bodies."""
    sizes = [3 * V.dofmap.index_map.size_local for V in problem.spaces]
    u = problem.u if isinstance(problem.u, list | tuple) else [problem.u]
    return np.concatenate([w.x.array[:n] for w, n in zip(u, sizes, strict=True)])


def by_position(*functions: fem.Function) -> np.ndarray:
    """Values at all nodes, ordered by position: the same whatever the partition.

    A mesh that is made twice may be cut in different places.
    """
    tables = []
    for u in functions:
        V = u.function_space
        n = V.dofmap.index_map.size_local
        rows = np.hstack([V.tabulate_dof_coordinates()[:n], u.x.array.reshape(-1, 3)[:n]])
        rows = np.vstack(V.mesh.comm.allgather(rows))
        tables.append(rows[np.lexsort(np.round(rows[:, :3], 9).T), 3:])
    return np.vstack(tables)
