# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Order of nodes in formats."""

from __future__ import annotations

from collections.abc import Sequence

import basix

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
