# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Demos on coarse meshes: a pin against Persson's solution, a bolt and rubber against statics."""

import itertools

import numpy as np
import pytest
from demo_loader import load_demo

pytest.importorskip("gmsh")


@pytest.fixture(scope="module")
def pin():
    return load_demo("demo_pin")


@pytest.mark.parametrize("degrees", [1.0, 20.0, 40.0, 60.0, 80.0])
def test_closed_solution_of_the_pin(pin, degrees):
    """The pressure carries the load; small angles are Hertz's."""
    load = pin.load_at(degrees)
    assert pin.resultant(degrees) == pytest.approx(load, rel=1e-10)
    if degrees < 2:
        stiffness = pin.E / (1 - pin.NU**2)
        hertz = np.sqrt(8 * load / (np.pi * stiffness * pin.CLEARANCE))
        assert np.radians(degrees) == pytest.approx(hertz, rel=1e-3)
        largest = 2 * load / (np.pi * pin.R * hertz)
        assert pin.persson(degrees, 0.0) == pytest.approx(largest, rel=1e-3)


@pytest.mark.slow
def test_pin(pin):
    """Cells of 5 degrees: half-angle, largest pressure and profile within a few hundredths."""
    p, load = pin.problem(5.0)
    r = pin.measure(p, load, 50.0)
    assert abs(r["force_error"]) < 1e-4
    assert r["found_half_angle"] == pytest.approx(50.0, rel=0.02)
    assert abs(r["largest_pressure_error"]) < 0.015
    assert r["profile_error"] < 0.03
    assert r["newton_iterations"] < 15


@pytest.mark.slow
def test_bolt():
    """The preload is reached; slip begins, and ends in Coulomb's bound of both interfaces."""
    demo = load_demo("demo_bolt")
    j = demo.Joint(4.5, 0.2)
    preload = j.tighten(demo.PRELOAD)
    assert preload == pytest.approx(demo.PRELOAD, rel=1e-3)
    states = [demo.measure(j), *demo.pull(j, (0.006, 0.03, 0.06, 0.08))]
    for s in states:
        assert abs(s["balance"]) < 1e-6 * preload
        assert s["used"] < 1.001
    # It sticks at first, and its stiffness falls when the plates slip, and when the head does
    assert states[1]["stick"]["plates"] > 0 and states[1]["stick"]["head"] > 0
    slopes = [
        (b["pull"] - a["pull"]) / (b["displacement"] - a["displacement"])
        for a, b in itertools.pairwise(states)
    ]
    assert slopes[0] > 1.5 * slopes[1] > 0 and slopes[-1] < 0.1 * slopes[0]
    measured, bound = demo.slip_load(j, states)
    assert measured == pytest.approx(bound, rel=3e-3)
    assert measured == pytest.approx(2 * 0.2 * preload, rel=0.1)


@pytest.mark.slow
def test_rubber():
    """The press carries what contact does, and the cylinder, which keeps its volume, bulges."""
    demo = load_demo("demo_rubber")
    p, press, top = demo.problem(0.3, 0.5)
    (contact,), forces = p.interfaces, []

    def load(t):
        press.value[2] = -0.1 * t

    for _ in p.steps(4, load, progress=False):
        s = contact.summary()
        np.testing.assert_allclose(p.reaction(top)[2], -s["force"][2], rtol=1e-8)
        np.testing.assert_allclose(contact.master_force, -s["force"], atol=1e-10 * s["force"][2])
        forces.append(s["force"][2])
        assert s["stick"] + s["slip"] > 0
    # Young's modulus is 2.8; glued above and held below it is stiffer, up to the fourth step
    assert np.all(np.diff(forces) > 0)
    uniaxial = np.pi / 4 * 2.8125 * 0.1
    assert uniaxial < forces[-1] < 1.6 * uniaxial
