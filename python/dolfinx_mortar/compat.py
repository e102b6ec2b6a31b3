# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""One call for what DOLFINx 0.9, 0.10 and 0.11 spell differently.

Nothing else asks for the version. Where possible a feature is tested, so that development versions
work too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mpi4py import MPI

import basix.ufl
import dolfinx
import numpy as np
import numpy.typing as npt
from dolfinx.mesh import GhostMode, Mesh, MeshTags

#: Version of DOLFINx as (major, minor).
VERSION = tuple(int(part) for part in dolfinx.__version__.split(".")[:2])


def cell_partitioner(mode: GhostMode = GhostMode.none) -> Callable:
    """Partitioner of cells for :func:`create_mesh`.

    Args:
        mode: Ghost mode. Interfaces need no ghost cells.

    Returns:
        A function that DOLFINx calls with the dual graph of the mesh.
    """
    # 0.10 has a default for the number of cells at a facet, 0.11 insists on it.
    return dolfinx.mesh.create_cell_partitioner(mode, *(() if VERSION < (0, 10) else (2,)))


def create_mesh(
    comm: MPI.Intracomm,
    cells: npt.NDArray[np.int64],
    element: basix.ufl._ElementBase,
    x: npt.NDArray[np.floating],
    partitioner: Callable | None = None,
) -> Mesh:
    """Make a mesh from arrays; each rank hands over its share.

    Args:
        comm: Communicator of the mesh.
        cells: Nodes of each cell in the order of ``element``, as global input node numbers,
            shape ``(num_cells, num_nodes_per_cell)``.
        element: Coordinate element of value shape ``(gdim,)``, or a ``ufl.Mesh`` of it.
        x: Node coordinates [length], shape ``(num_nodes, gdim)``; ranks' shares are
            concatenated in rank order.
        partitioner: From :func:`cell_partitioner`; ``None`` gives a partition without ghosts.

    Returns:
        The distributed mesh.
    """
    if partitioner is None and comm.size > 1:
        partitioner = cell_partitioner()
    if VERSION < (0, 10):
        return dolfinx.mesh.create_mesh(comm, cells, x, element, partitioner)
    return dolfinx.mesh.create_mesh(comm, cells, element, x, partitioner)


def tags_from_vertices(
    mesh: Mesh, dim: int, vertices: npt.NDArray[np.int64], values: npt.NDArray[np.int32]
) -> MeshTags:
    """Tag entities that are named by their vertices.

    Args:
        mesh: Mesh made from arrays or from a file.
        dim: Dimension of the entities.
        vertices: Input node numbers of each entity's vertices in any order, shape
            ``(num_entities, num_vertices)``. Any rank may name any entity of the mesh.
        values: Tag of each entity, shape ``(num_entities,)``.

    Returns:
        Tags of the entities, on each rank that has them.
    """
    from dolfinx.io.utils import distribute_entity_data

    topology = mesh.topology
    topology.create_entities(dim)
    topology.create_connectivity(dim, 0)
    topology.create_connectivity(dim, topology.dim)

    # DOLFINx expects all nodes of an entity but looks only at the vertices, which come first.
    layout = coordinate_element(mesh).create_dof_layout()
    num_nodes = len(layout.entity_closure_dofs(dim, 0))
    vertices = np.asarray(vertices, np.int64)
    nodes = np.repeat(vertices[:, :1], num_nodes, axis=1)
    nodes[:, : vertices.shape[1]] = vertices

    entities, local_values = distribute_entity_data(mesh, dim, nodes, np.asarray(values, np.int32))
    return dolfinx.mesh.meshtags_from_entities(
        mesh, dim, dolfinx.graph.adjacencylist(entities), local_values.astype(np.int32)
    )


def geometry_dofmap(mesh: Mesh) -> npt.NDArray[np.int32]:
    """Geometry nodes of each cell, shape ``(num_cells, num_nodes_per_cell)``."""
    geometry = mesh.geometry
    return geometry.dofmaps[0] if hasattr(geometry, "dofmaps") else geometry.dofmap


def coordinate_element(mesh: Mesh) -> Any:
    """DOLFINx coordinate element of a mesh with one cell type."""
    geometry = mesh.geometry
    return geometry.cmaps[0] if hasattr(geometry, "cmaps") else geometry.cmap


def interpolation_points(V: dolfinx.fem.FunctionSpace) -> npt.NDArray[np.floating]:
    """Points at which an expression is evaluated to interpolate it."""
    points = V.element.interpolation_points
    return points() if callable(points) else points  # a method before 0.10
