# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""The demo of the tied beam, against a computation without the library's coupling."""

import cases
import numpy as np
import oracle
import pytest
import ufl
from demo_loader import load_demo
from dolfinx import fem

pytest.importorskip("gmsh")

# The oracle is serial.
pytestmark = pytest.mark.serial


@pytest.fixture(scope="module")
def demo():
    return load_demo("demo_tied_beam")


@pytest.mark.parametrize("ratio", ["2:3", "3:2"])
def test_energy_error(demo, ratio):
    """D and M of the oracle in a saddle point of dense matrices give the library's errors.

    The quadratures differ: where facets are curved both are accurate to about nine digits.
    """
    domain, tags = demo.beam("tet10", 1, "curved", ratio)
    V = demo.displacement_space(domain, "tet10")
    K, b, free = elasticity(demo, V, tags)
    slave, slave_nodes = cases.oracle_surface(V, tags, demo.SLAVE)
    master, master_nodes = cases.oracle_surface(V, tags, demo.MASTER)
    points = oracle.segment_points(slave, master, points=6)
    for multiplier in oracle.MULTIPLIERS:
        coupling = oracle.mortar(slave, master, multiplier, facet_points=points)
        B = np.zeros((np.count_nonzero(coupling.has_multiplier), len(b) // 3))
        B[:, slave_nodes] = coupling.D[coupling.has_multiplier]
        B[:, master_nodes] = -coupling.M[coupling.has_multiplier]
        u = fem.Function(V)
        u.x.array[free] = saddle_point(K, np.kron(B, np.eye(3))[:, free], b[free])
        expected, _ = demo.energy_error(u)
        found, _ = demo.energy_error(demo.solve(domain, tags, "tet10", multiplier)[0])
        assert found == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("ratio", ["2:3", "3:2"])
@pytest.mark.parametrize("element", ["tet10", "hex20"])
def test_bending_is_exact(demo, element, ratio):
    """Linear tractions are reproduced on affine facets: of any tetrahedra, and of boxes."""
    domain, tags = demo.beam(element, 1, "plane", ratio)
    if element == "tet10":
        jitter(domain, demo)
    assert relative_error(demo, domain, tags, element, None) < 1e-11
    # The other spaces with condensable multipliers reproduce constants only
    for multiplier in ("dual", "dual-linear"):
        assert relative_error(demo, domain, tags, element, multiplier) > 1e-5


@pytest.mark.parametrize("ratio", ["2:3", "3:2"])
def test_coupling_error_on_distorted_hexahedra(demo, ratio):
    """On facets that are not affine a small part of it is left, which vanishes under refinement.

    The standard multipliers reproduce linear tractions there too: what differs from them is the
    error of the coupling. That of hex20, whose functions are no longer all quadratic ones, is of
    second order, and larger.
    """
    differences, errors = [], []
    for k in (2, 3):
        domain, tags = demo.beam("hex20", k, "plane", ratio)
        x = domain.geometry.x
        bump = np.cos(np.pi * x[:, 1] / demo.ly) * np.cos(np.pi * x[:, 2] / demo.lz)
        x[:, 1:] += 0.1 * (bump * np.sin(np.pi * np.clip(-x[:, 0], 0, 2) / 2))[:, None]
        u, v = (
            demo.solve(domain, tags, "hex20", multiplier)[0] for multiplier in (None, "standard")
        )
        errors.append(demo.energy_error(u)[0])
        dx = ufl.dx(domain=domain, metadata={"quadrature_degree": 6})
        square = ufl.inner(demo.sigma(u - v), demo.epsilon(u - v)) * dx
        differences.append(np.sqrt(fem.assemble_scalar(fem.form(square))))
    assert differences[0] < 0.2 * errors[0]
    assert np.log(differences[0] / differences[1]) / np.log(3 / 2) > 2.4


def relative_error(demo, domain, tags, element, multiplier):
    error, norm = demo.energy_error(demo.solve(domain, tags, element, multiplier)[0])
    return error / norm


def jitter(domain, demo):
    """Move the vertices of the left part at random, on the sides and the cut within them."""
    x, cells = domain.geometry.x, domain.geometry.dofmap
    vertices = np.unique(cells[:, :4])
    v = x[vertices]
    rng = np.random.default_rng(1)
    move = rng.uniform(-0.06, 0.06, v.shape)
    move[v[:, 0] > -0.3] = 0
    for i, size in enumerate((demo.lx, demo.ly, demo.lz)):
        move[np.abs(np.abs(v[:, i]) - size / 2) < 1e-9, i] = 0
    # Both sides of the cut have their own vertices there
    cut = np.abs(v[:, 0] + 1 - demo.TILT * v[:, 1]) < 1e-9
    move[cut, 0] = demo.TILT * move[cut, 1]
    x[vertices] += move
    ends = [(2, 3), (1, 3), (1, 2), (0, 3), (0, 2), (0, 1)]  # edges of a tetrahedron
    for e, (a, b) in enumerate(ends):
        x[cells[:, 4 + e]] = (x[cells[:, a]] + x[cells[:, b]]) / 2


def elasticity(demo, V, tags):
    """Stiffness of the free dofs (dense), load of all dofs, and the free dofs."""
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    dx = ufl.dx(domain=V.mesh, metadata={"quadrature_degree": 5})
    ds = ufl.ds(domain=V.mesh, subdomain_data=tags, metadata={"quadrature_degree": 5})
    x, n = ufl.SpatialCoordinate(V.mesh), ufl.FacetNormal(V.mesh)
    K = fem.assemble_matrix(fem.form(ufl.inner(demo.sigma(u), demo.epsilon(v)) * dx))
    load = 2 * demo.p / demo.ly * x[1] * n[0] * v[0] * ds(demo.ENDS)
    b = fem.assemble_vector(fem.form(load)).array
    free = np.ones(len(b), dtype=bool)
    for bc in demo.supports(V):
        free[bc.dof_indices()[0]] = False
    return K.to_dense()[np.ix_(free, free)], b, np.flatnonzero(free)


def saddle_point(K, B, b):
    """The displacement of [K B^T; B 0]."""
    n = len(b)
    A = np.zeros((n + len(B), n + len(B)))
    A[:n, :n] = K
    # Stiffness is some thousand times larger than areas
    A[:n, n:] = 1e3 * B.T
    A[n:, :n] = 1e3 * B
    return np.linalg.solve(A, np.concatenate([b, np.zeros(len(B))]))[:n]
