# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""A block in the corner of a floor and two walls, for tests of edges of the slave surface."""

from __future__ import annotations

from mpi4py import MPI

import blocks
import cases
from blocks import FACES

PRESSURE = (3.0, 5.0, 8.0)


def corner(
    slave: str,
    master: str,
    *,
    energy: cases.Energy | None = None,
    pressure: tuple = PRESSURE,
    walls: int = 2,
    cells: tuple = (3, 2),
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> cases.Case:
    """A unit block (part 0, slave) pressed on a floor (part 1) and on walls (parts 2 and 3).

    Dead loads press it, contact alone holds it. Floor and walls are as large as its faces and free
    to expand, so that at small strains all stresses are constant.

    Args:
        slave: Element of the block.
        master: Element of floor and walls.
        energy: Of all bodies; linear elastic by default.
        pressure: Loads in the directions x, y and z per area.
        walls: Number of walls; without a wall the block is held by a symmetry plane there.
        cells: Cells of the block in each direction, and of a side of the walls.
        comm: Communicator.
    """
    n, m = cells
    near = cases.near
    parts = [
        blocks.block("block", slave, (0, 0, 0), (1, 1, 1), (n, n, n), energy),
        blocks.block("floor", master, (0, 0, -0.5), (1, 1, 0), (m, m, 1), energy),
        blocks.block("wall x", master, (-0.5, 0, 0), (0, 1, 1), (1, m, m), energy),
        blocks.block("wall y", master, (0, -0.5, 0), (1, 0, 1), (m, 1, m), energy),
    ][: 2 + walls]
    faces = ["z-", "x-", "y-"][: 1 + walls]
    held = []
    for p in range(1, 2 + walls):
        low = [0.0, 0.0, 0.0]
        low[(2, 0, 1)[p - 1]] = -0.5
        held += [cases.Dirichlet(p, lambda x, c=c, v=low[c]: near(v)(x[c]), (c,)) for c in range(3)]
    held += [cases.Dirichlet(0, lambda x, c=c: near(0)(x[c]), (c,)) for c in range(walls, 2)]
    contact = cases.Interface(
        "contact",
        [(0, FACES[f]) for f in faces],
        [(1 + k, FACES[f.replace("-", "+")]) for k, f in enumerate(faces)],
        initially_active=False,
    )
    loads = []
    for c, name in enumerate("xyz"):
        traction = [0.0, 0.0, 0.0]
        traction[c] = -pressure[c]
        loads.append(cases.SurfaceLoad(0, FACES[name + "+"], tuple(traction)))
    return blocks.assemble(parts, [contact], held, comm=comm, surface_loads=loads)
