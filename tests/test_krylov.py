# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Iterations of Krylov solvers where Dirichlet conditions meet the contact.

On planes of symmetry, components of slave and of master nodes are prescribed. That must not cost
iterations: a part that is cut off by such planes takes hardly more than the whole does.
"""

import functools
import sys
from pathlib import Path

import cases
import dolfinx_mortar as dm
import numpy as np
import pytest
from blocks import NU, E
from bolted import bolted_joint
from corner import corner
from mirrored import crossed_cylinders, model, punch
from press_fit import press_fit

sys.path.append(str(Path(__file__).parent / "benchmarks"))
import flatness  # noqa: E402

PRECONDITIONERS = ("cholesky", "gamg")
# Every system is solved to the same tolerance, by a preconditioner of its own: what is counted is
# how good that is
EXACT = {"snes_ksp_ew": False, "pc_mortar_reuse": False}
FRICTION = {"frictionless": {}, "friction": {"friction": 0.3}}


def iterations(problem, solve):
    """Numbers of iterations of the Krylov solver in those of Newton's method."""
    counts = []

    def count(ksp, iteration, norm):
        if iteration == 0:
            counts.append(0)
        counts[-1] = iteration

    problem._cpp_object.ksp.setMonitor(count)
    solve()
    return counts


def check(part, whole):
    assert len(part) > 2
    assert max(part) <= 1.5 * max(whole)
    assert np.mean(part) <= 1.5 * np.mean(whole)


@pytest.mark.parametrize("preconditioner", PRECONDITIONERS)
@pytest.mark.parametrize("friction", FRICTION)
def test_punch(preconditioner, friction):
    def count(planes):
        kinds = [(dm.Contact, FRICTION[friction])]
        solver = {"pc_type": preconditioner, **EXACT}
        m = model(punch(("hex20", "hex8")), kinds, planes, petsc_options=solver)
        return iterations(m.problem, lambda: m.press(0.08))

    check(count((0, 1)), count(()))


@pytest.mark.parametrize("preconditioner", PRECONDITIONERS)
@pytest.mark.parametrize("friction", FRICTION)
def test_crossed_cylinders(preconditioner, friction):
    def count(planes):
        kinds = [(dm.Contact, FRICTION[friction])]
        solver = {"pc_type": preconditioner, **EXACT}
        m = model(crossed_cylinders(("hex20", "hex8")), kinds, planes, petsc_options=solver)
        return iterations(m.problem, lambda: m.press(0.08))

    check(count((0, 1)), count(()))


@pytest.mark.parametrize("layers", [punch, crossed_cylinders])
def test_part_and_whole_are_one_problem(layers):
    """Where a part has the very equations of the whole, a solver takes the same course.

    Segments end at a plane of symmetry, which makes the equations differ a little, and Newton's
    iterates with them; an exact factorisation leaves nothing but the preconditioner to differ.
    """

    def count(planes):
        kinds = [(dm.Contact, {"integration": "element"})]
        solver = {"pc_type": "cholesky", **EXACT}
        m = model(layers(("hex20", "hex8")), kinds, planes, petsc_options=solver)
        return iterations(m.problem, lambda: m.press(0.08))

    whole = count(())
    for planes in ((0, 1), (1,)):
        np.testing.assert_allclose(count(planes), whole, rtol=0, atol=1)


@pytest.mark.parametrize("preconditioner", PRECONDITIONERS)
@pytest.mark.parametrize("friction", FRICTION)
def test_several_interfaces(preconditioner, friction):
    """A second interface, tied or with friction, ends at the planes as well."""

    def count(planes):
        below = (dm.Contact, {"friction": 0.5}) if friction == "friction" else (dm.Tie, {})
        kinds = [(dm.Contact, FRICTION[friction]), below]
        solver = {"pc_type": preconditioner, **EXACT}
        layers = punch(("hex8", "hex20"), base=True)
        m = model(layers, kinds, planes, petsc_options=solver)
        return iterations(m.problem, lambda: m.press(0.08))

    check(count((0, 1)), count(()))


@functools.cache
def press_fit_counts(quarter, preconditioner, friction):
    """Iterations, and the number of nodes that slip in the end."""
    solver = {"pc_type": preconditioner, **EXACT}
    p, _ = press_fit(quarter, 0.01, petsc_options=solver, **FRICTION[friction])
    return iterations(p, p.solve), p.history[-1]["slip"]


@pytest.mark.parametrize("preconditioner", PRECONDITIONERS)
@pytest.mark.parametrize("friction", FRICTION)
def test_press_fit(preconditioner, friction):
    part, whole = (press_fit_counts(q, preconditioner, friction)[0] for q in (True, False))
    check(part, whole)


def test_friction_costs_little():
    """The preconditioner knows that slip turns; that friction follows the pressure it does not."""

    counts, slipping = zip(*(press_fit_counts(False, "cholesky", f) for f in FRICTION))
    assert min(slipping) > 10
    without, with_friction = counts
    check(with_friction, without)


@pytest.mark.parametrize("preconditioner", PRECONDITIONERS)
@pytest.mark.parametrize("friction", FRICTION)
def test_bolted_joint(preconditioner, friction):
    """Three interfaces, two of them of one bolt, which nothing but contact holds along its axis."""

    def count(quarter):
        solver = {"pc_type": preconditioner, **EXACT}
        p, contacts = bolted_joint(quarter, 0.02 * E, petsc_options=solver, **FRICTION[friction])
        counts = iterations(p, p.solve)
        head, nut, plates = (c.force[2] for c in contacts)
        assert head > 0 and np.allclose([-nut, plates], head, rtol=1e-6)
        return counts

    check(count(True), count(False))


@pytest.mark.parametrize("case, cells", [("contact", (6, 10)), ("contact, hex8", (9, 18))])
def test_bodies_slide_on_coarse_levels(case, cells):
    """Blocks that slide on each other take as many iterations on a fine mesh as on a coarse one.

    Aggregates with nodes of both blocks would hold them together on coarse levels: 12 and 15
    iterations of second-order elements, 14 and 19 of first-order ones. Which part of a mesh a rank
    has changes numbers by one.
    """
    coarse, fine = (max(flatness.solve(n, flatness.CASES[case], {})["krylov"]) for n in cells)
    assert fine <= coarse + 2


@pytest.mark.parametrize("preconditioner", PRECONDITIONERS)
def test_edges(preconditioner):
    """Contact on floor and walls costs hardly more than on a floor between planes of symmetry."""

    def count(walls):
        case = corner("hex20", "hex20", walls=walls, energy=cases.neo_hooke(E, NU))
        p = cases.make_problem(case, petsc_options={"pc_type": preconditioner, **EXACT}).problem
        return iterations(p, p.solve)

    check(count(2), count(0))


@pytest.mark.parametrize("preconditioner", PRECONDITIONERS)
def test_same_solution_as_a_direct_solver(preconditioner):
    """Prescribed components come out as they are prescribed, and all else as by LU."""
    found = []
    for solver in (None, {"pc_type": preconditioner, "ksp_rtol": 1e-12}):
        kinds = [(dm.Contact, {"friction": 0.3})]
        m = model(punch(("tet10", "hex8")), kinds, (0, 1), petsc_options=solver)
        m.press(0.08)
        found.append([*m.contact.force, *m.contact.master_force])
    assert np.allclose(*found, rtol=1e-9, atol=0)


def test_a_breakdown_is_not_blamed_on_the_supports():
    """CG does not fit a system that is not symmetric; the model is held well."""
    solver = {"ksp_type": "cg", "pc_type": "jacobi"}
    m = model(punch(("hex8", "hex8")), [(dm.Contact, {})], (0, 1), petsc_options=solver)
    with pytest.raises(dm.ConvergenceError, match="does not fit the system") as error:
        m.press(0.08)
    assert "held" not in str(error.value)
