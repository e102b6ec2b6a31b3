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
from dolfinx_mortar import problem as problem_module
from pressed import pressed

another = pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="one rank has no other")


@pytest.fixture(autouse=True)
def interrupts_raise():
    """A process that a shell has put in the background ignores them from the start."""
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, handler)


def interrupted(call, rank):
    """A look at interrupts in the iteration with a signal, on one rank, before the n-th call."""
    poll, calls = problem_module._poll, []

    def look(problem):
        calls.append(None)
        if len(calls) == call and problem.comm.rank == rank:
            os.kill(os.getpid(), signal.SIGINT)
        poll(problem)

    return look, calls


class Late:
    """A problem after its first step."""

    def __init__(self):
        self.p = pressed(dm.Contact, elements=("hex20", "hex8"), friction=0.3)
        self.p.move(0.0, -0.01)

    def values(self):
        c = self.p.interface
        fields = (c.multiplier, c.slip, c.status, *self.p.problem.u)
        return [f.x.array.copy() for f in fields] + [c.force]


@pytest.mark.parametrize("rank", [0, pytest.param(-1, marks=another)])
@pytest.mark.parametrize("call", [1, 2, 3, "last"])
def test_signal(call, rank, monkeypatch):
    """On one rank alone, in the middle of the iteration and when all is solved."""
    late = Late()
    p = late.p
    rank = rank % p.problem.comm.size
    before = late.values()
    if call == "last":
        other = Late().p
        call = other.move(0.02, -0.02) + 1
    look, calls = interrupted(call, rank)
    with monkeypatch.context() as patch:
        patch.setattr(problem_module, "_poll", look)
        with pytest.raises(KeyboardInterrupt):
            p.move(0.02, -0.02)
    assert len(calls) == call
    for a, b in zip(late.values(), before, strict=True):
        assert np.allclose(a, b, rtol=1e-12, atol=0)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler

    p.move(0.02, -0.02)
    other = pressed(dm.Contact, elements=("hex20", "hex8"), friction=0.3)
    other.move(0.0, -0.01)
    other.move(0.02, -0.02)
    assert np.allclose(p.norms(), other.norms(), rtol=1e-9)


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
            look, _ = interrupted(2, p.problem.comm.rank)
            patch.setattr(problem_module, "_poll", look)
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
