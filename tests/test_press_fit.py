# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""A press fit on coarse meshes against Lamé's closed solution."""

import pytest
from demo_loader import load_demo

pytest.importorskip("gmsh")


@pytest.fixture(scope="module")
def demo():
    return load_demo("demo_press_fit")


@pytest.mark.parametrize("way", ["offset", "overlap", "temperature"])
def test_pressure_is_that_of_lame(demo, way):
    """The shape of coarse quadratic arcs costs some parts in a thousand of the interference."""
    assert demo.lame_pressure() == pytest.approx(33.375, rel=1e-4)
    demo.measure(way, (5.0, 4.0))
    result = demo.results[-1]
    assert result["multiplier"] == "dual-linear"
    assert abs(result["force_error"]) < 0.01
    assert abs(result["mean_pressure_error"]) < 0.01
    assert result["largest_error"] < 0.03
    assert result["newton_iterations"] < 6
