# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""How evenly the integration of a contact is spread over ranks, and what the ranks exchange for it.

Hertz's problem of demo_hertz.py (neo-Hooke, one load from zero), and the half cylinders of
demo_sliding.py through their load steps, with facets left to the ranks that own their cells
("cells") and spread (Contact's option balance). For each: quadrature points of the rank that has
most of them relative to the mean, the largest of all steps; bytes that a rank receives in the
library's exchanges of a Newton iteration, largest and mean of the ranks; time of the slowest rank
in search, integration and linearisation, which means something only with a core for each rank.

    python3 tests/benchmarks/balance.py [--ranks 2 4 8] [--case hertz cylinders] [--level 1]
        [--steps 80]
"""

from __future__ import annotations

import argparse
import functools
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
from cost import timed
from dolfinx_mortar import cpp

sys.path.append(str(Path(__file__).parents[2] / "demos"))

PHASES = ("search", "integrate", "linearise")


def watch(rows: list[dict], balance: bool) -> None:
    """Let all contacts be balanced or not, and note points and bytes of every solve."""
    comm = MPI.COMM_WORLD
    solve = dm.ContactProblem.solve
    dm.Contact = functools.partial(dm.Contact, balance=balance)

    def watched(problem, *args, **kwargs):
        before = cpp.received_bytes()
        iterations = solve(problem, *args, **kwargs)
        received = (cpp.received_bytes() - before) / iterations
        (contact,) = problem.interfaces
        points = comm.allgather(contact.evaluation.nodal.num_points)
        all_bytes = comm.allgather(received)
        size = contact.force
        rows.append(
            {
                "facets": comm.allreduce(contact.data.slave.num_facets),
                "iterations": iterations,
                "points": points,
                "bytes": all_bytes,
                "force": [float(f) for f in size],
                "norm": float(np.sqrt(comm.allreduce(float(np.sum(problem.state.u**2))))),
            }
        )
        return iterations

    dm.ContactProblem.solve = watched


def hertz(level: int, steps: int) -> None:
    import demo_hertz

    domain, tags, _ = demo_hertz.levelled_mesh("hex20", 0.2, level, False)
    demo_hertz.solve(domain, tags, "hex20", "neo-hooke", 0.2)


def cylinders(level: int, steps: int) -> None:
    import demo_sliding

    demo_sliding.options.stop = steps
    demo_sliding.say = lambda text: None
    demo_sliding.solve(0.3, level, lambda step: "", lambda step, u, contact: None)


CASES = {"hertz": hertz, "cylinders": cylinders}


def case(arguments) -> None:
    """One case with one setting, in this process: its figures as JSON on rank 0."""
    rows: list[dict] = []
    watch(rows, arguments.balance == "spread")
    CASES[arguments.case[0]](arguments.level, arguments.steps)
    comm = MPI.COMM_WORLD
    seconds = comm.allreduce(sum(timed(f"~mortar: {p}") for p in PHASES), MPI.MAX)
    if comm.rank == 0:
        print("RESULT " + json.dumps({"rows": rows, "seconds": seconds}), flush=True)


def run(name: str, ranks: int, setting: str, arguments) -> dict:
    """One case with one setting, in processes of its own."""
    command = [shutil.which("mpirun") or "mpirun", "--oversubscribe", "-n", str(ranks)]
    command += [sys.executable, "-m", "mpi4py", __file__, "--case", name, "--balance", setting]
    command += ["--level", str(arguments.level), "--steps", str(arguments.steps)]
    environment = os.environ | {"OMPI_MCA_mpi_yield_when_idle": "1"}
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=environment)
    line = next(x for x in done.stdout.splitlines() if x.startswith("RESULT "))
    return json.loads(line.removeprefix("RESULT "))


def difference(a: list[dict], b: list[dict]) -> float:
    """Largest difference of two runs, relative to the largest value."""
    worst = 0.0
    for key in ("force", "norm"):
        x, y = (np.array([row[key] for row in rows]) for rows in (a, b))
        worst = max(worst, np.abs(x - y).max() / np.abs(x).max())
    return float(worst)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ranks", type=int, nargs="+", default=[2, 4, 8])
    parser.add_argument("--case", choices=list(CASES), nargs="+", default=list(CASES))
    parser.add_argument("--level", type=int, default=1, help="refinement of the demos")
    parser.add_argument("--steps", type=int, default=80, help="last step of the half cylinders")
    parser.add_argument("--balance", choices=("cells", "spread"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.balance:
        case(arguments)
        return
    columns = ("slave facets", "facets by", "points, most / mean", "kB, most", "kB, mean")
    columns += ("iterations", "time [s]", "difference")
    print("| case | ranks | " + " | ".join(columns) + " |", flush=True)
    print("|---|--:|--:|---|" + "--:|" * (len(columns) - 2), flush=True)
    for name in arguments.case:
        for ranks in arguments.ranks:
            reference = None
            for setting in ("cells", "spread"):
                result = run(name, ranks, setting, arguments)
                rows = result["rows"]
                points = np.array([row["points"] for row in rows], dtype=float)
                touched = points.sum(axis=1) > 0
                most = (points.max(axis=1) / points.mean(axis=1))[touched].max()
                received = np.array([row["bytes"] for row in rows]) / 1e3
                change = "" if reference is None else f"{difference(reference, rows):.0e}"
                reference = reference or rows
                print(
                    f"| {name} | {ranks} | {rows[0]['facets']} | {setting} | {most:.2f} "
                    f"| {received.max(axis=1).mean():.0f} | {received.mean():.0f} "
                    f"| {sum(row['iterations'] for row in rows)} | {result['seconds']:.2f} "
                    f"| {change} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
