# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Direct solver and multigrid on blocks of several shapes: CPU time of one solve.

A block, its top pressed down, on a rigid sphere of thirty times its length, with small strains.

    python3 tests/benchmarks/shapes.py [--shape "cube, hex20" ...]
"""

from __future__ import annotations

import argparse
import time

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import ufl
from dolfinx import fem, mesh

E, NU = 1000.0, 0.3
SOLVERS = {"direct": {"pc_type": "lu"}, "multigrid": {"pc_type": "gamg"}}
# Cells and sides
SHAPES = {
    "cube, hex20": ((12, 12, 12), (1.0, 1.0, 1.0)),
    "cube, hex27": ((10, 10, 10), (1.0, 1.0, 1.0)),
    "beam, hex20": ((40, 6, 6), (40 / 6, 1.0, 1.0)),
    "beam, hex27": ((40, 6, 6), (40 / 6, 1.0, 1.0)),
    "plate, hex27": ((30, 30, 2), (15.0, 15.0, 1.0)),
    "slice, hex20": ((60, 60, 1), (60.0, 60.0, 1.0)),
    "slice of flat cells, hex20": ((60, 60, 1), (60.0, 60.0, 0.3)),
}


def solve(name: str, options: dict) -> tuple[int, float, int]:
    """Displacements, CPU time of this rank [s], Newton iterations."""
    cells, sides = SHAPES[name]
    kind = mesh.CellType.hexahedron
    domain = mesh.create_box(MPI.COMM_WORLD, [(0, 0, 0), sides], cells, kind)
    space = dm.hex20((3,)) if name.endswith("hex20") else ("Lagrange", 2, (3,))
    V = fem.functionspace(domain, space)
    domain.topology.create_connectivity(2, 3)
    below, above = (
        mesh.locate_entities_boundary(domain, 2, lambda x, z=z: np.isclose(x[2], z))
        for z in (0.0, sides[2])
    )
    tags = mesh.meshtags(domain, 2, below, np.full(len(below), 1, np.int32))
    u = fem.Function(V)
    eps = ufl.sym(ufl.grad(u))
    lmbda, mu = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
    energy = (lmbda / 2 * ufl.tr(eps) ** 2 + mu * ufl.inner(eps, eps)) * ufl.dx(degree=4)
    F = ufl.derivative(energy, u, ufl.TestFunction(V))
    motion = np.array([0.0, 0.0, -0.01 * sides[2]])
    bcs = [fem.dirichletbc(motion, fem.locate_dofs_topological(V, 2, above), V)]
    radius = 30 * sides[0]
    ball = dm.RigidSphere((sides[0] / 2, sides[1] / 2, -radius), radius)
    contact = dm.Contact(V, tags, slave=1, master=ball)
    with dm.ContactProblem(F, u, bcs=bcs, interfaces=[contact], petsc_options=options) as problem:
        start = time.process_time()
        newton = problem.solve()
        seconds = time.process_time() - start
    return 3 * V.dofmap.index_map.size_global, seconds, newton


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shape", choices=SHAPES, nargs="+", default=list(SHAPES))
    arguments = parser.parse_args()
    root = MPI.COMM_WORLD.rank == 0
    if root:
        print("| shape | displacements | solver | time [s] | Newton |\n|---|--:|---|--:|--:|")
    for name in arguments.shape:
        for solver, options in SOLVERS.items():
            size, seconds, newton = solve(name, options)
            if root:
                print(f"| {name} | {size} | {solver} | {seconds:.1f} | {newton} |", flush=True)


if __name__ == "__main__":
    main()
