# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""PETSc options: those that nothing reads are reported, and the user's database stays his."""

import warnings

from petsc4py import PETSc

import dolfinx_mortar as dm
import pytest
from pressed import pressed
from test_bad_input import fails

PREFIX = "pressed_"  # of the problem


@pytest.fixture
def database():
    """PETSc's database, which is as it was after the test."""
    before = PETSc.Options().getAll()
    yield PETSc.Options()
    for name in PETSc.Options().getAll():
        if name not in before:
            PETSc.Options().delValue(name)


@pytest.mark.parametrize(
    ("option", "meant"),
    [
        ("snes_rtoll", "snes_rtol"),
        ("pc_tpye", "pc_type"),
        ("ksp_max_its", "ksp_max_it"),
        ("-snes_rtol", "snes_rtol"),
        ("pc_factor_solver_type", "pc_factor_mat_solver_type"),
        ("snes_linesearch_typ", "snes_linesearch_type"),
    ],
)
def test_misspelt_name(option, meant):
    fails(lambda: pressed(dm.Tie, petsc_options={option: "1"}), repr(option), repr(meant))


@pytest.mark.parametrize("option", ["snes_tolerance", "mg_levels_pc_sor_its", "pc_gamg_threshold"])
def test_name_that_no_solver_reads(option):
    """One warning, on rank 0, with the first solve."""
    p = pressed(dm.Tie, petsc_options={option: "1"})
    rank = p.problem.comm.rank
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        p.move(0.0, -0.01)
        p.move(0.0, -0.02)
    ours = [str(w.message) for w in caught if "PETSc options" in str(w.message)]
    assert len(ours) == (rank == 0)
    assert all(option in text and PREFIX in text for text in ours)


def test_misspelt_name_in_the_database(database):
    database[PREFIX + "snes_rtoll"] = 1e-3
    p = pressed(dm.Tie)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fails(lambda: p.move(0.0, -0.01), "snes_rtoll", kind=UserWarning)
    p.move(0.0, -0.01)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"pc_type": "gamg", "mg_levels_ksp_type": "richardson", "pc_gamg_threshold": 0.01},
        {"pc_type": "bjacobi", "sub_pc_type": "ilu", "sub_pc_factor_levels": 1},
        {"pc_type": "cholesky", "ksp_gmres_restart": 50},
        {"ksp_type": "preonly", "pc_type": "lu", "mat_mumps_icntl_14": 80},
        {"snes_monitor": "ascii:/dev/null", "ksp_monitor": "ascii:/dev/null"},
        {"snes_converged_reason": "ascii:/dev/null", "snes_view": "ascii:/dev/null"},
        {"ksp_view": "ascii:/dev/null", "ksp_converged_reason": "ascii:/dev/null"},
    ],
    ids=lambda options: "-".join(options),
)
def test_good_names_cause_no_word(options):
    p = pressed(dm.Contact, elements=("hex20", "hex8"), petsc_options=options)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        p.move(0.0, -0.01)


def test_the_database_is_left_as_it_was(database):
    """The problem's options come before the user's in it, and then give way again."""
    values = {"snes_max_it": "33", "snes_monitor": None, "ksp_type": "gmres", "pc_type": "bjacobi"}
    for name, value in values.items():
        database.setValue(PREFIX + name, value)
    before = database.getAll()
    options = {"snes_max_it": 44, "snes_monitor": "ascii:/dev/null", "snes_rtol": 1e-8}
    p = pressed(dm.Contact, petsc_options=options)
    assert database.getAll() == before
    p.move(0.0, -0.01)
    assert database.getAll() == before
    assert p.problem.snes.getTolerances()[3] == 44
    assert p.problem.snes.getTolerances()[0] == 1e-8
    assert p.problem._cpp_object.ksp.getType() == "gmres"
    for wrong in ({"pc_type": "lU"}, {"snes_rtoll": 1}, {"snes_type": "ksponly"}):
        with pytest.raises(ValueError):
            pressed(dm.Contact, petsc_options=options | wrong)
        assert database.getAll() == before


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"pc_type": "lU"}, ("PETSc does not accept", "PC type lU")),
        ({"snes_rtol": "small"}, ("PETSc does not accept", "small")),
        ({"snes_type": "ksponly"}, ("'ksponly'", "'newtonls'")),
        ({"snes_type": "newtontr"}, ("'newtontr'", "'newtonls'")),
        ({"snes_type": "ngmres"}, ("'ngmres'", "'newtonls'")),
        ({"snes_linesearch_type": "shell"}, ("'shell'", "'nleqerr'")),
        ({"snes_linesearch_type": "cp"}, ("'cp'", "'nleqerr'")),
        ({"snes_mf": None}, ("snes_mf", "leave it out")),
        ({"snes_fd": None}, ("snes_fd", "leave it out")),
        ({"snes_lag_jacobian": -2}, ("snes_lag_jacobian", "positive")),
        ({"snes_lag_jacobian_persists": True}, ("snes_lag_jacobian_persists",)),
        ({1: 2}, ("strings",)),
        ("snes_monitor", ("dictionary",)),
    ],
    ids=str,
)
def test_options_that_cannot_be(options, words):
    fails(lambda: pressed(dm.Contact, petsc_options=options), *words)


def test_another_type_after_construction():
    p = pressed(dm.Contact)
    p.problem.snes.setType("ksponly")
    fails(lambda: p.move(0.0, -0.01), "'ksponly'", "'newtonls'")


def test_one_linear_solve_for_ties():
    """Small displacements need no second step."""
    p = pressed(dm.Tie, petsc_options={"snes_type": "ksponly"})
    q = pressed(dm.Tie)
    p.move(0.0, -1e-8)
    q.move(0.0, -1e-8)
    assert p.norms()[0] > 0
    assert p.norms() == pytest.approx(q.norms(), rel=1e-6)


def test_interfaces_of_a_problem_that_was_refused_are_free():
    p = pressed(dm.Contact)
    u, bcs, old = p.problem.u, p.problem.bcs, p.interface
    contact = dm.Contact(slave=old.slave, master=old.master)
    for wrong in ({"pc_type": "lU"}, {"snes_rtoll": 1}, {"snes_type": "ksponly"}):
        with pytest.raises(ValueError):
            dm.ContactProblem(p.forms, u, bcs=bcs, interfaces=[contact], petsc_options=wrong)
    problem = dm.ContactProblem(p.forms, u, bcs=bcs, interfaces=[contact])
    p.top.value[2] = -0.01
    problem.solve()
    assert contact.num_active > 0
