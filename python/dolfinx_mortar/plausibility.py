# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""States that solve the equations, but can not be meant.

The search for master facets ends at a certain distance, a prescribed displacement leaves contact
nothing to decide, and not every material resists being turned inside out. Newton's iteration sees
none of this.
"""

from __future__ import annotations

from typing import NamedTuple

from mpi4py import MPI

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem

from . import compat, cpp
from .contact import Contact
from .layout import Layout

#: Largest penetration [size of a node's area] of nodes that can not move
_TOLERANCE = 0.1


def find_overlap(contact: Contact, layout: Layout, u_all: npt.NDArray[np.float64]) -> str:
    """Find slave facets deep inside a master body, where the search finds no facet. Collective.

    From an uncovered slave facet a ray goes into its own body. If that leaves another body first,
    through a master facet and further away than the search reaches, then the slave facet is in
    there.

    Args:
        contact: Contact, integrated in the configuration of ``u_all``.
        layout: Displacement dofs.
        u_all: Local displacements of all bodies.

    Returns:
        A sentence, the same on all ranks; empty where there is no such facet.
    """
    if contact._search_distance is not None:
        return ""  # what lies further apart is not to meet, says the user
    comm = layout.comm
    body, boxes = _bodies(layout, u_all)
    x_slave, x_master = (
        cpp.current_positions(s, u_all) for s in (contact._surface_slave, contact._surface_master)
    )
    slave = _outlines(contact._surface_slave, x_slave)
    of_slave = _bodies_of_facets(contact._surface_slave, body)
    of_master = _bodies_of_facets(contact._surface_master, body)
    masters = np.unique(np.concatenate(comm.allgather(np.unique(of_master))))
    middle, normal, size = slave.middle, slave.normal, slave.size
    inside = np.zeros(len(middle), dtype=bool)
    for m in masters:
        low, high = boxes[m]
        inside |= (of_slave != m) & np.all((middle > low) & (middle < high), axis=1)
    inside &= contact._nodal["facet_area"] == 0.0
    if comm.allreduce(int(inside.sum())) == 0:
        return ""
    triangles = _outlines(contact._surface_master, x_master).triangles(of_master)
    triangles = [np.concatenate(t) for t in zip(*comm.allgather(triangles))]
    depths = [
        (_depth(middle[f], normal[f], size[f], of_slave[f], boxes, *triangles), tuple(middle[f]))
        for f in np.flatnonzero(inside)
    ]
    depth, x = max(comm.allgather(max(depths, default=(0.0, (0.0, 0.0, 0.0)))))
    if depth == 0.0:
        return ""
    return (
        f"The slave facet at {point(x)} is {depth:.3g} deep inside a master body, further than "
        "master facets are searched for."
    )


def find_blocked(contact: Contact, layout: Layout, u: npt.NDArray[np.float64]) -> str:
    """Find slave nodes that Dirichlet conditions hold inside a master. Collective.

    Args:
        contact: Contact, evaluated at ``u``.
        layout: Displacement dofs.
        u: Owned displacements.

    Returns:
        A sentence, the same on all ranks; empty where there is no such node.
    """
    comm, n = layout.comm, contact.num_owned
    # A node that can move at a slant to its normal is not blocked
    normals = contact._configuration.normals[:n]
    free = np.where(contact._fixed[:n] == 0, normals, 0.0)
    fixed = np.linalg.norm(free, axis=1) < 0.3
    if comm.allreduce(int(fixed.sum())) == 0:
        return ""
    gap, near = contact._gap_everywhere(u)
    size = np.sqrt(contact._weights[:n])
    deep = fixed & near & (gap < -_TOLERANCE * size)
    worst = min(
        zip(gap[deep], map(tuple, contact._surface_slave.X[:n][deep])),
        default=(0.0, (0.0, 0.0, 0.0)),
    )
    depth, x = min(comm.allgather(worst))
    if depth == 0.0:
        return ""
    return (
        f"The prescribed displacements hold the slave node at X = {point(x)} {-depth:.3g} inside "
        "the master, where contact can not push it out: they contradict the contact. Change "
        "these Dirichlet conditions, or let the other surface be the slave; the state is as before "
        "the step."
    )


def find_inverted(layout: Layout, functions: list[fem.Function]) -> str:
    """Find cells that are turned inside out, in the middle of them or of a facet. Collective.

    Args:
        layout: Displacement dofs.
        functions: Displacements.

    Returns:
        A sentence, the same on all ranks; empty where there is no such cell.
    """
    number, first = 0, (np.inf, np.inf, np.inf)
    for V, u in zip(layout.spaces, functions):
        mesh = V.mesh
        cells = mesh.topology.index_map(mesh.topology.dim).size_local
        geometry, element = mesh.ufl_domain().ufl_coordinate_element(), V.ufl_element()
        X = mesh.geometry.x[compat.geometry_dofmap(mesh)[:cells]]
        values = u.x.array.reshape(-1, 3)[V.dofmap.list[:cells]]
        J = np.einsum("cni,jpn->cpij", X, _gradients(geometry))
        j = np.linalg.det(J + np.einsum("cni,jpn->cpij", values, _gradients(element)))
        bad = np.flatnonzero(np.any(j * np.linalg.det(J) <= 0, axis=1))
        number += len(bad)
        first = min([first, *map(tuple, X[bad].mean(axis=1))])
    number = layout.comm.allreduce(number)
    x = min(layout.comm.allgather(first))
    if number == 0:
        return ""
    which = "A cell is" if number == 1 else f"{number} cells are"
    return f"{which} turned inside out, at X = {point(x)}."


def point(x: npt.ArrayLike) -> str:
    """A position in words."""
    x = np.where(np.abs(x) < 1e-12 * np.max(np.abs(x)), 0.0, x)
    return f"({x[0]:.4g}, {x[1]:.4g}, {x[2]:.4g})"


def _gradients(element) -> npt.NDArray[np.float64]:
    """Derivatives of an element's scalar functions, shape (3, points, n).

    Points are the middles of the cell and of its facets.
    """
    scalar = element.sub_elements[0] if element.block_size > 1 else element
    cell = getattr(basix.CellType, scalar.cell_type.name)
    vertices, facets = basix.geometry(cell), basix.topology(cell)[2]
    points = [vertices.mean(axis=0), *(vertices[f].mean(axis=0) for f in facets)]
    return scalar.tabulate(1, np.array(points))[1:]


def _bodies(layout: Layout, u_all) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Separate body of each local block, and boxes of these, shape (n, 2, 3). Collective."""
    labels, points, count = [], [], 0
    for b, V in enumerate(layout.spaces):
        own = count + layout.separate_bodies(b)
        local = np.zeros((layout.num_local[b], 1))
        local[: len(own), 0] = own
        labels.append(layout.forward(b, local)[:, 0].astype(np.int64))
        points.append(V.tabulate_dof_coordinates()[: layout.num_local[b]])
        count = layout.comm.allreduce(int(own.max(initial=count - 1)), op=MPI.MAX) + 1
    label, x = np.concatenate(labels), np.concatenate(points) + u_all.reshape(-1, 3)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, label, x)
    np.maximum.at(high, label, x)
    layout.comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    layout.comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    return label, np.stack([low, high], axis=1)


def _bodies_of_facets(surface: cpp.Surface, body) -> npt.NDArray[np.int64]:
    return body[surface.local_blocks[surface.nodes[surface.offsets[:-1]]]]


class _Outlines(NamedTuple):
    """Facets of this rank as flat polygons.

    Attributes:
        corners: Shape (n, 4, 3); a triangle's last corner is there twice.
        triangle: Flags of triangles.
        middle: Means of the corners, shape (n, 3).
        normal: Outward normals, shape (n, 3).
        size: Largest extents in a coordinate direction.
    """

    corners: npt.NDArray[np.float64]
    triangle: npt.NDArray[np.bool_]
    middle: npt.NDArray[np.float64]
    normal: npt.NDArray[np.float64]
    size: npt.NDArray[np.float64]

    def triangles(self, body: npt.NDArray[np.int64]) -> tuple:
        """Corners, normals, sizes and bodies of the triangles that facets are split in."""
        quadrilaterals = np.flatnonzero(~self.triangle)
        points = [self.corners[:, :3], self.corners[quadrilaterals][:, [1, 3, 2]]]
        facet = np.concatenate([np.arange(len(self.corners)), quadrilaterals])
        return np.concatenate(points), self.normal[facet], self.size[facet], body[facet]


def _outlines(surface: cpp.Surface, x: npt.NDArray[np.float64]) -> _Outlines:
    begin = surface.offsets[:-1]
    triangle = np.isin(np.diff(surface.offsets), (3, 6))
    c = x[surface.nodes[begin[:, None] + np.where(triangle[:, None], [0, 1, 2, 2], [0, 1, 2, 3])]]
    flags = triangle[:, None]
    n = np.cross(
        np.where(flags, c[:, 1] - c[:, 0], c[:, 1] - c[:, 2]),
        np.where(flags, c[:, 2] - c[:, 0], c[:, 3] - c[:, 0]),
    )
    n *= surface.orientation[:, None] / np.linalg.norm(n, axis=1)[:, None]
    middle = np.where(flags, c[:, :3].mean(axis=1), c.mean(axis=1))
    return _Outlines(c, triangle, middle, n, np.ptp(c, axis=1).max(axis=1))


def _depth(x, n, size, own, boxes, points, normals, sizes, bodies) -> float:
    """How deep the facet at x with normal n is inside of another body, else zero.

    The facet is given by its middle, normal, size and body, and the triangles of all masters
    by theirs, with their corners for the middle.
    """
    # Barycentric coordinates of the points where the ray x - t n meets the planes of triangles
    a, b = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    h = np.cross(-n, b)
    det = np.einsum("ti,ti->t", a, h)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = x - points[:, 0]
        v = np.einsum("ti,ti->t", s, h) / det
        q = np.cross(s, a)
        w = q @ -n / det
        t = np.einsum("ti,ti->t", b, q) / det
        meets = (v >= 0) & (w >= 0) & (v + w <= 1) & (t > 0)
    if not meets.any():
        return 0.0
    first = np.flatnonzero(meets)[np.argmin(t[meets])]
    low, high = boxes[bodies[first]]
    leaves = normals[first] @ n < 0 and bodies[first] != own
    deep = t[first] > max(size, sizes[first])
    return float(t[first]) if leaves and deep and np.all((x > low) & (x < high)) else 0.0
