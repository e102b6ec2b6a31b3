# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Rigid tools: masters that do not deform and have no mesh, or facets alone."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh, MeshTags

from . import arguments, cpp
from .parts import Part

if TYPE_CHECKING:
    from .interfaces import Interface


_COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")


class RigidTool:
    """What the rigid tools have in common: motion, and the forces on them.

    A tool is the ``master`` of a :class:`Contact` or a :class:`Tie`, or of several. Its points move
    by a translation d and a rotation R about the reference point c, from X to c + d + R (X - c).
    A motion is prescribed like a Dirichlet condition: set it, alike on all ranks, and solve::

        ball = dm.RigidSphere((0, 0, 1.5), radius=0.5)
        contact = dm.Contact(V, facet_tags, slave=1, master=ball)
        problem = dm.ContactProblem(F, u, bcs=bcs, interfaces=[contact])
        for t in problem.steps(10, lambda t: ball.translation.put(2, -0.1 * t)):
            print(ball.force)

    A problem begins with the tool where its motion puts it when the problem is made.

    A tool can be carried by a load instead, in all or in some of its six components::

        ball.free = "z"  # before the problem is made
        ball.applied_force = (0, 0, -10)
        problem.solve()
        print(ball.translation[2])
    """

    #: Facets, where the tool has them
    parts: tuple[Part, ...] = ()

    def __init__(self, tool: cpp.RigidTool, reference_point: Any):
        if reference_point is not None:
            tool.reference_point = arguments.vector("reference_point", reference_point)
        self._tool = tool
        self._translation, self._rotation = np.zeros(3), np.zeros(3)
        self._applied_force, self._applied_moment = np.zeros(3), np.zeros(3)
        self._accepted: npt.NDArray[np.float64] | None = None
        self._interfaces: list[weakref.ref[Interface]] = []

    @property
    def reference_point(self) -> npt.NDArray[np.float64]:
        """Point [length] that rotations and moments are about, before the motion."""
        return np.array(self._tool.reference_point)

    @property
    def translation(self) -> npt.NDArray[np.float64]:
        """Translation [length], shape (3,); its entries may be set. Read when a solve begins.

        Where it is free it shows the last solution.
        """
        return self._translation

    @translation.setter
    def translation(self, value: Any) -> None:
        self._translation[:] = arguments.vector("translation", value)

    @property
    def rotation(self) -> npt.NDArray[np.float64]:
        """Rotation vector: about its direction, by its length [rad]; as translation."""
        return self._rotation

    @rotation.setter
    def rotation(self, value: Any) -> None:
        self._rotation[:] = arguments.vector("rotation", value)

    @property
    def free(self) -> tuple[str, ...]:
        """Components that are not prescribed but loaded, of ``"x y z rx ry rz"``; none at first.

        Set it before a problem is made, to names in one string or several, or ``"all"``. Where the
        rotation is free its vector must stay shorter than 2π.
        """
        return tuple(name for name, free in zip(_COMPONENTS, self._tool.free) if free)

    @free.setter
    def free(self, value: Any) -> None:
        self.check_free()
        names = value.split() if isinstance(value, str) else list(value)
        names = list(_COMPONENTS) if names == ["all"] else names
        for name in names:
            arguments.choice("free", name, [*_COMPONENTS, "all"])
        self._tool.free = [int(name in names) for name in _COMPONENTS]

    @property
    def applied_force(self) -> npt.NDArray[np.float64]:
        """Force on the reference point, in free components, shape (3,); entries may be set."""
        return self._applied_force

    @applied_force.setter
    def applied_force(self, value: Any) -> None:
        self._applied_force[:] = arguments.vector("applied_force", value)

    @property
    def applied_moment(self) -> npt.NDArray[np.float64]:
        """Moment about the reference point, in free components, shape (3,); entries may be set."""
        return self._applied_moment

    @applied_moment.setter
    def applied_moment(self, value: Any) -> None:
        self._applied_moment[:] = arguments.vector("applied_moment", value)

    @property
    def reaction_force(self) -> npt.NDArray[np.float64]:
        """Force that holds the tool in prescribed components, zero in free ones. Collective."""
        return np.where(self._tool.free[:3], 0.0, -self.force)

    @property
    def reaction_moment(self) -> npt.NDArray[np.float64]:
        """Moment that holds the tool in prescribed components, as above. Collective.

        Where some components of the rotation are free and others not it is the moment that acts,
        without what is applied.
        """
        return np.where(self._tool.free[3:], 0.0, -self.moment)

    @property
    def force(self) -> npt.NDArray[np.float64]:
        """Resultant of the forces of all interfaces on the tool, shape (3,). Collective."""
        return self._resultants()[0]

    @property
    def moment(self) -> npt.NDArray[np.float64]:
        """Their moment about the reference point where that is now, shape (3,). Collective."""
        return self._resultants()[1]

    def _resultants(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        interfaces = self._interfaces_alive()
        if not interfaces:
            raise RuntimeError(
                "The tool is not part of a ContactProblem yet: make it the master of an interface."
            )
        resultants = [i.resultants() for i in interfaces]
        force = np.sum([r.master_force for r in resultants], axis=0)
        about_origin = np.sum([r.master_moment for r in resultants], axis=0)
        return force, about_origin - np.cross(interfaces[0].tool_point(), force)

    def positions(self, X: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Where points X of the tool are in the last accepted state, both of shape (n, 3)."""
        motion = np.concatenate([self._translation, self._rotation])
        motion = motion if self._accepted is None else self._accepted
        a = np.asarray(X, dtype=np.float64) - self.reference_point
        R = np.asarray(cpp.rotation_matrix(motion[3:]))
        return self.reference_point + motion[:3] + a @ R.T

    # -- For interfaces ------------------------------------------------------------

    def describe(self) -> cpp.RigidTool:
        """The tool as the C++ library takes it, with its present motion."""
        self._tool.translation = arguments.vector("translation", self._translation)
        self._tool.rotation = arguments.vector("rotation", self._rotation)
        self._tool.force = arguments.vector("applied_force", self._applied_force)
        self._tool.moment = arguments.vector("applied_moment", self._applied_moment)
        return self._tool

    def update(self, problem: cpp.ContactProblem, every: bool = False) -> None:
        """Show the motion in the last accepted state; of every component, or of free ones."""
        motion = np.array(problem.tool_motion(self._tool))
        free = np.array(self._tool.free, dtype=bool) | every
        self._translation[free[:3]] = motion[:3][free[:3]]
        self._rotation[free[3:]] = motion[3:][free[3:]]
        self._accepted = motion

    def check_free(self) -> None:
        """Refuse a tool that is in a problem already."""
        if self._interfaces_alive():
            raise ValueError(
                "A rigid tool is part of another ContactProblem already: make a new one for each "
                "problem."
            )

    def attach(self, interface: Interface) -> None:
        """Become the master of an interface of a problem."""
        self._interfaces.append(weakref.ref(interface))

    def _interfaces_alive(self) -> list[Interface]:
        return [i for i in (ref() for ref in self._interfaces) if i is not None]

    def present_values(self) -> dict[str, Any]:
        """Its motion at present, to be the same on all ranks."""
        tool = self.describe()
        names = ("translation", "rotation", "force", "moment")
        return {f"{name} of the tool": list(getattr(tool, name)) for name in names}

    def numbers(self) -> list[float]:
        """Numbers that describe the tool, to be the same on all ranks."""
        return [float(x) for x in self._tool.frame(1.0)] + list(self._tool.reference_point)


class RigidPlane(RigidTool):
    """A half-space.

    Args:
        point: A point of its surface [length].
        normal: Outward normal, towards the slave.
        reference_point: Point that rotations and moments are about; by default ``point``.
    """

    def __init__(self, point: Any, normal: Any, reference_point: Any = None):
        direction = arguments.direction("normal", normal)
        tool = cpp.RigidTool.plane(arguments.vector("point", point), list(direction))
        super().__init__(tool, reference_point)


class RigidSphere(RigidTool):
    """A ball, or a socket.

    Args:
        centre: Centre [length].
        radius: Radius [length].
        hollow: The tool is all that lies outside of the sphere.
        reference_point: Point that rotations and moments are about; by default the centre.
    """

    def __init__(
        self, centre: Any, radius: float, hollow: bool = False, reference_point: Any = None
    ):
        radius = arguments.length("radius", radius)
        tool = cpp.RigidTool.sphere(arguments.vector("centre", centre), radius, bool(hollow))
        super().__init__(tool, reference_point)


class RigidCylinder(RigidTool):
    """A roller, infinitely long, or a bore.

    Args:
        point: A point of the axis [length].
        axis: Direction of the axis.
        radius: Radius [length].
        hollow: The tool is all that lies outside of the cylinder.
        reference_point: Point that rotations and moments are about; by default ``point``.
    """

    def __init__(
        self,
        point: Any,
        axis: Any,
        radius: float,
        hollow: bool = False,
        reference_point: Any = None,
    ):
        direction = arguments.direction("axis", axis)
        radius = arguments.length("radius", radius)
        tool = cpp.RigidTool.cylinder(
            arguments.vector("point", point), list(direction), radius, bool(hollow)
        )
        super().__init__(tool, reference_point)


class RigidSurface(RigidTool):
    """Facets of a mesh, which move as one and have no unknowns.

    Args:
        mesh: Mesh of degree 1 or 2, on the ranks of the bodies' meshes.
        facet_tags: Tags of its boundary facets.
        tag: Tag of the facets of the tool. Their normals point out of the mesh.
        reference_point: Point that rotations and moments are about.
    """

    def __init__(self, mesh: Mesh, facet_tags: MeshTags, tag: int, reference_point: Any):
        if not isinstance(mesh, Mesh):
            raise ValueError(f"mesh is a {type(mesh).__name__}, but must be a dolfinx.mesh.Mesh.")
        if reference_point is None:
            raise ValueError(
                "A RigidSurface needs a reference_point: rotations and moments are about it."
            )
        point = arguments.vector("reference_point", reference_point)
        element = mesh.ufl_domain().ufl_coordinate_element().sub_elements[0]
        V = fem.functionspace(mesh, ("Lagrange", element.basix_element.degree, (3,)))
        self.parts = (Part(V, facet_tags, tag).checked("master"),)
        self._displacement = fem.Function(V, name="displacement")
        super().__init__(cpp.RigidTool(point), None)

    @property
    def displacement(self) -> fem.Function:
        """Displacement of the tool's mesh in the last accepted state, always the same function."""
        return self._displacement

    def update(self, problem: cpp.ContactProblem, every: bool = False) -> None:
        """See :meth:`RigidTool.update`."""
        super().update(problem, every)
        x = self._displacement.function_space.tabulate_dof_coordinates()
        self._displacement.x.array[:] = (self.positions(x) - x).ravel()
