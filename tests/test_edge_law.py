# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Contact conditions of a node that is closed on several patches at once."""

import numpy as np
import pytest
from dolfinx_mortar import cpp

pytestmark = pytest.mark.serial

STICK, SLIP = 1, 2
C_N, C_T = 70.0, 50.0


def state(seed, patches=2):
    """Nearly orthogonal normals, tractions around pressure, some slip."""
    rng = np.random.default_rng(seed)
    n = -np.eye(3)[:patches] + 0.2 * rng.standard_normal((patches, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    z = 10 * n + 3 * rng.standard_normal((patches, 3))
    return {
        "z": z,
        "n": n,
        "g": -0.01 * rng.random(patches),
        "w": 0.05 * rng.standard_normal((patches, 3)),
    }


def residual(s, friction=None, tresca=None, damped=False, fixed=None):
    m = len(s["n"])
    return cpp.contact_residual(
        s["z"],
        s["n"],
        s["g"],
        s["w"],
        np.full(m, 2.0),
        np.full(m, C_N),
        np.full(m, C_T),
        np.ones(m, dtype=np.int8),
        np.zeros((m, 3), dtype=np.int8) if fixed is None else fixed,
        friction or 0.0,
        tresca,
        [],
        damped,
        None,
        np.zeros(m, dtype=np.int64),
    )


def derivative(r, name):
    """Derivative of all residuals by all values, shape (3 m, columns m)."""
    own, other = (getattr(a, "d" + name) for a in (r, r.couplings))
    own, other = (a[:, :, None] if a.ndim == 2 else a for a in (own, other))
    m, c = len(own), own.shape[2]
    J = np.zeros((m, 3, m, c))
    for i in range(m):
        J[i, :, i, :] = own[i]
    for i, j, block in zip(r.couplings.rows, r.couplings.columns, other):
        J[i, :, j, :] = block
    return J.reshape(3 * m, c * m)


def difference(s, name, **law):
    columns = []
    for k in range(s[name].size):
        f = []
        for h in (1e-6, -1e-6):
            moved = s | {name: s[name].copy()}
            moved[name].flat[k] += h
            f.append(residual(moved, **law).value.ravel())
        columns.append((f[0] - f[1]) / 2e-6)
    return np.stack(columns, axis=1)


LAWS = {
    "stick": {"friction": 5.0},
    "slip": {"friction": 0.005},
    "tresca stick": {"tresca": 80.0},
    "tresca slip": {"tresca": 0.02},
    "frictionless": {},
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("patches", [2, 3])
def test_derivatives(law, patches):
    for seed in range(5):
        s = state(seed, patches)
        r = residual(s, **LAWS[law])
        assert np.all(r.status > 0)
        if law != "frictionless" and patches == 2:
            assert np.all(r.status == (STICK if "stick" in law else SLIP))
            assert len(r.couplings.rows) == 2
        for name in ("z", "n", "w", "g"):
            exact = derivative(r, name)
            error = np.abs(exact - difference(s, name, **LAWS[law])).max()
            assert error < 1e-7 * max(np.abs(exact).max(), 1.0), name


def test_what_the_law_says():
    """Slip: both tractions along the edge are at their bounds, against the motion."""
    s = state(1)
    friction = 0.1
    edge = np.cross(*s["n"])
    edge /= np.linalg.norm(edge)
    # Tractions that solve the conditions: closed gaps, motion along the edge
    s["g"] = np.zeros(2)
    s["w"] = np.outer([0.3, 0.4], -edge)
    pressure = np.array([8.0, 5.0])
    s["z"] = pressure[:, None] * s["n"] + friction * pressure[:, None] * edge
    r = residual(s, friction=friction)
    assert np.all(r.status == SLIP)
    assert np.abs(r.value).max() < 1e-12
    # Stick: no motion, traction within the cone, shared in proportion to the bounds
    s["w"] = np.zeros((2, 3))
    s["z"] = pressure[:, None] * s["n"] + 0.04 * pressure[:, None] * edge
    r = residual(s, friction=friction)
    assert np.all(r.status == STICK)
    assert np.abs(r.value).max() < 1e-12


def test_parallel_normals_close_once():
    """Two patches with the same normal cannot both hold a node."""
    s = state(2)
    s["n"][1] = s["n"][0]
    s["z"] = np.array([8.0, 5.0])[:, None] * s["n"]
    status = residual(s).status
    assert list(status > 0) == [True, False]


def test_no_friction_where_a_node_can_not_slide():
    """On three patches, and on an edge in a plane of symmetry."""
    s = state(3, 3)
    r = residual(s, friction=0.3)
    assert np.all(r.status == STICK)
    normal = np.sum(s["z"] * s["n"], axis=1)
    tangential = s["z"] - normal[:, None] * s["n"]
    assert np.allclose(r.value, tangential + C_N * s["g"][:, None] * s["n"])
