# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""A rubber block (hex20) dragged over a steel plate (tet10), forth and back: against statics."""

import numpy as np
import pytest
from demo_loader import load_demo


@pytest.fixture(scope="module")
def demo():
    return load_demo("demo_drag")


def test_drag_and_back(demo):
    path, ends = demo.motion(short=(4, 5), long=(4, 3))
    steps = demo.drag(0, 0.3, path)["steps"]

    # Everything slides at the end of each way, and statics knows the force
    for end, sign in zip(ends[1:], (1, -1), strict=True):
        r = steps[end - 1]
        assert r["stick"] == 0 and r["slip"] == r["active"] > 0
        assert r["ratio"] == pytest.approx(sign, abs=1e-6)
        travel = r["displacement"] - steps[end - 2]["displacement"]
        assert r["dissipation"] == pytest.approx(r["drag_force"] * travel, rel=1e-4)
    # Coulomb's bound holds in all steps, and sliding brings each node's traction into line with
    # the motion, so that the drag comes nearer to it with each of them
    assert max(abs(s["ratio"]) for s in steps) < 1 + 1e-10
    pressed, turn = ends[0], ends[1]
    for part in (steps[pressed:turn], steps[turn:]):
        left = np.array([1 - abs(s["ratio"]) for s in part if s["stick"] == 0])
        assert len(left) > 3 and left[0] < 0.02
        assert np.all(left[1:] < left[:-1] / 3)
    # Before, the drag grows from nothing, while the zone that sticks shrinks
    assert abs(steps[pressed - 1]["ratio"]) < 1e-6
    for part in (steps[pressed:turn], steps[turn:]):
        sticking = [s for s in part if s["stick"] > 0]
        assert len(sticking) > 1
        assert max(abs(s["ratio"]) for s in sticking) < 0.999
        assert np.all(np.diff([s["stick"] for s in part]) <= 0)
    assert steps[turn]["stick"] > 0.8 * steps[turn]["active"]  # it sticks again

    for s in steps:
        assert s["outside_cone"] < 1e-8
        assert s["along_traction"] < 1e-12
        assert s["balance"] < 1e-8
        assert s["dissipation"] > 0
        assert s["newton_iterations"] < 12
    # Quadratic: the last residual is about the square of the one before
    before, last = steps[ends[1] - 2]["residuals"][-2:]
    assert last < 10 * before**2 + 1e-13
