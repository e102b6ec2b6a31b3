# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Boundaries of meshes as triangles and lines."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from dolfinx.cpp.mesh import cell_num_entities
from dolfinx.mesh import Mesh

from .. import compat


class Surface(NamedTuple):
    """A surface as triangles, and its cell edges as lines (``pyvista.PolyData``)."""

    faces: Any
    edges: Any


class _Lattice(NamedTuple):
    """A reference facet that is cut into small triangles."""

    points: npt.NDArray[np.float64]
    triangles: npt.NDArray[np.int64]
    lines: npt.NDArray[np.int64]
    """Points along each edge of the facet."""
    outside: float
    """Positive where triangles are numbered as seen from outside."""


class _Piece(NamedTuple):
    """Some facets, cut into triangles."""

    points: npt.NDArray[np.float64]
    triangles: npt.NDArray[np.int64]
    lines: npt.NDArray[np.int64]
    values: list[npt.NDArray[np.float64]]
    """Of each field, a row for each point."""


def _lattice(
    cell: basix.CellType, n: int
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Points, triangles and boundary lines of a reference facet that is cut n times."""
    triangle = cell == basix.CellType.triangle
    nodes = [(i, j) for j in range(n + 1) for i in range(n + 1 - j * triangle)]
    number = {node: k for k, node in enumerate(nodes)}
    triangles = []
    for i, j in nodes:
        corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
        here = [number.get(corner, -1) for corner in corners]
        if here[1] >= 0 and here[3] >= 0:
            triangles.append((here[0], here[1], here[3]))
            if here[2] >= 0:
                triangles.append((here[1], here[2], here[3]))
    steps = range(n + 1)
    lines = [[(i, 0) for i in steps], [(0, i) for i in steps]]
    if triangle:
        lines += [[(i, n - i) for i in steps]]
    else:
        lines += [[(i, n) for i in steps], [(n, i) for i in steps]]
    return (
        np.array(nodes) / n,
        np.array(triangles),
        np.array([[number[node] for node in line] for line in lines]),
    )


def _boundary(
    mesh: Mesh, where: Callable | None, cells: npt.NDArray[np.int32] | None
) -> npt.NDArray[np.int32]:
    """Boundary facets of the chosen cells as pairs (cell, local facet), owned cells only."""
    tdim = mesh.topology.dim
    mesh.topology.create_connectivity(tdim, tdim - 1)
    num_cells = mesh.topology.index_map(tdim).size_local
    per_cell = cell_num_entities(mesh.topology.cell_type, tdim - 1)
    cell_facets = mesh.topology.connectivity(tdim, tdim - 1).array
    cell_facets = cell_facets.reshape(-1, per_cell)[:num_cells]
    chosen = np.ones(num_cells, dtype=bool)
    if where is not None:
        centres = mesh.geometry.x[compat.geometry_dofmap(mesh)[:num_cells]].mean(axis=1)
        chosen = np.asarray(where(centres.T), dtype=bool)
    if cells is not None:
        chosen &= np.isin(np.arange(num_cells), cells)

    # The cell behind a facet may be on another rank.
    count = la.vector(mesh.topology.index_map(tdim - 1), 1, np.float64)
    count.array[:] = 0
    np.add.at(count.array, cell_facets[chosen].ravel(), 1)
    count.scatter_reverse(la.InsertMode.add)
    count.scatter_forward()
    pairs = np.argwhere(chosen[:, None] & (count.array[cell_facets] == 1))
    return pairs.astype(np.int32)


def _evaluate(
    u: fem.Function, cells: npt.NDArray[np.int32], X: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Values of a point-valued function at reference points, shape (cells, points, values)."""
    V = u.function_space
    element = V.ufl_element()
    dofmap = V.dofmap
    scalar = element.sub_elements[0] if element.block_size > 1 else element
    basis = scalar.basix_element.tabulate(0, X)[0, :, :, 0]
    values = u.x.array.reshape(-1, dofmap.index_map_bs)[dofmap.list[cells]]
    return np.einsum("qn,cnb->cqb", basis, values)


def surface(
    mesh: Mesh,
    fields: Mapping[str, fem.Function] | None = None,
    *,
    displacement: fem.Function | None = None,
    factor: float = 1.0,
    where: Callable[[npt.NDArray[np.float64]], npt.NDArray[np.bool_]] | None = None,
    cells: npt.NDArray[np.int32] | None = None,
    facets: npt.NDArray[np.int32] | None = None,
    subdivisions: int | None = None,
) -> Surface | None:
    """The boundary of a mesh, deformed, with fields on it; collective.

    Args:
        mesh: A mesh of tetrahedra or hexahedra.
        fields: Functions to carry along, by name; nodal or cell-wise elements, scalars or
            vectors.
        displacement: Displacement [length] by which points are moved.
        factor: Its scale.
        where: Takes cell centres, shape ``(3, num_cells)``, and tells which cells to show; cuts
            open a body.
        cells: Show these cells only (indices on this rank, such as ``cell_tags.find(1)``): one body
            of several.
        facets: Show these facets only (indices on this rank, such as ``tags.find(3)``).
        subdivisions: Cuts per facet edge; by default 1 for straight facets and 4 for curved.

    Returns:
        The surface on rank 0, ``None`` elsewhere.
    """
    fields = dict(fields or {})
    n = _subdivisions(mesh, displacement) if subdivisions is None else subdivisions
    pairs = _boundary(mesh, where, cells)
    if facets is not None:
        local = mesh.topology.connectivity(mesh.topology.dim, mesh.topology.dim - 1)
        shown = np.array([local.links(cell)[i] for cell, i in pairs], np.int32)
        pairs = pairs[np.isin(shown, facets)]
    handed = _handedness(mesh, pairs[:, 0])
    pieces = []
    for i in range(len(basix.topology(mesh.basix_cell())[mesh.topology.dim - 1])):
        chosen = pairs[:, 1] == i
        owners = pairs[chosen, 0]
        lattice = _facet_lattice(mesh.basix_cell(), i, n)
        x = _positions(mesh, owners, lattice.points)
        if displacement is not None:
            x = x + factor * _evaluate(displacement, owners, lattice.points)
        values = [_evaluate(u, owners, lattice.points) for u in fields.values()]
        pieces.append(_piece(lattice, handed[chosen], x, values))
    gathered = mesh.comm.gather(_join(pieces))
    return None if gathered is None else _as_polydata(_join(gathered), list(fields))


def _subdivisions(mesh: Mesh, displacement: fem.Function | None) -> int:
    """Cuts of a facet's edge with which it looks as it is."""
    elements = [mesh.ufl_domain().ufl_coordinate_element()]
    if displacement is not None:
        elements.append(displacement.function_space.ufl_element())
    straight = all(element.embedded_superdegree == 1 for element in elements)
    return 1 if straight and mesh.basix_cell() == basix.CellType.tetrahedron else 4


def _handedness(mesh: Mesh, cells: npt.NDArray[np.int32]) -> npt.NDArray[np.float64]:
    """Positive for right-handed cells, negative for left-handed ones, which DOLFINx may have."""
    nodes = compat.geometry_dofmap(mesh)[cells]
    third = 3 if mesh.basix_cell() == basix.CellType.tetrahedron else 4
    axes = mesh.geometry.x[nodes[:, [1, 2, third]]]
    return np.linalg.det(axes - mesh.geometry.x[nodes[:, :1]])


def _facet_lattice(cell: basix.CellType, facet: int, n: int) -> _Lattice:
    """A facet of a reference cell, cut n times; points in the cell's coordinates."""
    geometry, dim = basix.geometry(cell), len(basix.topology(cell)) - 2
    points, triangles, lines = _lattice(basix.cell.subentity_types(cell)[dim][facet], n)
    origin, a, b = geometry[basix.topology(cell)[dim][facet][:3]]
    outside = np.cross(a - origin, b - origin) @ basix.cell.facet_outward_normals(cell)[facet]
    return _Lattice(origin + points @ np.array([a - origin, b - origin]), triangles, lines, outside)


def _positions(
    mesh: Mesh, cells: npt.NDArray[np.int32], X: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Positions of reference points in cells, shape (cells, points, 3)."""
    element = mesh.ufl_domain().ufl_coordinate_element().sub_elements[0].basix_element
    basis = element.tabulate(0, X)[0, :, :, 0]
    return np.einsum("qn,cnd->cqd", basis, mesh.geometry.x[compat.geometry_dofmap(mesh)[cells]])


def _piece(
    lattice: _Lattice,
    handed: npt.NDArray[np.float64],
    x: npt.NDArray[np.float64],
    values: Sequence[npt.NDArray[np.float64]],
) -> _Piece:
    """The same facet of several cells, triangles numbered as seen from outside.

    Args:
        lattice: The facet, with n points.
        handed: From :func:`_handedness`.
        x: Positions of its points, shape (cells, n, 3).
        values: Values of each field, shape (cells, n, columns).
    """
    first = len(lattice.points) * np.arange(len(x))[:, None, None]
    outward = (lattice.outside * handed > 0)[:, None, None]
    triangles = np.where(outward, lattice.triangles, lattice.triangles[:, ::-1])
    return _Piece(
        x.reshape(-1, 3),
        (triangles + first).reshape(-1, 3),
        (lattice.lines + first).reshape(-1, lattice.lines.shape[1]),
        [v.reshape(-1, v.shape[2]) for v in values],
    )


def _join(pieces: Sequence[_Piece]) -> _Piece:
    """One piece of several."""
    start = np.cumsum([0] + [len(p.points) for p in pieces])
    return _Piece(
        np.concatenate([p.points for p in pieces]),
        np.concatenate([p.triangles + s for p, s in zip(pieces, start)]),
        np.concatenate([p.lines + s for p, s in zip(pieces, start)]),
        [np.concatenate(columns) for columns in zip(*(p.values for p in pieces))],
    )


def _as_polydata(piece: _Piece, names: Sequence[str]) -> Surface:
    """A surface as PyVista has it, with the values as fields of these names."""
    import pyvista as pv

    faces = pv.PolyData(piece.points, faces=np.insert(piece.triangles, 0, 3, axis=1).ravel())
    size = piece.lines.shape[1]
    edges = pv.PolyData(piece.points, lines=np.insert(piece.lines, 0, size, axis=1).ravel())
    for name, value in zip(names, piece.values, strict=True):
        faces.point_data[name] = value[:, 0] if value.shape[1] == 1 else value
    return Surface(faces, edges)
