# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Ranks that are given different arguments, or of which one raises, raise together."""

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import pytest
from dolfinx import fem, mesh
from dolfinx_mortar import agreement
from pressed import pressed
from test_bad_input import fails

comm = MPI.COMM_WORLD
several = pytest.mark.skipif(comm.size == 1, reason="one rank has no other")
LAST = comm.rank == comm.size - 1


class Unportable(Exception):
    """An error that cannot be made again from its arguments."""

    def __init__(self, a, b):
        super().__init__(f"{a} and {b}")


def test_one_rank_raises():
    """All raise what the lowest rank raises that raises at all."""

    def raise_on(ranks, error):
        with agreement.alike(comm):
            if comm.rank in ranks:
                raise error

    raise_on([comm.size], KeyError("nobody"))
    error = fails(lambda: raise_on([comm.size - 1], KeyError("last")), "last", kind=KeyError)
    assert error.__traceback__ is not None
    fails(lambda: raise_on(range(comm.size), IndexError(f"{comm.rank}")), "0", kind=IndexError)
    stop = [comm.size - 1]
    with pytest.raises(KeyboardInterrupt):
        raise_on(stop, KeyboardInterrupt())
    with pytest.raises((Unportable, RuntimeError), match="1 and 2"):
        raise_on(stop, Unportable(1, 2))


@several
@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("friction", (0.1, 0.3)),
        ("friction", (None, 0.3)),
        ("tresca", (1.0, 2.0)),
        ("multiplier", ("dual", "standard")),
        ("integration", ("segment", "element")),
        ("quadrature_degree", (4, None)),
        ("search_distance", (0.1, 0.2)),
        ("geometry", ("current", "reference")),
        ("c_n", (1.0, 2.0)),
        ("initial_active", ("gap", "all")),
        ("initial_active", ("gap", lambda x: x[0] > 0)),
        ("friction", (0.1, -0.1)),
        ("friction", (0.1, "0.1")),
    ],
)
def test_arguments_of_an_interface_differ(name, values):
    fails(lambda: pressed(dm.Contact, **{name: values[LAST]}), name)


@several
def test_tags_differ():
    p = pressed(dm.Contact).interface
    V, tags = [[getattr(side[0], name) for side in (p.slave, p.master)] for name in ("V", "tags")]
    slave = 99 if LAST else p.slave[0].tag
    master = p.master[0].tag
    fails(lambda: dm.Tie(V, tags, slave=slave, master=master), "slave", "99")


@several
@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("condense", (None, False)),
        ("petsc_options", ({"snes_max_it": 10}, {"snes_max_it": 11})),
        ("petsc_options", (None, {"ksp_type": "gmres"})),
        ("petsc_options", (None, {1: 2})),
    ],
)
def test_arguments_of_a_problem_differ(name, values):
    fails(lambda: pressed(dm.Contact, **{name: values[LAST]}), name)


@several
def test_what_changes_between_solves_differs(tmp_path):
    p = pressed(dm.Contact, friction=0.3)
    p.move(0.0, -0.01)
    before = p.norms()
    p.interface.friction = 0.3 + 0.1 * LAST
    fails(lambda: p.move(0.0, -0.02), "friction of contact 0", "0.3", "0.4")
    p.interface.friction = 0.3
    fails(lambda: p.problem.solve(max_cuts=3 + LAST), "max_cuts")
    fails(lambda: p.problem.solve(None if LAST else lambda t: None), "adaptive")
    p.problem.snes.setTolerances(max_it=30 + LAST)
    fails(p.problem.solve, "tolerances")
    p.problem.snes.setTolerances(max_it=30)
    for action in (p.problem.save, p.problem.load):
        fails(lambda action=action: action(tmp_path / f"state{LAST:d}"), "path", "state")
    assert np.array_equal(p.norms(), before)
    p.move(0.0, -0.02)


@several
def test_limit_of_relocation_differs():
    p = pressed(dm.Tie).interface
    tie = dm.Tie(slave=p.slave, master=p.master)
    fails(lambda: dm.relocate(tie, limit=0.5 + 0.1 * LAST), "limit")


def test_adaptive_raises_on_one_rank():
    """All raise it, and the displacement is that before the first part of the step."""
    p = pressed(dm.Contact, friction=0.3)
    p.move(0.0, -0.01)
    before = [u.x.array.copy() for u in p.problem.u]
    force = p.interface.force

    def load(t):
        p.top.value[:] = 0.02 * t, 0.0, -0.01
        if len(calls) == 0:
            p.top.value[0] = np.nan
        calls.append(t)
        if t > 0.5 and len(calls) > 1 and LAST:
            raise ZeroDivisionError("no load")

    calls = []
    fails(lambda: p.problem.solve(adaptive=load), "no load", kind=ZeroDivisionError)
    assert calls == [1.0, 0.5, 1.0]
    for u, values in zip(p.problem.u, before, strict=True):
        assert np.array_equal(u.x.array, values)
    assert np.allclose(p.interface.force, force, rtol=1e-12)


def test_initial_active_raises_on_one_rank():
    def choose(x):
        raise ZeroDivisionError("no choice")

    p = pressed(dm.Contact, initial_active=choose)
    fails(lambda: p.move(0.0, -0.01), "no choice", kind=ZeroDivisionError)
    assert not any(u.x.array.any() for u in p.problem.u)


@several
def test_meshes_on_different_communicators():
    functions = []
    for c in (comm, MPI.COMM_SELF):
        domain = mesh.create_unit_cube(c, 2, 2, 2)
        functions.append(fem.Function(fem.functionspace(domain, ("Lagrange", 1, (3,)))))
    fails(lambda: dm.ContactProblem([None, None], functions), "different communicators")
    tags = mesh.meshtags(domain, 2, np.empty(0, np.int32), np.empty(0, np.int32))
    spaces = [f.function_space for f in functions]
    fails(lambda: dm.Tie(spaces, (tags, tags), slave=1, master=2), "different communicators")
