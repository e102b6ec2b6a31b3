# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Facets: shape functions, their derivatives, linear sub-facets, quadrature on them."""

import itertools

import numpy as np
import oracle
import pytest
from dolfinx_mortar import cpp
from facet_pairs import TYPE, Pairing

pytestmark = pytest.mark.serial
kinds = pytest.mark.parametrize("kind", oracle.KINDS)


def tabulate(kind, xi):
    """N, N,1, N,2, N,11, N,12, N,22 at points; shape (points, 6, nodes)."""
    return np.array([cpp.tabulate(TYPE[kind], tuple(map(float, p))) for p in xi])


def points(seed):
    return np.random.default_rng(seed).uniform(-0.2, 1.2, (20, 2))


@kinds
def test_nodes(kind):
    nodes = cpp.node_coordinates(TYPE[kind])
    assert np.array_equal(nodes, oracle.REFERENCE_NODES[kind])
    assert cpp.num_nodes(TYPE[kind]) == len(nodes)
    assert cpp.num_corners(TYPE[kind]) == oracle.num_corners(kind)
    assert np.allclose(tabulate(kind, nodes)[:, 0], np.eye(len(nodes)), rtol=0, atol=1e-15)


@kinds
def test_polynomials_are_reproduced(kind):
    """Those that the element has, with first and second derivatives."""
    xi = points(1)
    x, y = xi.T
    nodes = oracle.REFERENCE_NODES[kind]
    for p, q in oracle.EXPONENTS[kind]:

        def power(s, n, k):
            """Derivative of order k of s^n."""
            return np.prod(np.arange(n - k + 1, n + 1)) * s ** max(n - k, 0) if k <= n else 0 * s

        values = nodes[:, 0] ** p * nodes[:, 1] ** q
        expected = [
            power(x, p, a) * power(y, q, b)
            for a, b in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        ]
        assert np.allclose(tabulate(kind, xi) @ values, np.transpose(expected), atol=1e-13)


@kinds
def test_values_are_those_of_the_reference(kind):
    xi = points(2)
    N, dN = oracle.shape_functions(kind, xi)
    table = tabulate(kind, xi)
    assert np.allclose(table[:, 0], N, rtol=0, atol=1e-13)
    assert np.allclose(table[:, 1:3], dN, rtol=0, atol=1e-13)


@kinds
def test_derivatives(kind):
    """Against differences, exact for polynomials of low degree up to round-off."""
    xi = points(3)
    table = tabulate(kind, xi)
    for i, direction in enumerate(np.eye(2)):
        for value, slopes in ((0, (1, 2)), (1, (3, 4)), (2, (4, 5))):
            difference, _ = oracle.derivative(
                lambda p, v=value: tabulate(kind, p)[:, v], xi, direction + 0 * xi, 0.1, levels=3
            )
            assert np.allclose(difference, table[:, slopes[i]], rtol=0, atol=1e-12)


def around(sub):
    """Corners in the order of the outline; the library's quadrilaterals are in tensor order."""
    return sub if len(sub) == 3 else [sub[k] for k in (0, 1, 3, 2)]


@kinds
def test_sub_facets_tile_the_facet(kind):
    """Every node is in one, areas add up, and no point is in two."""
    nodes = oracle.REFERENCE_NODES[kind]
    polygons = [nodes[around(sub)] for sub in cpp.sub_facets(TYPE[kind])]
    assert {k for sub in cpp.sub_facets(TYPE[kind]) for k in sub} == set(range(len(nodes)))
    areas = [oracle.polygon_area(p) for p in polygons]
    assert min(areas) > 0  # in the sense of the facet
    assert sum(areas) == pytest.approx(0.5 if kind.startswith("tri") else 1.0, rel=1e-15)
    for a, b in itertools.combinations(polygons, 2):
        assert abs(oracle.polygon_area(oracle.clip(a, b))) < 1e-15


@kinds
def test_sub_facets_are_those_of_the_reference(kind):
    ours = {frozenset(sub) for sub in cpp.sub_facets(TYPE[kind])}
    assert ours == {frozenset(sub) for sub in oracle.SUB_FACETS[kind]}


def flat_pair(kind):
    """A facet of unit corners under a triangle or square far larger."""
    x = np.column_stack([oracle.REFERENCE_NODES[kind], np.zeros(len(oracle.REFERENCE_NODES[kind]))])
    slave = oracle.Surface(x, [(kind, np.arange(len(x)))], np.ones(1))
    return Pairing(slave, oracle.patch("quad4", (1, 1), lower=(-2, -2), upper=(3, 3), outward=-1))


@kinds
@pytest.mark.parametrize("integration", ["segment", "element"])
@pytest.mark.parametrize("degree", [1, 2, 4, 7, 12])
def test_degree_of_quadrature(kind, integration, degree):
    p = flat_pair(kind).points(integration, degree)
    x, y = p.xi.T
    for a, b in itertools.product(range(degree + 1), repeat=2):
        if a + b > degree:
            continue
        if kind.startswith("tri"):
            factorial = [float(np.prod(np.arange(1, n + 1))) for n in (a, b, a + b + 2)]
            exact = factorial[0] * factorial[1] / factorial[2]
        else:
            exact = 1 / ((a + 1) * (b + 1))
        assert p.w @ (x**a * y**b) == pytest.approx(exact, rel=1e-12)
