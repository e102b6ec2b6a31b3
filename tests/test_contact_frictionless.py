# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Frictionless contact at finite deformation: a block that is turned, pressed in and moved."""

from mpi4py import MPI

import cases
import nodal
import numpy as np
import pytest
from dolfinx import fem, la

comm = MPI.COMM_WORLD


def run(case, times, condense=None, rtol=1e-11, **options):
    """Solve a case step by step.

    Returns:
        Displacements, contact, problem, and the history of each step.
    """
    s = cases.make_problem(case, condense=condense, petsc_options={"snes_rtol": rtol}, **options)
    histories = []
    for t in times:
        s.step(t)
        histories.append(s.problem.history)
    return s.u, s.contact, s.problem, histories


def check_balance(contact, moments=True):
    """Resultants of both sides cancel: forces, and moments where the gap is closed at all points.

    Between curved facets only its average around each node is zero.
    """
    size = np.linalg.norm(contact.force)
    assert size > 0
    assert np.abs(contact.force + contact.master_force).max() < 1e-10 * size
    if moments:
        assert np.abs(contact.moment + contact.master_moment).max() < 2e-10 * size


def test_4c_turned_block():
    """Against 4C, which computes with (negligible) inertia; forces in balance at every step."""
    case = cases.rotated_block()
    # Before they touch the block moves stiffly, with forces of round-off alone
    u, contact, _, histories = run(case, case.times, rtol=1e-9)
    assert cases.check_expected(case, u, tolerance=1e-4) < 1e-4
    check_balance(contact)
    touching = [h for h in histories if h[-1]["active"] > 0]
    assert len(touching) > 20
    assert max(len(h) - 1 for h in touching) < 10


@pytest.mark.parametrize("multiplier", ["dual", "standard"])
def test_forces_balance(multiplier):
    case = cases.rotated_block(one_mesh=True)
    _, contact, _, _ = run(case, (0.1, 0.2), multiplier=multiplier)
    assert contact.num_active > 0
    check_balance(contact)


def pressed_second_order(comm=comm):
    """Two hex20 blocks, the upper one turned and smaller, pressed together by displacement."""
    a, b = 0.55, 0.2
    plan = np.array([(-b, -a), (a, -b), (-a, b), (b, a)])
    points, quads = cases.mapped_grid(plan, 2, 2)
    near = cases.near
    upper = cases.Part(
        "upper",
        "hex20",
        cases.neo_hooke(1000, 0.3),
        *cases.extrude(points, quads, lambda x, y: 1.02 + 0.1 * (x**2 + y**2), lambda x, y: 1.6, 1),
        lambda x: np.where(x[:, 2] < 1.2, 1, 0) * (np.abs(x[:, 2] - 1.05) < 0.05),
    )
    lower = cases.Part(
        "lower",
        "hex20",
        cases.neo_hooke(300, 0.3),
        *cases.box((-1, -1, 0), (1, 1, 1), (3, 3, 1)),
        lambda x: np.where(near(1)(x[:, 2]), 2, 0),
    )
    parts = [upper, lower]
    return cases.Case(
        "own",
        parts,
        *cases._bodies(comm, parts, False),
        interfaces=[cases.Interface("contact", [(0, 1)], [(1, 2)], initially_active=False)],
        dirichlet=[
            cases.Dirichlet(0, lambda x: near(1.6)(x[2]), value=lambda t: (0.02 * t, 0, -0.06 * t)),
            cases.Dirichlet(1, lambda x: near(0)(x[2])),
        ],
    )


def assert_same(first, second, tolerance):
    """The same iterates: norms of each iteration, and states of all nodes."""
    for a, b in zip(first, second, strict=True):
        assert len(a) == len(b)
        for i, j in zip(a, b, strict=True):
            assert (i["active"], i["changes"], i["step"]) == (j["active"], j["changes"], j["step"])
            for key in ("force", "constraint"):
                if key == "force" and max(i["residual"], j["residual"]) < 1e-9:
                    continue  # round-off
                if np.isfinite(i[key]) or np.isfinite(j[key]):
                    assert i[key] == pytest.approx(j[key], rel=1e-5, abs=tolerance)


@pytest.mark.parametrize("multiplier", ["dual", "dual-linear", "dual-reproducing"])
def test_condensed_iterates_are_those_of_the_saddle_point(multiplier):
    times, found = (1.0, 2.0), []
    for condense in (True, False):
        case = pressed_second_order()
        u, contact, _, histories = run(case, times, condense=condense, multiplier=multiplier)
        check_balance(contact, moments=False)
        found.append((u, histories, contact.force))
    assert_same(found[0][1], found[1][1], 1e-9)
    assert found[0][2] == pytest.approx(found[1][2], rel=1e-9, abs=1e-9)
    a, b = (nodal.by_position(*u) for u, _, _ in found)
    assert np.abs(a - b).max() < 1e-11


def test_iterates_do_not_depend_on_ranks():
    """As on one rank, on which each rank computes the same by itself."""
    times = (1.0, 2.0)
    _, together, _, histories = run(pressed_second_order(), times)
    _, alone, _, expected = run(pressed_second_order(MPI.COMM_SELF), times)
    assert_same(histories, expected, 1e-9)
    assert together.force == pytest.approx(alone.force, rel=1e-9, abs=1e-9)


def test_contact_carries_what_the_supports_carry():
    """Forces of contact are the reactions, which follow from stresses and no multipliers."""
    case = pressed_second_order()
    u, contact, _, _ = run(case, (1.0, 2.0))
    for form, w, height, force in zip(
        cases.residuals(case, u), u, (1.6, 0.0), (contact.force, contact.master_force), strict=True
    ):
        V = w.function_space
        f = fem.assemble_vector(fem.form(form))
        f.scatter_reverse(la.InsertMode.add)
        owned = V.dofmap.index_map.size_local
        held = cases.near(height)(V.tabulate_dof_coordinates()[:owned, 2])
        reaction = comm.allreduce(f.array.reshape(-1, 3)[:owned][held].sum(axis=0))
        assert reaction == pytest.approx(-force, rel=1e-8, abs=1e-8)
    # Without friction, on a surface that is nearly plane, it pushes hardly sideways
    assert contact.force[2] > 1 and np.abs(contact.force[:2]).max() < 1e-2 * contact.force[2]


def with_factor(stress, energy):
    return lambda u: fem.Constant(u.function_space.mesh, stress) * energy(u)


def scaled(case, length, stress):
    """The same bodies measured in other units: lengths and stresses have these factors."""
    for body in case.bodies:
        body.mesh.geometry.x[:] *= length
    for part in case.parts:
        part.energy = with_factor(stress, part.energy)
    for condition in case.dirichlet:
        where, value = condition.where, condition.value
        condition.where = lambda x, where=where: where(x / length)
        condition.value = lambda t, value=value: length * np.array(value(t))
    return case


def test_iterates_do_not_depend_on_units():
    """Metres and pascals, millimetres and megapascals."""
    times, found = (1.0, 2.0), []
    for length, stress in ((1.0, 1.0), (1e3, 1e-6)):
        case = scaled(pressed_second_order(), length, stress)
        u, contact, _, histories = run(case, times)
        found.append((u, histories, contact.force / (stress * length**2), length))
    assert_same(found[0][1], found[1][1], 1e-9)
    assert found[0][2] == pytest.approx(found[1][2], rel=1e-9, abs=1e-9)
    a, b = (nodal.by_position(*u) / length for u, _, _, length in found)
    assert np.abs(a - b).max() < 1e-10
