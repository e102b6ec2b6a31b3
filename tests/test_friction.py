# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Coulomb and Tresca friction: against 4C, against statics, frame indifference."""

import blocks
import cases
import dolfinx_mortar as dm
import nodal
import numpy as np
import pytest

OPEN, STICK, SLIP = 0, 1, 2


def nodal_values(contact, z=None, evaluation=None):
    """Of the owned nodes in contact: pressure, tangential multiplier, slip, state."""
    evaluation = evaluation or contact.evaluation
    status = evaluation.law.status
    closed = status != OPEN
    z = nodal.multipliers(contact, z)
    normal = evaluation.configuration.normals[: len(z)]
    pressure = np.sum(z * normal, axis=1)
    motion = evaluation.weighted_slip
    slip = np.sum(motion * normal, axis=1)[:, None] * normal - motion
    tangential = z - pressure[:, None] * normal
    return pressure[closed], tangential[closed], slip[closed], status[closed]


def check_cone(contact, largest):
    """No traction outside of the cone, no slip against its traction; stick does not move.

    Args:
        contact: At an accepted step.
        largest: Largest traction on any rank.
    """
    pressure, tangential, slip, status = nodal_values(contact)
    bound = contact.friction * pressure
    length = np.linalg.norm(tangential, axis=1)
    assert np.all(length <= bound + 1e-8 * largest)
    assert np.all(np.sum(tangential * slip, axis=1) >= -1e-12 * largest)
    slips = status == SLIP
    assert np.abs(length - bound)[slips].max(initial=0) < 1e-8 * largest
    # Traction and slip are parallel
    moved = np.linalg.norm(slip, axis=1)
    across = length * moved - np.sum(tangential * slip, axis=1)
    assert np.abs(across[slips]).max(initial=0) <= 1e-6 * largest * moved.max(initial=0)
    assert moved[~slips].max(initial=0) < 1e-9 * max(moved.max(initial=0), 1e-3)
    assert contact.dissipation >= -1e-12 * largest


def test_4c_sliding_block():
    """4C takes its dual functions from whole facets and too few points: that is 1.7e-6."""
    case = cases.sliding_block()
    s = cases.make_problem(case, initial_active="all", c_n=1e4, c_t=1e4)
    for t in case.times:
        assert s.step(t) < 8
        check_cone(s.contact, 100.0)
    assert cases.check_expected(case, s.u, tolerance=2e-6) < 2e-6
    assert s.problem.history[-1]["stick"] == 8


def on_rigid_plate(friction=None, element="hex20"):
    """A block that is pressed on a plate, all of which is held, and dragged over it."""
    parts = [
        blocks.block("block", element, (0.3, 0.3, 1), (0.8, 0.7, 1.2), (2, 2, 1)),
        blocks.block("plate", "hex20", (0, 0, 0), (2, 1, 1), (4, 2, 1)),
    ]
    faces = blocks.FACES
    pressed = cases.Dirichlet(
        0, lambda x: cases.near(1.2)(x[2]), value=lambda t: (0.1 * (t - 1), 0.0, -0.02)
    )
    held = [pressed, cases.Dirichlet(1, lambda x: x[2] > -1)]
    contact = cases.Interface(
        "contact", [(0, faces["z-"])], [(1, faces["z+"])], friction, initially_active=False
    )
    return blocks.assemble(parts, [contact], held, times=(1.0, 2.0, 3.0, 4.0, 5.0))


@pytest.mark.parametrize("element", ["hex20", "tet10"])
def test_drag_is_friction_times_pressing_force(element):
    case = on_rigid_plate(0.1, element)
    s = cases.make_problem(case)
    for t in case.times:
        s.step(t)
        check_cone(s.contact, 100.0)
        force = s.contact.force
        assert np.abs(force + s.contact.master_force).max() < 1e-10 * np.abs(force).max()
    last = s.problem.history[-1]
    assert last["slip"] == last["active"] > 0
    assert force[0] == pytest.approx(-0.1 * force[2], rel=1e-6)
    assert abs(force[1]) < 1e-6 * force[2]
    # What the drag takes over a step is its work
    assert s.contact.dissipation == pytest.approx(-force[0] * 0.1, rel=1e-3)


def test_tresca_bound():
    case = on_rigid_plate()
    s = cases.make_problem(case, friction=None, tresca=0.5)
    for t in case.times:
        s.step(t)
    _, tangential, _, status = nodal_values(s.contact)
    assert np.all(status == SLIP)
    assert np.abs(np.linalg.norm(tangential, axis=1) - 0.5).max(initial=0) < 1e-8
    pressing = s.contact.force[2]
    assert pressing > 1  # the bound does not know of it


def test_turning_together_is_no_slip():
    """A rigid motion of both bodies changes D and M, but it is no slip."""
    case = on_rigid_plate(0.3)
    s = cases.make_problem(case)
    for t in case.times[:2]:
        s.step(t)
    problem = s.problem
    state, step = problem._cpp_object.begin()  # the next step remembers this one
    axis = np.array([1.0, -2.0, 0.5]) / np.sqrt(5.25)
    W = np.cross(np.eye(3), axis)
    R = np.eye(3) + np.sin(0.7) * W + (1 - np.cos(0.7)) * W @ W
    z = problem.state.z.reshape(-1, 3) @ R.T
    for f in s.u:
        X = f.function_space.tabulate_dof_coordinates()
        f.x.array[:] = ((X + f.x.array.reshape(-1, 3)) @ R.T + [0.3, -1, 2] - X).ravel()
    x = np.concatenate([nodal.displacements(problem), z.ravel()])
    turned = problem._cpp_object.evaluate(state, step, x).interfaces.interfaces[0]
    pressure, tangential, slip, _ = nodal_values(s.contact, z, turned)
    assert np.all(pressure > 0)
    assert np.abs(slip).max(initial=0) < 1e-15
    check_rotated = np.linalg.norm(tangential, axis=1) / (0.3 * pressure)
    assert np.abs(check_rotated).max(initial=0) < 1 + 1e-8


def test_second_press_starts_from_the_accepted_step():
    """A step that does not converge leaves friction's memory as it was."""
    case = on_rigid_plate(0.3)
    forces = []
    for fail in (False, True):
        s = cases.make_problem(case)
        for t in case.times[:3]:
            if fail and t > 1.5:
                snes = s.problem.snes
                limits = snes.getTolerances()
                snes.setTolerances(max_it=1)
                with pytest.raises(dm.ConvergenceError):
                    s.step(t)
                snes.setTolerances(max_it=limits[3])
            s.step(t)
        forces.append(s.contact.force)
    assert np.abs(forces[0] - forces[1]).max() < 1e-9 * np.abs(forces[0]).max()
