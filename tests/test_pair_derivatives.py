# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Derivatives of quadrature points and integrals of a slave facet, against finite differences.

The pairings are in general position, so that everything is smooth within the steps. One random
direction at a time: a wrong or missing term shows in any.
"""

import numpy as np
import oracle
import pytest
from dolfinx_mortar import cpp
from facet_pairs import PAIRINGS, Pairing, beyond_an_edge, edge_flags, random_pairing

pytestmark = pytest.mark.serial
pairings = pytest.mark.parametrize("pairing", PAIRINGS, ids="-".join)
integrations = pytest.mark.parametrize("integration", ["segment", "element"])
# From the smooth step the extrapolation goes down until round-off
STEP, LEVELS = 2e-4, 5


def moved(p, direction, h):
    n = len(p.slave.x)
    return Pairing(p.slave.moved(h * direction[:n]), p.master.moved(h * direction[n:]))


def generic(pairing, integration, covered=False):
    """A pairing that is covered in part, or as a whole, and smooth."""
    return random_pairing(
        *pairing, 11 if integration == "segment" else 7, covered=covered, distort=0.04
    )


def along(p, function, rng):
    """A random direction, shape (nodes, 3), and the converged difference quotient along it."""
    direction = rng.uniform(-1, 1, (len(p.slave.x) + len(p.master.x), 3))
    difference, _ = oracle.derivative(
        lambda h: function(moved(p, direction, float(h))),
        np.zeros(()),
        np.ones(()),
        STEP,
        LEVELS,
    )
    return direction, difference


def agree(ours, difference):
    return np.abs(ours - difference).max() < 1e-6 * np.abs(difference).max()


@pairings
@integrations
def test_points(pairing, integration):
    """Places on both facets and weights."""
    p = generic(pairing, integration)
    first = next(
        f for f in range(len(p.master.facets)) if len(only(p, f).points(integration, 3).w) > 0
    )
    p = only(p, first)
    rng = np.random.default_rng(1)
    r = p.points(integration, 3, derivatives=True)

    def table(q):
        r = q.points(integration, 3)
        return np.column_stack([r.xi, r.eta, r.w])

    # Each number of each point as a sum of its own
    n = 5 * len(r.w)
    d = r.differentiate(np.eye(n), len(p.slave.x), len(p.master.x)).T
    for _ in range(2):
        direction, difference = along(p, table, rng)
        assert agree((d @ direction.ravel()).reshape(-1, 5), difference)


def only(p, f):
    """The same slave facet with master facet f alone."""
    kind, nodes, x, sign = p.master.facet(f)
    return Pairing(p.slave, oracle.Surface(x, [(kind, np.arange(len(x)))], np.array([sign])))


@pairings
@integrations
@pytest.mark.parametrize("multiplier", oracle.MULTIPLIERS)
@pytest.mark.parametrize("left", [0, -1])
def test_integrals(pairing, integration, multiplier, left):
    """Contact force, weighted gap, position; one node shares its function, or is idle."""
    flags = edge_flags(pairing[0], multiplier, covered=False)
    p = generic(pairing, integration)
    check(p, multiplier, integration=integration, left=left, nonnegative=flags)


@pytest.mark.parametrize(
    "pairing", [p for p in PAIRINGS if p[0] in ("tri6", "quad8")], ids="-".join
)
@integrations
def test_corner_functions_of_whole_facets(pairing, integration):
    """Those of "dual-reproducing" where no edge is flagged: G is not symmetric then; and mixed."""
    n = len(oracle.REFERENCE_NODES[pairing[0]])
    p = generic(pairing, integration, covered=True)
    for flags in (None, np.arange(n, dtype=np.int8) % 2):
        check(p, "dual-reproducing", integration=integration, nonnegative=flags)


@pytest.mark.parametrize("kind", ["tri6", "quad8", "quad9"])
def test_points_left_out_beyond_an_edge(kind):
    """The same where the points beyond the slave facet are left out."""
    p = beyond_an_edge(kind)
    check(p, "dual", nonnegative=np.ones(len(p.slave.x), np.int8), degree=12)


def check(p, multiplier, left=0, **same):
    """Compare all derivatives of the integrals of a pairing with difference quotients."""
    rng = np.random.default_rng(2)
    n, m = len(p.slave.x), len(p.master.x)
    has_multiplier = np.ones(n, np.int8)
    has_multiplier[1] = left
    z = rng.normal(size=(n, 3))
    normals = np.array([0, 0, 1]) + 0.1 * rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    same["has_multiplier"] = has_multiplier
    same["offset"] = 0.1 * np.random.default_rng(3).normal(size=n)
    r = p.integrate(
        multiplier, normals=normals, z=z, derivatives=cpp.Derivatives.gap_and_slip, **same
    )
    assert r["covered"]
    blocks = np.array(r["master_blocks"])

    def values(q):
        s = q.integrate(multiplier, normals=normals, **same)
        return np.vstack([s["D"].T @ z, -s["M"].T @ z, s["gap"][:, None] * [1, 0, 0], s["jump"]])

    direction, difference = along(p, values, rng)
    d = np.vstack([direction[:n], direction[n:][blocks]]).ravel()
    force = np.zeros((n + m, 3))
    force[np.concatenate([np.arange(n), n + blocks])] = (r["d_force"] @ d).reshape(-1, 3)
    assert agree(force, difference[: n + m])
    assert agree(r["d_gap"] @ d, difference[n + m : 2 * n + m, 0])
    assert agree((r["d_jump"] @ d).reshape(-1, 3), difference[2 * n + m :])

    turn = rng.normal(size=(n, 3))
    difference, _ = oracle.derivative(
        lambda h: p.integrate(multiplier, normals=normals + h * turn, **same)["gap"],
        np.zeros(()),
        np.ones(()),
        STEP,
        LEVELS,
    )
    assert agree(r["d_gap_normal"] @ turn.ravel(), difference)


@integrations
def test_values_do_not_depend_on_derivatives(integration):
    """Asking for derivatives changes no value, up to round-off."""
    for pairing in PAIRINGS[::6]:
        p = generic(pairing, integration)
        plain = p.integrate("dual", integration)
        full = p.integrate("dual", integration, derivatives=cpp.Derivatives.gap_and_slip)
        for name in ("D", "M", "gap", "jump", "coverage"):
            assert np.allclose(plain[name], full[name], rtol=1e-12, atol=1e-15)
