# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""A half or a quarter that planes of symmetry cut off is that part of the whole."""

from mpi4py import MPI

import cases
import dolfinx_mortar as dm
import nodal
import numpy as np
import oracle
import pytest
from mirrored import model, punch

comm = MPI.COMM_WORLD
PLANES = {"half": (1,), "quarter": (0, 1)}
DEPTH = 0.08


def solve(planes, layers, **options):
    # Newton's iteration as far as rounding lets it go
    solver = {"snes_rtol": 1e-13}
    m = model(layers, [(dm.Contact, options)], planes, petsc_options=solver)
    m.press(DEPTH)
    return m


def gathered(*columns):
    """Rows of all ranks, side by side."""
    return np.vstack(comm.allgather(np.column_stack(columns)))


def slave_nodes(m):
    """Positions, normals, tractions, weights and gaps of the slave nodes."""
    c = m.contact
    weighted = [nodal.weights(c), c.evaluation.gap]
    return gathered(nodal.positions(c), nodal.normals(c), nodal.multipliers(c), *weighted)


def displacements(m, body):
    u = m.problem.u[body]
    n = u.function_space.dofmap.index_map.size_local
    x = u.function_space.tabulate_dof_coordinates()
    return gathered(x[:n], u.x.array.reshape(-1, 3)[:n])


def restricted(whole, part):
    """The rows of the whole at the positions of the part's, their first three columns."""
    distance = np.linalg.norm(whole[None, :, :3] - part[:, None, :3], axis=2)
    assert np.all(distance.min(axis=1) < 1e-9)
    return whole[distance.argmin(axis=1)]


def multiplicity(x, planes):
    """How many mirrored parts a node belongs to."""
    return 2.0 ** sum(cases.near(0)(x[:, axis]) for axis in planes)


def check(part, whole, planes, tolerance):
    """Compare a part with the whole, and return its force found from the whole."""
    for body in range(2):
        a = displacements(part, body)
        b = restricted(displacements(whole, body), a)
        assert np.abs(a - b).max() < tolerance * DEPTH
    a = slave_nodes(part)
    b = restricted(slave_nodes(whole), a)
    share = multiplicity(a[:, :3], planes)[:, None]
    normals, z, weighted = (slice(3, 6), slice(6, 9), slice(9, 11))
    on = share[:, 0] > 1
    assert np.count_nonzero(on) > 4
    assert np.abs(a[:, normals] - b[:, normals]).max() < tolerance
    assert np.abs(a[:, z] - b[:, z]).max() < tolerance * np.abs(b[:, z]).max()
    scale = np.abs(b[:, weighted]).max(axis=0)
    assert np.all(np.abs(share * a[:, weighted] - b[:, weighted]) < tolerance * scale)
    # The sum of Φ_j over the part, times z_j
    force = -np.sum(b[:, z] * b[:, 9:10] / share, axis=0)
    assert np.allclose(part.contact.force, force, rtol=0, atol=tolerance * abs(force[2]))
    copies = 2 ** len(planes)
    assert np.isclose(copies * part.contact.force[2], whole.contact.force[2], rtol=tolerance)


@pytest.mark.parametrize("friction", [None, 0.3], ids=["frictionless", "friction"])
@pytest.mark.parametrize("elements", [("hex20", "hex8"), ("tet10", "hex20")], ids="-".join)
def test_parts_of_the_whole(friction, elements):
    options = {"friction": friction, "integration": "element"}
    whole = solve((), punch(elements), **options)
    for planes in PLANES.values():
        part = solve(planes, punch(elements), **options)
        check(part, whole, planes, 1e-9)
        # Forces of the mirrored parts cancel along the planes, that of each part does not vanish
        assert all(abs(part.contact.force[axis]) > 1e-4 * part.contact.force[2] for axis in planes)
    assert np.abs(whole.contact.force[:2]).max() < 1e-9 * whole.contact.force[2]


@pytest.mark.parametrize("multiplier", oracle.MULTIPLIERS)
def test_segments(multiplier):
    """Segments are projected along normals of facets, which here lie in the plane of symmetry."""
    layers = punch(("hex20", "hex8"))
    layers[0].surfaces = (lambda x, y: 1 + 0.2 * y**2, layers[0].surfaces[1])
    layers[1].surfaces = (layers[1].surfaces[0], lambda x, y: 1 - 0.1 * y**2)
    options = {"multiplier": multiplier, "geometry": "reference", "friction": 0.3}
    part, whole = (solve(planes, layers, **options) for planes in ((0,), ()))
    check(part, whole, (0,), 1e-9)


@pytest.mark.parametrize("multiplier", oracle.MULTIPLIERS)
def test_segments_that_end_beyond_the_plane(multiplier):
    """Where surfaces are apart and inclined, a part has no master for a thin strip at the plane.

    It is as wide as the gap times the slope; the whole has the master's image there. The strips
    are at open nodes, and change the tractions beside them by some 1e-4 of the largest.
    """
    layers = punch(("hex20", "hex8"))
    part, whole = (solve(p, layers, multiplier=multiplier) for p in (PLANES["quarter"], ()))
    check(part, whole, PLANES["quarter"], 5e-4)
