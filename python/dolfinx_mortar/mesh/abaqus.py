# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Meshes from Abaqus input files."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
from dolfinx.mesh import Mesh, MeshTags

from ..elements import hex20
from .distribution import Arrays, distribute, on_rank
from .hexahedra import HEX_VERTICES, TET_EDGES, hex20_permutation, node_permutation


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
        cell, degree, edges = basix.CellType.tetrahedron, 1 + (num_nodes == 10), TET_EDGES
        element = basix.ufl.element("Lagrange", cell.name, degree, shape=(3,))
        permutation = node_permutation(cell, range(4), edges if degree == 2 else ())
        return _AbaqusElement(element, permutation, _TET_FACES)
    if num_nodes == 8:
        cell = basix.CellType.hexahedron
        element = basix.ufl.element("Lagrange", cell.name, 1, shape=(3,))
        return _AbaqusElement(element, node_permutation(cell, HEX_VERTICES, ()), _HEX_FACES)
    if num_nodes == 20:
        return _AbaqusElement(hex20(shape=(3,)), hex20_permutation("abaqus"), _HEX_FACES)
    return None


def _abaqus_blocks(path: Path) -> Iterator[tuple[str, dict[str, str], list[list[str]]]]:
    """Keyword, parameters and data lines of each block, upper case, comments removed."""
    keyword, continued = "", ""
    parameters: dict[str, str] = {}
    data: list[list[str]] = []
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
            inside: set[tuple[int, ...]] = set()
            for nodes in self.elements.values():
                for vertices in element.faces:
                    facet = tuple(sorted(nodes[v] for v in vertices))
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
) -> tuple[Arrays, str, dict[str, int], dict[str, int]]:
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
    arrays = Arrays(
        np.array([file.nodes[int(n)] for n in used]),
        np.searchsorted(used, cells)[:, element.permutation],
        np.array([cell_sets[file.block[n]] for n in file.elements], np.int32),
        np.searchsorted(used, facets),
        np.array([facet_tags[name] for name in tagged.values()], np.int32),
    )
    return arrays, file.kind, cell_sets, facet_tags


def read_abaqus(
    path: str | Path,
    comm: MPI.Intracomm,
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
    found = on_rank(comm, 0, lambda: _abaqus_arrays(Path(path), facet_sets))
    arrays = None if found is None else found[0]
    kind, cell_sets, facet_tags = comm.bcast(None if found is None else found[1:], root=0)
    element = _abaqus_element(kind)
    assert element is not None
    return AbaqusMesh(
        *distribute(comm, arrays, element.geometry, partitioner), cell_sets, facet_tags
    )
