# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""States that solve the equations, but can not be meant.

The search for master facets ends at a certain distance, a prescribed displacement leaves contact
nothing to decide, and not every material resists being turned inside out. Newton's iteration sees
none of this.
"""

from __future__ import annotations

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
    body, boxes = _bodies(layout, u_all)
    slave, master = contact._surface_slave, contact._surface_master
    depth, x = cpp.find_overlap(
        slave,
        cpp.current_positions(slave, u_all),
        (contact._nodal["facet_area"] == 0.0).astype(np.int8),
        _bodies_of_facets(slave, body),
        master,
        cpp.current_positions(master, u_all),
        _bodies_of_facets(master, body),
        boxes,
    )
    if depth == 0.0:
        return ""
    return (
        f"The slave facet at {point(x)} is {depth:.3g} deep inside a master body, further than "
        "master facets are searched for."
    )


def find_crossing(
    contact: Contact, before: npt.NDArray[np.float64], u_all: npt.NDArray[np.float64]
) -> str:
    """Find where the surfaces have passed through each other on the way to a state. Collective.

    Args:
        contact: Contact.
        before: Local displacements of all bodies in the last accepted state.
        u_all: The same in this state.

    Returns:
        A sentence, the same on all ranks; empty where they have not.
    """
    slave, master = contact._surface_slave, contact._surface_master
    depth, x = cpp.find_crossing(
        slave,
        *(cpp.current_positions(slave, u) for u in (before, u_all)),
        master,
        *(cpp.current_positions(master, u) for u in (before, u_all)),
        contact._search_distance,
    )
    if depth == 0.0:
        return ""
    return (
        f"At {point(x)} one contact surface is {depth:.3g} behind the other one, further than "
        "facets are searched for."
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
