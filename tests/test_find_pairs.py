# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Pairs of facing surfaces that are found by themselves."""

from mpi4py import MPI

import blocks
import cases
import dolfinx_mortar as dm
import numpy as np
import pytest
import ufl
from dolfinx import default_scalar_type, fem, mesh
from dolfinx_mortar.mesh import find_pairs
from test_bad_input import fails

comm = MPI.COMM_WORLD


def bodies(element="hex8"):
    """A plate (1), two blocks on it (2, 3) 0.02 above, and one far away (4), in one mesh."""
    parts = [
        blocks.block("plate", element, (0, 0, 0), (3, 1, 0.5), (3, 1, 1)),
        blocks.block("left", element, (0.1, 0.1, 0.52), (0.9, 0.9, 1), (4, 4, 1)),
        blocks.block("right", element, (1.6, 0.1, 0.52), (2.9, 0.9, 1), (4, 4, 1)),
        blocks.block("far", element, (0, 0, 4), (1, 1, 5), (1, 1, 1)),
    ]
    (body,), _ = cases._bodies(comm, parts, True)
    domain = body.mesh
    cells = np.arange(domain.topology.index_map(3).size_local, dtype=np.int32)
    middle = mesh.compute_midpoints(domain, 3, cells)
    values = np.select(
        [middle[:, 2] < 0.5, middle[:, 2] > 3, middle[:, 0] < 1.2], [1, 4, 2], 3
    ).astype(np.int32)
    return body.V, mesh.meshtags(domain, 3, cells, values)


@pytest.mark.parametrize("element", ["hex8", "tet10"])
def test_pairs(element):
    V, cell_tags = bodies(element)
    pairs = find_pairs(V.mesh, cell_tags, 0.1)
    # The blocks are finer: they are the slaves
    assert [p.bodies for p in pairs] == [(2, 1), (3, 1)]
    per_cell = 2 if element == "tet10" else 1
    for p in pairs:
        assert p.num_facets[0] == 16 * per_cell
        assert p.num_facets[1] <= 2 * per_cell
        assert p.sizes[0] < p.sizes[1]
        facets = p.facet_tags.find(p.slave)
        assert comm.allreduce(len(facets)) == p.num_facets[0]
        z = mesh.compute_midpoints(V.mesh, 2, facets)[:, 2]
        assert np.all(np.abs(z - 0.52) < 1e-12)
        z = mesh.compute_midpoints(V.mesh, 2, p.facet_tags.find(p.master))[:, 2]
        assert np.all(np.abs(z - 0.5) < 1e-12)
    assert find_pairs(V.mesh, cell_tags, 0.01) == []


def test_contacts_of_pairs():
    """From cell tags to a solution, without a facet tag of one's own."""
    V, cell_tags = bodies()
    contacts = [
        dm.Contact(V, p.facet_tags, slave=p.slave, master=p.master)
        for p in find_pairs(V.mesh, cell_tags, 0.1)
    ]
    domain = V.mesh
    u, v = fem.Function(V), ufl.TestFunction(V)
    eps = ufl.sym(ufl.grad(u))
    F = ufl.inner(2 * eps + ufl.tr(eps) * ufl.Identity(3), ufl.grad(v)) * ufl.dx
    down = fem.Constant(domain, default_scalar_type((0, 0, -0.03)))
    still = fem.Constant(domain, default_scalar_type((0, 0, 0)))
    bcs = [
        fem.dirichletbc(value, fem.locate_dofs_geometrical(V, where), V)
        for value, where in (
            (down, lambda x: np.isclose(x[2], 1.0)),
            (still, lambda x: np.isclose(x[2], 0.0) | (x[2] > 3)),
        )
    ]
    dm.ContactProblem(F, u, bcs=bcs, interfaces=contacts).solve()
    assert all(c.force[2] > 1e-4 for c in contacts)
    # The right block has 1.625 times the area of the left one
    assert 1.3 < contacts[1].force[2] / contacts[0].force[2] < 1.9


def test_pairs_that_cannot_be():
    V, cell_tags = bodies()
    fails(lambda: find_pairs(V.mesh, cell_tags, -1.0), "distance")
    other, _ = bodies()
    fails(lambda: find_pairs(other.mesh, cell_tags), "cell_tags")
