# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Meshes of 20-node hexahedra, which DOLFINx's own readers refuse, and Abaqus input files."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh, MeshTags

from . import compat
from .elements import hex20

__all__ = [
    "AbaqusMesh",
    "create_hex20_mesh",
    "hex20_permutation",
    "model_to_hex20",
    "read_abaqus",
]

# Basix numbers the vertices of a hexahedron as a tensor product; all formats here go around the
# bottom and then around the top.
_HEX_VERTICES = (0, 1, 3, 2, 4, 5, 7, 6)

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
_TET_EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))


def _permutation(
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
    return _permutation(basix.CellType.hexahedron, _HEX_VERTICES, _HEX_EDGES[order])


def create_hex20_mesh(
    comm: MPI.Comm,
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


class _Arrays(NamedTuple):
    """A mesh as the rank that read it holds it."""

    points: npt.NDArray[np.float64]
    cells: npt.NDArray[np.int64]
    """In Basix's node order."""
    cell_values: npt.NDArray[np.int32]
    facets: npt.NDArray[np.int64]
    """Vertices only."""
    facet_values: npt.NDArray[np.int32]


def _on_rank(comm: MPI.Comm, rank: int, task: Callable[[], Any]) -> Any:
    """Run a task on one rank; if it fails, all ranks raise the same error."""
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


def _distribute(
    comm: MPI.Comm,
    rank: int,
    arrays: _Arrays | None,
    element: basix.ufl._ElementBase,
    partitioner: Callable | None = None,
) -> tuple[Mesh, MeshTags, MeshTags]:
    """Mesh and tags from the arrays that one rank holds."""
    num_vertices, num_facet_vertices = {
        basix.CellType.tetrahedron: (4, 3),
        basix.CellType.hexahedron: (8, 4),
    }[element.cell_type]
    if comm.rank != rank:
        arrays = _Arrays(
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


# -- gmsh -----------------------------------------------------------------

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


def _gmsh_arrays(model: Any) -> _Arrays:
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
    return _Arrays(
        points,
        np.searchsorted(used, cells)[:, hex20_permutation("gmsh")],
        cell_values,
        np.searchsorted(used, corners),
        facet_values,
    )


def model_to_hex20(
    model: Any, comm: MPI.Comm, rank: int = 0, partitioner: Callable | None = None
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
    arrays = _on_rank(comm, rank, lambda: _gmsh_arrays(model))
    return _distribute(comm, rank, arrays, hex20(shape=(3,)), partitioner)


# -- Abaqus ---------------------------------------------------------------


class AbaqusMesh(NamedTuple):
    """What :func:`read_abaqus` finds in a file."""

    mesh: Mesh
    cell_tags: MeshTags
    facet_tags: MeshTags
    cell_sets: dict[str, int]
    """Tag of each element set."""
    facet_sets: dict[str, int]
    """Tag of each surface."""


_HEX_FACES = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))
_TET_FACES = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))


class _AbaqusElement(NamedTuple):
    geometry: basix.ufl._ElementBase
    permutation: list[int]
    faces: tuple[tuple[int, ...], ...]
    """Vertices of the faces S1, S2, ..."""


def _abaqus_element(name: str) -> _AbaqusElement | None:
    # Letters after the number of nodes (R, I, H, ...) choose an integration, not other nodes.
    match = re.match(r"C3D(\d+)(?!\d)", name)
    num_nodes = int(match.group(1)) if match else 0
    if num_nodes in (4, 10):
        cell, degree, edges = basix.CellType.tetrahedron, 1 + (num_nodes == 10), _TET_EDGES
        element = basix.ufl.element("Lagrange", cell.name, degree, shape=(3,))
        permutation = _permutation(cell, range(4), edges if degree == 2 else ())
        return _AbaqusElement(element, permutation, _TET_FACES)
    if num_nodes == 8:
        cell = basix.CellType.hexahedron
        element = basix.ufl.element("Lagrange", cell.name, 1, shape=(3,))
        return _AbaqusElement(element, _permutation(cell, _HEX_VERTICES, ()), _HEX_FACES)
    if num_nodes == 20:
        return _AbaqusElement(hex20(shape=(3,)), hex20_permutation("abaqus"), _HEX_FACES)
    return None


def _abaqus_blocks(path: Path) -> Iterator[tuple[str, dict[str, str], list[list[str]]]]:
    """Keyword, parameters and data lines of each block, upper case, comments removed."""
    keyword, parameters, data = "", {}, []
    continued = ""
    for line in path.read_text().splitlines():
        line = line.strip().upper()
        if not line or line.startswith("**"):
            continue
        if line.startswith("*") or continued:
            line = continued + line
            if line.endswith(","):
                continued = line
                continue
            continued = ""
            if keyword:
                yield keyword, parameters, data
            keyword, *rest = (part.strip() for part in line[1:].split(","))
            parameters = {
                key.strip(): value.strip() for key, _, value in (p.partition("=") for p in rest)
            }
            data = []
        else:
            data.append([part.strip() for part in line.split(",")])
    if keyword:
        yield keyword, parameters, data


class _AbaqusFile:
    """Contents of an input file, with Abaqus's own numbers of nodes and elements."""

    def __init__(self, path: Path):
        self.nodes: dict[int, list[float]] = {}
        self.elements: dict[int, list[int]] = {}
        self.kind: str = ""
        self.element_sets: dict[str, list[int]] = {}
        self.node_sets: dict[str, list[int]] = {}
        self.surfaces: dict[str, list[tuple[str, int]]] = {}
        self.block: dict[int, str] = {}
        """Element set that each element was defined with."""
        parts = 0
        for keyword, parameters, data in _abaqus_blocks(path):
            if keyword == "NODE":
                self._read_nodes(parameters, data)
            elif keyword == "ELEMENT":
                self._read_elements(path, parameters, data)
            elif keyword == "ELSET":
                self._read_set(self.element_sets, parameters["ELSET"], parameters, data)
            elif keyword == "NSET":
                self._read_set(self.node_sets, parameters["NSET"], parameters, data)
            elif keyword == "SURFACE" and parameters.get("TYPE", "ELEMENT") == "ELEMENT":
                self._read_surface(path, parameters["NAME"], data)
            elif keyword == "INCLUDE" or (keyword == "INSTANCE" and data):
                raise ValueError(f"{path}: *{keyword} is not supported: write one flat input file")
            parts += keyword == "PART"
        if parts > 1:
            raise ValueError(
                f"{path}: {parts} parts, whose numbers overlap, are not supported: let Abaqus "
                "write the input file without parts and assemblies"
            )
        if not self.elements:
            raise ValueError(f"{path}: no solid elements (C3D4, C3D8, C3D10 or C3D20) found")

    def _read_nodes(self, parameters: dict[str, str], data: list[list[str]]) -> None:
        for number, *x in data:
            self.nodes[int(number)] = [float(value.replace("D", "E")) for value in x[:3]]
        if "NSET" in parameters:
            names = self.node_sets.setdefault(parameters["NSET"], [])
            names.extend(int(line[0]) for line in data)

    def _read_elements(self, path: Path, parameters: dict[str, str], data: list[list[str]]) -> None:
        name = parameters.get("TYPE", "")
        element = _abaqus_element(name)
        if element is None:
            if name.startswith("C3D"):
                raise ValueError(f"{path}: elements of type {name} are not supported")
            return  # Shells, masses, connectors ... have no place in a mesh of solids.
        if self.kind and _abaqus_element(self.kind) != element:
            raise ValueError(
                f"{path}: elements of type {self.kind} and {name}: a DOLFINx mesh has one type "
                "of cell, so write one file per type and tie the meshes"
            )
        self.kind = name
        size = 1 + len(element.permutation)
        values = [int(value) for line in data for value in line if value]
        if len(values) % size:
            raise ValueError(f"{path}: an element of type {name} has too few nodes")
        numbers = values[::size]
        for i, number in enumerate(numbers):
            self.elements[number] = values[i * size + 1 : (i + 1) * size]
        block = parameters.get("ELSET", "")
        self.block.update(dict.fromkeys(numbers, block))
        self.element_sets.setdefault(block, []).extend(numbers)

    def _read_surface(self, path: Path, name: str, data: list[list[str]]) -> None:
        faces = self.surfaces.setdefault(name, [])
        for where, *face in data:
            if not face or not re.fullmatch(r"S[1-6]", face[0]):
                raise ValueError(
                    f"{path}: surface {name} names no faces S1 to S6 of solid elements: "
                    f"{', '.join((where, *face))}"
                )
            faces.append((where, int(face[0][1])))

    @staticmethod
    def _read_set(
        sets: dict[str, list[int]], name: str, parameters: dict[str, str], data: list[list[str]]
    ) -> None:
        members = sets.setdefault(name, [])
        for line in data:
            entries = [entry for entry in line if entry]
            if "GENERATE" in parameters:
                first, last, *step = map(int, entries)
                members.extend(range(first, last + 1, *step))
            else:
                for entry in entries:
                    members.extend([int(entry)] if entry.isdigit() else sets[entry])

    def faces(self, name: str, element: _AbaqusElement) -> set[tuple[int, ...]]:
        """Sorted vertices of the facets of a surface or, failing that, of a node set."""
        found = set()
        if name in self.surfaces:
            for where, face in self.surfaces[name]:
                for number in [int(where)] if where.isdigit() else self.element_sets[where]:
                    nodes = self.elements[number]
                    found.add(tuple(sorted(nodes[v] for v in element.faces[face - 1])))
        elif name in self.node_sets:
            members = set(self.node_sets[name])
            inside = set()
            for nodes in self.elements.values():
                for face in element.faces:
                    facet = tuple(sorted(nodes[v] for v in face))
                    if members.issuperset(facet):
                        # A facet that is seen twice lies inside the body.
                        (inside if facet in found else found).add(facet)
            found -= inside
        else:
            raise ValueError(
                f"there is no surface or node set {name!r}: the file has the surfaces "
                f"{sorted(self.surfaces)} and the node sets {sorted(self.node_sets)}"
            )
        return found


def _abaqus_arrays(
    path: Path, facet_sets: Sequence[str] | None
) -> tuple[_Arrays, str, dict[str, int], dict[str, int]]:
    file = _AbaqusFile(path)
    element = _abaqus_element(file.kind)
    assert element is not None

    cell_sets = {name: i + 1 for i, name in enumerate(dict.fromkeys(file.block.values()))}
    cells = np.array(list(file.elements.values()), np.int64)

    names = list(file.surfaces) if facet_sets is None else [name.upper() for name in facet_sets]
    tagged: dict[tuple[int, ...], str] = {}
    for name in names:
        for facet in file.faces(name, element):
            if tagged.setdefault(facet, name) != name:
                raise ValueError(
                    f"{path}: {tagged[facet]} and {name} overlap, but a facet has one tag: "
                    "choose with facet_sets"
                )
    facet_tags = {name: i + 1 for i, name in enumerate(names)}

    used = np.unique(cells)
    missing = [int(n) for n in used if int(n) not in file.nodes]
    if missing:
        raise ValueError(f"{path}: node {missing[0]} is used but not defined")
    facets = np.array(list(tagged), np.int64).reshape(-1, len(element.faces[0]))
    arrays = _Arrays(
        np.array([file.nodes[int(n)] for n in used]),
        np.searchsorted(used, cells)[:, element.permutation],
        np.array([cell_sets[file.block[n]] for n in file.elements], np.int32),
        np.searchsorted(used, facets),
        np.array([facet_tags[name] for name in tagged.values()], np.int32),
    )
    return arrays, file.kind, cell_sets, facet_tags


def read_abaqus(
    path: str | Path,
    comm: MPI.Comm,
    facet_sets: Sequence[str] | None = None,
    partitioner: Callable | None = None,
) -> AbaqusMesh:
    """Read the mesh of an Abaqus input file (C3D4, C3D8, C3D10 or C3D20 and their variants).

    Understood are ``*NODE``, ``*ELEMENT``, ``*NSET``, ``*ELSET`` (also ``GENERATE``) and
    ``*SURFACE, TYPE=ELEMENT``; materials, steps and other keywords are passed over. Abaqus's
    C3D20 has its edge nodes at the bottom (1-2, 2-3, 3-4, 4-1), at the top and at the uprights,
    as VTK has.

    Args:
        path: File, read on rank 0.
        comm: Communicator of the mesh.
        facet_sets: Names of surfaces or node sets whose facets get tags 1, 2, ... in this order.
            A node set stands for the boundary facets that have all their vertices in it.
            ``None`` takes all surfaces of the file in its order.
        partitioner: From :func:`dolfinx_mortar.compat.cell_partitioner`.

    Returns:
        Mesh, with hex20 geometry for C3D20, its tags, and names of the tags in upper case. Cells
        are tagged 1, 2, ... by the ``ELSET`` of their ``*ELEMENT`` block.

    Raises:
        ValueError: On every rank: for several parts or cell types, for overlapping or unknown
            surfaces, for undefined nodes.
        OSError: On every rank, if the file cannot be read.
    """
    found = _on_rank(comm, 0, lambda: _abaqus_arrays(Path(path), facet_sets))
    arrays = found[0] if comm.rank == 0 else None
    kind, cell_sets, facet_tags = comm.bcast(found[1:] if comm.rank == 0 else None, root=0)
    element = _abaqus_element(kind)
    assert element is not None
    return AbaqusMesh(
        *_distribute(comm, 0, arrays, element.geometry, partitioner), cell_sets, facet_tags
    )
