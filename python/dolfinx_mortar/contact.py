# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Unilateral contact with or without friction."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import MeshTags

from . import agreement, arguments, cpp
from .interfaces import Interface
from .offsets import Offset
from .tools import RigidTool

_CHOICES = {
    "gap": cpp.InitialActive.gap,
    "none": cpp.InitialActive.none,
    "all": cpp.InitialActive.all,
}


#: Of a summary
_NUMBERS = (
    *("area", "mean_pressure", "largest_pressure", "penetration"),
    *("open", "stick", "slip", "dissipation"),
)


class Contact(Interface):
    r"""Unilateral contact of two surfaces, with Coulomb or Tresca friction.

    Args:
        V, facet_tags, slave, master: See :class:`Tie`.
        multiplier, integration, quadrature_degree: See :class:`Tie`.
        search_distance, max_angle, min_coverage: See :class:`Tie`.
        friction: Coulomb's coefficient μ; None or 0 for frictionless contact. A ``fem.Constant``
            is read when a solve begins.
        tresca: Given bound of the tangential traction [traction] instead of μ z_n; a number or a
            ``fem.Constant``.
        offset: Added to the gap [length]: an interference below zero, a clearance above it. A
            number, or a scalar ``fem.Constant``, ``fem.Function`` or UFL expression on the slave's
            mesh, interpolated at the slave nodes when a solve begins; a list of these where the
            slave surface is on several bodies.
        c_n, c_t: Complementarity parameters [traction per length]. They change the path of the
            iteration, not its result; by default the stiffness of the slave nodes per area, of
            which c_n is a tenth in the first iterations of a solve.
        geometry: ``"current"`` (finite deformation, everything linearised) or ``"reference"``
            (small deformation: D, M and normals stay those of the reference configuration).
        initial_active: Nodes in contact when the first solve starts: ``"gap"`` (those that
            penetrate, and where a body would not be held otherwise, those that it meets first on
            the way that its loads drive it), ``"none"``, ``"all"``, or a function of positions
            (shape (3, n)) that returns flags.
        normal: Only with ``geometry="reference"``: direction from the slave to the master to be
            used at all nodes instead of the slave's own normals. With small strains both are
            right up to the angle between the surfaces; the normal of a plane master is the
            better choice, as it makes contact with that plane exact.
        feature_angle: Angle [degrees] between slave facets, in the reference configuration, from
            which on they meet at an edge. The patches on the sides of an edge have their own
            normals and gaps: a node there is in contact with each of them on its own, on two or
            three at once in the corner of a master. Friction of such a node acts along the edge,
            with the sum of both normal forces. 180 averages normals over all edges.
        balance: Spread the integration evenly over all ranks, whatever the partition of the
            bodies; False leaves a facet to the rank that owns its cell. By default it is spread
            from 50 slave facets on. With ``geometry="reference"``, which is integrated once, it
            never is.
    """

    columns: ClassVar[Mapping[str, int]] = {
        **Interface.columns,
        "pressure": 1,
        "recovered_pressure": 1,
        "gap": 1,
        "status": 1,
        "slip": 3,
        "tangential_traction": 3,
    }

    def __init__(
        self,
        V: fem.FunctionSpace | Sequence[fem.FunctionSpace] | None = None,
        facet_tags: MeshTags | Sequence[MeshTags] | None = None,
        *,
        slave: int | Sequence[tuple],
        master: int | Sequence[tuple] | RigidTool,
        friction: float | fem.Constant | None = None,
        tresca: float | fem.Constant | None = None,
        offset: Any = None,
        c_n: float | None = None,
        c_t: float | None = None,
        geometry: str = "current",
        initial_active: str | Callable = "gap",
        normal: Sequence[float] | None = None,
        feature_angle: float = 40.0,
        balance: bool | None = None,
        **options: Any,
    ):
        super().__init__(V, facet_tags, slave=slave, master=master, **options)
        with agreement.alike(self.comm) as same:
            self.friction, self.tresca, self.offset = friction, tresca, offset
            arguments.positive("c_n", c_n, "a traction per length")
            arguments.positive("c_t", c_t, "a traction per length")
            arguments.choice("geometry", geometry, ("current", "reference"))
            if not callable(initial_active) and initial_active not in _CHOICES:
                raise ValueError(
                    f"initial_active is {initial_active!r}, but must be 'gap', 'none', 'all' or a "
                    "function of positions."
                )
            direction = None if normal is None else arguments.direction("normal", normal)
            if normal is not None and geometry != "reference":
                raise ValueError("A given normal makes sense only with geometry='reference'.")
            same.update(self.friction_values())
            same["offset"] = self._offset.numbers()
            same["c_n"], same["c_t"], same["geometry"] = c_n, c_t, geometry
            same["initial_active"] = "a function" if callable(initial_active) else initial_active
            same["normal"] = None if direction is None else direction.tolist()
            arguments.positive("feature_angle", feature_angle, "of degrees")
            if feature_angle > 180:
                raise ValueError(f"feature_angle is {feature_angle}, but cannot be above 180.")
            same["feature_angle"] = feature_angle
            if balance not in (None, True, False):
                raise ValueError(f"balance is {balance!r}, but must be True, False or None.")
            same["balance"] = balance
        self._feature_angle = float(feature_angle)
        self._balance = None if balance is None else bool(balance)
        self._geometry = geometry
        self._c = (c_n, c_t)
        self._normal = direction
        self._initial_active = initial_active

    # -- What a user has said ------------------------------------------------------

    @property
    def geometry(self) -> str:
        """The geometry that was chosen."""
        return self._geometry

    @property
    def friction(self) -> float | fem.Constant:
        """Coulomb's coefficient μ. May be changed between solves, alike on all ranks."""
        return 0.0 if self._friction is None else self._friction

    @friction.setter
    def friction(self, value: float | fem.Constant | None) -> None:
        self._friction = arguments.bound("friction", value)

    @property
    def tresca(self) -> float | fem.Constant | None:
        """Tresca's bound [traction] or None. May be changed between solves, as friction."""
        return self._tresca

    @tresca.setter
    def tresca(self, value: float | fem.Constant | None) -> None:
        self._tresca = arguments.bound("tresca", value)

    @property
    def offset(self) -> Any:
        """What is added to the gap [length], as given. May be changed between solves."""
        return self._offset.given

    @offset.setter
    def offset(self, value: Any) -> None:
        self._offset = Offset(value)

    def present_values(self) -> dict[str, Any]:
        """What friction, offset and motion are at present, to be the same on all ranks.

        Raises:
            ValueError: A value that a user has changed meanwhile cannot be.
        """
        offset = {"offset": self._offset.numbers()}
        return {**super().present_values(), **self.friction_values(), **offset}

    def present_offset(self) -> npt.NDArray[np.float64]:
        """Offset of the local slave nodes, as the C++ library takes it. Collective.

        That of ghosts is zero: their owners know it.
        """
        spaces = [f.function_space for f in arguments.as_list(self.gap)]
        owned = self._offset.values(spaces, self.slave_dofs())
        if self._offset.given is None:
            return owned
        return np.pad(owned, (0, self.data.slave.num_nodes - len(owned)))

    def friction_values(self) -> dict[str, float | None]:
        """What friction is at present, to be the same on all ranks.

        Raises:
            ValueError: A value that a user has changed meanwhile cannot be.
        """
        friction = arguments.value(arguments.bound("friction", self._friction))
        tresca = arguments.value(arguments.bound("tresca", self._tresca))
        if friction and tresca is not None:
            raise ValueError("Give either friction (Coulomb) or tresca, not both.")
        return {"friction": friction, "tresca": tresca}

    @property
    def is_frictional(self) -> bool:
        """Tangential tractions are possible."""
        return bool(arguments.value(self._friction)) or self._tresca is not None

    def present_friction(self) -> cpp.Friction:
        """Friction as the C++ library takes it."""
        values = self.friction_values()
        return cpp.Friction(values["friction"] or 0.0, values["tresca"])

    def describe(self) -> cpp.InterfaceOptions:
        """See :meth:`Interface.describe`."""
        options, choice = super().describe(), self._initial_active
        options.make_contact(
            *self._c,
            self._geometry == "reference",
            self.present_friction(),
            self._feature_angle,
            None if self._normal is None else [float(n) for n in self._normal],
            cpp.InitialActive.given if callable(choice) else _CHOICES[choice],
            _flags(choice, self.comm) if callable(choice) else None,
        )
        options.balance = self._balance
        return options

    # -- Results -------------------------------------------------------------------

    @property
    def pressure(self) -> fem.Function:
        """Contact pressure n·λ [traction], positive in compression; see :attr:`multiplier`.

        Nodal values: averages with the functions of the nodes, which are wide at corners and narrow
        at edges, so that both differ where the pressure varies.

        At an edge, where a node has a normal and a pressure on each side, the largest.
        """
        return self._field("pressure")

    @property
    def recovered_pressure(self) -> fem.Function:
        """Pressure of :attr:`recovered_traction`.

        On curved masters that are coarser than the slave it has a quarter to a ninth of the error
        (L2) of nodal values with ``"dual"``; on flat and fine ones these have the smaller one.
        """
        return self._field("recovered_pressure")

    @property
    def tangential_traction(self) -> fem.Function:
        """Tangential part of the contact traction on the slave body."""
        return self._field("tangential_traction")

    @property
    def gap(self) -> fem.Function:
        """Distance of the master along the slave's normals [length].

        Near the master an average around each node with the multiplier's functions, as in the
        contact condition; further away the mean gap of the facets around. Nodes that carry no
        multiplier have the mean of their neighbours, zero where these carry none either, as out
        of reach of the search. At an edge the smallest.
        """
        return self._field("gap")

    @property
    def slip(self) -> fem.Function:
        """Tangential slip [length] of slave nodes in contact since contact began."""
        return self._field("slip")

    @property
    def status(self) -> fem.Function:
        """0 open, 1 stick, 2 slip (frictionless contact: always 2); at an edge the largest."""
        return self._field("status")

    @property
    def dissipation(self) -> float:
        """Energy that friction took in the last step, never negative. Collective."""
        self.evaluation  # noqa: B018 (an error where there is none)
        return self._owner().comm.allreduce(self.state.dissipation)

    @property
    def num_active(self) -> int:
        """Number of slave nodes in contact, on all ranks. Collective."""
        self.evaluation  # noqa: B018
        return self._owner().comm.allreduce(int(np.sum(self.state.status != cpp.Status.open)))

    def summary(self) -> dict[str, Any]:
        """The contact in numbers, in the last accepted state. Collective.

        Returns:
            ``force`` on the slave (3,), ``centre`` of the pressure (3,), ``area`` of the nodes in
            contact, ``mean_pressure`` there, ``largest_pressure`` of a node, ``penetration`` (the
            deepest overlap at integration points; conditions hold as averages around nodes),
            numbers of ``open``, ``stick`` and ``slip`` nodes (without friction all in contact
            are in ``slip``), ``dissipation`` of the last step.

        Raises:
            RuntimeError: There is no solution yet.
        """
        s = self._cpp.summarise(self._index)
        vectors = {name: np.array(getattr(s, name)) for name in ("force", "centre")}
        return vectors | {name: getattr(s, name) for name in _NUMBERS}

    @property
    def force(self) -> npt.NDArray[np.float64]:
        """Resultant of the contact forces on the slave body, shape (3,). Collective."""
        return np.array(self.resultants().slave_force)

    @property
    def master_force(self) -> npt.NDArray[np.float64]:
        """Resultant of the contact forces on the master body, shape (3,). Collective."""
        return np.array(self.resultants().master_force)

    @property
    def moment(self) -> npt.NDArray[np.float64]:
        """Moment about the origin of the contact forces on the slave, shape (3,). Collective."""
        return np.array(self.resultants().slave_moment)

    @property
    def master_moment(self) -> npt.NDArray[np.float64]:
        """Moment about the origin of the contact forces on the master, shape (3,). Collective."""
        return np.array(self.resultants().master_moment)


def _flags(choice: Callable, comm: MPI.Intracomm) -> Callable[[npt.NDArray], npt.NDArray[np.int8]]:
    """A function of positions, shape (n, 3), that returns what a user's function chooses.

    It raises on all ranks where the user's function raises, or returns no flags, on one.
    """

    def flags(x: npt.NDArray[np.float64]) -> npt.NDArray[np.int8]:
        n = len(x)
        chosen: npt.NDArray = np.zeros(n, dtype=bool)
        with agreement.alike(comm):
            if n > 0:
                given = choice(x.T.copy())
                chosen = np.asarray(given)
                if chosen.shape != (n,) or not np.isin(chosen, (0, 1)).all():
                    raise ValueError(
                        "initial_active returned "
                        f"{'None' if given is None else f'{chosen.dtype} of shape {chosen.shape}'}:"
                        " for positions of shape (3, n) it must return n flags, True where a node "
                        "is in contact."
                    )
        return chosen.astype(np.int8)

    return flags
