# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Tied bodies: constant stress passes through any interface, rigid motions cost nothing."""

from mpi4py import MPI

import blocks
import cases
import dolfinx_mortar as dm
import nodal
import numpy as np
import oracle
import pytest
import ufl
from dolfinx import fem
from facet_pairs import PAIRINGS
from scipy.sparse.linalg import spsolve

serial = pytest.mark.serial
# On several ranks each kind of facet once on each side is enough
pairings = pytest.mark.parametrize(
    "pairing",
    [
        pytest.param(p, marks=[] if k in (1, 7, 13, 19, 20) else serial)
        for k, p in enumerate(PAIRINGS)
    ],
    ids=map("-".join, PAIRINGS),
)
multipliers = pytest.mark.parametrize("multiplier", oracle.MULTIPLIERS)
STRAIN = 1e-3 * np.array([[1.0, 0.3, -0.4], [0.3, -0.7, 0.5], [-0.4, 0.5, -1.2]])


def solve(case, forms=None, condense=None, **options):
    """Displacements, ties, problem of a case solved in one step."""
    s = cases.make_problem(case, forms, condense, **options)
    s.problem.solve()
    return s.u, s.interfaces, s.problem


def relative_error(case, u):
    """Of nodal displacements, to the largest of the exact ones."""
    zero = cases.displacements(case)
    return cases.largest_error(case, u) / cases.largest_error(case, zero)


@pairings
def test_constant_stress(pairing):
    """All components of stress, all multiplier spaces, condensed where that is possible."""
    case = blocks.stressed_blocks(*(blocks.ELEMENT[kind] for kind in pairing), STRAIN)
    traction = blocks.stress_of(STRAIN) @ [0, 0, -1]
    for multiplier in oracle.MULTIPLIERS:
        u, (tie,), _ = solve(case, multiplier=multiplier)
        assert relative_error(case, u) < 1e-10, multiplier
        # The traction is constant, so it is that constant at all nodes of the slave surface
        for field in (tie.traction, tie.recovered_traction):
            t = field.x.array.reshape(-1, 3)
            on_surface = np.isin(np.arange(len(t)), tie.data.slave.local_blocks)
            assert np.abs(t[on_surface] - traction).max(initial=0) < 1e-9 * np.abs(traction).max()


@multipliers
def test_seven_interfaces(multiplier):
    """All five kinds of facets, in one problem, a surface of several bodies among them."""
    case = cases.tied_patch_seven()
    u, _, _ = solve(case, multiplier=multiplier)
    assert relative_error(case, u) < 1e-9


@multipliers
@pytest.mark.parametrize("one_mesh", [False, True], ids=["two meshes", "one mesh"])
def test_overhanging_slave(multiplier, one_mesh):
    case = cases.tied_patch_overhang(one_mesh=one_mesh)
    u, _, _ = solve(case, multiplier=multiplier)
    assert relative_error(case, u) < 1e-9
    cases.check_expected(case, u)


def test_finite_strain():
    """The reference has "dual" multipliers; others are other discretisations, and come close."""
    case = cases.tied_hex27()
    for multiplier in oracle.MULTIPLIERS:
        u, _, _ = solve(case, multiplier=multiplier)
        cases.check_expected(case, u, 1e-6 if multiplier == "dual" else 1e-3)


@serial
@multipliers
@pytest.mark.parametrize("kind", ["tri6", "quad8", "quad9"])
@pytest.mark.parametrize("integration", ["segment"])
def test_overhanging_second_order(kind, multiplier, integration):
    """The master ends inside slave facets; the rest of the slave surface has the traction as load.

    The load of a partly covered facet is not polynomial on it, so it comes from the reference.
    """
    parts = [
        blocks.block("lower", blocks.ELEMENT[kind], (0, 0, 0), (1, 1, 1), (3, 3, 1)),
        blocks.block("upper", "hex27", (0.2, 0.15, 1), (0.7, 0.85, 2), (2, 2, 1)),
    ]
    strain = 1e-3 * np.diag([blocks.NU, blocks.NU, -1])
    traction = blocks.stress_of(strain)[2]
    case = blocks.assemble(
        parts,
        [blocks.tie(0, 1, "z+", "z-")],
        [
            cases.Dirichlet(0, lambda x: cases.near(0)(x[2]), (2,)),
            cases.Dirichlet(0, blocks.at(0, 0, 0), (0, 1)),
            cases.Dirichlet(0, blocks.at(1, 0, 0), (1,)),
        ],
        surface_loads=[cases.SurfaceLoad(1, blocks.FACES["z+"], tuple(traction))],
        exact=lambda part, x: strain @ x,
    )
    (slave, nodes), (master, _) = cases.interface_surfaces(case, case.interfaces[0])
    covered = np.zeros((case.bodies[0].V.tabulate_dof_coordinates().shape[0], 3))
    covered[nodes[:, 1]] = np.outer(
        oracle.mortar(slave, master, "standard", points=5).D.sum(axis=0), traction
    )
    u = cases.displacements(case)
    forms = cases.residuals(case, u)
    V = case.bodies[0].V
    v, w = ufl.TestFunction(V), ufl.TrialFunction(V)
    ds = ufl.Measure("ds", V.mesh, subdomain_data=case.bodies[0].facet_tags)(blocks.FACES["z+"])
    # A traction on the whole surface whose nodal forces are those on the covered part
    A = fem.assemble_matrix(fem.form(ufl.inner(w, v) * ds)).to_scipy().tocsc()
    used = np.flatnonzero(A.diagonal())
    part = fem.Function(V)
    part.x.array[used] = spsolve(A[used][:, used], covered.ravel()[used])
    t = fem.Constant(V.mesh, traction)
    forms[0] -= ufl.inner(t - part, v) * ds
    ties = cases.make_interfaces(case, multiplier=multiplier, integration=integration)
    problem = dm.ContactProblem(forms, u, bcs=cases.DirichletConditions(case).bcs, interfaces=ties)
    problem.solve()
    assert relative_error(case, u) < 1e-9
    # Some nodes are covered too little to have a multiplier
    assert ties[0].num_multiplier_nodes < len(nodes)


@pytest.mark.parametrize("element", ["hex8", pytest.param("hex20", marks=serial), "tet10"])
@pytest.mark.parametrize("multiplier", ["dual-reproducing", pytest.param("dual", marks=serial)])
def test_one_mesh_is_two_meshes(element, multiplier):
    """Also in a state that is not uniform: the top is bent."""

    def displacements(one_mesh):
        parts = [
            blocks.block("upper", element, (0, 0, 1), (1, 1, 2), (3, 3, 1)),
            blocks.block("lower", element, (0, 0, 0), (1, 1, 1), (2, 2, 1)),
        ]
        case = blocks.assemble(
            parts,
            [blocks.tie(0, 1)],
            [
                cases.Dirichlet(1, lambda x: cases.near(0)(x[2])),
                cases.Dirichlet(0, blocks.at(1, 1, 2), value=lambda t: (0.01, -0.02, 0.03)),
                cases.Dirichlet(0, blocks.at(0, 1, 2), value=lambda t: (0.02, 0.02, -0.01)),
            ],
            one_mesh=one_mesh,
        )
        u, _, _ = solve(case, multiplier=multiplier)
        return [
            cases.displacement_at(case, u, 0, p)
            for p in [(0, 0, 1), (1, 0, 1), (1 / 3, 2 / 3, 1), (1, 0, 2), (1 / 3, 1, 2)]
        ]

    one, two = displacements(True), displacements(False)
    assert np.abs(np.array(one) - two).max() < 1e-9 * np.abs(two).max()


@pytest.mark.parametrize("multiplier", ["dual", "dual-linear", "dual-reproducing"])
@pytest.mark.parametrize("kinds", [("quad8", "tri6"), ("tri6", "quad9"), ("quad9", "quad4")])
def test_condensed_is_saddle_point(kinds, multiplier):
    """Displacements, multipliers, on a curved interface in a state that is not uniform."""
    ends = [
        cases.Dirichlet(1, lambda x: cases.near(0)(x[2])),
        cases.Dirichlet(0, lambda x: cases.near(2)(x[2]), value=lambda t: (0.02, 0.01, -0.03)),
    ]
    case = blocks.curved_blocks(*(blocks.ELEMENT[kind] for kind in kinds), ends)
    (u, (tie,), _), (w, (saddle,), _) = (
        solve(case, multiplier=multiplier, condense=c) for c in (True, False)
    )
    for a, b in [*zip(u, w, strict=True), (tie.multiplier, saddle.multiplier)]:
        largest = np.abs(b.x.array).max(initial=1e-30)
        assert np.abs(a.x.array - b.x.array).max(initial=0) < 1e-10 * max(largest, 1e-6)


@multipliers
@pytest.mark.parametrize(
    "element", ["hex20", "tet10", *(pytest.param(e, marks=serial) for e in ("hex8", "hex27"))]
)
def test_several_interfaces(element, multiplier):
    """Three blocks tied to each other, with a line where all meet, on symmetry planes and sides.

    Two stand on a third and lean on each other: nodes of the line belong to two interfaces, and
    on the sides displacements are prescribed, in parts or entirely.
    """
    parts = [
        blocks.block("left", element, (0, 0, 1), (1, 1, 2), (3, 3, 2)),
        blocks.block("right", element, (1, 0, 1), (2, 1, 2), (2, 4, 3)),
        blocks.block("lower", element, (0, 0, 0), (2, 1, 1), (5, 2, 1)),
    ]
    strain = 1e-3 * np.diag([2.0, -1.0, -3.0])

    exact_on = [
        # The outer sides of all blocks in normal direction, one side entirely
        *((p, 0, s) for p, s in ((0, 0.0), (1, 2.0), (2, 0.0), (2, 2.0))),
        *((p, 1, s) for p in range(3) for s in (0.0, 1.0)),
        *((p, 2, s) for p, s in ((0, 2.0), (1, 2.0), (2, 0.0))),
    ]
    conditions = [
        cases.Dirichlet(
            p,
            lambda x, i=i, s=s: cases.near(s)(x[i]),
            (i,),
            value=lambda t, i=i, s=s: strain[i] * s,
        )
        for p, i, s in exact_on
    ]
    interfaces = [
        blocks.tie(0, 2),
        blocks.tie(1, 2),
        blocks.tie(0, 1, "x+", "x-"),
    ]
    case = blocks.assemble(parts, interfaces, conditions, exact=lambda part, x: strain @ x)
    u, _, _ = solve(case, multiplier=multiplier)
    assert relative_error(case, u) < 1e-9


@pytest.mark.parametrize("element", ["hex20", pytest.param("tet10", marks=serial)])
def test_interfaces_agree_on_the_basis_where_they_meet(element):
    """One of two interfaces with common nodes is covered in part: B T is what was integrated."""
    parts = [
        blocks.block("upper", element, (0, 0, 1), (2, 1, 2), (4, 2, 1)),
        blocks.block("lower", element, (0, 0, 0), (2, 1, 1), (3, 2, 1)),
        blocks.block("beside", element, (2, 0, 1.3), (3, 0.7, 2), (2, 2, 2)),
    ]
    clamped = [cases.Dirichlet(1, lambda x: cases.near(0)(x[2]))]
    case = blocks.assemble(parts, [blocks.tie(0, 1), blocks.tie(0, 2, "x+", "x-")], clamped)
    s = cases.make_problem(case)
    positive = [i.state.basis.nonnegative[: nodal.number(i)] for i in s.interfaces]
    found = [MPI.COMM_WORLD.allreduce(int(p.sum())) for p in positive]
    assert found[1] > found[0] > 0  # the covered one has some, on the common line
    step = s.problem._cpp_object.step
    B, B_tilde = step.B_ties, step.B_tilde_ties
    difference = B.matMult(step.T)
    difference.axpy(-1.0, B_tilde)
    assert difference.norm() < 1e-14 * B.norm()


@pytest.mark.parametrize(
    ("given", "kinds", "element", "expected"),
    [
        ((None, None), ("tie", "tie"), "hex20", "dual-reproducing"),
        ((None, None), ("tie", "contact"), "hex20", "dual"),
        ((None, None), ("tie", "contact"), "tet10", "dual"),
        ((None, "dual-linear"), ("tie", "tie"), "hex20", "dual-linear"),
        (("dual", "dual-linear"), ("tie", "tie"), "hex20", None),
    ],
)
def test_interfaces_agree_on_the_space_where_they_meet(given, kinds, element, expected):
    """The default follows what is given for another one; two that are given must agree."""
    parts = [
        blocks.block("upper", element, (0, 0, 1), (2, 1, 2), (2, 1, 1)),
        blocks.block("lower", element, (0, 0, 0), (2, 1, 1), (3, 1, 1)),
        blocks.block("beside", element, (2, 0, 1), (3, 1, 2), (1, 2, 2)),
    ]
    pairs = [blocks.tie(0, 1), blocks.tie(0, 2, "x+", "x-")]
    for pair, kind in zip(pairs, kinds, strict=True):
        pair.kind = kind
    clamped = [cases.Dirichlet(1, lambda x: cases.near(0)(x[2]))]
    case = blocks.assemble(parts, pairs, clamped)
    made = [cases.make_interfaces(case, multiplier=space)[i] for i, space in enumerate(given)]
    u = cases.displacements(case)
    forms = cases.residuals(case, u)
    if expected is None:
        with pytest.raises(ValueError, match="share slave nodes"):
            dm.ContactProblem(forms, u, interfaces=made)
    else:
        dm.ContactProblem(forms, u, interfaces=made)
        assert [i.multiplier_space for i in made] == [expected] * 2


@pytest.mark.parametrize(
    ("shape", "curved"),
    [
        (lambda x, y: 0.0, False),
        (lambda x, y: 0.1 * x + 0.2 * y, False),
        (lambda x, y: 0.05 * x**2, True),
        (lambda x, y: 0.1 * np.abs(x - 0.5), True),  # a kink between plane facets
        (lambda x, y: np.where(x > 0.5, x - 0.5, 0), False),  # an edge of 45 degrees
    ],
)
@pytest.mark.parametrize("element", ["hex8", "tet10", "hex20", "hex27"])
def test_default_space_of_contacts(element, shape, curved):
    """Corners of tri6 where the master is curved, all nodes elsewhere."""
    parts = [
        blocks.block("upper", element, (0, 0, 1), (1, 1, 2), (1, 1, 1)),
        blocks.block(
            "lower", "hex20", (0, 0, 0), (1, 1, 1), (2, 1, 1), top=lambda x, y: 1 + shape(x, y)
        ),
    ]
    pair = blocks.tie(0, 1)
    pair.kind = "contact"
    case = blocks.assemble(parts, [pair], [cases.Dirichlet(0, lambda x: x[2] > 1.5)])
    contact = cases.make_problem(case).interfaces[0]
    assert contact.multiplier_space == ("dual-linear" if element == "tet10" and curved else "dual")


@multipliers
@pytest.mark.parametrize(
    "kinds", [("quad8", "tri6"), *(pytest.param(p, marks=serial) for p in PAIRINGS[7:25:15])]
)
def test_clamped_slave_nodes(kinds, multiplier):
    """A side is held in every component, slave nodes of the interface with it."""
    case = blocks.stressed_blocks(*(blocks.ELEMENT[kind] for kind in kinds), STRAIN)

    # One linear function for each component: a Dirichlet value varies along the side
    conditions = cases.DirichletConditions(case).bcs
    for p in range(2):
        V = case.bodies[case.body[p]].V
        exact = fem.Function(V)
        exact.interpolate(lambda x: STRAIN @ x)
        dofs = fem.locate_dofs_geometrical(V, lambda x: cases.near(0)(x[0]))
        conditions.append(fem.dirichletbc(exact, dofs))
    u = cases.displacements(case)
    problem = dm.ContactProblem(
        cases.residuals(case, u),
        u,
        bcs=conditions,
        interfaces=cases.make_interfaces(case, multiplier=multiplier),
    )
    problem.solve()
    assert relative_error(case, u) < 1e-10


def move_ends(case, motion):
    bcs = []
    for p, z in ((1, 0), (0, 2)):
        V = case.bodies[case.body[p]].V
        value = fem.Function(V)
        value.interpolate(motion)
        dofs = fem.locate_dofs_geometrical(V, lambda x, z=z: cases.near(z)(x[2]))
        bcs.append(fem.dirichletbc(value, dofs))
    return bcs


def largest_departure(case, u, motion):
    """From a given motion, over all nodes."""
    worst = 0.0
    for body, w in zip(case.bodies, u, strict=True):
        exact = fem.Function(body.V)
        exact.interpolate(motion)
        worst = max(worst, np.abs(w.x.array - exact.x.array).max(initial=0))
    return case.bodies[0].mesh.comm.allreduce(worst, op=MPI.MAX)


CURVED = [("tri3", "quad4"), ("quad4", "tri6"), ("quad8", "quad9"), ("tri6", "quad8")]


def solve_moved(case, motion, multiplier="dual", ties=None):
    u = cases.displacements(case)
    problem = dm.ContactProblem(
        cases.residuals(case, u),
        u,
        bcs=move_ends(case, motion),
        interfaces=ties or cases.make_interfaces(case, multiplier=multiplier),
    )
    problem.solve()
    return u


@pytest.mark.parametrize("multiplier", ["dual", pytest.param("standard", marks=serial)])
@pytest.mark.parametrize("kinds", CURVED)
def test_translation_of_a_curved_tie(kinds, multiplier):
    """The two surfaces do not coincide; that gap must not be closed."""
    case = blocks.curved_blocks(*(blocks.ELEMENT[kind] for kind in kinds), [])

    def motion(x):
        return np.array([[0.3], [-0.2], [0.5]]) + 0 * x

    u = solve_moved(case, motion, multiplier)
    assert largest_departure(case, u, motion) < 1e-10


ON_EDGES = [("quad8", "dual"), ("tri6", "dual")]


@multipliers
@pytest.mark.parametrize("isoparametric", [False, True], ids=["straight", "isoparametric"])
@pytest.mark.parametrize("kinds", [CURVED[0], *(pytest.param(k, marks=serial) for k in CURVED[1:])])
def test_rotation_after_relocation(kinds, isoparametric, multiplier):
    """A rotation (linearised, as the material is) strains a curved tie, but not a relocated one.

    With multipliers on edges straight cells cannot follow: it gets better.
    """
    spin = 0.1 * np.array([[0, -1, 0.5], [1, 0, -0.7], [-0.5, 0.7, 0]])

    def motion(x):
        return spin @ x

    elements = (blocks.ELEMENT[kind] for kind in kinds)
    case = blocks.curved_blocks(*elements, [], isoparametric=isoparametric)
    before = largest_departure(case, solve_moved(case, motion, multiplier), motion)
    assert 1e-4 < before < 1e-2
    ties = cases.make_interfaces(case, multiplier=multiplier)
    assert 0 < dm.relocate(ties[0], move_ends(case, motion)) < 0.1
    after = largest_departure(case, solve_moved(case, motion, ties=ties), motion)
    stiff = (kinds[0], multiplier) in ON_EDGES and not isoparametric
    assert after < (before if stiff else 1e-12)
