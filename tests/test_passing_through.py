# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Steps in which contact surfaces pass through each other are refused, in any arrangement."""

from mpi4py import MPI

import cases
import dolfinx_mortar as dm
import numpy as np
import pytest
import ufl
from blocks import FACES, NU, E, block
from dolfinx import fem
from test_bad_input import fails

comm = MPI.COMM_WORLD
REFUSED = ("cannot be meant", "passed through", "smaller load steps", "state is as before")


def problem(bodies, held, sides, energy=cases.linear_elastic, **options):
    """A contact problem of bodies.

    Args:
        bodies: Bodies, a mesh each.
        held: Body, test for its held points, and whether these move as the constant returned.
        sides: Slave and master, lists of (body, tag).
        energy: Material.
        options: Of the contact.

    Returns:
        Problem, displacements, contact, and the constant that some held points move by.
    """
    u = [fem.Function(b.V) for b in bodies]
    dx = ufl.dx(metadata={"quadrature_degree": 3})
    forms = [ufl.derivative(energy(E, NU)(w) * dx, w) for w in u]
    bcs, motions = [], []
    for b, where, sign in held:
        V = bodies[b].V
        motion = fem.Constant(bodies[b].mesh, np.zeros(3))
        motions.append((motion, sign))
        bcs.append(fem.dirichletbc(motion, fem.locate_dofs_geometrical(V, where), V))

    def move(z):
        for motion, sign in motions:
            motion.value[2] = sign * z

    slave, master = (
        [(bodies[b].V, bodies[b].facet_tags, tag) for b, tag in side] for side in sides
    )
    contact = dm.Contact(slave=slave, master=master, **options)
    return dm.ContactProblem(forms, u, bcs=bcs, interfaces=[contact]), u, contact, move


def refused(problem, u, words=REFUSED):
    """The solve is refused and leaves the displacements."""
    before = [w.x.array.copy() for w in u]
    error = fails(problem.solve, *words, kind=dm.ConvergenceError)
    for w, values in zip(u, before, strict=True):
        np.testing.assert_array_equal(w.x.array, values)
    return str(error)


def clip(element):
    """A bar with a slot along its middle: two jaws of one body, and their back."""
    points, cells = cases.box((0, 0, 0), (10, 0.5, 3), (10, 1, 5))
    centres = points[cells].mean(axis=1)
    cells = cells[~((centres[:, 0] > 2) & cases.near(1.5)(centres[:, 2]))]
    used, cells = np.unique(cells, return_inverse=True)

    def tag(x):
        inner = (x[:, 0] > 5) & (x[:, 0] < 9.99)
        return np.select([inner & cases.near(z)(x[:, 2]) for z in (1.8, 1.2)], [1, 2], 0)

    part = cases.Part(
        "clip", element, cases.linear_elastic(E, NU), points[used], cells.reshape(-1, 8), tag
    )
    return cases._bodies(comm, [part], False)[0]


def squeezed(element="hex8", swap=False, **options):
    """The clip, its jaws moved towards each other."""
    held = [
        (0, lambda x: np.isclose(x[0], 0), 0),
        (0, lambda x: (x[0] > 3) & np.isclose(x[2], 3), -1),
        (0, lambda x: (x[0] > 3) & np.isclose(x[2], 0), 1),
    ]
    sides = [[(0, 1)], [(0, 2)]]
    return problem(clip(element), held, sides[::-1] if swap else sides, **options)


@pytest.mark.parametrize("element", ["hex8", "hex20"])
@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("friction", [None, 0.2])
def test_jaws_of_one_body(element, swap, friction):
    p, u, contact, move = squeezed(element, swap, friction=friction)
    move(2.0)
    message = refused(p, u)
    assert "behind the other one" in message
    # The same in steps
    for z in (0.15, 0.3, 0.32):
        move(z)
        p.solve()
    assert contact.num_active > 0 and contact.force[2] * (-1 if swap else 1) > 0
    move(2.0)
    refused(p, u, words=["smaller load steps", "state is as before"])


def stacked(swap, lower=(((0, 0, 0.9), (1, 1, 1)),), **options):
    """A block above one or more thin plates."""
    parts = [block("block", "hex8", (0.2, 0.2, 1.05), (0.8, 0.8, 1.4), (4, 4, 2))]
    parts += [block(f"plate {i}", "hex8", *box, (6, 6, 1)) for i, box in enumerate(lower)]
    bodies, _ = cases._bodies(comm, parts, False)
    plates = range(1, len(bodies))
    held = [(0, lambda x: np.isclose(x[2], 1.4), -1)]
    for i in plates:
        held.append((i, lambda x, z=lower[i - 1][0][2]: np.isclose(x[2], z), 0))
    sides = [[(0, FACES["z-"])], [(i, FACES["z+"]) for i in plates]]
    return problem(bodies, held, sides[::-1] if swap else sides, **options)


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("distance", [None, 0.2])
def test_left_behind_entirely(swap, distance):
    """Where no facet is inside another body any more."""
    p, u, contact, move = stacked(swap, search_distance=distance)
    move(4.0)
    assert "3.95 behind" in refused(p, u)
    move(0.06)
    p.solve()
    assert contact.num_active > 0
    move(4.0)
    refused(p, u, words=["smaller load steps", "state is as before"])


@pytest.mark.parametrize("swap", [False, True])
def test_one_of_several_plates(swap):
    """The block misses the first plate and falls through the second one."""
    plates = ((2, 0, 0.9), (3, 1, 1)), ((0, 0, -1.1), (1, 1, -1))
    p, u, _, move = stacked(swap, lower=plates)
    move(1.5)
    assert p.solve() < 10
    move(5.0)
    assert "behind" in refused(p, u)


@pytest.mark.parametrize("swap", [False, True])
def test_beside_the_plate(swap):
    """That is no passing, however far."""
    p, u, contact, move = stacked(swap, lower=(((2, 0, 0.9), (3, 1, 1)),))
    for z in (0.5, 7.0, 0.0, -9.0):
        move(z)
        p.solve()
        assert contact.num_active == 0
