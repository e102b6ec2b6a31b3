# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Meshes of 20-node hexahedra from gmsh."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh, MeshTags

from ..elements import hex20
from .distribution import Arrays, distribute, on_rank
from .hexahedra import hex20_permutation

# Element types of gmsh's MSH format.
_GMSH_HEX20, _GMSH_QUAD8 = 17, 16


def _gmsh_groups(
    model: Any, dim: int, element_type: int, num_nodes: int
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int32]]:
    """Nodes (gmsh's tags) and physical group of all elements of a dimension."""
    nodes = [np.empty((0, num_nodes), np.int64)]
    values = [np.empty(0, np.int32)]
    for _, group in model.getPhysicalGroups(dim):
        for entity in model.getEntitiesForPhysicalGroup(dim, group):
            for found, _, node_tags in zip(*model.mesh.getElements(dim, entity)):
                if found != element_type:
                    name = model.mesh.getElementProperties(found)[0]
                    wanted = model.mesh.getElementProperties(element_type)[0]
                    raise ValueError(
                        f"physical group {group} of dimension {dim} contains elements of type "
                        f"{name!r}, not {wanted!r}: recombine the mesh and set "
                        "Mesh.SecondOrderIncomplete to 1 before setOrder(2)"
                    )
                nodes.append(node_tags.astype(np.int64).reshape(-1, num_nodes))
                values.append(np.full(len(nodes[-1]), group, np.int32))
    return np.concatenate(nodes), np.concatenate(values)


def _gmsh_arrays(model: Any) -> Arrays:
    cells, cell_values = _gmsh_groups(model, 3, _GMSH_HEX20, 20)
    facets, facet_values = _gmsh_groups(model, 2, _GMSH_QUAD8, 8)
    if len(cells) == 0:
        raise ValueError("the gmsh model has no physical group of volumes with mesh in it")
    node_tags, points, _ = model.mesh.getNodes()
    node_tags = node_tags.astype(np.int64)

    # gmsh's node tags may have gaps, and nodes may belong to no cell.
    used = np.unique(cells)
    order = np.argsort(node_tags)
    points = points.reshape(-1, 3)[order[np.searchsorted(node_tags, used, sorter=order)]]
    corners = facets[:, :4]
    if not np.isin(corners, used).all():
        raise ValueError("a physical group of surfaces has facets that belong to no cell")
    return Arrays(
        points,
        np.searchsorted(used, cells)[:, hex20_permutation("gmsh")],
        cell_values,
        np.searchsorted(used, corners),
        facet_values,
    )


def model_to_hex20(
    model: Any, comm: MPI.Intracomm, rank: int = 0, partitioner: Callable | None = None
) -> tuple[Mesh, MeshTags, MeshTags]:
    """Turn a gmsh model of 20-node hexahedra into a mesh with curved geometry.

    The model is meshed with ``gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)`` and
    ``gmsh.model.mesh.setOrder(2)``. Cells in no physical group of volumes are left out.

    Args:
        model: ``gmsh.model`` on ``rank``; ignored on the others.
        comm: Communicator of the mesh.
        rank: The rank that holds the model.
        partitioner: From :func:`dolfinx_mortar.compat.cell_partitioner`.

    Returns:
        ``(mesh, cell_tags, facet_tags)``; the tags are the model's physical groups.

    Raises:
        ValueError: On every rank, if the groups contain other elements than hex20 and quad8.
    """
    arrays = on_rank(comm, rank, lambda: _gmsh_arrays(model))
    return distribute(comm, arrays, hex20(shape=(3,)), partitioner)
