# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Springs for bodies that nothing holds but contact."""

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import pytest
from test_bad_contact import Blocks
from test_bad_input import fails

comm = MPI.COMM_WORLD
STABLE = {"stabilise": 1e-3}


def test_block_on_a_slippery_plane():
    """Pressed straight down and free to move sideways: the whole force is that of contact."""
    block = Blocks(held=None, problem_options=STABLE)
    block.load.value[:] = 0.0, 0.0, -10.0
    block.solve()
    force = 10 * 0.36
    np.testing.assert_allclose(block.contact.force, [0, 0, force], rtol=1e-6, atol=1e-6 * force)
    found = block.problem.stabilisation
    assert 0 <= found["force"] < 1e-6 and 0 <= found["energy_share"] < 1e-6
    # Symmetric: it has not moved sideways, but for round-off
    u = block.u[0].x.array.reshape(-1, 3)
    mean = comm.allreduce(u[:, :2].sum(axis=0)) / comm.allreduce(len(u))
    assert np.all(np.abs(mean) < 1e-4)  # round-off of forces over the springs that are left


def test_same_as_a_held_body():
    """Contact forces of a body that is held, too: the springs leave nothing behind."""
    free, held = Blocks(held=None, problem_options=STABLE), Blocks(held="sideways")
    for block in (free, held):
        block.load.value[:] = 0.0, 0.0, -10.0
        block.solve()
    assert free.contact.force[2] == pytest.approx(held.contact.force[2], rel=1e-6)


def test_gap_that_is_closed():
    """A body high over the other one falls down on it: no search sees the other one at first."""
    block = Blocks(gap=0.3, held=None, friction=0.3, problem_options=STABLE)
    for load in (-0.5, -10.0):
        block.load.value[:] = 0.0, 0.0, load
        block.problem.solve()
    assert block.contact.force[2] == pytest.approx(3.6, rel=1e-5)


def test_body_that_slides_away():
    """Springs would hold it: an error, and the state is as before."""
    block = Blocks(held=None, problem_options=STABLE)
    block.load.value[:] = 1.0, 0.0, -10.0
    fails(block.solve, "nothing else holds a body", kind=dm.ConvergenceError)
    assert all(np.all(w.x.array == 0) for w in block.u)
    # Nothing is left of the springs
    block.load.value[:] = 0.0, 0.0, -10.0
    block.solve()
    assert block.contact.force[2] == pytest.approx(3.6, rel=1e-6)


def test_bad_input():
    fails(lambda: Blocks(held="top", problem_options=STABLE), "leave it out")
    for given, word in ((-1, "-1"), ("a little", "'a little'")):
        options = {"stabilise": given}
        fails(lambda o=options: Blocks(held=None, problem_options=o), f"stabilise is {word}")
