# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Line searches and lagged Jacobians lead where full Newton steps lead."""

import dolfinx_mortar as dm
import numpy as np
import pytest
from pressed import pressed

STEPS = ((0.0, -0.01), (0.03, -0.02), (0.05, -0.03))


def norms(**options):
    p = pressed(dm.Contact, **options)
    return np.array([(p.move(x, z), *p.norms())[1:] for x, z in STEPS])


@pytest.fixture(scope="module")
def expected():
    """Norms after full Newton steps, for elements and friction."""
    found = {}

    def of(elements, friction):
        if (elements, friction) not in found:
            found[elements, friction] = norms(elements=elements, friction=friction)
        return found[elements, friction]

    return of


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize(
    "elements", [("hex8", "hex8"), pytest.param(("hex20", "hex8"), marks=pytest.mark.serial)]
)
@pytest.mark.parametrize("kind", ["bt", "l2", "nleqerr"])
def test_line_search(kind, elements, friction, expected):
    options = {"snes_linesearch_type": kind}
    found = norms(elements=elements, friction=friction, petsc_options=options)
    assert np.allclose(found, expected(elements, friction), rtol=1e-8)


@pytest.mark.parametrize("elements", [("hex8", "hex8"), ("hex20", "hex8")])
def test_lagged_jacobian(elements, expected):
    """The system outlives the matrices that it was made of."""
    found = norms(elements=elements, friction=0.0, petsc_options={"snes_lag_jacobian": 2})
    assert np.allclose(found, expected(elements, 0.0), rtol=1e-8)


def test_jacobian_of_long_ago():
    """A system of the first iterations corrects gaps of the later ones as far as they are."""
    found = []
    for lag in (1, 10):
        p = pressed(dm.Contact, petsc_options={"snes_lag_jacobian": lag, "snes_max_it": 100})
        p.move(0.3, -0.1)
        found.append(p.norms())
    assert np.allclose(*found, rtol=1e-8)


def test_measure_of_gaps_is_that_of_a_line_search():
    """Gaps are measured alike, however large c_n is in the first iterations."""
    histories = []
    for kind in ("basic", "bt"):
        p = pressed(dm.Contact, petsc_options={"snes_linesearch_type": kind})
        p.move(0.3, -0.1)
        histories.append(p.problem.history)
    full, searched = (h[1] for h in histories)
    assert full["step"] == 1 and searched["step"] == pytest.approx(1)
    assert full["constraint"] > 0.1
    assert full["constraint"] == pytest.approx(searched["constraint"], rel=1e-6)


def test_history_has_the_length_of_the_step():
    """Of what the line search has made of Newton's."""
    p = pressed(dm.Contact, petsc_options={"snes_linesearch_type": "l2"})
    p.move(0.0, -0.01)
    assert [h["step"] for h in p.problem.history[:1]] == [0.0]
    assert np.allclose([h["step"] for h in p.problem.history[1:]], 1.0, rtol=0.3)
    assert any(h["step"] not in (0.0, 1.0) for h in p.problem.history)


def test_iterative_solver_and_line_search(expected):
    options = {"snes_linesearch_type": "nleqerr", "pc_type": "gamg", "ksp_rtol": 1e-12}
    found = norms(elements=("hex20", "hex8"), friction=0.3, petsc_options=options)
    assert np.allclose(found, expected(("hex20", "hex8"), 0.3), rtol=1e-8)
