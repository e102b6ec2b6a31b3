# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Hertz's problem on coarse meshes: largest pressure, contact radius and force."""

import functools

import dolfinx_mortar as dm
import numpy as np
import pytest
from demo_loader import load_demo

pytest.importorskip("gmsh")


@pytest.fixture(scope="module")
def demo():
    return load_demo("demo_hertz")


@pytest.fixture(scope="module")
def measured(demo):
    """Results and forces on slave and master, for an element and a material."""

    @functools.cache
    def measure(element, material):
        _, contact = demo.measure(element, material, 0.2, 1)
        return demo.results[-1], contact.force, contact.master_force

    return measure


@pytest.mark.parametrize("material", ["neo-hooke", "st-venant-kirchhoff", "linear"])
def test_pressure_and_radius(demo, measured, material):
    """3.2 cells along the radius: within 1.5 % of the references, the radius by a facet."""
    result, force, master_force = measured("hex20", material)
    largest, radii = demo.REFERENCE[material, 0.2]
    assert result["lambda_max"] == pytest.approx(largest, rel=0.015)
    assert abs(result["contact_radius"] - np.mean(radii)) < result["h"]
    assert result["smallest_pressure"] > 0
    assert result["force_error"] < 1e-8
    assert result["newton_iterations"] <= 5
    assert np.abs(force + master_force).max() < 1e-10 * force[2]


def test_first_step_opens_no_nodes(demo):
    """What it leaves of gaps is no traction; with c_n as large as the stiffness it takes 6."""
    demo.measure("hex20", "neo-hooke", 0.2, 2)
    assert demo.results[-1]["newton_iterations"] <= 4


@pytest.mark.parametrize("p", [0.0125, 0.05, 0.2])
def test_hertz_curve(demo, p):
    """Linear material, loads in the ratio 1 : 4 : 16: Hertz's pressure at all nodes, force, radius.

    Meshes are alike in units of Hertz's radius, which is 5 to 13 % of the hemisphere's, so that the
    hemisphere is nearly the half space of the theory.
    """
    domain, tags, h = demo.levelled_mesh("hex20", p, 1, False)
    u, contact, _, _ = demo.solve(domain, tags, "hex20", "linear", p)
    largest, rho = demo.hertz(p)
    r, pressure, active = demo.nodal_values(u, contact).T
    inside = r < rho - h  # further out the facet with the kink at the edge has its share
    assert np.count_nonzero(inside) > 10
    curve = largest * np.sqrt(1 - (r[inside] / rho) ** 2)
    assert np.abs(pressure[inside] - curve).max() < 0.05 * largest
    assert pressure.max() == pytest.approx(largest, rel=0.01)
    assert abs((r[active > 0].max() + r[active == 0].min()) / 2 - rho) < h
    # The mesh is a quarter
    assert contact.force[2] == pytest.approx(np.pi * demo.R**2 * p / 4, rel=1e-3)


@pytest.mark.parametrize("material", ["linear", "neo-hooke"])
def test_rigid_plane(demo, material):
    """A tool in place of the body of one cell: the same force, and pressures as near to Hertz's."""
    p, largest = 0.2, demo.REFERENCE[material, 0.2][0]
    domain, tags, h = demo.levelled_mesh("hex20", p, 1, False)
    plane = dm.RigidPlane((0, 0, 0), (0, 0, 1))
    found = [
        demo.solve(domain, tags, "hex20", material, p, master=master)
        for master in (demo.MASTER, plane)
    ]
    force = np.pi * demo.R**2 * p / 4  # the mesh is a quarter, its top no exact disc
    for u, contact, _, iterations in found:
        _, pressure, _ = demo.nodal_values(u, contact).T
        assert pressure.max() == pytest.approx(largest, rel=0.015)
        assert contact.force[2] == pytest.approx(force, rel=1e-3)
        assert iterations < 10
    body, tool = (contact.force for _, contact, _, _ in found)
    assert tool[2] == pytest.approx(body[2], rel=1e-9)
    # The body's contact has the slave's normals, which lean outwards
    np.testing.assert_allclose(tool[:2], 0, atol=1e-9 * tool[2])
    np.testing.assert_allclose(plane.force, -tool, rtol=1e-12)


@pytest.mark.parametrize("element", ["hex8", "hex27", "tet10"])
def test_elements(measured, element):
    result, *_ = measured(element, "neo-hooke")
    assert result["lambda_max"] == pytest.approx(18.533, rel=0.02)
    assert abs(result["contact_radius"] - 1.024) < result["h"]
    assert result["force_error"] < 1e-8
    assert result["newton_iterations"] < 10


def test_whole_hemisphere_is_four_quarters(demo):
    demo.measure("hex20", "neo-hooke", 0.2, 0)
    quarter = demo.results[-1]
    demo.measure("hex20", "neo-hooke", 0.2, 0, full=True)
    full = demo.results[-1]
    assert full["lambda_max"] == pytest.approx(quarter["lambda_max"], rel=1e-8)
    assert full["contact_radius"] == pytest.approx(quarter["contact_radius"], rel=1e-8)


def test_quadratic_convergence(measured):
    """The residual at the end is about the square of the one before."""
    result, *_ = measured("hex20", "neo-hooke")
    before, last = result["residuals"][-2:]
    assert before < 1e-4
    assert last < 10 * before**2 + 1e-13
