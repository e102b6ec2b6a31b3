# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Interferences and clearances: what is added to the gap of a contact."""

from mpi4py import MPI

import dolfinx_mortar as dm
import nodal
import numpy as np
import oracle
import pytest
import ufl
from blocks import E
from dolfinx import fem
from facet_pairs import PAIRINGS, edge_flags, random_pairing
from press_fit import press_fit
from pressed import pressed
from test_bad_input import fails

comm = MPI.COMM_WORLD


@pytest.mark.serial
@pytest.mark.parametrize("pairing", PAIRINGS, ids="-".join)
@pytest.mark.parametrize("multiplier", oracle.MULTIPLIERS)
def test_weighted_gap(pairing, multiplier):
    """It grows by ∫ Φ_j Σ N_k offset_k = Σ D_jk offset_k; nothing else changes."""
    p = random_pairing(*pairing, 11, covered=False, distort=0.04)
    offset = np.random.default_rng(3).normal(size=len(p.slave.x))
    same = {"nonnegative": edge_flags(pairing[0], multiplier, covered=False)}
    without = p.integrate(multiplier, **same)
    with_offset = p.integrate(multiplier, offset=offset, **same)
    expected = without["gap"] + without["D"] @ offset
    np.testing.assert_allclose(with_offset["gap"], expected, rtol=0, atol=1e-13)
    for name in ("D", "M", "jump"):
        np.testing.assert_array_equal(with_offset[name], without[name])


@pytest.mark.parametrize("geometry", ["current", "reference"])
@pytest.mark.parametrize("offset", [-0.01, 0.02])
def test_same_as_a_body_that_is_moved(geometry, offset):
    """Top held, with an offset: forces as with a top that is moved by as much."""
    p = pressed(dm.Contact, geometry=geometry, offset=offset)
    p.move(0.0, -0.03)
    moved = pressed(dm.Contact, geometry=geometry)
    moved.move(0.0, -0.03 + offset)
    force, expected = p.interface.force[2], moved.interface.force[2]
    assert force > 1.0
    assert force == pytest.approx(expected, rel=2e-2)
    # What is between the bodies is the offset
    assert np.all(np.abs(p.interface.gap.x.array) < 1e-9)


def test_kinds_of_offsets():
    """A number, a constant, an expression and a function that mean the same; changed between."""
    given = {}
    for kind in ("number", "constant", "expression", "function"):
        p = pressed(dm.Contact, elements=("hex20", "hex8"))
        V = p.problem.u[0].function_space
        W = p.interface.gap.function_space
        c = fem.Constant(V.mesh, -0.004)
        if kind == "function":
            f = fem.Function(W)
            f.x.array[:] = -0.004
        p.interface.offset = {
            "number": -0.004,
            "constant": c,
            "expression": c + 0 * ufl.SpatialCoordinate(V.mesh)[0],
            "function": None if kind != "function" else f,
        }[kind]
        p.move(0.0, 0.0)
        first = p.interface.force[2]
        c.value = -0.008
        if kind == "number":
            p.interface.offset = -0.008
        if kind == "function":
            f.x.array[:] = -0.008
        p.move(0.0, 0.0)
        given[kind] = [first, p.interface.force[2]]
        p.interface.offset = None
        p.move(0.0, 0.0)
        assert abs(p.interface.force[2]) < 1e-6 * first
    for values in given.values():
        np.testing.assert_allclose(values, given["number"], rtol=1e-9)
    assert given["number"][1] > 1.8 * given["number"][0] > 0


def test_offset_that_varies():
    """A wedge: what is between the surfaces, as an average around a node, is the offset there."""
    p = pressed(dm.Contact, elements=("hex27", "hex8"))
    x = ufl.SpatialCoordinate(p.problem.u[0].function_space.mesh)
    p.interface.offset = -0.01 * (1 + x[0])
    p.move(0.0, 0.0)
    c, n = p.interface, nodal.number(p.interface)
    assert c.force[2] > 1.0 and np.all(c.state.status[:n] > 0)
    apart = np.array(c.evaluation.nodal.jump).reshape(-1, 3)[:n, 2] / nodal.weights(c)
    np.testing.assert_allclose(apart, 0.01 * (1 + nodal.positions(c)[:, 0]), rtol=5e-3)


def test_press_fit_by_overlap_and_by_offset():
    """Radii that overlap, or equal ones and an offset."""
    preload = 0.01
    overlap, first = press_fit(True, preload)
    overlap.solve()
    offset, second = press_fit(True, 0.0, offset=-preload)
    offset.solve()
    pressures = []
    for contact in (first, second):
        active = nodal.has_multiplier(contact)
        z = np.linalg.norm(nodal.multipliers(contact)[active], axis=1)
        total = comm.allreduce(float(z.sum())), comm.allreduce(len(z))
        pressures.append(total[0] / total[1])
    assert pressures[0] > 1e-4 * E
    assert pressures[1] == pytest.approx(pressures[0], rel=2e-2)


def test_saved_with_the_state(tmp_path):
    p = pressed(dm.Contact, offset=-0.01, friction=0.2)
    p.move(0.0, 0.0)
    p.problem.save(tmp_path / "state")
    p.move(0.01, 0.0)
    q = pressed(dm.Contact, offset=-0.01, friction=0.2)
    q.problem.load(tmp_path / "state")
    q.move(0.01, 0.0)
    np.testing.assert_allclose(q.norms(), p.norms(), rtol=1e-9)


def test_offsets_that_cannot_be():
    p = pressed(dm.Contact)
    domain = p.problem.u[0].function_space.mesh
    for wrong in ("0.1", np.nan, np.inf, [0.1, "a"]):
        fails(lambda w=wrong: pressed(dm.Contact, offset=w), "offset")
    fails(lambda: pressed(dm.Contact, offset=ufl.SpatialCoordinate(domain)), "scalar")
    p.interface.offset = [0.1, 0.2]
    fails(lambda: p.move(0.0, -0.01), "one part for each")
    other = pressed(dm.Contact).problem.u[0].function_space.mesh
    p.interface.offset = 0.1 * ufl.SpatialCoordinate(other)[0]
    fails(lambda: p.move(0.0, -0.01), "another mesh")
    p.interface.offset = fem.Function(p.interface.gap.function_space)
    p.interface.offset.x.array[:] = np.nan
    with pytest.raises(RuntimeError, match="not finite"):
        p.move(0.0, -0.01)
