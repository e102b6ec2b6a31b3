# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Results of an interface as functions of the slave bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dolfinx import fem

from . import cpp


class Fields:
    """Functions on the slave bodies, zero off the slave surface, made once. Collective.

    Args:
        spaces: Displacement spaces of the slave bodies.
        bodies: Their numbers among the bodies of the problem.
        layout: Displacement dofs of the problem.
        columns: Names of the functions, with the number of values at a node: 1 or 3.
        suffix: What the functions' own names end with: those of one problem may stand in one file,
            and no two of a file may be alike.
    """

    def __init__(
        self,
        spaces: Sequence[fem.FunctionSpace],
        bodies: Sequence[int],
        layout: cpp.Layout,
        columns: Mapping[str, int],
        suffix: str = "",
    ):
        self._parts = [(layout.local_start(b), layout.num_owned[b]) for b in bodies]
        scalar = [V.sub(0).collapse()[0] if 1 in columns.values() else None for V in spaces]
        self._functions = {
            name: [
                fem.Function(V if size == 3 else W, name=name + suffix)
                for V, W in zip(spaces, scalar, strict=True)
            ]
            for name, size in columns.items()
        }

    def __getitem__(self, name: str) -> Any:
        """The function; a list of them where the surface has parts on several bodies."""
        functions = self._functions[name]
        return functions[0] if len(functions) == 1 else functions

    def update(self, results: Sequence[cpp.Field]) -> None:
        """Let all functions show results; zero for those that are not there. Collective."""
        given = {r.name: r for r in results}
        for name, functions in self._functions.items():
            for (start, size), f in zip(self._parts, functions, strict=True):
                f.x.array[:] = 0.0
                if name in given:
                    nodes, values = given[name].nodes, given[name].values
                    mine = (nodes >= start) & (nodes < start + size)
                    rows = f.x.array.reshape(-1, values.shape[1])
                    rows[nodes[mine] - start] = values[mine]
                f.x.scatter_forward()
