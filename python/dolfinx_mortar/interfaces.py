# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Interfaces between bodies: what a user says of them, and where their results are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import MeshTags

from . import agreement, arguments, cpp, memory, parts
from .fields import Fields
from .tools import RigidTool

if TYPE_CHECKING:
    from .problem import ContactProblem

_SPACES = {
    "standard": cpp.MultiplierSpace.standard,
    "dual": cpp.MultiplierSpace.dual,
    "dual-linear": cpp.MultiplierSpace.dual_linear,
    "dual-reproducing": cpp.MultiplierSpace.dual_reproducing,
}
_INTEGRATIONS = {
    "segment": cpp.Integration.segment,
    "element": cpp.Integration.element,
}

#: Largest degree of quadrature: 256 points on each triangle, far beyond what any facet needs
MAX_DEGREE = 30

#: Share of its surroundings that must be covered for a slave node to carry a multiplier, by
#: default. A block that slides with friction over a coarser slave loses no step with 0.15 and 0.2
#: and fails with 0.02, where nodes at its edges carry five times the pressure of the others; with
#: 0.3 one node is left under it at times.
MIN_COVERAGE = 0.15


class Constraints(NamedTuple):
    """Constraints u_slave = Σ c u_master, as ``add_constraint`` of dolfinx_mpc takes them.

    Slaves are local dofs, ascending; masters are global dofs with a coefficient and an owning
    rank each. Those of ``slaves[i]`` are ``masters[offsets[i]:offsets[i + 1]]``.
    """

    slaves: npt.NDArray[np.int32]
    masters: npt.NDArray[np.int64]
    coefficients: npt.NDArray[np.float64]
    owners: npt.NDArray[np.int32]
    offsets: npt.NDArray[np.int32]


class Interface:
    """What tying and contact have in common; see :class:`Tie` and :class:`Contact`.

    An interface is a description. It can be a part of one :class:`ContactProblem`, and shows that
    problem's results.

    Attributes:
        slave: Parts of the slave surface.
        master: Parts of the master surface, none on an analytic tool.
        tool: Rigid tool that the master surface is on, or None.
        comm: Communicator of the meshes.
        problem: The problem it is a part of, or None.
    """

    #: Names of the fields, with their numbers of values at a node
    columns: ClassVar[Mapping[str, int]] = {
        "multiplier": 3,
        "traction": 3,
        "recovered_traction": 3,
    }

    def __init__(
        self,
        V: fem.FunctionSpace | Sequence[fem.FunctionSpace] | None = None,
        facet_tags: MeshTags | Sequence[MeshTags] | None = None,
        *,
        slave: int | Sequence[tuple],
        master: int | Sequence[tuple] | RigidTool,
        multiplier: str | None = None,
        integration: str = "segment",
        quadrature_degree: int | None = None,
        search_distance: float | None = None,
        max_angle: float = 70.0,
        min_coverage: float = MIN_COVERAGE,
    ):
        if type(self) is Interface:
            raise ValueError("An Interface alone has no condition: make a Tie or a Contact.")
        self.tool = master if isinstance(master, RigidTool) else None
        tool_parts = list(self.tool.parts) if self.tool else []
        with agreement.alike(parts.communicator(V, slave, master, tool_parts)) as same:
            self.slave = parts.read(V, facet_tags, 0, slave, "slave")
            if self.tool is None:
                self.master = parts.read(V, facet_tags, 1, master, "master")
            else:
                self.master, same["master"] = tool_parts, self.tool.numbers()
            parts.check_sides(self.slave, self.master)
            if multiplier is not None:
                arguments.choice("multiplier", multiplier, _SPACES)
            rule = _INTEGRATIONS[arguments.choice("integration", integration, _INTEGRATIONS)]
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
            same["tags of the master"] = [p.tag for p in self.master]
            same["multiplier"], same["integration"] = multiplier, integration
            same["quadrature_degree"] = quadrature_degree
            same["search_distance"] = search_distance
            same["max_angle"], same["min_coverage"] = max_angle, min_coverage
        self.comm = self.slave[0].V.mesh.comm
        self.problem: ContactProblem | None = None
        self._space = None if multiplier is None else _SPACES[multiplier]
        self._min_coverage = min_coverage
        self._options = cpp.IntegrationOptions(
            integration=rule,
            degree=quadrature_degree,
            max_angle=max_angle,
            distance=search_distance,
        )

    @property
    def multiplier_space(self) -> str:
        """The multiplier space: what was asked for, or in a problem the default there."""
        space = self.data.options.space if self.problem else self._space
        return next((name for name, value in _SPACES.items() if value == space), "default")

    @property
    def min_coverage(self) -> float:
        """Share of its surroundings that must be covered for a node to carry a multiplier."""
        return self._min_coverage

    # -- For the problem ------------------------------------------------------

    def describe(self) -> cpp.InterfaceOptions:
        """The interface as the C++ library takes it."""
        return cpp.InterfaceOptions(
            [(p.V._cpp_object, p.tags._cpp_object, p.tag) for p in self.slave],
            [(p.V._cpp_object, p.tags._cpp_object, p.tag) for p in self.master],
            self._space,
            self._options,
            self._min_coverage,
            None if self.tool is None else self.tool.describe(),
        )

    def present_values(self) -> dict[str, Any]:
        """What may be changed between solves, to be the same on all ranks."""
        return {} if self.tool is None else self.tool.present_values()

    def attach(self, problem: ContactProblem, index: int) -> None:
        """Become a part of a problem. Collective.

        Args:
            problem: Problem.
            index: Number of this interface in it.
        """
        self.problem, self._index = problem, index
        if self.tool is not None:
            self.tool.attach(self)
        bodies = sorted({problem.body(p.V) for p in self.slave})
        spaces = [problem.spaces[b] for b in bodies]
        self._bodies = bodies
        suffix = f"_{self._index + 1}" if self._index > 0 else ""
        self._fields = Fields(spaces, bodies, problem.coupling.layout, self.columns, suffix)

    def update_fields(self) -> None:
        """Let the fields show the last accepted state. Collective."""
        self._fields.update(self._cpp.results(self._index))
        if self.tool is not None:
            self.tool.update(self._cpp)

    # -- What follows from the state -------------------------------------------

    def _owner(self) -> ContactProblem:
        if self.problem is None:
            raise RuntimeError(
                "The interface is not part of a ContactProblem yet: name it in "
                "ContactProblem(..., interfaces=[...]) first."
            )
        return self.problem

    @property
    def _cpp(self) -> cpp.ContactProblem:
        return self._owner()._cpp_object

    @property
    def data(self) -> cpp.Interface:
        """Surfaces and options, as the C++ library has them."""
        return self._owner().coupling.interfaces[self._index].data

    @property
    def first_node(self) -> int:
        """First multiplier node of this rank in the vectors of the problem."""
        return self._owner().coupling.interfaces[self._index].first_node

    @property
    def state(self) -> cpp.InterfaceState:
        """What the interface remembers between solves; a copy."""
        return self._cpp.state.interfaces[self._index]

    @property
    def evaluation(self) -> cpp.InterfaceEvaluation:
        """Gaps, motions, geometry and nodal integrals of the last accepted state; a view.

        Raises:
            RuntimeError: There is no solution yet.
        """
        evaluation = self._cpp.evaluation
        if evaluation is None:
            raise RuntimeError(
                "There is no solution yet: call solve() of the ContactProblem first."
            )
        return evaluation.interfaces[self._index]

    @property
    def weights(self) -> npt.NDArray[np.float64]:
        """Area that belongs to each local slave node [length²]."""
        return np.array(self._cpp.step.weights[self._index])

    def slave_dofs(self) -> npt.NDArray[np.int32]:
        """Owned slave nodes among the local dofs of the slave bodies, body after body."""
        layout, slave = self._owner().coupling.layout, self.data.slave
        blocks = np.array(slave.local_blocks[: slave.num_owned])
        dofs, at = np.empty_like(blocks), 0
        for body in self._bodies:
            start, size = layout.local_start(body), layout.num_local[body]
            mine = (blocks >= start) & (blocks < start + size)
            dofs[mine] = blocks[mine] - start + at
            at += size
        return dofs

    @property
    def num_multiplier_nodes(self) -> int:
        """Number of slave nodes, on all ranks, that carry a multiplier. Collective."""
        return self._cpp.num_multiplier_nodes(self._index)

    def _field(self, name: str) -> Any:
        if self.problem is None:
            self._owner()
        return self._fields[name]

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

    @property
    def recovered_traction(self) -> fem.Function:
        """The traction as a continuous field of first order, with the same resultant.

        At corners the average ∫ψ_c t_c / ∫ψ_c with their (bi)linear functions ψ_c, whatever the
        multiplier space, linear between them: smoother than nodal values, which belong to
        functions of different shapes at corners and edges.
        """
        return self._field("recovered_traction")

    @property
    def facet_multipliers(self) -> npt.NDArray[np.float64]:
        """λ_h itself at the nodes of each slave facet of this rank, shape (nodes, 3). Collective.

        In the order of ``data.slave.nodes``: facet f has the rows from ``data.slave.offsets[f]``
        to ``offsets[f + 1]``, and λ_h = Σ N_k λ_h(x_k) in between, where masters cover it. Dual
        functions jump from facet to facet and change their sign, and so does λ_h.

        Raises:
            RuntimeError: There is no solution yet.
        """
        return self._cpp.facet_multipliers(self._index)

    def nodal_forces(self) -> fem.Function | list[fem.Function]:
        """Forces of the interface at the nodes of all bodies, as the displacement. Collective.

        -Dᵀz on the slave and Mᵀz on the master, in balance: what external forces at these nodes
        would do. New functions, which later solves do not change.

        Raises:
            RuntimeError: There is no solution yet.
        """
        owner = self._owner()
        return owner.as_functions(self._cpp.nodal_forces(self._index), "contact_force")

    def resultants(self) -> cpp.Resultants:
        """Forces and moments about the origin, on slave and master. Collective.

        Raises:
            RuntimeError: There is no solution yet.
        """
        self.evaluation  # noqa: B018 (an error where there is none)
        return self._cpp.resultants(self._index)

    def tool_point(self) -> npt.NDArray[np.float64]:
        """Where the reference point of the tool was put by the last accepted step. Collective."""
        return np.array(self._cpp.tool_point(self._index))

    # -- Matrices: each access makes a new one, which is the caller's ---------

    def _maker(self) -> cpp.ContactProblem:
        memory.free_forgotten(self._owner().comm)  # as earlier matrices
        return self._cpp

    @property
    def D(self) -> PETSc.Mat:
        """D_jk = ∫ Φ_j N_k (equation 3.5): multiplier dofs by displacement dofs. Collective."""
        return self._maker().D(self._index)

    @property
    def M(self) -> PETSc.Mat:
        """M_jl = ∫ Φ_j N_l∘P (equation 3.6): multiplier dofs by displacement dofs. Collective."""
        return self._maker().M(self._index)

    @property
    def T(self) -> PETSc.Mat:
        """Basis transformation (equations 4.5, 4.13): displacement by displacement dofs."""
        return self._maker().transformation(self._index, False)

    @property
    def T_inverse(self) -> PETSc.Mat:
        """Exact inverse of T (equations 4.6, 4.14)."""
        return self._maker().transformation(self._index, True)

    @property
    def D_inverse(self) -> PETSc.Mat:
        """D⁻¹ = T D̃⁻¹, sparse: displacement dofs by multiplier dofs. Collective.

        Raises:
            RuntimeError: Multipliers are not dual, or at corners only (``multiplier="dual"`` has
                them at all nodes).
        """
        return self._maker().inverse(self._index)

    @property
    def P(self) -> PETSc.Mat:
        """P = D⁻¹ M: displacement dofs of the slave nodes from those of the masters. Collective.

        Raises:
            RuntimeError: Multipliers are not dual, or at corners only (``multiplier="dual"`` has
                them at all nodes).
        """
        return self._maker().projection(self._index)


class Tie(Interface):
    r"""Mesh tying, D u⁽¹⁾ = M u⁽²⁾ with D and M of the reference configuration.

    Args:
        V: Displacement space, or (space of the slave, space of the master).
        facet_tags: Facet tags of the mesh, or one for each of the two meshes.
        slave: Tag of the slave facets, which carry the multipliers; the finer side, or the one on
            the softer body. A list of ``(V, facet_tags, tag)`` makes a surface of several bodies.
        master: Tag of the master facets, a list as for ``slave``, or a rigid tool (see
            :class:`RigidTool`).
        multiplier: ``"dual-reproducing"`` (default of ties: at the corners of tri6 and quad8,
            reproduces linear tractions, condensed; elsewhere ``"dual"``), ``"dual-linear"``
            (default of contacts of tri6 slaves on curved masters: at corners, condensed),
            ``"dual"`` (default of other contacts: at all nodes, condensed) or ``"standard"``
            (needs a saddle point solver). Interfaces that share slave nodes have one space: where
            none is given, that of contacts.
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

    #: Positions of local slave and master nodes to integrate at, where a relocation has moved them
    positions: tuple[npt.NDArray, npt.NDArray] | None = None

    def describe(self) -> cpp.InterfaceOptions:
        """See :meth:`Interface.describe`."""
        options = super().describe()
        if self.positions is not None:
            options.set_positions(*self.positions)
        return options

    def constraints(self) -> Constraints:
        """The tie as master–slave constraints u_slave = Σ c u_master. Collective.

        Returns:
            What ``add_constraint`` of dolfinx_mpc takes. Dofs are those of the coupled problem,
            ``3 * block + component``; in a problem with one body that is DOLFINx's numbering.
            Masters are the dofs of the master surface, and slave nodes that carry no multiplier
            themselves.

        Raises:
            RuntimeError: Multipliers are not dual, or at corners only (``multiplier="dual"`` has
                them at all nodes).
        """
        return Constraints(*self._maker().constraints(self._index))
