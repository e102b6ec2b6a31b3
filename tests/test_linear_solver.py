# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""The condensed system gives the steps of the saddle point, whatever solves it."""

from mpi4py import MPI
from petsc4py import PETSc

import cases
import dolfinx_mortar as dm
import numpy as np
import pytest
import ufl
from blocks import NU, E
from corner import corner
from dolfinx import fem
from dolfinx.mesh import CellType, create_unit_cube, locate_entities_boundary, meshtags
from dolfinx_mortar import cpp
from nodal import by_position
from pressed import pressed
from timers import counted

comm = MPI.COMM_WORLD
SET_UP = "~mortar: set up"
SADDLE = {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}
ITERATIVE = ("gamg", "cholesky", "bjacobi")
KINDS = {
    "tie": (dm.Tie, {}),
    "contact": (dm.Contact, {}),
    "friction": (dm.Contact, {"friction": 0.3}),
    "corners": (dm.Contact, {"multiplier": "dual-linear"}),
    "linear tractions": (dm.Contact, {"multiplier": "dual-reproducing", "friction": 0.3}),
}


def history(p):
    steps = []
    for x, z in ((0.0, -0.01), (0.03, -0.02)):
        p.move(x, z)
        steps.append([(h["active"], h["stick"], h["slip"]) for h in p.problem.history])
    return steps


@pytest.mark.parametrize("name", KINDS)
def test_same_iterates_condensed_and_saddle_point(name):
    kind, options = KINDS[name]
    p = pressed(kind, elements=("hex20", "hex8"), **options)
    q = pressed(kind, elements=("hex20", "hex8"), condense=False, **options)
    assert history(p) == history(q)
    assert np.allclose(p.norms(), q.norms(), rtol=1e-10)
    for a, b in zip(p.problem.history[:-1], q.problem.history[:-1], strict=True):
        # Rounding shows in residuals that are next to nothing
        assert np.isclose(a["force"], b["force"], rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("walls", [1, 2])
@pytest.mark.parametrize("friction", [None, 0.3], ids=["frictionless", "friction"])
def test_same_iterates_at_edges(friction, walls):
    """Slave nodes that stick and slide on several patches at once have several multipliers."""
    histories = []
    for condense in (True, False):
        case = corner("hex8", "hex8", walls=walls, energy=cases.neo_hooke(E, NU))
        problem = cases.make_problem(case, condense=condense, friction=friction).problem
        problem.solve()
        histories.append(problem.history)
    states = [[(h["active"], h["stick"], h["slip"]) for h in hs] for hs in histories]
    assert states[0] == states[1]
    forces = [[h["force"] for h in hs[:-1]] for hs in histories]
    assert np.allclose(*forces, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("preconditioner", ITERATIVE)
@pytest.mark.parametrize("name", KINDS)
def test_preconditioned_through_the_reduced_system(name, preconditioner):
    kind, options = KINDS[name]
    solver = {"pc_type": preconditioner, "ksp_rtol": 1e-12, "pc_mortar_reuse": False}
    p = pressed(kind, elements=("hex20", "hex8"), **options)
    q = pressed(kind, elements=("hex20", "hex8"), petsc_options=solver, **options)
    assert history(p) == history(q)
    assert np.allclose(p.norms(), q.norms(), rtol=1e-8)
    if (name, preconditioner) == ("tie", "cholesky"):
        # Constraints of a tie do not turn with normals: the reduction is exact
        assert q.problem._cpp_object.ksp.getIterationNumber() <= 2


@pytest.mark.parametrize("preconditioner", ["gamg", "cholesky"])
@pytest.mark.parametrize("name", KINDS)
def test_inexact_steps_end_at_the_same_solution(name, preconditioner):
    """Loose linear solves and preconditioners of earlier systems: less work, the same result."""
    kind, options = KINDS[name]
    exact = {"pc_type": preconditioner, "snes_ksp_ew": False, "pc_mortar_reuse": False}
    results = []
    for solver in ({"pc_type": preconditioner}, exact):
        p = pressed(kind, elements=("hex20", "hex8"), petsc_options=solver, **options)
        counts, set_ups = [], counted(SET_UP)

        def count(ksp, iteration, norm, counts=counts):
            counts.append(iteration > 0)

        p.problem._cpp_object.ksp.setMonitor(count)
        for x, z in ((0.0, -0.01), (0.01, -0.012)):
            p.move(x, z)
        u = by_position(*p.problem.u)
        results.append((u, sum(counts), counted(SET_UP) - set_ups))
    (u, iterations, set_ups), (v, more, most) = results
    assert np.linalg.norm(u - v) < 1e-8 * np.linalg.norm(v)
    # To factorise is more work than to iterate, so that a factorisation serves longer
    assert iterations < (0.9 if preconditioner == "gamg" else 4) * more
    assert set_ups < most


@pytest.mark.parametrize("element", ["tet10", "hex20", "hex27"])
def test_multigrid_of_corners(element):
    """With a level of all nodes above the corners' there are fewer iterations."""
    kind = CellType.tetrahedron if element == "tet10" else CellType.hexahedron
    mesh = create_unit_cube(comm, 6, 6, 6, kind)
    V = fem.functionspace(mesh, dm.hex20((3,)) if element == "hex20" else ("Lagrange", 2, (3,)))
    mesh.topology.create_connectivity(2, 3)
    facets = locate_entities_boundary(mesh, 2, lambda x: np.isclose(x[2], 0))
    tags = meshtags(mesh, 2, facets, np.full(len(facets), 1, np.int32))
    top = locate_entities_boundary(mesh, 2, lambda x: np.isclose(x[2], 1))
    dofs = fem.locate_dofs_topological(V, 2, top)
    bcs = [fem.dirichletbc(np.array([0.0, 0.0, -0.05]), dofs, V)]
    counts, norms = [], []
    for corners in (True, False):
        u = fem.Function(V)
        F = ufl.derivative(cases.linear_elastic(E, NU)(u) * ufl.dx, u, ufl.TestFunction(V))
        contact = dm.Contact(V, tags, slave=1, master=dm.RigidPlane((0, 0, 0), (0, 0, 1)))
        solver = {"pc_type": "gamg", "ksp_rtol": 1e-8, "pc_mortar_corners": corners}
        problem = dm.ContactProblem(F, u, bcs=bcs, interfaces=[contact], petsc_options=solver)
        count = []
        problem._cpp_object.ksp.setMonitor(lambda ksp, i, norm, count=count: count.append(i > 0))
        problem.solve()
        counts.append(sum(count))
        norms.append(np.sqrt(comm.allreduce(problem.state.u @ problem.state.u)))
    assert counts[0] < 0.75 * counts[1]
    assert np.isclose(*norms, rtol=1e-7)


def krylov_iterations(kind, **options):
    """Iterations of all systems of a step, each to 1e-8 with a preconditioner of its own."""
    p = pressed(kind, elements=("hex20", "hex20"), **options)
    counts = []
    p.problem._cpp_object.ksp.setMonitor(lambda ksp, iteration, norm: counts.append(iteration > 0))
    p.move(0.0, -0.01)
    return sum(counts)


def test_multigrid_of_ties():
    """Multipliers at corners alone cost no iterations."""
    solver = {"pc_type": "gamg", "ksp_rtol": 1e-8, "pc_mortar_reuse": False}
    counts = [
        krylov_iterations(dm.Tie, petsc_options=solver, multiplier=space)
        for space in ("dual-reproducing", "dual")
    ]
    assert counts[0] <= 1.3 * counts[1]


def test_solver_by_size():
    """Multigrid where a model is large and no solver is given, else what is given."""
    for large, given, pc in (
        (False, {}, "lu"),
        (True, {}, "gamg"),
        (True, {"pc_type": "lu"}, "lu"),
        (True, {"ksp_type": "preonly"}, "lu"),
        (False, {"pc_type": "gamg"}, "gamg"),
    ):
        assert cpp.effective_options("sized_", given, large)["sized_pc_type"] == pc


@pytest.mark.parametrize("cells, kind", [((15, 15, 15), "gamg"), ((300, 3, 3), "lu")])
def test_solver_by_shape(cells, kind):
    """A cube has multigrid; a beam of as many displacements is factorised with less work."""
    mesh = create_unit_cube(comm, *cells, CellType.hexahedron)
    V = fem.functionspace(mesh, ("Lagrange", 2, (3,)))
    assert V.dofmap.index_map.size_global * 3 > 80_000
    u = fem.Function(V)
    F = ufl.inner(ufl.grad(u), ufl.grad(ufl.TestFunction(V))) * ufl.dx
    mesh.topology.create_connectivity(2, 3)
    facets = locate_entities_boundary(mesh, 2, lambda x: np.isclose(x[2], 0))
    tags = meshtags(mesh, 2, facets, np.full(len(facets), 1, np.int32))
    tool = dm.RigidPlane((0, 0, 0), (0, 0, 1))
    contact = dm.Contact(V, tags, slave=1, master=tool)
    problem = dm.ContactProblem(F, u, interfaces=[contact])
    ksp = problem._cpp_object.ksp
    assert (ksp.getType() == "preonly") == (kind == "lu")


def test_options_reach_nested_solvers_and_nothing_else():
    """Options are PETSc's while the problem sets up and solves, and only then."""
    solver = {"pc_type": "gamg", "mg_levels_ksp_type": "richardson"}
    p = pressed(dm.Tie, elements=("hex8", "hex8"), petsc_options=solver)
    p.move(0.0, -0.01)
    smoother = p.problem._cpp_object.inner_pc.getMGSmoother(1)
    assert smoother.getType() == "richardson"
    assert not any("mg_levels" in name for name in PETSc.Options().getAll())


def test_a_failing_linear_solver_stops_the_iteration():
    p = pressed(
        dm.Contact, elements=("hex20", "hex8"), petsc_options={"pc_type": "none", "ksp_max_it": 3}
    )
    with pytest.raises(dm.ConvergenceError, match="ksp_max_it"):
        p.move(0.0, -0.01)


def test_a_lagged_jacobian():
    """A system is solved twice, with a new preconditioner each time."""
    lag = {"pc_type": "gamg", "pc_mortar_reuse": False, "snes_lag_jacobian": 2, "snes_max_it": 100}
    p, q = (pressed(dm.Contact, petsc_options=solver) for solver in (None, lag))
    for x in (p, q):
        x.move(0.0, -0.01)
    assert np.allclose(p.norms(), q.norms(), rtol=1e-8)
