# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Surfaces that pass through each other on their way, and surfaces that only seem to."""

from mpi4py import MPI

import numpy as np
import oracle
import pytest
from distributed import distribute
from dolfinx_mortar import cpp

comm = MPI.COMM_WORLD
KINDS = ["tri3", "tri6", "quad4", "quad8", "quad9"]


def deal(*surfaces, communicator=comm):
    """Surfaces on the ranks, facets and nodes at random."""
    rng = np.random.default_rng(5)
    return [
        distribute(communicator, s, first_block=10**6 * i, rng=rng) for i, s in enumerate(surfaces)
    ]


def crossing(slave, master, slave_after, master_after=None, distance=None):
    """Depth and position, of surfaces of the oracle, the same on all ranks and on one alone.

    Args:
        slave, master: Before.
        slave_after, master_after: Maps of positions, shape (nodes, 3); None where nothing moves.
        distance: Search distance.
    """
    results = []
    for communicator in (comm, MPI.COMM_SELF):
        arguments = []
        dealt = deal(slave, master, communicator=communicator)
        for part, move in zip(dealt, (slave_after, master_after), strict=True):
            after = part.x if move is None else np.ascontiguousarray(move(part.x))
            arguments += [part.surface, part.x, after]
        results.append(cpp.find_crossing(*arguments, distance))
    assert comm.bcast(results[0]) == results[0]
    assert results[0][0] == pytest.approx(results[1][0], rel=1e-12)
    return results[0]


def shift(*by):
    return lambda x: x + np.array(by)


def plates(kinds=("quad4", "quad4"), gap=0.1, cells=(6, 4), size=1.0):
    """A plate over a larger one, facing each other."""
    rng = np.random.default_rng(3)
    more = {"distort": 0.2, "shuffle": True, "rng": rng}
    upper = oracle.patch(
        kinds[0], (cells[0],) * 2, upper=(size, size), height=gap, outward=-1, **more
    )
    lower = oracle.patch(kinds[1], (cells[1],) * 2, lower=(-0.5, -0.5), upper=(1.5, 1.5), **more)
    return upper, lower


@pytest.mark.parametrize("kinds", zip(KINDS, np.roll(KINDS, 2), strict=True))
@pytest.mark.parametrize("swap", [False, True])
def test_plates_pass_through_each_other(kinds, swap):
    upper, lower = plates(kinds)
    moves = shift(0.05, 0.0, -3.4), None
    if swap:
        upper, lower, moves = lower, upper, moves[::-1]
    depth, x = crossing(upper, lower, *moves)
    assert depth == pytest.approx(3.3, rel=1e-12)
    assert x[2] == pytest.approx(0.0 if swap and x[2] > -1 else -3.3, abs=1e-12)


@pytest.mark.parametrize("start", [-1e-12, 0.0, 1e-12, -0.02])
def test_plates_that_touch_at_the_beginning(start):
    """Nodes in contact are on either side by round-off, and by more between nodes."""
    upper, lower = plates(gap=start)
    depth, _ = crossing(upper, lower, shift(0, 0, -2))
    assert depth == pytest.approx(2 - start, rel=1e-9)


@pytest.mark.parametrize("swap", [False, True])
def test_needle_between_nodes(swap):
    """Of the two surfaces only the finer one has points that meet the other."""
    needle, lower = plates(cells=(2, 1), size=0.04)
    moves = shift(0.33, 0.21, -3.0), None
    if swap:
        needle, lower, moves = lower, needle, moves[::-1]
    depth, _ = crossing(needle, lower, *moves)
    assert depth == pytest.approx(2.9, rel=1e-12)


def test_beam_that_bends_through_another():
    """As the jaws of a clip do: at its end a surface stays where it is."""
    upper, lower = plates(gap=0.6, cells=(14, 24))
    depth, _ = crossing(
        upper,
        lower,
        lambda x: x - np.outer(x[:, 0] ** 2, [0, 0, 1]),
        lambda x: x + np.outer(x[:, 0].clip(0) ** 2, [0, 0, 1]),
    )
    # At x = 1 they are 1.4 apart in z, and the planes have a slope of two
    assert 0.9 * 1.4 / np.sqrt(5) < depth < 1.4


@pytest.mark.parametrize("depth", [0.3, 1.2])
def test_within_reach(depth):
    """What the search finds is contact, not a passing."""
    upper, lower = plates()
    assert crossing(upper, lower, shift(0, 0, -0.1 - depth), distance=1.25)[0] == 0.0
    found = crossing(upper, lower, shift(0, 0, -0.1 - depth), distance=0.25)[0]
    assert found == pytest.approx(depth)


def test_reach_by_default():
    """The larger diameter of the facets."""
    upper, lower = plates(cells=(4, 4), size=2.0)
    lower = upper.moved(np.array([0, 0, -0.1]))
    lower.sign = -upper.sign
    x = [lower.x[nodes] for _, nodes in lower.facets]
    diameter = [np.linalg.norm(p[:, None] - p, axis=2).max() for p in x]
    assert crossing(upper, lower, shift(0, 0, -0.1 - 0.99 * min(diameter)))[0] == 0.0
    assert crossing(upper, lower, shift(0, 0, -0.1 - 1.01 * max(diameter)))[0] > max(diameter)


# -- No passing ------------------------------------------------------------------------------------


def rotation(angle, axis=1):
    a = np.eye(3)
    i, j = [k for k in range(3) if k != axis]
    a[i, i] = a[j, j] = np.cos(angle)
    a[i, j], a[j, i] = np.sin(angle), -np.sin(angle)
    return a


@pytest.mark.parametrize("angle", [0.5, 2.0, 3.0])
def test_both_turn_together(angle):
    upper, lower = plates(gap=0.01)

    def turn(x):
        return (x - [3.0, 0, 0]) @ rotation(angle).T + [40.0, 0, 0]

    assert crossing(upper, lower, turn, turn)[0] == 0.0


@pytest.mark.parametrize("by", [(9, 0, 0), (0, 0, 9), (-3, 3, 0.2), (0.8, 0, -1e-10)])
@pytest.mark.parametrize("gap", [-1e-10, 0.0, 0.02])
def test_apart_or_along(by, gap):
    upper, lower = plates(gap=gap)
    assert crossing(upper, lower, shift(*by))[0] == 0.0


def test_far_beyond_the_edge():
    """A surface that was far away and comes down beside the other one."""
    upper, lower = plates(gap=5.0)
    side = upper.moved(np.array([2.2, 0, 0]))
    assert crossing(side, lower, shift(0, 0, -9))[0] == 0.0


def test_over_the_edge_in_steps():
    """A plate that is dragged over an edge and falls down beside it."""
    upper, lower = plates(gap=0.0)
    x, step = 0.0, 0.15
    for _ in range(20):
        assert crossing(upper, lower, shift(step, 0, -0.1 if x > 1.5 else 0.0))[0] == 0.0
        upper = upper.moved(np.array([step, 0, -0.1 if x > 1.5 else 0.0]))
        x += step
    assert upper.x[:, 2].max() < -0.5


def test_back_side():
    """Surfaces that do not face each other are none of contact's business."""
    upper, lower = plates()
    upper.sign = -upper.sign
    assert crossing(upper, lower, shift(0, 0, -3.0))[0] == 0.0


def cylinder(radius, outward, cells, kind="quad4", length=1.0):
    """A whole cylinder around the y axis."""
    flat = oracle.patch(kind, cells, upper=(2 * np.pi, length), outward=outward)
    phi, y, _ = flat.x.T
    x = np.column_stack([radius * np.sin(phi), y, radius * np.cos(phi)])
    return oracle.Surface(x, flat.facets, flat.sign)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("swap", "clearance"), [(False, 0.4), (True, 0.02)])
def test_pin_turns_in_a_bore(kind, swap, clearance):
    """Straight paths of the bore's nodes, seen from the pin, go through the pin."""
    pin = cylinder(1.0, 1, (24, 2), kind)
    bore = cylinder(1.0 + clearance, -1, (20, 2), kind)

    def turn(x):
        return x @ rotation(1.5).T

    surfaces = (bore, pin) if swap else (pin, bore)
    for moves in ((turn, None), (None, turn)):
        assert crossing(*surfaces, *moves)[0] == 0.0


@pytest.mark.parametrize("swap", [False, True])
def test_cylinder_rolls(swap):
    """The whole of it is tagged; nodes go up behind, over it and down in front."""
    wheel = cylinder(1.0, 1, (48, 3))
    floor = oracle.patch("quad4", (20, 3), lower=(-2, -1), upper=(8, 2), height=-1.0)
    angle = 1.2

    def roll(x):
        return x @ rotation(angle).T + [angle, 0, 0]

    surfaces, moves = (wheel, floor), (roll, None)
    if swap:
        surfaces, moves = surfaces[::-1], moves[::-1]
    assert crossing(*surfaces, *moves)[0] == 0.0


@pytest.mark.parametrize("swap", [False, True])
def test_cylinder_falls_through_the_floor(swap):
    wheel = cylinder(1.0, 1, (48, 3))
    floor = oracle.patch("quad4", (20, 3), lower=(-2, -1), upper=(8, 2), height=-1.0)
    surfaces, moves = (wheel, floor), (shift(0.3, 0, -2.5), None)
    if swap:
        surfaces, moves = surfaces[::-1], moves[::-1]
    # Its upper half faces the floor with its back, and its lowest facet is at a slant
    depth, _ = crossing(*surfaces, *moves)
    assert depth == pytest.approx(2.5, abs=0.3 * 2 * np.pi / 48)


def sheet(thickness):
    """Both sides of a sheet, as one surface."""
    top, bottom = (
        oracle.patch("quad4", (4, 4), lower=(-0.5, -0.5), upper=(1.5, 1.5), height=z, outward=s)
        for z, s in ((0.0, 1), (-thickness, -1))
    )
    more = [(kind, nodes + len(top.x)) for kind, nodes in bottom.facets]
    return oracle.Surface(
        np.vstack([top.x, bottom.x]), top.facets + more, np.concatenate([top.sign, bottom.sign])
    )


@pytest.mark.parametrize("swap", [False, True])
def test_through_a_thin_sheet(swap):
    """In at its top, out at its bottom; one that is under it and moves down has not."""
    upper, _ = plates()
    for start, expected in ((0.0, 2.9), (-0.2, 0.0)):
        surfaces = (upper.moved(np.array([0, 0, start])), sheet(0.05))
        moves = (shift(0, 0, -3.0), None)
        if expected == 0.0:
            surfaces[0].sign = -upper.sign  # it faces the bottom
        if swap:
            surfaces, moves = surfaces[::-1], moves[::-1]
        assert crossing(*surfaces, *moves)[0] == pytest.approx(expected, rel=1e-9)


def test_only_what_is_near_travels():
    """Large surfaces of which each rank has a far part of its own."""
    n = 12 * comm.size
    upper = oracle.patch("quad4", (n, 2), upper=(n, 2.0), height=0.1, outward=-1)
    lower = oracle.patch("quad4", (n, 2), upper=(n, 2.0))
    middle = [np.mean(s.x[nodes, 0]) for s in (upper,) for _, nodes in s.facets]
    rank = np.minimum(np.array(middle) * comm.size / n, comm.size - 1).astype(int)
    node = np.minimum(upper.x[:, 0] * comm.size / n, comm.size - 1).astype(int)
    parts = [
        distribute(comm, s, facet_rank=rank, node_rank=node, first_block=10**6 * i)
        for i, s in enumerate((upper, lower))
    ]
    arguments = []
    for part, move in zip(parts, (np.array([0, 0, -4.0]), 0.0), strict=True):
        arguments += [part.surface, part.x, part.x + move]
    assert cpp.find_crossing(*arguments)[0] == pytest.approx(3.9)
