# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Frictional contact of bodies on two meshes with different elements: as long as all nodes stick
it is a tied interface, at any non-matching pairing, condensed or not, on any number of ranks."""

import blocks
import cases
import nodal
import numpy as np
import pytest

SECOND_ORDER = [(a, b) for a in ("tet10", "hex20", "hex27") for b in ("tet10", "hex20", "hex27")]
MIXED = [
    ("hex8", "tet10"),
    ("tet10", "hex8"),
    ("hex20", "hex8"),
    ("tet4", "hex20"),
    ("hex8", "tet4"),
]
FRICTION = 0.5

# Stress with a pressure of 10 and a shear of 3 on the interface: less than friction holds
STRESS = np.array([[-1.0, 0.0, 3.0], [0.0, 2.0, -1.0], [3.0, -1.0, -10.0]])


def strain():
    trace = np.trace(STRESS)
    return ((1 + blocks.NU) * STRESS - blocks.NU * trace * np.eye(3)) / blocks.E


def touching(slave, master):
    """Two blocks under the tractions of a constant stress; only contact holds the upper one."""
    case = blocks.stressed_blocks(slave, master, strain())
    tie = case.interfaces[0]
    case.interfaces = [cases.Interface("contact", tie.slave, tie.master, FRICTION)]
    return case


def solve(case, condense=None, **options):
    s = cases.make_problem(case, condense=condense, petsc_options={"snes_rtol": 1e-10}, **options)
    s.problem.solve()
    return s.u, s.contact, s.problem


def nodal_values(contact):
    """Normal and tangential multipliers and states of the owned nodes that carry one."""
    carries = nodal.has_multiplier(contact)
    z = nodal.multipliers(contact)[carries]
    normal = nodal.normals(contact)[carries]
    pressure = np.sum(z * normal, axis=1)
    return pressure, z - pressure[:, None] * normal, contact.state.status[carries]


@pytest.mark.parametrize("condense", [True, False], ids=["condensed", "saddle point"])
@pytest.mark.parametrize("pair", SECOND_ORDER + MIXED, ids="-".join)
def test_stick_is_tied(pair, condense):
    case = touching(*pair)
    u, contact, problem = solve(case, condense, initial_active="all")
    size = np.abs(strain()).max()
    assert cases.largest_error(case, u) < 1e-8 * size
    pressure, tangential, status = nodal_values(contact)
    assert np.all(status == 1)
    for values in (pressure, tangential):  # the same at all nodes
        assert np.abs(values - values[:1]).max(initial=0) < 1e-8 * 10
    assert contact.force[2] == pytest.approx(10, rel=1e-9)
    assert contact.force[0] == pytest.approx(-3, rel=1e-9)
    assert contact.dissipation == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("pair", [("hex20", "tet10"), ("hex27", "hex20")], ids="-".join)
def test_same_as_a_tie(pair):
    """Displacements, and multipliers at small deformation, are those of `Tie`."""
    case = touching(*pair)
    u, contact, _ = solve(case, geometry="reference", initial_active="all")
    case.interfaces[0].kind = "tie"
    v, tie, _ = solve(case)
    for a, b in zip(u, v, strict=True):
        assert np.abs(a.x.array - b.x.array).max(initial=0) < 1e-8 * np.abs(strain()).max()
    z, w = contact.multiplier.x.array, tie.multiplier.x.array
    assert np.abs(z - w).max(initial=0) < 1e-8 * 10


def dragged(slave, master):
    """A block that is pressed on another one and dragged over it, held at its top."""
    parts = [
        blocks.block("upper", slave, (0.1, 0.1, 1), (0.8, 0.8, 1.5), (2, 2, 1)),
        blocks.block("lower", master, (0, 0, 0), (1, 1, 1), (2, 3, 1)),
    ]
    faces = blocks.FACES
    move = cases.Dirichlet(
        0, lambda x: cases.near(1.5)(x[2]), value=lambda t: (0.02 * (t - 1), 0.004 * (t - 1), -0.01)
    )
    held = [move, cases.Dirichlet(1, lambda x: cases.near(0)(x[2]))]
    contact = cases.Interface(
        "contact", [(0, faces["z-"])], [(1, faces["z+"])], FRICTION, initially_active=False
    )
    return blocks.assemble(parts, [contact], held, times=(1.0, 2.0, 3.0))


@pytest.mark.parametrize(
    "pair", [("hex20", "tet10"), ("tet10", "hex8"), ("hex8", "hex27")], ids="-".join
)
def test_condensed_is_saddle_point(pair):
    """Also while some nodes stick and others slip the iterates are the same."""
    case = dragged(*pair)
    found = []
    for condense in (True, False):
        s = cases.make_problem(case, condense=condense)
        sets = []
        for t in case.times:
            s.step(t)
            sets += [(h["active"], h["stick"], h["slip"]) for h in s.problem.history]
        found.append((sets, s.u, s.contact.force))
    assert found[0][0] == found[1][0]
    assert any(stick and slip for _, stick, slip in found[0][0])
    for a, b in zip(found[0][1], found[1][1], strict=True):
        assert np.abs(a.x.array - b.x.array).max(initial=0) < 1e-10
    assert np.abs(found[0][2] - found[1][2]).max() < 1e-9 * np.abs(found[0][2]).max()
