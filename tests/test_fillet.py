# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Rubber with a fillet, pressed on a plate: what takes part changes without a jump."""

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from versions import gmsh_reader

gmsh = pytest.importorskip("gmsh")

comm = MPI.COMM_WORLD
SLAVE, TOP, PLANE_X, PLANES_Y = 1, 2, 3, 4
SIZE, WIDTH, THICKNESS, RADIUS = 0.08, 0.5, 0.1, 0.1


def slice_with_fillet():
    """A slice of tetrahedra; bottom, fillet and side are slaves."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.MeshSizeMin", SIZE)
    gmsh.option.setNumber("Mesh.MeshSizeMax", SIZE)
    model = gmsh.model
    occ = model.occ
    w, r = WIDTH, RADIUS
    corners = [(0, 0), (w - r, 0), (w - r, r), (w, r), (w, w), (0, w)]
    p = [occ.addPoint(x, 0, z) for x, z in corners]
    lines = [occ.addLine(p[0], p[1]), occ.addCircleArc(p[1], p[2], p[3])]
    lines += [occ.addLine(p[i], p[(i + 1) % 6]) for i in (3, 4, 5)]
    face = occ.addPlaneSurface([occ.addCurveLoop(lines)])
    made = occ.extrude([(2, face)], 0, THICKNESS, 0)
    occ.synchronize()
    volume = next(tag for dim, tag in made if dim == 3)
    groups = {SLAVE: [], TOP: [], PLANE_X: [], PLANES_Y: []}
    for _, surface in model.getBoundary([(3, volume)], oriented=False):
        box = np.array(model.getBoundingBox(2, surface)).reshape(2, 3)
        flat = np.ptp(box, axis=0) < 1e-3
        if flat[1]:
            groups[PLANES_Y].append(surface)
        elif flat[0] and box[0, 0] < 1e-3:
            groups[PLANE_X].append(surface)
        else:
            groups[TOP if flat[2] and box[0, 2] > 1e-3 else SLAVE].append(surface)
    model.addPhysicalGroup(3, [volume], 1)
    for tag, surfaces in groups.items():
        model.addPhysicalGroup(2, surfaces, tag)
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


def test_steps_begin_in_equilibrium():
    """Where the last one ended, with facets of the fillet becoming less steep all the way."""
    domain, tags = slice_with_fillet()
    box = [[-0.25, -0.25, -0.25], [1.25, 0.35, 0]]
    plate = mesh.create_box(comm, box, [3, 3, 1], mesh.CellType.hexahedron)
    top_of_plate = mesh.locate_entities_boundary(plate, 2, lambda x: np.isclose(x[2], 0))
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 2, (3,))))
    w = fem.Function(fem.functionspace(plate, ("Lagrange", 1, (3,))))
    V, W = u.function_space, w.function_space
    top = fem.Constant(domain, np.zeros(3))
    bcs = [fem.dirichletbc(top, fem.locate_dofs_topological(V, 2, tags.find(TOP)), V)]
    for c, tag in enumerate((PLANE_X, PLANES_Y)):
        dofs = fem.locate_dofs_topological(V.sub(c), 2, tags.find(tag))
        bcs.append(fem.dirichletbc(np.float64(0), dofs, V.sub(c)))
    low = fem.locate_dofs_geometrical(W, lambda x: x[2] < -0.1)
    bcs.append(fem.dirichletbc(np.zeros(3), low, W))
    master = mesh.meshtags(plate, 2, np.sort(top_of_plate), 1)
    contact = dm.Contact((V, W), (tags, master), slave=SLAVE, master=1, friction=0.3)
    problem = dm.ContactProblem(
        [residual(u, 1.0, 50.0), residual(w, 1e3, 2e3)], [u, w], bcs=bcs, interfaces=[contact]
    )
    numbers, starts = [], []
    for compression in 0.0125 * np.arange(1, 7):
        top.value[2] = -compression
        problem.solve()
        numbers.append(contact.num_multiplier_nodes)
        starts.append([problem.history[0][k] for k in ("force", "constraint")])
    assert len(set(numbers)) > 1
    assert np.max(starts[1:]) < 1e-8
