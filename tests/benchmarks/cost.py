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
from dolfinx.mesh import locate_entities_boundary, meshtags
from dolfinx_mortar import compat, cpp, sparse
from dolfinx_mortar.linearisation import linearise

SLAVE, MASTER = 3, 7


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
    multipliers, layout = p._coupling.multipliers, p._layout
    x = c._positions(layout.all_local(p._functions))
    z = np.ones((c.num_nodes, 3))
    active = np.ones(c.num_nodes, dtype=np.int8)
    n_u, n_z = layout.size_u, multipliers.size
    times = {}

    def search():
        cpp.find_candidates(c._surface_slave, x[0], c._surface_master, x[1])

    def matrices():
        D, M = multipliers.z_by_u(), multipliers.z_by_u()
        cpp.integrate(c._data, configuration, D=D, M=M)
        D.assemble()
        M.assemble()

    def linearisation():
        mats = {
            "force": sparse.empty(p.comm, n_u, n_u),
            "gap": sparse.empty(p.comm, n_z // 3, n_u),
            "gap_normal": sparse.empty(p.comm, n_z // 3, n_z),
        }
        cpp.integrate_derivatives(c._data, configuration, z, active, **mats)
        normals = multipliers.z_by_u()
        cpp.differentiate_normals(c._data, configuration, normals)
        for A in [*mats.values(), normals]:
            A.assemble()

    configuration = cpp.configure(c._data, *x)
    times["search"] = best(search)
    times["integrate"] = best(lambda: cpp.integrate(c._data, configuration))
    times["D and M"] = best(matrices)
    times["derivatives"] = best(linearisation, 2)
    return times


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
    K = compat.create_matrix(linear)
    results["stiffness"] = best(lambda: compat.assemble_matrix(K, linear), 2)
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
    problem = dm.ContactProblem(F, u, bcs=bcs, interfaces=[contact])
    results["set-up memory [MB]"] = memory() - before
    # Press the cubes together a little
    u.interpolate(lambda x: np.vstack([0 * x[0], 0 * x[1], -1e-3 * np.where(x[2] > 0, 1, 0)]))
    results["tangent"] = best(problem._forms.tangent, 1)
    results |= measure_interface(problem, contact)

    # One linearisation and condensation, as in Newton's iteration, without the solve
    solver, problem._cached = problem._solver, None
    problem._x.array[: problem._n_u] = problem._layout.gather([u])
    problem._forced = None
    problem._begin()
    problem._evaluate(problem._x.array_r)
    tangent = problem._forms.tangent()
    start = time.perf_counter()
    system = linearise(problem._coupling, tangent, problem._z)
    results["contact linearised"] = time.perf_counter() - start
    solver._run = lambda A, b: b.copy()
    start = time.perf_counter()
    f = problem._cached[1]
    solver.solve(system, f[: problem._n_u].copy(), f[problem._n_u :].copy())
    results["condensation"] = time.perf_counter() - start
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
