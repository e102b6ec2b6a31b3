# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Layers look down only, and no object looks into another."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CPP = ROOT / "cpp" / "dolfinx_mortar"
PYTHON = ROOT / "python" / "dolfinx_mortar"

pytestmark = pytest.mark.serial

#: Rooms of the C++ library; each includes itself and those before it. `dolfinx` alone knows
#: DOLFINx: forms, spaces and meshes, timers and the log.
ROOMS = ("common", "geometry", "surface", "multiplier", "assembly", "contact", "dolfinx", "solver")

#: Modules and subpackages of the package, lowest first; type-only imports count too, but for the
#: one that names the type of an interface's owner
MODULES = (
    *("cpp", "errors", "arguments", "agreement", "interrupts", "memory", "compat", "elements"),
    *(
        "mesh",
        "plotting",
        "parts",
        "forms",
        "state_file",
        "fields",
        "tools",
        "interfaces",
        "offsets",
        "contact",
    ),
    *("relocation", "checkpoint", "progress", "problem"),
)
ABOVE = {("interfaces", "problem"), ("checkpoint", "problem"), ("tools", "interfaces")}
#: Subpackages, which nothing else imports: they are for users who want them
EXTRAS = ("mesh", "plotting")


def test_rooms():
    found = {path.name for path in CPP.iterdir() if path.is_dir()}
    assert found == set(ROOMS)
    for path in [*CPP.glob("*/*.h"), *CPP.glob("*/*.cpp")]:
        room = path.parent.name
        for name in re.findall(r"#include <dolfinx_mortar/(\w+)/", path.read_text()):
            assert ROOMS.index(name) < ROOMS.index(room), f"{path} includes {name}"
        foreign = re.findall(r"#include <(dolfinx|basix|petsc\w*|mpi)\b", path.read_text())
        if room != "dolfinx":
            # The reference quadrature is Basix's
            allowed = {"basix"} if path.stem == "quadrature" else set()
            assert not ({"dolfinx", "basix"} & set(foreign)) - allowed, path
        if room == "geometry":
            assert not set(foreign) - {"basix"}, path


def imports(path):
    """Modules of the package, or subpackages other than its own, that a file imports."""
    level = len(path.relative_to(PYTHON).parts)
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level == level:
            if node.module:
                yield node.module.split(".")[0]
            else:
                yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            assert not node.module.startswith("dolfinx_mortar"), path


def test_modules():
    files = [p for p in PYTHON.rglob("*.py") if p != PYTHON / "__init__.py"]
    found = {path: path.relative_to(PYTHON).with_suffix("").parts[0] for path in files}
    assert set(found.values()) == set(MODULES) - {"cpp"}
    for path, name in found.items():
        for other in imports(path):
            if (name, other) not in ABOVE:
                assert MODULES.index(other) < MODULES.index(name), f"{path} imports {other}"


def test_extras_are_not_imported():
    for path in PYTHON.glob("*.py"):
        assert not set(imports(path)) & set(EXTRAS), path


def test_nothing_looks_into_another_object():
    """Names with an underscore are their object's; `_cpp_object` is DOLFINx's word for its own."""
    for path in PYTHON.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Attribute) and re.match(r"_[a-z]", node.attr):
                own = isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")
                known = node.attr in ("_cpp_object", "_ElementBase", "_BlockedElement")
                assert own or known, f"{path}:{node.lineno} uses .{node.attr}"
