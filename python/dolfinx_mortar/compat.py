# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""One call for what DOLFINx 0.9, 0.10 and 0.11 spell differently.

The rest of the package and the demos call these functions and stay free of version tests. Where
possible a feature is tested, not a version number, so that development versions work too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import basix.ufl
import dolfinx
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from dolfinx.mesh import GhostMode, Mesh, MeshTags

__all__ = [
    "VERSION",
    "apply_lifting",
    "assemble_matrix",
    "assemble_vector",
    "cell_partitioner",
    "coordinate_element",
    "create_matrix",
    "create_mesh",
    "create_vector",
    "dofmap",
    "geometry_dofmap",
    "interpolation_points",
    "list_timings",
    "model_to_mesh",
    "read_from_msh",
    "set_bc",
    "tags_from_vertices",
    "value_shape",
]

#: Version of DOLFINx as (major, minor).
VERSION = tuple(int(part) for part in dolfinx.__version__.split(".")[:2])


# -- Meshes ---------------------------------------------------------------


def cell_partitioner(mode: GhostMode = GhostMode.none) -> Callable:
    """Partitioner of cells for :func:`create_mesh`.

    Args:
        mode: Ghost mode. Interfaces need no ghost cells.

    Returns:
        A function that DOLFINx calls with the dual graph of the mesh.
    """
    # 0.10 has a default for the number of cells at a facet, 0.11 insists on it.
    args = (mode,) if VERSION < (0, 10) else (mode, 2)
    return dolfinx.mesh.create_cell_partitioner(*args)


def create_mesh(
    comm: MPI.Comm,
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


def _gmsh_module():
    try:
        from dolfinx.io import gmsh as module
    except ImportError:
        from dolfinx.io import gmshio as module
    return module


def _three(data, comm: MPI.Comm) -> tuple[Mesh, MeshTags, MeshTags]:
    """Mesh, cell tags, facet tags; empty tags where the model has none."""
    mesh, cell_tags, facet_tags = data[:3]
    tdim = mesh.topology.dim
    if facet_tags is None:
        mesh.topology.create_entities(tdim - 1)
        facet_tags = dolfinx.mesh.meshtags(
            mesh, tdim - 1, np.empty(0, np.int32), np.empty(0, np.int32)
        )
    return mesh, cell_tags, facet_tags


def model_to_mesh(
    model: Any,
    comm: MPI.Comm,
    rank: int = 0,
    gdim: int = 3,
    partitioner: Callable | None = None,
) -> tuple[Mesh, MeshTags, MeshTags]:
    """Turn a gmsh model with Lagrange cells into a mesh.

    Args:
        model: ``gmsh.model`` on ``rank``; ignored on the others, where it may be ``None``.
        comm: Communicator of the mesh.
        rank: The rank that holds the model.
        gdim: Geometric dimension.
        partitioner: From :func:`cell_partitioner`.

    Returns:
        ``(mesh, cell_tags, facet_tags)``; the tags are the model's physical groups. For hex20
        cells see :func:`dolfinx_mortar.mesh.model_to_hex20`.
    """
    data = _gmsh_module().model_to_mesh(model, comm, rank, gdim=gdim, partitioner=partitioner)
    return _three(data, comm)


def read_from_msh(
    path: str, comm: MPI.Comm, rank: int = 0, gdim: int = 3
) -> tuple[Mesh, MeshTags, MeshTags]:
    """Read a gmsh file; see :func:`model_to_mesh` for the return value."""
    return _three(_gmsh_module().read_from_msh(path, comm, rank, gdim=gdim), comm)


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


# -- Spaces and functions ---------------------------------------------------


def value_shape(V: fem.FunctionSpace) -> tuple[int, ...]:
    """Value shape of a space of point values: ``()``, ``(gdim,)``, ..."""
    return tuple(V.ufl_element().reference_value_shape)


def dofmap(V: fem.FunctionSpace) -> Any:
    """DOLFINx dofmap of a space on a mesh with one cell type."""
    return V.dofmap if hasattr(V, "dofmap") else V.dofmaps[0]


def interpolation_points(V: fem.FunctionSpace) -> npt.NDArray[np.floating]:
    """Reference points at which an expression is evaluated to interpolate it into ``V``.

    Returns:
        Points, shape ``(num_points, tdim)``.
    """
    points = V.element.interpolation_points
    return points() if callable(points) else points


# -- Linear algebra ---------------------------------------------------------


def create_vector(V: fem.FunctionSpace) -> PETSc.Vec:
    """Ghosted PETSc vector, zero, with the layout of ``V``."""
    index_map, bs = dofmap(V).index_map, dofmap(V).index_map_bs
    ghosts = index_map.ghosts.astype(PETSc.IntType)
    size = (index_map.size_local * bs, index_map.size_global * bs)
    b = PETSc.Vec().createGhost(ghosts, size, bsize=bs, comm=V.mesh.comm)
    with b.localForm() as local:
        local.set(0.0)
    return b


def create_matrix(a: fem.Form, mat_type: str | None = None) -> PETSc.Mat:
    """PETSc matrix with the sparsity pattern of a bilinear form."""
    return fem_petsc.create_matrix(a, mat_type)


def assemble_matrix(
    A: PETSc.Mat, a: fem.Form, bcs: Sequence[fem.DirichletBC] = (), diag: float = 1.0
) -> PETSc.Mat:
    """Assemble a bilinear form into a matrix, which is set to zero before.

    Args:
        A: From :func:`create_matrix`.
        a: Compiled bilinear form.
        bcs: Dirichlet conditions; their rows and columns become zero.
        diag: Value on the diagonal of those rows.

    Returns:
        ``A``, assembled.
    """
    A.zeroEntries()
    # The keyword is "diagonal" in 0.9 and "diag" since 0.10; the position is the same.
    fem_petsc.assemble_matrix(A, a, list(bcs), diag)
    A.assemble()
    return A


def assemble_vector(b: PETSc.Vec, L: fem.Form) -> PETSc.Vec:
    """Assemble a linear form into a vector, which is set to zero before.

    Returns:
        ``b``; ghost contributions are not yet sent to their owners.
    """
    with b.localForm() as local:
        local.set(0.0)
    fem_petsc.assemble_vector(b, L)
    return b


def apply_lifting(
    b: PETSc.Vec,
    a: Sequence[fem.Form],
    bcs: Sequence[Sequence[fem.DirichletBC]],
    x0: Sequence[PETSc.Vec] = (),
    alpha: float = 1.0,
) -> None:
    """``b -= alpha A (g - x0)`` for the constrained columns."""
    fem_petsc.apply_lifting(b, list(a), [list(bc) for bc in bcs], x0=list(x0), alpha=alpha)


def set_bc(
    b: PETSc.Vec,
    bcs: Sequence[fem.DirichletBC],
    x0: PETSc.Vec | None = None,
    alpha: float = 1.0,
) -> None:
    """``b = alpha (g - x0)`` in the constrained rows."""
    fem_petsc.set_bc(b, list(bcs), x0, alpha)


# -- Diagnostics --------------------------------------------------------------


def list_timings(comm: MPI.Comm) -> None:
    """Print DOLFINx's table of timers, maximum over ranks."""
    if hasattr(dolfinx.common, "TimingType"):
        dolfinx.common.list_timings(comm, [dolfinx.common.TimingType.wall])
    else:
        dolfinx.common.list_timings(comm)


#: Sum of ghost contributions, for ``la.Vector.scatter_reverse``
INSERT_ADD = dolfinx.la.InsertMode.add


def set_bc_values(bc: fem.DirichletBC, values: npt.NDArray[np.floating]) -> None:
    """Write the values of a Dirichlet condition into an array of local dofs.

    Args:
        bc: Condition.
        values: Owned and ghost values of its space, shape ``(n,)``.
    """
    bc.set(values, None, 1.0)
