# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Programs that tests run: the C++ demos and unit tests of the build."""

import os
import subprocess
from pathlib import Path

import dolfinx_mortar as dm

# Open MPI's ranks wait in busy loops. Ranks that share cores, with each other and with other work,
# keep those cores from the rank that they wait for, unless they yield; to sleep is half as fast.
YIELDING = {"OMPI_MCA_mpi_yield_when_idle": "1"}
BUILD = Path(dm.cpp.__file__).parents[2]  # where <build>/python/dolfinx_mortar/cpp*.so is


def run(*command, cwd=None, timeout=900):
    """Run a command, which must succeed; returns what it writes.

    The limit is for what hangs: ranks that are left few cores by other work take minutes.
    """
    # MPI adds to the environment of this process what mpirun must not see; os.environ lacks it.
    done = subprocess.run(
        [str(c) for c in command],
        env=YIELDING | os.environ,
        cwd=cwd,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=timeout,
    )
    assert done.returncode == 0, done.stdout[-8000:]
    return done.stdout
