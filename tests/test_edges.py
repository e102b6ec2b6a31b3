# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Contact of slave surfaces with edges: one condition for each patch that meets a master."""

import blocks
import cases
import numpy as np
import oracle
import pytest
from corner import PRESSURE, corner
from mpi4py import MPI

comm = MPI.COMM_WORLD
ELEMENTS = ("tet4", "hex8", "tet10", "hex20", "hex27")


def displacement(part, x):
    """Exact displacement of the parts of `corner` at small strains, with three walls."""
    p = np.array(PRESSURE)
    E, nu = blocks.E, blocks.NU
    if part == 0:
        strain = (-p + nu * (p.sum() - p)) / E
        return strain * x - 0.5 * p / E
    c = (2, 0, 1)[part - 1]
    strain = np.full(3, nu * p[c] / E)
    strain[c] = -p[c] / E
    shift = np.zeros(3)
    shift[c] = 0.5
    return strain * (x + shift)


def largest_error(s, case):
    """Largest error of a displacement on any rank."""
    worst = 0.0
    for part, u in enumerate(s.u):
        x = u.function_space.tabulate_dof_coordinates()
        exact = np.array([displacement(part, y) for y in x]).reshape(-1, 3)
        worst = max(worst, np.abs(u.x.array.reshape(-1, 3) - exact).max(initial=0.0))
    return comm.allreduce(worst, op=MPI.MAX)


@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("multiplier", oracle.MULTIPLIERS)
def test_three_patches_transfer_constant_stress(element, multiplier):
    """Each patch of an edge node transfers the pressure of its own wall, to round-off."""
    master = {"tet10": "hex27", "tet4": "hex8"}.get(element, element)
    case = corner(element, master)
    s = cases.make_problem(case, multiplier=multiplier, geometry="reference")
    s.problem.solve()
    scale = max(PRESSURE) / blocks.E
    assert largest_error(s, case) < 1e-10 * scale
    assert np.allclose(s.contact.force, PRESSURE, rtol=0, atol=1e-9)
    assert np.allclose(s.contact.master_force, [-p for p in PRESSURE], rtol=0, atol=1e-9)
