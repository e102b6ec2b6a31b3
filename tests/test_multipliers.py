# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Multiplier functions: basis transformation, biorthogonality, partition of unity, row sums."""

import functools

import numpy as np
import oracle
import pytest
from dolfinx_mortar import cpp
from facet_pairs import (
    PAIRINGS,
    SPACE,
    TYPE,
    Pairing,
    beyond_an_edge,
    edge_flags,
    random_pairing,
)

pytestmark = pytest.mark.serial
DUAL = ("dual", "dual-linear")
kinds = pytest.mark.parametrize("kind", oracle.KINDS)
multipliers = pytest.mark.parametrize("multiplier", oracle.MULTIPLIERS)
pairings = pytest.mark.parametrize("pairing", PAIRINGS, ids="-".join)
integrations = pytest.mark.parametrize("integration", ["segment", "element"])


@kinds
@multipliers
def test_transformation(kind, multiplier):
    T = cpp.transformation(SPACE[multiplier], TYPE[kind])
    # The linear functions that "standard" has on tri6 and quad8 are those of "dual-linear"
    linear = multiplier == "standard" and kind in ("tri6", "quad8")
    expected = oracle.transformation(kind, "dual-linear" if linear else multiplier)
    assert np.allclose(T, expected, rtol=0, atol=1e-16)
    inverse = cpp.inverse_transformation(SPACE[multiplier], TYPE[kind])
    assert np.allclose(T @ inverse, np.eye(len(T)), rtol=0, atol=1e-15)
    # An edge depends on its own corners only, so that T is the same seen from both facets
    assert np.array_equal(inverse != 0, T != 0)
    expected = len(oracle.multiplier_nodes(kind, multiplier))
    assert cpp.num_multipliers(SPACE[multiplier], TYPE[kind]) == expected


def nodes(pairing, multiplier):
    return oracle.multiplier_nodes(pairing[0], multiplier)


@functools.cache
def examples(pairing, number, covered, kinds=("segment", "element"), degrees=(None,)):
    """Random facets that masters cover entirely, or in part, with all of the integrations."""
    found = []
    for seed in range(10 * number):
        p = random_pairing(*pairing, seed, covered=covered)
        some = all(
            p.integrate("dual", kind, degree=degree)["covered"]
            for kind in kinds
            for degree in degrees
        )
        assert some or not covered
        found += [p] if some else []
        if len(found) == number:
            return found
    raise AssertionError(f"of {10 * number} facets masters cover a part of {len(found)} only")


@pairings
@pytest.mark.parametrize("multiplier", DUAL)
@integrations
@pytest.mark.parametrize("covered", [True, False], ids=["covered", "partly covered"])
def test_biorthogonality(pairing, multiplier, integration, covered):
    """D~ is diagonal, its entries are the integrals of the transformed functions."""
    for p in examples(pairing, 3, covered):
        r = p.integrate(multiplier, integration)
        k = nodes(pairing, multiplier)
        D = r["D_tilde"][np.ix_(k, k)]
        scale = r["area"]
        assert np.abs(D - np.diag(r["coverage"][k])).max() < 1e-13 * scale
        # What the library divides by, and D = D~ T^-1
        assert np.abs(r["diagonal"][k] - np.diag(D)).max() < 1e-13 * scale
        inverse = cpp.inverse_transformation(SPACE[multiplier], TYPE[pairing[0]])
        assert np.abs(r["D"] - r["D_tilde"] @ inverse).max() < 1e-13 * scale


@pairings
@pytest.mark.parametrize("multiplier", DUAL)
@integrations
def test_integrals_of_transformed_functions(pairing, multiplier, integration):
    """Positive on covered facets; on partly covered ones they add up to the covered area."""
    k = nodes(pairing, multiplier)
    for p in examples(pairing, 3, True):
        r = p.integrate(multiplier, integration)
        assert r["coverage"][k].min() > 0.01 * r["area"]
    for p in examples(pairing, 3, False):
        r = p.integrate(multiplier, integration)
        assert r["coverage"][k].sum() == pytest.approx(r["area"], rel=1e-13)


@pytest.mark.parametrize(("kind", "strip"), [("tri6", (-1, 0.1)), ("quad8", (0.85, 2))])
def test_covered_parts_can_have_negative_integrals(kind, strip):
    """Of "dual" on tri6 and quad8: N~ of a corner is negative near the opposite edge.

    On tri6 it is L (5 L - 2) / 3 with the corner's coordinate L, on quad8
    (1 - x) (1 - y) (1 - 1.2 (x + y)) for the corner at the origin. So a node of which too small a
    share is covered must not have a multiplier. Its function goes to the other nodes, and nothing
    else changes: D~ stays diagonal with the same entries, and constants stay reproduced.
    """
    reference = oracle.REFERENCE_NODES[kind]
    x = np.column_stack([reference, np.zeros(len(reference))])
    slave = oracle.Surface(x, [(kind, np.arange(len(x)))], np.ones(1))
    lower, upper = (strip[0], -1), (strip[1], 2)
    p = Pairing(slave, oracle.patch("quad4", (2, 3), lower=lower, upper=upper, outward=-1))
    r = p.integrate("dual")
    assert r["coverage"].min() < -1e-3 * r["area"]

    xi, w = oracle.facet_rule(kind, 6)
    integral = w @ oracle.shape_functions(kind, xi)[0] @ oracle.transformation(kind, "dual")
    covered_fraction = r["coverage"] / integral
    has_multiplier = covered_fraction > 0.02
    assert has_multiplier.any() and not has_multiplier.all()
    s = p.integrate("dual", has_multiplier=has_multiplier)
    assert not s["D_tilde"][~has_multiplier].any() and not s["M"][~has_multiplier].any()
    D = s["D_tilde"][np.ix_(has_multiplier, has_multiplier)]
    assert np.abs(D - np.diag(r["coverage"][has_multiplier])).max() < 1e-13
    assert s["D"].sum(axis=0) == pytest.approx(r["D"].sum(axis=0), abs=1e-13)
    assert s["M"].sum(axis=0) == pytest.approx(r["M"].sum(axis=0), abs=1e-13)


@kinds
def test_nonnegative_functions_are_nowhere_negative(kind):
    n = len(oracle.REFERENCE_NODES[kind])
    T = cpp.transformation(SPACE["dual"], TYPE[kind], np.ones(n, np.int8))
    xi, _ = oracle.facet_rule(kind, 30)
    values = oracle.shape_functions(kind, xi)[0] @ T
    assert values.min() > -1e-14
    assert np.abs(values.sum(axis=1) - 1).max() < 1e-14


@pairings
@integrations
def test_nonnegative_functions_on_partly_covered_facets(pairing, integration):
    """Their integrals are positive whatever is covered, and dual functions remain what they are."""
    n = len(oracle.REFERENCE_NODES[pairing[0]])
    for p in examples(pairing, 4, False):
        r = p.integrate("dual", integration, nonnegative=np.ones(n, np.int8))
        area = r["area"]
        assert r["coverage"].min() > 0
        assert r["coverage"].sum() == pytest.approx(area, rel=1e-13)
        assert np.abs(r["D_tilde"] - np.diag(r["coverage"])).max() < 1e-13 * area
        assert np.abs(r["D"].sum(axis=1) - r["M"].sum(axis=1)).max() < 1e-13 * area


@pytest.mark.parametrize("kind", ["tri6", "quad8", "quad9"])
def test_no_negative_weights_beyond_an_edge(kind):
    """Functions are negative there: such points are left out where they would outweigh the rest."""
    p = beyond_an_edge(kind)
    flags = np.ones(len(p.slave.x), np.int8)
    points = p.points("segment", 12)
    xi, w = points.xi, points.w
    T = cpp.transformation(SPACE["dual"], TYPE[kind], flags)
    assert (w @ oracle.shape_functions(kind, xi)[0] @ T).min() < 0
    inside = xi.min(axis=1) >= 0
    assert 0.1 * w.sum() < w[inside].sum() < 0.9 * w.sum()
    r = p.integrate("dual", degree=12, nonnegative=flags)
    expected = w[inside] @ oracle.shape_functions(kind, xi[inside])[0] @ T
    assert r["coverage"] == pytest.approx(expected, rel=1e-10)
    assert r["diagonal"] == pytest.approx(r["coverage"], rel=1e-10)
    assert r["diagonal"].min() > 0
    assert r["area"] == pytest.approx(w[inside].sum(), rel=1e-12)
    assert r["dropped_area"] == pytest.approx(w[~inside].sum(), rel=1e-12)
    assert r["lost"] > 0
    # Where no point is left, the facet is not covered
    p.master.x[:, 0] = [0.4, 0.6, 0.4, 0.6]
    r = p.integrate("dual", degree=12, nonnegative=flags)
    assert not r["covered"] and r["area"] == 0
    assert r["dropped_area"] == pytest.approx(p.points("segment", 12).w.sum(), rel=1e-12)


@pairings
@multipliers
@integrations
@pytest.mark.parametrize("covered", [True, False], ids=["covered", "partly covered"])
def test_partition_of_unity(pairing, multiplier, integration, covered):
    """The functions add up to one: column sums of D are integrals of N, of nodes that share too."""
    rng = np.random.default_rng(5)
    flags = edge_flags(pairing[0], multiplier, covered)
    for p in examples(pairing, 2, covered):
        n = len(p.slave.x)
        some = np.ones(n, bool)
        some[rng.permutation(oracle.num_corners(pairing[0]))[:2]] = False
        inner = p.integrate("standard", integration)["D"].sum(axis=0)
        for has_multiplier in (np.ones(n, bool), some):
            r = p.integrate(
                multiplier, integration, has_multiplier=has_multiplier, nonnegative=flags
            )
            assert np.abs(r["D"].sum(axis=0) - inner).max() < 1e-13 * r["area"]
            assert r["D"].sum() == pytest.approx(r["area"], rel=1e-13)


@pairings
@multipliers
@integrations
@pytest.mark.parametrize("covered", [True, False], ids=["covered", "partly covered"])
def test_row_sums(pairing, multiplier, integration, covered):
    """Of D and M are equal, for any rule: a translation has no effect, and forces balance."""
    # A slave facet's own points must be many enough for dual functions on the covered part
    degrees = {"segment": (None, 5, 7), "element": (None, 11, 13)}[integration]
    flags = edge_flags(pairing[0], multiplier, covered)
    facets = examples(pairing, 3, covered, (integration,), degrees)
    for p, degree in zip(facets, degrees, strict=True):
        r = p.integrate(multiplier, integration, degree=degree, nonnegative=flags)
        scale = np.abs(r["M"]).sum(axis=1).max()
        assert np.abs(r["D"].sum(axis=1) - r["M"].sum(axis=1)).max() < 1e-13 * scale


@kinds
def test_inverse(kind):
    """D^-1 = T D~^-1, exact, and as sparse as T."""
    for seed in range(3):
        r = random_pairing(kind, "tri6", seed).integrate("dual")
        T = cpp.transformation(SPACE["dual"], TYPE[kind])
        inverse = T / r["diagonal"]
        assert np.abs(inverse @ r["D"] - np.eye(len(T))).max() < 1e-12
        assert np.count_nonzero(inverse) == np.count_nonzero(T)


@pairings
@multipliers
def test_constant_traction(pairing, multiplier):
    """A constant multiplier gives each master node the force of a constant traction."""
    p = random_pairing(*pairing, 3)
    r, s = p.integrate(multiplier), p.integrate("standard")
    assert np.abs(r["M"].sum(axis=0) - s["M"].sum(axis=0)).max() < 1e-13 * r["area"]


@pairings
def test_idle_nodes_leave_their_neighbours_alone(pairing):
    """Whether a node that nothing acts at has a multiplier is nothing to the others."""
    p = random_pairing(*pairing, 5)
    n = len(p.slave.x)
    everywhere = p.integrate("dual")
    assert everywhere["covered"]
    for k in range(n):
        others = np.arange(n) != k
        idle = p.integrate("dual", has_multiplier=np.where(others, 1, -1))
        shared = p.integrate("dual", has_multiplier=others)
        for name in ("D", "M", "gap", "jump"):
            assert np.array_equal(idle[name][others], everywhere[name][others])
            assert not np.any(idle[name][k])
        assert not np.allclose(shared["gap"][others], everywhere["gap"][others])


@pytest.mark.parametrize("kind", ["tri6", "quad8"])
@integrations
def test_linear_tractions_are_reproduced(kind, integration):
    """By "dual-reproducing" on affine facets: λ_h is the function whose values corners have."""
    x = oracle.REFERENCE_NODES[kind] @ [[1.2, 0.3, 0], [-0.4, 0.9, 0]]
    slave = oracle.Surface(x, [(kind, np.arange(len(x)))], np.ones(1))
    low, high = x.min(axis=0) - 0.1, x.max(axis=0) + 0.1
    p = Pairing(slave, oracle.patch("quad4", (1, 1), lower=low[:2], upper=high[:2], outward=-1))
    r = p.integrate("dual-reproducing", integration)
    corners = oracle.num_corners(kind)
    xi, w = oracle.facet_rule(kind, 8)
    N = oracle.shape_functions(kind, xi)[0]
    w = w * r["area"] / w.sum()
    for z in (np.ones(len(x)), x[:, 0], x[:, 1]):
        expected = (w * (N @ z)) @ N
        assert np.abs(z[:corners] @ r["D"][:corners] - expected).max() < 1e-13 * r["area"]
    assert not r["D"][corners:].any()


@pytest.mark.parametrize(
    "pairing", [p for p in PAIRINGS if p[0] in ("tri6", "quad8")], ids="-".join
)
@integrations
@pytest.mark.parametrize("covered", [True, False], ids=["covered", "partly covered"])
def test_corner_functions_are_biorthogonal(pairing, integration, covered):
    """Of "dual-reproducing": to the transformed functions of the corners, with any flags."""
    corners, n = oracle.num_corners(pairing[0]), len(oracle.REFERENCE_NODES[pairing[0]])
    rng = np.random.default_rng(5)
    for p in examples(pairing, 3, covered):
        for flags in (np.ones(n, np.int8), rng.integers(0, 2, n).astype(np.int8)):
            r = p.integrate("dual-reproducing", integration, nonnegative=flags)
            if not covered and not flags.all() and not r["covered"]:
                continue  # integrals of functions that change their sign may vanish
            D, scale = r["D_tilde"][:corners, :corners], r["area"]
            assert np.abs(D - np.diag(np.diag(D))).max() < 1e-13 * scale
            assert np.abs(r["D"].sum(axis=1) - r["M"].sum(axis=1)).max() < 1e-13 * scale
            assert r["D"].sum() == pytest.approx(scale, rel=1e-13)
            if flags.all():
                assert np.diag(D).min() > 0
                assert np.abs(np.diag(D) - r["coverage"][:corners]).max() < 1e-13 * scale
