# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Slave facets spread over the ranks whatever the partition: same surface, same results."""

from mpi4py import MPI

import cases
import dolfinx_mortar as dm
import numpy as np
import oracle
import pytest
import ufl
from blocks import FACES, block
from distributed import distribute
from dolfinx import fem
from dolfinx_mortar import cpp
from pressed import pressed
from test_bad_input import fails

comm = MPI.COMM_WORLD


def facets_of(s):
    """Facets as tuples: type, orientation, blocks of the nodes in their order."""
    ends = zip(s.offsets[:-1], s.offsets[1:], strict=True)
    return [
        (int(t), int(o), *s.blocks[s.nodes[i:j]].tolist())
        for t, o, (i, j) in zip(s.types, s.orientation, ends, strict=True)
    ]


# Facets and nodes at random, all facets on the first rank, all nodes on the last
@pytest.mark.parametrize("kind", ["tri3", "quad9"])
@pytest.mark.parametrize(
    "options",
    [{}, {"facet_rank": 0}, {"node_rank": comm.size - 1}, {"facet_rank": 0, "node_rank": 0}],
)
def test_same_surface(kind, options):
    rng = np.random.default_rng(3)
    source = oracle.patch(kind, (12, 9), shuffle=True, rng=rng)
    d = distribute(comm, source, rng=rng, **options)
    s = cpp.spread_facets(d.surface)
    before, after = (
        [f for part in comm.allgather(facets_of(a)) for f in part] for a in (d.surface, s)
    )
    assert sorted(before) == sorted(after)

    # As many everywhere, but for a part
    counts = comm.allgather(s.num_facets)
    part = min(max(len(before) // (128 * comm.size), 1), 16)
    assert max(counts) - min(counts) <= part

    # Nodes stay where they are, and ghosts are up to date
    n = d.surface.num_owned
    assert (s.num_owned, s.first_owned, s.num_global) == (
        n,
        d.surface.first_owned,
        d.surface.num_global,
    )
    for a, b in ((s.blocks, d.surface.blocks), (s.X, d.surface.X), (s.numbers, d.surface.numbers)):
        np.testing.assert_array_equal(a[:n], b[:n])
    position = dict(zip(d.block.tolist(), source.x, strict=True))
    for number, x in zip(s.blocks.tolist(), s.X, strict=True):
        np.testing.assert_array_equal(position[number], x)
    count = np.zeros(s.num_nodes)
    np.add.at(count, s.nodes, 1.0)
    cpp.scatter_reverse_add(s, count)
    expected = np.zeros(d.surface.num_nodes)
    np.add.at(expected, d.surface.nodes, 1.0)
    cpp.scatter_reverse_add(d.surface, expected)
    np.testing.assert_array_equal(count[:n], expected[:n])


def test_same_candidates():
    """The search finds the same pairs, whose masters travel to the parts that they meet."""
    rng = np.random.default_rng(4)
    slave = oracle.patch("tri3", (9, 9), rng=rng)
    master = oracle.patch("quad4", (6, 6), height=0.05, outward=-1.0, rng=rng)
    a = distribute(comm, slave, facet_rank=0, rng=rng)
    b = distribute(comm, master, first_block=10_000, rng=rng)
    pairs = []
    for s in (a.surface, cpp.spread_facets(a.surface)):
        c = cpp.find_candidates(s, np.array(s.X), b.surface, b.x, None)
        blocks = [f[2:] for f in facets_of(s)]
        masters = [
            tuple(c.master.blocks[i:j].tolist())
            for i, j in zip(c.master.offsets[:-1], c.master.offsets[1:], strict=True)
        ]
        found = [
            (blocks[f], masters[m])
            for f in range(s.num_facets)
            for m in c.facets[c.offsets[f] : c.offsets[f + 1]]
        ]
        pairs.append(sorted(p for part in comm.allgather(found) for p in part))
    assert len(pairs[0]) > 100
    assert pairs[0] == pairs[1]


ELEMENTS = {
    "hex8": ("hex8", "hex8"),
    "tet10 on hex27": ("tet10", "hex27"),
    "hex20": ("hex20", "hex20"),
}


def norm(f):
    """Norm of the nodal values of a field on all ranks."""
    V = f.function_space
    owned = f.x.array[: V.dofmap.index_map.size_local * V.dofmap.index_map_bs]
    return np.sqrt(comm.allreduce(float(owned @ owned)))


def dragged(elements, balance, offset=False, **options):
    """Iterations and results of two steps with friction, and whether facets were spread."""
    p = pressed(
        dm.Contact,
        elements=ELEMENTS[elements],
        friction=0.3,
        balance=balance,
        petsc_options={"snes_rtol": 1e-11},
        **options,
    )
    contact = p.interface
    if offset:
        x = ufl.SpatialCoordinate(contact.slave[0].V.mesh)
        contact.offset = -0.002 * (1 + x[0])
    iterations = [p.move(0.0, -0.02), p.move(0.05, -0.03)]
    fields = [contact.pressure, contact.recovered_pressure, contact.gap, contact.slip]
    numbers = [v for v in contact.summary().values() if isinstance(v, float)]
    values = [p.norms(), contact.force, contact.moment, numbers, [norm(f) for f in fields]]
    spread = comm.allreduce(bool(len(contact.data.slave.parts)), op=MPI.LOR)
    return iterations, np.concatenate(values), spread


def low_corner(x):
    return (x[0] < 0.5) & (x[1] < 0.5)


@pytest.mark.parametrize(
    "options",
    [
        {"elements": "hex8"},
        {"elements": "tet10 on hex27", "slave_sides": ("z-", "x+")},  # an edge
        {"elements": "hex20", "offset": True},
        {"elements": "hex8", "initial_active": low_corner},
    ],
    ids=["plain", "edge", "offset", "given"],
)
def test_same_results(options):
    iterations, expected, spread = dragged(balance=False, **options)
    assert not spread
    found = dragged(balance=True, **options)
    assert found[0] == iterations
    np.testing.assert_allclose(found[1], expected, rtol=1e-9, atol=1e-10 * np.abs(expected).max())
    assert found[2] == (comm.size > 1)


def test_many_facets_are_spread():
    """By default, from 50 on."""
    for cells, spread in ((7, False), (8, True)):
        parts = [
            block("upper", "hex8", (0.1, 0.1, 1.0), (0.9, 0.9, 1.5), (cells, cells, 1)),
            block("lower", "hex8", (0.0, 0.0, 0.5), (1.0, 1.0, 1.0), (2, 2, 1)),
        ]
        bodies = cases._bodies(comm, parts, False)[0]
        sides = [
            [(b.V, b.facet_tags, FACES[face])] for b, face in zip(bodies, ("z-", "z+"), strict=True)
        ]
        contact = dm.Contact(slave=sides[0], master=sides[1])
        u = [fem.Function(b.V) for b in bodies]
        F = [
            ufl.inner(ufl.grad(w), ufl.grad(ufl.TestFunction(w.function_space))) * ufl.dx for w in u
        ]
        dm.ContactProblem(F, u, interfaces=[contact])
        found = comm.allreduce(bool(len(contact.data.slave.parts)), op=MPI.LOR)
        assert found == (spread and comm.size > 1)


def test_what_is_not_spread():
    """Few facets by default, and a geometry that is integrated once."""
    for options in ({}, {"geometry": "reference", "balance": True}):
        p = pressed(dm.Contact, **options)
        assert not comm.allreduce(bool(len(p.interface.data.slave.parts)), op=MPI.LOR)


def test_bad_input():
    fails(lambda: pressed(dm.Contact, balance="yes"), "balance is 'yes'")
