"""The C++ unit tests, tests/cpp, run by ctest on one, two and three ranks."""

import os
import shutil
import subprocess
from pathlib import Path

import dolfinx_mortar as dm
import pytest

BUILD = Path(dm.cpp.__file__).parents[2]  # where <build>/python/dolfinx_mortar/cpp*.so is

pytestmark = pytest.mark.serial


def test_cpp_unit():
    if not (BUILD / "tests" / "cpp" / "CTestTestfile.cmake").is_file():
        pytest.skip(f"{BUILD} has no C++ tests: needs Catch2 and the CMake option MORTAR_TESTS")
    assert shutil.which("ctest"), "the build has C++ tests, but there is no ctest"
    # MPI adds to the environment of this process what mpirun must not see; os.environ lacks it.
    # Ranks that wait for others leave the processor to them.
    done = subprocess.run(
        ["ctest", "--test-dir", str(BUILD), "--output-on-failure", "--no-tests=error"],
        env=dict(os.environ, OMPI_MCA_mpi_yield_when_idle="1"),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=1000,
    )
    assert done.returncode == 0, done.stdout[-8000:]
