# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Splitting of a surface's nodes at its edges."""

from mpi4py import MPI

import numpy as np
import oracle
import pytest
from distributed import distribute
from dolfinx_mortar import cpp

comm = MPI.COMM_WORLD
kinds = pytest.mark.parametrize("kind", oracle.KINDS)
FEATURE = np.radians(40)


def roof(angle):
    """A ridge along x = 0.5; the normals of its two sides have the angle between them."""
    slope = np.tan(np.radians(angle) / 2)
    return lambda x, y: -slope * np.abs(x - 0.5)


def surface(kind, angle, seed=3):
    rng = np.random.default_rng(seed)
    source = oracle.patch(kind, (4, 3), height=roof(angle), distort=0.0, bend=0.0, rng=rng)
    return distribute(comm, source, rng=rng)


def ridge(s):
    """Flags of the owned nodes on the ridge."""
    return np.abs(s.X[: s.num_owned, 0] - 0.5) < 1e-9


@kinds
@pytest.mark.parametrize("angle", [30.0, 50.0, 120.0])
def test_nodes_on_a_ridge(kind, angle):
    """They become two beyond the feature angle; others stay."""
    d = surface(kind, angle)
    s = cpp.split_at_edges(d.surface, FEATURE)
    on_ridge = comm.allreduce(int(np.sum(ridge(d.surface))))
    assert on_ridge > 0
    expected = d.surface.num_global + (on_ridge if angle > 40 else 0)
    assert s.num_global == expected
    assert comm.allreduce(s.num_owned) == expected


@kinds
def test_each_side_has_its_normals(kind):
    """And facets keep their blocks and positions."""
    d = surface(kind, 90.0)
    s = cpp.split_at_edges(d.surface, FEATURE)
    assert np.array_equal(s.blocks[s.nodes], d.surface.blocks[d.surface.nodes])
    assert np.array_equal(s.X[s.nodes], d.surface.X[d.surface.nodes])
    normals = cpp.compute_normals(s, s.X)
    side = np.sign(s.X[s.nodes].reshape(-1, 3)[:, 0] - 0.5)
    offsets = np.repeat(np.arange(s.num_facets), np.diff(s.offsets))
    side = np.sign(np.bincount(offsets, side, minlength=s.num_facets))[offsets]
    expected = np.stack([side * np.sqrt(0.5), 0 * side, np.full(len(side), np.sqrt(0.5))], axis=1)
    assert np.allclose(normals.n[s.nodes], expected, atol=1e-12)


@kinds
def test_numbers_and_exchange(kind):
    """Nodes of one block are consecutive, ghosts get what their owners have."""
    s = cpp.split_at_edges(surface(kind, 90.0).surface, FEATURE)
    numbers = np.concatenate(comm.allgather(s.numbers[: s.num_owned]))
    assert np.array_equal(np.sort(numbers), np.arange(s.num_global))
    blocks = s.blocks[: s.num_owned]
    assert len(np.unique(blocks)) == 1 + np.count_nonzero(np.diff(blocks)) or len(blocks) == 0
    values = np.where(np.arange(s.num_nodes) < s.num_owned, s.numbers, -1).astype(np.int64)
    cpp.scatter_forward(s, values)
    assert np.array_equal(values, s.numbers)
    # Each facet adds one to its nodes: as many as there are facets at each, on its side
    count = np.zeros(s.num_nodes)
    np.add.at(count, s.nodes, 1.0)
    cpp.scatter_reverse_add(s, count)
    assert comm.allreduce(count[: s.num_owned].sum()) == comm.allreduce(len(s.nodes))
    assert np.all(count[: s.num_owned] > 0)


@kinds
def test_order_of_patches_is_that_of_any_partition(kind):
    """The first node of a block is the one of the same side on any number of ranks."""
    first = []
    for seed in (3, 5):
        rng = np.random.default_rng(seed)
        source = oracle.patch(kind, (4, 3), height=roof(90.0), distort=0.0, bend=0.0, rng=rng)
        s = cpp.split_at_edges(distribute(comm, source, rng=rng).surface, FEATURE)
        n = cpp.compute_normals(s, s.X).n[: s.num_owned]
        _, index = np.unique(s.blocks[: s.num_owned], return_index=True)
        index = index[ridge(s)[index]]
        first += comm.allreduce(list(np.sign(n[index, 0])))
    assert len(set(first)) == 1
