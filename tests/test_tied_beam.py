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
