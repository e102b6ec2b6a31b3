# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Interfaces between bodies: mesh tying and contact."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.common import Timer
from dolfinx.mesh import MeshTags

from . import agreement, arguments, cpp, memory, parts, sparse
from .coverage import MIN_COVERAGE
from .fields import Fields, spread

if TYPE_CHECKING:
    from .layout import Layout
    from .multipliers import Multipliers
    from .problem import ContactProblem

_SPACES = {
    "standard": cpp.MultiplierSpace.standard,
    "dual": cpp.MultiplierSpace.dual,
    "dual-linear": cpp.MultiplierSpace.dual_linear,
}
_INTEGRATIONS = {
    "segment": cpp.Integration.segment,
    "element": cpp.Integration.element,
}


#: Largest degree of quadrature: 256 points on each triangle, far beyond what any facet needs
MAX_DEGREE = 30


class Interface:
    """What tying and contact have in common; see :class:`Tie` and :class:`Contact`.

    Attributes:
        slave: Parts of the slave surface.
        master: Parts of the master surface.
    """

    #: Names of the fields, with their numbers of values at a node
    _columns = {"multiplier": 3, "traction": 3}

    #: Slave facets that no master is near of are left out
    _leave_distant = False

    def __init__(
        self,
        V: fem.FunctionSpace | Sequence[fem.FunctionSpace] | None = None,
        facet_tags: MeshTags | Sequence[MeshTags] | None = None,
        *,
        slave: int | Sequence[tuple],
        master: int | Sequence[tuple],
        multiplier: str = "dual",
        integration: str = "segment",
        quadrature_degree: int | None = None,
        search_distance: float | None = None,
        max_angle: float = 70.0,
        min_coverage: float = MIN_COVERAGE,
    ):
        if type(self) is Interface:
            raise ValueError("An Interface alone has no condition: make a Tie or a Contact.")
        with agreement.alike(parts.communicator(V, slave, master)) as same:
            self.slave = parts.read(V, facet_tags, 0, slave, "slave")
            self.master = parts.read(V, facet_tags, 1, master, "master")
            for a in self.slave:
                for b in self.master:
                    if a.tag == b.tag and a.tags is b.tags:
                        raise ValueError(
                            f"Slave and master are the same surface (facet tag {a.tag}): give the "
                            "two sides of the interface different tags."
                        )
            self._space = _SPACES[arguments.choice("multiplier", multiplier, _SPACES)]
            self._integration = _INTEGRATIONS[
                arguments.choice("integration", integration, _INTEGRATIONS)
            ]
            if quadrature_degree is not None:
                arguments.whole("quadrature_degree", quadrature_degree, 1, MAX_DEGREE)
            arguments.positive("search_distance", search_distance, "a length")
            max_angle = arguments.number("max_angle", max_angle)
            if not 0 < max_angle < 90:
                raise ValueError(f"max_angle is {max_angle} degrees, but must be between 0 and 90.")
            min_coverage = arguments.number("min_coverage", min_coverage)
            if not 0 <= min_coverage < 1:
                raise ValueError(f"min_coverage is {min_coverage}, but must be from 0 to below 1.")
            same["slave"] = [p.tag for p in self.slave]
            same["master"] = [p.tag for p in self.master]
            same["multiplier"], same["integration"] = multiplier, integration
            same["quadrature_degree"] = quadrature_degree
            same["search_distance"] = search_distance
            same["max_angle"], same["min_coverage"] = max_angle, min_coverage
        self._comm = self.slave[0].V.mesh.comm
        self._multiplier_space = multiplier
        self._degree = quadrature_degree
        self._max_angle, self._min_coverage = max_angle, min_coverage
        #: A warning of what is left out has been given
        self._warned = False
        self._search_distance = search_distance
        self._problem: ContactProblem | None = None
        #: Reference positions of local nodes where they differ from the mesh's (relocated ties)
        self._integration_positions: tuple[Any, Any] | None = None

    @property
    def multiplier_space(self) -> str:
        """The multiplier space that was chosen."""
        return self._multiplier_space

    # -- Set-up, called by the problem --------------------------------------

    @property
    def is_dual(self) -> bool:
        """Multipliers are dual, and can be condensed."""
        return self.multiplier_space != "standard"

    def _create_surfaces(self, layout: Layout) -> None:
        self._layout = layout
        self._surface_slave = self._surface(self.slave, "slave")
        self._surface_master = self._surface(self.master, "master")
        self.num_nodes = self._surface_slave.num_nodes
        self.num_owned = self._surface_slave.num_owned

    def _surface(self, pieces: list[parts.Part], side: str) -> cpp.Surface:
        bodies = [self._layout.body(p.V) for p in pieces]
        return cpp.create_surface(
            [p.V._cpp_object for p in pieces],
            [p.tags._cpp_object for p in pieces],
            [p.tag for p in pieces],
            side,
            [self._layout.blocks[b] for b in bodies],
            [self._layout.local_start(b) for b in bodies],
        )

    def _create_data(
        self,
        multipliers: npt.NDArray[np.int64],
        carries: npt.NDArray[np.int8],
        fixed: npt.NDArray[np.int8],
    ) -> None:
        """Make the interface's data; arrays are over local slave nodes, ghosts up to date."""
        self._multipliers = multipliers
        self._fixed = fixed
        #: Nodes that may carry a multiplier, before any is dropped for want of a master
        self._candidates = carries.copy()
        self._data = cpp.Interface(
            self._surface_slave,
            self._surface_master,
            self._space,
            self._integration,
            self._degree,
            self._search_distance,
            multipliers,
            carries,
            fixed,
            self._leave_distant,
            self._max_angle,
        )
        self._update_weights()

    def _update_weights(self) -> None:
        #: Area that belongs to each local slave node [length²]
        self._weights = np.asarray(cpp.nodal_weights(self._data, self._surface_slave.X))

    def _set_positive(self, positive: npt.NDArray[np.int8]) -> None:
        """Choose at which local slave nodes the basis is to be positive. Collective."""
        self._data.positive = positive
        self._update_weights()

    def _check_orphans(self, nodal: dict) -> None:
        comm = self._layout.comm
        orphans = comm.allgather((nodal["num_orphans"], nodal["orphan"]))
        for number, x in orphans:
            if number > 0:
                raise RuntimeError(
                    f"Slave facet at ({x[0]:.6g}, {x[1]:.6g}, {x[2]:.6g}) has no node that can "
                    "carry a multiplier: all its nodes belong to other interfaces or to Dirichlet "
                    "boundaries. Refine the slave surface there, or swap slave and master."
                )

    def _check_met(self, nodal: dict) -> None:
        comm = self._layout.comm
        if comm.allreduce(int(nodal["num_covered"])) > 0:
            return
        boxes = []
        for surface in (self._surface_slave, self._surface_master):
            X = surface.X[: surface.num_owned]
            low = np.empty(3)
            high = np.empty(3)
            comm.Allreduce(X.min(axis=0, initial=np.inf), low, op=MPI.MIN)
            comm.Allreduce(X.max(axis=0, initial=-np.inf), high, op=MPI.MAX)
            boxes.append(
                f"{np.array2string(low, precision=4)} to {np.array2string(high, precision=4)}"
            )
        raise RuntimeError(
            f"No slave facet meets a master facet: slave {self.slave[0].tag} spans {boxes[0]}, "
            f"master {self.master[0].tag} {boxes[1]}. Check the tags, that the surfaces face each "
            "other, and search_distance."
        )

    def _drop_uncovered(self, nodal: dict) -> bool:
        """Let only nodes carry a multiplier that a master covers enough.

        Returns:
            True where that changes the set of multipliers on any rank. Collective.
        """
        covered = nodal["coverage"] > self._min_coverage * self._weights
        carries = (self._candidates.astype(bool) & covered).astype(np.int8)
        self._data.idle = self._find_idle(nodal, covered)
        self._drop_repeated(nodal, carries)
        changed = bool(np.any(carries != self._data.carries))
        changed = self._layout.comm.allreduce(changed, op=MPI.LOR)
        if changed:
            self._data.carries = carries
        return changed

    def _find_idle(self, nodal: dict, covered: npt.NDArray[np.bool_]) -> npt.NDArray[np.int8]:
        """Flag nodes that nothing acts at: their neighbours do not take their share.

        Args:
            nodal: Nodal integrals.
            covered: Flags of local nodes that a master covers enough to carry a multiplier.
        """
        return np.zeros(self.num_nodes, dtype=np.int8)

    def _drop_repeated(self, nodal: dict, carries: npt.NDArray[np.int8]) -> None:
        """Let no two nodes at one place carry the same condition. Collective.

        Args:
            nodal: Nodal integrals.
            carries: Flags of local nodes, changed in place.
        """

    def _positions(self, u_all: npt.NDArray[np.float64] | None) -> tuple[Any, Any]:
        if u_all is None and self._integration_positions is not None:
            return self._integration_positions
        if u_all is None:
            return self._surface_slave.X, self._surface_master.X
        return (
            cpp.current_positions(self._surface_slave, u_all),
            cpp.current_positions(self._surface_master, u_all),
        )

    def _configure(self, u_all: npt.NDArray[np.float64] | None) -> cpp.Configuration:
        """Positions, normals and candidates for ``u_all`` (None: reference). Collective."""
        with Timer("~mortar: search"):
            return cpp.configure(self._data, *self._positions(u_all))

    # -- Nodal values and fields --------------------------------------------

    @property
    def num_multiplier_nodes(self) -> int:
        """Number of slave nodes, on all ranks, that carry a multiplier. Collective."""
        comm = self._owner().comm
        return comm.allreduce(int(np.sum(self._data.carries[: self.num_owned] != 0)))

    def _z(self) -> npt.NDArray[np.float64]:
        """Multipliers at the local slave nodes, shape (n, 3). Collective."""
        problem = self._owner()
        return problem._coupling.multipliers.local(problem._z, self)

    def _owner(self) -> ContactProblem:
        if self._problem is None:
            raise RuntimeError(
                "The interface is not part of a ContactProblem yet: name it in "
                "ContactProblem(..., interfaces=[...]) first."
            )
        self._problem._check_alive()
        return self._problem

    def _create_fields(self) -> None:
        bodies = sorted({self._layout.body(p.V) for p in self.slave})
        self._fields = Fields(self._layout, self._surface_slave, bodies, self._columns)

    def _field(self, name: str) -> Any:
        if self._problem is None:
            self._owner()
        return self._fields[name]

    def _set_field(
        self,
        name: str,
        values: npt.NDArray[np.float64],
        how: str,
        measure: npt.NDArray[np.float64] | None = None,
    ) -> None:
        """Set a field from values of nodes that carry a multiplier. Collective.

        Args:
            name: Name of the field.
            values: Values of the local slave nodes, shape (n, columns).
            how: See :func:`dolfinx_mortar.fields.combine`.
            measure: See :func:`dolfinx_mortar.fields.combine`.
        """
        values = spread(self._surface_slave, self._data.carries.astype(bool), values)
        self._fields.set(name, values[: self.num_owned], how, measure)

    def _update_fields(self) -> None:
        """Let the fields show the present state. Collective."""
        z = self._z()
        self._set_field("multiplier", z, "mean", self._shares())
        self._set_field("traction", -z, "mean", self._shares())

    def _shares(self) -> npt.NDArray[np.float64]:
        """Area that counts for the multiplier of each owned slave node."""
        return np.maximum(self._nodal["weight"][: self.num_owned], 0.0)

    @property
    def multiplier(self) -> fem.Function:
        """Nodal multipliers λ [traction], zero off the surface; λ = -t_c on the slave.

        With dual functions z_j is the average of λ around node j, weighted by Ñ_j. This and all
        other fields are functions on the slave's space, or on its scalar sister, lists of them
        where the slave surface is on several bodies. Each is the same object for ever, zero
        before the first solve, and shows the last accepted state.
        """
        return self._field("multiplier")

    @property
    def traction(self) -> fem.Function:
        """Contact traction t_c = -λ that acts on the slave body."""
        return self._field("traction")

    # -- Matrices -------------------------------------------------------------

    # Each access makes a new matrix, which is the caller's

    def _multipliers_of_owner(self) -> Multipliers:
        coupling = self._owner()._coupling
        memory.free_forgotten(coupling.comm)  # as earlier matrices
        return coupling.multipliers

    def _matrix(self, name: str) -> PETSc.Mat:
        """D or M. Collective."""
        A = self._multipliers_of_owner().z_by_u()
        cpp.integrate(self._data, self._configure(self._current()), **{name: A})
        A.assemble()
        return A

    def _current(self) -> npt.NDArray[np.float64] | None:
        """Displacements that the matrices belong to; None for the reference configuration."""
        return None

    @property
    def D(self) -> PETSc.Mat:
        """D_jk = ∫ Φ_j N_k (equation 3.5): multiplier dofs by displacement dofs. Collective."""
        return self._matrix("D")

    @property
    def M(self) -> PETSc.Mat:
        """M_jl = ∫ Φ_j N_l∘P (equation 3.6): multiplier dofs by displacement dofs. Collective."""
        return self._matrix("M")

    @property
    def T(self) -> PETSc.Mat:
        """Basis transformation (equations 4.5, 4.13): displacement by displacement dofs."""
        return self._multipliers_of_owner().transformation([self], inverse=False)

    def _inverse(self) -> PETSc.Mat:
        if self.multiplier_space != "dual":
            raise RuntimeError(
                "D has a sparse inverse with multiplier='dual' only: D⁻¹, P and constraints are "
                f"not available with {self.multiplier_space!r}."
            )
        return self._multipliers_of_owner().inverse(self)

    @property
    def T_inverse(self) -> PETSc.Mat:
        """Exact inverse of T (equations 4.6, 4.14)."""
        return self._multipliers_of_owner().transformation([self], inverse=True)

    @property
    def D_inverse(self) -> PETSc.Mat:
        """D⁻¹ = T D̃⁻¹, sparse: displacement dofs by multiplier dofs. Collective.

        Raises:
            RuntimeError: The multipliers are not ``"dual"``.
        """
        return self._inverse()

    @property
    def P(self) -> PETSc.Mat:
        """P = D⁻¹ M: displacement dofs of the slave nodes from those of the masters. Collective.

        Raises:
            RuntimeError: The multipliers are not ``"dual"``.
        """
        inverse, M = self._inverse(), self.M
        P = inverse.matMult(M)
        sparse.destroy(inverse, M)
        return P


class Tie(Interface):
    r"""Mesh tying, D u⁽¹⁾ = M u⁽²⁾ with D and M of the reference configuration.

    Args:
        V: Displacement space, or (space of the slave, space of the master).
        facet_tags: Facet tags of the mesh, or one for each of the two meshes.
        slave: Tag of the slave facets, which carry the multipliers; the finer side, or the one on
            the softer body. A list of ``(V, facet_tags, tag)`` makes a surface of several bodies.
        master: Tag of the master facets, or a list as for ``slave``.
        multiplier: ``"dual"`` (biorthogonal, condensed), ``"dual-linear"`` (the same with
            multipliers at corners only) or ``"standard"`` (needs a saddle point solver).
        integration: ``"segment"`` (exact on the overlap of facets) or ``"element"`` (points of
            the slave facets projected on masters: cheaper, not exact).
        quadrature_degree: Degree on each triangle of a segment, or on each slave facet.
        search_distance: Facets further apart [length] are not paired; by default the larger
            diameter of the two.
        max_angle: Facets whose normals are further than this [degrees] from opposing each other
            are not paired. On facets that are steeper, points of curved masters are far from
            where they should be. A warning names facets that lose more than 5 % of their area.
        min_coverage: A slave node carries a multiplier where masters cover more than this share
            of the surface around it (measured by its function, from 0 to 1). Nodes that are
            covered less, at the edge of a master, get large tractions that change much.

    The constraint is on displacements, so an initial gap between two discretised curved surfaces
    stays as it is and a rigid translation creates no stress. A rigid *rotation* of a curved tie
    does create (small) stress, as the gap does not turn with the bodies, unless the slave nodes
    are first moved onto the master with :func:`dolfinx_mortar.relocate`.
    """

    def constraints(self) -> list[tuple[int, npt.NDArray[np.int64], npt.NDArray[np.float64]]]:
        """The tie as master–slave constraints u_slave = Σ c_k u_k. Collective.

        Returns:
            For each slave dof of this rank ``(dof, master dofs, coefficients)``, with dofs of the
            coupled problem, ``3 * block + component``; in a problem with one body that is
            DOLFINx's global numbering. Masters are the dofs of the master surface, and slave
            nodes that carry no multiplier themselves.

        Raises:
            RuntimeError: The multipliers are not ``"dual"``.
        """
        multipliers, B = self._multipliers_of_owner(), self._owner()._coupling.B_ties
        assert B is not None
        return multipliers.constraints(self, B[1])
