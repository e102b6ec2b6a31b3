# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Defaults and fixed numbers, read from the sources; defaults.toml says what they change."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import tomllib

ROOT = Path(__file__).parents[1]
PYTHON = ROOT / "python" / "dolfinx_mortar"
CPP = ROOT / "cpp" / "dolfinx_mortar"

#: What users call, and where it is
CALLS = {
    "Tie": ("interfaces.py", "Interface.__init__"),
    "Contact": ("contact.py", "Contact.__init__"),
    "ContactProblem": ("problem.py", "ContactProblem.__init__"),
    "ContactProblem.solve": ("problem.py", "ContactProblem.solve"),
    "ContactProblem.steps": ("problem.py", "ContactProblem.steps"),
    "relocate": ("relocation.py", "relocate"),
    "adjust": ("relocation.py", "adjust"),
    "RigidPlane": ("tools.py", "RigidPlane.__init__"),
    "RigidSphere": ("tools.py", "RigidSphere.__init__"),
    "RigidCylinder": ("tools.py", "RigidCylinder.__init__"),
    "mesh.find_pairs": ("mesh/pairs.py", "find_pairs"),
    "mesh.create_mesh": ("mesh/arrays.py", "create_mesh"),
    "mesh.read_abaqus": ("mesh/abaqus.py", "read_abaqus"),
}
FACETS = ("tri3", "quad4", "tri6", "quad8", "quad9")
#: Groups of PETSc options in solver_options.cpp
OPTIONS = ("newton", "direct", "factorisation", "krylov", "inexact", "corners", "multigrid")


class FixedNumber(NamedTuple):
    """A number that the sources fix, with its comment."""

    name: str
    value: str
    file: str
    comment: str


def of_call(name: str) -> dict[str, str]:
    """Default of each argument that has one, as it is written; names of constants replaced."""
    file, path = CALLS[name]
    tree = ast.parse((PYTHON / file).read_text())
    constants = {
        ast.unparse(n.targets[0]): ast.unparse(n.value)
        for n in tree.body
        if isinstance(n, ast.Assign) and isinstance(n.value, ast.Constant)
    }
    node: Any = tree
    for part in path.split("."):
        node = next(n for n in node.body if getattr(n, "name", None) == part)
    a = node.args
    pairs = [*zip(a.args[len(a.args) - len(a.defaults) :], a.defaults)]
    pairs += [(k, d) for k, d in zip(a.kwonlyargs, a.kw_defaults) if d is not None]
    texts = {arg.arg: ast.unparse(default) for arg, default in pairs}
    return {arg: constants.get(text, text) for arg, text in texts.items()}


def of_options(group: str) -> dict[str, str]:
    """PETSc options of a group in solver_options.cpp."""
    source = (CPP / "solver" / "solver_options.cpp").read_text()
    (body,) = re.findall(rf"const Options {group}\s*=\s*\{{(.*?)\}};", source, re.DOTALL)
    return dict(re.findall(r'\{"([\w]+)",\s*"([^"]*)"\}', body))


def fixed_numbers() -> list[FixedNumber]:
    """Numbers that the sources name and fix, those with a comment."""
    numbers = [n for path in sorted(PYTHON.rglob("*.py")) for n in _fixed_in(path, PYTHON, "#:")]
    numbers += [n for path in sorted(CPP.glob("*/*.*")) for n in _fixed_in(path, CPP, "//")]
    return [n for n in numbers if n.name not in effects()["structure"]]


def _fixed_in(path: Path, root: Path, mark: str) -> Iterator[FixedNumber]:
    comment: list[str] = []
    last = ""
    for line in path.read_text().splitlines():
        text = line.strip()
        if text.startswith(mark):
            comment = comment if last.startswith(mark) else []
            comment.append(text.lstrip("/#: "))
        found = re.match(r"(?:static )?constexpr (?:double|int|std::int64_t) (.*);", text)
        found = found or re.fullmatch(r"([A-Z_]+ = [-\d.e]+)", text)
        words = re.sub(r"@brief |----+", "", " ".join(comment)).strip()
        if found and words:
            for name, value in re.findall(r"(\w+) = ([-\d.e]+)", found[1]):
                yield FixedNumber(name, value, str(path.relative_to(root)), words)
        elif not text.startswith(mark):
            comment = []
        last = text


def quadrature_degrees() -> dict[tuple[str, str], int]:
    """Default degree of the rule for pairs of slave and master facets."""
    from dolfinx_mortar import cpp

    types = {name: getattr(cpp.FacetType, name) for name in FACETS}
    return {(s, m): cpp.default_degree(types[s], types[m]) for s in types for m in types}


def effects() -> dict[str, Any]:
    """What defaults.toml says, by table."""
    return tomllib.loads(Path(__file__).with_suffix(".toml").read_text())


def undescribed() -> list[str]:
    """Defaults without a description, and descriptions of what is no default any more."""
    described = effects()
    found = {name: set(of_call(name)) for name in CALLS}
    found |= {f"petsc.{group}": set(of_options(group)) for group in OPTIONS}
    given = {name: set(described.get("call", {}).get(name, {})) for name in CALLS}
    given |= {f"petsc.{g}": set(described.get("petsc", {}).get(g, {})) for g in OPTIONS}
    return [f"{name}: {argument}" for name in found for argument in found[name] ^ given[name]]
