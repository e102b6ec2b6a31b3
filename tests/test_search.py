# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Pairs of slave and master facets that may meet."""

import itertools

from mpi4py import MPI

import numpy as np
import oracle
import pytest
from distributed import KIND, distribute, fails_on_all
from dolfinx_mortar import cpp

comm = MPI.COMM_WORLD
# Each kind at least once on each side, with both shapes
pairings = pytest.mark.parametrize(
    "kinds",
    [
        ("tri3", "quad9"),
        ("tri6", "quad8"),
        ("quad4", "tri3"),
        ("quad8", "quad4"),
        ("quad9", "tri6"),
    ],
)

MASTER_BLOCK = 10**6


def hill(x, y):
    return 0.3 * np.sin(2 * x) * np.cos(3 * y)


def sources(kinds, seed, gap=0.02):
    """Two hills, the master's outward side down, and partly beside the slave."""
    rng = np.random.default_rng(seed)
    shared = {"distort": 0.2, "bend": 0.1, "shuffle": True, "rng": rng}
    slave = oracle.patch(kinds[0], (6, 5), height=hill, **shared)
    master = oracle.patch(
        kinds[1],
        (4, 5),
        lower=(0.2, -0.3),
        upper=(1.3, 0.8),
        height=lambda x, y: hill(x, y) + gap,
        outward=-1,
        **shared,
    )
    return slave, master


def deal(slave, master, communicator=comm, slave_rank=None, master_rank=None, node_rank=None):
    """Facets and nodes of both surfaces on the ranks, at random where nothing is said."""
    rng = np.random.default_rng(17)
    return (
        distribute(communicator, slave, facet_rank=slave_rank, node_rank=node_rank, rng=rng),
        distribute(
            communicator,
            master,
            facet_rank=master_rank,
            node_rank=node_rank,
            first_block=MASTER_BLOCK,
            rng=rng,
        ),
    )


def find(slave, master, distance=None):
    return cpp.find_candidates(slave.surface, slave.x, master.surface, master.x, distance)


def pairs(slave, master, candidates, communicator=comm):
    """Pairs (slave facet, master facet) of the sources, from all ranks."""
    facet = {
        tuple(master.block[nodes].tolist()): m for m, (_, nodes) in enumerate(master.source.facets)
    }
    lists = candidates.master
    found = [
        facet[tuple(lists.blocks[lists.offsets[m] : lists.offsets[m + 1]].tolist())]
        for m in range(len(lists.types))
    ]
    local = [
        (int(slave.facets[f]), found[m])
        for f in range(slave.surface.num_facets)
        for m in candidates.facets[candidates.offsets[f] : candidates.offsets[f + 1]]
    ]
    everything = sum(communicator.allgather(local), [])
    assert len(set(everything)) == len(everything)
    return set(everything)


def bounding_box(kind, x):
    """Box of the coefficients of a facet in a basis of Bernstein polynomials."""
    xi = oracle.REFERENCE_NODES[kind]
    if kind in ("tri3", "quad4"):
        control = x
    elif kind == "tri6":
        q, r, s = 1 - xi.sum(axis=1), *xi.T
        basis = [q**2, r**2, s**2, 2 * r * s, 2 * q * s, 2 * q * r]
        control = np.linalg.solve(np.transpose(basis), x)
    else:
        xi = oracle.REFERENCE_NODES["quad9"]
        line = [[(1 - t) ** 2, 2 * t * (1 - t), t**2] for t in xi.T]
        basis = [a * b for a, b in itertools.product(*line)]
        control = np.linalg.solve(np.transpose(basis), oracle.shape_functions(kind, xi)[0] @ x)
    return control.min(axis=0), control.max(axis=0)


def brute_force(slave, master, distance=None):
    """All pairs by definition."""

    def outline(surface, f):
        kind, _, x, sign = surface.facet(f)
        diameter = np.linalg.norm(x[:, None] - x, axis=2).max()
        normals = [oracle.sub_facet_normal(x[list(s)], sign) for s in oracle.SUB_FACETS[kind]]
        return *bounding_box(kind, x), diameter, np.array(normals)

    s = [outline(slave, f) for f in range(len(slave.facets))]
    m = [outline(master, f) for f in range(len(master.facets))]
    return {
        (i, j)
        for (i, (sl, su, sd, sn)), (j, (ml, mu, md, mn)) in itertools.product(
            enumerate(s), enumerate(m)
        )
        if np.maximum(sl - mu, ml - su).max() <= (distance or max(sd, md)) and (sn @ mn.T).min() < 0
    }


@pairings
@pytest.mark.parametrize("distance", [None, 0.05, 0.4])
def test_brute_force(kinds, distance):
    """The same pairs as by trying all, wherever facets and nodes are."""
    slave, master = sources(kinds, 1)
    expected = brute_force(slave, master, distance)
    assert 0 < len(expected) < len(slave.facets) * len(master.facets)
    s, m = deal(slave, master)
    assert pairs(s, m, find(s, m, distance)) == expected


@pairings
def test_disjoint_ranks(kinds):
    """Slave and master never share a rank, and nodes belong to a third."""
    slave, master = sources(kinds, 2)
    s, m = deal(slave, master, slave_rank=0, master_rank=comm.size - 1, node_rank=comm.size // 2)
    candidates = find(s, m)
    assert pairs(s, m, candidates) == brute_force(slave, master)
    if comm.rank > 0:
        assert len(candidates.facets) == len(candidates.master.types) == 0
        assert len(candidates.offsets) == 1


@pairings
def test_nothing_is_missed(kinds):
    """All pairs with common quadrature points are found."""
    slave, master = sources(kinds, 3)
    s, m = deal(slave, master)
    found = pairs(s, m, find(s, m, 0.1))
    # The slow reference has a share of the slave facets on each rank
    mine = range(comm.rank, len(slave.facets), comm.size)
    share = oracle.Surface(slave.x, [slave.facets[f] for f in mine], slave.sign[list(mine)])
    points = oracle.segment_points(share, master, points=2)
    met = {(f, int(g)) for f, p in zip(mine, points, strict=True) for g in p.master}
    met = set().union(*comm.allgather(met))
    assert len(met) > 10 and met <= found


#: Heights of the nodes of facets that bulge beyond these
BULGES = {
    "tri6": [0, 0, 0, 0.3, 0.3, 0.3],
    "quad8": [0, 0, 0, 0, 0.1, 0.1, 0.1, 0.1],
    "quad9": 0.3 * (oracle.REFERENCE_NODES["quad9"][:, 0] > 0),
}


@pytest.mark.parametrize("kind", BULGES)
@pytest.mark.parametrize("side", ["slave", "master"])
def test_bulging_facets_are_found(kind, side):
    """A facet that is near only where it bulges, and whose nodes are further than the distance."""
    x = np.column_stack([oracle.REFERENCE_NODES[kind], BULGES[kind]])
    top = oracle.evaluate(kind, x, oracle.facet_rule(kind, 30)[0])[0][:, 2].max()
    assert top > x[:, 2].max() + 0.03
    bulging = oracle.Surface(x, [(kind, np.arange(len(x)))], np.ones(1))
    flat = oracle.patch("quad4", (1, 1), lower=(-1, -1), upper=(2, 2), outward=-1)
    flat.x[:, 2] = top + 0.01
    if side == "master":
        bulging.sign, flat.sign = -bulging.sign, -flat.sign
        bulging.x[:, 2] *= -1
        flat.x[:, 2] *= -1
        s, m = deal(flat, bulging)
    else:
        s, m = deal(bulging, flat)
    assert pairs(s, m, find(s, m, 0.02)) == {(0, 0)}
    if side == "slave":
        flat.x[:, 2] += 10
        s, m = deal(bulging, flat)
        assert not pairs(s, m, find(s, m, 0.02))


@pairings
def test_contents(kinds):
    """What the list of masters holds, and its order."""
    slave, master = sources(kinds, 5)
    s, m = deal(slave, master)
    c = find(s, m)
    lists = c.master
    assert c.offsets[0] == 0 and c.offsets[-1] == len(c.facets)
    for f in range(s.surface.num_facets):
        assert (np.diff(c.facets[c.offsets[f] : c.offsets[f + 1]]) > 0).all()
    # Each master in some pair
    assert np.array_equal(np.unique(c.facets), np.arange(len(lists.types)))

    rows = [
        lists.blocks[lists.offsets[i] : lists.offsets[i + 1]].tolist()
        for i in range(len(lists.types))
    ]
    assert rows == sorted(rows)
    for i, row in enumerate(rows):
        nodes = [int(np.flatnonzero(m.block == b)[0]) for b in row]
        f = next(f for f, (_, k) in enumerate(master.facets) if k.tolist() == nodes)
        assert KIND[int(lists.types[i])] == master.facets[f][0]
        assert lists.orientation[i] == master.sign[f]
        assert np.array_equal(lists.x[lists.offsets[i] : lists.offsets[i + 1]], master.x[nodes])


@pairings
def test_same_as_alone(kinds):
    """A rank that has everything to itself finds the same."""
    slave, master = sources(kinds, 6)
    s, m = deal(slave, master)
    alone = deal(slave, master, MPI.COMM_SELF)
    assert pairs(s, m, find(s, m)) == pairs(*alone, find(*alone), MPI.COMM_SELF)


def test_facing_away():
    """Surfaces that turn their backs on each other have no pairs, however near."""
    slave = oracle.patch("quad9", (3, 3))
    master = oracle.patch("tri6", (2, 2), height=0.01)
    s, m = deal(slave, master)
    assert not pairs(s, m, find(s, m))
    master.sign *= -1
    s, m = deal(slave, master)
    assert len(pairs(s, m, find(s, m))) == len(brute_force(slave, master)) > 0


def test_far_away():
    slave, master = sources(("quad8", "tri3"), 7, gap=5.0)
    s, m = deal(slave, master)
    assert not pairs(s, m, find(s, m))
    assert len(find(s, m).master.types) == 0
    assert len(pairs(s, m, find(s, m, 20.0))) == len(slave.facets) * len(master.facets)


def test_bad_input():
    """Errors on all ranks alike, also where one rank alone has the cause."""
    slave, master = sources(("quad4", "tri3"), 8)
    s, m = deal(slave, master, node_rank=comm.size - 1)
    x = s.x
    if comm.rank == comm.size - 1:
        x[0, 1] = np.inf
    args = (s.surface, x, m.surface, m.x)
    assert "not finite" in fails_on_all(comm, cpp.find_candidates, *args)
    for distance in (0.0, -1.0, np.nan, np.inf):
        assert "positive" in fails_on_all(comm, find, s, m, distance)
    assert pairs(s, m, find(s, m))
