# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Cost of the interface against the bulk, phase by phase.

Two cubes of hex27, n³ cells over (2 n / 3)³, slave the finer side: the time of the mortar
matrices, of the contact terms with their linearisation and of the condensation, as shares of the
time it takes to assemble the bulk's tangent in the same run; then the time against the number of
slave facets.

    python3 tests/benchmarks/cost.py [--n 20] [--scaling]
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from pathlib import Path

from mpi4py import MPI

import basix.ufl
import dolfinx
import dolfinx_mortar as dm
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.common import timing
from dolfinx.fem import petsc
from dolfinx.mesh import locate_entities_boundary, meshtags
from dolfinx_mortar import compat, cpp

SLAVE, MASTER = 3, 7


def assemble(A, a):
    """Assemble a bilinear form into a matrix that has its pattern."""
    A.zeroEntries()
    petsc.assemble_matrix(A, a)
    A.assemble()


def two_cubes(n: int, m: int):
    """Unit cubes of n³ cells (above, slave) and m³ cells (below), with facet tags."""

    def cube(n, z0):
        g = np.linspace(0, 1, n + 1)
        x = np.stack(np.meshgrid(g + z0, g, g, indexing="ij")[::-1], axis=-1).reshape(-1, 3)
        i, j, k = np.meshgrid(*3 * [np.arange(n)], indexing="ij")
        first = ((i * (n + 1) + j) * (n + 1) + k).ravel()
        steps = [c * (n + 1) ** 2 + b * (n + 1) + a for c in (0, 1) for b in (0, 1) for a in (0, 1)]
        return x, first[:, None] + np.array(steps)

    x1, c1 = cube(n, 0.0)
    x2, c2 = cube(m, -1.0)
    x, cells = np.vstack([x1, x2]), np.vstack([c1, c2 + len(x1)]).astype(np.int64)
    if MPI.COMM_WORLD.rank > 0:
        x, cells = x[:0], cells[:0]
    element = basix.ufl.element("Lagrange", "hexahedron", 1, shape=(3,))
    mesh = compat.create_mesh(MPI.COMM_WORLD, cells, element, x)
    mesh.topology.create_connectivity(2, 3)
    facets = locate_entities_boundary(mesh, 2, lambda x: np.isclose(x[2], 0))
    above = (
        dolfinx.mesh.compute_midpoints(
            mesh,
            3,
            np.array([mesh.topology.connectivity(2, 3).links(f)[0] for f in facets], np.int32),
        )[:, 2]
        > 0
    )
    values = np.where(above, SLAVE, MASTER).astype(np.int32)
    return mesh, meshtags(mesh, 2, facets, values)


def best(function, repeats: int = 3) -> float:
    """Shortest time of some calls [s]."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def memory() -> float:
    """Peak resident memory [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def interface_only(n: int) -> dict:
    """Time of search, D and M, and derivatives for n² slave facets, without a bulk problem."""
    mesh, tags = two_cubes_slab(n)
    V = fem.functionspace(mesh, ("Lagrange", 2, (3,)))
    contact = dm.Contact(V, tags, slave=SLAVE, master=MASTER)
    u = fem.Function(V)
    F = ufl.inner(ufl.grad(u), ufl.grad(ufl.TestFunction(V))) * ufl.dx
    p = dm.ContactProblem(F, u, interfaces=[contact])
    return measure_interface(p, contact) | {"facets": n * n}


def two_cubes_slab(n: int):
    """A layer of n² cells over one of (2 n / 3)² cells."""
    m = max(1, round(2 * n / 3))

    def slab(n, z0):
        g = np.linspace(0, 1, n + 1)
        z = np.array([z0, z0 + 1])
        x = np.stack(np.meshgrid(z, g, g, indexing="ij")[::-1], axis=-1).reshape(-1, 3)
        j, k = np.meshgrid(*2 * [np.arange(n)], indexing="ij")
        first = (j * (n + 1) + k).ravel()
        steps = [c * (n + 1) ** 2 + b * (n + 1) + a for c in (0, 1) for b in (0, 1) for a in (0, 1)]
        return x, first[:, None] + np.array(steps)

    x1, c1 = slab(n, 0.0)
    x2, c2 = slab(m, -1.0)
    element = basix.ufl.element("Lagrange", "hexahedron", 1, shape=(3,))
    mesh = compat.create_mesh(
        MPI.COMM_WORLD,
        np.vstack([c1, c2 + len(x1)]).astype(np.int64),
        element,
        np.vstack([x1, x2]),
    )
    mesh.topology.create_connectivity(2, 3)
    facets = locate_entities_boundary(mesh, 2, lambda x: np.isclose(x[2], 0))
    cells = np.array([mesh.topology.connectivity(2, 3).links(f)[0] for f in facets], np.int32)
    above = dolfinx.mesh.compute_midpoints(mesh, 3, cells)[:, 2] > 0
    return mesh, meshtags(mesh, 2, facets, np.where(above, SLAVE, MASTER).astype(np.int32))


def measure_interface(p: dm.ContactProblem, c: dm.Contact) -> dict:
    """Times [s] of the phases of an interface, every slave node in contact."""
    u = np.concatenate([w.x.array for w in (p.u if isinstance(p.u, list) else [p.u])])
    slave, master = c.data.slave, c.data.master
    x = [cpp.current_positions(s, u) for s in (slave, master)]
    configuration, basis = cpp.configure(c.data, *x), c.state.basis
    sizes = p.coupling.size, p.coupling.layout.size

    def matrices():
        for name in ("D", "M"):
            cpp.mortar_matrix(c.data, basis, configuration, *sizes, name).destroy()

    return {
        "search": best(lambda: cpp.find_candidates(slave, x[0], master, x[1])),
        "integrate": best(lambda: cpp.integrate(c.data, basis, configuration)),
        "D and M": best(matrices),
    }


def timed(name: str) -> float:
    """Time that a timer of the library has counted so far [s]."""
    try:
        total = timing(name)[1]
    except RuntimeError:
        return 0.0
    return total.total_seconds() if hasattr(total, "total_seconds") else float(total)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, default=20, help="cells along an edge of the slave cube")
    parser.add_argument("--scaling", action="store_true", help="time against number of facets")
    parser.add_argument("--out", type=Path, help="write figures to this JSON file")
    args = parser.parse_args()
    comm = MPI.COMM_WORLD
    results: dict = {}

    n, m = args.n, round(2 * args.n / 3)
    mesh, tags = two_cubes(n, m)
    V = fem.functionspace(mesh, ("Lagrange", 2, (3,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    E, nu = 1000.0, 0.3
    mu, lmbda = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))

    def eps(w):
        return ufl.sym(ufl.grad(w))

    def sigma(w):
        return 2 * mu * eps(w) + lmbda * ufl.tr(eps(w)) * ufl.Identity(3)

    dx = ufl.dx(metadata={"quadrature_degree": 4})
    linear = fem.form(ufl.inner(sigma(ufl.TrialFunction(V)), eps(v)) * dx)
    K = petsc.create_matrix(linear)
    results["stiffness"] = best(lambda: assemble(K, linear), 2)
    K.destroy()

    c, beta = mu / 2, nu / (1 - 2 * nu)
    Fg = ufl.Identity(3) + ufl.grad(u)
    J = ufl.det(Fg)
    psi = c * (ufl.inner(Fg, Fg) - 3) + c / beta * (J ** (-2 * beta) - 1)
    F = ufl.derivative(psi * dx, u, v)
    bcs = []
    for z, value in ((-1.0, 0.0), (1.0, -0.01)):
        dofs = fem.locate_dofs_geometrical(V, lambda x, z=z: np.isclose(x[2], z))
        bcs.append(fem.dirichletbc(np.array([0.0, 0.0, value]), dofs, V))
    before = memory()
    contact = dm.Contact(V, tags, slave=SLAVE, master=MASTER, initial_active="all")
    # The condensed matrix is made for a direct solver alone, and this model is large
    direct = {"ksp_type": "preonly", "pc_type": "lu"}
    problem = dm.ContactProblem(F, u, bcs=bcs, interfaces=[contact], petsc_options=direct)
    results["set-up memory [MB]"] = memory() - before
    # Press the cubes together a little
    u.interpolate(lambda x: np.vstack([0 * x[0], 0 * x[1], -1e-3 * np.where(x[2] > 0, 1, 0)]))
    tangent = fem.form(ufl.derivative(F, u))
    K = petsc.create_matrix(tangent)
    results["tangent"] = best(lambda: assemble(K, tangent), 1)
    K.destroy()
    results |= measure_interface(problem, contact)

    # What Newton's iteration spends on the interface, per iteration
    iterations = problem.solve()
    for key, name in (("contact linearised", "linearise"), ("condensation", "condense")):
        results[key] = timed(f"~mortar: {name}") / iterations
    results["solve"] = timed("~mortar: solve") / iterations
    results["peak memory [MB]"] = memory()

    if comm.rank == 0:
        print(
            f"{n}³ on {m}³ hex27, {V.dofmap.index_map.size_global * 3} dofs, {n * n} slave facets"
        )
        for key, value in results.items():
            if "memory" in key:
                print(f"  {key:22s} {value:9.1f}")
            else:
                share = f"{100 * value / results['stiffness']:6.1f} % of stiffness"
                share += f", {100 * value / results['tangent']:6.1f} % of tangent"
                print(f"  {key:22s} {value:9.3f} s   {share}")
    if args.scaling:
        results["scaling"] = []
        for size in (20, 40, 80, 160):
            row = interface_only(size)
            results["scaling"].append(row)
            if comm.rank == 0:
                per = {k: f"{1e6 * v / row['facets']:.1f}" for k, v in row.items() if k != "facets"}
                print(f"  {row['facets']:6d} slave facets, µs per facet: {per}, {memory():.0f} MB")
    if args.out and comm.rank == 0:
        args.out.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
