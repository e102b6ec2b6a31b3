# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Blocks that meet at non-matching interfaces, as cases, for tests of whole problems."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from mpi4py import MPI

import cases
import numpy as np

ELEMENT = {kind: element for element, kind in cases.FACET_KIND.items()}
E, NU = 1000.0, 0.3
ELASTIC = cases.linear_elastic(E, NU)
FACES = {"x-": 10, "x+": 11, "y-": 12, "y+": 13, "z-": 14, "z+": 15}
NORMAL = {name: np.eye(3)["xyz".index(name[0])] * (1 if name[1] == "+" else -1) for name in FACES}


def stress_of(strain: np.ndarray) -> np.ndarray:
    """Linear elastic stress of a strain."""
    lmbda, mu = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
    return lmbda * np.trace(strain) * np.eye(3) + 2 * mu * strain


def block(
    name: str,
    element: str,
    lower: Sequence[float],
    upper: Sequence[float],
    cells: Sequence[int],
    energy: cases.Energy | None = None,
    bottom: Callable | None = None,
    top: Callable | None = None,
) -> cases.Part:
    """A block whose faces are tagged as in `FACES`; with curved bottom or top on request."""
    x, y = (np.linspace(lower[i], upper[i], cells[i] + 1) for i in range(2))
    points, hexes = cases.extrude(
        *cases.grid(x, y),
        bottom or (lambda x, y: lower[2]),
        top or (lambda x, y: upper[2]),
        cells[2],
        tetrahedra=element.startswith("tet"),
    )
    middle = (lower[2] + upper[2]) / 2

    def tag(x):
        sides = [cases.near(p[i])(x[:, i]) for i in range(2) for p in (lower, upper)]
        ends = [x[:, 2] < middle, x[:, 2] > middle]
        return np.select(sides + ends, list(FACES.values()), 0)

    return cases.Part(name, element, energy or ELASTIC, points, hexes, tag)


def assemble(
    parts: list[cases.Part],
    interfaces: list[cases.Interface],
    dirichlet: list[cases.Dirichlet],
    *,
    comm: MPI.Comm = MPI.COMM_WORLD,
    one_mesh: bool = False,
    **more,
) -> cases.Case:
    """A case of parts."""
    bodies = cases._bodies(comm, parts, one_mesh)
    return cases.Case("blocks", parts, *bodies, interfaces, dirichlet, **more)


def stressed_blocks(
    slave: str,
    master: str,
    strain: np.ndarray,
    *,
    cells: tuple = ((3, 3, 1), (2, 2, 1)),
    one_mesh: bool = False,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> cases.Case:
    """A block (part 0, slave) on another one under tractions of a constant stress.

    They are held at three vertices of the lower block only, in as many components as a rigid body
    has motions.

    Args:
        slave: Element of the upper block.
        master: Element of the lower block.
        strain: The strain, symmetric.
        cells: Cells of both.
        one_mesh: Whether both share a mesh.
        comm: Communicator.
    """
    parts = [
        block("upper", slave, (0, 0, 1), (1, 1, 2), cells[0]),
        block("lower", master, (0, 0, 0), (1, 1, 1), cells[1]),
    ]
    stress = stress_of(strain)
    loads = [
        cases.SurfaceLoad(p, FACES[face], tuple(stress @ NORMAL[face]))
        for p, free in ((0, "z+"), (1, "z-"))
        for face in (free, "x-", "x+", "y-", "y+")
    ]
    supports = [
        cases.Dirichlet(1, at(*p), c, value=lambda t, p=p: strain @ np.array(p))
        for p, c in (((0, 0, 0), (0, 1, 2)), ((1, 0, 0), (1, 2)), ((0, 1, 0), (2,)))
    ]
    if one_mesh:  # tags of both parts' sides are the same, and so are the tractions
        loads = [load for load in loads if load.part == 0 or load.tag == FACES["z-"]]
    return assemble(
        parts,
        [tie(0, 1)],
        supports,
        comm=comm,
        one_mesh=one_mesh,
        surface_loads=loads,
        exact=lambda part, x: strain @ x,
    )


def at(*point: float) -> Callable[[np.ndarray], np.ndarray]:
    """Test for one point."""
    return lambda x: np.all([cases.near(c)(x[i]) for i, c in enumerate(point)], axis=0)


def tie(slave: int, master: int, slave_face: str = "z-", master_face: str = "z+"):
    """A tied interface of two blocks."""
    return cases.Interface("tie", [(slave, FACES[slave_face])], [(master, FACES[master_face])])


def wave(x, y):
    """A curved interface."""
    return 1 + 0.15 * np.cos(2 * x - 0.3) * np.sin(2.5 * y + 0.4)


def curved_blocks(
    slave: str, master: str, dirichlet, *, comm=MPI.COMM_WORLD, isoparametric=False, **more
):
    """Two blocks with a curved interface, each with its own faceted version of it."""
    parts = [
        block("upper", slave, (0, 0, 1), (1, 1, 2), (3, 4, 2), bottom=wave),
        block("lower", master, (0, 0, 0), (1, 1, 1), (2, 3, 2), top=wave),
    ]
    for part in parts:
        part.isoparametric = isoparametric
    return assemble(parts, [tie(0, 1)], dirichlet, comm=comm, **more)
