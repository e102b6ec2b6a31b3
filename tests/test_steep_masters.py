# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Masters that are steep above the slave: what is left out, that it is counted, and said."""

from mpi4py import MPI

import cases
import dolfinx_mortar as dm
import numpy as np
import oracle
import pytest
import ufl
from blocks import FACES, NU, E, block
from dolfinx import fem
from facet_pairs import INTEGRATION, PAIRINGS, TYPE, in_facet_order, one_facet
from numpy.linalg import norm
from pressed import pressed

comm = MPI.COMM_WORLD
pairings = pytest.mark.parametrize("pairing", PAIRINGS, ids="-".join)
integrations = pytest.mark.parametrize("integration", INTEGRATION)


def turned(kind, angle, distort=0.0, seed=0):
    """A master above the middle of a facet, turned by an angle [degrees]."""
    rng = np.random.default_rng(seed)
    surface = one_facet(kind, rng, distort, -1)
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    surface.x = surface.x @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T
    return surface


def points(slave, master, integration="segment", **options):
    a, b = slave.facets[0][0], master.facets[0][0]
    return dm.cpp.pair_points(
        TYPE[a],
        int(slave.sign[0]),
        in_facet_order(slave),
        TYPE[b],
        int(master.sign[0]),
        in_facet_order(master),
        INTEGRATION[integration],
        6,
        False,
        **options,
    )


@pytest.mark.serial
@pairings
@integrations
def test_whole_parts_are_left_out(pairing, integration):
    """On the one side of the angle all of a plane master is kept, on the other nothing."""
    rng = np.random.default_rng(4)
    slave = one_facet(pairing[0], rng, 0.0)
    for limit in (40.0, 70.0, 85.0):
        kept = points(slave, turned(pairing[1], limit - 1), integration, max_angle=limit)
        left_out = points(slave, turned(pairing[1], limit + 1), integration, max_angle=limit)
        # The points of a slave facet may miss one so steep
        assert len(kept.w) > 0 or (integration == "element" and limit > 70)
        assert kept.dropped_area < 1e-12
        assert len(left_out.w) == 0
        everything = points(slave, turned(pairing[1], limit + 1), integration, max_angle=89.9)
        assert left_out.dropped_area == pytest.approx(everything.w.sum(), rel=1e-10)


@pytest.mark.serial
@pairings
def test_points_lie_on_the_master(pairing):
    """However curved and steep it is, up to the mismatch of linear parts; the rest is counted."""
    lost = kept = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        slave = one_facet(pairing[0], rng, 0.0)
        master = turned(pairing[1], rng.uniform(0, 89), 0.1, seed)
        for integration in INTEGRATION:
            p = points(slave, master, integration)
            eta = p.eta
            beyond = np.maximum(-eta.min(axis=1, initial=0), 0)
            inside = eta.sum(axis=1) if pairing[1].startswith("tri") else eta.max(axis=1, initial=0)
            assert np.maximum(beyond, inside - 1).max(initial=0) <= 0.1 + 1e-12
            assert np.all(p.w > 0)
            kept += p.w.sum()
            lost += p.dropped_area
    assert kept > 0 and lost > 0


@pytest.mark.serial
@pytest.mark.parametrize("max_angle", [0.0, 90.0, -1.0, np.nan])
def test_angles_that_make_no_sense(max_angle):
    slave, master = one_facet("tri3", np.random.default_rng(1), 0), turned("tri3", 0)
    with pytest.raises(ValueError, match="max_angle"):
        integrate(slave, master, max_angle)
    with pytest.raises(ValueError, match="max_angle"):
        pressed(dm.Tie, max_angle=max_angle)


def integrate(slave, master, max_angle):
    n, m = len(slave.x), len(master.x)
    return dm.cpp.integrate_facet(
        TYPE[slave.facets[0][0]],
        1,
        in_facet_order(slave),
        oracle.averaged_normals(slave),
        np.ones(n, np.int8),
        np.zeros((n, 3)),
        [TYPE[master.facets[0][0]]],
        np.array([-1], np.int8),
        np.arange(m),
        in_facet_order(master),
        dm.cpp.MultiplierSpace.dual,
        dm.cpp.Integration.segment,
        None,
        dm.cpp.Derivatives.none,
        max_angle=max_angle,
    )


# -- A plate over a smaller block whose walls belong to the master too -----------------------------

WALLS = ("x-", "x+", "y-", "y+")


class Plate:
    """A plate that stands over the edges of a block.

    Args:
        faces: Faces of the block that are master.
        element: Kind of cells.
        kind: Interface.
        top: Height of the block's top.
        options: Options of the interface.
    """

    def __init__(self, faces, element="hex8", kind=dm.Contact, top=None, **options):
        parts = [
            block("upper", element, (-0.5, -0.5, 1.0), (1.5, 1.5, 1.4), (4, 4, 1)),
            block("lower", element, (0, 0, 0), (1, 1, 1), (2, 2, 2), top=top),
        ]
        bodies, _ = cases._bodies(comm, parts, False)
        self.u = [fem.Function(b.V) for b in bodies]
        energy = cases.neo_hooke(E, NU)
        dx = ufl.dx(metadata={"quadrature_degree": 3})
        forms = [ufl.derivative(energy(u) * dx, u) for u in self.u]
        self.top = fem.Constant(bodies[0].mesh, np.zeros(3))
        bcs = []
        zero = fem.Constant(bodies[1].mesh, np.zeros(3))
        for b, value, z in zip(bodies, (self.top, zero), (1.4, 0.0), strict=True):
            dofs = fem.locate_dofs_geometrical(b.V, lambda x, z=z: np.isclose(x[2], z))
            bcs.append(fem.dirichletbc(value, dofs, b.V))
        self.bodies = upper, lower = bodies
        self.faces = faces
        self.interface = kind(
            slave=[(upper.V, upper.facet_tags, FACES["z-"])],
            master=[(lower.V, lower.facet_tags, FACES[face]) for face in faces],
            **options,
        )
        self.problem = dm.ContactProblem(forms, self.u, bcs=bcs, interfaces=[self.interface])

    def drag(self):
        """Press, then move sideways: forces of each step."""
        forces = []
        for x, z in ((0, -0.03), (0.02, -0.06), (0.06, -0.06)):
            self.top.value[:] = x, 0, z
            self.problem.solve()
            forces.append(self.interface.force)
        return np.array(forces)


def bulge(plate, amplitude, noise):
    """Move the walls of the lower block out, and all of its nodes below the top at random."""
    u = plate.u[1]
    x = u.function_space.tabulate_dof_coordinates()
    # The same at a place on all ranks
    v = noise * np.sin(1e3 * x[:, [1, 2, 0]] + 7e2 * x) * (x[:, 2:] < 0.99)
    v[:, :2] += 2 * amplitude * (x[:, :2] - 0.5) * np.sin(np.pi * x[:, 2:])
    u.x.array[:] = v.ravel()


def largest_row(M):
    """Largest sum of magnitudes in a row, of all ranks."""
    indptr, _, values = M.getValuesCSR()
    rows = np.add.reduceat(np.append(np.abs(values), 0), indptr[:-1]) * (np.diff(indptr) > 0)
    return comm.allreduce(rows.max(initial=0), op=MPI.MAX)


@pytest.mark.parametrize("element", ["hex8", "hex27"])
@integrations
def test_rows_are_bounded(element, integration):
    """Near-vertical walls do not get into M: its rows are as without them."""
    plate = Plate(("z+", *WALLS), element, integration=integration)
    alone = Plate(("z+",), element, integration=integration)
    area = comm.allreduce(plate.interface.weights.max(initial=0), op=MPI.MAX)
    expected = largest_row(alone.interface.M)
    assert expected < 2.2 * area
    for amplitude, noise in ((0.0, 0.0), (0.0, 0.01), (0.005, 0.0), (0.02, 0.01), (0.05, 0.0)):
        bulge(plate, amplitude, noise)
        assert largest_row(plate.interface.M) == pytest.approx(expected, rel=1e-9)


def seen(plate):
    """M of the slow reference and the bound of its rows, per node of the slave surface (serial).

    Both at the positions as they are, with the library's choice of a basis.
    """
    i, (upper, lower) = plate.interface, plate.bodies
    slave, dofs = cases.oracle_surface(upper.V, upper.facet_tags, FACES["z-"], plate.u[0])
    parts = [
        cases.oracle_surface(lower.V, lower.facet_tags, FACES[face], plate.u[1])
        for face in plate.faces
    ]
    start = np.cumsum([0, *(len(part.x) for part, _ in parts)])
    master = oracle.Surface(
        np.vstack([part.x for part, _ in parts]),
        [
            (k, n + s)
            for (part, _), s in zip(parts, start[:-1], strict=True)
            for k, n in part.facets
        ],
        np.concatenate([part.sign for part, _ in parts]),
    )
    columns = upper.V.dofmap.index_map.size_global + np.concatenate([d for _, d in parts])
    nonnegative = np.zeros(upper.V.dofmap.index_map.size_local, np.int8)
    nonnegative[i.data.slave.local_blocks] = i.state.basis.nonnegative
    assert np.all(i.state.basis.has_multiplier)

    M, bound = np.zeros((len(slave.x), columns.max() + 1)), np.zeros(len(slave.x))
    points = oracle.segment_points(slave, master, 9, max_angle=70)
    for f, (xi, eta, at, w) in enumerate((p.xi, p.eta, p.master, p.weight) for p in points):
        if w.sum() < 1e-10:
            continue
        kind, nodes, _, _ = slave.facet(f)
        T = dm.cpp.transformation(dm.cpp.MultiplierSpace.dual, TYPE[kind], nonnegative[dofs][nodes])
        functions = oracle.shape_functions(kind, xi)[0] @ T
        functions = functions @ oracle.dual_coefficients(functions, w).T
        most = 0
        for g in np.unique(at):
            here = at == g
            N = oracle.shape_functions(kind, eta[here])[0]
            most = max(most, np.abs(N).sum(axis=1).max())
            M[np.ix_(nodes, columns[master.facets[g][1]])] += functions[here].T @ (
                w[here, None] * N
            )
        bound[nodes] += most * (w @ np.abs(functions))
    return M, bound


@pytest.mark.serial
@pytest.mark.parametrize("element, largest", [("hex8", 1.0), ("hex27", 3.2)])
def test_rows_of_walls_that_are_seen(element, largest):
    """Walls below the angle do get into M, with the exact integrals.

    They cover strips and corners of facets. Dual functions of second order have large values of
    both signs there, so that a row of |M| can have several times the area of its node, which is
    no more than ∫|Φ_j| allows.
    """
    plate = Plate(("z+", *WALLS), element, quadrature_degree=18)
    area = plate.interface.weights.max()
    found = 0
    for amplitude in (0.15, 0.2):
        bulge(plate, amplitude, 0.0)
        indptr, columns, values = plate.interface.M.getValuesCSR()
        expected, bound = seen(plate)
        M = np.zeros((3 * len(expected), 3 * expected.shape[1]))
        M[np.repeat(np.arange(len(M)), np.diff(indptr)), columns] = values
        M = M[::3, ::3]
        assert np.abs(M - expected).max() < 1e-7 * area
        rows = np.abs(M).sum(axis=1)
        assert np.all(rows <= (1 + 1e-6) * bound)
        found = max(found, rows.max() / area)
    assert found == pytest.approx(largest, rel=0.05)


@pytest.mark.parametrize("friction", [None, 0.3])
def test_walls_take_no_part(friction):
    """Forces are those of the top alone."""
    forces = Plate(("z+", *WALLS), friction=friction).drag()
    expected = Plate(("z+",), friction=friction).drag()
    assert norm(expected[-1]) > 1e-3
    assert norm(forces - expected) < 1e-10 * norm(expected)


@pytest.mark.parametrize("kind", [dm.Tie, dm.Contact])
def test_a_warning_says_what_is_lost(kind, capfd):
    """Once, on one rank, and only where nothing else covers the facet."""
    warnings = []

    def number():
        lines = "".join(capfd.readouterr()).splitlines()
        warnings.extend(line for line in lines if "faces masters at more" in line)
        return comm.allreduce(len(warnings))

    plate = Plate(("z+", *WALLS), kind=kind)
    plate.problem.solve()
    assert number() == 0  # the walls are below the top's edge: seen from above they have no area

    def roof(x, y):
        return 1 - np.tan(np.radians(20)) * np.maximum(x - 0.5, 0)

    for max_angle, expected in ((25.0, 0), (15.0, 1)):
        plate = Plate(("z+",), kind=kind, top=roof, max_angle=max_angle)
        for _ in range(2):
            plate.problem.solve()
        assert number() == expected
    for text in warnings:
        assert "100% of the slave facet near X = (0.75, " in text
        assert "max_angle = 15 degrees" in text
