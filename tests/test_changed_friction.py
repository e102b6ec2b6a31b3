# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""What may change between solves, and what may not: friction, interfaces, geometry."""

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import pytest
from dolfinx import fem
from pressed import pressed
from test_bad_input import fails

comm = MPI.COMM_WORLD
STEPS = ((0.0, -0.01), (0.02, -0.01), (0.05, -0.01))


def constant(value):
    """A constant like those of forms; its mesh does not matter."""
    domain = pressed(dm.Contact).problem.u[0].function_space.mesh
    return fem.Constant(domain, value)


def drag(p, coefficients=None, name="friction"):
    """Norms and force after each step; the coefficients are set before the steps."""
    results = []
    for k, (x, z) in enumerate(STEPS):
        if coefficients is not None:
            setattr(p.interface, name, coefficients[k])
        p.move(x, z)
        results.append([*p.norms(), *np.abs(p.interface.force[[0, 2]])])
    return np.array(results)


def test_constant_is_the_number():
    expected = drag(pressed(dm.Contact, friction=0.3))
    p = pressed(dm.Contact, friction=constant(0.3))
    assert np.allclose(drag(p), expected, rtol=1e-9)
    assert isinstance(p.interface.friction, fem.Constant)
    expected = drag(pressed(dm.Contact, tresca=20.0))
    assert np.allclose(drag(pressed(dm.Contact, tresca=constant(20.0))), expected, rtol=1e-9)


def test_changed_constant_is_the_changed_number():
    values = (0.1, 0.4, 0.2)
    expected = drag(pressed(dm.Contact, friction=0.1), values)
    mu = constant(0.0)
    p = pressed(dm.Contact, friction=mu)
    results = []
    for (x, z), value in zip(STEPS, values, strict=True):
        mu.value = value
        p.move(x, z)
        results.append([*p.norms(), *np.abs(p.interface.force[[0, 2]])])
    assert np.allclose(results, expected, rtol=1e-9)
    # All of it slides in the end: Coulomb's law, but for the tilt of the deformed surfaces
    assert np.isclose(results[-1][2], 0.2 * results[-1][3], rtol=5e-3)


def test_friction_that_comes_and_goes():
    """Without friction there is no drag; with it again, the motion since then counts."""
    p = pressed(dm.Contact)
    results = drag(p, (0.0, 0.3, None))
    assert results[1, 2] > 0.1 * results[1, 3]
    assert results[0, 2] < 1e-3 * results[0, 3] and results[2, 2] < 1e-3 * results[2, 3]
    assert np.allclose(results[2], drag(pressed(dm.Contact))[2], rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("value", [-1, np.nan, np.inf, "0.3", [0.3]])
def test_coefficients_that_cannot_be(value):
    p = pressed(dm.Contact, friction=0.3)
    for name in ("friction", "tresca"):
        fails(lambda name=name: setattr(p.interface, name, value), name)
    assert p.interface.friction == 0.3 and p.interface.tresca is None


@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_constant_that_cannot_be(value):
    """Found when the solve begins, which leaves all as it was."""
    mu = constant(0.3)
    p = pressed(dm.Contact, friction=mu)
    p.move(0.0, -0.01)
    before = p.norms()
    mu.value = value
    fails(lambda: p.move(0.02, -0.01), "friction")
    assert np.array_equal(p.norms(), before)
    mu.value = 0.3
    p.move(0.02, -0.01)
    fails(lambda: pressed(dm.Contact, friction=constant((0.1, 0.2))), "scalar")


def test_both_laws_at_once():
    p = pressed(dm.Contact, friction=0.3)
    p.interface.tresca = 1.0
    fails(lambda: p.move(0.0, -0.01), "not both")
    p.interface.friction = None
    p.move(0.0, -0.01)


def test_interfaces_and_geometry_stay():
    p = pressed(dm.Contact)
    assert p.problem.interfaces == (p.interface,)
    assert not hasattr(p.problem.interfaces, "append")
    for owner, name in ((p.problem, "interfaces"), (p.interface, "geometry")):
        with pytest.raises(AttributeError):
            setattr(owner, name, [])
    with pytest.raises(AttributeError):
        p.interface.multiplier_space = "standard"


@pytest.mark.parametrize(
    ("returned", "words"),
    [
        (lambda n: None, "None"),
        (lambda n: np.ones(n + 1, bool), "shape"),
        (lambda n: np.ones((3, n), bool), "shape"),
        (lambda n: np.full(n, 0.5), "float64"),
        (lambda n: np.arange(n) + 7, "int64"),
        (lambda n: True, "shape ()"),
    ],
)
def test_flags_that_are_none(returned, words):
    p = pressed(dm.Contact, initial_active=lambda x: returned(x.shape[1]))
    fails(lambda: p.move(0.0, -0.01), "initial_active", words, "flags")
    assert not any(u.x.array.any() for u in p.problem.u)


def test_flags_that_are_some():
    """Flags of any kind, for the positions that a rank has."""
    for kind in (np.asarray, list, lambda flags: flags.astype(int)):
        p = pressed(dm.Contact, initial_active=lambda x, kind=kind: kind(x[2] < 2))
        p.move(0.0, -0.01)
        assert p.interface.num_active > 0
