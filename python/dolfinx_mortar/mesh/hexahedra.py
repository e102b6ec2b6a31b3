# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Order of nodes in formats, and meshes of 20-node hexahedra from arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from mpi4py import MPI

import basix
import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh

from .. import compat
from ..elements import hex20

# Basix numbers the vertices of a hexahedron as a tensor product; all formats here go around the
# bottom and then around the top.
HEX_VERTICES = (0, 1, 3, 2, 4, 5, 7, 6)

# Vertices (in the format's own numbers) at the ends of each edge node, in the format's order.
_BOTTOM = ((0, 1), (1, 2), (2, 3), (3, 0))
_TOP = ((4, 5), (5, 6), (6, 7), (7, 4))
_UPRIGHT = ((0, 4), (1, 5), (2, 6), (3, 7))
_HEX_EDGES = {
    "gmsh": (
        *((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3)),
        *((2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7)),
    ),
    "vtk": (*_BOTTOM, *_TOP, *_UPRIGHT),
    "abaqus": (*_BOTTOM, *_TOP, *_UPRIGHT),
    "exodus": (*_BOTTOM, *_UPRIGHT, *_TOP),
}
TET_EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))


def node_permutation(
    cell: basix.CellType, vertices: Sequence[int], edges: Sequence[tuple[int, int]]
) -> list[int]:
    """``p`` with ``basix_nodes = nodes[p]``.

    Args:
        cell: Cell type.
        vertices: Basix number of each vertex of the format.
        edges: Vertices (the format's numbers) of each edge node; empty for first order.
    """
    ends = [{vertices[a], vertices[b]} for a, b in edges]
    num_vertices = len(vertices)
    vertex_nodes = [vertices.index(i) for i in range(num_vertices)]
    edge_nodes = [num_vertices + ends.index(set(edge)) for edge in basix.topology(cell)[1] if edges]
    return vertex_nodes + edge_nodes


def hex20_permutation(order: str = "gmsh") -> list[int]:
    """Where the nodes of a 20-node hexahedron come from.

    Args:
        order: ``"gmsh"``; ``"vtk"`` or ``"abaqus"`` (the same: edges of the bottom, of the top,
            uprights); ``"exodus"`` (bottom, uprights, top: also 4C's order); ``"basix"``.

    Returns:
        ``p`` with ``basix_nodes = nodes[p]``, length 20.

    Raises:
        ValueError: For any other order.
    """
    if order == "basix":
        return list(range(20))
    if order not in _HEX_EDGES:
        raise ValueError(
            f"unknown node order {order!r} of hex20 cells: "
            f"use one of {', '.join(map(repr, (*_HEX_EDGES, 'basix')))}"
        )
    return node_permutation(basix.CellType.hexahedron, HEX_VERTICES, _HEX_EDGES[order])


def create_hex20_mesh(
    comm: MPI.Intracomm,
    points: npt.ArrayLike,
    cells: npt.ArrayLike,
    order: str = "gmsh",
    partitioner: Callable | None = None,
) -> Mesh:
    """Make a mesh of 20-node hexahedra with curved (serendipity) geometry.

    Args:
        comm: Communicator of the mesh.
        points: Node coordinates [length], shape ``(num_nodes, 3)``. Each rank hands over its
            share, which may be empty; shares are concatenated in rank order.
        cells: Global input node numbers of each cell, shape ``(num_cells, 20)``.
        order: Node order of ``cells``, see :func:`hex20_permutation`.
        partitioner: From :func:`dolfinx_mortar.compat.cell_partitioner`.

    Returns:
        Mesh whose coordinate element is ``hex20(shape=(3,))``.

    Raises:
        ValueError: If ``cells`` does not have 20 nodes per cell, or ``order`` is unknown.
    """
    cells = np.asarray(cells, dtype=np.int64)
    if cells.ndim != 2 or cells.shape[1] != 20:
        raise ValueError(f"hex20 cells have 20 nodes, but the array of cells is {cells.shape}")
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    return compat.create_mesh(
        comm, cells[:, hex20_permutation(order)], hex20(shape=(3,)), points, partitioner
    )
