# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""The whole Newton system against finite differences of the whole residual.

States are random: surfaces are distorted and do not match, multipliers are not in equilibrium. A
term that is missing or wrong in a derivative shows there at once.
"""

import blocks
import cases
import dolfinx_mortar as dm
import nodal
import numpy as np
import oracle
import pytest
from corner import corner
from mirrored import level, model, punch
from scipy.sparse import bmat, csr_matrix

pytestmark = pytest.mark.serial

OPEN, STICK, SLIP = 0, 1, 2


def problem(slave, master, overhang=0.0, **options):
    """Two blocks in contact, held at the bottom; each on a mesh of its own.

    Args:
        slave: Element of the upper block.
        master: Element of the lower block.
        overhang: Length by which the upper block stands over the lower one's edge.
        **options: Of the contact.
    """
    s = overhang
    parts = [
        blocks.block("upper", slave, (s, s, 1), (1 + s, 1 + s, 1.5), (2, 2, 1)),
        blocks.block("lower", master, (0, 0, 0), (1.05, 1.02, 1), (2, 1, 1)),
    ]
    faces = blocks.FACES
    held = [cases.Dirichlet(1, lambda x: cases.near(0)(x[2]))]
    contact = cases.Interface("contact", [(0, faces["z-"])], [(1, faces["z+"])])
    case = blocks.assemble(parts, [contact], held)
    u = cases.displacements(case)
    (contact,) = cases.make_interfaces(case, initial_active="all", **options)
    bcs = cases.DirichletConditions(case).bcs
    return dm.ContactProblem(cases.residuals(case, u), u, bcs=bcs, interfaces=[contact]), contact


def sparse(A):
    indptr, indices, values = A.getValuesCSR()
    return csr_matrix((values, indices, indptr), shape=A.getSize())


def random_state(p, contact, spread):
    """State and step of a solve, and displacements and multipliers around a closed contact."""
    rng = np.random.default_rng(7)
    problem, n = p._cpp_object, p.coupling.layout.size
    # What friction remembers is another distorted state
    displace(p, 4e-3 * rng.standard_normal(n))
    state, step = problem.begin()
    x = np.zeros(n + p.coupling.size)
    x[:n] = nodal.displacements(p)
    first = problem.evaluate(state, step, x).interfaces.interfaces[0]
    x[:n] += 4e-3 * rng.standard_normal(n)
    normal = first.configuration.normals[: nodal.number(contact)]
    pressure = 20 + spread * rng.standard_normal(len(normal))
    z = pressure[:, None] * normal + 4 * rng.standard_normal((len(normal), 3))
    x[n:] = z.ravel()
    return state, step, x


def displace(p, values):
    """Set the displacements of all bodies."""
    start = 0
    for u in p.u if isinstance(p.u, list | tuple) else [p.u]:
        u.x.array[:] = values[start : start + len(u.x.array)]
        start += len(u.x.array)


def check(p, state, step, x):
    """Largest relative deviation of the Jacobian times a direction, and the law of the nodes."""
    problem, n = p._cpp_object, p.coupling.layout.size
    at = problem.evaluate(state, step, x)
    # Newton's method takes the scale of the friction equations as it is at the iterate
    step.scale = [at.interfaces.interfaces[0].scale]
    at = problem.evaluate(state, step, x)
    law = at.interfaces.interfaces[0].law
    status = law.status
    s = problem.linearise(state, step, at, damped=False)
    K = sparse(s.K)
    if s.K_c is not None:
        K = K + sparse(s.K_c)
    J = bmat([[K, sparse(s.B).T], [sparse(s.C_u), sparse(s.C_z)]]).tolil()
    J[s.fixed] = 0.0
    J[s.fixed, s.fixed] = 1.0
    J = J.tocsr()
    rng = np.random.default_rng(11)
    worst, compared = 0.0, 0
    for _ in range(4):
        d = rng.standard_normal(len(x))
        d[n:] *= 1000
        exact = J @ d
        assert np.allclose(exact, s.multiply(d), rtol=1e-12, atol=1e-12 * np.abs(exact).max())
        best = np.inf
        for h in (1e-6, 1e-7, 3e-8):
            f = []
            for sign in (h, -h):
                moved = problem.evaluate(state, step, x + sign * d)
                f.append(moved.residual.copy())
                if np.any(moved.interfaces.interfaces[0].law.status != status):
                    break
            else:
                error = np.abs((f[0] - f[1]) / (2 * h) - exact)
                best = min(
                    best,
                    max(
                        error[part].max() / np.abs(exact[part]).max()
                        for part in (slice(n), slice(n, None))
                    ),
                )
        if np.isfinite(best):
            compared += 1
            worst = max(worst, best)
    assert compared > 0
    return worst, status, law


# Friction that makes all nodes stick, slip, or some of each, in the states above
FRICTION = {"frictionless": None, "stick": 50.0, "slip": 0.02, "mixed": 0.3}
SECOND_ORDER = ("tet10", "hex20", "hex27")


def expect(state, status):
    closed = status[status != OPEN]
    if state == "stick":
        assert np.all(closed == STICK)
    elif state == "mixed":
        assert {STICK, SLIP} <= set(closed)
    else:
        assert np.all(closed == SLIP)
    assert len(closed) > 4


@pytest.mark.parametrize("state", FRICTION)
@pytest.mark.parametrize("integration", ["segment", "element"])
@pytest.mark.parametrize("overhang", [0.0, 0.3], ids=["covered", "partly covered"])
def test_states(state, integration, overhang):
    p, contact = problem(
        "hex20",
        "tet10",
        overhang,
        friction=FRICTION[state],
        integration=integration,
        c_n=1e3,
        c_t=1e3,
    )
    # Some nodes are open where the pressures are spread
    spread = 8.0 if state in ("frictionless", "mixed") else 1.0
    error, status, _ = check(p, *random_state(p, contact, spread))
    expect(state, status)
    assert error < 1e-6


@pytest.mark.parametrize("slave", SECOND_ORDER)
@pytest.mark.parametrize("master", SECOND_ORDER)
def test_second_order_pairs(slave, master):
    p, contact = problem(slave, master, 0.3, friction=0.3, c_n=1e3, c_t=1e3)
    error, status, law = check(p, *random_state(p, contact, spread=8.0))
    expect("mixed", status)
    assert error < 1e-6


@pytest.mark.parametrize("pair", [("tet4", "hex8"), ("hex8", "tet10"), ("hex20", "hex8")], ids=str)
def test_mixed_order_pairs(pair):
    p, contact = problem(*pair, 0.3, friction=0.3, c_n=1e3, c_t=1e3)
    error, *_ = check(p, *random_state(p, contact, spread=8.0))
    assert error < 1e-6


@pytest.mark.parametrize("multiplier", oracle.MULTIPLIERS)
@pytest.mark.parametrize("friction", [None, 0.3], ids=["frictionless", "friction"])
@pytest.mark.parametrize("pair", [("hex20", "hex20"), ("tet10", "hex27")], ids="-".join)
def test_multipliers(multiplier, friction, pair):
    p, contact = problem(*pair, 0.3, friction=friction, multiplier=multiplier, c_n=1e3, c_t=1e3)
    error, *_ = check(p, *random_state(p, contact, spread=8.0))
    assert error < 1e-6


@pytest.mark.parametrize("options", [{"tresca": 5.0}, {"geometry": "reference", "friction": 0.3}])
def test_tresca_and_small_deformation(options):
    p, contact = problem("hex20", "hex27", c_n=1e3, c_t=1e3, **options)
    error, *_ = check(p, *random_state(p, contact, spread=8.0))
    assert error < 1e-6


def corner_problem(slave, master, walls, **options):
    """A block in a corner: nodes on its edges are in contact with two and three bodies."""
    case = corner(slave, master, energy=cases.neo_hooke(blocks.E, blocks.NU), walls=walls)
    u = cases.displacements(case)
    (contact,) = cases.make_interfaces(case, initial_active="all", **options)
    bcs = cases.DirichletConditions(case).bcs
    return dm.ContactProblem(cases.residuals(case, u), u, bcs=bcs, interfaces=[contact]), contact


@pytest.mark.parametrize("state", FRICTION)
@pytest.mark.parametrize(
    "pair", [("hex8", "hex8"), ("hex20", "tet10"), ("tet10", "hex27")], ids=str
)
@pytest.mark.parametrize("walls", [1, 2])
def test_edges(state, pair, walls):
    p, contact = corner_problem(*pair, walls, friction=FRICTION[state], c_n=1e3, c_t=1e3)
    error, status, law = check(p, *random_state(p, contact, spread=4.0))
    assert (len(law.couplings.rows) > 0) == (state != "frictionless")
    assert np.sum(status != OPEN) > np.sum(nodal.has_multiplier(contact)) / 2
    assert error < 1e-8


@pytest.mark.parametrize("state", FRICTION)
@pytest.mark.parametrize("pair", [("hex20", "tet10"), ("tet10", "hex27")], ids=str)
def test_offset(state, pair):
    """An offset that varies along the surface; nodes of edges have one value."""
    p, contact = corner_problem(*pair, 1, friction=FRICTION[state], c_n=1e3, c_t=1e3)
    x = contact.data.slave.X.reshape(-1, 3)
    p._cpp_object.set_offset(0, 0.02 * np.sin(7 * x[:, 0] + 3 * x[:, 1]))
    error, status, _ = check(p, *random_state(p, contact, spread=4.0))
    assert np.sum(status != OPEN) > np.sum(nodal.has_multiplier(contact)) / 2
    assert error < 1e-8


@pytest.mark.parametrize("state", FRICTION)
def test_planes_of_symmetry(state):
    """Prescribed components at slave nodes: of displacements, normals and tractions."""
    options = {"friction": FRICTION[state], "initial_active": "all", "c_n": 1e3, "c_t": 1e3}
    layers = punch(("hex20", "tet10"))
    layers[0].surfaces = (level(1), layers[0].surfaces[1])
    layers[1].surfaces = (layers[1].surfaces[0], level(1))
    m = model(layers, [(dm.Contact, options)], (0, 1))
    p, contact = m.problem, m.contact
    error, status, law = check(p, *random_state(p, contact, spread=1.0))
    held = contact.data.fixed[: nodal.number(contact)].astype(bool)
    # Where the planes meet a node cannot slide
    on_both = held[:, 0] & held[:, 1]
    assert np.any(on_both) and np.any(held[:, 0] & ~on_both) and np.any(held[:, 1] & ~on_both)
    expect(state, status[~on_both])
    assert error < 1e-6
