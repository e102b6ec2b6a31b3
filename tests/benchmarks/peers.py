# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Hertz's problem beside CalculiX's mortar contact: time, memory and errors, in one run.

The hemisphere of demo_hertz.py on its plane, a quarter, hex20, small strains, without friction. Its
mesh is written as input of CalculiX: the same nodes, C3D20 cells (with the same 27 points of
integration), supports and pressure, the spherical cap as slave and the one fixed cell of the plane
as master, `*CONTACT PAIR, TYPE=MORTAR` (dual multipliers) with hard contact, one increment, and its
default solver, in Debian SPOOLES, a direct one. Only the plane differs: it reaches further, beyond
the planes of symmetry, since CalculiX may lose multipliers of slave nodes on edges of the master,
and is higher by a millionth of the radius, since CalculiX starts with the nodes that touch and
needs one; contact alone holds the body, so that this moves it and changes no pressure. This library
runs with its direct solver and with multigrid. Neither code is given an active set, each has its
default tolerances (CalculiX's: a force residual of 0.5 %, a correction of 1 %) and one thread.

Each solution has a process of its own. "Wall" and "cpu" are the time and "memory" the largest
resident memory of the whole process. CalculiX's reads a mesh and writes fields; this library's
starts Python, makes the mesh and stores pressures, but finds its forms compiled, with the demo's
options; "solve" is the time of the nonlinear solve alone. "Newton" counts iterations, also those of
increments given up. "Ratio" is CalculiX's wall time in units of the row's. "Force" is the contact
force, of CalculiX the sum of the slave nodes' reactions, which should be the load, and "∫ p" the
integral of the interpolated nodal pressures, which is near it on fine meshes. Pressures of both
codes are compared with Hertz's alike, with the measures of the demo: "peak" is the error of the
largest pressure, "largest" the largest error of nodes within 0.85 of Hertz's radius, both of
Hertz's largest pressure, and "L2" the relative error in the norm L2 on the slave surface.

    python3 tests/benchmarks/peers.py [--sizes 7x12 10x17] [--ccx PATH] [--contact MORTAR]
        [--solvers direct multigrid] [--limit 3600] [--keep FOLDER] [--out peers.json]

A size is the number of cells along the fine cube at the pole and of layers around it; 2, 4, 6 are
levels 0, 1, 2 of the demo, and 4 is a quick check. The program of CalculiX is `ccx` (Debian:
calculix-ccx).
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import dolfinx_mortar as dm
import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx_mortar.mesh import hex20_permutation
from scipy.spatial import cKDTree

sys.path.append(str(Path(__file__).parents[2] / "demos"))
import demo_hertz as hertz

LOAD = 0.2
RAISED = 1e-6 * hertz.R  # the plane of CalculiX
SOLVERS = {"direct": {"ksp_type": "preonly", "pc_type": "lu"}, "multigrid": {"pc_type": "gamg"}}
TYPES = ("MORTAR", "PGMORTAR", "LINMORTAR", "PGLINMORTAR")

# Corners of the faces S1 to S6, and DOLFINx's number of each corner of a hexahedron
FACES = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
CORNERS = (0, 1, 3, 2, 4, 5, 7, 6)

# A process starts with the resident memory of the one that forks it as its largest one. So a small
# one starts the program, in the place of this one, which has loaded DOLFINx.
LAUNCHER = """
import json, resource, subprocess, sys, time
limit, report, *command = sys.argv[1:]
start = time.perf_counter()
try:
    code = subprocess.run(command, stdin=subprocess.DEVNULL, timeout=float(limit)).returncode
except subprocess.TimeoutExpired:
    code = None
wall = time.perf_counter() - start
usage = resource.getrusage(resource.RUSAGE_CHILDREN)
row = {"code": code, "wall": wall, "cpu": usage.ru_utime + usage.ru_stime}
with open(report, "w") as file:
    json.dump(row | {"bytes": usage.ru_maxrss * 1024}, file)
"""


def launch(command: list[str], folder: Path, name: str, limit: float) -> dict:
    """Run a program in a folder; its wall and CPU time [s] and its largest memory [B].

    Args:
        command: The program and its arguments.
        folder: Where it runs and where its output goes, to a file `name`.log.
        name: See `folder`.
        limit: Time [s] after which it is ended.

    Raises:
        RuntimeError: If it fails or takes too long.
    """
    report, log = folder / f"{name}.json", folder / f"{name}.log"
    launcher = [sys.executable, "-S", "-c", LAUNCHER, str(limit), str(report)]
    with log.open("w") as output:
        subprocess.run(
            [*launcher, *command],
            cwd=folder,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=os.environ | {"OMP_NUM_THREADS": "1"},
            check=True,
        )
    row = json.loads(report.read_text())
    if (code := row.pop("code")) is None:
        raise RuntimeError(f"took more than {limit:g} s")
    if code != 0:
        last = [line for line in log.read_text().splitlines() if line.strip()][-4:]
        raise RuntimeError(f"ended with code {code}: {' / '.join(last)}")
    return row


def size(text: str) -> tuple[int, int]:
    """Numbers of cells along the fine cube and of layers around it, of "7x12" or of "7"."""
    cells, _, layers = text.partition("x")
    return int(cells), int(layers or round(1.5 * int(cells)))


def meshed(text: str) -> tuple:
    """The demo's mesh in any size, and its tags."""
    cells, layers = size(text)
    a = 1.26 * hertz.hertz(LOAD)[1]
    growth = hertz.grading(a / 2, 3, 2 * hertz.R - a) ** (3 / layers)
    return hertz.hemisphere("hex20", a, cells, layers, growth)


# -- CalculiX ----------------------------------------------------------------------------------


def faces(domain, facets: np.ndarray) -> list[tuple[int, int]]:
    """Cell and face of facets, both from 1, in CalculiX's numbers."""
    topology = domain.topology
    for dims in ((2, 3), (2, 0), (3, 0)):
        topology.create_connectivity(*dims)
    found = []
    for facet in facets:
        cell = topology.connectivity(2, 3).links(facet)[0]
        vertices = topology.connectivity(3, 0).links(cell)[list(CORNERS)]
        wanted = set(topology.connectivity(2, 0).links(facet))
        face = next(i for i, c in enumerate(FACES) if set(vertices[list(c)]) == wanted)
        found.append((int(cell) + 1, face + 1))
    return found


def write_input(path: Path, W, tags, contact: str) -> None:
    """Write the problem as input of CalculiX.

    Args:
        path: The file.
        W: Scalar hex20 space; its dofs, counted from 1, are the nodes.
        tags: Of facets.
        contact: One of TYPES.
    """
    domain = W.mesh
    order, dofs = hex20_permutation("abaqus"), W.dofmap.list
    nodes = np.empty_like(dofs)
    nodes[:, order] = dofs
    at = {tag: faces(domain, tags.find(tag)) for tag in (hertz.CAP, hertz.MASTER, hertz.TOP)}
    on = {
        "CAP_NODES": fem.locate_dofs_topological(W, 2, tags.find(hertz.CAP)),
        "SYMMETRY_X": fem.locate_dofs_topological(W, 2, tags.find(hertz.SYMMETRY_X)),
        "SYMMETRY_Y": fem.locate_dofs_topological(W, 2, tags.find(hertz.SYMMETRY_Y)),
        "PLANE": np.unique(dofs[mesh.locate_entities(domain, 3, lambda x: x[2] < 1e-10)]),
    }
    x, plane = W.tabulate_dof_coordinates(), on["PLANE"]
    # Slave nodes in planes of symmetry would be on the master's edges, outside by rounding, and
    # lose their multipliers
    x[plane, :2] = 2 * x[plane, :2] - x[plane, :2].max(axis=0)
    # Where rounding leaves a gap at the pole, nothing holds the body at first
    x[plane, 2] += RAISED
    lines = ["*NODE, NSET=BODIES"]
    # A number may have 20 characters
    for i, point in enumerate(x, 1):
        lines.append(f"{i}, " + ", ".join(f"{c:.12e}" for c in point))
    lines.append("*ELEMENT, TYPE=C3D20, ELSET=BODIES")
    for i, cell in enumerate(nodes + 1, 1):
        lines += [", ".join(map(str, (i, *cell[:10]))) + ",", ", ".join(map(str, cell[10:]))]
    for name, members in on.items():
        lines += [f"*NSET, NSET={name}", *(f"{i + 1}," for i in members)]
    for name, tag in (("CAP", hertz.CAP), ("MASTER", hertz.MASTER)):
        lines += [f"*SURFACE, NAME={name}", *(f"{cell}, S{face}" for cell, face in at[tag])]
    lines += ["*MATERIAL, NAME=SOFT", "*ELASTIC", f"{hertz.E}, {hertz.nu}"]
    lines += ["*SOLID SECTION, ELSET=BODIES, MATERIAL=SOFT"]
    lines += ["*BOUNDARY", "PLANE, 1, 3", "SYMMETRY_X, 1", "SYMMETRY_Y, 2"]
    lines += [f"*CONTACT PAIR, INTERACTION=HARD, TYPE={contact}", "CAP, MASTER"]
    # Without a law of pressure and overclosure, mortar contact is hard
    lines += ["*SURFACE INTERACTION, NAME=HARD"]
    lines += ["*STEP", "*STATIC", "1., 1., 1e-3", "*DLOAD"]
    lines += [f"{cell}, P{face}, {LOAD}" for cell, face in at[hertz.TOP]]
    lines += ["*NODE PRINT, NSET=CAP_NODES, TOTALS=ONLY", "RF", "*CONTACT FILE", "CDIS, CSTR"]
    path.write_text("\n".join([*lines, "*END STEP"]) + "\n")


def read_pressure(path: Path, W) -> fem.Function:
    """Nodal contact pressures, CPRESS, of the last increment in a file of results."""
    blocks = path.read_text().split(" -4  CONTACT")
    if len(blocks) == 1:
        raise RuntimeError("wrote no contact pressures")
    lines = blocks[-1].split("\n -3")[0].splitlines()
    names = [line.split()[1] for line in lines if line.startswith(" -5")]
    start = 13 + 12 * names.index("CPRESS")  # fixed columns, which may leave no blanks
    pressure = fem.Function(W)
    for line in lines:
        if line.startswith(" -1"):
            pressure.x.array[int(line[3:13]) - 1] = float(line[start : start + 12])
    return pressure


def calculix(program: str, W, tags, arguments, folder: Path) -> tuple[dict, fem.Function]:
    """Figures and pressure of CalculiX."""
    write_input(folder / "hertz.inp", W, tags, arguments.contact)
    for old in folder.glob("hertz.[!i]*"):  # of a run before that was kept
        old.unlink()
    row = launch([program, "hertz"], folder, "calculix", arguments.limit)
    pressure = read_pressure(folder / "hertz.frd", W)
    total = (folder / "hertz.dat").read_text().split("total force")[-1].split("\n")[2]
    # Step, increment, attempt (with a U if it failed), iterations and times
    attempts = [line.split() for line in (folder / "hertz.sta").read_text().splitlines()[2:]]
    version = re.search(r"Version\s+([\w.]+)", (folder / "calculix.log").read_text())
    return row | {
        "code": f"CalculiX {version[1] if version else ''}, {arguments.contact}",
        "newton": sum(int(words[3]) for words in attempts if len(words) > 3),
        "force": float(total.split()[2]),
    }, pressure


# -- This library ------------------------------------------------------------------------------


def case(text: str, solver: str, path: Path) -> None:
    """Solve in this process, and store nodal pressures and figures.

    Unlike in the demo, no active set is given in advance.
    """
    domain, tags = meshed(text)
    V = hertz.displacement_space(domain, "hex20")
    u, v = fem.Function(V), ufl.TestFunction(V)
    options = {"domain": domain, "metadata": {"quadrature_degree": 5}}
    load = fem.Constant(domain, LOAD)
    top = ufl.ds(subdomain_data=tags, **options)(hertz.TOP)
    energy = hertz.energy(u, "linear") * ufl.dx(**options)
    contact = dm.Contact(
        V,
        tags,
        slave=hertz.CAP,
        master=hertz.MASTER,
        geometry="reference",
        normal=(0, 0, -1),
        multiplier="dual",
    )
    problem = dm.ContactProblem(
        ufl.derivative(energy, u, v) + load * v[2] * top,
        u,
        bcs=hertz.supports(V, tags, False),
        interfaces=[contact],
        petsc_options_prefix="peers_",
        petsc_options=SOLVERS[solver],
        jit_options=hertz.FAST,
    )
    start = time.perf_counter()
    newton = problem.solve()
    seconds = time.perf_counter() - start
    np.savez(
        path,
        x=contact.pressure.function_space.tabulate_dof_coordinates(),
        pressure=contact.pressure.x.array,
        newton=newton,
        force=contact.force[2],
        solve=seconds,
    )


def library(text: str, solver: str, W, arguments, folder: Path) -> tuple[dict, fem.Function]:
    """Figures and pressure of this library."""
    path = folder / f"{solver}.npz"
    command = [sys.executable, str(Path(__file__).resolve()), "--case", str(path)]
    command += ["--sizes", text, "--solvers", solver]
    row = launch(command, folder, solver, arguments.limit)
    with np.load(path) as stored:
        pressure = fem.Function(W)
        # Another process may number the nodes otherwise
        nearest = cKDTree(stored["x"]).query(W.tabulate_dof_coordinates())[1]
        pressure.x.array[:] = stored["pressure"][nearest]
        row |= {name: float(stored[name]) for name in ("force", "solve")}
        row["newton"] = int(stored["newton"])
    return row, pressure


# -- Table -------------------------------------------------------------------------------------


def errors(pressure: fem.Function, tags) -> dict:
    """Errors of a pressure against Hertz's, and its resultant."""
    largest = hertz.hertz(LOAD)[0]
    options = {"domain": pressure.function_space.mesh, "subdomain_data": tags}
    ds = ufl.ds(**options, metadata={"quadrature_degree": 5})
    return {
        "peak": float(pressure.x.array.max() / largest - 1),
        "largest": hertz.largest_error(pressure, tags, LOAD),
        "L2": hertz.pressure_error(pressure, tags, LOAD),
        "integral": float(fem.assemble_scalar(fem.form(pressure * ds(hertz.CAP)))),
    }


def compare(text: str, program: str, arguments, folder: Path) -> list[dict]:
    """Rows of all codes for one mesh, each printed as soon as it is there."""
    domain, tags = meshed(text)
    W = fem.functionspace(domain, dm.hex20())
    problem = {"size": text, "dofs": 3 * W.dofmap.index_map.size_global}
    problem["applied"] = hertz.applied_force(domain, tags, LOAD)
    common = {"W": W, "arguments": arguments, "folder": folder}
    runs = {f"CalculiX, {arguments.contact}": partial(calculix, program, tags=tags, **common)}
    for solver in arguments.solvers:
        runs[f"dolfinx_mortar, {solver}"] = partial(library, text, solver, **common)
    rows: list[dict] = []
    for code, run in runs.items():
        row = {"code": code} | problem
        try:
            figures, pressure = run()
            row |= figures | errors(pressure, tags)
            if "wall" in (first := (rows or [row])[0]):
                row["ratio"] = first["wall"] / row["wall"]
        except RuntimeError as error:
            row["failure"] = str(error)
        rows.append(row)
        print(formatted(row), flush=True)
    return rows


COLUMNS = ("code", "unknowns", "wall [s]", "cpu [s]", "solve [s]", "memory [MB]", "Newton")
COLUMNS += ("load", "force", "∫ p", "peak [%]", "largest [%]", "L2 [%]", "ratio")


def formatted(row: dict) -> str:
    """A row of the table."""
    if "failure" in row:
        return f"| {row['code']} | {row['dofs']} | {row['failure']} |"
    cells = [row["code"], f"{row['dofs']}", f"{row['wall']:.1f}", f"{row['cpu']:.1f}"]
    cells += [f"{row['solve']:.1f}" if "solve" in row else "", f"{row['bytes'] / 1e6:.0f}"]
    cells += [f"{row['newton']}"]
    cells += [f"{row[name]:.4f}" for name in ("applied", "force", "integral")]
    cells += [f"{100 * row[name]:.2f}" for name in ("peak", "largest", "L2")]
    cells += [f"{row['ratio']:.2f}" if "ratio" in row else ""]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", nargs="+", default=["7x12", "10x17"])
    parser.add_argument("--ccx", help="the program, instead of ccx in the PATH")
    parser.add_argument("--contact", choices=TYPES, default="MORTAR", help="type of CalculiX's")
    parser.add_argument("--solvers", choices=SOLVERS, nargs="+", default=list(SOLVERS))
    parser.add_argument("--limit", type=float, default=3600.0, help="of a solution's time [s]")
    parser.add_argument("--keep", type=Path, help="keep input and results in this folder")
    parser.add_argument("--out", type=Path, help="write figures to this JSON file")
    parser.add_argument("--case", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.case:
        case(arguments.sizes[0], arguments.solvers[0], arguments.case)
        return
    program = shutil.which(arguments.ccx or "ccx")
    if program is None:
        parser.error(
            f"there is no program {arguments.ccx or 'ccx'}: install CalculiX (Debian: apt install "
            "calculix-ccx) or name its solver with --ccx PATH"
        )
    rows = []
    with tempfile.TemporaryDirectory(prefix="peers-") as temporary:
        base = arguments.keep.resolve() if arguments.keep else Path(temporary)
        folders = {text: base / text for text in ("2", *arguments.sizes)}
        for folder in folders.values():
            folder.mkdir(parents=True, exist_ok=True)
        # Compiles forms
        space = fem.functionspace(meshed("2")[0], dm.hex20())
        library("2", "direct", space, arguments, folders["2"])
        print("| " + " | ".join(COLUMNS) + " |", flush=True)
        print("|---|" + "--:|" * (len(COLUMNS) - 1), flush=True)
        for text in arguments.sizes:
            rows += compare(text, os.path.abspath(program), arguments, folders[text])
            if arguments.out:
                arguments.out.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
