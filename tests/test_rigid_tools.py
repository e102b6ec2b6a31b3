# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Rigid tools as masters: planes, spheres, cylinders, and facets of meshes."""

from dataclasses import dataclass

from mpi4py import MPI

import cases
import dolfinx_mortar as dm
import numpy as np
import pytest
import test_newton_jacobian as newton
import ufl
from blocks import FACES, NU, E, block
from dolfinx import fem
from nodal import by_position
from test_bad_input import fails

comm = MPI.COMM_WORLD
DX = ufl.dx(metadata={"quadrature_degree": 3})


@dataclass
class Pressed:
    """A block that stands on a tool, or is held above it."""

    problem: dm.ContactProblem
    contact: dm.Interface
    top: fem.Constant
    others: list


def body(element, box=((0.0, 0.0, 0.0), (1.0, 1.0, 0.5)), cells=(3, 3, 2), name="upper"):
    (b,), _ = cases._bodies(comm, [block(name, element, *box, cells)], False)
    return b


def pressed(
    make,
    element="hex8",
    kind=dm.Contact,
    cells=(3, 3, 2),
    slave=("z-",),
    free="",
    rotation=None,
    petsc_options=None,
    stabilise=None,
    **options,
):
    """A neo-Hookean block of 1 x 1 x 0.5, its top held, over what `make` returns.

    Args:
        make: Returns a tool.
        element, cells: Of the block.
        kind: Contact or Tie.
        slave: Sides that are the slave.
        free: Components of the tool that are.
        rotation: With which the tool begins, about where it leaves a ball's or a plane's surface.
        petsc_options, stabilise: Of the problem.
        **options: Of the interface.
    """
    b = body(element, cells=cells)
    dx = ufl.dx(metadata={"quadrature_degree": 5 if element == "hex27" else 3})
    u = fem.Function(b.V)
    F = ufl.derivative(cases.neo_hooke(E, NU)(u) * dx, u, ufl.TestFunction(b.V))
    top = fem.Constant(b.mesh, np.zeros(3))
    dofs = fem.locate_dofs_geometrical(b.V, lambda x: np.isclose(x[2], 0.5))
    bcs = [fem.dirichletbc(top, dofs, b.V)]
    tool = make()
    tool.free = free
    if rotation is not None:
        tool.rotation = rotation
    contact = kind(
        slave=[(b.V, b.facet_tags, FACES[side]) for side in slave], master=tool, **options
    )
    problem = dm.ContactProblem(
        F,
        u,
        bcs=bcs,
        interfaces=[contact],
        petsc_options_prefix="tool_",
        petsc_options=petsc_options,
        stabilise=stabilise,
    )
    return Pressed(problem, contact, top, [b])


def plane(z=0.0, **options):
    return lambda: dm.RigidPlane((0.3, 0.2, z), (0, 0, 1), **options)


def meshed(element="hex8", box=((-0.5, -0.5, -1.0), (1.5, 1.5, 0.0)), cells=(2, 3, 1)):
    """The top of a block as a tool."""

    def make():
        b = body(element, box, cells, "tool")
        return dm.RigidSurface(b.mesh, b.facet_tags, FACES["z+"], (0.5, 0.5, 0.0))

    return make


def prescribed(element, mesh_of_tool, motion, **options):
    """The same with a body in place of the tool, all of whose nodes are moved by `motion(x)`."""
    b, c = body(element), body(*mesh_of_tool, "plate")
    u = [fem.Function(x.V) for x in (b, c)]
    dx = ufl.dx(metadata={"quadrature_degree": 5 if element == "hex27" else 3})
    energy = cases.neo_hooke(E, NU)
    F = [ufl.derivative(energy(w) * dx, w, ufl.TestFunction(w.function_space)) for w in u]
    top, moved = fem.Constant(b.mesh, np.zeros(3)), fem.Function(c.V)
    held = fem.locate_dofs_geometrical(b.V, lambda x: np.isclose(x[2], 0.5))
    every = fem.locate_dofs_geometrical(c.V, lambda x: x[2] < 1)
    contact = dm.Contact(
        slave=[(b.V, b.facet_tags, FACES["z-"])],
        master=[(c.V, c.facet_tags, FACES["z+"])],
        **options,
    )
    problem = dm.ContactProblem(
        F,
        u,
        bcs=[fem.dirichletbc(top, held, b.V), fem.dirichletbc(moved, every)],
        interfaces=[contact],
        petsc_options_prefix="body_",
    )
    moved.interpolate(motion)
    return Pressed(problem, contact, top, [moved, motion])


class Motion:
    """x -> c + d + R (x - c) - x, with attributes that a test changes."""

    def __init__(self, centre):
        self.centre = np.array(centre)[:, None]
        self.d, self.r = np.zeros(3), np.zeros(3)

    def __call__(self, x):
        return rotation(self.r) @ (x - self.centre) + self.centre + self.d[:, None] - x


def rotation(vector):
    """R of a rotation vector (Rodrigues)."""
    angle = np.linalg.norm(vector)
    if angle == 0:
        return np.eye(3)
    a, b, c = np.asarray(vector) / angle
    W = np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]])
    return np.eye(3) + np.sin(angle) * W + (1 - np.cos(angle)) * W @ W


MOVES = (([0, 0, 0.02], [0, 0, 0]), ([0.03, 0.01, 0.02], [0.02, -0.03, 0]))


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("geometry", ["current", "reference"])
@pytest.mark.parametrize("elements", [("hex8", "hex20"), ("hex20", "tet10"), ("tet10", "hex8")])
def test_facets_are_a_body_of_prescribed_nodes(elements, geometry, friction):
    """The same to the accuracy of Newton's method, for the tool's twelve numbers are exact."""
    box, cells = ((-0.5, -0.5, -1.0), (1.5, 1.5, 0.0)), (2, 3, 1)
    options = {"friction": friction, "geometry": geometry}
    p = pressed(meshed(elements[1], box, cells), elements[0], **options)
    motion = Motion((0.5, 0.5, 0.0))
    q = prescribed(elements[0], (elements[1], box, cells), motion, **options)
    tool = p.contact.tool
    for d, r in MOVES:
        tool.translation, tool.rotation = d, r
        motion.d, motion.r = np.array(d), np.array(r)
        q.others[0].interpolate(motion)
        for problem in (p.problem, q.problem):
            problem.solve()
    assert p.contact.num_active == q.contact.num_active > 0
    assert len(p.problem.history) == len(q.problem.history)
    size = np.linalg.norm(q.contact.force)
    np.testing.assert_allclose(p.contact.force, q.contact.force, atol=1e-8 * size)
    np.testing.assert_allclose(tool.force, q.contact.master_force, atol=1e-8 * size)
    point = np.array([0.5, 0.5, 0.0]) + (MOVES[-1][0] if geometry == "current" else 0)
    moment = q.contact.master_moment - np.cross(point, q.contact.master_force)
    np.testing.assert_allclose(tool.moment, moment, atol=1e-8 * size)
    X = np.random.default_rng(3).normal(size=(5, 3))
    np.testing.assert_allclose(tool.positions(X), X + motion(X.T).T, atol=1e-13)
    V, u = tool.displacement.function_space, tool.displacement.x.array.reshape(-1, 3)
    x = V.tabulate_dof_coordinates()
    np.testing.assert_allclose(u, motion(x.T).T, atol=1e-13)
    mine, other = (by_position(x.contact.multiplier) for x in (p, q))
    np.testing.assert_allclose(mine, other, atol=1e-6 * np.abs(other).max())


@pytest.mark.parametrize("element", ["hex8", "hex20", "hex27", "tet4", "tet10"])
def test_plane(element):
    """No force but along the normal; as a body of one cell, whose normals are the slave's own."""
    p = pressed(plane(), element, slave=("z-", "x-", "x+", "y-", "y+"))
    motion = Motion((0.3, 0.2, 0.0))
    cell = ("hex8", ((-0.5, -0.5, -1.0), (1.5, 1.5, 0.0)), (1, 1, 1))
    q = prescribed(element, cell, motion, multiplier=p.contact.multiplier_space)
    tilt = [0.02, -0.03, 0]
    p.contact.tool.translation, p.contact.tool.rotation = (0, 0, 0.03), tilt
    motion.d, motion.r = np.array([0, 0, 0.03]), np.array(tilt)
    q.others[0].interpolate(motion)
    for problem in (p.problem, q.problem):
        problem.solve()
        force = [i["force"] for i in problem.history]
        assert force[-1] < 1e-9 and len(force) <= 9
    force, normal = p.contact.tool.force, rotation(tilt) @ [0, 0, 1]
    np.testing.assert_allclose(force, (force @ normal) * normal, atol=1e-9 * np.linalg.norm(force))
    assert force @ normal == pytest.approx(q.contact.master_force @ normal, rel=5e-3)
    np.testing.assert_allclose(p.contact.force, -force, rtol=1e-12)
    # Pressures act on the plane: its moment is that of the slave
    point = np.array([0.3, 0.2, 0.03])
    expected = -(p.contact.moment - np.cross(point, p.contact.force))
    np.testing.assert_allclose(p.contact.tool.moment, expected, atol=3e-3 * np.linalg.norm(force))


def dome(radius, cells):
    """A block whose top is the lower side of a ball turned round: facets of a spherical cap."""

    def make():
        def top(x, y):
            return np.sqrt(radius**2 - (x - 0.5) ** 2 - (y - 0.5) ** 2) - radius - 0.02

        part = block("cap", "hex8", (-0.2, -0.2, -2), (1.2, 1.2, 0), (cells, cells, 1), top=top)
        (b,), _ = cases._bodies(comm, [part], False)
        return dm.RigidSurface(b.mesh, b.facet_tags, FACES["z+"], (0.5, 0.5, -radius - 0.02))

    return make


def ball(radius):
    return lambda: dm.RigidSphere((0.5, 0.5, -radius - 0.02), radius)


@pytest.mark.parametrize("element", ["hex8", "hex20", "tet10"])
def test_sphere_is_the_limit_of_its_facets(element):
    """Force without friction against that of facets, whose error is that of their height."""
    forces = []
    for make in (dome(2.0, 12), dome(2.0, 36), ball(2.0)):
        p = pressed(make, element, cells=(5, 5, 2), multiplier="dual")
        p.contact.tool.translation = (0, 0, 0.1)
        p.problem.solve()
        forces.append(p.contact.tool.force)
    coarse, fine, exact = forces
    assert abs(fine[2] / exact[2] - 1) < 3e-3 < abs(coarse[2] / exact[2] - 1)
    np.testing.assert_allclose(exact[:2], 0, atol=3e-3 * abs(exact[2]))


def test_friction_on_a_sphere_and_its_facets():
    """Pressed in steps, and dragged. A step counts slip from where the surfaces were at its start,
    also before they met: for both kinds of pairing only what is slip remains with small steps."""
    forces = []
    for make in (dome(2.0, 24), ball(2.0)):
        p = pressed(make, "hex20", cells=(5, 5, 2), friction=0.2, multiplier="dual")
        for z in np.linspace(0.02, 0.1, 6)[1:]:
            p.contact.tool.translation = (0, 0, z)
            p.problem.solve()
        p.contact.tool.translation = (0.01, 0, 0.1)
        p.problem.solve()
        forces.append(p.contact.tool.force)
    facets, exact = forces
    np.testing.assert_allclose(facets, exact, atol=1e-2 * np.linalg.norm(exact))


def pressing(contact):
    """Integral of the pressure."""
    s = contact.summary()
    return s["mean_pressure"] * s["area"]


@pytest.mark.parametrize("hollow", [False, True])
def test_cylinder(hollow):
    """A roller of large radius is a plane to its curvature. Friction has the radius as its arm."""
    radius = 200.0
    axis = (0.5, 0.5, radius if hollow else -radius)
    p = pressed(lambda: dm.RigidCylinder(axis, (1, 0, 0), radius, hollow), "hex20", friction=0.2)
    q = pressed(lambda: dm.RigidPlane((0.5, 0.5, 0), (0, 0, 1)), "hex20", friction=0.2)
    for x in (p, q):
        x.contact.tool.translation = (0, 0, 0.02)
        x.problem.solve()
        x.contact.tool.translation = (0, 0.03, 0.02)
        x.problem.solve()
        assert x.contact.summary()["stick"] == 0
    np.testing.assert_allclose(p.contact.tool.force, q.contact.tool.force, rtol=2e-2, atol=1e-4)
    force, moment = p.contact.tool.force, p.contact.tool.moment
    assert moment[0] == pytest.approx((radius if hollow else -radius) * force[1], rel=5e-3)


def test_rotation_drags():
    """A roller that is turned in place drags the block along its surface."""
    p = pressed(
        lambda: dm.RigidCylinder((0.5, 0.5, -0.5), (0, 1, 0), 0.5),
        "hex20",
        cells=(8, 2, 2),
        friction=0.3,
    )
    tool = p.contact.tool
    tool.translation = (0, 0, 0.05)
    p.problem.solve()
    assert np.linalg.norm(tool.force[:2]) < 1e-3 * abs(tool.force[2])
    for angle in (0.02, 0.05, 0.1, 0.15):
        tool.rotation = (0, angle, 0)
        p.problem.solve()
    # The surface below the block moves to +x, and pulls it along
    summary = p.contact.summary()
    assert summary["stick"] == 0 and summary["force"][0] > 0.2 * summary["force"][2] > 0
    assert tool.moment[1] == pytest.approx(-0.3 * 0.5 * pressing(p.contact), rel=1e-2)
    work = -tool.moment[1] * 0.05
    assert 0.9 * work < p.contact.dissipation < 1.01 * work


@pytest.mark.parametrize("make", [plane(), meshed()], ids=["plane", "facets"])
@pytest.mark.parametrize("element", ["hex8", "hex20", "tet10"])
def test_tied_body_follows(make, element):
    """A body that is tied to a tool and not held otherwise moves with it, without any stress."""
    p = pressed(make, element, kind=dm.Tie)
    V = p.problem.spaces[0]
    p.problem.destroy()
    u = fem.Function(V)
    F = ufl.derivative(cases.neo_hooke(E, NU)(u) * DX, u, ufl.TestFunction(V))
    tie = dm.Tie(
        slave=[(V, p.others[0].facet_tags, FACES["z-"])], master=(tool := make()), max_angle=70.0
    )
    problem = dm.ContactProblem(F, u, interfaces=[tie], petsc_options_prefix="tied_")
    for t in (0.5, 1.0):
        tool.translation, tool.rotation = (0.1 * t, 0.2 * t, -0.3 * t), (0.5 * t, -0.4 * t, 0.3 * t)
        problem.solve()
    x = V.tabulate_dof_coordinates()[: V.dofmap.index_map.size_local]
    c = tool.reference_point
    expected = (rotation(tool.rotation) @ (x - c).T).T + c + tool.translation - x
    own = u.x.array.reshape(-1, 3)[: len(x)]
    np.testing.assert_allclose(own, expected, atol=1e-8)
    assert np.linalg.norm(tool.force) < 1e-6 * E


def test_two_contacts_share_a_tool():
    """Forces of both add up; the tool has one motion."""
    b = body("hex8")
    u = fem.Function(b.V)
    dx = ufl.dx(metadata={"quadrature_degree": 3})
    F = ufl.derivative(cases.neo_hooke(E, NU)(u) * dx, u, ufl.TestFunction(b.V))
    held = fem.locate_dofs_geometrical(b.V, lambda x: np.isclose(x[1], 0.5, atol=0.2))
    zero = fem.Constant(b.mesh, np.zeros(3))
    groove = dm.RigidCylinder((0.5, 0.5, 0.25), (1, 0, 0), 0.6, hollow=True)
    contacts = [
        dm.Contact(slave=[(b.V, b.facet_tags, FACES[side])], master=groove) for side in ("y-", "y+")
    ]
    problem = dm.ContactProblem(F, u, bcs=[fem.dirichletbc(zero, held, b.V)], interfaces=contacts)
    groove.translation = (0, 0.12, 0)
    problem.solve()
    forces = [c.master_force for c in contacts]
    assert forces[0][1] < 0 and np.linalg.norm(forces[1]) < 1e-12
    np.testing.assert_allclose(groove.force, forces[0] + forces[1], rtol=1e-12)


def test_saved_and_continued(tmp_path):
    """From a file another problem goes on with the tool where it was."""
    runs = []
    for again in (False, True):
        p = pressed(ball(2.0), "hex20", friction=0.2)
        tool = p.contact.tool
        if again:
            p.problem.load(tmp_path / "state")
            np.testing.assert_allclose(tool.translation, [0, 0, 0.08], atol=1e-12)
        else:
            tool.translation = (0, 0, 0.08)
            p.problem.solve()
            p.problem.save(tmp_path / "state")
        tool.translation, tool.rotation = (0.01, 0, 0.08), (0, 0.01, 0)
        p.problem.solve()
        runs.append(np.concatenate([tool.force, tool.moment]))
    np.testing.assert_allclose(runs[0], runs[1], rtol=1e-8, atol=1e-10)


def test_begins_where_the_tool_is():
    """A problem that is made when the tool has moved does not drag it there from its reference."""
    p = pressed(plane(z=-1.0), "hex8", friction=0.5)
    p.problem.destroy()
    b, tool = p.others[0], dm.RigidPlane((0, 0, -1.0), (0, 0, 1))
    tool.translation = (0.5, 0.4, 1.0)
    u = fem.Function(b.V)
    F = ufl.derivative(cases.neo_hooke(E, NU)(u) * DX, u, ufl.TestFunction(b.V))
    held = fem.locate_dofs_geometrical(b.V, lambda x: np.isclose(x[2], 0.5))
    bcs = [fem.dirichletbc(fem.Constant(b.mesh, np.zeros(3)), held, b.V)]
    contact = dm.Contact(slave=[(b.V, b.facet_tags, FACES["z-"])], master=tool, friction=0.5)
    problem = dm.ContactProblem(F, u, bcs=bcs, interfaces=[contact])
    tool.translation[2] = 1.02
    problem.solve()
    force = tool.force
    assert force[2] < -1
    assert np.linalg.norm(force[:2]) < 1e-3 * abs(force[2])


@pytest.mark.parametrize("shape", ["ball", "plane"])
def test_passing_through(shape):
    """A step that throws the body to the far side of a tool is refused."""
    p = pressed(ball(0.2) if shape == "ball" else plane(z=-0.01), "hex8", cells=(6, 6, 1))
    p.contact.tool.translation = (0, 0, 5.0)
    with pytest.raises((dm.ConvergenceError, RuntimeError)):
        p.problem.solve()
    assert not p.problem.state.started


# -- Tools that are carried by a load ----------------------------------------------------------


@pytest.mark.parametrize("element", ["hex8", "hex20", "tet10"])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_loaded_ball(element, friction):
    """The force of contact is the load; the ball goes where a prescribed motion has that force."""
    p = pressed(ball(2.0), element, friction=friction, free="z")
    tool, load = p.contact.tool, np.array([0.0, 0.0, 30.0])
    tool.applied_force = load / 3
    p.problem.solve()
    tool.applied_force = load
    p.problem.solve()
    assert tool.force[2] == pytest.approx(-30, rel=1e-9)
    np.testing.assert_allclose(tool.reaction_force[:2], -tool.force[:2])
    assert tool.reaction_force[2] == 0
    # What is left of all equations: forces alone are small before gaps are closed
    last = [max(i["force"], i["constraint"]) for i in p.problem.history][-3:]
    assert last[2] < 1e-9 and last[2] < 1e-3 * last[1] < 1e-4 * last[0]
    # Prescribed components are what they were told to be
    motion = p.problem._cpp_object.tool_motion(tool.describe())
    np.testing.assert_allclose([*motion[:2], *motion[3:]], 0, atol=1e-15)
    q = pressed(ball(2.0), element, friction=friction)
    middle = comm.bcast(float(tool.translation[2]))
    assert 0.02 < middle < 0.2
    if friction == 0:
        q.contact.tool.translation = (0, 0, middle)
        q.problem.solve()
        assert q.contact.tool.force[2] == pytest.approx(-30, rel=1e-7)


def test_all_components_free():
    """A plate on a ball joint finds the slope of a block's bottom, with an eccentric load too."""
    p = pressed(meshed(), "hex20", free="z rx ry")
    tool = p.contact.tool
    tool.rotation = (0, 0, 0)
    for t in (0.3, 1.0):
        tool.applied_force, tool.applied_moment = (0, 0, 20 * t), (1.0 * t, -0.6 * t, 0)
        p.problem.solve()
    np.testing.assert_allclose(tool.force[2], -20, rtol=1e-9)
    np.testing.assert_allclose(tool.moment[:2], [-1.0, 0.6], atol=1e-8)
    assert tool.rotation[0] > 1e-4 and tool.rotation[1] < -1e-4 and tool.rotation[2] == 0
    # Pressures act where force and moment do
    centre = p.contact.summary()["centre"] - [0.5, 0.5, 0]
    np.testing.assert_allclose(centre[:2], [0.6 / 20, 1.0 / 20], rtol=0.05)


def loaded_far_away(stabilise, force=20.0):
    """A plate below a block with a gap, free to tilt, pushed up away from the block's middle."""
    p = pressed(plane(-0.1), "hex20", free="z rx ry", stabilise=stabilise)
    p.contact.tool.applied_force = (0, 0, force)
    return p


def test_tool_that_springs_hold():
    """With springs a plate meets the block; without them nothing holds it on its way."""
    fails(loaded_far_away(None).problem.solve, "is not held", kind=dm.ConvergenceError)
    fails(
        loaded_far_away(1e-3).problem.solve,
        "stiffest springs",
        "ten times",
        kind=dm.ConvergenceError,
    )
    p = loaded_far_away(1e-2)
    tool = p.contact.tool
    p.problem.solve()
    assert tool.force[2] == pytest.approx(-20, rel=1e-6)
    np.testing.assert_allclose(tool.moment, 0, atol=1e-5)
    found = p.problem.stabilisation
    assert 0 < found["force"] < 1e-5 and 0 < found["energy_share"] < 1e-4
    # From there it stands without springs, and the place is the same
    place = np.array([*tool.translation, *tool.rotation])
    q = pressed(plane(), "hex20", free="z rx ry")
    q.contact.tool.applied_force = (0, 0, 20)
    q.problem.solve()
    np.testing.assert_allclose(tool.rotation, q.contact.tool.rotation, atol=1e-6)
    np.testing.assert_allclose(place[2], 0.1 + q.contact.tool.translation[2], rtol=1e-6)
    # Prescribed components begin where they are, and are told where to go
    tool.translation = (0.01, 0, 0)
    p.problem.solve()
    np.testing.assert_allclose(tool.translation[:2], [0.01, 0], atol=1e-12)
    assert tool.force[2] == pytest.approx(-20, rel=1e-6)


def test_long_cycles():
    """Sets that come back after eight iterations, as of a plate that first meets a corner."""
    p = loaded_far_away(1e-1, 5.0)
    p.problem.solve()
    assert p.contact.tool.force[2] == pytest.approx(-5, rel=1e-4)


def test_tool_that_springs_alone_would_hold():
    p = pressed(plane(-0.1), "hex8", free="z", stabilise=1e-3)
    p.contact.tool.applied_force = (0, 0, -20)
    fails(p.problem.solve, "carry all of the loads", kind=dm.ConvergenceError)


def test_roller_that_is_driven():
    """A moment turns a roller below a block until friction balances it."""
    p = pressed(
        lambda: dm.RigidCylinder((0.5, 0.5, -0.5), (0, 1, 0), 0.5),
        "hex20",
        cells=(8, 2, 2),
        friction=0.3,
        free="ry",
    )
    tool = p.contact.tool
    tool.translation = (0, 0, 0.05)
    p.problem.solve()
    for moment in (1.0, 2.0, 4.0):
        tool.applied_moment[1] = moment
        p.problem.solve()
        assert tool.moment[1] == pytest.approx(-moment, rel=1e-8)
    assert 0.001 < tool.rotation[1] < 0.1
    assert p.contact.force[0] > 0


def test_body_tied_to_a_loaded_tool():
    """A grip that pulls: its force is the load, and its path that of a force on the free end."""
    p = pressed(plane(), "hex20", kind=dm.Tie, free="all")
    tool = p.contact.tool
    tool.applied_force, tool.applied_moment = (2.0, 1.0, -3.0), (0.1, 0.2, 0.3)
    p.problem.solve()
    np.testing.assert_allclose(tool.force, [-2, -1, 3], rtol=1e-8)
    # Moment about where the reference point is now; ties act at reference positions
    assert p.problem.history[-1]["force"] < 1e-9
    assert tool.translation[2] < 0


def test_loads_are_saved(tmp_path):
    runs = []
    for again in (False, True):
        p = pressed(ball(2.0), "hex8", friction=0.2, free="z ry")
        tool = p.contact.tool
        tool.applied_force = (0, 0, 20)
        if again:
            p.problem.load(tmp_path / "state")
        else:
            p.problem.solve()
            p.problem.save(tmp_path / "state")
        tool.applied_force, tool.translation[0] = (0, 0, 30), 0.01
        p.problem.solve()
        runs.append(np.concatenate([tool.force, tool.moment, tool.translation, tool.rotation]))
    np.testing.assert_allclose(runs[0], runs[1], rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("element", ["hex8", "hex20"])
@pytest.mark.parametrize("solver", [{"pc_type": "cholesky"}, {"pc_type": "gamg"}])
def test_loaded_with_other_solvers(solver, element):
    p, q = (
        pressed(meshed(), element, cells=(4, 4, 3), free="z rx", petsc_options=options)
        for options in (None, solver)
    )
    for x in (p, q):
        x.contact.tool.applied_force, x.contact.tool.applied_moment = (0, 0, 10), (0.5, 0, 0)
        x.problem.solve()
    assert np.linalg.norm(p.contact.tool.rotation) > 1e-4
    np.testing.assert_allclose(q.contact.force, p.contact.force, atol=1e-6)
    np.testing.assert_allclose(q.contact.tool.translation, p.contact.tool.translation, atol=1e-7)


SHAPES = {
    "plane": lambda: dm.RigidPlane((0.3, 0.4, 0.01), (0.1, -0.05, 1)),
    "sphere": lambda: dm.RigidSphere((0.4, 0.6, -1.5), 1.52),
    "socket": lambda: dm.RigidSphere((0.5, 0.5, 2.0), 2.02, hollow=True),
    "cylinder": lambda: dm.RigidCylinder((0.5, 0.5, -1.0), (1, 0.3, 0.05), 1.01),
    "bore": lambda: dm.RigidCylinder((0.5, 0.5, 1.5), (0.2, 1, 0.0), 1.52, hollow=True),
    "facets": meshed("hex20"),
}


@pytest.mark.serial
@pytest.mark.parametrize("free", ["", "all"])
@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("element", ["hex8", "hex20", "hex27", "tet4", "tet10"])
@pytest.mark.parametrize("shape", SHAPES)
def test_jacobian(shape, element, friction, free):
    """The whole Newton matrix against differences, columns of the tool's frame included."""
    p = pressed(
        SHAPES[shape],
        element,
        cells=(2, 2, 1),
        friction=friction,
        initial_active="all",
        free=free,
        rotation=(0.4, -0.7, 0.3) if free else (0, 0, 0),
    )
    p.contact.tool.applied_moment = (3.0, -2.0, 5.0)
    p.contact.tool.describe()
    state, step, x = random_state(p.problem, p.contact, spread=8.0)
    worst, status, *_ = newton.check(p.problem, state, step, x)
    assert worst < 1e-8
    assert np.any(status != 0)


def random_state(problem, contact, spread):
    """As in the tests of the Newton matrix, with a frame that is moved and distorted, too."""
    rng = np.random.default_rng(7)
    cpp, n = problem._cpp_object, problem.coupling.layout.size
    problem.u.x.array[:] = 4e-3 * rng.standard_normal(len(problem.u.x.array))
    state, step = cpp.begin()
    x = np.zeros(n + problem.coupling.size)
    x[:n] = cpp.unknowns()
    first = cpp.evaluate(state, step, x).interfaces.interfaces[0]
    x[:n] += 4e-3 * rng.standard_normal(n)
    normal = first.configuration.normals[: contact.data.slave.num_owned]
    pressure = 20 + spread * rng.standard_normal(len(normal))
    x[n:] = (pressure[:, None] * normal + 4 * rng.standard_normal((len(normal), 3))).ravel()
    return state, step, x


def test_bad_input():
    """What cannot be is refused in words."""
    b = body("hex8")
    tags = b.facet_tags
    for make, word in (
        (lambda: dm.RigidPlane((0, 0), (0, 0, 1)), "three finite numbers"),
        (lambda: dm.RigidPlane((0, 0, 0), (0, 0, 0)), "not all zero"),
        (lambda: dm.RigidSphere((0, 0, 0), -1.0), "radius is -1.0, but must be a positive"),
        (lambda: dm.RigidSphere((0, 0, 0), None), "radius is None"),
        (lambda: dm.RigidSphere((0, 0, np.nan), 1.0), "finite"),
        (lambda: dm.RigidCylinder((0, 0, 0), (0, 0, 0), 1.0), "not all zero"),
        (lambda: dm.RigidCylinder((0, 0, 0), (0, 0, 1), "1"), "radius is '1'"),
        (lambda: dm.RigidSurface(b.mesh, tags, 1, None), "needs a reference_point"),
        (lambda: dm.RigidSurface(b.mesh, tags, 1.5, (0, 0, 0)), "must be a whole number"),
        (lambda: dm.RigidSurface(b.V, tags, 1, (0, 0, 0)), "must be a dolfinx.mesh.Mesh"),
        (lambda: setattr(dm.RigidSphere((0, 0, 0), 1), "free", "z q"), "free is 'q'"),
        (lambda: dm.RigidPlane((0, 0, 0), (0, 0, 1)).force, "not part of a ContactProblem yet"),
    ):
        fails(make, word)
    p = pressed(plane(), "hex8")
    p.contact.tool.translation[2] = np.nan
    fails(p.problem.solve, "translation is", "finite")
    p.contact.tool.translation = (0, 0, 0.01)
    p.problem.solve()
    u = fem.Function(b.V)
    F = ufl.derivative(cases.neo_hooke(E, NU)(u) * DX, u, ufl.TestFunction(b.V))
    again = dm.Contact(slave=[(b.V, tags, FACES["z-"])], master=p.contact.tool)
    fails(lambda: dm.ContactProblem(F, u, interfaces=[again]), "part of another ContactProblem")
    # A motion that differs between ranks
    if comm.size > 1:
        p.contact.tool.translation = (0, 0, 0.01 * (1 + comm.rank))
        fails(p.problem.solve, "translation of the tool of contact 0 is", "on rank 1")
