# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""What does not fit is refused by the same clear error on every rank, and nothing hangs."""

from mpi4py import MPI

import basix.ufl
import blocks
import cases
import dolfinx_mortar as dm
import numpy as np
import pytest
import ufl
from dolfinx import fem, la, mesh

comm = MPI.COMM_WORLD
LOWER, UPPER = blocks.FACES["z+"], blocks.FACES["z-"]


@pytest.fixture
def case():
    """Two tied cubes, the slave on top, both in one mesh for each; the lower one is held."""
    return two_cubes()


def two_cubes(gap=0.0, element="hex8", shift=0.0, kind="tie"):
    parts = [
        blocks.block("upper", element, (shift, 0, 1 + gap), (1 + shift, 1, 2 + gap), (2, 2, 2)),
        blocks.block("lower", element, (0, 0, 0), (1, 1, 1), (3, 3, 1)),
    ]
    case = blocks.assemble(
        parts,
        [blocks.tie(0, 1)],
        [
            cases.Dirichlet(1, lambda x: cases.near(0)(x[2])),
            cases.Dirichlet(0, lambda x: cases.near(2 + gap)(x[2])),
        ],
    )
    case.interfaces[0].kind = kind
    return case


def parts(case, slave_tag=UPPER, master_tag=LOWER):
    (upper, lower) = case.bodies
    return {
        "V": (upper.V, lower.V),
        "facet_tags": (upper.facet_tags, lower.facet_tags),
        "slave": slave_tag,
        "master": master_tag,
    }


def problem(case, interfaces, **options):
    u = cases.displacements(case)
    return dm.ContactProblem(
        cases.residuals(case, u),
        u,
        bcs=cases.DirichletConditions(case).bcs,
        interfaces=interfaces,
        **options,
    )


def fails(action, *words, kind=(ValueError, RuntimeError)):
    """The action raises on all ranks, the same message with these words. Returns the error."""
    try:
        action()
        error = None
    except Exception as e:
        error = e
    messages = comm.allgather(None if error is None else f"{type(error).__name__}: {error}")
    assert messages[0] is not None and set(messages) == {messages[0]}, messages
    assert isinstance(error, kind), messages[0]
    for word in words:
        assert word in messages[0], messages[0]
    return error


# -- Surfaces ------------------------------------------------------------------------------------


def test_tag_without_facets(case):
    fails(
        lambda: problem(case, [dm.Tie(**parts(case, slave_tag=77))]),
        "slave surface (facet tag 77)",
        "no facets",
    )
    fails(
        lambda: problem(case, [dm.Tie(**parts(case, master_tag=78))]),
        "master surface (facet tag 78)",
        "no facets",
    )


def test_interior_facets(case):
    body = case.bodies[0]
    facets = mesh.locate_entities(body.mesh, 2, lambda x: np.isclose(x[2], 1.5))
    tags = mesh.meshtags(body.mesh, 2, facets, np.full(len(facets), 5, np.int32))
    slave = [(body.V, tags, 5)]
    master = [(case.bodies[1].V, case.bodies[1].facet_tags, LOWER)]
    fails(lambda: problem(case, [dm.Tie(slave=slave, master=master)]), "inside the mesh")


def test_slave_is_master(case):
    body = case.bodies[0]
    fails(lambda: dm.Tie(body.V, body.facet_tags, slave=3, master=3), "same surface", "facet tag 3")
    part = [(body.V, body.facet_tags, UPPER)]
    fails(lambda: problem(case, [dm.Tie(slave=part, master=part)]), "same surface")
    # The same facets by another name
    facets = body.facet_tags.find(UPPER)
    again = mesh.meshtags(body.mesh, 2, facets, np.full(len(facets), 9, np.int32))
    other = [(body.V, again, 9)]
    fails(lambda: problem(case, [dm.Tie(slave=part, master=other)]), "slave", "master")


def test_master_nowhere_near():
    case = two_cubes(gap=30.0)
    fails(
        lambda: problem(case, [dm.Tie(**parts(case))]),
        "No slave facet meets a master facet",
        f"slave (facet tag {UPPER})",
        "search_distance",
    )
    case = two_cubes(shift=5.0)
    fails(lambda: problem(case, [dm.Tie(**parts(case))]), "No slave facet meets a master facet")


def test_facets_that_face_away(case):
    """The bottom of the lower block looks the same way as the bottom of the upper one."""
    wrong = parts(case, master_tag=blocks.FACES["z-"])
    fails(lambda: problem(case, [dm.Tie(**wrong)]), "No slave facet meets", "face each other")


def test_collapsed_facet(case):
    body = case.bodies[0]
    x = body.mesh.geometry.x
    x[np.isclose(x[:, 2], 1.0), :2] = 0.5
    fails(lambda: problem(case, [dm.Tie(**parts(case))]), "slave surface", "area")


def test_wrong_parts(case):
    p = parts(case)
    fails(lambda: dm.Tie(slave=3, master=7), "needs a function space")
    fails(lambda: dm.Tie(p["V"], p["facet_tags"][:1], slave=3, master=7), "Two bodies need two")
    fails(lambda: dm.Tie(slave=[], master=7), "no parts")
    swapped = p["facet_tags"][::-1]
    fails(
        lambda: problem(case, [dm.Tie(p["V"], swapped, slave=UPPER, master=LOWER)]),
        "another mesh",
    )


def test_tags_that_are_no_whole_numbers(case):
    for tag in (1.0, "1", True, None):
        fails(lambda tag=tag: dm.Tie(**parts(case, slave_tag=tag)), "slave", "whole number")
    fails(lambda: dm.Tie(**parts(case, slave_tag=2**40)), "slave", "at most")


def test_tags_of_another_type(case):
    body = case.bodies[0]
    facets = body.facet_tags.find(UPPER)
    for dtype in (np.float64, np.int64, np.int8):
        tags = mesh.meshtags(body.mesh, 2, facets, np.full(len(facets), UPPER, dtype))
        p = parts(case)
        p["facet_tags"] = tags, p["facet_tags"][1]
        fails(lambda p=p: dm.Tie(**p), "slave", np.dtype(dtype).name, "int32")


def test_things_that_are_no_spaces_or_tags(case):
    p = parts(case)
    wrong = p | {"V": tuple(b.mesh for b in case.bodies)}
    fails(lambda: dm.Tie(**wrong), "FunctionSpace", "Mesh")
    wrong = p | {"facet_tags": (p["facet_tags"][0], 3)}
    fails(lambda: dm.Tie(**wrong), "master", "MeshTags", "int")
    fails(lambda: dm.Tie(slave=[p["V"][0]], master=7), "slave", "(V, facet_tags, tag)")


def test_relocation_of_a_contact(case):
    fails(lambda: dm.relocate(dm.Contact(**parts(case))), "a Tie, not of a Contact")
    fails(lambda: dm.relocate(dm.Tie(**parts(case)), limit=-1.0), "limit", "positive")
    tie = dm.Tie(**parts(case))
    problem(case, [tie])
    fails(lambda: dm.relocate(tie), "before the problem")


def test_normal_away_from_the_master():
    """Contact would never be found, wherever the bodies are."""
    case = two_cubes(gap=0.01, kind="contact")
    for normal in ((0, 0, 1), (1, 0, 0), (1, 0, 0.5)):
        contact = dm.Contact(**parts(case), geometry="reference", normal=normal)
        fails(lambda c=contact: problem(case, [c]), "from the slave to the master", "-1")
    for gap in (0.01, 20.0):
        case = two_cubes(gap=gap, kind="contact")
        problem(case, [dm.Contact(**parts(case), geometry="reference", normal=(0.5, 0, -1))])


def test_tags_of_cells(case):
    body = case.bodies[0]
    tie = dm.Tie(
        slave=[(body.V, body.cell_tags, 1)],
        master=[(case.bodies[1].V, case.bodies[1].facet_tags, LOWER)],
    )
    fails(lambda: problem(case, [tie]), "needs tags of facets")


# -- Spaces --------------------------------------------------------------------------------------


def with_space(V, tags):
    """A problem of one body in a space, tied to itself between two sides."""
    u = fem.Function(V)
    v = ufl.TestFunction(V)
    F = ufl.inner(u, v) * ufl.dx
    tie = dm.Tie(V, tags, slave=UPPER, master=LOWER)
    return dm.ContactProblem(F, u, interfaces=[tie])


@pytest.mark.parametrize(
    ("element", "words"),
    [
        (("Lagrange", 3, (3,)), ("degree 3", "Lagrange of degree 1 or 2")),
        (("Lagrange", 1), ("1 component", "(3,)")),
        (("Lagrange", 1, (2,)), ("2 component", "(3,)")),
        (("NCE", 1), ("coupled", "Lagrange")),
        (("DG", 1, (3,)), ("discontinuous",)),
        (
            basix.ufl.element(
                "S",
                "hexahedron",
                2,
                basix.LagrangeVariant.legendre,
                basix.DPCVariant.legendre,
                shape=(3,),
            ),
            ("serendipity", "dolfinx_mortar.hex20()"),
        ),
    ],
    ids=["degree 3", "scalar", "two components", "Nedelec", "discontinuous", "serendipity"],
)
def test_unsupported_space(case, element, words):
    body = case.bodies[0]
    fails(lambda: with_space(fem.functionspace(body.mesh, element), body.facet_tags), *words)


def test_space_of_no_unknown(case):
    """Equal elements are not the same space."""
    p = parts(case)
    p["V"] = (p["V"][0].clone(), p["V"][1])
    fails(lambda: problem(case, [dm.Tie(**p)]), "not the space of one of the problem's unknowns")


def test_condition_on_another_space(case):
    W = fem.functionspace(case.bodies[0].mesh, ("Lagrange", 2, (3,)))
    bc = fem.dirichletbc(np.zeros(3), np.array([0], np.int32), W)
    u = cases.displacements(case)
    forms = cases.residuals(case, u)
    fails(lambda: dm.ContactProblem(forms, u, bcs=[bc]), "Dirichlet condition")


def test_forms_and_displacements(case):
    u = cases.displacements(case)
    forms = cases.residuals(case, u)
    fails(lambda: dm.ContactProblem(forms[:1], u), "1 forms for 2 displacements")


# -- Options -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"multiplier": "duel"}, "'dual'"),
        ({"integration": "mortar"}, "'segment'"),
        ({"quadrature_degree": 0}, "positive"),
        ({"search_distance": -1.0}, "positive"),
        ({"search_distance": np.nan}, "positive"),
        ({"search_distance": "1"}, "positive"),
        ({"quadrature_degree": 3.5}, "whole number"),
        ({"quadrature_degree": 1000}, "30 at most"),
        ({"multiplier": 1}, "'dual'"),
        ({"integration": ["segment"]}, "'element'"),
    ],
)
def test_wrong_option(case, options, word):
    for kind in (dm.Tie, dm.Contact):
        fails(lambda kind=kind: kind(**parts(case), **options), next(iter(options)), word)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"friction": -0.1}, "negative"),
        ({"friction": np.nan}, "friction"),
        ({"friction": np.inf}, "finite"),
        ({"friction": "0.3"}, "number"),
        ({"friction": [0.3]}, "number"),
        ({"tresca": "1"}, "number"),
        ({"tresca": -1.0}, "negative"),
        ({"friction": 0.2, "tresca": 1.0}, "not both"),
        ({"c_n": 0.0}, "positive"),
        ({"c_t": -1.0}, "positive"),
        ({"c_n": "1"}, "positive"),
        ({"normal": (0, 0, -1)}, "geometry='reference'"),
        ({"normal": (0, 0), "geometry": "reference"}, "three finite numbers"),
        ({"normal": (0, 0, 0), "geometry": "reference"}, "three finite numbers"),
        ({"normal": "down", "geometry": "reference"}, "three finite numbers"),
        ({"feature_angle": 0}, "positive"),
        ({"feature_angle": 200}, "180"),
        ({"geometry": "new"}, "'current'"),
        ({"initial_active": "some"}, "'none'"),
    ],
)
def test_wrong_contact_option(case, options, word):
    fails(lambda: dm.Contact(**parts(case), **options), word)


def test_standard_multipliers_are_not_condensed(case):
    tie = dm.Tie(**parts(case), multiplier="standard")
    fails(lambda: problem(case, [tie], condense=True), "cannot be condensed", "'dual'")


def test_matrices_before_the_problem(case):
    """A tie on its own has no numbering yet."""
    tie = dm.Tie(**parts(case))
    for name in ("D", "M", "P", "T", "D_inverse", "T_inverse", "multiplier"):
        fails(lambda name=name: getattr(tie, name), "not part of a ContactProblem")
    fails(tie.constraints, "not part of a ContactProblem")


# -- Solving -------------------------------------------------------------------------------------


def test_displacement_that_is_not_a_number():
    case = two_cubes(kind="contact")
    u = cases.displacements(case)
    contact = dm.Contact(**parts(case))
    p = dm.ContactProblem(
        cases.residuals(case, u),
        u,
        bcs=cases.DirichletConditions(case).bcs,
        interfaces=[contact],
    )
    values = u[0].x.array.reshape(-1, 3)
    values[np.isclose(case.bodies[0].V.tabulate_dof_coordinates()[:, 2], 1.0)] = np.nan
    fails(p.solve, "not finite")


def test_no_multiplier_left(case):
    """All slave nodes are clamped."""
    u = cases.displacements(case)
    V = case.bodies[0].V
    all_nodes = fem.locate_dofs_geometrical(V, lambda x: x[0] > -1)
    bcs = [fem.dirichletbc(np.zeros(3), all_nodes, V)]
    forms = cases.residuals(case, u)
    fails(
        lambda: dm.ContactProblem(forms, u, bcs=bcs, interfaces=[dm.Tie(**parts(case))]),
        "has no node that can carry a multiplier",
    )


def pressed(depth):
    """A nonlinear contact problem, the upper block pushed down by `depth`."""
    case = two_cubes(gap=0.01, kind="contact")
    case.parts = [
        cases.Part(p.name, p.element, cases.neo_hooke(1000, 0.3), p.points, p.cells, p.tag)
        for p in case.parts
    ]
    push = fem.Constant(case.bodies[0].mesh, np.array([0.0, 0.0, -depth]))
    upper, lower = (b.V for b in case.bodies)
    top = fem.locate_dofs_geometrical(upper, lambda x: cases.near(2.01)(x[2]))
    bottom = fem.locate_dofs_geometrical(lower, lambda x: cases.near(0)(x[2]))
    bcs = [
        fem.dirichletbc(push, top, upper),
        fem.dirichletbc(np.zeros(3), bottom, lower),
    ]
    u = cases.displacements(case)
    contact = dm.Contact(**parts(case))
    p = dm.ContactProblem(
        cases.residuals(case, u),
        u,
        bcs=bcs,
        interfaces=[contact],
        petsc_options={"snes_max_it": 8},
    )
    return p, contact, push


@pytest.mark.parametrize("far", [5.0, pytest.param(40.0, marks=pytest.mark.serial)])
def test_state_after_a_failed_step(far):
    """u, multipliers and the active set are those of the last good step; solving goes on."""
    p, contact, push = pressed(0.03)
    p.solve()
    u = [w.x.array.copy() for w in p.u]
    fields = ("multiplier", "pressure", "gap", "status")
    before = {name: getattr(contact, name).x.array.copy() for name in fields}
    force = contact.force
    assert force[2] > 0

    push.value[2] = -far
    error = fails(p.solve, "The ", kind=dm.ConvergenceError)
    assert error.history
    assert all(np.array_equal(w.x.array, v) for w, v in zip(p.u, u, strict=True))
    for name, values in before.items():
        assert np.array_equal(getattr(contact, name).x.array, values), name
    assert np.allclose(contact.force, force, rtol=1e-12)

    push.value[2] = -0.05
    p.solve()
    reference, other, _ = pressed(0.05)
    reference.solve()
    # Not node by node: the same mesh may be numbered otherwise when it is made again
    for a, b in zip(p.u, reference.u, strict=True):
        assert la.norm(a.x) == pytest.approx(la.norm(b.x), rel=1e-7)
    assert np.abs(contact.moment - other.moment).max() < 1e-6 * np.abs(other.moment).max()
    assert np.abs(contact.force - other.force).max() < 1e-6 * np.abs(other.force).max()
