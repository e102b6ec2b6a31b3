# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""A rubber cylinder with a sharp rim, compressed until its side folds onto the plate."""

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from versions import gmsh_reader

gmsh = pytest.importorskip("gmsh")

comm = MPI.COMM_WORLD
SLAVE, TOP, PLANE_X, PLANE_Y = 1, 2, 3, 4


def quarter_cylinder(size):
    """A quarter of a cylinder of radius and height 1, of tetrahedra; bottom and side are slaves."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    model = gmsh.model
    volume = model.occ.addCylinder(0, 0, 0, 0, 0, 1, 1, angle=np.pi / 2)
    model.occ.synchronize()
    groups = {SLAVE: [], TOP: [], PLANE_X: [], PLANE_Y: []}
    for _, surface in model.getBoundary([(3, volume)], oriented=False):
        box = np.array(model.getBoundingBox(2, surface)).reshape(2, 3)
        flat = np.ptp(box, axis=0) < 1e-3
        if flat[2]:
            groups[TOP if box[0, 2] > 0.5 else SLAVE].append(surface)
        else:
            groups[PLANE_X if flat[0] else PLANE_Y if flat[1] else SLAVE].append(surface)
    model.addPhysicalGroup(3, [volume], 1)
    for tag, surfaces in groups.items():
        model.addPhysicalGroup(2, surfaces, tag)
    gmsh.option.setNumber("Mesh.MeshSizeMin", size)
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    model.mesh.generate(3)
    model.mesh.setOrder(2)
    domain, _, tags = gmsh_reader.model_to_mesh(model, comm, 0, gdim=3)[:3]
    gmsh.finalize()
    return domain, tags


def residual(u, shear, bulk):
    """Neo-Hooke's material."""
    F = ufl.Identity(3) + ufl.grad(u)
    J = ufl.det(F)
    energy = shear / 2 * (J ** (-2 / 3) * ufl.inner(F, F) - 3)
    energy += bulk / 4 * (J**2 - 1 - 2 * ufl.ln(J))
    return ufl.derivative(energy * ufl.dx(u.function_space.mesh, degree=5), u)


@pytest.mark.slow
@pytest.mark.serial
def test_side_folds_onto_the_plate():
    """All steps without help, and at the end the side lies on the plate, not in it."""
    domain, tags = quarter_cylinder(0.2)
    plate = mesh.create_box(
        comm, [[-0.5, -0.5, -0.5], [2.5, 2.5, 0]], [3, 3, 1], mesh.CellType.hexahedron
    )
    top_of_plate = mesh.locate_entities_boundary(plate, 2, lambda x: np.isclose(x[2], 0))
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 2, (3,))))
    w = fem.Function(fem.functionspace(plate, ("Lagrange", 1, (3,))))
    V, W = u.function_space, w.function_space
    top = fem.Constant(domain, np.zeros(3))
    bcs = [fem.dirichletbc(top, fem.locate_dofs_topological(V, 2, tags.find(TOP)), V)]
    for c, tag in enumerate((PLANE_X, PLANE_Y)):
        dofs = fem.locate_dofs_topological(V.sub(c), 2, tags.find(tag))
        bcs.append(fem.dirichletbc(np.float64(0), dofs, V.sub(c)))
    low = fem.locate_dofs_geometrical(W, lambda x: x[2] < 0.1)
    bcs.append(fem.dirichletbc(np.zeros(3), low, W))
    contact = dm.Contact(
        (V, W),
        (tags, mesh.meshtags(plate, 2, np.sort(top_of_plate), 1)),
        slave=SLAVE,
        master=1,
        friction=0.5,
    )
    problem = dm.ContactProblem(
        [residual(u, 1.0, 5.0), residual(w, 1e3, 2e3)], [u, w], bcs=bcs, interfaces=[contact]
    )
    iterations = []
    for compression in np.arange(1, 22) * 0.025:
        top.value[2] = -compression
        iterations.append(problem.solve())

    x = V.tabulate_dof_coordinates()
    side = (np.hypot(x[:, 0], x[:, 1]) > 0.99) & (x[:, 2] > 1e-6) & (x[:, 2] < 0.99)
    height = (x + u.x.array.reshape(-1, 3))[side, 2]
    assert np.sum(height < 1e-2) > 20
    assert height.min() > -1e-3
    assert np.mean(iterations) < 8
    assert contact.force[2] > 0
