# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Relocation of slave nodes onto the master surface."""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import fem
from scipy.spatial import cKDTree

from . import agreement, arguments, sparse
from .interfaces import Tie
from .layout import Layout
from .multipliers import Multipliers


def relocate(tie: Tie, bcs: Sequence[fem.DirichletBC] = (), limit: float = 0.8) -> float:
    """Move the slave nodes of *your* mesh onto the master surface, X_s := D⁻¹ M X_m. Collective.

    A tie constrains displacements. Where the discretised surfaces of a curved interface do not
    coincide, forces that balance have a small moment left, and a rigid rotation creates a small
    stress. Both vanish when D X_s = M X_m holds. Call this before forms are assembled and before
    the problem is created.

    D and M stay those of the positions before: the tie keeps these, since the condition is exact
    only with the matrices that gave the new positions.

    Only geometry nodes at slave nodes that carry a multiplier, and those on edges between them,
    move. With multipliers on edges, straight cells under a second-order displacement can not
    follow: give the mesh the order of the displacement, or only a part of the stress goes.

    Args:
        tie: Interface, not yet part of a problem.
        bcs: Dirichlet conditions of the problem; nodes they fix entirely do not move.
        limit: Largest motion allowed, as a share of the size of the adjacent facets.

    Returns:
        Largest motion of a node [length].

    Raises:
        RuntimeError: A node would move further than ``limit`` allows; nothing has been moved.
    """
    if not isinstance(tie, Tie):
        raise ValueError(
            f"relocate moves the slave nodes of a Tie, not of a {type(tie).__name__}: bodies in "
            "contact have a gap that is meant."
        )
    with agreement.alike(tie._comm) as same:
        same["limit"] = arguments.positive("limit", limit)
        bcs = arguments.as_list(bcs)
        same["number of bcs"] = len(bcs)
        if tie._problem is not None:
            raise ValueError(
                "The tie is part of a ContactProblem already: relocate it before the problem is "
                "made."
            )
    spaces: list[fem.FunctionSpace] = []
    for part in [*tie.slave, *tie.master]:
        if part.V not in spaces:
            spaces.append(part.V)
    layout = Layout(spaces)
    multipliers = Multipliers(layout, [tie], bcs)
    pair = multipliers.integrate_ties()
    assert pair is not None
    B, B_tilde = pair

    # Motion of the nodes that carry multipliers such that B (X + dX) = 0
    r = sparse.product(B, layout.positions())
    carries = np.repeat(tie._data.carries[: tie.num_owned].astype(bool), 3)
    own = multipliers.own_dofs(tie)
    rows = np.flatnonzero(carries).astype(PETSc.IntType)
    first_z, first_u = B.getOwnershipRange()[0], layout.first_u
    comm = layout.comm
    row_set = PETSc.IS().createGeneral(rows + first_z, comm=comm)
    column_set = PETSc.IS().createGeneral((own[rows] + first_u).astype(PETSc.IntType), comm=comm)
    # In the transformed basis: corner functions of tri6 and quad8 have no positive integral, and
    # edges follow their corners
    D = B_tilde.createSubMatrix(row_set, column_set)
    ksp = PETSc.KSP().create(comm)
    ksp.setOperators(D)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    b, dx = D.createVecLeft(), D.createVecRight()
    b.array[:] = -r[rows]
    ksp.solve(b, dx)
    motion = np.zeros(layout.size_u)
    motion[own[rows]] = dx.array
    if multipliers.T is not None:
        motion = sparse.product(multipliers.T, motion)

    sparse.destroy(B, B_tilde, D, ksp, row_set, column_set, b, dx)
    multipliers.destroy()

    size = np.sqrt(np.maximum(tie._weights[: tie.num_owned], 0.0))
    length = np.linalg.norm(motion[own].reshape(-1, 3), axis=1)
    worst = np.argmax(length - limit * size) if len(length) else 0
    bad = None
    if len(length) and length[worst] > limit * size[worst]:
        bad = (length[worst], size[worst], tie._surface_slave.X[worst].tolist())
    for item in comm.allgather(bad):
        if item is not None:
            raise RuntimeError(
                f"The slave node at {tuple(round(v, 6) for v in item[2])} would move by "
                f"{item[0]:.3g}, but facets there have the size {item[1]:.3g}: the surfaces are "
                "too far apart to be relocated."
            )
    largest = comm.allreduce(float(length.max(initial=0.0)), op=MPI.MAX)
    slave, master = tie._positions(None)
    tie._integration_positions = np.array(slave), np.array(master)

    for b_index, V in enumerate(layout.spaces):
        f = fem.Function(V)
        n = layout.num_owned[b_index]
        start = layout.starts[b_index]
        f.x.array[: 3 * n] = motion[start : start + 3 * n]
        f.x.scatter_forward()
        values = f.x.array.reshape(-1, 3)
        moved = np.flatnonzero(np.any(values != 0, axis=1))
        if len(moved) == 0:
            continue
        points = V.tabulate_dof_coordinates()[moved]
        geometry = V.mesh.geometry
        distance, node = cKDTree(geometry.x).query(points)
        scale = np.max(np.abs(geometry.x), initial=1e-300)
        same = distance < 1e-10 * scale
        geometry.x[node[same]] += values[moved[same]]
    return largest
