# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Results of an interface as functions of the slave bodies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from . import cpp
from .layout import Layout


def spread(
    surface: cpp.Surface, carries: npt.NDArray[np.bool_], values: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Give nodes without a multiplier the mean of their facets' nodes that have one. Collective.

    Args:
        surface: Surface.
        carries: Flags of local nodes that carry a multiplier, shape (n,).
        values: Values of local nodes, shape (n, columns).
    """
    sums = np.zeros((len(values), values.shape[1] + 1))
    offsets, nodes = surface.offsets, surface.nodes
    sizes = np.diff(offsets)
    for size in np.unique(sizes):
        facets = np.flatnonzero(sizes == size)
        dofs = nodes[offsets[facets][:, None] + np.arange(size)]
        has = carries[dofs]
        count = has.sum(axis=1)
        mean = (values[dofs] * has[:, :, None]).sum(axis=1)
        mean = mean / np.maximum(count, 1)[:, None]
        rows = np.hstack([mean, np.ones((len(facets), 1))])[count > 0]
        target = dofs[count > 0]
        np.add.at(sums, target, rows[:, None, :])
    cpp.scatter_reverse_add(surface, sums)
    cpp.scatter_forward(surface, sums)
    out = np.where(carries[:, None], values, 0.0)
    bare = ~carries & (sums[:, -1] > 0)
    out[bare] = sums[bare, :-1] / sums[bare, -1:]
    return out


def combine(
    blocks: npt.NDArray[np.integer],
    values: npt.NDArray[np.float64],
    how: str,
    measure: npt.NDArray[np.float64] | None = None,
) -> tuple[npt.NDArray[np.integer], npt.NDArray[np.float64]]:
    """One value for each displacement node, where several surface nodes may be at it.

    Args:
        blocks: Displacement node of each surface node, shape (n,).
        values: Values of the surface nodes, shape (n, columns).
        how: ``"largest"``, ``"smallest"``, ``"mean"`` weighted by the measure, or ``"first"``,
            the value of the node with the largest measure.
        measure: Measure of each surface node, not negative, shape (n,).

    Returns:
        Displacement nodes, each once, and their values.
    """
    nodes, group, count = np.unique(blocks, return_inverse=True, return_counts=True)
    group = group.ravel()
    if len(nodes) == len(blocks):
        return blocks, values
    if how == "first":
        order = np.lexsort((np.arange(len(group)), -measure, group))
        _, first = np.unique(group[order], return_index=True)
        return nodes, values[order[first]]
    if how == "mean":
        total = np.bincount(group, weights=measure)[group]
        share = np.where(total > 0, measure / np.where(total > 0, total, 1), 1 / count[group])
        out = np.zeros((len(nodes), values.shape[1]))
        np.add.at(out, group, share[:, None] * values)
        return nodes, out
    out = np.full((len(nodes), values.shape[1]), -np.inf if how == "largest" else np.inf)
    (np.maximum if how == "largest" else np.minimum).at(out, group, values)
    return nodes, out


class Fields:
    """Functions on the slave bodies, zero off the slave surface, made once. Collective.

    Args:
        layout: Displacement dofs.
        surface: Slave surface.
        bodies: Bodies that it is on, ascending.
        columns: Names of the functions, with the number of values at a node: 1 or 3.
    """

    def __init__(
        self, layout: Layout, surface: cpp.Surface, bodies: list[int], columns: Mapping[str, int]
    ):
        self._layout, self._surface, self._bodies = layout, surface, bodies
        self._functions = {
            name: [
                fem.Function(layout.spaces[b] if size == 3 else layout.scalar_space(b), name=name)
                for b in bodies
            ]
            for name, size in columns.items()
        }

    def __getitem__(self, name: str) -> Any:
        """The function; a list of them where the surface has parts on several bodies."""
        functions = self._functions[name]
        return functions[0] if len(functions) == 1 else functions

    def clear(self) -> None:
        """Set all functions to zero."""
        for functions in self._functions.values():
            for f in functions:
                f.x.array[:] = 0.0

    def set(
        self,
        name: str,
        values: npt.NDArray[np.float64],
        how: str,
        measure: npt.NDArray[np.float64] | None = None,
    ) -> None:
        """Set a function. Collective.

        Args:
            name: Its name.
            values: Values of the owned slave nodes, shape (num_owned, columns).
            how: See :func:`combine`.
            measure: See :func:`combine`.
        """
        # Owners know all surface nodes at their displacement nodes, other ranks may not
        blocks = self._surface.local_blocks[: self._surface.num_owned]
        nodes, values = combine(blocks, values, how, measure)
        for b, f in zip(self._bodies, self._functions[name]):
            local = nodes - self._layout.local_start(b)
            mine = (local >= 0) & (local < self._layout.num_owned[b])
            f.x.array[:] = 0.0
            f.x.array.reshape(-1, values.shape[1])[local[mine]] = values[mine]
            f.x.scatter_forward()
