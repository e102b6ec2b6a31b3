# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Whether Dirichlet conditions and ties hold the bodies of a problem."""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import scipy.linalg
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from . import sparse
from .interfaces import Tie
from .layout import Layout


def is_held(layout: Layout, ties: Sequence[Tie], fixed: npt.NDArray[np.int32]) -> bool:
    """Whether no body, with those it is tied to, can move rigidly. Collective.

    Args:
        layout: Displacement dofs.
        ties: Interfaces that are tied.
        fixed: Owned displacement dofs (local) with a Dirichlet condition.
    """
    return free_motions(layout, ties, fixed, layout.positions()).shape[1] == 0


def free_motions(
    layout: Layout,
    ties: Sequence[Tie],
    fixed: npt.NDArray[np.int32],
    positions: npt.NDArray[np.float64],
) -> npt.NDArray[np.float64]:
    """Rigid motions that Dirichlet conditions and ties leave to bodies. Collective.

    Args:
        layout: Displacement dofs.
        ties: Interfaces that are tied.
        fixed: Owned displacement dofs (local) with a Dirichlet condition.
        positions: Positions of the owned displacement dofs, shape (size_u,).

    Returns:
        Motions of the owned displacement dofs, shape (size_u, number of motions).
    """
    labels = _tied_bodies(layout, ties)
    x = positions.reshape(-1, 3)
    scale = layout.comm.allreduce(float(np.max(np.abs(x), initial=0.0)), op=MPI.MAX)
    modes = _rigid_modes(x / (scale or 1.0)).reshape(-1, 6)
    of_fixed = labels[fixed // 3]
    free = [np.empty((layout.size_u, 0))]
    count = layout.comm.allreduce(int(labels.max(initial=-1)), op=MPI.MAX) + 1
    for label in range(count):
        mine = fixed[of_fixed == label]
        gram = layout.comm.allreduce(modes[mine].T @ modes[mine])
        tolerance = 1e-10 * max(1.0, np.trace(gram))
        values, vectors = np.linalg.eigh(gram)
        on_body = np.repeat(labels == label, 3)[:, None]
        free.append(np.where(on_body, modes @ vectors[:, values <= tolerance], 0.0))
    return np.hstack(free)


def unresisted(
    motions: npt.NDArray[np.float64], K: PETSc.Mat, fixed: npt.NDArray[np.int32]
) -> npt.NDArray[np.float64]:
    """Those combinations of motions that a stiffness, as of springs or inertia, leaves free.

    Collective.

    Args:
        motions: Motions of the owned displacement dofs, shape (size_u, number of motions).
        K: Tangent of the bodies.
        fixed: Owned displacement dofs (local) with a Dirichlet condition.
    """
    if motions.shape[1] == 0:
        return motions
    comm = K.getComm().tompi4py()
    stiffness = np.abs(K.getDiagonal().array)[:, None] * motions
    resistance = np.column_stack([sparse.product(K, m) for m in motions.T])
    resistance[fixed] = 0.0
    sums = [stiffness.T @ stiffness, resistance.T @ resistance]
    scale, resisted = comm.allreduce(np.array(sums))
    values, vectors = scipy.linalg.eigh(resisted, scale)
    return motions @ vectors[:, values < 1e-14]


def _rigid_modes(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Translations and infinitesimal rotations at points, shape (n, 3, 6)."""
    modes = np.zeros((len(x), 3, 6))
    modes[:, 0, 0] = modes[:, 1, 1] = modes[:, 2, 2] = 1.0
    modes[:, 1, 3], modes[:, 2, 3] = -x[:, 2], x[:, 1]
    modes[:, 0, 4], modes[:, 2, 4] = x[:, 2], -x[:, 0]
    modes[:, 0, 5], modes[:, 1, 5] = -x[:, 1], x[:, 0]
    return modes


def _tied_bodies(layout: Layout, ties: Sequence[Tie]) -> npt.NDArray[np.int64]:
    """Number of the connected and tied part that each owned block belongs to. Collective."""
    labels, count = [], 0
    for b in range(len(layout.spaces)):
        own = layout.separate_bodies(b)
        labels.append(count + own)
        count += layout.comm.allreduce(int(own.max(initial=-1)), op=MPI.MAX) + 1
    label = np.concatenate(labels)
    links = []
    for tie in ties:
        mine: set[int] = set()
        for s in (tie._surface_slave, tie._surface_master):
            mine |= set(label[s.blocks[: s.num_owned] - layout.first_u // 3].tolist())
        together = sorted(set().union(*layout.comm.allgather(mine)))
        links += [(together[0], other) for other in together]
    i, j = np.array(links, dtype=np.int64).reshape(-1, 2).T
    graph = coo_matrix((np.ones(len(i)), (i, j)), shape=(count, count))
    _, part = connected_components(graph, directed=False)
    return part[label].astype(np.int64)
