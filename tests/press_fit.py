# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""A shaft in a ring that is too narrow for it: the whole, and a quarter of it."""

from __future__ import annotations

from mpi4py import MPI

import cases
import dolfinx_mortar as dm
import numpy as np
import ufl
from blocks import NU, E
from dolfinx import fem
from mirrored import COORDINATES, fix, mirror, symmetry

INNER, OUTER = 1, 2


def press_fit(
    quarter: bool,
    oversize: float,
    *,
    comm: MPI.Comm = MPI.COMM_WORLD,
    petsc_options: dict | None = None,
    **options,
) -> tuple[dm.ContactProblem, dm.Contact]:
    """A hollow shaft (the slave) of outer radius 1 + oversize in a ring of inner radius 1.

    The shaft's core and the ring's housing are rigid: contact without friction would not keep a
    shaft from turning in its ring.

    Args:
        quarter: Whether planes of symmetry cut out the quarter where x and y are positive.
        oversize: Oversize of the shaft's radius.
        comm: Communicator.
        petsc_options: Of the problem.
        **options: Of the contact.
    """
    planes = (0, 1) if quarter else ()
    energy = cases.linear_elastic(E, NU)
    spaces, tags, u, F, bcs = [], [], [], [], []
    shapes = (("hex20", 0.5, 1 + oversize, 4), ("hex27", 1.0, 1.7, 3))
    for (element, inner, outer, n), held in zip(shapes, (0.5, 1.7), strict=True):
        body = cases._body(comm, [_segment(element, inner, outer, n, energy, planes)], [0])
        _bend(body.mesh, n)
        w = fem.Function(body.V, name="u")
        dx = ufl.dx(metadata={"quadrature_degree": 4})
        F.append(ufl.derivative(energy(w) * dx, w, ufl.TestFunction(body.V)))
        bcs += symmetry(body.V, planes)
        rim = cases.near(held)
        bcs += [fix(body.V, c, lambda x, rim=rim: rim(np.hypot(x[0], x[1]))) for c in range(3)]
        spaces.append(body.V)
        tags.append(body.facet_tags)
        u.append(w)
    contact = dm.Contact(spaces, tags, slave=OUTER, master=INNER, **options)
    problem = dm.ContactProblem(
        F,
        u,
        bcs=bcs,
        interfaces=[contact],
        petsc_options_prefix="press_fit_",
        petsc_options=petsc_options,
    )
    return problem, contact


def _segment(element, inner, outer, n, energy, planes) -> cases.Part:
    """A quarter with n cells along its arc, or all of it, straight-sided."""
    angles, radii = np.linspace(0, np.pi / 2, n + 1), np.linspace(inner, outer, 2)
    plan, quads = cases.grid(radii, angles)
    plan = plan[:, :1] * np.column_stack([np.cos(plan[:, 1]), np.sin(plan[:, 1])])
    points, cells = cases.extrude(plan, quads, lambda x, y: 0.0, lambda x, y: 0.6, 2)
    for axis in COORDINATES - set(planes):
        points, cells = mirror(points, cells, axis)
    bend = np.cos(np.pi / (4 * n))  # of a radius, in the middle of a straight edge

    def tag(x):
        radius = np.hypot(x[:, 0], x[:, 1])
        side = [cases.near(r * bend)(radius) for r in (inner, outer)]
        return np.select(side, [INNER, OUTER], 0)

    part = cases.Part("segment", element, energy, points, cells, tag)
    part.isoparametric = True
    return part


def _bend(mesh, n: int) -> None:
    """Move the nodes of straight edges onto circles."""
    x = mesh.geometry.x
    sector = np.pi / (2 * n)
    angle = np.arctan2(x[:, 1], x[:, 0]) % sector - sector / 2
    x[:, :2] *= (np.cos(angle) / np.cos(sector / 2))[:, None]
