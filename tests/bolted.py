# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Two plates that a tightened bolt holds together: the whole, and a quarter of it."""

from __future__ import annotations

from mpi4py import MPI

import cases
import dolfinx_mortar as dm
import numpy as np
import ufl
from blocks import NU, E
from dolfinx import fem
from mirrored import COORDINATES, fix, mirror, symmetry

HEAD, NUT, TOP, BOTTOM = 1, 2, 3, 4
CORE, SHANK, FLANGE, HOLE, RIM = 0.25, 0.5, 0.95, 0.6, 1.7


def bolted_joint(
    quarter: bool,
    tension: float,
    *,
    comm: MPI.Comm = MPI.COMM_WORLD,
    petsc_options: dict | None = None,
    **options,
) -> tuple[dm.ContactProblem, list[dm.Contact]]:
    """Contact below the head, at the nut, and between the plates; the shank has clearance.

    A rigid rod in the bolt's core, along which it slides, and the plates' rims keep them in place
    sideways. In the direction of its axis nothing but contact holds the bolt.

    Args:
        quarter: Whether planes of symmetry cut out the quarter where x and y are positive.
        tension: Stress along the axis that the shank would have if it were held at its ends.
        comm: Communicator.
        petsc_options: Of the problem.
        **options: Of the contacts.
    """
    planes = (0, 1) if quarter else ()
    energy = cases.linear_elastic(E, NU)
    meshes = {
        "bolt": ("hex20", _bolt(), {HEAD: 1.0, NUT: -1.0}),
        "upper": ("hex8", _plate(0, 1, 4), {TOP: 1.0, BOTTOM: 0.0}),
        "lower": ("hex8", _plate(-1, 0, 3), {TOP: 0.0, BOTTOM: -1.0}),
    }
    bodies, u, F, bcs = {}, [], [], []
    for name, (element, mesh, heights) in meshes.items():
        body = cases._body(comm, [_part(name, element, mesh, heights, energy, planes)], [0])
        bodies[name] = body
        w = fem.Function(body.V, name="u")
        dx = ufl.dx(metadata={"quadrature_degree": 4})
        form = ufl.derivative(energy(w) * dx, w, ufl.TestFunction(body.V))
        bcs += symmetry(body.V, planes)
        if name == "bolt":
            x, v = ufl.SpatialCoordinate(body.mesh), ufl.TestFunction(body.V)
            shank = ufl.conditional(abs(x[2]) < 1, tension, 0.0)
            form += shank * v[2].dx(2) * dx
        on = cases.near(CORE if name == "bolt" else RIM)
        held = range(3) if name == "lower" else range(2)
        bcs += [fix(body.V, c, lambda x, on=on: on(np.hypot(x[0], x[1]))) for c in held]
        u.append(w)
        F.append(form)

    def side(name, tag):
        return [(bodies[name].V, bodies[name].facet_tags, tag)]

    pairs = (
        (("bolt", HEAD), ("upper", TOP)),
        (("bolt", NUT), ("lower", BOTTOM)),
        (("upper", BOTTOM), ("lower", TOP)),
    )
    contacts = [dm.Contact(slave=side(*s), master=side(*m), **options) for s, m in pairs]
    problem = dm.ContactProblem(
        F,
        u,
        bcs=bcs,
        interfaces=contacts,
        petsc_options_prefix="bolted_",
        petsc_options=petsc_options,
    )
    return problem, contacts


def _ring(radii, n):
    """Plan of a quarter of a ring with n cells along its arc, straight-sided."""
    plan, quads = cases.grid(radii, np.linspace(0, np.pi / 2, n + 1))
    return plan[:, :1] * np.column_stack([np.cos(plan[:, 1]), np.sin(plan[:, 1])]), quads


def _extruded(radii, n, low, high, layers):
    return cases.extrude(*_ring(radii, n), lambda x, y: low, lambda x, y: high, layers)


def _bolt():
    """A quarter of a hollow bolt, two cells of head and nut beside the shank's one."""
    flange = np.array([CORE, SHANK, (SHANK + FLANGE) / 2, FLANGE])
    pieces = [(flange, -1.3, -1.0, 1), (flange[:2], -1.0, 1.0, 2), (flange, 1.0, 1.3, 1)]
    points, cells = [], []
    for radii, low, high, layers in pieces:
        x, c = _extruded(radii, 3, low, high, layers)
        cells.append(c + sum(map(len, points)))
        points.append(x)
    keys = np.round(np.vstack(points), 9)
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return np.vstack(points)[first], number.ravel()[np.vstack(cells)]


def _plate(low, high, n):
    return _extruded(np.array([HOLE, 0.9, 1.25, RIM]), n, low, high, 1)


def _part(name, element, mesh, heights, energy, planes) -> cases.Part:
    points, cells = mesh
    for axis in COORDINATES - set(planes):
        points, cells = mirror(points, cells, axis)

    def tag(x):
        sides = [cases.near(height)(x[:, 2]) for height in heights.values()]
        return np.select(sides, list(heights), 0)

    return cases.Part(name, element, energy, points, cells, tag)
