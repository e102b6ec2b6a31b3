"""The nodal 20-node hexahedron: its dofs, its span, and its use in DOLFINx."""

from mpi4py import MPI
from petsc4py import PETSc

import basix
import basix.ufl
import dolfinx_mortar as dm
import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from dolfinx.mesh import CellType, create_unit_cube, exterior_facet_indices
from dolfinx_mortar import compat
from dolfinx_mortar.mesh import create_hex20_mesh


def serendipity_monomials():
    """Exponents of the span: superlinear degree (degree without linear factors) at most 2."""
    exponents = np.stack(np.meshgrid(*[range(3)] * 3, indexing="ij"), -1).reshape(-1, 3)
    superlinear = np.where(exponents > 1, exponents, 0).sum(axis=1)
    return exponents[superlinear <= 2]


def unit_cube_hex20(comm, n, warp=lambda x: x):
    """Cube of n^3 serendipity cells on rank 0's arrays, nodes moved by ``warp``."""
    i = np.arange(2 * n + 1)
    grid = np.stack(np.meshgrid(i, i, i, indexing="ij"), -1).reshape(-1, 3)
    points = np.rint(2 * dm.hex20().basix_element.points).astype(int)
    corner = grid[(grid % 2 == 0).all(axis=1) & (grid < 2 * n).all(axis=1)]
    cells = ((corner[:, None] + points) @ ((2 * n + 1) ** 2, 2 * n + 1, 1)).astype(np.int64)
    used, cells = np.unique(cells, return_inverse=True)
    x = warp(grid[used] / (2.0 * n))
    if comm.rank > 0:
        x, cells = np.empty((0, 3)), np.empty((0, 20), np.int64)
    return create_hex20_mesh(comm, x, cells.reshape(-1, 20), order="basix")


def wavy(x):
    """A smooth map that bends every edge of a mesh of the unit cube."""
    y = x.copy()
    y[:, 0] += 0.05 * np.sin(np.pi * x[:, 1]) * np.sin(np.pi * x[:, 2])
    y[:, 2] += 0.05 * np.sin(np.pi * x[:, 0])
    return y


def integral(expression, mesh):
    form = fem.form(expression * ufl.dx(metadata={"quadrature_degree": 8}))
    return mesh.comm.allreduce(fem.assemble_scalar(form), op=MPI.SUM)


def test_dofs_are_values_at_vertices_and_edge_midpoints():
    element = dm.hex20().basix_element
    cell = basix.CellType.hexahedron
    vertices = basix.geometry(cell)
    midpoints = [vertices[edge].mean(axis=0) for edge in basix.topology(cell)[1]]
    assert np.allclose(element.points, np.vstack([vertices, midpoints]), atol=1e-15)
    assert np.allclose(element.tabulate(0, element.points)[0, :, :, 0], np.eye(20), atol=1e-13)
    # One dof per edge and none in faces: nothing to permute between neighbouring cells.
    assert element.dof_transformations_are_identity


def test_span_is_serendipity():
    element = dm.hex20().basix_element
    x = np.random.default_rng(1).random((60, 3))
    phi = element.tabulate(0, x)[0, :, :, 0]
    exponents = serendipity_monomials()
    assert len(exponents) == element.dim == 20
    for exponent in exponents:
        at_nodes = np.prod(element.points**exponent, axis=1)
        assert np.allclose(phi @ at_nodes, np.prod(x**exponent, axis=1), atol=1e-13)
    for exponent in [(2, 2, 0), (2, 2, 2)]:
        at_nodes = np.prod(element.points ** np.array(exponent), axis=1)
        assert not np.allclose(phi @ at_nodes, np.prod(x ** np.array(exponent), axis=1), atol=1e-3)


def test_same_span_as_basix_serendipity():
    moments = basix.ufl.element("S", "hexahedron", 2).basix_element
    x = np.random.default_rng(2).random((60, 3))
    both = [e.tabulate(0, x)[0, :, :, 0] for e in (moments, dm.hex20().basix_element)]
    assert np.linalg.matrix_rank(np.hstack(both), tol=1e-10) == 20


@pytest.mark.parametrize("geometry", ["trilinear", "hex20"])
def test_interpolates_quadratics(geometry):
    comm = MPI.COMM_WORLD
    if geometry == "trilinear":
        mesh = create_unit_cube(comm, 3, 4, 2, CellType.hexahedron)
    else:
        mesh = unit_cube_hex20(comm, 3)
    V = fem.functionspace(mesh, dm.hex20(shape=(3,)))
    assert V.ufl_element().reference_value_shape == (3,)
    u = fem.Function(V)
    u.interpolate(lambda x: np.stack([x[0] * x[1], x[2] ** 2 - x[1], x[0] ** 2 * x[1] * x[2]]))
    x = ufl.SpatialCoordinate(mesh)
    difference = u - ufl.as_vector([x[0] * x[1], x[2] ** 2 - x[1], x[0] ** 2 * x[1] * x[2]])
    assert np.sqrt(integral(ufl.inner(difference, difference), mesh)) < 1e-13


def test_dof_coordinates():
    mesh = unit_cube_hex20(MPI.COMM_WORLD, 3, wavy)
    V = fem.functionspace(mesh, dm.hex20(shape=(3,)))
    x = V.tabulate_dof_coordinates()
    u = fem.Function(V)
    u.interpolate(lambda x: x)
    assert np.allclose(u.x.array.reshape(-1, 3), x, atol=1e-14)

    # Isoparametric: the dof points are the nodes of the geometry, cell by cell.
    nodes = compat.geometry_dofmap(mesh)
    for cell in range(len(nodes)):
        assert np.allclose(x[V.dofmap.cell_dofs(cell)], mesh.geometry.x[nodes[cell]], atol=1e-14)


def test_curved_geometry_has_the_right_volume():
    """The serendipity map of one cell, integrated by DOLFINx and by hand."""
    comm = MPI.COMM_SELF
    points = dm.hex20().basix_element.points + 0.05 * np.sin(7 * np.arange(60)).reshape(20, 3)
    mesh = create_hex20_mesh(comm, points, np.arange(20).reshape(1, 20), order="basix")
    X, w = basix.make_quadrature(basix.CellType.hexahedron, 10)
    jacobian = np.einsum(
        "dqn,ni->qid", dm.hex20().basix_element.tabulate(1, X)[1:, :, :, 0], points
    )
    one = fem.Constant(mesh, 1.0)
    volume = fem.assemble_scalar(fem.form(one * ufl.dx(metadata={"quadrature_degree": 10})))
    assert volume == pytest.approx(w @ np.linalg.det(jacobian), rel=1e-13)


def test_elasticity_reproduces_a_quadratic_displacement():
    """Assembly, lifting and a solve, on whatever number of ranks: no error on straight cells."""
    mesh = unit_cube_hex20(MPI.COMM_WORLD, 3)
    V = fem.functionspace(mesh, dm.hex20(shape=(3,)))

    def exact(x):
        return np.stack([x[0] * x[1], -(x[0] ** 2) / 2 - x[2] ** 2, x[1] * x[2]])

    x = ufl.SpatialCoordinate(mesh)
    u_exact = ufl.as_vector([x[0] * x[1], -(x[0] ** 2) / 2 - x[2] ** 2, x[1] * x[2]])
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    dx = ufl.dx(metadata={"quadrature_degree": 4})

    def sigma(w):
        return 2 * ufl.sym(ufl.grad(w)) + ufl.div(w) * ufl.Identity(3)

    a = fem.form(ufl.inner(sigma(u), ufl.grad(v)) * dx)
    L = fem.form(-ufl.inner(ufl.div(sigma(u_exact)), v) * dx)
    mesh.topology.create_connectivity(2, 3)
    g = fem.Function(V)
    g.interpolate(exact)
    facets = exterior_facet_indices(mesh.topology)
    bcs = [fem.dirichletbc(g, fem.locate_dofs_topological(V, 2, facets))]

    A = petsc.assemble_matrix(a, bcs)
    A.assemble()
    b = petsc.assemble_vector(L)
    petsc.apply_lifting(b, [a], [bcs])
    b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    petsc.set_bc(b, bcs)
    ksp = PETSc.KSP().create(mesh.comm)
    ksp.setOperators(A)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    solution = b.duplicate()
    ksp.solve(b, solution)
    w = fem.Function(V)
    w.x.array[: solution.getLocalSize()] = solution.array
    w.x.scatter_forward()
    error = integral(ufl.inner(w - u_exact, w - u_exact), mesh)
    assert np.sqrt(error) < 1e-12
    for thing in (ksp, A, b, solution):
        thing.destroy()
