# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Slave nodes that nearly touch the master, moved onto it."""

from mpi4py import MPI

import cases
import dolfinx_mortar as dm
import numpy as np
import pytest
from blocks import FACES, block
from test_bad_input import fails

comm = MPI.COMM_WORLD


def bump(x, y):
    return 1 + 0.02 * np.sin(3 * x + 0.5) * np.cos(2 * y)


def bodies(element, gap=0.0, master="hex27"):
    """A block over another one, whose top is wavy."""
    parts = [
        block("upper", element, (0.1, 0.1, 1 + gap), (0.9, 0.9, 1.5), (3, 3, 1)),
        block("lower", master, (0, 0, 0), (1, 1, 1), (4, 4, 1), top=bump),
    ]
    return cases._bodies(comm, parts, False)[0]


def heights(body):
    """Largest and smallest distance of the bottom's corners from the wave, on all ranks."""
    x = body.mesh.geometry.x
    x = x[x[:, 2] < 1.25]
    d = x[:, 2] - bump(x[:, 0], x[:, 1])
    low, high = (np.min(d, initial=9), np.max(d, initial=-9))
    return comm.allreduce(low, op=MPI.MIN), comm.allreduce(high, op=MPI.MAX)


@pytest.mark.parametrize("element", ["hex8", "hex20", "tet10"])
def test_nodes_lie_on_the_master(element):
    """To the wave, as far as the master's facets follow it."""
    upper, lower = bodies(element)
    contact = dm.Contact(
        slave=[(upper.V, upper.facet_tags, FACES["z-"])],
        master=[(lower.V, lower.facet_tags, FACES["z+"])],
    )
    before = heights(upper)
    largest = dm.adjust(contact, 0.05)
    assert 0.01 < largest < 0.05
    low, high = heights(upper)
    assert max(abs(low), abs(high)) < 0.2 * max(np.abs(before))
    if element == "hex8":  # others have nodes on edges, which straight cells do not follow
        assert dm.adjust(contact, 0.05) < 1e-2 * largest  # normals have turned a little


def test_far_nodes_stay():
    upper, lower = bodies("hex8", gap=0.1)
    contact = dm.Contact(
        slave=[(upper.V, upper.facet_tags, FACES["z-"])],
        master=[(lower.V, lower.facet_tags, FACES["z+"])],
    )
    before = upper.mesh.geometry.x.copy()
    assert dm.adjust(contact, 0.05) == 0
    np.testing.assert_array_equal(upper.mesh.geometry.x, before)


def test_onto_a_tool():
    """All nodes of the bottom, in exactly one plane."""
    upper, _ = bodies("hex20")
    tool = dm.RigidPlane((0, 0, 0.99), (0.02, -0.01, 1))
    side = [(upper.V, upper.facet_tags, FACES["z-"])]
    assert dm.adjust(dm.Contact(slave=side, master=tool), 0.05) > 0.001
    x = upper.mesh.geometry.x
    n = np.array([0.02, -0.01, 1]) / np.linalg.norm([0.02, -0.01, 1])
    d = (x[x[:, 2] < 1.2] - [0, 0, 0.99]) @ n
    assert np.max(np.abs(d), initial=0) < 1e-12


@pytest.mark.parametrize("gap", [0.03, -0.04])
def test_nodes_have_a_gap(gap):
    """Over a wave, as far as the master's facets follow it; what would move too far stays."""
    upper, lower = bodies("hex8", gap=gap)
    contact = dm.Contact(
        slave=[(upper.V, upper.facet_tags, FACES["z-"])],
        master=[(lower.V, lower.facet_tags, FACES["z+"])],
    )
    before = heights(upper)
    assert dm.adjust(contact, 1e-3, gap=-gap) == 0
    assert heights(upper) == before
    largest = dm.adjust(contact, 0.025, gap=gap)
    assert 0.01 < largest < 0.025
    deviations = np.array(heights(upper)) - gap
    assert np.max(np.abs(deviations)) < 0.2 * np.max(np.abs(np.array(before) - gap))
    assert dm.adjust(contact, 0.025, gap=gap) < 1e-2 * largest


@pytest.mark.parametrize("gap", [0.02, -0.02])
def test_a_gap_to_a_tool(gap):
    """All nodes of the bottom, in exactly one plane."""
    upper, _ = bodies("hex20")
    tool = dm.RigidPlane((0, 0, 0.99), (0.02, -0.01, 1))
    side = [(upper.V, upper.facet_tags, FACES["z-"])]
    assert dm.adjust(dm.Contact(slave=side, master=tool), 0.08, gap=gap) > 0.001
    x = upper.mesh.geometry.x
    n = np.array([0.02, -0.01, 1]) / np.linalg.norm([0.02, -0.01, 1])
    d = (x[x[:, 2] < 1.2] - [0, 0, 0.99]) @ n - gap
    assert np.max(np.abs(d), initial=0) < 1e-12


def test_bad_input():
    upper, lower = bodies("hex8")
    sides = {
        "slave": [(upper.V, upper.facet_tags, FACES["z-"])],
        "master": [(lower.V, lower.facet_tags, FACES["z+"])],
    }
    fails(lambda: dm.adjust(dm.Tie(**sides), 0.1), "for ties there is relocate")
    for distance in (None, -1.0, "near"):
        fails(lambda d=distance: dm.adjust(dm.Contact(**sides), d), "distance is")
    for gap in (None, np.nan, "0.1"):
        fails(lambda g=gap: dm.adjust(dm.Contact(**sides), 0.1, gap=g), "gap is")
