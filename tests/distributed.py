# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Surfaces of plain arrays, dealt out to ranks in any way, for tests."""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import oracle
from dolfinx_mortar import cpp

TYPE = {kind: getattr(cpp.FacetType, kind) for kind in oracle.KINDS}
KIND = {int(number): kind for kind, number in TYPE.items()}


@dataclass
class Distributed:
    """A surface of the library and where it comes from.

    Attributes:
        surface: The surface, facets and nodes distributed.
        source: The same surface on one rank.
        facets: Facets of this rank, as facets of ``source``.
        nodes: Local nodes, as nodes of ``source``.
        block: Block number of each node of ``source``.
        owner: Owning rank of each node of ``source``.
    """

    surface: cpp.Surface
    source: oracle.Surface
    facets: np.ndarray
    nodes: np.ndarray
    block: np.ndarray
    owner: np.ndarray

    @property
    def x(self) -> np.ndarray:
        """Positions of the local nodes, shape (num_nodes, 3)."""
        return np.ascontiguousarray(self.source.x[self.nodes])

    def facet_nodes(self, f: int) -> np.ndarray:
        """Local nodes of a local facet."""
        return self.surface.nodes[self.surface.offsets[f] : self.surface.offsets[f + 1]]


def distribute(
    comm: MPI.Comm,
    source: oracle.Surface,
    *,
    facet_rank: np.ndarray | int | None = None,
    node_rank: np.ndarray | int | None = None,
    first_block: int = 0,
    rng: np.random.Generator | None = None,
) -> Distributed:
    """Deal facets and nodes of a surface out to the ranks.

    Each rank also owns blocks that are not on the surface, as bodies have them.

    Args:
        comm: Communicator.
        source: Surface, the same on all ranks.
        facet_rank: Rank of each facet, shape (facets,), or one for all; random if not given.
        node_rank: Rank that owns each node, likewise. Owners need not have a facet at the node.
        first_block: Number of the first block.
        rng: Random numbers, the same on all ranks.
    """
    num_nodes, num_facets = len(source.x), len(source.facets)
    if facet_rank is None:
        facet_rank = rng.integers(comm.size, size=num_facets)
    if node_rank is None:
        node_rank = rng.integers(comm.size, size=num_nodes)
    facet_rank = np.broadcast_to(facet_rank, num_facets)
    owner = np.broadcast_to(node_rank, num_nodes)

    # Blocks by rank, every other one inside the body
    block = np.empty(num_nodes, np.int64)
    block[np.argsort(owner, kind="stable")] = first_block + 2 * np.arange(num_nodes) + 1
    mine = np.flatnonzero(owner == comm.rank)
    facets = np.flatnonzero(facet_rank == comm.rank)
    touched = {int(k) for f in facets for k in source.facets[f][1]}
    ghosts = np.array(sorted(k for k in touched if owner[k] != comm.rank), dtype=int)
    if rng is not None:
        # Function spaces promise no order of ghosts; a generator of this rank's own
        ghosts = np.random.default_rng(comm.rank).permutation(ghosts)

    numbers, X, local = [], [], {}
    for k in mine:
        numbers += [block[k] - 1, block[k]]
        local[k] = len(X) + 1
        X += [np.full(3, np.nan), source.x[k]]
    num_owned = len(numbers)
    for k in ghosts:
        local[k] = len(X)
        numbers.append(block[k])
        X.append(source.x[k])
    surface = cpp.create_surface(
        comm.py2f(),
        [TYPE[source.facets[f][0]] for f in facets],
        np.array([local[k] for f in facets for k in source.facets[f][1]], np.int32),
        source.sign[facets].astype(np.int8),
        np.array(numbers, np.int64),
        num_owned,
        owner[ghosts].astype(np.int32),
        np.array(X, float).reshape(-1, 3),
    )
    node = dict(zip(block.tolist(), range(num_nodes), strict=True))
    nodes = np.array([node[b] for b in surface.blocks], dtype=int)
    return Distributed(surface, source, facets, nodes, block, owner)


def fails_on_all(comm: MPI.Comm, fn, *args) -> str:
    """Call a function that must raise on all ranks alike; returns the message."""
    try:
        fn(*args)
        message = None
    except Exception as error:
        message = f"{type(error).__name__}: {error}"
    messages = comm.allgather(message)
    assert messages[0] is not None and set(messages) == {messages[0]}, messages
    assert messages[0].startswith("RuntimeError: "), messages[0]
    return messages[0].removeprefix("RuntimeError: ")
