# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Unilateral contact with or without friction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx.common import Timer

from . import agreement, arguments, cpp, sparse
from .contact_fields import ContactFields
from .friction import Frictional
from .parts import Part

if TYPE_CHECKING:
    from .problem import ContactProblem

OPEN, STICK, SLIP = 0, 1, 2


class Contact(Frictional, ContactFields):
    r"""Unilateral contact of two surfaces, with Coulomb or Tresca friction.

    Args:
        V, facet_tags, slave, master, multiplier, integration, quadrature_degree,
            search_distance, max_angle, min_coverage: See :class:`Tie`.
        friction: Coulomb's coefficient μ; None or 0 for frictionless contact. A ``fem.Constant``
            is read when a solve begins.
        tresca: Given bound of the tangential traction [traction] instead of μ z_n; a number or a
            ``fem.Constant``.
        c_n, c_t: Complementarity parameters [traction per length]. They change the path of the
            iteration, not its result; by default the stiffness of the slave nodes per area.
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
    """

    _leave_distant = True

    def __init__(
        self,
        V=None,
        facet_tags=None,
        *,
        slave,
        master,
        friction: float | None = None,
        tresca: float | None = None,
        c_n: float | None = None,
        c_t: float | None = None,
        geometry: str = "current",
        initial_active: str | Callable = "gap",
        normal: Sequence[float] | None = None,
        feature_angle: float = 40.0,
        **options: Any,
    ):
        super().__init__(V, facet_tags, slave=slave, master=master, **options)
        with agreement.alike(self._comm) as same:
            self.friction, self.tresca = friction, tresca
            arguments.positive("c_n", c_n, "a traction per length")
            arguments.positive("c_t", c_t, "a traction per length")
            arguments.choice("geometry", geometry, ("current", "reference"))
            if not callable(initial_active) and initial_active not in ("gap", "none", "all"):
                raise ValueError(
                    f"initial_active is {initial_active!r}, but must be 'gap', 'none', 'all' or a "
                    "function of positions."
                )
            self._normal = arguments.direction(normal)
            if normal is not None and geometry != "reference":
                raise ValueError("A given normal makes sense only with geometry='reference'.")
            same.update(self._friction_arguments())
            same["c_n"], same["c_t"], same["geometry"] = c_n, c_t, geometry
            same["initial_active"] = "a function" if callable(initial_active) else initial_active
            same["normal"] = None if normal is None else self._normal.tolist()
            arguments.positive("feature_angle", feature_angle, "of degrees")
            if feature_angle > 180:
                raise ValueError(f"feature_angle is {feature_angle}, but can not be above 180.")
            same["feature_angle"] = feature_angle
        self._feature_angle = float(feature_angle)
        self._geometry = geometry
        self._c = (c_n, c_t)
        self._initial_active = initial_active

    @property
    def geometry(self) -> str:
        """The geometry that was chosen."""
        return self._geometry

    # -- Called by the problem ---------------------------------------------------

    def _surface(self, pieces: list[Part], side: str) -> cpp.Surface:
        surface = super()._surface(pieces, side)
        if side == "master":
            return surface
        whole = surface.num_global
        surface = cpp.split_at_edges(surface, np.radians(self._feature_angle))
        #: Some node is one of several at its place, on any rank
        self._split = surface.num_global > whole
        blocks = surface.blocks[: surface.num_owned]
        #: Displacement blocks of the owned nodes, None where no two are the same
        self._blocks = None if len(np.unique(blocks)) == len(blocks) else blocks.copy()
        return surface

    def _find_idle(self, nodal: dict, covered: npt.NDArray[np.bool_]) -> npt.NDArray[np.int8]:
        """Flag the nodes that masters do not touch and hardly cover.

        Shared among the neighbours, the gap of such a node would count as theirs: a master that
        comes under the side of a fillet would lift the nodes that it rests on. Left out, the node
        is open, as it is with a multiplier once it is covered.
        """
        if self.geometry == "reference":  # gaps are not those of the nodal integrals
            return super()._find_idle(nodal, covered)
        distant = np.asarray(nodal["near"]) == 0
        return (self._candidates.astype(bool) & ~covered & distant).astype(np.int8)

    def _drop_repeated(self, nodal: dict, carries: npt.NDArray[np.int8]) -> None:
        """Of patches that meet the same master surface at a node the one that faces it best stays.

        On a plane the gaps of both sides of an edge are one condition: both are the distance of
        the edge from the plane. Masters that face different ways give one each. Collective.
        """
        n = self.num_owned
        self._barred = np.zeros(n, dtype=bool)
        if self._blocks is not None:
            master = nodal["master_normal"][:n]
            master = master / np.maximum(np.linalg.norm(master, axis=1), 1e-300)[:, None]
            opposed = -np.sum(master * self._configuration.normals[:n], axis=1)
            same = np.cos(np.radians(self._feature_angle))
            _, first, count = np.unique(self._blocks, return_index=True, return_counts=True)
            for start, size in zip(first[count > 1], count[count > 1]):
                nodes = start + np.flatnonzero(carries[start : start + size])
                kept: list[int] = []
                for j in nodes[np.argsort(-opposed[nodes], kind="stable")]:
                    if any(master[j] @ master[k] > same for k in kept):
                        self._barred[j] = True
                    else:
                        kept.append(j)

    def _set_parameters(self, stiffness: npt.NDArray[np.float64]) -> None:
        """Set complementarity parameters [traction per weighted gap].

        Args:
            stiffness: Stiffness of the owned slave nodes [force per length], shape (num_owned,).
        """
        area = np.maximum(self._weights[: self.num_owned], 1e-300)
        default = stiffness / area**2
        self._c_n = default if self._c[0] is None else self._c[0] / area
        self._c_t = default if self._c[1] is None else self._c[1] / area
        # A traction, until the first iterate gives a better one
        self._scale = self._c_t * area**1.5

    def _largest_traction(self, z: npt.NDArray[np.float64]) -> float:
        """Largest traction at work, for relative tolerances: of no less than round-off. Collective.

        Args:
            z: Multipliers of the owned nodes [traction], any shape.
        """
        # Times the default tolerance 1e-9 the floor is the round-off of positions, 1e-15, times
        # the stiffness with which gaps count as tractions
        X = np.concatenate([self._surface_slave.X, self._surface_master.X])
        stiffness = self._c_n * self._weights[: self.num_owned]
        mine = [np.abs(z).max(initial=0.0), np.abs(X).max(initial=0.0), stiffness.max(initial=0.0)]
        largest = np.empty(3)
        self._layout.comm.Allreduce(np.array(mine), largest, op=MPI.MAX)
        return max(float(largest[0]), 1e-6 * float(largest[1] * largest[2]))

    def _configure(self, u_all) -> cpp.Configuration:
        """Positions, normals and candidates for ``u_all`` (None: reference). Collective."""
        with Timer("~mortar: search"):
            configuration = cpp.configure(self._data, *self._positions(u_all))
        if self._normal is not None:
            configuration.normals = np.tile(self._normal, (self.num_nodes, 1))
        return configuration

    def _set_arguments(self, z, gap, motion, forced) -> None:
        """State of the owned nodes that :meth:`_evaluate_law` is about.

        Args:
            z: Multipliers [traction], shape (num_owned, 3).
            gap: Weighted gaps [length³], shape (num_owned,).
            motion: Weighted relative motion in this step [length³], shape (num_owned, 3), or None
                without friction.
            forced: States to use, or None for those that follow from the values.
        """
        self._multipliers, self._gap_weighted = z, gap
        self._motion, self._forced = motion, forced

    def _evaluate_law(self, damped: bool = False) -> npt.NDArray[np.float64]:
        """Complementarity function at the owned nodes, shape (num_owned, 3).

        See C++ contact_residual; keeps its results in ``_law``.
        """
        n, motion = self.num_owned, self._motion
        # Distances of the reference configuration say nothing about the present one
        frozen = self.geometry == "reference"
        near = None if frozen else np.ascontiguousarray(self._nodal["near"][:n])
        self._law = cpp.contact_residual(
            np.ascontiguousarray(self._multipliers),
            np.ascontiguousarray(self._configuration.normals[:n]),
            np.ascontiguousarray(self._gap_weighted),
            None if motion is None else np.ascontiguousarray(motion),
            self._scale if self.is_frictional else None,
            self._c_n,
            self._c_t,
            self._data.carries[:n] * (~self._barred & (self._nodal["coverage"][:n] > 0)),
            np.ascontiguousarray(self._fixed[:n]),
            arguments.value(self._friction) or 0.0,
            arguments.value(self._tresca),
            self._forced,
            damped,
            near,
            self._blocks,
        )
        return self._law["value"]

    def _rescale(self) -> None:
        """Let the tangential equations of nodes in contact be of the size of tractions."""
        bound = self._law["bound"]
        self._scale = np.where(bound > 0, bound, self._scale)

    def _accept_slip(self) -> None:
        """Add the slip of the step that ends with the last evaluated state."""
        n = self._configuration.normals[: self.num_owned]
        slip = np.sum(self._motion * n, axis=1)[:, None] * n - self._motion
        closed = (self._status != OPEN)[:, None]
        slip = np.where(closed, slip, 0.0)
        self._dissipation = float(np.sum(self._multipliers * slip))
        # An average of slip, from slip times area
        weight = np.where(closed, self._nodal["weight"][: self.num_owned, None], 1.0)
        self._total_slip = np.where(closed, self._total_slip + slip / weight, 0.0)

    @property
    def _status(self) -> npt.NDArray[np.int8]:
        """State of the owned slave nodes."""
        return self._law["status"]

    def _nodal_gap(self) -> npt.NDArray[np.float64]:
        """Gap of the owned nodes [length]; infinite where no master is near."""
        n = self.num_owned
        weight = self._nodal["weight"][:n]
        carries = self._data.carries[:n].astype(bool)
        return np.where(carries, self._gap_weighted / np.where(carries, weight, 1.0), np.inf)

    def _check_candidates(self) -> None:
        """Refuse a slave surface on which contact could not act anywhere. Collective."""
        if self._layout.comm.allreduce(int(np.sum(self._candidates[: self.num_owned]))) == 0:
            raise RuntimeError(
                f"No node of the slave surface (facet tag {self.slave[0].tag}) can carry a "
                "contact traction: the displacements of all of them are prescribed, or they "
                "belong to other interfaces as well. Let the other surface be the slave."
            )

    def _check_normal(self) -> None:
        """Refuse a given normal that does not lead from the slave to the master. Collective.

        Raises:
            ValueError: It does not, by the slave's own normals where it faces the master.
        """
        if self._normal is None:
            return
        configuration = cpp.configure(self._data, *self._positions(None))
        covered = cpp.integrate(self._data, configuration)["coverage"][: self.num_owned]
        area = np.column_stack([covered, self._weights[: self.num_owned]])
        own = self._layout.comm.allreduce(area.T @ configuration.normals[: self.num_owned])
        # Surfaces that are far from each other do not face anything yet
        mean = own[0] if own[0].any() else own[1]
        mean = mean / max(np.linalg.norm(mean), 1e-300)
        if mean @ self._normal < 0.1:
            given, own = (np.array2string(v, precision=3) for v in (self._normal, mean))
            raise ValueError(
                f"normal is {given}, but the slave's own normal is about {own} where it faces the "
                "master: give the direction from the slave to the master."
            )

    def _overlap(self) -> float:
        """Deepest overlap at the nodes that carry a multiplier, in facet sizes. Collective."""
        n = self.num_owned
        use = self._data.carries[:n].astype(bool) & self._nodal["near"][:n].astype(bool)
        depth = -self._nodal["gap"][:n][use] / self._nodal["weight"][:n][use]
        area = self._weights[:n]
        mine = np.array([depth.max(initial=0.0), area.max(initial=0.0)])
        deepest = np.empty(2)
        self._layout.comm.Allreduce(mine, deepest, op=MPI.MAX)
        return float(deepest[0] / np.sqrt(deepest[1]))

    def _gap_everywhere(
        self, u: npt.NDArray[np.float64]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
        """Gap of the owned nodes [length], as if all of them carried a multiplier. Collective.

        Args:
            u: Owned displacements.

        Returns:
            Gaps, and flags of the nodes that a master is near of, shapes (num_owned,).
        """
        n, carries = self.num_owned, self._data.carries
        problem = self._owner()
        B = problem._coupling.multipliers.z_by_u()
        self._data.carries = np.ones_like(carries)
        nodal = cpp.integrate(self._data, self._configuration, B=B)
        self._data.carries = carries
        B.assemble()
        gap, near = nodal["gap"][:n], nodal["near"][:n].astype(bool)
        if self.geometry == "reference":
            rows = problem._coupling.multipliers.slice(self)
            moved = sparse.product(B, u)[rows].reshape(-1, 3)
            gap = gap - np.sum(self._configuration.normals[:n] * moved, axis=1)
            near[:] = True
        B.destroy()
        weight = nodal["weight"][:n]
        near &= weight > self._min_coverage * self._weights[:n]
        return gap / np.where(near, weight, 1.0), near

    def _initial_status(self, first: npt.NDArray[np.bool_] | None) -> npt.NDArray[np.int8]:
        """States to begin with. Collective.

        Args:
            first: Nodes that are to hold a body; None where all bodies are held.
        """
        n = self.num_owned
        carries = self._data.carries[:n].astype(bool)
        choice = self._initial_active
        if choice == "none":
            return np.zeros(n, dtype=np.int8)
        if choice == "all":
            closed = carries
        elif callable(choice):
            closed = self._chosen(choice) & carries
        else:
            # Where surfaces touch, round-off must not choose among their nodes
            touching = self._distances() <= 1e-9 * np.sqrt(self._weights[:n])
            closed = carries & ((self._status != OPEN) | touching)
            if first is not None:
                closed |= carries & first
        state = np.where(closed, STICK if self.is_frictional else SLIP, OPEN)
        return state.astype(np.int8)

    def _chosen(self, choice: Callable) -> npt.NDArray[np.bool_]:
        """Owned slave nodes that a user's function chooses, shape (num_owned,). Collective.

        Raises:
            ValueError: The function does not return flags. What it raises itself comes through.
        """
        n = self.num_owned
        flags = np.zeros(n, dtype=bool)
        with agreement.alike(self._layout.comm):
            if n > 0:
                chosen = choice(self._surface_slave.X[:n].T.copy())
                flags = np.asarray(chosen)
                if flags.shape != (n,) or not np.isin(flags, (0, 1)).all():
                    raise ValueError(
                        "initial_active returned "
                        f"{'None' if chosen is None else f'{flags.dtype} of shape {flags.shape}'}: "
                        "for positions of shape (3, n) it must return n flags, True where a node "
                        "is in contact."
                    )
        return flags.astype(bool)

    # -- Results -------------------------------------------------------------------

    def _solved(self) -> ContactProblem:
        """The problem, which must have a solution to look at."""
        problem = self._owner()
        if not problem._started:
            raise RuntimeError(
                "There is no solution yet: call solve() of the ContactProblem first."
            )
        return problem

    def _current(self):
        problem = self._owner()
        if self.geometry == "reference":
            return None
        return self._layout.all_local(problem._functions)

    @property
    def dissipation(self) -> float:
        """Energy that friction took in the last step, never negative. Collective."""
        return self._solved().comm.allreduce(getattr(self, "_dissipation", 0.0))

    @property
    def num_active(self) -> int:
        """Number of slave nodes in contact, on all ranks. Collective."""
        return self._solved().comm.allreduce(int(np.sum(self._status != OPEN)))

    @property
    def force(self) -> npt.NDArray[np.float64]:
        """Resultant of the contact forces on the slave body, shape (3,). Collective."""
        return self._solved()._resultants(self)[0]

    @property
    def master_force(self) -> npt.NDArray[np.float64]:
        """Resultant of the contact forces on the master body, shape (3,). Collective."""
        return self._solved()._resultants(self)[1]

    @property
    def moment(self) -> npt.NDArray[np.float64]:
        """Moment about the origin of the contact forces on the slave, shape (3,). Collective."""
        return self._solved()._resultants(self)[2]

    @property
    def master_moment(self) -> npt.NDArray[np.float64]:
        """Moment about the origin of the contact forces on the master, shape (3,). Collective."""
        return self._solved()._resultants(self)[3]
