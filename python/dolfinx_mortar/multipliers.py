# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Multipliers of all interfaces of a problem, and their mortar matrices."""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.common import Timer

from . import coverage, cpp, sparse
from .contact import Contact
from .interfaces import Interface, Tie
from .layout import Layout


def find_fixed_dofs(
    layout: Layout, prescribed: Sequence[npt.NDArray[np.int8]]
) -> npt.NDArray[np.int32]:
    """Owned displacement dofs (local) with a Dirichlet condition.

    Args:
        layout: Displacement dofs.
        prescribed: Flags of :meth:`Layout.prescribed`.
    """
    owned = [p[: 3 * n] for p, n in zip(prescribed, layout.num_owned)]
    return np.flatnonzero(np.concatenate(owned)).astype(np.int32)


class Multipliers:
    """Numbers of the multiplier dofs, the basis transformation, and B = [D, -M].

    Every slave node of every interface has three multiplier dofs; the part of a rank is
    ``[interface 0 owned nodes, interface 1 owned nodes, ...]``.

    Args:
        layout: Displacement dofs.
        interfaces: Interfaces.
        bcs: Dirichlet conditions.

    Attributes:
        ties, contacts: The interfaces by kind.
        size: Number of multiplier dofs of this rank.
        first: First multiplier dof of this rank.
        fixed_dofs: Local displacement dofs with a Dirichlet condition.
        T: Basis transformation of all interfaces (equations 4.5, 4.13), None where it is the
            identity.
        T_minus_one: T minus the identity, or None.
    """

    def __init__(
        self, layout: Layout, interfaces: Sequence[Interface], bcs: Sequence[fem.DirichletBC]
    ):
        self.layout, self.comm = layout, layout.comm
        self.interfaces = list(interfaces)
        self.ties = [i for i in self.interfaces if isinstance(i, Tie)]
        self.contacts = [i for i in self.interfaces if isinstance(i, Contact)]
        for i in self.interfaces:
            i._create_surfaces(layout)
        prescribed = layout.prescribed(bcs)
        self.fixed_dofs = find_fixed_dofs(layout, prescribed)
        self._number()
        self._assign(prescribed)
        self.T: PETSc.Mat | None = None
        self.T_minus_one: PETSc.Mat | None = None
        if self.interfaces:
            self.update_transformation()

    # -- Numbers --------------------------------------------------------------

    def _number(self) -> None:
        starts = np.cumsum([0, *(i.num_owned for i in self.interfaces)])
        self.size = 3 * int(starts[-1])
        self.first = self.comm.exscan(self.size) or 0
        #: First local multiplier node of each interface
        self._starts = {id(i): int(s) for i, s in zip(self.interfaces, starts)}

    def nodes(self, interface: Interface) -> slice:
        """Local multiplier nodes of an interface."""
        start = self._starts[id(interface)]
        return slice(start, start + interface.num_owned)

    def slice(self, interface: Interface) -> slice:
        """Local multiplier dofs of an interface's owned nodes."""
        nodes = self.nodes(interface)
        return slice(3 * nodes.start, 3 * nodes.stop)

    def own_dofs(self, interface: Interface) -> npt.NDArray[np.int32]:
        """Local displacement dofs of an interface's owned slave nodes."""
        blocks = interface._surface_slave.blocks[: interface.num_owned]
        blocks = blocks - self.layout.first_u // 3
        return (3 * blocks[:, None] + np.arange(3)).ravel().astype(np.int32)

    def local(self, z: npt.NDArray, interface: Interface) -> npt.NDArray[np.float64]:
        """Multipliers of the local slave nodes of an interface, shape (n, 3). Collective."""
        values = np.zeros((interface.num_nodes, 3))
        values[: interface.num_owned] = z[self.slice(interface)].reshape(-1, 3)
        cpp.scatter_forward(interface._surface_slave, values)
        return values

    def mask(self, interfaces: Sequence[Interface]) -> npt.NDArray[np.float64]:
        """One at the multiplier dofs of some interfaces, else zero."""
        values = np.zeros(self.size)
        for i in interfaces:
            values[self.slice(i)] = 1.0
        return values

    # -- Which nodes carry a multiplier ------------------------------------------

    def _assign(self, prescribed: list[npt.NDArray[np.int8]]) -> None:
        """Decide which slave nodes carry a multiplier.

        None at nodes that are slaves of two interfaces, slave here and master there, or fixed in
        every component: their functions are shared among their neighbours.
        """
        layout = self.layout
        total = sum(layout.num_local)
        uses = np.zeros(total, dtype=np.int32)
        masters = np.zeros(total, dtype=bool)
        for i in self.interfaces:
            uses[i._surface_slave.local_blocks[: i.num_owned]] += 1
            m = i._surface_master
            masters[m.local_blocks[: m.num_owned]] = True
        chained = any(
            np.any(masters[i._surface_slave.local_blocks[: i.num_owned]]) for i in self.interfaces
        )
        #: True where a node is slave here and master there
        self._chained = self.comm.allreduce(chained, op=MPI.LOR)
        #: True where a node is slave of several interfaces
        self._shared = self.comm.allreduce(bool(np.any(uses > 1)), op=MPI.LOR)
        self._check_spaces(uses > 1)
        flags = np.concatenate(prescribed).reshape(-1, 3)
        for i in self.interfaces:
            s = i._surface_slave
            fixed = np.ascontiguousarray(flags[s.local_blocks])
            cpp.scatter_forward(s, fixed)
            blocks = s.local_blocks[: i.num_owned]
            carries = np.zeros(i.num_nodes, dtype=np.int8)
            carries[: i.num_owned] = (
                (uses[blocks] == 1) & ~masters[blocks] & ~fixed[: i.num_owned].all(axis=1)
            )
            if i.multiplier_space != "dual":
                carries &= self._corner_flags(i)
            cpp.scatter_forward(s, carries)
            numbers = np.zeros(i.num_nodes, dtype=np.int64)
            numbers[: i.num_owned] = self.first // 3 + self.nodes(i).start + np.arange(i.num_owned)
            cpp.scatter_forward(s, numbers)
            i._create_data(numbers, carries, fixed)
        for c in self.contacts:
            c._check_candidates()
            c._check_normal()

    def _check_spaces(self, shared: npt.NDArray[np.bool_]) -> None:
        """Refuse different transformations of the same nodes. Collective.

        Raises:
            ValueError: Interfaces with different multiplier spaces share slave nodes.
        """
        touching = {
            i.multiplier_space
            for i in self.interfaces
            if np.any(shared[i._surface_slave.local_blocks[: i.num_owned]])
        }
        touching = set().union(*self.comm.allgather(touching))
        if len(touching) > 1:
            raise ValueError(
                "Interfaces that share slave nodes must have the same multiplier space, not "
                f"{' and '.join(sorted(touching))}."
            )

    def share_positive(self, interfaces: Sequence[Interface]) -> list[Interface]:
        """Let interfaces agree on the basis at slave nodes they share. Collective.

        Args:
            interfaces: Interfaces, all of which have a configuration.

        Returns:
            Interfaces whose basis has changed.
        """
        if not self._shared:
            return []
        flags = np.zeros(sum(self.layout.num_local), dtype=np.int8)
        for i in interfaces:
            flags[i._surface_slave.local_blocks[: i.num_owned]] |= i._data.positive[: i.num_owned]
        changed = []
        for i in interfaces:
            positive = np.zeros(i.num_nodes, dtype=np.int8)
            positive[: i.num_owned] = flags[i._surface_slave.local_blocks[: i.num_owned]]
            cpp.scatter_forward(i._surface_slave, positive)
            if self.comm.allreduce(bool(np.any(positive != i._data.positive)), op=MPI.LOR):
                i._set_positive(positive)
                i._nodal = cpp.integrate(i._data, i._configuration)
                changed.append(i)
        return changed

    def _corner_flags(self, interface: Interface) -> npt.NDArray[np.int8]:
        """Flags of local slave nodes that the multiplier space has a function at."""
        s = interface._surface_slave
        flags = np.zeros(interface.num_nodes, dtype=np.int32)
        offsets, nodes = s.offsets, s.nodes
        for type_ in np.unique(s.types):
            facets = np.flatnonzero(s.types == type_)
            n = cpp.num_multipliers(interface._space, cpp.FacetType(int(type_)))
            flags[nodes[offsets[facets][:, None] + np.arange(n)]] = 1
        cpp.scatter_reverse_add(s, flags)
        cpp.scatter_forward(s, flags)
        return (flags > 0).astype(np.int8)

    def choose(self, interface: Interface, u_all: npt.NDArray | None) -> bool:
        """Adapt multipliers to what masters cover in a configuration. Collective.

        Args:
            interface: Interface.
            u_all: Local displacements of all bodies; None for the reference configuration.

        Returns:
            True where that changes the basis transformation.
        """
        i = interface
        i._configuration = i._configure(u_all)
        i._data.carries = i._candidates
        i._nodal = cpp.integrate(i._data, i._configuration)
        positive = np.asarray(cpp.flag_positive(i._data, i._nodal["beyond"]))
        changed = self.comm.allreduce(bool(np.any(positive != i._data.positive)), op=MPI.LOR)
        if changed:
            i._set_positive(positive)
            i._nodal = cpp.integrate(i._data, i._configuration)
        coverage.report_lost(i)
        return changed

    def tied(self, tie: Tie) -> npt.NDArray[np.bool_]:
        """Flags of the multiplier dofs of a tie whose constraint is that of the tie."""
        n = tie.num_owned
        carries = tie._data.carries[:n].astype(bool)
        return (carries[:, None] & (tie._fixed[:n] == 0)).ravel()

    # -- Basis transformation -----------------------------------------------------

    def _slave_rows(
        self, interfaces: Sequence[Interface], inverse: bool
    ) -> tuple[PETSc.Mat, npt.NDArray[np.bool_]]:
        """Rows of T, or of its inverse, of some interfaces' slave dofs, and flags of these."""
        n = self.layout.size_u
        T, slaves = sparse.empty(self.comm, n, n), np.zeros(n, dtype=bool)
        for i in interfaces:
            slaves[self.own_dofs(i)] = True
            cpp.insert_transformation(i._data, inverse, T)
        T.assemble()
        return T, slaves

    def _add_identity(self, A: PETSc.Mat, rows: npt.NDArray[np.bool_], factor: float) -> None:
        i, n = np.flatnonzero(rows), self.layout.size_u
        identity = sparse.selection(self.comm, n, n, i, i)
        A.axpy(factor, identity)
        identity.destroy()

    def transformation(self, interfaces: Sequence[Interface], inverse: bool) -> PETSc.Mat:
        """T, or its inverse, of some interfaces; the identity off their slave nodes."""
        T, slaves = self._slave_rows(interfaces, inverse)
        self._add_identity(T, ~slaves, 1.0)
        return T

    def update_transformation(self) -> None:
        """Form T anew, after a change of interfaces' multipliers. Collective."""
        sparse.destroy(self.T, self.T_minus_one)
        # Products with T - I are to cost no more than its few entries
        T_minus_one, slaves = self._slave_rows(self.interfaces, False)
        self._add_identity(T_minus_one, slaves, -1.0)
        if T_minus_one.norm() == 0:
            T_minus_one.destroy()
            self.T = self.T_minus_one = None
        else:
            self.T, self.T_minus_one = T_minus_one.copy(), T_minus_one
            self._add_identity(self.T, np.ones(self.layout.size_u, dtype=bool), 1.0)

    def destroy(self) -> None:
        """Free all matrices. Collective."""
        sparse.destroy(self.T, self.T_minus_one)
        self.T = self.T_minus_one = None

    # -- Mortar matrices -----------------------------------------------------------

    def z_by_u(self) -> PETSc.Mat:
        """Empty matrix of multiplier dofs by displacement dofs."""
        return sparse.empty(self.comm, self.size, self.layout.size_u)

    def empty_B(self) -> tuple[PETSc.Mat, PETSc.Mat]:
        """Empty B, and B̃; one matrix serves as both where T is the identity."""
        B = self.z_by_u()
        return B, B if self.T is None else self.z_by_u()

    def assemble(self, interfaces: Sequence[Interface]) -> tuple[PETSc.Mat, PETSc.Mat]:
        """Integrate interfaces in their configurations: B and B̃ = B T. Collective."""
        B, B_tilde = self.empty_B()
        # Masters of one interface may be slave nodes of another
        M = self.z_by_u() if self._chained and B_tilde is not B else None
        for i in interfaces:
            with Timer("~mortar: integrate"):
                i._nodal = cpp.integrate(
                    i._data, i._configuration, B=B, B_tilde=None if B_tilde is B else B_tilde, M=M
                )
        B.assemble()
        B_tilde.assemble()
        if M is not None:
            M.assemble()
            MT = M.matMult(self.T)
            B_tilde.axpy(1.0, M)
            B_tilde.axpy(-1.0, MT)
            sparse.destroy(M, MT)
        return B, B_tilde

    def integrate_ties(self) -> tuple[PETSc.Mat, PETSc.Mat] | None:
        """Decide on the multipliers of ties, and assemble their B and B̃. Collective.

        Raises:
            RuntimeError: A tie's surfaces do not meet, or some of its facets have no multiplier.
        """
        if not self.ties:
            return None
        for tie in self.ties:
            self.choose(tie, None)
        self.share_positive(self.ties)
        for tie in self.ties:
            tie._check_orphans(tie._nodal)
            tie._check_met(tie._nodal)
            tie._drop_uncovered(tie._nodal)
        self.update_transformation()
        return self.assemble(self.ties)

    def inverse(self, interface: Interface) -> PETSc.Mat:
        """D⁻¹ = T D̃⁻¹ of an interface with dual multipliers. Collective.

        Raises:
            RuntimeError: A node on an edge carries a multiplier for each of several patches.
        """
        n = interface.num_owned
        carries = np.repeat(interface._data.carries[:n].astype(bool), 3)
        diagonal = np.repeat(interface._nodal["diagonal"][:n], 3)[carries]
        rows = self.own_dofs(interface)[carries]
        if sparse.any_rank(self.comm, len(np.unique(rows)) < len(rows)):
            raise RuntimeError(
                "D has no inverse where slave nodes on an edge carry one multiplier for each of "
                "the patches that meet there: D⁻¹ and P are not available. Tag one smooth side of "
                "the edge, or average normals over edges with feature_angle=180."
            )
        columns = self.slice(interface).start + np.flatnonzero(carries)
        order = np.argsort(rows)
        E = sparse.selection(
            self.comm,
            self.layout.size_u,
            self.size,
            rows[order],
            columns[order],
            1.0 / diagonal[order],
        )
        if self.T is None:
            return E
        T = self.transformation([interface], False)
        D_inverse = T.matMult(E)
        sparse.destroy(T, E)
        return D_inverse

    def constraints(self, tie: Tie, B_tilde: PETSc.Mat):
        """See :meth:`Tie.constraints`.

        Args:
            tie: Tie with dual multipliers.
            B_tilde: B̃ of the ties.
        """
        # Rows T (I_R - E D̃⁻¹ B̃_R) T⁻¹ of the slave dofs
        n_u = self.layout.size_u
        T = self.transformation([tie], False)
        T_inverse = self.transformation([tie], True)
        own = self.own_dofs(tie)[self.tied(tie)]
        keep = np.ones(n_u)
        keep[own] = 0.0
        B = sparse.scale_rows(B_tilde.copy(), self.mask([tie]))
        D_inverse = tie._inverse()
        DB = D_inverse.matMult(sparse.scale_columns(B, keep))
        rows = np.flatnonzero(keep)
        kept = sparse.selection(self.comm, n_u, n_u, rows, rows)
        R = T.matMult(kept)
        R.axpy(-1.0, DB)
        C = R.matMult(T_inverse)
        sparse.destroy(T, T_inverse, B, D_inverse, DB, kept, R)
        first = self.layout.first_u
        out = []
        for dof in sorted(own):
            columns, values = C.getRow(first + dof)
            used = np.abs(values) > 1e-14 * np.max(np.abs(values), initial=0.0)
            out.append((int(first + dof), columns[used].astype(np.int64), values[used]))
        C.destroy()
        return out
