# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""States of a problem in files, to continue a run on any number of ranks.

Values are stored cell by cell: the order of the cells in the mesh's input and the dofs of a cell
do not depend on the partition. Several slave nodes of an interface may be at one displacement
node, in an order that does not depend on it either; each has its columns there.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from . import cpp, state_file
from .interfaces import Interface

if TYPE_CHECKING:
    from .problem import ContactProblem

#: Columns of a slave node: multiplier, slip, carries, status, c_n, c_t, scale
_WIDTH = 11


def _cells(problem: ContactProblem, body: int) -> tuple[npt.NDArray, npt.NDArray]:
    """Original numbers and dofs of the cells a rank owns."""
    V = problem._layout.spaces[body]
    mesh = V.mesh
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    return np.asarray(mesh.topology.original_cell_index[:owned]), V.dofmap.list[:owned]


def _occurrences(i: Interface) -> npt.NDArray[np.int64]:
    """How many owned slave nodes of an interface come before each at its displacement node."""
    blocks = i._surface_slave.local_blocks[: i.num_owned]
    order = np.argsort(blocks, kind="stable")
    _, first, group = np.unique(blocks[order], return_index=True, return_inverse=True)
    count = np.empty(len(blocks), dtype=np.int64)
    count[order] = np.arange(len(blocks)) - first[group.ravel()]
    return count


def _most_occurrences(i: Interface) -> int:
    """Largest number of slave nodes at one displacement node. Collective."""
    most = int(np.max(_occurrences(i), initial=0)) + 1
    return i._layout.comm.allreduce(most, op=MPI.MAX)


def _slave_values(problem: ContactProblem, i: Interface) -> npt.NDArray[np.float64]:
    """What is stored of the owned slave nodes of an interface, shape (num_owned, 11)."""
    coupling = problem._coupling
    values = np.zeros((i.num_owned, _WIDTH))
    values[:, :3] = problem._z[coupling.multipliers.slice(i)].reshape(-1, 3)
    if i in coupling.contacts and problem._started:
        values[:, 3:6] = i._total_slip
        values[:, 6] = i._data.carries[: i.num_owned]
        values[:, 7] = i._status
        values[:, 8], values[:, 9], values[:, 10] = i._c_n, i._c_t, i._scale
    return values


def _slots(problem: ContactProblem, i: Interface, body: int):
    """Where the owned slave nodes of an interface are among the values of a body.

    Returns:
        Flags of the nodes on the body; for these displacement nodes and occurrences.
    """
    layout = problem._layout
    local = i._surface_slave.local_blocks[: i.num_owned] - layout.local_start(body)
    mine = (local >= 0) & (local < layout.num_owned[body])
    return mine, local[mine], _occurrences(i)[mine]


def _columns(problem: ContactProblem, body: int) -> npt.NDArray[np.float64]:
    """What is stored at the local nodes of a body, shape (n, columns). Collective.

    Columns: displacement, and for each interface as often as it has slave nodes at one
    displacement node those of :data:`_WIDTH`.
    """
    layout = problem._layout
    n = layout.num_local[body]
    columns = [problem._functions[body].x.array.reshape(-1, 3)[:n]]
    for i in problem._coupling.interfaces:
        values = np.zeros((n, _most_occurrences(i), _WIDTH))
        mine, nodes, occurrence = _slots(problem, i, body)
        values[nodes, occurrence] = _slave_values(problem, i)[mine]
        columns.append(layout.forward(body, values.reshape(n, -1)))
    return np.hstack(columns)


def _describe(problem: ContactProblem) -> dict:
    """What must be the same in the file and in the problem. Collective."""
    layout = problem._layout
    bodies = []
    for b, V in enumerate(layout.spaces):
        tdim = V.mesh.topology.dim
        cells = V.mesh.topology.index_map(tdim).size_global
        x = V.tabulate_dof_coordinates()[: layout.num_owned[b]]
        moments = layout.comm.allreduce(np.concatenate([x.sum(axis=0), (x**2).sum(axis=0)]))
        bodies.append(
            {
                "cells": int(cells),
                "dofs_per_cell": int(V.dofmap.list.shape[1]),
                "blocks": int(V.dofmap.index_map.size_global),
                "moments": [float(m) for m in moments],
            }
        )
    kinds = [
        [
            type(i).__name__,
            i.multiplier_space,
            int(i._surface_slave.num_global),
            _most_occurrences(i),
        ]
        for i in problem._coupling.interfaces
    ]
    return {"bodies": bodies, "interfaces": kinds}


def save(problem: ContactProblem, path: str | Path) -> None:
    """See :meth:`ContactProblem.save`."""
    comm, description = problem.comm, _describe(problem)
    blocks, finite = [], True
    for b, body in enumerate(description["bodies"]):
        values = _columns(problem, b)
        cells, dofs = _cells(problem, b)
        finite = finite and bool(np.all(np.isfinite(values)))
        blocks.append(state_file.Block(cells, body["cells"], values[dofs].reshape(len(cells), -1)))
    if not comm.allreduce(finite, op=MPI.LAND):
        raise RuntimeError(
            f"The state is not written to {path}: displacements or multipliers are not finite."
        )
    description["started"] = problem._started
    state_file.write(comm, Path(path), description, blocks)


def _compare(header: dict, expected: dict, path: Path) -> str:
    if header["interfaces"] != expected["interfaces"]:
        return (
            f"{path} belongs to another problem: its interfaces are {header['interfaces']}, "
            f"here they are {expected['interfaces']}."
        )
    if len(header["bodies"]) != len(expected["bodies"]):
        return f"{path} belongs to another problem: the number of bodies differs."
    for a, b in zip(header["bodies"], expected["bodies"]):
        for key in ("cells", "dofs_per_cell", "blocks"):
            if a[key] != b[key]:
                return (
                    f"{path} belongs to another mesh or space: {key} is {a[key]}, "
                    f"here it is {b[key]}."
                )
        scale = np.max(np.abs(b["moments"])) + 1e-300
        if np.max(np.abs(np.array(a["moments"]) - b["moments"])) > 1e-9 * scale:
            return f"{path} belongs to another mesh: the nodes are in other places."
    return ""


def load(problem: ContactProblem, path: str | Path) -> None:
    """See :meth:`ContactProblem.load`."""
    path, comm = Path(path), problem.comm
    header = state_file.read_description(comm, path)
    message = _compare(header["description"], _describe(problem), path)
    if message:
        raise RuntimeError(message)
    parts = [_cells(problem, b) for b in range(len(problem._functions))]
    records = state_file.read(comm, path, header, [cells for cells, _ in parts])
    values = []
    for b, ((_, dofs), record) in enumerate(zip(parts, records)):
        width = record.shape[1] // dofs.shape[1]
        nodal = np.full((problem._layout.num_local[b], width), np.nan)
        nodal[dofs.ravel()] = record.reshape(-1, width)
        values.append(problem._layout.complete(b, nodal))
    before = problem._state()
    try:
        _set(problem, values, bool(header["description"]["started"]))
    except Exception:
        problem._restore(before)
        raise


def _set(problem: ContactProblem, values: list[npt.NDArray], started: bool) -> None:
    """Give a problem the state that was stored. Collective."""
    layout, coupling = problem._layout, problem._coupling
    for b, f in enumerate(problem._functions):
        f.x.array.reshape(-1, 3)[: layout.num_local[b]] = values[b][:, :3]
        f.x.scatter_forward()
    start = 3
    for i in coupling.interfaces:
        width = _WIDTH * _most_occurrences(i)
        nodal = np.zeros((i.num_owned, _WIDTH))
        for b in range(len(problem._functions)):
            mine, nodes, occurrence = _slots(problem, i, b)
            stored = values[b][:, start : start + width].reshape(len(values[b]), -1, _WIDTH)
            nodal[mine] = stored[nodes, occurrence]
        start += width
        problem._z[coupling.multipliers.slice(i)] = nodal[:, :3].ravel()
        if i in coupling.contacts:
            _set_contact(i, nodal)
    problem._started = started
    if started:
        coupling.resume(
            layout.all_local(problem._functions), layout.gather(problem._functions), problem._z
        )


def _set_contact(c: Interface, nodal: npt.NDArray[np.float64]) -> None:
    """Give a contact the values of :func:`_slave_values`. Collective."""
    c._total_slip = nodal[:, 3:6].copy()
    carries = np.zeros(c.num_nodes, dtype=np.int8)
    carries[: c.num_owned] = nodal[:, 6] > 0.5
    cpp.scatter_forward(c._surface_slave, carries)
    c._data.carries = carries
    c._c_n, c._c_t, c._scale = (nodal[:, k].copy() for k in (8, 9, 10))
