# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Contact of slave surfaces with edges: one condition for each patch that meets a master."""

from mpi4py import MPI

import blocks
import cases
import nodal
import numpy as np
import oracle
import pytest
from blocks import FACES
from corner import PRESSURE, corner

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
    # As far as a direct solver gets: of a saddle point on five ranks one solve is good to 2e-10
    options = {"snes_rtol": 1e-12}
    s = cases.make_problem(case, petsc_options=options, multiplier=multiplier, geometry="reference")
    s.problem.solve()
    scale = max(PRESSURE) / blocks.E
    assert largest_error(s, case) < 1e-10 * scale
    assert np.allclose(s.contact.force, PRESSURE, rtol=0, atol=1e-9)
    assert np.allclose(s.contact.master_force, [-p for p in PRESSURE], rtol=0, atol=1e-9)


def cube_on_plate(element, faces, top, **options):
    """A neo-Hookean cube pressed on a plate; some of its faces are the slave surface."""
    energy = cases.neo_hooke(blocks.E, blocks.NU)
    parts = [
        blocks.block("cube", element, (0, 0, 0), (1, 1, 1), (3, 3, 2), energy),
        blocks.block("plate", element, (-1, -1, -0.5), (2, 2, 0), (3, 3, 1), energy),
    ]
    held = [
        cases.Dirichlet(0, lambda x: cases.near(1)(x[2]), value=lambda t: top),
        cases.Dirichlet(1, lambda x: cases.near(-0.5)(x[2])),
    ]
    contact = cases.Interface(
        "contact", [(0, FACES[f]) for f in faces], [(1, FACES["z+"])], initially_active=False
    )
    return cases.make_problem(blocks.assemble(parts, [contact], held), **options)


@pytest.mark.parametrize("element", ["hex8", "tet10", "hex20", "hex27"])
@pytest.mark.parametrize("friction", [None, 0.3], ids=["frictionless", "friction"])
def test_sides_of_a_cube_change_nothing(element, friction):
    """Faces that meet no master may be tagged with the one that does."""
    top = (0.02, 0.01, -0.05) if friction else (0.0, 0.0, -0.05)
    results = []
    for faces in (["z-"], ["z-", "x-", "x+", "y-", "y+"]):
        s = cube_on_plate(element, faces, top, friction=friction)
        s.problem.solve()
        results.append((nodal.by_position(s.u[0]), s.contact.force, s.contact.num_active))
    (u, force, active), (u_all, force_all, active_all) = results
    assert active == active_all
    assert np.abs(force - force_all).max() < 1e-10 * np.abs(force).max()
    assert np.abs(u - u_all).max() < 1e-10 * 0.05


def neo_hookean_corner(slave, master, walls, **options):
    case = corner(slave, master, energy=cases.neo_hooke(blocks.E, blocks.NU), walls=walls)
    return cases.make_problem(case, **options)


@pytest.mark.parametrize("walls", [1, 2])
@pytest.mark.parametrize("friction", [None, 0.3], ids=["frictionless", "friction"])
def test_condensed_iterates_are_those_of_the_saddle_point(walls, friction):
    """Nodes on edges lose two and three multipliers at once."""
    histories, solutions = [], []
    for condense in (True, False):
        s = neo_hookean_corner("hex20", "hex8", walls, friction=friction, condense=condense)
        s.problem.solve()
        histories.append([(h["active"], h["stick"]) for h in s.problem.history])
        solutions.append(nodal.by_position(*s.u))
    assert histories[0] == histories[1]
    scale = np.abs(solutions[0]).max()
    assert np.abs(solutions[0] - solutions[1]).max() < 1e-11 * scale


@pytest.mark.parametrize(
    "pair", [("hex8", "hex8"), ("tet10", "hex27"), ("hex20", "tet10")], ids=str
)
def test_newton_ends_quadratically_in_a_corner(pair):
    s = neo_hookean_corner(*pair, 2, friction=0.3)
    s.problem.solve()
    *_, before, last = [max(h["force"], h["constraint"]) for h in s.problem.history]
    assert last < max(100 * before**2, 1e-10)
    # In balance with the loads, and between the bodies
    assert np.allclose(s.contact.force, PRESSURE, rtol=1e-8)
    assert np.allclose(s.contact.force + s.contact.master_force, 0, atol=1e-9)


@pytest.mark.parametrize("friction", [None, 0.3], ids=["frictionless", "friction"])
def test_krylov_solvers_in_a_corner(friction):
    solutions = []
    krylov = [{"pc_type": name, "ksp_rtol": 1e-12} for name in ("cholesky", "gamg")]
    for options in ({}, *krylov):
        s = neo_hookean_corner("hex20", "hex8", 2, friction=friction, petsc_options=options)
        s.problem.solve()
        solutions.append(nodal.by_position(*s.u))
    direct, *others = solutions
    scale = np.abs(direct).max()
    for other in others:
        assert np.abs(direct - other).max() < 1e-8 * scale


@pytest.mark.parametrize("element", ["hex8", pytest.param("hex20", marks=pytest.mark.serial)])
def test_drag_along_an_edge(element):
    """A block slides in a trough: nodes on its edge have the friction of both sides."""
    friction = 0.3
    parts = [
        blocks.block("block", element, (0.5, 0, 0), (1.5, 1, 1), (3, 3, 3)),
        blocks.block("floor", "hex8", (0, 0, -0.5), (3, 1.5, 0), (4, 2, 1)),
        blocks.block("wall", "hex8", (0, -0.5, 0), (3, 0, 1.5), (4, 1, 2)),
    ]
    held = [
        cases.Dirichlet(1, lambda x: cases.near(-0.5)(x[2])),
        cases.Dirichlet(2, lambda x: cases.near(-0.5)(x[1])),
        cases.Dirichlet(
            0,
            lambda x: cases.near(1)(x[2]) & (x[1] > 0.4),
            value=lambda t: (0.1 * t, -0.02, -0.03),
        ),
    ]
    contact = cases.Interface(
        "contact",
        [(0, FACES["z-"]), (0, FACES["y-"])],
        [(1, FACES["z+"]), (2, FACES["y+"])],
        initially_active=False,
    )
    s = cases.make_problem(blocks.assemble(parts, [contact], held), friction=friction)
    # In steady sliding all nodes slip along the edge
    for t in np.arange(1.0, 9.0):
        s.step(t)
    c = s.contact
    status = c.state.status
    closed = status > 0
    n = nodal.normals(c)[closed]
    z = nodal.multipliers(c)[closed]
    pressure = np.sum(z * n, axis=1)
    tangential = z - pressure[:, None] * n
    assert np.all(status[closed] == 2)
    assert np.allclose(np.linalg.norm(tangential, axis=1), friction * pressure, rtol=1e-6)
    assert np.allclose(tangential[:, 0], friction * pressure, rtol=1e-3)
    _, patches = np.unique(c.data.slave.blocks[: len(status)][closed], return_counts=True)
    assert comm.allreduce(int(np.sum(patches == 2))) >= 3


def test_no_inverse_at_edges():
    """D has more rows than slave dofs where a node carries several multipliers."""
    s = neo_hookean_corner("hex8", "hex8", 1)
    s.problem.solve()
    with pytest.raises(RuntimeError, match="one multiplier for each of the patches"):
        _ = s.contact.P
