# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Memory stays as it is, however often problems are solved, made and looked at."""

import gc

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import pytest
from dolfinx import fem
from pressed import pressed
from test_failed_step import Blocks

comm = MPI.COMM_WORLD


def resident() -> int:
    """Memory of this process [kB]."""
    with open("/proc/self/status") as file:
        line = next(text for text in file if text.startswith("VmRSS"))
    return int(line.split()[1])


def growth(action, repeats: int) -> float:
    """Growth of memory in each repetition, after as many others, on the worst rank [kB].

    The least of two rounds: what leaks grows in both, a heap with holes may grow in one.
    """
    sizes = []
    for _ in range(3):
        for _ in range(repeats):
            action()
            gc.collect()
        sizes.append(resident())
    return comm.allreduce(min(np.diff(sizes)) / repeats, op=MPI.MAX)


class Three:
    """Two blocks on a larger one: one is pressed onto it, one is tied to it."""

    def __init__(self):
        low, high = [0.1, 0.2, 1.0], [0.45, 0.8, 1.6]
        shift = np.array([0.45, 0.0, 0.0])
        parts = [
            Blocks.body(low, high, 2),
            Blocks.body(low + shift, high + shift, 2),
            Blocks.body([0.0, 0.0, 0.0], [1.0, 1.0, 1.0], 3),
        ]
        self.u, self.tags, self.F = zip(*parts, strict=True)
        self.V = [u.function_space for u in self.u]
        self.motion = fem.Constant(self.V[0].mesh, np.array([0.0, 0.0, -0.02]))
        self.bcs = [
            fem.dirichletbc(self.motion, Blocks.side(self.V[0], 1.6), self.V[0]),
            fem.dirichletbc(np.zeros(3), Blocks.side(self.V[2], 0.0), self.V[2]),
        ]

    def problem(self):
        def sides(k):
            return {
                "slave": [(self.V[k], self.tags[k], 1)],
                "master": [(self.V[2], self.tags[2], 1)],
            }

        interfaces = [dm.Contact(**sides(0), friction=0.3), dm.Tie(**sides(1))]
        return dm.ContactProblem(list(self.F), list(self.u), bcs=self.bcs, interfaces=interfaces)


def test_solves_with_a_tie_and_a_contact():
    three = Three()
    problem = three.problem()

    def step():
        three.motion.value[0] = 0.01 - three.motion.value[0]
        problem.solve()

    assert growth(step, 10) < 50


def test_problems_that_are_dropped():
    three = Three()
    assert growth(three.problem, 15) < 50


def test_problems_whose_meshes_are_dropped():
    assert growth(lambda: Three().problem(), 10) < 120


def test_destroyed_problem():
    """Its fields stay, and all else says that it is destroyed."""
    three = Three()
    with three.problem() as problem:
        problem.solve()
        contact = problem.interfaces[0]
        pressure = contact.pressure.x.array.copy()
    problem.destroy()
    assert np.array_equal(contact.pressure.x.array, pressure)
    for use in (problem.solve, lambda: problem.save("state"), lambda: contact.force):
        with pytest.raises(RuntimeError, match="destroyed"):
            use()
    three.problem().solve()


def test_matrices_that_are_looked_at():
    p = pressed(dm.Contact, friction=0.3)
    p.move(0.0, -0.01)
    c = p.interface

    def look():
        for name in ("D", "M", "T", "T_inverse", "D_inverse", "P"):
            getattr(c, name)

    assert growth(look, 10) < 30
