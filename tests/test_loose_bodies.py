# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Bodies that nothing but contact holds: a pin in a bore with clearance, blocks on slopes."""

from mpi4py import MPI

import cases
import dolfinx_mortar as dm
import numpy as np
import pytest
import ufl
from blocks import NU, E
from dolfinx import fem
from dolfinx_mortar import cpp
from scipy.optimize import linprog, lsq_linear
from test_bad_contact import Blocks, refused

comm = MPI.COMM_WORLD
OUTER, INNER, ENDS, SYMMETRY = 1, 2, 3, 4


def ring(name, element, inner, outer, cells, angle):
    """A part of a hollow cylinder around the z axis, from the x axis on, one cell thick."""
    closed = angle > 6
    r = np.linspace(inner, outer, cells[0] + 1)
    phi = np.linspace(0, angle, cells[1] + 1)
    points, quads = cases.grid(r, phi)
    plan = points[:, :1] * np.column_stack([np.cos(points[:, 1]), np.sin(points[:, 1])])
    if closed:
        quads = quads % (len(r) * cells[1])
        plan = plan[: len(r) * cells[1]]
    thickness = 0.3
    points, hexes = cases.extrude(plan, quads, lambda x, y: 0, lambda x, y: thickness, 1)

    def tag(x):
        distance = np.linalg.norm(x[:, :2], axis=1)
        ends = cases.near(0)(x[:, 2]) | cases.near(thickness)(x[:, 2])
        cut = cases.near(0)(x[:, 1]) & ~np.array(closed)
        middle = (inner + outer) / 2
        sides = [ends, cut, distance > middle, distance < middle]
        return np.select(sides, [ENDS, SYMMETRY, OUTER, INNER])

    return cases.Part(name, element, cases.linear_elastic(E, NU), points, hexes, tag)


def pin_in_bore(clearance=0.05, angle=np.pi, element="hex8", start=(0, 0), **options):
    """A pin, or its half, in a plate that is held at its rim; both in plane strain.

    Returns:
        Problem, displacement of the pin, contact, and the force on the pin per volume.
    """
    n = int(round(12 * angle / np.pi))
    parts = [
        ring("pin", element, 0.4, 1.0, (3, n), angle),
        ring("plate", element, 1.0 + clearance, 2.0, (3, n + 2), angle),
    ]
    bodies, _ = cases._bodies(comm, parts, False)
    u = [fem.Function(b.V) for b in bodies]
    u[0].interpolate(lambda x: np.array([*start, 0.0])[:, None] + 0 * x)
    dx = ufl.dx(metadata={"quadrature_degree": 3})
    forms = [ufl.derivative(cases.neo_hooke(E, NU)(w) * dx, w) for w in u]
    load = fem.Constant(bodies[0].mesh, np.zeros(3))
    forms[0] -= ufl.inner(load, ufl.TestFunction(bodies[0].V)) * dx
    bcs = []
    for b in bodies:
        held = [(ENDS, 2)] + [(SYMMETRY, 1)] * (angle < 6)
        held += [(OUTER, 0), (OUTER, 1)] * (b is bodies[1])
        for tag, c in held:
            V = b.V.sub(c)
            dofs = fem.locate_dofs_topological(V, 2, b.facet_tags.find(tag))
            bcs.append(fem.dirichletbc(0.0, dofs, V))
    pin, plate = bodies
    contact = dm.Contact(
        slave=[(pin.V, pin.facet_tags, OUTER)],
        master=[(plate.V, plate.facet_tags, INNER)],
        **options,
    )
    problem = dm.ContactProblem(forms, u, bcs=bcs, interfaces=[contact])
    return problem, u[0], contact, load


def volume(u):
    mesh = u.function_space.mesh
    return comm.allreduce(fem.assemble_scalar(fem.form(fem.Constant(mesh, 1.0) * ufl.dx)))


@pytest.mark.parametrize("element", ["hex8", "hex20"])
@pytest.mark.parametrize("clearance", [0.002, 0.05, 0.1])
@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("friction", [None, 0.3])
def test_half_pin(element, clearance, direction, friction):
    problem, u, contact, load = pin_in_bore(clearance, element=element, friction=friction)
    load.value[0] = direction * 2.0
    problem.solve()
    assert contact.force[0] == pytest.approx(-load.value[0] * volume(u), rel=1e-6)


@pytest.mark.parametrize("clearance", [0.002, 0.05])
@pytest.mark.parametrize("angle", [0.0, 0.3, 2.0, 4.0])
def test_whole_pin_with_friction(clearance, angle):
    problem, u, contact, load = pin_in_bore(clearance, angle=2 * np.pi, friction=0.3)
    load.value[:2] = 2 * np.cos(angle), 2 * np.sin(angle)
    problem.solve()
    np.testing.assert_allclose(contact.force, -load.value * volume(u), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("cells", [((3, 3, 2), (4, 4, 2)), ((5, 5, 2), (7, 7, 2))])
@pytest.mark.parametrize("force", [(4.0, 0.0), (3.0, 3.0)])
@pytest.mark.parametrize("before", [None, 2.0])
def test_block_past_the_angle_of_friction(cells, force, before):
    """Friction of 0.3 does not hold a force of 4 along the surface under one of 10."""
    block = Blocks(held=None, friction=0.3, cells=cells)
    if before is not None:
        block.load.value[:] = before, 0.0, -10.0
        block.solve()
        assert block.contact.force[0] == pytest.approx(-0.36 * before, rel=1e-6)
    block.load.value[:] = *force, -10.0
    error = refused(block, "All nodes in contact slip", "slides away", "no static solution")
    assert len(error.history) < 12


def test_dragged_block_does_not_slide_away():
    """All its nodes slip, but it is held; a step that fails is one for other reasons."""
    block = Blocks(friction=0.1, petsc_options={"snes_max_it": 2})
    block.problem.snes.setTolerances(max_it=20)
    for x in (0.0, 0.05):
        block.motion.value[:] = x, 0.0, -0.01
        block.solve()
    assert block.problem.history[-1]["stick"] == 0
    block.problem.snes.setTolerances(max_it=2)
    block.motion.value[:] = 0.12, 0.0, -0.02
    error = refused(block, "did not converge")
    assert "slides away" not in str(error)


@pytest.mark.parametrize(
    "friction, force, overloaded",
    [
        (0.3, (2.9, 0), False),
        (0.3, (3.3, 0), True),
        (0.3, (2.0, 2.0), False),
        (0.3, (2.3, 2.3), True),
        # Its height is its width: it tips over where friction is no bound
        (2.0, (4.7, 0), False),
        (2.0, (0, -5.3), True),
    ],
)
def test_what_friction_can_balance(friction, force, overloaded):
    block = Blocks(held=None, friction=friction, petsc_options={"snes_max_it": 1})
    block.load.value[:] = *force, -10.0
    refused(block, "did not converge")
    assert cpp.is_overloaded(block.problem._cpp_object) == overloaded


@pytest.mark.parametrize("loads", ["friction", "anything"])
def test_distance_from_the_cone_of_friction(loads):
    """Few edges, found by all ranks together, decide as all of them at once do."""
    rng = np.random.default_rng(3)
    normals = rng.normal(size=(300, 3)) * [0.3, 0.2, 0.0] + [0, 0, 1]
    tractions = normals + 0.2 * rng.normal(size=(300, 3))
    edges = np.hstack([tractions, np.cross(rng.normal(size=(300, 3)), tractions)])
    edges /= np.linalg.norm(edges, axis=1)[:, None]
    mine = edges[comm.rank :: comm.size] if comm.rank < 2 else edges[:0]
    every = np.concatenate(comm.allgather(mine))
    identity = np.eye(6)
    columns = np.hstack([every.T, identity, -identity])
    cost = np.repeat([0.0, 1.0], [len(every), 12])
    left = []
    for _ in range(20):
        work = rng.normal(size=6)
        if loads == "friction":
            work = 2 * work + (rng.random(300) < 0.02) @ edges
        work /= np.linalg.norm(work)
        left.append(cpp.distance_from_cone(comm.py2f(), mine, work))
        # The least sum of what is left bounds the least length
        total = linprog(cost, A_eq=columns, b_eq=work, method="highs").fun
        assert left[-1] <= total + 1e-9 and total <= np.sqrt(6) * left[-1] + 1e-6
        result = lsq_linear(every.T, work, bounds=(0, np.inf), tol=1e-14)
        assert left[-1] == pytest.approx(np.sqrt(2 * result.cost), abs=1e-5)
    assert min(left) < (1e-6 if loads == "friction" else 1) and max(left) > 0.1


def test_springs_hold_a_block_that_slips():
    def on_springs(E, nu):
        energy = cases.neo_hooke(E, nu)
        return lambda u: energy(u) + 50 * ufl.inner(u, u)

    block = Blocks(held=None, friction=0.3, energy=on_springs)
    block.load.value[:] = 6.0, 0.0, -10.0
    block.solve()
    assert block.problem.history[-1]["stick"] == 0
    assert not cpp.is_overloaded(block.problem._cpp_object)
