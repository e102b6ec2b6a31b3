# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Meshes that one rank has read, for all ranks."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeVar

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh, MeshTags

from .. import compat

_T = TypeVar("_T")


class Arrays(NamedTuple):
    """A mesh as the rank that read it holds it."""

    points: npt.NDArray[np.float64]
    cells: npt.NDArray[np.int64]
    """In Basix's node order."""
    cell_values: npt.NDArray[np.int32]
    facets: npt.NDArray[np.int64]
    """Vertices only."""
    facet_values: npt.NDArray[np.int32]


def on_rank(comm: MPI.Intracomm, rank: int, task: Callable[[], _T]) -> _T | None:
    """Do something on one rank; if it fails there, raise the same error on all ranks. Collective.

    Returns:
        What the task returns, None on other ranks.
    """
    result, error = None, None
    if comm.rank == rank:
        try:
            result = task()
        except Exception as e:
            error = e
    error = comm.bcast(error, root=rank)
    if error is not None:
        raise error
    return result


def distribute(
    comm: MPI.Intracomm,
    arrays: Arrays | None,
    element: basix.ufl._ElementBase,
    partitioner: Callable | None = None,
) -> tuple[Mesh, MeshTags, MeshTags]:
    """Make mesh, cell tags and facet tags from the arrays that one rank holds. Collective."""
    num_vertices, num_facet_vertices = {
        basix.CellType.tetrahedron: (4, 3),
        basix.CellType.hexahedron: (8, 4),
    }[element.cell_type]
    if arrays is None:
        arrays = Arrays(
            np.empty((0, 3)),
            np.empty((0, element.dim // element.block_size), np.int64),
            np.empty(0, np.int32),
            np.empty((0, num_facet_vertices), np.int64),
            np.empty(0, np.int32),
        )
    mesh = compat.create_mesh(comm, arrays.cells, element, arrays.points, partitioner)
    cell_tags = compat.tags_from_vertices(
        mesh, 3, arrays.cells[:, :num_vertices], arrays.cell_values
    )
    cell_tags.name = "cell_tags"
    facet_tags = compat.tags_from_vertices(mesh, 2, arrays.facets, arrays.facet_values)
    facet_tags.name = "facet_tags"
    return mesh, cell_tags, facet_tags
