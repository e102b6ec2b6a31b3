"""The C++ demo, built in a clean folder against an installed library."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import dolfinx_mortar as dm
import pytest

DEMO = Path(__file__).parents[1] / "demos" / "cpp"
BUILD = Path(dm.cpp.__file__).parents[2]  # where <build>/python/dolfinx_mortar/cpp*.so is


def run(*command):
    # MPI adds to the environment of this process what mpirun must not see; os.environ lacks it.
    done = subprocess.run(
        [str(c) for c in command],
        env=dict(os.environ),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout[-4000:]
    return done.stdout


@pytest.mark.serial
@pytest.mark.slow
def test_demo_from_installed_package(tmp_path):
    if not (BUILD / "CMakeCache.txt").is_file() or shutil.which("cmake") is None:
        pytest.skip("needs the CMake build folder that dolfinx_mortar was imported from")
    prefix, work = tmp_path / "prefix", tmp_path / "build"
    run("cmake", "--install", BUILD, "--prefix", prefix)
    assert not list(prefix.rglob("*.cpp"))
    run(
        "cmake", "-G", "Ninja", "-S", DEMO, "-B", work, f"-DCMAKE_PREFIX_PATH={prefix};{sys.prefix}"
    )
    run("cmake", "--build", work)

    found = []
    for ranks in (1, 2, 3):
        output = run("mpirun", "-n", ranks, work / "mortar_demo")
        numbers = [float(n) for n in re.findall(r": +([-+.e0-9]+)", output)]
        assert len(numbers) >= 5, output
        multipliers, norm_d, norm_m, difference, area = numbers[:5]
        assert multipliers == 49  # Q2 on 3 x 3 facets
        assert difference < 1e-14
        assert area == pytest.approx(0.49, rel=1e-12)
        found.append((norm_d, norm_m))
    assert found[1] == pytest.approx(found[0], rel=1e-11)
    assert found[2] == pytest.approx(found[0], rel=1e-11)
