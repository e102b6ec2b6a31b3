# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Averaged nodal normals and their derivative."""

from mpi4py import MPI

import numpy as np
import oracle
import pytest
from distributed import distribute, fails_on_all
from dolfinx_mortar import cpp

comm = MPI.COMM_WORLD
kinds = pytest.mark.parametrize("kind", oracle.KINDS)


def hill(x, y):
    return 0.3 * np.sin(2 * x) * np.cos(3 * y)


def random_surface(kind, seed, rng=None, **options):
    rng = np.random.default_rng(seed)
    options = {"height": hill, "distort": 0.2, "bend": 0.05, "shuffle": True} | options
    source = oracle.patch(kind, (4, 3), rng=rng, **options)
    return distribute(comm, source, rng=rng), rng


def gathered_derivative(d, x, fixed, normals):
    """The derivative of all normals with respect to all positions, on all ranks."""
    n = 3 * len(d.source.x)
    J = np.zeros((n, n))
    for f in range(d.surface.num_facets):
        dofs = (3 * d.nodes[d.facet_nodes(f)][:, None] + np.arange(3)).ravel()
        J[np.ix_(dofs, dofs)] += cpp.normal_derivative(d.surface, x, fixed, normals, f)
    return comm.allreduce(J)


@kinds
def test_plane(kind):
    d, _ = random_surface(kind, 1, height=0.7, bend=0, outward=-1)
    n = cpp.compute_normals(d.surface, d.x)
    assert np.allclose(n.n, [0, 0, -1], atol=1e-14)
    # The length of the sum counts the facets that meet at a node
    count = np.bincount(np.concatenate([k for _, k in d.source.facets]))
    assert np.allclose(n.length, count[d.nodes], rtol=1e-13)


@kinds
@pytest.mark.parametrize("outward", [-1, 1])
def test_agrees_with_definition(kind, outward):
    d, _ = random_surface(kind, 2, outward=outward)
    n = cpp.compute_normals(d.surface, d.x)
    assert np.allclose(np.linalg.norm(n.n, axis=1), 1, atol=1e-14)
    assert np.allclose(n.n, oracle.averaged_normals(d.source)[d.nodes], atol=1e-13)


@kinds
def test_moves_with_the_surface(kind):
    """Rotations turn normals, translations and scaling leave them."""
    d, rng = random_surface(kind, 3)
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    Q *= np.linalg.det(Q)
    n = cpp.compute_normals(d.surface, d.x)
    moved = cpp.compute_normals(d.surface, np.ascontiguousarray(1e-3 * d.x @ Q.T + [5, 6, 7]))
    assert np.allclose(moved.n, n.n @ Q.T, atol=1e-10)


@kinds
def test_symmetry_plane(kind):
    """Half a surface with its symmetry plane's component fixed has the whole one's normals."""

    def ridge(x, y):
        return 0.5 * np.cos(2 * x) * (1 + 0.3 * y)

    whole = oracle.patch(kind, (4, 2), lower=(-1.0, 0.0), height=ridge)
    # The triangles of the whole are no mirror images of each other: mirror the half instead
    half = oracle.patch(kind, (2, 2), height=ridge)
    mirrored = half.x * [-1, 1, 1]
    if kind.startswith("tri"):
        on = np.isclose(half.x[:, 0], 0)
        number = np.where(on, np.arange(len(on)), len(on) + np.cumsum(~on) - 1)
        whole = oracle.Surface(
            np.vstack([half.x, mirrored[~on]]),
            half.facets + [(k, number[nodes]) for k, nodes in half.facets],
            np.concatenate([half.sign, -half.sign]),
        )
    expected = oracle.averaged_normals(whole)
    d = distribute(comm, half, rng=np.random.default_rng(4))
    fixed = np.zeros((len(d.nodes), 3), np.int8)
    fixed[np.isclose(d.x[:, 0], 0), 0] = 1
    n = cpp.compute_normals(d.surface, d.x, fixed).n
    for k in np.flatnonzero(fixed[:, 0]):
        match = np.linalg.norm(whole.x - d.x[k], axis=1).argmin()
        assert np.allclose(n[k], expected[match], atol=1e-14)
        assert n[k, 0] == 0


def test_own_direction_fixed():
    """Where the surface's own direction is prescribed, nothing is dropped."""
    d, _ = random_surface("quad9", 5, height=0.0, bend=0)
    fixed = np.zeros((len(d.nodes), 3), np.int8)
    fixed[d.nodes % 3 == 0] = [0, 0, 1]
    fixed[d.nodes % 3 == 1] = [1, 1, 1]
    n = cpp.compute_normals(d.surface, d.x, fixed)
    assert np.allclose(n.n, [0, 0, 1], atol=1e-14)


@kinds
@pytest.mark.parametrize("with_fixed", [False, True])
def test_derivative(kind, with_fixed):
    """Against differences of fourth order, nodes of all ranks moving at once."""
    d, rng = random_surface(kind, 6)
    fixed = None
    if with_fixed:
        components = rng.random((len(d.source.x), 3)) < 0.2
        components[0] = components[1] = True
        fixed = components[d.nodes].astype(np.int8)
    normals = cpp.compute_normals(d.surface, d.x, fixed)
    J = gathered_derivative(d, d.x, fixed, normals)
    h = 2e-5
    for _ in range(6):
        dx = rng.uniform(-1, 1, d.source.x.shape)
        dn = (J @ dx.ravel()).reshape(-1, 3)[d.nodes]
        difference = 0
        for step, weight in ((-2, 1), (-1, -8), (1, 8), (2, -1)):
            x = np.ascontiguousarray(d.x + step * h * dx[d.nodes])
            difference += weight / (12 * h) * cpp.compute_normals(d.surface, x, fixed).n
        assert np.allclose(dn, difference, rtol=1e-8, atol=1e-8)


@kinds
def test_derivative_of_rotation(kind):
    """To first order, normals turn as the surface does: dn = omega x n for dx = omega x x."""
    d, rng = random_surface(kind, 7)
    normals = cpp.compute_normals(d.surface, d.x)
    J = gathered_derivative(d, d.x, None, normals)
    omega = rng.uniform(-1, 1, 3)
    dn = (J @ np.cross(omega, d.source.x).ravel()).reshape(-1, 3)[d.nodes]
    assert np.allclose(dn, np.cross(omega, normals.n), atol=1e-12)
    # and translations and scaling do not change them
    for dx in (np.tile([1.0, 2.0, 3.0], len(d.source.x)), d.source.x.ravel()):
        assert np.allclose(J @ dx, 0, atol=1e-11)


@kinds
def test_collapsed_facet(kind):
    """A facet without area is an error on all ranks, which names the place."""
    d, _ = random_surface(kind, 8, height=0.0, bend=0)
    victim = d.source.facets[5][1]
    d.source.x[victim[1:]] = d.source.x[victim[0]] + [[1e-17, 0, 0]]
    message = fails_on_all(comm, cpp.compute_normals, d.surface, d.x)
    assert "no area" in message and "midpoint" in message
    message = fails_on_all(comm, cpp.check_areas, d.surface, d.x, "slave surface (facet tag 3)")
    assert "slave surface (facet tag 3)" in message


def test_normals_cancel():
    """Both sides of a thin plate in one surface: the normals at shared nodes cancel."""
    upper = oracle.patch("quad4", (2, 2))
    source = oracle.Surface(
        upper.x, upper.facets + upper.facets, np.concatenate([upper.sign, -upper.sign])
    )
    d = distribute(comm, source, rng=np.random.default_rng(9))
    assert "cancel" in fails_on_all(comm, cpp.compute_normals, d.surface, d.x)


def test_not_a_number():
    """NaN on one rank is an error on all."""
    d, _ = random_surface("tri6", 10)
    x = d.x
    if comm.rank == comm.size - 1:
        x[d.facet_nodes(0)[0], 0] = np.nan
    assert "no area" in fails_on_all(comm, cpp.compute_normals, d.surface, x)
