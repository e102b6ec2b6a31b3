# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""A run continued from a file is the uninterrupted run."""

import errno
import os
import resource
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import pytest
from dolfinx import la
from dolfinx_mortar import checkpoint, state_file
from pressed import pressed
from programs import run as run_program

comm = MPI.COMM_WORLD
STEPS = [(0.0, -0.01), (0.02, -0.02), (0.05, -0.02), (0.08, -0.02)]


@pytest.fixture
def folder():
    """A folder that all ranks know."""
    path = comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else None)
    yield Path(path)


def sliding():
    return pressed(dm.Contact, elements=("hex20", "hex8"), friction=0.3)


def run(p, steps):
    for x, z in steps:
        p.move(x, z)
    return values(p)


def values(p):
    """The same for any number of ranks."""
    slip = p.interface.slip
    return np.concatenate([p.norms(), p.interface.force, [la.norm(slip.x)]])


def test_continued_is_uninterrupted(folder):
    whole = sliding()
    run(whole, STEPS[:2])
    whole.problem.save(folder / "state")
    expected = run(whole, STEPS[2:])
    continued = sliding()
    continued.problem.load(folder / "state")
    assert np.allclose(run(continued, STEPS[2:]), expected, rtol=1e-10, atol=1e-10)


@pytest.mark.serial
def test_continued_on_another_number_of_ranks(folder):
    whole = sliding()
    run(whole, STEPS[:2])
    whole.problem.save(folder / "state")
    expected = run(whole, STEPS[2:])
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "import conftest\n"  # which says how forms are compiled
        "import numpy as np, test_checkpoint as t\n"
        "p = t.sliding(); p.problem.load(sys.argv[2])\n"
        "v = t.run(p, t.STEPS[2:])\n"
        "if t.comm.rank == 0: np.savetxt(sys.argv[3], v, fmt='%.17g')\n"
    )
    arguments = [Path(__file__).parent, folder / "state", folder / "values"]
    run_program("mpirun", "-n", 2, sys.executable, "-c", code, *arguments)
    assert np.allclose(np.loadtxt(folder / "values"), expected, rtol=1e-10, atol=1e-10)


def test_state_after_loading_is_the_saved_one(folder):
    p = sliding()
    saved = run(p, STEPS[:2])
    p.problem.save(folder / "state")
    q = sliding()
    q.problem.load(folder / "state")
    assert np.allclose(values(q), saved, rtol=1e-12, atol=1e-12)


def test_foreign_and_truncated_files_are_refused(folder):
    p = sliding()
    run(p, STEPS[:1])
    before = p.norms()
    p.problem.save(folder / "state")
    if comm.rank == 0:
        whole = (folder / "state").read_bytes()
        (folder / "short").write_bytes(whole[:-100])
        (folder / "text").write_text("no state")
        (folder / "header").write_bytes(whole[:1000])
        (folder / "spoilt").write_bytes(whole.replace(b'"bodies"', b'"bodice"', 1))
        (folder / "long").write_bytes(whole + b"more")
        (folder / "newer").write_bytes(whole.replace(b"state 2", b"state 3", 1))
        (folder / "older").write_bytes(b'{"magic": "dolfinx_mortar state 1", "bodies"'.ljust(9000))
        (folder / "empty").write_bytes(b"")
    comm.Barrier()
    for name, words in (
        ("short", "truncated"),
        ("header", "truncated|not a state file"),
        ("spoilt", "damaged.*header"),
        ("long", "damaged.*bytes"),
        ("newer", "state file of version 3.*reads version 2"),
        ("older", "earlier version.*version 1"),
        ("empty", "not a state file"),
        ("text", "not a state file"),
        ("missing", "cannot be read"),
    ):
        with pytest.raises(RuntimeError, match=words):
            p.problem.load(folder / name)
    other = pressed(dm.Contact, friction=0.3)
    with pytest.raises(RuntimeError, match="belongs to another"):
        other.problem.load(folder / "state")
    tied = pressed(dm.Tie, elements=("hex20", "hex8"))
    with pytest.raises(RuntimeError, match="interfaces"):
        tied.problem.load(folder / "state")
    assert np.array_equal(p.norms(), before)


def test_damaged_files_are_refused(folder):
    """Any byte counts, and nothing changes in the problem."""
    p = sliding()
    run(p, STEPS[:2])
    p.problem.save(folder / "state")
    whole = (folder / "state").read_bytes()
    before = p.problem.state
    random = np.random.default_rng(0)
    start = 4096
    cases = []
    for k in [0, 5, 25, 40, *random.integers(0, len(whole), 25)]:
        spoilt = bytearray(whole)
        spoilt[k] ^= random.integers(1, 256)
        cases.append(bytes(spoilt))
    for k in random.integers(start, len(whole) - 512, 8):
        cases.append(whole[:k] + bytes(512) + whole[k + 512 :])
    # Two records of the upper body, exchanged
    size = 20 * 14 * 8
    a, b = start + size, start + 2 * size
    cases.append(whole[:a] + whole[b : b + size] + whole[a:b] + whole[b + size :])
    for case in cases:
        if case == whole:
            continue
        if comm.rank == 0:
            (folder / "bad").write_bytes(case)
        comm.Barrier()
        with pytest.raises(RuntimeError, match="damaged|truncated|not a state file|version"):
            p.problem.load(folder / "bad")
        assert p.problem.state == before
    p.problem.load(folder / "state")


def test_state_that_cannot_be_evaluated_is_not_taken(folder, monkeypatch):
    p = sliding()
    run(p, STEPS[:1])
    p.problem.save(folder / "state")
    run(p, STEPS[1:2])
    before = values(p)

    load = checkpoint.load

    def spoilt(*arguments):
        state = load(*arguments)
        u = state.u.reshape(-1, 3)
        u[:, 2] = np.nan
        state.u = u.ravel()
        return state

    with monkeypatch.context() as m:
        m.setattr(checkpoint, "load", spoilt)
        with pytest.raises(RuntimeError, match="finite"):
            p.problem.load(folder / "state")
    assert np.array_equal(values(p), before)


def test_several_slave_nodes_at_a_displacement_node(folder):
    """The slave surface has edges: its nodes there have a multiplier on each side."""
    p = edged()
    p.move(0.0, -0.02)
    assert checkpoint.most_occurrences(p.interface) > 1
    saved = values(p)
    p.problem.save(folder / "state")
    q = edged()
    q.problem.load(folder / "state")
    assert np.allclose(values(q), saved, rtol=1e-12, atol=1e-12)


def edged():
    """The top of the pressed block takes part, with the sides around its lower edges."""
    return pressed(dm.Contact, friction=0.3, slave_sides=("z-", "x-", "x+", "y-", "y+"))


def test_states_are_values():
    """A state brings all back; that of another problem is refused."""
    p = sliding()
    run(p, STEPS[:1])
    state, before = p.problem.state, values(p)
    run(p, STEPS[1:2])
    assert not np.allclose(values(p), before)
    p.problem.restore(state)
    assert p.problem.state == state
    np.testing.assert_allclose(values(p), before, rtol=1e-12, atol=1e-12)
    other = pressed(dm.Tie, elements=("hex8", "hex8"))
    with pytest.raises(ValueError, match="are needed"):
        other.problem.restore(state)
    state.z = np.append(state.z, 0.0)
    with pytest.raises(ValueError, match="another problem"):
        p.problem.restore(state)
    np.testing.assert_allclose(values(p), before, rtol=1e-12, atol=1e-12)


def test_interrupted_save_keeps_the_previous_file(folder, monkeypatch):
    p = sliding()
    run(p, STEPS[:1])
    p.problem.save(folder / "state")
    before = (folder / "state").read_bytes()
    run(p, STEPS[1:2])

    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("dolfinx_mortar.state_file._transfer", stop)
    with pytest.raises(KeyboardInterrupt):
        p.problem.save(folder / "state")
    comm.Barrier()
    assert (folder / "state").read_bytes() == before
    assert not (folder / "state.partial").exists()


def test_save_that_fails_on_one_rank(folder, monkeypatch):
    """All ranks hear of it, and the previous file stays."""
    p = sliding()
    run(p, STEPS[:1])
    p.problem.save(folder / "state")
    before = (folder / "state").read_bytes()
    opened = state_file.MPI.File.Open

    class Full:
        """A disk without space for the last rank."""

        def __init__(self, *args):
            self.file = opened(*args)

        def __getattr__(self, name):
            return getattr(self.file, name)

        def Write_all(self, record):
            self.file.Write_all(record)
            if comm.rank == comm.size - 1:
                raise MPI.Exception(MPI.ERR_NO_SPACE)

    full = {"File": SimpleNamespace(Open=Full), "Exception": MPI.Exception}
    full |= {name: getattr(MPI, name) for name in ("DOUBLE", "MODE_WRONLY")}
    with monkeypatch.context() as m:
        m.setattr(state_file, "MPI", SimpleNamespace(**full))
        with pytest.raises(RuntimeError, match="cannot be written.*state"):
            p.problem.save(folder / "state")
    comm.Barrier()
    assert (folder / "state").read_bytes() == before
    assert not (folder / "state.partial").exists()
    comm.Barrier()
    p.problem.save(folder / "state")


def test_save_on_a_full_disk(folder, monkeypatch):
    p = sliding()
    run(p, STEPS[:1])
    p.problem.save(folder / "state")
    before = (folder / "state").read_bytes()

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as m:
        m.setattr(os, "posix_fallocate", full)
        with pytest.raises(RuntimeError, match="cannot be written to .*No space left on device"):
            p.problem.save(folder / "state")
    comm.Barrier()
    assert [f.name for f in folder.iterdir()] == ["state"]
    assert (folder / "state").read_bytes() == before


def test_save_beyond_what_the_system_allows(folder):
    """A real refusal, on the rank that reserves the space."""
    p = sliding()
    run(p, STEPS[:1])
    allowed = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, allowed[1]))
    try:
        with pytest.raises(RuntimeError, match="cannot be written.*File too large"):
            p.problem.save(folder / "state")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, allowed)
    comm.Barrier()
    assert not list(folder.iterdir())


def test_save_where_no_file_can_be(folder):
    p = sliding()
    if comm.rank == 0:
        (folder / "taken").mkdir()
    comm.Barrier()
    for name in ("taken", "missing/state"):
        with pytest.raises(RuntimeError, match="cannot be written"):
            p.problem.save(folder / name)
