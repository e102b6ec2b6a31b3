# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Sizes of the bodies, and whether their meshes stay as they were."""

from __future__ import annotations

import zlib

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from .layout import Layout


def extent(layout: Layout) -> float:
    """Largest side of the box around all bodies [length]. Collective."""
    x = layout.positions().reshape(-1, 3)
    low, high = x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)
    layout.comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    layout.comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    return float(np.max(high - low))


def cell_size(layout: Layout) -> npt.NDArray[np.float64]:
    """Mean cell size of its body at each owned displacement dof [length]. Collective."""
    sizes = np.empty(layout.size_u)
    for b, V in enumerate(layout.spaces):
        dim = V.mesh.topology.dim
        num = V.mesh.topology.index_map(dim).size_local
        h = V.mesh.h(dim, np.arange(num, dtype=np.int32))
        total = layout.comm.allreduce(np.array([h.sum(), num]))
        sizes[layout.starts[b] : layout.starts[b + 1]] = total[0] / total[1]
    return sizes


def checksums(layout: Layout) -> list[int]:
    """Checksums of this rank's part of the meshes."""
    meshes = [V.mesh for V in layout.spaces]
    return [zlib.crc32(np.ascontiguousarray(m.geometry.x)) for m in meshes]
