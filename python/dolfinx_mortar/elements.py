# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""The nodal 20-node hexahedron, which Basix does not have ready-made."""

from __future__ import annotations

from functools import cache

import basix
import basix.ufl
import numpy as np


@cache
def _hex20_scalar() -> basix.ufl._ElementBase:
    cell = basix.CellType.hexahedron
    moments = basix.create_element(
        basix.ElementFamily.serendipity,
        cell,
        2,
        basix.LagrangeVariant.legendre,
        basix.DPCVariant.legendre,
    )
    geometry = basix.geometry(cell)
    vertices, edges, faces, _ = basix.topology(cell)

    # Basix wants, per entity, the points and the matrix that turns values at them into dofs.
    points = [
        [geometry[vertex] for vertex in vertices],
        [geometry[edge].mean(axis=0, keepdims=True) for edge in edges],
        [np.empty((0, 3)) for _ in faces],
        [np.empty((0, 3))],
    ]
    matrices = [
        [np.ones((1, 1, 1, 1)) if len(x) else np.empty((0, 1, 0, 1)) for x in entities]
        for entities in points
    ]
    return basix.ufl.custom_element(
        cell,
        (),
        moments.wcoeffs,
        points,
        matrices,
        0,
        basix.MapType.identity,
        basix.SobolevSpace.H1,
        False,
        moments.embedded_subdegree,
        moments.embedded_superdegree,
    )


def hex20(shape: tuple[int, ...] | None = None) -> basix.ufl._ElementBase:
    """Serendipity element of degree 2 on hexahedra with nodal values as dofs.

    The space is that of Basix's ``"S"`` element of degree 2: all quadratics and the serendipity
    cubics and quartics. Basix's own edge dofs are moments against polynomials, which are not
    values at points and cannot be nodes of a contact surface. Here the dofs are the values at
    the 8 vertices and the 12 edge midpoints, in Basix's order of vertices and edges.

    Args:
        shape: Value shape. ``None`` or ``()`` gives a scalar element, ``(3,)`` a displacement
            or coordinate element with blocked dofs.

    Returns:
        An element for ``fem.functionspace``, ``ufl.Mesh`` and
        :func:`dolfinx_mortar.compat.create_mesh`.
    """
    scalar = _hex20_scalar()
    if shape is None or shape == ():
        return scalar
    return basix.ufl.blocked_element(scalar, shape=tuple(shape))
