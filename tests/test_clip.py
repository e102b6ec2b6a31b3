# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Intersection of two convex polygons."""

import numpy as np
import oracle
import pytest
from dolfinx_mortar import cpp

pytestmark = pytest.mark.serial

SQUARE = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=float)
TRIANGLE = SQUARE[:3]


def clip(slave, master, tol=1e-13):
    return cpp.clip([tuple(p) for p in slave], [tuple(p) for p in master], tol)


def area(polygon):
    return oracle.polygon_area(polygon) if len(polygon) > 2 else 0.0


def convex(rng, corners):
    """A random convex polygon, counter-clockwise."""
    angle = 2 * np.pi * (np.arange(corners) + rng.uniform(-0.2, 0.2, corners)) / corners
    shape = rng.uniform(0.3, 1.0, 2) * np.column_stack([np.cos(angle), np.sin(angle)])
    return shape + rng.uniform(-0.7, 0.7, 2)


@pytest.mark.parametrize("corners", [(3, 3), (3, 4), (4, 3), (4, 4)])
def test_random_polygons(corners):
    """Area and centroid are the reference's; the result is convex, and inside both."""
    rng = np.random.default_rng(sum(corners))
    overlaps = 0
    for _ in range(500):
        a, b = convex(rng, corners[0]), convex(rng, corners[1])
        ours, theirs = clip(a, b), oracle.clip(a, b)
        assert area(ours) == pytest.approx(area(theirs), abs=1e-12)
        if area(theirs) < 1e-6:
            continue
        overlaps += 1
        assert centroid(ours) == pytest.approx(centroid(theirs), abs=1e-9)
        assert len(ours) <= sum(corners)
        for outline in (a, b, ours):
            assert (heights(ours, outline) > -1e-12).all()
    assert overlaps > 100


def heights(x, outline):
    """Distance of points x to the inner side of each edge of an outline."""
    edge = np.roll(outline, -1, axis=0) - outline
    edge /= np.maximum(np.linalg.norm(edge, axis=1, keepdims=True), 1e-300)
    d = x[:, None] - outline
    return edge[:, 0] * d[..., 1] - edge[:, 1] * d[..., 0]


def centroid(polygon):
    p = polygon - polygon[0]
    q = np.roll(p, -1, axis=0)
    cross = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    return polygon[0] + (p + q).T @ cross / (3 * cross.sum())


@pytest.mark.parametrize("shape", [SQUARE, TRIANGLE])
def test_coincident_polygons(shape):
    """Numbered from any corner, and moved by less than the tolerance."""
    rng = np.random.default_rng(0)
    for k in range(len(shape)):
        for noise in (0, 1e-15, 1e-10):
            moved = np.roll(shape, k, axis=0) + noise * rng.uniform(-1, 1, shape.shape)
            result = clip(shape, moved, tol=1e-9)
            assert area(result) == pytest.approx(area(shape), abs=1e-9)


def test_coincident_edges():
    """Neighbours share an edge: no overlap. One inside the other along an edge: the inner one."""
    assert area(clip(SQUARE, SQUARE + [1, 0])) == 0
    inner = np.array([(0.2, 0), (0.8, 0), (0.8, 0.5), (0.2, 0.5)])
    assert area(clip(SQUARE, inner)) == pytest.approx(0.3, rel=1e-15)
    assert area(clip(inner, SQUARE)) == pytest.approx(0.3, rel=1e-15)
    assert area(clip(SQUARE, SQUARE + [0.25, 0])) == pytest.approx(0.75, rel=1e-15)


def test_pieces_of_a_split_polygon_add_up():
    """Whatever rounding does at the common edges, nothing is lost or counted twice."""
    rng = np.random.default_rng(1)
    for _ in range(200):
        a = convex(rng, 4)
        b = convex(rng, 4)
        parts = sum(area(clip(a, b[list(t)])) for t in ((0, 1, 2), (0, 2, 3)))
        assert parts == pytest.approx(area(clip(a, b)), abs=1e-11)


@pytest.mark.parametrize(
    "other",
    [
        SQUARE + [2, 0],  # apart
        SQUARE + [1, 1],  # a common corner
        np.array([(1, 0.5), (2, 0), (2, 1)]),  # a corner on an edge
        SQUARE + [1 + 1e-14, 0.3],  # nearly touching
        SQUARE + [1 - 1e-14, 0.3],
    ],
)
def test_touching(other):
    assert area(clip(SQUARE, other)) <= 1e-13
    assert area(clip(other, SQUARE)) <= 1e-13


@pytest.mark.parametrize("width", [1e-3, 1e-6, 1e-9])
def test_slivers(width):
    """Thin overlaps keep their area, to the tolerance times their length."""
    for shift, length in (((1 - width, 0.3), 0.7), ((0.3, -1 + width), 0.7)):
        assert area(clip(SQUARE, SQUARE + shift)) == pytest.approx(width * length, abs=1e-12)
    needle = np.array([(-1, 0.5), (2, 0.5 - width / 2), (2, 0.5 + width / 2)])
    assert area(clip(SQUARE, needle)) == pytest.approx(width / 2, abs=1e-12)


def test_scale_and_place():
    """The area of millimetres far away is that of metres here, to the round-off of the place."""
    rng = np.random.default_rng(2)
    for _ in range(50):
        a, b = convex(rng, 4), convex(rng, 3)
        expected = area(clip(a, b))
        assert area(clip(1e-3 * a, 1e-3 * b, 1e-16)) == pytest.approx(1e-6 * expected, abs=1e-18)
        assert area(clip(a + 1e3, b + 1e3, 1e-11)) == pytest.approx(expected, abs=1e-9)


def test_swapped_sides():
    rng = np.random.default_rng(3)
    for _ in range(100):
        a, b = convex(rng, 4), convex(rng, 3)
        assert area(clip(a, b)) == pytest.approx(area(clip(b, a)), abs=1e-13)
        k = rng.integers(4)
        assert area(clip(np.roll(a, k, axis=0), b)) == pytest.approx(area(clip(a, b)), abs=1e-13)
