# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Fields of an interface: what they show, and when."""

import tempfile
from pathlib import Path

from mpi4py import MPI

import dolfinx_mortar as dm
import nodal
import numpy as np
import oracle
import pytest
import ufl
from dolfinx import fem, la, mesh
from dolfinx.io import VTXWriter
from pressed import pressed

comm = MPI.COMM_WORLD
NAMES = (
    "multiplier",
    "traction",
    "recovered_traction",
    "pressure",
    "recovered_pressure",
    "gap",
    "slip",
    "status",
    "tangential_traction",
)


def norms(contact):
    return [la.norm(getattr(contact, name).x) for name in NAMES]


def test_fields_are_the_same_objects():
    """They are zero before the first solve, then show each accepted state and no other."""
    p = pressed(dm.Contact, friction=0.3)
    c = p.interface
    first = {name: getattr(c, name) for name in NAMES}
    assert all(f.name == name and la.norm(f.x) == 0 for name, f in first.items())
    p.move(0.0, -0.01)
    one = norms(c)
    assert min(n for n, name in zip(one, NAMES, strict=True) if name not in ("gap", "slip")) > 0
    p.move(0.02, -0.02)
    two = norms(c)
    assert two[NAMES.index("pressure")] > 1.5 * one[NAMES.index("pressure")]
    assert two[NAMES.index("slip")] > 0
    assert all(getattr(c, name) is f for name, f in first.items())
    with pytest.raises((dm.ConvergenceError, RuntimeError)):
        p.move(np.nan, -0.02)
    assert norms(c) == two


def test_fields_after_a_cut_step_that_fails():
    """A half of a step that was accepted is not shown when the rest fails."""
    p = pressed(dm.Contact, friction=0.3)
    p.move(0.0, -0.01)
    before = norms(p.interface)
    halves = []

    def load(t):
        halves.append(t)
        p.top.value[:] = (0.0, 0.0, -0.01 - 0.01 * t) if t <= 0.5 else np.nan

    with pytest.raises(dm.ConvergenceError):
        p.problem.solve(adaptive=load, max_cuts=2)
    assert 0.5 in halves
    np.testing.assert_allclose(norms(p.interface), before, rtol=1e-9, atol=1e-12)


def test_fields_after_loading():
    folder = Path(comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else None))
    p = pressed(dm.Contact, friction=0.3)
    p.move(0.0, -0.01)
    one = norms(p.interface)
    p.problem.save(folder / "state")
    p.move(0.02, -0.02)
    p.problem.load(folder / "state")
    np.testing.assert_allclose(norms(p.interface), one, rtol=1e-8, atol=1e-10)


def test_a_writer_that_is_opened_once_writes_each_step():
    p = pressed(dm.Contact)
    folder = comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else None)
    path = Path(folder) / "contact.bp"
    steps = []
    with VTXWriter(comm, str(path), [p.interface.pressure, p.interface.gap], "BP4") as file:
        for k, z in enumerate((-0.01, -0.02)):
            p.move(0.0, z)
            file.write(float(k))
            steps.append(p.interface.pressure.x.array.max(initial=0))
    comm.Barrier()
    # Such files hold plain doubles
    written = b"".join(part.read_bytes() for part in sorted(path.glob("data.*")))
    largest = [comm.allreduce(float(value), op=MPI.MAX) for value in steps]
    assert all(np.float64(value).tobytes() in written for value in largest)
    assert largest[1] > 1.5 * largest[0]


def height(x):
    """Gap between the slave and the master: small, and beyond a bend large."""
    return 0.12 * np.minimum(x[0], 0.5) + 4 * np.maximum(x[0] - 0.75, 0)


def plate_below_bent_master():
    """Bodies, their facet tags, and conditions that press them together at x = 0."""
    box = mesh.CellType.hexahedron
    plate = mesh.create_box(comm, [np.zeros(3), np.ones(3)], [2, 2, 1], box)
    master = mesh.create_box(comm, [np.array([0, 0, 1.0]), np.array([1, 1, 1.5])], [8, 4, 1], box)
    upper = mesh.locate_entities_boundary(plate, 2, lambda x: np.isclose(x[2], 1))
    lower = mesh.locate_entities_boundary(master, 2, lambda x: np.isclose(x[2], 1))
    tags = [mesh.meshtags(plate, 2, upper, 1), mesh.meshtags(master, 2, lower, 1)]
    master.geometry.x[:, 2] += height(master.geometry.x.T)
    V = fem.functionspace(plate, dm.hex20(shape=(3,)))
    W = fem.functionspace(master, ("Lagrange", 1, (3,)))
    u = [fem.Function(V), fem.Function(W)]
    strain = [ufl.sym(ufl.grad(w)) for w in u]
    F = [ufl.derivative(50 * ufl.inner(e, e) * ufl.dx, w) for e, w in zip(strain, u, strict=True)]
    bottom = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[2], 0))
    whole = fem.locate_dofs_geometrical(W, lambda x: x[2] > 0)
    bcs = [
        fem.dirichletbc(np.zeros(3), bottom, V),
        fem.dirichletbc(np.array([0, 0, -0.01]), whole, W),
    ]
    return F, u, tags, bcs


def test_no_penetration_far_away():
    """The multiplier's functions are negative in places, distances are not."""
    F, u, tags, bcs = plate_below_bent_master()
    spaces = [w.function_space for w in u]
    wide = {"search_distance": 10.0, "max_angle": 85.0}
    contact = dm.Contact(spaces, tags, slave=1, master=1, **wide)
    dm.ContactProblem(F, u, bcs=bcs, interfaces=[contact]).solve()
    gap = contact.evaluation.gap / nodal.weights(contact)
    feigned = np.where(contact.state.status == 0, gap, 0.0)
    assert comm.allreduce(float(feigned.min(initial=0)), op=MPI.MIN) < -0.05
    status, gap = contact.status.x.array, contact.gap.x.array
    assert comm.allreduce(int(np.sum(status > 0))) > 0
    assert np.all(gap[status == 0] > -1e-9)
    # The mean distance of the facets beyond the middle
    x = contact.gap.function_space.tabulate_dof_coordinates()
    far = gap[(x[:, 0] > 0.7) & (x[:, 2] > 0.9)]
    np.testing.assert_allclose(far, 0.06 + 0.25 - 0.01, atol=0.02)


@pytest.mark.parametrize("multiplier", oracle.MULTIPLIERS)
@pytest.mark.parametrize("element", ["hex8", "tet10", "hex20", "hex27"])
def test_recovered_traction_of_a_tie_has_the_resultant(element, multiplier):
    """On a plane surface, to round-off: the sum of the nodal forces."""
    p = pressed(dm.Tie, elements=(element, "hex8"), multiplier=multiplier)
    p.move(0.01, -0.02)
    tie = p.interface
    z, f = tie.D.createVecLeft(), tie.D.createVecRight()
    z.array = p.problem.state.z
    tie.D.multTranspose(z, f)
    force = -comm.allreduce(f.array.reshape(-1, 3).sum(axis=0))
    found = integrals(tie, tie.recovered_traction)
    assert np.linalg.norm(force) > 1e-3
    assert np.abs(found - force).max() < 1e-12 * np.linalg.norm(force)


@pytest.mark.parametrize("multiplier", oracle.MULTIPLIERS)
@pytest.mark.parametrize("element", ["hex8", "tet10", "hex20", "hex27"])
def test_recovered_pressure_has_the_resultant(element, multiplier):
    """Of contact with friction, and is the normal part of the recovered traction."""
    p = pressed(
        dm.Contact,
        elements=(element, "hex8"),
        friction=0.3,
        geometry="reference",
        multiplier=multiplier,
    )
    p.move(0.0, -0.005)
    p.move(0.001, -0.005)
    contact = p.interface
    force = contact.force
    assert np.linalg.norm(force) > 1e-3
    found = integrals(contact, contact.recovered_traction)
    assert np.abs(found - force).max() < 1e-12 * np.linalg.norm(force)
    (pressed_with,) = integrals(contact, contact.recovered_pressure)
    assert pressed_with == pytest.approx(force[2], rel=1e-12)


@pytest.mark.parametrize("multiplier", oracle.MULTIPLIERS)
@pytest.mark.parametrize("element", ["hex8", "tet10", "hex20", "hex27"])
def test_facet_multipliers_have_the_nodal_forces(element, multiplier):
    """∫ N_k λ_h = (Dᵀ z)_k at each slave node, with λ_h integrated by itself."""
    p = pressed(dm.Tie, elements=(element, "hex8"), multiplier=multiplier)
    tie = p.interface
    with pytest.raises(RuntimeError, match="no solution yet"):
        _ = tie.facet_multipliers
    p.move(0.01, -0.02)
    z, f = tie.D.createVecLeft(), tie.D.createVecRight()
    z.array = p.problem.state.z
    tie.D.multTranspose(z, f)
    expected = np.vstack(comm.allgather(f.array.reshape(-1, 3)))
    slave, values = tie.data.slave, tie.facet_multipliers
    assert values.shape == (len(slave.nodes), 3)
    kind = {"hex8": "quad4", "tet10": "tri6", "hex20": "quad8", "hex27": "quad9"}[element]
    xi, w = oracle.facet_rule(kind, 4)
    found = np.zeros_like(expected)
    for begin, end in zip(slave.offsets[:-1], slave.offsets[1:], strict=True):
        nodes = slave.nodes[begin:end]
        N, _ = oracle.shape_functions(kind, xi)
        _, tangents = oracle.evaluate(kind, slave.X.reshape(-1, 3)[nodes], xi)
        area = np.linalg.norm(np.cross(tangents[:, 0], tangents[:, 1]), axis=1) * w
        found[slave.blocks[nodes]] += N.T @ (area[:, None] * (N @ values[begin:end]))
    found = comm.allreduce(found)
    assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


def integrals(interface, field):
    """Of the components of a field over the slave surface."""
    (slave,) = interface.slave
    ds = ufl.Measure("ds", slave.V.mesh, subdomain_data=slave.tags)(slave.tag)
    components = [field] if field.ufl_shape == () else [field[i] for i in range(3)]
    forms = [fem.form(f * ds) for f in components]
    return np.array([comm.allreduce(fem.assemble_scalar(f)) for f in forms])
