# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Contact patch tests: bodies pressed together at flat non-matching interfaces keep a constant
pressure, to round-off."""

import blocks
import cases
import numpy as np
import oracle
import pytest

SECOND_ORDER = [(a, b) for a in ("tri6", "quad8", "quad9") for b in ("tri6", "quad8", "quad9")]
MIXED = [("tri3", "quad8"), ("quad4", "tri6"), ("quad9", "quad4"), ("tri6", "tri3")]


def pressed_blocks(slave, master, load, energy=None):
    """A block (part 0, slave) on another one, pressed by a dead load per reference area.

    Symmetry planes x = 0 and y = 0 hold both sideways; the upper one is held up by contact alone.
    """
    parts = [
        blocks.block("upper", slave, (0, 0, 1), (1, 1, 2), (3, 3, 1), energy),
        blocks.block("lower", master, (0, 0, 0), (1, 1, 1), (2, 2, 1), energy),
    ]
    near = cases.near
    held = [cases.Dirichlet(p, lambda x, i=i: near(0)(x[i]), (i,)) for p in (0, 1) for i in (0, 1)]
    held.append(cases.Dirichlet(1, lambda x: near(0)(x[2]), (2,)))
    faces = blocks.FACES
    contact = cases.Interface(
        "contact", [(0, faces["z-"])], [(1, faces["z+"])], initially_active=False
    )
    top = cases.SurfaceLoad(0, faces["z+"], (0.0, 0.0, -load))
    return blocks.assemble(parts, [contact], held, surface_loads=[top])


def solve(case, condense=None, **options):
    """Displacements, contact and problem of a case solved in one step."""
    # Quadratic convergence: the iteration beyond 1e-9 reaches round-off
    s = cases.make_problem(case, condense=condense, petsc_options={"snes_rtol": 1e-12}, **options)
    s.problem.solve()
    return s.u, s.contact, s.problem


def pressures(contact):
    """Values of the pressure at the slave nodes that this rank owns, multiplier or not."""
    surface, problem = contact.data.slave, contact.problem
    start = problem.coupling.layout.local_start(problem.body(contact.slave[0].V))
    return contact.pressure.x.array[surface.local_blocks[: surface.num_owned] - start]


@pytest.mark.parametrize("pairing", SECOND_ORDER + MIXED, ids="-".join)
def test_constant_pressure_of_small_strains(pairing):
    load = 10.0
    case = pressed_blocks(*(blocks.ELEMENT[kind] for kind in pairing), load)
    for multiplier in oracle.MULTIPLIERS:
        u, contact, _ = solve(case, multiplier=multiplier, geometry="reference")
        p = pressures(contact)
        assert np.abs(p - load).max(initial=0) < 1e-10 * load, multiplier
        for displacement in u:  # (nu, nu, -1) load / E times position
            V = displacement.function_space
            x = V.tabulate_dof_coordinates() * load / blocks.E * [blocks.NU, blocks.NU, -1]
            error = np.abs(displacement.x.array.reshape(-1, 3) - x).max(initial=0)
            assert error < 1e-10 * load / blocks.E, multiplier


@pytest.mark.parametrize("pairing", SECOND_ORDER, ids="-".join)
def test_constant_pressure_at_finite_strain(pairing):
    """The load is per reference area, the pressure per deformed area."""
    load = 100.0
    energy = cases.neo_hooke(blocks.E, blocks.NU)
    case = pressed_blocks(*(blocks.ELEMENT[kind] for kind in pairing), load, energy)
    u, contact, problem = solve(case)
    stretch = 1 + cases.displacement_at(case, u, 0, (1, 1, 1))[0]
    assert stretch > 1.02
    p = pressures(contact)
    assert np.abs(p - load / stretch**2).max(initial=0) < 1e-10 * load
    # Resultants cancel, and are the load
    assert np.abs(contact.force + contact.master_force).max() < 1e-10 * load
    assert np.abs(contact.moment + contact.master_moment).max() < 1e-10 * load
    assert contact.force[2] == pytest.approx(load, rel=1e-10)
    assert contact.num_active == contact.num_multiplier_nodes


@pytest.mark.parametrize("multiplier", oracle.MULTIPLIERS)
@pytest.mark.parametrize("one_mesh", [False, True])
def test_4c_contact_patch(multiplier, one_mesh):
    """A small cube on a block, pressure also on the free part of the block's surface."""
    case = cases.contact_patch(one_mesh=one_mesh)
    u, contact, _ = solve(case, multiplier=multiplier, geometry="reference")
    zero = cases.displacements(case)
    assert cases.largest_error(case, u) < 1e-10 * cases.largest_error(case, zero)
    assert np.abs(pressures(contact) - 100).max(initial=0) < 1e-10 * 100
    cases.check_expected(case, u, tolerance=1e-10)
