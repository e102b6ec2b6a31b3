# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Iterations of GMRES with multigrid, from mesh to mesh and from case to case.

Blocks that are pressed together: a small one on a large one, whose cells are 3/2 as large. Every
linear system is solved to 1e-8 with a preconditioner of its own, so that the numbers are those of
the systems, and not of how far Newton's iteration has got.

    python3 tests/benchmarks/flatness.py [--cells 6 9 12 18] [--case NAME ...] [--option NAME=VALUE]
                                         [--multiplier NAME]
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import ufl
from dolfinx import default_scalar_type, fem, mesh

TOP, BOTTOM = 1, 2
SETTINGS = {
    "pc_type": "gamg",
    "ksp_type": "gmres",
    "ksp_rtol": 1e-8,
    "ksp_max_it": 1000,
    "pc_mortar_reuse": False,
}
# Lowest and highest corner of each block
LOWER = ((0.0, 0.0, 0.0), (1.0, 1.0, 0.5))
UPPER = ((0.1, 0.1, 0.5), (0.9, 0.9, 0.9))
LID = ((0.0, 0.0, 0.9), (1.0, 1.0, 1.4))


def case(element="hex27", stiffness=1.0, nu=0.3, motion=(0.0, 0.0), loose=False, **interface):
    """Settings of a case: Young's modulus of the upper block over that of the lower one, motion of
    its top along x and y; a third block above a loose one; `tie`, or options of a contact."""
    return {
        "element": element,
        "stiffness": stiffness,
        "nu": nu,
        "motion": motion,
        "loose": loose,
        "interface": interface,
    }


CASES = {
    "tie": case(tie=True),
    "tie, tet10": case("tet10", tie=True),
    "tie, hex20": case("hex20", tie=True),
    "tie, nu = 0.49": case(nu=0.49, tie=True),
    "tie, 1000 times stiffer above": case(stiffness=1000.0, tie=True),
    "tie, 1000 times softer above": case(stiffness=1e-3, tie=True),
    "contact": case(),
    "contact, tet10": case("tet10"),
    "contact, hex8": case("hex8"),
    "contact, nu = 0.49": case(nu=0.49),
    "friction 0.5, most nodes stick": case(motion=(0.002, 0.0), friction=0.5),
    "friction 0.2, all nodes slip": case(motion=(0.05, 0.0), friction=0.2),
    "friction 0.2, all nodes slip, reference": case(
        motion=(0.05, 0.0), friction=0.2, geometry="reference"
    ),
    "three blocks, friction 0.3 alone holds one": case(loose=True, friction=0.3),
}


def block(comm, corners, size: float, element: str):
    """A box of cells, facets of its faces below and above tagged."""
    low, high = np.array(corners)
    cells = [max(1, round(length / size)) for length in high - low]
    kind = mesh.CellType.tetrahedron if element == "tet10" else mesh.CellType.hexahedron
    domain = mesh.create_box(comm, [low, high], cells, kind)
    facets, values = [], []
    for tag, z in ((BOTTOM, low[2]), (TOP, high[2])):
        found = mesh.locate_entities_boundary(domain, 2, lambda x, z=z: np.isclose(x[2], z))
        facets.append(found)
        values.append(np.full(len(found), tag, np.int32))
    facets, values = np.concatenate(facets), np.concatenate(values)
    order = np.argsort(facets)
    return domain, mesh.meshtags(domain, 2, facets[order], values[order])


def body(comm, corners, size, element, E, nu):
    """Displacement, facet tags and residual of a linear elastic block, in cells of a given size."""
    domain, tags = block(comm, corners, size, element)
    degree = 1 if element == "hex8" else 2
    space = dm.hex20((3,)) if element == "hex20" else ("Lagrange", degree, (3,))
    u = fem.Function(fem.functionspace(domain, space))
    mu = fem.Constant(domain, default_scalar_type(E / (2 * (1 + nu))))
    lmbda = fem.Constant(domain, default_scalar_type(E * nu / ((1 + nu) * (1 - 2 * nu))))
    eps = ufl.sym(ufl.grad(u))
    energy = (lmbda / 2 * ufl.tr(eps) ** 2 + mu * ufl.inner(eps, eps)) * ufl.dx(degree=4)
    return u, tags, ufl.derivative(energy, u, ufl.TestFunction(u.function_space))


def hold(u, tags, tag, value):
    V = u.function_space
    value = fem.Constant(V.mesh, np.array(value, default_scalar_type))
    return fem.dirichletbc(value, fem.locate_dofs_topological(V, 2, tags.find(tag)), V)


def solve(n: int, settings: dict, options: dict) -> dict:
    """Unknowns, iterations of GMRES for each Newton step, and seconds."""
    comm, element = MPI.COMM_WORLD, settings["element"]
    interface = dict(settings["interface"])
    tied = interface.pop("tie", False)
    fine, coarse, nu = 1.0 / n, 1.5 / n, settings["nu"]
    shift = [*settings["motion"], -0.005]
    bodies = [
        body(comm, UPPER, fine, element, settings["stiffness"], nu),
        body(comm, LOWER, coarse, element, 1.0, nu),
    ]
    if settings["loose"]:
        bodies.append(body(comm, LID, coarse, element, 1.0, nu))
    top = bodies[-1] if settings["loose"] else bodies[0]
    bcs = [hold(*top[:2], TOP, shift), hold(*bodies[1][:2], BOTTOM, [0.0, 0.0, 0.0])]
    pairs = [(0, BOTTOM, 1, TOP)] + ([(0, TOP, 2, BOTTOM)] if settings["loose"] else [])
    interfaces = []
    for slave, slave_tag, master, master_tag in pairs:
        V = tuple(bodies[b][0].function_space for b in (slave, master))
        tags = tuple(bodies[b][1] for b in (slave, master))
        kind = dm.Tie if tied else dm.Contact
        interfaces.append(kind(V, tags, slave=slave_tag, master=master_tag, **interface))
    per_solve: list[int] = []

    def count(ksp, iteration, norm):
        if iteration == 0:
            per_solve.append(0)
        per_solve[-1] = iteration

    u = [b[0] for b in bodies]
    with dm.ContactProblem(
        [b[2] for b in bodies], u, bcs=bcs, interfaces=interfaces, petsc_options=SETTINGS | options
    ) as problem:
        problem._cpp_object.ksp.setMonitor(count)
        start = time.perf_counter()
        problem.solve()
        seconds = time.perf_counter() - start
    dofs = sum(3 * w.function_space.dofmap.index_map.size_global for w in u)
    return {"cells": n, "dofs": dofs, "krylov": per_solve, "seconds": seconds}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--cells",
        type=int,
        nargs="+",
        default=[6, 9, 12, 18],
        help="per unit length, of the small block",
    )
    parser.add_argument("--case", choices=CASES, nargs="+", default=list(CASES))
    parser.add_argument("--option", action="append", default=[], help="of PETSc, NAME=VALUE")
    parser.add_argument("--multiplier", help="space of the multipliers, instead of the default")
    parser.add_argument("--out", type=Path, help="write figures to this JSON file")
    arguments = parser.parse_args()
    options = dict(o.split("=", 1) for o in arguments.option)
    if arguments.multiplier:
        for settings in CASES.values():
            settings["interface"]["multiplier"] = arguments.multiplier
    root = MPI.COMM_WORLD.rank == 0
    rows = []
    if root:
        print("| case | unknowns: most iterations of a system (Newton steps), of the last one |")
        print("|---|---|")
    for name in arguments.case:
        cells = []
        for n in arguments.cells:
            try:
                row = solve(n, CASES[name], options)
            except dm.ConvergenceError as error:
                row = {"cells": n, "error": str(error)}
                cells.append(f"n = {n}: failed, {str(error)[:60]}")
            else:
                cells.append(
                    f"{row['dofs']}: {max(row['krylov'])} ({len(row['krylov'])}), "
                    f"last {row['krylov'][-1]}"
                )
            rows.append({"case": name} | row)
        if root:
            print(f"| {name} | " + "; ".join(cells) + " |", flush=True)
    if arguments.out and root:
        arguments.out.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
