"""The C++ unit tests, tests/cpp, run by ctest on one, two and three ranks."""

import shutil

import pytest
from programs import BUILD, run

pytestmark = pytest.mark.serial


def test_cpp_unit():
    if not (BUILD / "tests" / "cpp" / "CTestTestfile.cmake").is_file():
        pytest.skip(f"{BUILD} has no C++ tests: needs Catch2 and the CMake option MORTAR_TESTS")
    assert shutil.which("ctest"), "the build has C++ tests, but there is no ctest"
    options = ("--output-on-failure", "--no-tests=error")
    run("ctest", "--test-dir", BUILD, *options, timeout=1000)
