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
    """

    #: Facets, where the tool has them
    parts: tuple[Part, ...] = ()

    def __init__(self, tool: cpp.RigidTool, reference_point: Any):
        if reference_point is not None:
            tool.reference_point = arguments.vector("reference_point", reference_point)
        self._tool = tool
        self._translation, self._rotation = np.zeros(3), np.zeros(3)
        self._interfaces: list[weakref.ref[Interface]] = []

    @property
    def reference_point(self) -> npt.NDArray[np.float64]:
        """Point [length] that rotations and moments are about, before the motion."""
        return np.array(self._tool.reference_point)

    @property
    def translation(self) -> npt.NDArray[np.float64]:
        """Translation [length], shape (3,); its entries may be set. Read when a solve begins."""
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

    # -- For interfaces ------------------------------------------------------------

    def describe(self) -> cpp.RigidTool:
        """The tool as the C++ library takes it, with its present motion."""
        self._tool.translation = arguments.vector("translation", self._translation)
        self._tool.rotation = arguments.vector("rotation", self._rotation)
        return self._tool

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
        return {"translation": list(tool.translation), "rotation": list(tool.rotation)}

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
        super().__init__(cpp.RigidTool(point), None)
