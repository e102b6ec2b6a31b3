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
from dolfinx import fem, la

from . import cpp, state_file
from .contact import Contact
from .interfaces import Interface

if TYPE_CHECKING:
    from .problem import ContactProblem

#: Columns of a slave node: multiplier, slip, has_multiplier, status, c_n, c_t, scale
_WIDTH = 11


def _cells(V: fem.FunctionSpace) -> tuple[npt.NDArray, npt.NDArray]:
    """Original numbers and dofs of the cells a rank owns."""
    mesh = V.mesh
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    return np.asarray(mesh.topology.original_cell_index[:owned]), V.dofmap.list[:owned]


def _num_local(V: fem.FunctionSpace) -> int:
    return V.dofmap.index_map.size_local + V.dofmap.index_map.num_ghosts


def _forward(V: fem.FunctionSpace, values: npt.NDArray) -> npt.NDArray[np.float64]:
    """Copy rows of owned blocks to their ghosts, shape (n, columns). Collective."""
    columns = values.shape[1]
    vector = la.vector(V.dofmap.index_map, columns, dtype=np.float64)
    vector.array[:] = values.ravel()
    vector.scatter_forward()
    return vector.array.reshape(-1, columns).copy()


def _complete(V: fem.FunctionSpace, values: npt.NDArray) -> npt.NDArray[np.float64]:
    """Fill rows that are NaN (on any rank) with the values other ranks have. Collective."""
    columns, owned = values.shape[1], V.dofmap.index_map.size_local
    known = ~np.isnan(values).any(axis=1)
    vector = la.vector(V.dofmap.index_map, columns + 1, dtype=np.float64)
    array = vector.array.reshape(-1, columns + 1)
    array[:, :columns] = np.where(known[:, None], values, 0.0)
    array[:, columns] = known
    vector.scatter_reverse(la.InsertMode.add)
    array = vector.array.reshape(-1, columns + 1)
    # Ranks agree on the values of a node; do not let an average round
    mean = array[:owned, :columns] / np.maximum(array[:owned, columns:], 1.0)
    out = np.zeros_like(values)
    out[:owned] = np.where(known[:owned, None], values[:owned], mean)
    return _forward(V, out)


def _occurrences(i: Interface) -> npt.NDArray[np.int64]:
    """How many owned slave nodes of an interface come before each at its displacement node."""
    slave = i.data.slave
    blocks = slave.local_blocks[: slave.num_owned]
    order = np.argsort(blocks, kind="stable")
    _, first, group = np.unique(blocks[order], return_index=True, return_inverse=True)
    count = np.empty(len(blocks), dtype=np.int64)
    count[order] = np.arange(len(blocks)) - first[group.ravel()]
    return count


def most_occurrences(i: Interface) -> int:
    """Largest number of slave nodes of an interface at one displacement node. Collective."""
    most = int(np.max(_occurrences(i), initial=0)) + 1
    return i.comm.allreduce(most, op=MPI.MAX)


def _slave_values(i: Interface, state: cpp.State, k: int) -> npt.NDArray[np.float64]:
    """What is stored of the owned slave nodes of an interface, shape (num_owned, 11)."""
    n, s = i.data.slave.num_owned, state.interfaces[k]
    values = np.zeros((n, _WIDTH))
    values[:, :3] = _multipliers(i, state.z)
    if isinstance(i, Contact) and state.started:
        values[:, 3:6] = s.slip
        values[:, 6] = s.basis.has_multiplier[:n]
        values[:, 7] = s.status
        values[:, 8], values[:, 9], values[:, 10] = s.c_n, s.c_t, s.scale
    return values


def _multipliers(i: Interface, z: npt.NDArray) -> npt.NDArray[np.float64]:
    """Part of an interface in an array of multipliers, shape (num_owned, 3); a view."""
    first = i.first_node
    return z.reshape(-1, 3)[first : first + i.data.slave.num_owned]


def _slots(
    problem: ContactProblem, i: Interface, body: int
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.int32], npt.NDArray[np.int64]]:
    """Where the owned slave nodes of an interface are among the values of a body.

    Returns:
        Flags of the nodes on the body; for these displacement nodes and occurrences.
    """
    layout, slave = problem.coupling.layout, i.data.slave
    local = slave.local_blocks[: slave.num_owned] - layout.local_start(body)
    mine = (local >= 0) & (local < layout.num_owned[body])
    return mine, local[mine], _occurrences(i)[mine]


def _columns(problem: ContactProblem, state: cpp.State, body: int) -> npt.NDArray[np.float64]:
    """What is stored at the local nodes of a body, shape (n, columns). Collective.

    Columns: displacement, and for each interface as often as it has slave nodes at one
    displacement node those of :data:`_WIDTH`.
    """
    V, layout = problem.spaces[body], problem.coupling.layout
    n, start = _num_local(V), layout.owned_start(body)
    u = np.zeros((n, 3))
    u[: layout.num_owned[body]] = state.u.reshape(-1, 3)[start : start + layout.num_owned[body]]
    columns = [_forward(V, u)]
    for k, i in enumerate(problem.interfaces):
        values = np.zeros((n, most_occurrences(i), _WIDTH))
        mine, nodes, occurrence = _slots(problem, i, body)
        values[nodes, occurrence] = _slave_values(i, state, k)[mine]
        columns.append(_forward(V, values.reshape(n, -1)))
    return np.hstack(columns)


def _describe(problem: ContactProblem) -> dict:
    """What must be the same in the file and in the problem. Collective."""
    bodies = []
    for V in problem.spaces:
        x = V.tabulate_dof_coordinates()[: V.dofmap.index_map.size_local]
        moments = problem.comm.allreduce(np.concatenate([x.sum(axis=0), (x**2).sum(axis=0)]))
        bodies.append(
            {
                "cells": int(V.mesh.topology.index_map(V.mesh.topology.dim).size_global),
                "dofs_per_cell": int(V.dofmap.list.shape[1]),
                "blocks": int(V.dofmap.index_map.size_global),
                "moments": [float(m) for m in moments],
            }
        )
    kinds = [
        [
            type(i).__name__,
            i.multiplier_space,
            int(i.data.slave.num_global),
            most_occurrences(i),
        ]
        for i in problem.interfaces
    ]
    tools = _tools(problem, problem._cpp_object.displacements())
    return {"bodies": bodies, "interfaces": kinds, "tools": tools}


def _tools(problem: ContactProblem, u: npt.NDArray[np.float64]) -> list[float]:
    """Displacements of the frames of rigid tools, which rank 0 owns. Collective."""
    first = problem.coupling.layout.owned_start(len(problem.spaces))
    return problem.comm.bcast([float(x) for x in u[3 * first :]])


def save(problem: ContactProblem, path: str | Path) -> None:
    """See :meth:`ContactProblem.save`."""
    comm, description, state = problem.comm, _describe(problem), problem.state
    if not comm.allreduce(len(state.u) > 0 or problem.coupling.layout.size == 0, op=MPI.LAND):
        state.u = problem._cpp_object.displacements()
    blocks, finite = [], True
    for b, (V, body) in enumerate(zip(problem.spaces, description["bodies"], strict=True)):
        values = _columns(problem, state, b)
        cells, dofs = _cells(V)
        finite = finite and bool(np.all(np.isfinite(values)))
        blocks.append(state_file.Block(cells, body["cells"], values[dofs].reshape(len(cells), -1)))
    if not comm.allreduce(finite, op=MPI.LAND):
        raise RuntimeError(
            f"The state is not written to {path}: displacements or multipliers are not finite."
        )
    description["started"], description["tools"] = state.started, _tools(problem, state.u)
    state_file.write(comm, Path(path), description, blocks)


def _compare(header: dict, expected: dict, path: Path) -> str:
    if header["interfaces"] != expected["interfaces"]:
        return (
            f"{path} belongs to another problem: its interfaces are {header['interfaces']}, "
            f"here they are {expected['interfaces']}."
        )
    if len(header["bodies"]) != len(expected["bodies"]):
        return f"{path} belongs to another problem: the number of bodies differs."
    if len(header.get("tools", [])) != len(expected["tools"]):
        return f"{path} belongs to another problem: the number of rigid tools differs."
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


def load(problem: ContactProblem, path: str | Path) -> cpp.State:
    """The state that a file holds. Collective.

    Raises:
        RuntimeError: See :meth:`ContactProblem.load`.
    """
    path, comm = Path(path), problem.comm
    header = state_file.read_description(comm, path)
    message = _compare(header["description"], _describe(problem), path)
    if message:
        raise RuntimeError(message)
    parts = [_cells(V) for V in problem.spaces]
    records = state_file.read(comm, path, header, [cells for cells, _ in parts])
    values = []
    for V, (_, dofs), record in zip(problem.spaces, parts, records, strict=True):
        width = record.shape[1] // dofs.shape[1]
        nodal = np.full((_num_local(V), width), np.nan)
        nodal[dofs.ravel()] = record.reshape(-1, width)
        values.append(_complete(V, nodal))
    return _state(problem, values, header["description"])


def _state(problem: ContactProblem, values: list[npt.NDArray], description: dict) -> cpp.State:
    """The state that was stored, from values at the local nodes of each body."""
    state, layout = problem.state, problem.coupling.layout
    owned = [v[:n, :3].ravel() for v, n in zip(values, layout.num_owned)]  # tools follow
    tools = description.get("tools", []) if problem.comm.rank == 0 else []
    state.u, started = np.concatenate([*owned, tools]), bool(description["started"])
    z, start, interfaces = np.zeros(problem.coupling.size), 3, state.interfaces
    for k, i in enumerate(problem.interfaces):
        width = _WIDTH * most_occurrences(i)
        nodal = np.zeros((i.data.slave.num_owned, _WIDTH))
        for b in range(len(problem.spaces)):
            mine, nodes, occurrence = _slots(problem, i, b)
            stored = values[b][:, start : start + width].reshape(len(values[b]), -1, _WIDTH)
            nodal[mine] = stored[nodes, occurrence]
        start += width
        _multipliers(i, z)[:] = nodal[:, :3]
        if isinstance(i, Contact):
            s = interfaces[k]
            s.slip = np.ascontiguousarray(nodal[:, 3:6])
            s.status = nodal[:, 7].round().astype(np.int8)
            s.c_n, s.c_t, s.scale = (np.ascontiguousarray(nodal[:, c]) for c in (8, 9, 10))
    state.z, state.started, state.interfaces = z, started, interfaces
    return state
