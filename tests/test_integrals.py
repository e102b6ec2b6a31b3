# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""D, D~, M, gap and relative position of a slave facet, against the slow reference."""

import numpy as np
import oracle
import pytest
from dolfinx_mortar import cpp
from facet_pairs import INTEGRATION, PAIRINGS, TYPE, edge_flags, in_facet_order, random_pairing

pytestmark = pytest.mark.serial
pairings = pytest.mark.parametrize("pairing", PAIRINGS, ids="-".join)
multipliers = pytest.mark.parametrize("multiplier", oracle.MULTIPLIERS)
coverings = pytest.mark.parametrize("covered", [True, False], ids=["covered", "partly covered"])


def differences(ours, reference):
    """Largest differences, relative to the largest entry of each quantity."""
    return {k: np.abs(ours[k] - b).max() / np.abs(b).max() for k, b in reference.items()}


def quantities(r):
    """What there is to compare, from the reference's result."""
    return {"D": r.D, "M": r.M, "gap": r.gap, "jump": r.relative}


@pairings
@coverings
def test_segments(pairing, covered):
    """With rules of high degree on both sides; all nodes carry multipliers, or some share."""
    p = random_pairing(*pairing, 5, covered=covered, distort=0.02)
    n = len(p.slave.x)
    points = oracle.segment_points(p.slave, p.master, 10)
    for multiplier in oracle.MULTIPLIERS:
        flags = edge_flags(pairing[0], multiplier, covered)
        for dropped in ([], [0], [0, 2]):
            has_multiplier = np.ones(n, bool)
            has_multiplier[dropped] = False
            reference = oracle.mortar(
                p.slave,
                p.master,
                multiplier,
                dropped=dropped,
                facet_points=points,
                nonnegative=flags,
            )
            ours = p.integrate(
                multiplier, degree=18, has_multiplier=has_multiplier, nonnegative=flags
            )
            assert ours["area"] == pytest.approx(reference.area[0], rel=1e-10)
            worst = differences(ours, quantities(reference))
            assert max(worst.values()) < 1e-8, (multiplier, dropped, worst)
            if multiplier != "standard":
                k = oracle.multiplier_nodes(pairing[0], multiplier)
                D_tilde = reference.D_tilde[k]
                assert np.abs(ours["D_tilde"][k] - D_tilde).max() < 1e-8 * ours["area"]


@pairings
def test_default_degree(pairing):
    """What the default rule leaves out is small on facets as distorted as these."""
    p = random_pairing(*pairing, 6, distort=0.02)
    exact = p.integrate("dual", degree=18)
    exact = {name: exact[name] for name in ("D", "M", "gap", "jump")}
    worst = differences(p.integrate("dual"), exact)
    assert max(worst.values()) < 1e-3, worst


@pairings
@coverings
def test_elements(pairing, covered):
    """The same points of the slave facet, projected: equal to round-off."""
    p = random_pairing(*pairing, 8, covered=covered, distort=0.02)
    degree = 8
    rule = slave_rule(pairing[0], degree)
    points = oracle.element_points(p.slave, p.master, {pairing[0]: rule})
    for multiplier in oracle.MULTIPLIERS:
        flags = edge_flags(pairing[0], multiplier, covered)
        reference = oracle.mortar(
            p.slave, p.master, multiplier, facet_points=points, nonnegative=flags
        )
        ours = p.integrate(multiplier, "element", degree=degree, nonnegative=flags)
        assert ours["area"] == pytest.approx(reference.area[0], rel=1e-12)
        worst = differences(ours, quantities(reference))
        assert max(worst.values()) < 1e-9, (multiplier, worst)


def slave_rule(kind, degree):
    """The library's rule on a slave facet: from the points of a plane facet that is all covered."""
    reference = oracle.REFERENCE_NODES[kind]
    x = np.ascontiguousarray(np.column_stack([reference, np.zeros(len(reference))]))
    master = oracle.patch("quad4", (1, 1), lower=(-2, -2), upper=(3, 3), outward=-1)
    r = cpp.pair_points(
        TYPE[kind],
        1,
        x,
        TYPE["quad4"],
        int(master.sign[0]),
        in_facet_order(master),
        INTEGRATION["element"],
        degree,
        False,
    )
    return r.xi, r.w


@multipliers
def test_reversed_facets(multiplier):
    """Numbering a facet the other way round, with the opposite sense, changes nothing."""
    p = random_pairing("quad9", "tri6", 9)
    r = p.integrate(multiplier)
    order = [0, 2, 1, 3, 5, 4, 7, 6, 8]
    x, sign = p.slave.x[order], -p.slave.sign
    p.slave = oracle.Surface(x, p.slave.facets, sign)
    s = p.integrate(multiplier)
    scale = np.abs(r["M"]).max()
    assert np.abs(s["M"] - r["M"][order]).max() < 1e-12 * scale
    assert np.abs(s["D"] - r["D"][np.ix_(order, order)]).max() < 1e-12 * scale


@multipliers
def test_rigid_motion(multiplier):
    """Turned and moved together the facets have the same D, M and gap."""
    q, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    q *= np.sign(np.linalg.det(q))
    for pairing in PAIRINGS[::6]:
        p = random_pairing(*pairing, 10, covered=False)
        flags = edge_flags(pairing[0], multiplier, covered=False)
        r = p.integrate(multiplier, nonnegative=flags)
        for side in ("slave", "master"):
            s = getattr(p, side)
            setattr(p, side, oracle.Surface(s.x @ q.T + [3, -2, 5], s.facets, s.sign))
        t = p.integrate(multiplier, nonnegative=flags)
        scale = np.abs(r["M"]).max()
        for name in ("D", "M", "gap"):
            assert np.abs(t[name] - r[name]).max() < 1e-11 * scale
        assert np.abs(t["jump"] - r["jump"] @ q.T).max() < 1e-11 * scale


def test_facets_that_face_the_same_way_do_not_meet():
    p = random_pairing("quad8", "quad8", 12)
    p.master.sign = -p.master.sign
    for integration in ("segment", "element"):
        assert not p.integrate("dual", integration)["covered"]
