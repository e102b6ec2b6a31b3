# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Contacts in numbers, nodal forces, reactions and load steps."""

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import pytest
from pressed import pressed
from test_bad_input import fails

comm = MPI.COMM_WORLD


def test_before_the_first_solve():
    p = pressed(dm.Contact)
    for action in (p.interface.summary, p.interface.nodal_forces, p.problem.report):
        fails(action, "no solution yet")
    fails(lambda: p.problem.reaction(p.problem.bcs[0]), "no solution yet")


@pytest.mark.parametrize("elements", [("hex8", "hex8"), ("tet10", "hex20")], ids="-".join)
def test_summary(elements):
    p = pressed(dm.Contact, elements=elements, friction=0.3)
    p.move(0.0, -0.01)
    p.move(0.005, -0.01)
    c, s = p.interface, p.interface.summary()
    np.testing.assert_allclose(s["force"], c.force, rtol=1e-12)
    last = p.problem.history[-1]
    assert (s["stick"], s["slip"]) == (last["stick"], last["slip"])
    assert s["open"] + s["stick"] + s["slip"] == c.num_multiplier_nodes
    assert s["dissipation"] == pytest.approx(c.dissipation)
    # The whole bottom of the upper block, 0.6 by 0.6, is in contact
    assert s["open"] == 0
    assert s["area"] == pytest.approx(0.36, rel=0.02)
    assert s["mean_pressure"] * s["area"] == pytest.approx(c.force[2], rel=0.02)
    assert s["largest_pressure"] >= s["mean_pressure"] > 0
    assert np.abs(s["centre"] - (0.505, 0.5, 1.0)).max() < 0.03
    # Averages around nodes are zero: what overlaps is little
    assert 0 <= s["penetration"] < 0.1 * 0.01


@pytest.mark.parametrize(("geometry", "left"), [("current", 1e-3), ("reference", 1e-9)])
def test_penetration_is_what_is_left(geometry, left):
    """Bodies that overlap by 0.01 at first: between points of facets little, in averages none."""
    p = pressed(dm.Contact, geometry=geometry, offset=-0.01)
    p.move(0.0, 0.0)
    assert p.interface.force[2] > 1.0
    assert p.interface.summary()["penetration"] < left


def test_nodal_forces_and_reactions():
    """Those on both bodies have the resultants; a support carries what contact hands over."""
    p = pressed(dm.Contact, elements=("hex20", "hex8"), friction=0.3)
    p.move(0.0, -0.01)
    p.move(0.005, -0.01)
    c = p.interface
    forces = [
        comm.allreduce(
            f.x.array.reshape(-1, 3)[: f.function_space.dofmap.index_map.size_local].sum(axis=0)
        )
        for f in c.nodal_forces()
    ]
    np.testing.assert_allclose(forces[0], c.force, rtol=0, atol=1e-12 * np.abs(c.force).max())
    np.testing.assert_allclose(forces[1], c.master_force, rtol=0, atol=1e-12 * c.force[2])
    held = sum(p.problem.reaction(bc) for bc in p.problem.bcs)
    assert np.abs(held).max() < 1e-7 * c.force[2]
    top = [p.problem.reaction(bc) for bc in p.problem.bcs]
    assert max(t[2] for t in top) == pytest.approx(c.force[2], rel=1e-6)
    assert min(t[2] for t in top) == pytest.approx(-c.force[2], rel=1e-6)


def test_report():
    p = pressed(dm.Contact)
    p.move(0.0, -0.01)
    head, row = p.problem.report().split("\n")
    assert "overlap" in head and len(head) == len(row)
    assert f"{p.interface.force[2]:.4g}" in row


def test_steps(capsys):
    p = pressed(dm.Contact, friction=0.2)
    seen = []

    def load(t):
        seen.append(t)
        p.top.value[:] = 0.01 * t, 0.0, -0.01 * t

    ends = []
    for t in p.problem.steps(4, load):
        ends.append(t)
        assert p.interface.force[2] > 0
    assert ends == seen == [0.25, 0.5, 0.75, 1.0]
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == (4 if comm.rank == 0 else 0)
    assert all("left" in line for line in lines)


def test_steps_are_cut(capsys):
    """Too large a step is taken in halves."""
    p = pressed(dm.Contact)
    seen = []

    def load(t):
        seen.append(t)
        jump = max((t - max([s for s in seen[:-1] if s < t], default=0.0)) - 0.26, 0.0)
        p.top.value[:] = 0.0, 0.0, -0.01 * t if jump == 0 else np.nan

    assert list(p.problem.steps(1, load)) == [1.0]
    assert 1.0 in seen and min(seen) <= 0.25
    out = capsys.readouterr().out
    assert ("parts" in out) == (comm.rank == 0)
