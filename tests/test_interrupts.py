# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Ctrl-C at any time of a solve: the state is that before it, and the next solve works."""

import os
import signal

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import pytest
from dolfinx_mortar import interrupts
from pressed import pressed

another = pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="one rank has no other")


@pytest.fixture(autouse=True)
def interrupts_raise():
    """A process that a shell has put in the background ignores them from the start."""
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, handler)


class Late:
    """A problem after its first step, and one signal in the middle of a function."""

    def __init__(self, monkeypatch, rank):
        self.p = pressed(dm.Contact, elements=("hex20", "hex8"), friction=0.3)
        self.p.move(0.0, -0.01)
        self.monkeypatch, self.rank = monkeypatch, rank

    def signal_in(self, owner, name, call):
        """Send the signal, once, before the n-th call of a method."""
        method, calls = getattr(owner, name), []

        def interrupted(*args, **more):
            calls.append(name)
            if len(calls) == call and self.p.problem.comm.rank == self.rank:
                os.kill(os.getpid(), signal.SIGINT)
            return method(*args, **more)

        self.monkeypatch.setattr(owner, name, interrupted)
        return calls

    def values(self):
        c = self.p.interface
        fields = (c.multiplier, c.slip, c.status, *self.p.problem.u)
        return [f.x.array.copy() for f in fields] + [c.force]


PLACES = [
    ("_coupling", "begin", 1),
    ("_coupling", "evaluate", 1),
    ("_coupling", "evaluate", 3),
    ("_coupling", "rescale", 1),
    ("_forms", "residual", 2),
    ("_forms", "tangent", 1),
    ("_solver", "solve", 2),
    ("_coupling", "find_implausible", 1),
    ("_coupling", "accept", 1),
]


@pytest.fixture(scope="module")
def undisturbed():
    """Norms after the two steps."""
    p = pressed(dm.Contact, elements=("hex20", "hex8"), friction=0.3)
    p.move(0.0, -0.01)
    p.move(0.02, -0.02)
    return p.norms()


@pytest.mark.parametrize("rank", [0, pytest.param(-1, marks=another)])
@pytest.mark.parametrize("place", PLACES, ids=lambda p: f"{p[1]}{p[2]}")
def test_signal(place, rank, undisturbed):
    """On one rank alone, wherever the iteration is."""
    with pytest.MonkeyPatch.context() as patch:
        late = Late(patch, 0)
        p = late.p
        late.rank = rank % p.problem.comm.size
        before = late.values()
        calls = late.signal_in(getattr(p.problem, place[0]), *place[1:])
        with pytest.raises(KeyboardInterrupt):
            p.move(0.02, -0.02)
        assert len(calls) >= place[2]
    for a, b in zip(late.values(), before, strict=True):
        assert np.allclose(a, b, rtol=1e-12, atol=0)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler

    p.move(0.02, -0.02)
    assert np.allclose(p.norms(), undisturbed, rtol=1e-9)


def test_signal_in_a_users_function():
    """It need not wait there."""
    p = pressed(dm.Contact)
    p.move(0.0, -0.01)
    before = [u.x.array.copy() for u in p.problem.u]
    reached = []

    def load(t):
        p.top.value[2] = -0.02 * t
        if p.problem.comm.rank == 0:
            os.kill(os.getpid(), signal.SIGINT)
            reached.append(sum(range(1000)))

    with pytest.raises(KeyboardInterrupt):
        p.problem.solve(adaptive=load)
    assert not reached
    for u, values in zip(p.problem.u, before, strict=True):
        assert np.array_equal(u.x.array, values)


def test_a_handler_of_the_user_decides():
    """One that only takes a note does not end the solve."""
    p = pressed(dm.Contact)
    notes = []
    handler = signal.signal(signal.SIGINT, lambda *_: notes.append(p.problem.history))
    try:
        with pytest.MonkeyPatch.context() as patch:
            evaluate, calls = p.problem._coupling.evaluate, []

            def interrupted(*args):
                calls.append(None)
                if len(calls) == 2:
                    os.kill(os.getpid(), signal.SIGINT)
                return evaluate(*args)

            patch.setattr(p.problem._coupling, "evaluate", interrupted)
            p.move(0.0, -0.01)
    finally:
        signal.signal(signal.SIGINT, handler)
    assert len(notes) == 1
    assert p.interface.num_active > 0


def test_blocks_without_python_s_handler():
    with pytest.raises(ZeroDivisionError), interrupts.deferred():
        raise ZeroDivisionError
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interrupts.deferred():
            os.kill(os.getpid(), signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, handler)
