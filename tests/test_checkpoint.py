# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""A run continued from a file is the uninterrupted run."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import pytest
from dolfinx import la
from dolfinx_mortar import checkpoint
from pressed import pressed

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
        "import numpy as np, test_checkpoint as t\n"
        "p = t.sliding(); p.problem.load(sys.argv[2])\n"
        "v = t.run(p, t.STEPS[2:])\n"
        "if t.comm.rank == 0: np.savetxt(sys.argv[3], v, fmt='%.17g')\n"
    )
    # MPI adds to the environment of its processes what mpirun must not see
    drop = ("OMPI_COMM", "PMIX_", "PRTE_LAUNCHED", "OMPI_FILE", "OMPI_NUM")
    environment = {k: v for k, v in os.environ.items() if not k.startswith(drop)}
    arguments = [str(Path(__file__).parent), str(folder / "state"), str(folder / "values")]
    subprocess.run(
        ["mpirun", "-n", "2", sys.executable, "-c", code, *arguments],
        check=True,
        env=environment,
        timeout=200,
    )
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
        (folder / "spoilt").write_bytes(
            whole[:4096].replace(b'"bodies"', b'"bodice"') + whole[4096:]
        )
    comm.Barrier()
    for name, words in (
        ("short", "truncated"),
        ("header", "truncated|not a state file"),
        ("spoilt", "not a state file"),
        ("text", "not a state file"),
        ("missing", "can not be read"),
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


def test_interrupted_save_keeps_the_previous_file(folder, monkeypatch):
    p = sliding()
    run(p, STEPS[:1])
    p.problem.save(folder / "state")
    before = (folder / "state").read_bytes()
    run(p, STEPS[1:2])

    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("dolfinx_mortar.checkpoint._cells", stop)
    with pytest.raises(KeyboardInterrupt):
        p.problem.save(folder / "state")
    comm.Barrier()
    assert (folder / "state").read_bytes() == before


def test_save_that_fails_on_one_rank(folder, monkeypatch):
    """All ranks hear of it, and the previous file stays."""
    p = sliding()
    run(p, STEPS[:1])
    p.problem.save(folder / "state")
    before = (folder / "state").read_bytes()
    opened = checkpoint.MPI.File.Open

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
        m.setattr(checkpoint, "MPI", SimpleNamespace(**full))
        with pytest.raises(RuntimeError, match="can not be written.*state"):
            p.problem.save(folder / "state")
    comm.Barrier()
    assert (folder / "state").read_bytes() == before
    comm.Barrier()
    p.problem.save(folder / "state")


def test_save_where_no_file_can_be(folder):
    p = sliding()
    if comm.rank == 0:
        (folder / "taken").mkdir()
    comm.Barrier()
    for name in ("taken", "missing/state"):
        with pytest.raises(RuntimeError, match="can not be written"):
            p.problem.save(folder / name)
