# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Proposals for slave and master: facets of bodies of one mesh that face each other."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh, MeshTags, exterior_facet_indices, meshtags

from .. import arguments, cpp

#: Normals of facets that face each other are no further from opposing than this [degrees]
_LARGEST_ANGLE = 70.0


@dataclass(frozen=True)
class Pair:
    """Two bodies that face each other, as a contact or a tie takes them.

    Attributes:
        bodies: Cell tags of slave and master.
        facet_tags: Their facets that face each other, tagged with ``slave`` and ``master``.
        slave, master: Tags.
        num_facets: Number of these facets of slave and master, on all ranks.
        sizes: Mean length of an edge of these, of slave and master.
    """

    bodies: tuple[int, int]
    facet_tags: MeshTags
    num_facets: tuple[int, int]
    sizes: tuple[float, float]
    slave: int = 1
    master: int = 2


def find_pairs(mesh: Mesh, cell_tags: MeshTags, distance: float | None = None) -> list[Pair]:
    """Find boundary facets of different bodies that face each other. Collective.

    Facets are taken that are no further apart than a distance, by the boxes around them, and whose
    normals are within 70 degrees of opposing each other. The side with the smaller facets becomes
    the slave. ::

        contacts = [
            dm.Contact(V, pair.facet_tags, slave=pair.slave, master=pair.master)
            for pair in find_pairs(mesh, cell_tags, distance=0.1)
        ]

    A facet can be in several pairs, as one of a plate that carries two bodies; each pair has facet
    tags of its own. Where a slave facet is in two of them, see to it which contact is to have it.

    Args:
        mesh: Mesh of all bodies, whose nodes they do not share.
        cell_tags: Bodies: cells with different values. Cells without a value are left out.
        distance: Length; by default the larger diameter of two facets.

    Returns:
        Pairs, in the order of the bodies' tags.

    Raises:
        ValueError: ``cell_tags`` are not of cells of the mesh, or the distance is not positive.
    """
    if cell_tags.dim != mesh.topology.dim or cell_tags.topology != mesh.topology._cpp_object:
        raise ValueError("cell_tags must tag the cells of the mesh.")
    arguments.positive("distance", distance, "a length")
    V = fem.functionspace(mesh, ("Lagrange", 1, (3,)))
    index_map = V.dofmap.index_map
    num_blocks = index_map.size_local + index_map.num_ghosts
    numbers = index_map.local_to_global(np.arange(num_blocks, dtype=np.int32))
    bodies = {
        body: (facets, cpp.create_surface(V._cpp_object, facets, numbers, f"body {body}"))
        for body, facets in _boundaries(mesh, cell_tags).items()
    }
    pairs = []
    for first, second in combinations(sorted(bodies), 2):
        sides = [
            _facing(*bodies[a], bodies[b][1], distance)
            for a, b in ((first, second), (second, first))
        ]
        counts = [_total(mesh.comm, len(facets)) for facets, _ in sides]
        if min(counts) == 0:
            continue
        sizes = [_total(mesh.comm, total) / n for (_, total), n in zip(sides, counts)]
        finer = int(sizes[1] < sizes[0])
        order = [finer, 1 - finer]
        tags = _tags(mesh, [sides[k][0] for k in order])
        names = (first, second)
        pairs.append(
            Pair(
                bodies=(names[order[0]], names[order[1]]),
                facet_tags=tags,
                num_facets=(int(counts[order[0]]), int(counts[order[1]])),
                sizes=(sizes[order[0]], sizes[order[1]]),
            )
        )
    return pairs


def _total(comm: MPI.Intracomm, x: float) -> float:
    return comm.allreduce(x)


def _boundaries(mesh: Mesh, cell_tags: MeshTags) -> dict[int, npt.NDArray[np.int32]]:
    """Boundary facets of this rank of each body that any rank knows."""
    topology = mesh.topology
    topology.create_connectivity(2, 3)
    topology.create_connectivity(3, 2)
    facets = exterior_facet_indices(topology)
    of_facet = topology.connectivity(2, 3)
    cells = np.array([of_facet.links(f)[0] for f in facets], dtype=np.int32)
    value = np.zeros(topology.index_map(3).size_local + topology.index_map(3).num_ghosts, np.int32)
    known = np.zeros(len(value), bool)
    value[cell_tags.indices], known[cell_tags.indices] = cell_tags.values, True
    found = mesh.comm.allgather(np.unique(cell_tags.values))
    return {
        int(body): facets[known[cells] & (value[cells] == body)]
        for body in np.unique(np.concatenate(found))
    }


def _facing(
    facets: npt.NDArray[np.int32], own: cpp.Surface, other: cpp.Surface, distance: float | None
) -> tuple[npt.NDArray[np.int32], float]:
    """Facets of this rank that face another body, and the sum of their sizes."""
    candidates = cpp.find_candidates(own, own.X, other, other.X, distance)
    X, nodes = np.array(own.X).reshape(-1, 3), np.array(own.nodes)
    masters = candidates.master
    normals = _normals(X[nodes], own.offsets, own.orientation)
    opposite = _normals(np.array(masters.x).reshape(-1, 3), masters.offsets, masters.orientation)
    of_facet = np.repeat(np.arange(len(normals)), np.diff(np.array(candidates.offsets)))
    cosines = np.sum(normals[of_facet] * opposite[np.array(candidates.facets)], axis=1)
    chosen = np.zeros(len(normals), bool)
    chosen[of_facet[cosines < -np.cos(np.radians(_LARGEST_ANGLE))]] = True
    begin = np.array(own.offsets)[:-1][chosen]
    edges = np.linalg.norm(X[nodes[begin]] - X[nodes[begin + 1]], axis=1)
    return facets[chosen], float(edges.sum())


def _normals(
    x: npt.NDArray[np.float64], offsets: npt.ArrayLike, orientation: npt.ArrayLike
) -> npt.NDArray[np.float64]:
    """Outward unit normals of facets at their first node, shape (facets, 3)."""
    a = np.asarray(offsets)[:-1]
    n = np.cross(x[a + 1] - x[a], x[a + 2] - x[a]) * np.asarray(orientation)[:, None]
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def _tags(mesh: Mesh, sides: list[npt.NDArray[np.int32]]) -> MeshTags:
    """Tags 1 and 2 for the facets of two sides."""
    facets = np.concatenate(sides)
    values = np.repeat(np.array([1, 2], dtype=np.int32), [len(side) for side in sides])
    order = np.argsort(facets)
    return meshtags(mesh, 2, facets[order], values[order])
