# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Time, iterations and memory of Hertz's problem against the number of unknowns.

The hemisphere of demo_hertz.py on its plane, hex20, multigrid; every level in a process of its own,
since memory is the largest that a process has had. Beside it, in another one, the same bodies
without contact: one linear elastic solve on the same mesh, by the same multigrid, to 1e-8, the
plane's side of the hemisphere held near the pole. "Times" is what the problem takes, set-up of mesh
and forms left out, in units of that solve. On several ranks, times are those of rank 0, memory is
the sum.

    python3 tests/benchmarks/scaling.py [--levels 2 4 6] [--material neo-hooke] [--ranks 1]
        [--option NAME=VALUE ...] [--alone] [--picture pressure.png] [--out scaling.json]

Level 17 has three million unknowns; `--alone` leaves out the elastic solve.
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path

from mpi4py import MPI

import numpy as np
import ufl
from cost import timed
from dolfinx import fem
from dolfinx.common import timing

sys.path.append(str(Path(__file__).parents[2] / "demos"))
import demo_hertz as hertz

PHASES = ("assemble", "search", "linearise", "condense", "set up", "solve")
LOAD = 0.2


def cpu() -> float:
    """CPU time of this process so far [s]."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def counted(name: str) -> int:
    """How often a timer of the library has run; a direct solver has no set-up."""
    try:
        return timing(name)[0]
    except RuntimeError:
        return 0


def peak() -> float:
    """Largest resident memory of all processes so far [B]."""
    return MPI.COMM_WORLD.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)


def elastic(level: int, options: dict) -> dict:
    """One linear elastic solve by the same solver: CPU time [s] and iterations.

    An interface far from all else gives it to the bodies alone.
    """
    domain, tags, _ = hertz.levelled_mesh("hex20", LOAD, level, False)
    V = hertz.displacement_space(domain, "hex20")
    u, v = fem.Function(V), ufl.TestFunction(V)
    dx = ufl.dx(domain=domain, metadata={"quadrature_degree": 5})
    ds = ufl.ds(domain=domain, subdomain_data=tags, metadata={"quadrature_degree": 5})
    F = ufl.derivative(hertz.energy(u, "linear") * dx, u, v) + LOAD * v[2] * ds(hertz.TOP)
    bcs = hertz.supports(V, tags, False)
    dofs = fem.locate_dofs_topological(V.sub(2), 2, tags.find(hertz.CAP))
    bcs.append(fem.dirichletbc(0.0, dofs, V.sub(2)))
    plane = hertz.dm.RigidPlane((0, 0, 10 * hertz.R), (0, 0, -1))
    far = hertz.dm.Contact(V, tags, slave=hertz.TOP, master=plane, geometry="reference")
    settings = {"pc_type": "gamg", "ksp_rtol": 1e-8} | {
        k: value for k, value in options.items() if not k.startswith("snes")
    }
    with hertz.dm.ContactProblem(
        F, u, bcs=bcs, interfaces=[far], petsc_options=settings, jit_options=hertz.FAST
    ) as problem:
        start = cpu()
        problem.solve()
        seconds = cpu() - start
        return {"elastic cpu": seconds, "elastic iterations": problem._cpp_object.ksp.its}


def draw_pressure(path: Path, interface, dofs: int) -> None:
    """Nodal pressures over the distance from the axis, with Hertz's."""
    field = interface.pressure
    V = field.function_space
    nodes = fem.locate_dofs_topological(V, 2, interface.slave[0].tags.find(hertz.CAP))
    nodes = nodes[nodes < V.dofmap.index_map.size_local]
    x = V.tabulate_dof_coordinates()[nodes]
    mine = np.column_stack([np.hypot(x[:, 0], x[:, 1]), field.x.array[nodes]])
    gathered = V.mesh.comm.gather(mine)
    if gathered is None:
        return
    import matplotlib.pyplot as plt

    r, p = np.concatenate(gathered).T
    largest, radius = hertz.hertz(LOAD)
    curve = np.linspace(0, radius, 400)
    figure, axis = plt.subplots(figsize=(7, 4.5), layout="constrained")
    axis.plot(r, p, ".", markersize=2, label=f"{dofs:,}".replace(",", " ") + " unknowns, hex20")
    axis.plot(curve, largest * np.sqrt(1 - (curve / radius) ** 2), "k", linewidth=1, label="Hertz")
    axis.set(xlabel="distance from the axis", ylabel="pressure", xlim=(0, 1.3 * radius))
    axis.legend()
    figure.savefig(path, dpi=120)


def contact(level: int, material: str, options: dict, picture: Path | None = None) -> dict:
    """The problem: CPU time [s], of phases too, iterations and memory."""
    domain, tags, _ = hertz.levelled_mesh("hex20", LOAD, level, False)
    per_solve: list[int] = []
    monitored: dict = {}

    def solve(*args, **kwargs):
        # The solve alone is measured, and its Krylov iterations counted
        problem = args[0]

        def count(ksp, iteration, norm):
            if iteration == 0:
                per_solve.append(0)
            per_solve[-1] = iteration

        problem._cpp_object.ksp.setMonitor(count)
        start, wall = cpu(), time.perf_counter()
        result = original(*args, **kwargs)
        monitored["cpu"], monitored["seconds"] = cpu() - start, time.perf_counter() - wall
        return result

    original = hertz.dm.ContactProblem.solve
    hertz.dm.ContactProblem.solve = solve
    try:
        u, interface, problem, newton = hertz.solve(
            domain, tags, "hex20", material, LOAD, petsc_options={"pc_type": "gamg"} | options
        )
    finally:
        hertz.dm.ContactProblem.solve = original
    V = u.function_space
    dofs = 3 * V.dofmap.index_map.size_global
    if picture:
        draw_pressure(picture, interface, dofs)
    pressure = domain.comm.allreduce(interface.pressure.x.array.max(), MPI.MAX)
    return monitored | {
        "level": level,
        "dofs": dofs,
        "newton": newton,
        "krylov": per_solve,
        "largest pressure": float(pressure),
        "norm": float(np.sqrt(domain.comm.allreduce(np.sum(_owned(u) ** 2)))),
        "set-ups": counted("~mortar: set up"),
        **{phase: timed(f"~mortar: {phase}") for phase in PHASES},
    }


def _owned(u):
    index_map = u.function_space.dofmap.index_map
    return u.x.array[: 3 * index_map.size_local]


def case(arguments) -> None:
    """One solve of a level, in this process: prints its figures as JSON on rank 0."""
    options = dict(o.split("=", 1) for o in arguments.option)
    level = arguments.levels[0]
    if arguments.reference:
        row = elastic(level, options)
    else:
        row = contact(level, arguments.material, options, arguments.picture)
        row["bytes"] = peak()
    if MPI.COMM_WORLD.rank == 0:
        print("RESULT " + json.dumps(row), flush=True)


def run(level: int, arguments) -> dict:
    """One level: contact, and the elastic solve, each in processes of its own.

    The one that comes second in a process would find the memory that the first one has left.
    """
    command = [sys.executable, "-m", "mpi4py", __file__, "--case", "--levels", str(level)]
    command += ["--material", arguments.material]
    for option in arguments.option:
        command += ["--option", option]
    command += ["--picture", str(arguments.picture)] if arguments.picture else []
    if arguments.ranks > 1:
        mpirun = shutil.which("mpirun") or "mpirun"
        command = [mpirun, "-n", str(arguments.ranks), *command]

    def figures(*more: str) -> dict:
        done = subprocess.run([*command, *more], stdout=subprocess.PIPE, text=True, check=True)
        line = next(x for x in done.stdout.splitlines() if x.startswith("RESULT "))
        return json.loads(line.removeprefix("RESULT "))

    row = figures()
    if arguments.alone:
        return row | {"elastic cpu": float("nan"), "elastic iterations": 0}
    return row | figures("--reference")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--levels", type=int, nargs="+", default=[2, 4, 6])
    parser.add_argument("--material", choices=hertz.MATERIALS, default="neo-hooke")
    parser.add_argument("--ranks", type=int, default=1)
    parser.add_argument("--option", action="append", default=[], help="of PETSc, NAME=VALUE")
    parser.add_argument("--alone", action="store_true", help="without the elastic solve")
    parser.add_argument("--picture", type=Path, help="draw the pressures of the last level")
    parser.add_argument("--out", type=Path, help="write figures to this JSON file")
    parser.add_argument("--case", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--reference", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.case:
        case(arguments)
        return
    rows = []
    columns = ("dofs", "kB/dof", "wall [s]", "cpu [s]", "times", "elastic [s]", "iterations")
    print("| " + " | ".join((*columns, *PHASES, "set-ups", "of contact")) + " |", flush=True)
    print("|" + "--:|" * (len(columns) + len(PHASES) + 1) + "---|", flush=True)
    for level in arguments.levels:
        row = run(level, arguments)
        rows.append(row)
        cells = [
            f"{row['dofs']}",
            f"{row['bytes'] / row['dofs'] / 1e3:.2f}",
            f"{row['seconds']:.1f}",
            f"{row['cpu']:.1f}",
            f"{row['cpu'] / row['elastic cpu']:.2f}",
            f"{row['elastic cpu']:.1f}",
            f"{row['elastic iterations']}",
            *(f"{row[phase]:.1f}" for phase in PHASES),
            f"{row['set-ups']}",
            " ".join(map(str, row["krylov"])),
        ]
        print("| " + " | ".join(cells) + " |", flush=True)
    if arguments.out:
        arguments.out.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
