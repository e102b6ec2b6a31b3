# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Meshes from arrays for every supported cell, and facet tags from sets of nodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx.cpp.io import perm_gmsh, perm_vtk
from dolfinx.mesh import (
    CellType,
    Mesh,
    MeshTags,
    entities_to_geometry,
    exterior_facet_indices,
    meshtags,
)

from .. import arguments, compat
from ..elements import hex20
from .hexahedra import HEX_VERTICES, TET_EDGES, hex20_permutation, node_permutation

#: Cell, degree and number of nodes
_CELLS = {
    "tet4": ("tetrahedron", 1, 4),
    "tet10": ("tetrahedron", 2, 10),
    "hex8": ("hexahedron", 1, 8),
    "hex20": ("hexahedron", 2, 20),
    "hex27": ("hexahedron", 2, 27),
}
_ORDERS = ("gmsh", "vtk", "abaqus", "exodus", "basix")


def create_mesh(
    comm: MPI.Intracomm,
    points: npt.ArrayLike,
    cells: npt.ArrayLike,
    cell: str,
    order: str = "gmsh",
    partitioner: Callable | None = None,
) -> Mesh:
    """Make a mesh from arrays. Collective.

    Args:
        comm: Communicator of the mesh.
        points: Node coordinates [length], shape ``(num_nodes, 3)``. Each rank hands over its
            share, which may be empty; shares are concatenated in rank order.
        cells: Global input node numbers of each cell, shape ``(num_cells, nodes of a cell)``.
        cell: ``"tet4"``, ``"tet10"``, ``"hex8"``, ``"hex20"`` or ``"hex27"``.
        order: Node order of ``cells``: that of ``"gmsh"``, ``"vtk"``, ``"abaqus"``, ``"exodus"``
            or ``"basix"``; hex27 is known in those of gmsh, vtk and basix.
        partitioner: From :func:`dolfinx_mortar.compat.cell_partitioner`.

    Raises:
        ValueError: Cell or order are unknown, or cells have another number of nodes.
    """
    arguments.choice("cell", cell, _CELLS)
    arguments.choice("order", order, _ORDERS)
    name, degree, num_nodes = _CELLS[cell]
    cells = np.asarray(cells, dtype=np.int64)
    if cells.ndim != 2 or cells.shape[1] != num_nodes:
        raise ValueError(
            f"{cell} cells have {num_nodes} nodes, but the array of cells is {cells.shape}"
        )
    element = hex20(shape=(3,))
    if cell != "hex20":
        element = basix.ufl.element("Lagrange", name, degree, shape=(3,))
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    permutation = node_order(cell, order)
    return compat.create_mesh(comm, cells[:, permutation], element, points, partitioner)


def create_hex20_mesh(
    comm: MPI.Intracomm,
    points: npt.ArrayLike,
    cells: npt.ArrayLike,
    order: str = "gmsh",
    partitioner: Callable | None = None,
) -> Mesh:
    """Make a mesh of 20-node hexahedra with curved (serendipity) geometry, see create_mesh."""
    return create_mesh(comm, points, cells, "hex20", order, partitioner)


def node_order(cell: str, order: str) -> list[int]:
    """``p`` with ``basix_nodes = nodes[p]``, see :func:`create_mesh`."""
    name, degree, num_nodes = _CELLS[cell]
    if order == "basix":
        return list(range(num_nodes))
    if cell == "hex20":
        return hex20_permutation(order)
    if order in ("gmsh", "vtk"):
        permute = perm_gmsh if order == "gmsh" else perm_vtk
        return [int(i) for i in permute(getattr(CellType, name), num_nodes)]
    if cell == "hex27":
        raise ValueError(f"hex27 cells are known in the orders 'gmsh', 'vtk', 'basix', not {order}")
    # Abaqus and Exodus have the vertices of VTK, and the edges of tetrahedra
    if name == "hexahedron":
        return node_permutation(basix.CellType.hexahedron, HEX_VERTICES, ())
    return node_permutation(basix.CellType.tetrahedron, range(4), TET_EDGES if degree == 2 else ())


def tags_from_nodes(mesh: Mesh, sets: Mapping[int, npt.ArrayLike]) -> MeshTags:
    """Tag boundary facets all of whose vertices are in a set of nodes. Collective.

    Args:
        mesh: Mesh that was made from arrays or from a file.
        sets: For each tag the input numbers of nodes, the same on all ranks. Nodes within edges
            and facets may be in the set or not.

    Raises:
        ValueError: A facet is in two of the sets; on the rank that has it.
    """
    topology = mesh.topology
    topology.create_connectivity(2, 3)
    facets = exterior_facet_indices(topology)
    numbers = mesh.geometry.input_global_indices
    nodes = np.asarray(entities_to_geometry(mesh, 2, facets)).reshape(len(facets), -1)
    num_vertices = 3 if topology.cell_type == CellType.tetrahedron else 4
    vertices = numbers[nodes[:, :num_vertices]]
    values = np.zeros(len(facets), dtype=np.int32)
    chosen = np.zeros(len(facets), dtype=bool)
    for tag, members in sets.items():
        inside = np.isin(vertices, np.asarray(members, dtype=np.int64)).all(axis=1)
        if np.any(chosen & inside):
            other = int(values[chosen & inside][0])
            raise ValueError(f"sets {other} and {tag} share facets, which have one tag")
        chosen |= inside
        values[inside] = tag
    order = np.argsort(facets[chosen])
    tags = meshtags(mesh, 2, facets[chosen][order], values[chosen][order])
    tags.name = "facet_tags"
    return tags
