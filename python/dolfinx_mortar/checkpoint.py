# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""States of a problem in files, to continue a run on any number of ranks.

Values are stored cell by cell, cells in the order of the mesh's input: this order and the dofs of
a cell do not depend on the partition. A file is a header of fixed size (JSON) and a block of
doubles for each body.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from . import cpp

if TYPE_CHECKING:
    from .problem import ContactProblem

_MAGIC = "dolfinx_mortar state 1"
_HEADER = 4096


def _cells(problem: ContactProblem, body: int) -> tuple[npt.NDArray, npt.NDArray]:
    """Original numbers and dofs of the cells a rank owns."""
    V = problem._layout.spaces[body]
    mesh = V.mesh
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    return np.asarray(mesh.topology.original_cell_index[:owned]), V.dofmap.list[:owned]


def _columns(problem: ContactProblem, body: int) -> npt.NDArray[np.float64]:
    """What is stored at the local nodes of a body, shape (n, columns). Collective.

    Columns: displacement, and for each contact or tie with slave nodes on the body multiplier,
    slip, carries, status, c_n, c_t, scale.
    """
    layout, coupling = problem._layout, problem._coupling
    u = problem._functions[body].x.array.reshape(-1, 3)[: layout.num_local[body]]
    columns = [u]
    for i in coupling.interfaces:
        n = i.num_owned
        z = coupling.multipliers.local(problem._z, i)
        more = np.zeros((i.num_nodes, 8))
        if i in coupling.contacts and problem._started:
            more[:n, :3] = i._total_slip
            more[:n, 3] = i._data.carries[:n]
            more[:n, 4] = i._status
            more[:n, 5], more[:n, 6], more[:n, 7] = i._c_n, i._c_t, i._scale
            cpp.scatter_forward(i._surface_slave, more)
        values = np.zeros((layout.num_local[body], 11))
        local = i._surface_slave.local_blocks - layout.local_start(body)
        mine = (local >= 0) & (local < layout.num_local[body])
        values[local[mine]] = np.hstack([z, more])[mine]
        # Nodes of other ranks' slave facets: their owners know
        f = np.ascontiguousarray(values)
        columns.append(layout.forward(body, f))
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
        [type(i).__name__, i.multiplier_space, int(i._surface_slave.num_global)]
        for i in problem._coupling.interfaces
    ]
    return {"magic": _MAGIC, "bodies": bodies, "interfaces": kinds}


def save(problem: ContactProblem, path: str | Path) -> None:
    """See :meth:`ContactProblem.save`."""
    comm = problem.comm
    path = Path(path)
    partial = path.with_name(path.name + ".partial")
    header = _describe(problem)
    header["started"] = problem._started
    columns = [_columns(problem, b) for b in range(len(problem._functions))]
    sizes = [
        d["cells"] * d["dofs_per_cell"] * c.shape[1] * 8 for d, c in zip(header["bodies"], columns)
    ]
    header["columns"] = [int(c.shape[1]) for c in columns]
    header["size"] = _HEADER + sum(sizes)
    text = json.dumps(header).encode()
    if len(text) > _HEADER:
        raise RuntimeError("Too many bodies and interfaces for the header of a state file.")

    message = ""
    if comm.rank == 0:
        try:
            with open(partial, "wb") as f:
                f.write(text.ljust(_HEADER))
                f.truncate(header["size"])
        except OSError as error:
            message = str(error)
    _check_written(comm, path, message)
    file = MPI.File.Open(comm, str(partial), MPI.MODE_WRONLY)
    start = _HEADER
    for b, values in enumerate(columns):
        cells, dofs = _cells(problem, b)
        order = np.argsort(cells)
        record = np.ascontiguousarray(values[dofs[order]])
        kind = MPI.DOUBLE.Create_contiguous(int(dofs.shape[1] * values.shape[1])).Commit()
        view = kind.Create_indexed_block(1, cells[order].astype(np.int32)).Commit()
        file.Set_view(start, MPI.DOUBLE, view)
        try:
            file.Write_all(record)
        except MPI.Exception as error:  # perhaps on this rank alone: the others go on
            message = str(error)
        view.Free()
        kind.Free()
        start += sizes[b]
    try:
        file.Sync()
    except MPI.Exception as error:
        message = str(error)
    file.Close()
    _check_written(comm, path, message)
    # The file that was there before stays until the new one is complete
    if comm.rank == 0:
        try:
            os.replace(partial, path)
        except OSError as error:
            message = str(error)
    _check_written(comm, path, message)


def _check_written(comm, path: Path, message: str) -> None:
    """Raise on all ranks where one could not write. Collective."""
    message = max(comm.allgather(message))
    if message:
        raise RuntimeError(f"The state can not be written to {path}: {message}.")


def _read_header(problem: ContactProblem, path: Path) -> dict:
    comm = problem.comm
    expected = _describe(problem)
    message, header = "", {}
    if comm.rank == 0:
        try:
            with open(path, "rb") as f:
                header = json.loads(f.read(_HEADER).decode())
            if not isinstance(header, dict) or header.get("magic") != _MAGIC:
                message = f"{path} is not a state file of dolfinx_mortar."
            elif os.path.getsize(path) != header["size"]:
                message = (
                    f"{path} is truncated: it has {os.path.getsize(path)} bytes of "
                    f"{header['size']}."
                )
            else:
                message = _compare(header, expected, path)
        except OSError as error:
            message = f"The state can not be read from {path}: {error}."
        except (ValueError, KeyError, TypeError):
            message = f"{path} is not a state file of dolfinx_mortar."
    message, header = comm.bcast((message, header))
    if message:
        raise RuntimeError(message)
    return header


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
    path = Path(path)
    header = _read_header(problem, path)
    layout, coupling = problem._layout, problem._coupling
    file = MPI.File.Open(problem.comm, str(path), MPI.MODE_RDONLY)
    start = _HEADER
    values = []
    for b, (body, width) in enumerate(zip(header["bodies"], header["columns"])):
        cells, dofs = _cells(problem, b)
        order = np.argsort(cells)
        record = np.empty((len(cells), dofs.shape[1], width))
        kind = MPI.DOUBLE.Create_contiguous(int(dofs.shape[1] * width)).Commit()
        view = kind.Create_indexed_block(1, cells[order].astype(np.int32)).Commit()
        file.Set_view(start, MPI.DOUBLE, view)
        file.Read_all(record)
        view.Free()
        kind.Free()
        start += body["cells"] * body["dofs_per_cell"] * width * 8
        nodal = np.full((layout.num_local[b], width), np.nan)
        nodal[dofs[order].ravel()] = record.reshape(-1, width)
        values.append(layout.complete(b, nodal))
    file.Close()

    for b, f in enumerate(problem._functions):
        f.x.array.reshape(-1, 3)[: layout.num_local[b]] = values[b][:, :3]
        f.x.scatter_forward()
    for k, i in enumerate(coupling.interfaces):
        n = i.num_owned
        local = i._surface_slave.local_blocks[:n]
        nodal = np.zeros((n, 11))
        for b in range(len(problem._functions)):
            at = local - layout.local_start(b)
            mine = (at >= 0) & (at < layout.num_local[b])
            nodal[mine] = values[b][at[mine], 3 + 11 * k : 14 + 11 * k]
        problem._z[coupling.multipliers.slice(i)] = nodal[:, :3].ravel()
        if i in coupling.contacts:
            i._total_slip = nodal[:, 3:6].copy()
            carries = np.zeros(i.num_nodes, dtype=np.int8)
            carries[:n] = nodal[:, 6] > 0.5
            cpp.scatter_forward(i._surface_slave, carries)
            i._data.carries = carries
            i._c_n, i._c_t, i._scale = (nodal[:, c].copy() for c in (8, 9, 10))
    problem._started = bool(header["started"])
    if problem._started:
        coupling.resume(
            layout.all_local(problem._functions), layout.gather(problem._functions), problem._z
        )
