# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Values and derivatives of all interfaces of a problem, as vectors and matrices."""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.common import Timer

from . import cpp
from .condensation import NewtonSystem
from .contact import OPEN, SLIP, STICK, Contact
from .interfaces import Interface, Tie
from .layout import Layout

# What the fields of a contact are made of
_STATE = (
    "_total_slip",
    "_dissipation",
    "_configuration",
    "_nodal",
    "_law",
    "_gap_weighted",
    "_scale",
)


class Coupling:
    """Interfaces of a problem with their multipliers.

    Every slave node of every interface has three multiplier dofs; the part of a rank is
    ``[interface 0 owned nodes, interface 1 owned nodes, ...]``.

    Args:
        layout: Displacement dofs.
        interfaces: Interfaces.
        bcs: Dirichlet conditions.
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
        #: Local displacement dofs with a Dirichlet condition
        self.fixed_dofs = np.flatnonzero(
            np.concatenate([p[: 3 * n] for p, n in zip(prescribed, layout.num_owned)])
        ).astype(np.int32)
        self._number()
        self._assign(prescribed)

        self._reference = layout.positions()
        self._B = self._B_tilde = None
        self._B_old: PETSc.Mat | None = None
        self._history: list[npt.NDArray[np.int8]] = []
        self._accepted: tuple[npt.NDArray, npt.NDArray] | None = None
        self._T = self._T_minus_one = None
        if self.interfaces:
            self._update_transformation()
        self._integrate_ties()

    # -- Set-up ---------------------------------------------------------------

    @property
    def has_contact(self) -> bool:
        """Inequality constraints are present."""
        return len(self.contacts) > 0

    def _number(self) -> None:
        owned = [i.num_owned for i in self.interfaces]
        starts = np.cumsum([0, *owned])
        self.size_z = 3 * int(starts[-1])
        first = self.comm.exscan(int(starts[-1])) or 0
        self._first_multiplier = first
        #: First local multiplier of each interface
        self._starts = {id(i): int(s) for i, s in zip(self.interfaces, starts)}
        self._multipliers = {}
        for i, s in zip(self.interfaces, starts):
            numbers = np.zeros(i.num_nodes, dtype=np.int64)
            numbers[: i.num_owned] = first + s + np.arange(i.num_owned)
            cpp.scatter_forward(i._surface_slave, numbers)
            self._multipliers[id(i)] = numbers

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
            i._create_data(self._multipliers[id(i)], carries, fixed)

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

    def create_matrix(self, rows: int, columns: int) -> PETSc.Mat:
        """Empty AIJ matrix with local sizes (rows, columns), to be filled with any pattern."""
        A = PETSc.Mat().create(self.comm)
        A.setSizes(((rows, None), (columns, None)))
        A.setType("aij")
        A.setUp()
        return A

    def transformation(self, interfaces: Sequence[Interface], inverse: bool) -> PETSc.Mat:
        """T, or its inverse, of some interfaces; the identity off their slave nodes."""
        n = self.layout.size_u
        T = self.create_matrix(n, n)
        first = T.getOwnershipRange()[0]
        slaves = np.zeros(n, dtype=bool)
        for i in interfaces:
            blocks = i._surface_slave.blocks[: i.num_owned] - first // 3
            slaves[(3 * blocks[:, None] + np.arange(3)).ravel()] = True
        for row in np.flatnonzero(~slaves):
            T.setValue(first + row, first + row, 1.0)
        for i in interfaces:
            cpp.insert_transformation(i._data, inverse, T)
        T.assemble()
        return T

    def _is_identity(self, T: PETSc.Mat) -> bool:
        d = T.getDiagonal()
        d.array[:] -= 1.0
        entries = T.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"]
        return d.norm() == 0 and entries == T.getSize()[0]

    def _new_B(self) -> tuple[PETSc.Mat, PETSc.Mat]:
        """Empty B, and B̃ where it differs."""
        B = self.create_matrix(self.size_z, self.layout.size_u)
        if self._T is None:
            return B, B
        return B, self.create_matrix(self.size_z, self.layout.size_u)

    def _assemble_B(self, interfaces: Sequence[Interface]) -> tuple[PETSc.Mat, PETSc.Mat]:
        """Integrate interfaces in their configurations: B and B̃ = B T. Collective."""
        B, B_tilde = self._new_B()
        # Masters of one interface may be slave nodes of another
        chained = self._chained and B_tilde is not B
        M = self.create_matrix(self.size_z, self.layout.size_u) if chained else None
        for i in interfaces:
            # One matrix serves as both where there is no basis transformation
            with Timer("~mortar: integrate"):
                i._nodal = cpp.integrate(
                    i._data, i._configuration, B=B, B_tilde=None if B_tilde is B else B_tilde, M=M
                )
        for A in {id(A): A for A in (B, B_tilde)}.values():
            A.assemble()
        if M is not None:
            M.assemble()
            B_tilde.axpy(1.0, M)
            B_tilde.axpy(-1.0, M.matMult(self._T))
            M.destroy()
        return B, B_tilde

    def _integrate_ties(self) -> None:
        self._B_ties = None
        if not self.ties:
            return
        for tie in self.ties:
            self._choose_multipliers(tie, None)
            tie._check_orphans(tie._nodal)
            self._check_met(tie, tie._nodal)
            tie._drop_uncovered(tie._nodal)
        self._update_transformation()
        self._B_ties = self._assemble_B(self.ties)

    def _check_met(self, interface: Interface, nodal: dict) -> None:
        if self.comm.allreduce(int(nodal["num_covered"])) == 0:
            slave = interface._surface_slave.X[: interface.num_owned]
            master = interface._surface_master.X[: interface._surface_master.num_owned]
            boxes = []
            for x in (slave, master):
                low = self.comm.allreduce(x.min(axis=0, initial=np.inf), op=_MIN)
                high = self.comm.allreduce(x.max(axis=0, initial=-np.inf), op=_MAX)
                boxes.append(
                    f"{np.array2string(low, precision=4)} to {np.array2string(high, precision=4)}"
                )
            raise RuntimeError(
                "No slave facet meets a master facet: slave "
                f"{interface.slave[0].tag} spans {boxes[0]}, master {interface.master[0].tag} "
                f"{boxes[1]}. Check the tags, that the surfaces face each other, and "
                "search_distance."
            )

    def _own_dofs(self, interface: Interface) -> npt.NDArray[np.int32]:
        """Local displacement dofs of an interface's owned slave nodes."""
        n = interface.num_owned
        blocks = interface._surface_slave.blocks[:n] - self.layout.first_u // 3
        return (3 * blocks[:, None] + np.arange(3)).ravel().astype(np.int32)

    def inverse(self, interface: Interface) -> PETSc.Mat:
        """D⁻¹ = T D̃⁻¹ of an interface with dual multipliers. Collective."""
        n_u, n_z = self.layout.size_u, self.size_z
        n = interface.num_owned
        carries = np.repeat(interface._data.carries[:n].astype(bool), 3)
        diagonal = np.repeat(interface._nodal["diagonal"][:n], 3)
        own = self._own_dofs(interface)
        E = self.create_matrix(n_u, n_z)
        first_u, first_z = self.layout.first_u, 3 * self._first_multiplier
        start = self.slice(interface).start
        for j in np.flatnonzero(carries):
            E.setValue(first_u + own[j], first_z + start + j, 1.0 / diagonal[j])
        E.assemble()
        if self._T is None:
            return E
        return self.transformation([interface], False).matMult(E)

    def constraints(self, tie: Tie):
        """See :meth:`Tie.constraints`."""
        # Rows T (I_R - E D̃⁻¹ B̃_R) T⁻¹ of the slave dofs
        n_u = self.layout.size_u
        T = self.transformation([tie], False)
        T_inverse = self.transformation([tie], True)
        tied = np.flatnonzero(self._tied(tie))
        own = self._own_dofs(tie)[tied]
        inverse = tie._inverse()  # T E D̃⁻¹
        B = self._rows_of(self._B_ties[1], tie)
        keep = B.createVecRight()
        keep.array[:] = 1.0
        keep.array[own] = 0.0
        B.diagonalScale(R=keep)
        C = inverse.matMult(B)
        C.scale(-1.0)
        R = self.create_matrix(n_u, n_u)
        first = self.layout.first_u
        for i in np.flatnonzero(keep.array):
            R.setValue(first + i, first + i, 1.0)
        R.assemble()
        C.axpy(1.0, T.matMult(R))
        C = C.matMult(T_inverse)
        out = []
        for dof in sorted(own):
            columns, values = C.getRow(first + dof)
            used = np.abs(values) > 1e-14 * np.max(np.abs(values), initial=0.0)
            out.append((int(first + dof), columns[used].astype(np.int64), values[used]))
        return out

    # -- State ------------------------------------------------------------------

    def slice(self, interface: Interface) -> slice:
        """Local multiplier dofs of an interface's owned nodes."""
        start = 3 * self._starts[id(interface)]
        return slice(start, start + 3 * interface.num_owned)

    def local_multipliers(self, z: npt.NDArray, interface: Interface) -> npt.NDArray[np.float64]:
        """Multipliers of the local slave nodes of an interface, shape (n, 3). Collective."""
        values = np.zeros((interface.num_nodes, 3))
        values[: interface.num_owned] = z[self.slice(interface)].reshape(-1, 3)
        cpp.scatter_forward(interface._surface_slave, values)
        return values

    def set_parameters(self, diagonal: npt.NDArray[np.float64]) -> None:
        """Default complementarity parameters from the diagonal of the tangent."""
        for c in self.contacts:
            blocks = c._surface_slave.blocks[: c.num_owned] - self.layout.first_u // 3
            k = np.abs(diagonal.reshape(-1, 3)[blocks]).mean(axis=1)
            c._set_parameters(k)

    def begin(self, u_all: npt.NDArray, u: npt.NDArray) -> None:
        """Prepare a solve that starts from the displacement ``u``. Collective."""
        self._history = []
        if not self.contacts:
            return
        if self._accepted is None:
            self._accepted = u_all.copy(), u.copy()
        self.release_matrices()
        changed = [self._choose_multipliers(c, u_all) for c in self.contacts]
        if any(changed):
            self._update_transformation()
        for c in self.contacts:
            c._drop_uncovered(c._nodal)
            if not hasattr(c, "_total_slip"):
                c._total_slip = np.zeros((c.num_owned, 3))
        if any(c.is_frictional for c in self.contacts):
            # The old matrices need the multipliers of this step
            self._B_old = self._assemble_contacts(self._accepted[0])[0]

    def _choose_multipliers(self, interface: Interface, u_all: npt.NDArray | None) -> bool:
        """Adapt the multipliers to what masters cover in a configuration. Collective.

        Returns:
            True where that changes the basis transformation.
        """
        i = interface
        if isinstance(i, Tie) or i.geometry == "reference":
            u_all = None
        x = i._positions(u_all)
        i._configuration = i._configure(u_all)
        i._data.carries = i._candidates
        i._nodal = cpp.integrate(i._data, i._configuration)
        positive = np.asarray(cpp.flag_positive(i._data, x[0], i._nodal["facet_area"]))
        changed = self.comm.allreduce(bool(np.any(positive != i._data.positive)), op=MPI.LOR)
        if changed:
            i._data.positive = positive
            i._weights = np.asarray(cpp.nodal_weights(i._data, i._surface_slave.X))
            i._nodal = cpp.integrate(i._data, i._configuration)
        return changed

    def _update_transformation(self) -> None:
        self._T = self.transformation(self.interfaces, False)
        self._T_minus_one = None
        if self._is_identity(self._T):
            self._T = None
        else:
            self._T_minus_one = self._T.copy()
            self._T_minus_one.shift(-1.0)

    def _assemble_contacts(self, u_all: npt.NDArray) -> tuple[PETSc.Mat, PETSc.Mat]:
        for c in self.contacts:
            x = None if c.geometry == "reference" else u_all
            c._configuration = c._configure(x)
        return self._assemble_B(self.contacts)

    def resume(self, u_all: npt.NDArray, u: npt.NDArray, z: npt.NDArray) -> None:
        """Make a state that was read from a file the last accepted one. Collective."""
        self._history = []
        self.release_matrices()
        if self.contacts:
            self._accepted = u_all.copy(), u.copy()
            self.begin(u_all, u)
            self.evaluate(u_all, u, z, None)

    def release_matrices(self) -> None:
        """Forget matrices of earlier states."""
        pair = self._contact_B_pair or ()
        for A in {id(A): A for A in (*pair, self._B_old) if A is not None}.values():
            A.destroy()
        self._contact_B_pair = self._B_old = None

    def state(self):
        """What :meth:`restore` brings back."""
        # None of these is changed in place
        contacts = [
            (c, {k: getattr(c, k) for k in _STATE if hasattr(c, k)}, c._data.carries)
            for c in self.contacts
        ]
        return self._accepted, contacts

    def restore(self, state) -> None:
        """Go back to an earlier state."""
        # Part of a step may have been accepted before the rest of it failed
        self._accepted, contacts = state
        for c, values, carries in contacts:
            for name, value in values.items():
                setattr(c, name, value)
            c._data.carries = carries

    def accept(self, u_all: npt.NDArray) -> None:
        """The present state is that of an accepted step. Collective."""
        for c in self.contacts:
            if c.is_frictional:
                motion = c._motion
                n = c._configuration.normals[: c.num_owned]
                slip = np.sum(motion * n, axis=1)[:, None] * n - motion
                closed = (c._status != OPEN)[:, None]
                slip = np.where(closed, slip, 0.0)
                c._dissipation = float(np.sum(c._law_arguments[0] * slip))
                # An average of slip, from slip times area
                weight = np.where(closed, c._nodal["weight"][: c.num_owned, None], 1.0)
                c._total_slip = np.where(closed, c._total_slip + slip / weight, 0.0)
        if self.contacts:
            self._accepted = u_all.copy(), self._u.copy()

    # -- Residual -----------------------------------------------------------------

    def evaluate(
        self,
        u_all: npt.NDArray,
        u: npt.NDArray,
        z: npt.NDArray,
        forced: dict | None,
    ) -> tuple[npt.NDArray, npt.NDArray]:
        """Contact forces Bᵀz and constraints. Collective.

        Args:
            u_all: Local displacements of all bodies, ghosts included.
            u: Owned displacements.
            z: Owned multipliers.
            forced: States of contact nodes to use, or None.

        Returns:
            Bᵀz, shape (size_u,); residual of the constraints, shape (size_z,).
        """
        self._u = u.copy()
        f_z = z.copy()
        if not self.interfaces:
            return np.zeros(self.layout.size_u), f_z
        if self.contacts:
            self._evaluate_contacts(u_all)
        self._combine()
        vector_z, vector_u = self._B.createVecLeft(), self._B.createVecRight()
        vector_z.array[:] = z
        self._B.multTranspose(vector_z, vector_u)
        force = vector_u.array.copy()

        if self._B_ties is not None:
            vector_u.array[:] = u
            self._B_ties[0].mult(vector_u, vector_z)
            for tie in self.ties:
                rows, active = self.slice(tie), self._tied(tie)
                f_z[rows] = np.where(active, vector_z.array[rows], z[rows])
        if self.contacts:
            self._evaluate_laws(u, z, f_z, forced)
        return force, f_z

    def _evaluate_contacts(self, u_all) -> None:
        if self._contact_is_frozen and self._contact_B_pair is not None:
            return
        old = self._contact_B_pair
        if old is not None:
            for A in {id(A): A for A in old}.values():
                A.destroy()
        self._contact_B_pair = self._assemble_contacts(u_all)

    _contact_B_pair: tuple[PETSc.Mat, PETSc.Mat] | None = None

    @property
    def _contact_B(self) -> PETSc.Mat:
        assert self._contact_B_pair is not None
        return self._contact_B_pair[0]

    @property
    def _contact_is_frozen(self) -> bool:
        return all(c.geometry == "reference" for c in self.contacts)

    def _combine(self) -> None:
        """B of ties and contacts together."""
        pairs = [p for p in (self._contact_B_pair, self._B_ties) if p is not None]
        if len(pairs) == 1:
            self._B, self._B_tilde = pairs[0]
            return
        B = pairs[0][0].copy()
        B.axpy(1.0, pairs[1][0])
        if self._T is None:
            B_tilde = B
        else:
            B_tilde = pairs[0][1].copy()
            B_tilde.axpy(1.0, pairs[1][1])
        self._B, self._B_tilde = B, B_tilde

    def _tied(self, tie: Tie) -> npt.NDArray[np.bool_]:
        """Flags of the multiplier dofs of a tie whose constraint is that of the tie."""
        n = tie.num_owned
        carries = tie._data.carries[:n].astype(bool)
        return (carries[:, None] & (tie._fixed[:n] == 0)).ravel()

    def _evaluate_laws(self, u, z, f_z, forced) -> None:
        B = self._contact_B
        vector_u, vector_z = B.createVecRight(), B.createVecLeft()
        old = reference = None
        if self._B_old is not None:
            vector_u.array[:] = self._reference + u
            self._B_old.mult(vector_u, vector_z)
            old = vector_z.array.copy()
        if any(c.geometry == "reference" for c in self.contacts):
            vector_u.array[:] = u
            B.mult(vector_u, vector_z)
            reference = vector_z.array.copy()
            if self._B_old is not None:
                vector_u.array[:] = self._accepted[1]
                B.mult(vector_u, vector_z)
                reference_old = vector_z.array.copy()
        for c in self.contacts:
            rows, n = self.slice(c), c.num_owned
            normals = c._configuration.normals[:n]
            gap = c._nodal["gap"][:n]
            c._motion = None
            if c.geometry == "reference":
                moved = reference[rows].reshape(-1, 3)
                gap = gap - np.sum(normals * moved, axis=1)
                if c.is_frictional:
                    c._motion = reference_old[rows].reshape(-1, 3) - moved
            elif c.is_frictional:
                c._motion = c._nodal["offset"][:n] - old[rows].reshape(-1, 3)
            state = None if forced is None else forced.get(id(c))
            c._law_arguments = z[rows].reshape(-1, 3).copy(), gap, c._motion, state
            c._evaluate_law(*c._law_arguments)
            f_z[rows] = c._law["value"].ravel()

    def rescale(self, f_z: npt.NDArray) -> npt.NDArray[np.float64]:
        """Scale the friction equations by tractions of the last :meth:`evaluate`.

        Newton's steps do not depend on this scale, the linear solver's accuracy does.

        Args:
            f_z: Residual of the constraints.

        Returns:
            The same with the new scale.
        """
        f_z = f_z.copy()
        for c in self.contacts:
            if c.is_frictional:
                c._rescale()
            c._evaluate_law(*c._law_arguments, damped=True)
            f_z[self.slice(c)] = c._law["value"].ravel()
        return f_z

    # -- Linearisation ------------------------------------------------------------

    def linearise(self, K: PETSc.Mat, z: npt.NDArray) -> NewtonSystem:
        """Newton system at the state of the last :meth:`evaluate`. Collective.

        Args:
            K: Tangent of the bodies.
            z: Owned multipliers.
        """
        n_u, n_z = self.layout.size_u, self.size_z
        C_z = self.create_matrix(n_z, n_z)
        blocks = np.tile(np.eye(3), (n_z // 3, 1, 1))
        active = np.zeros(n_z, dtype=bool)
        for tie in self.ties:
            flags = self._tied(tie)
            active[self.slice(tie)] = flags
            rows = self.slice(tie)
            part = blocks[rows.start // 3 : rows.stop // 3].reshape(-1, 3)
            part[flags] = 0.0
            blocks[rows.start // 3 : rows.stop // 3] = part.reshape(-1, 3, 3)
        for c in self.contacts:
            rows = self.slice(c)
            blocks[rows.start // 3 : rows.stop // 3] = c._law["dz"]
            closed = (c._status != OPEN)[:, None] & (c._fixed[: c.num_owned] == 0)
            active[rows] = closed.ravel()
        first = 3 * self._first_multiplier
        cpp.add_blocks(C_z, first, first, np.ascontiguousarray(blocks))
        C_z.assemble()

        with Timer("~mortar: linearise"):
            C_u = self._contact_derivative(z) if self.contacts else None
        if self._B_ties is not None:
            tied = self._B_ties[0].copy()
            mask = tied.createVecLeft()
            mask.array[:] = 0.0
            for tie in self.ties:
                mask.array[self.slice(tie)] = self._tied(tie)
            tied.diagonalScale(L=mask)
            if C_u is None:
                C_u = tied
            else:
                C_u.axpy(1.0, tied)
        if C_u is None:
            C_u = self.create_matrix(n_z, n_u)
            C_u.assemble()

        K_c, self._force_derivative = self._force_derivative, None
        own = np.zeros(n_z, dtype=np.int32)
        diagonal = np.zeros(n_z)
        for i in self.interfaces:
            own[self.slice(i)] = self._own_dofs(i)
            diagonal[self.slice(i)] = np.repeat(i._nodal["diagonal"][: i.num_owned], 3)
        index = np.flatnonzero(active).astype(np.int32)
        projector = np.zeros((n_z // 3, 3, 3))
        for i in self.interfaces:
            rows, n = self.slice(i), i.num_owned
            flags = active[rows].reshape(-1, 3)
            part = np.tile(np.eye(3), (n, 1, 1))
            if isinstance(i, Contact):
                normal = i._configuration.normals[:n]
                sliding = i._status == SLIP
                part[sliding] = normal[sliding, :, None] * normal[sliding, None, :]
            projector[rows.start // 3 : rows.stop // 3] = (
                part * flags[:, :, None] * flags[:, None, :]
            )
        if self._B is None:
            self._B, self._B_tilde = self._new_B()
            self._B.assemble()
        return NewtonSystem(
            K=K,
            K_c=K_c,
            B=self._B,
            B_tilde=self._B_tilde,
            T=self._T_minus_one,
            C_u=C_u,
            C_z=C_z,
            active=index,
            own=own[index],
            diagonal=diagonal[index],
            projector=projector,
            fixed=self.fixed_dofs,
            tied=not self.contacts,
        )

    _force_derivative: PETSc.Mat | None = None

    def release(self, system: NewtonSystem, keep: Sequence[PETSc.Mat]) -> None:
        """Free a system's matrices that are made anew each time."""
        if all(system.K is not A for A in keep):
            system.K.destroy()
        if system.K_c is not None:
            system.K_c.destroy()
        system.C_u.destroy()
        system.C_z.destroy()

    def _contact_derivative(self, z: npt.NDArray) -> PETSc.Mat:
        """∂C/∂u of all contacts; leaves the derivative of the forces behind."""
        n_u, n_z = self.layout.size_u, self.size_z
        n_n = n_z // 3
        first, first_n = 3 * self._first_multiplier, self._first_multiplier
        current = [c for c in self.contacts if c.geometry == "current"]
        frictional = any(c.is_frictional for c in self.contacts)
        W_g = self.create_matrix(n_z, n_n)
        W_n = self.create_matrix(n_z, n_z)
        W_w = self.create_matrix(n_z, n_z) if frictional else None
        gap = self.create_matrix(n_n, n_u)
        gap_normal = self.create_matrix(n_n, n_z)
        normals = self.create_matrix(n_z, n_u)
        offset = self.create_matrix(n_z, n_u) if frictional else None
        force = self.create_matrix(n_u, n_u) if current else None
        frozen = self.create_matrix(n_n, n_z) if len(current) < len(self.contacts) else None
        for c in self.contacts:
            start = self._starts[id(c)]
            cpp.add_blocks(
                W_g,
                first + 3 * start,
                first_n + start,
                np.ascontiguousarray(c._law["dg"][:, :, None]),
            )
            cpp.add_blocks(W_n, first + 3 * start, first + 3 * start, c._law["dn"])
            if W_w is not None:
                sign = 1.0 if c.geometry == "current" else -1.0
                cpp.add_blocks(W_w, first + 3 * start, first + 3 * start, sign * c._law["dw"])
            active = np.zeros(c.num_nodes, dtype=np.int8)
            active[: c.num_owned] = c._status != OPEN
            cpp.scatter_forward(c._surface_slave, active)
            if c.geometry == "reference":
                n = c._configuration.normals[: c.num_owned]
                closed = (c._status != OPEN)[:, None]
                cpp.add_blocks(
                    frozen,
                    first_n + start,
                    first + 3 * start,
                    np.ascontiguousarray(np.where(closed, -n, 0.0)[:, None, :]),
                )
                continue
            cpp.integrate_derivatives(
                c._data,
                c._configuration,
                self.local_multipliers(z, c),
                active,
                force=force,
                gap=gap,
                gap_normal=gap_normal,
                offset=offset if c.is_frictional else None,
            )
            cpp.differentiate_normals(c._data, c._configuration, normals)
        matrices = [W_g, W_n, W_w, gap, gap_normal, normals, offset, force, frozen]
        for A in matrices:
            if A is not None:
                A.assemble()
        G = gap_normal.matMult(normals)
        G.axpy(1.0, gap)
        if frozen is not None:
            F = frozen.matMult(self._contact_B)
            G.axpy(1.0, F)
        C_u = W_g.matMult(G)
        N = W_n.matMult(normals)
        C_u.axpy(1.0, N)
        if frictional:
            # Motion: offset - B_old x (current), B_old u - B u (reference)
            V = offset
            V.axpy(-1.0, self._old_of_current())
            for c in self.contacts:
                if c.geometry == "reference" and c.is_frictional:
                    V.axpy(1.0, self._rows_of(self._contact_B, c))
            S = W_w.matMult(V)
            C_u.axpy(1.0, S)
        self._force_derivative = force
        for A in (W_g, W_n, W_w, gap, gap_normal, normals, offset, frozen, G, N):
            if A is not None:
                A.destroy()
        return C_u

    def _rows_of(self, A: PETSc.Mat, interface: Interface) -> PETSc.Mat:
        """Copy of a matrix with only the rows of one interface."""
        R = A.copy()
        mask = R.createVecLeft()
        mask.array[:] = 0.0
        mask.array[self.slice(interface)] = 1.0
        R.diagonalScale(L=mask)
        return R

    def _old_of_current(self) -> PETSc.Mat:
        assert self._B_old is not None
        R = self._B_old.copy()
        mask = R.createVecLeft()
        mask.array[:] = 0.0
        for c in self.contacts:
            if c.geometry == "current" and c.is_frictional:
                mask.array[self.slice(c)] = 1.0
        R.diagonalScale(L=mask)
        return R

    # -- Convergence and active sets ------------------------------------------------

    def constraint_measure(self, f_z: npt.NDArray, x: npt.NDArray, length: float) -> float:
        """Largest violation of a constraint, relative to displacements or tractions.

        Args:
            f_z: Residual of the constraints.
            x: State [u, z].
            length: Largest displacement on any rank.
        """
        z = x[len(x) - self.size_z :]
        worst = 0.0
        for i in self.interfaces:
            rows = self.slice(i)
            values = np.abs(f_z[rows])
            if isinstance(i, Tie):
                active = self._tied(i)
                weight = np.repeat(np.abs(i._nodal["weight"][: i.num_owned]), 3)
                jump = values[active] / weight[active]
                if length > 0:
                    worst = max(worst, float(np.max(jump, initial=0.0)) / length)
            else:
                largest = float(np.max(np.abs(z[rows]), initial=0.0))
                largest = self.comm.allreduce(largest, op=MPI.MAX)
                violation = float(np.max(values, initial=0.0))
                if largest > 0:
                    worst = max(worst, violation / largest)
                elif violation > 0:
                    worst = np.inf
        return worst

    def _all_status(self) -> npt.NDArray[np.int8]:
        return (
            np.concatenate([c._status for c in self.contacts])
            if self.contacts
            else np.empty(0, dtype=np.int8)
        )

    def status_counts(self) -> dict[str, int]:
        """Numbers of nodes in contact. Collective."""
        s = self._all_status()
        counts = [int(np.sum(s != OPEN)), int(np.sum(s == STICK)), int(np.sum(s == SLIP))]
        total = self.comm.allreduce(np.array(counts))
        return {"active": int(total[0]), "stick": int(total[1]), "slip": int(total[2])}

    def update_history(self, it: int) -> int:
        """Note the present states; number of nodes that changed. Collective."""
        s = self._all_status()
        before = self._history[-1] if self._history else None
        changed = len(s) if before is None else int(np.sum(s != before))
        if before is None:
            changed = int(np.sum(s != OPEN))
        self._history.append(s.copy())
        return self.comm.allreduce(changed)

    def undecided(self, z: npt.NDArray, rtol: float) -> bool:
        """True where all nodes that changed have neither gap nor traction. Collective."""
        if len(self._history) < 2:
            return False
        ok = True
        start = 0
        for c in self.contacts:
            n = c.num_owned
            changed = self._history[-1][start : start + n] != self._history[-2][start : start + n]
            start += n
            zc = z[self.slice(c)].reshape(-1, 3)
            largest = self.comm.allreduce(float(np.max(np.abs(zc), initial=0.0)), op=MPI.MAX)
            zn = np.abs(np.sum(zc * c._configuration.normals[:n], axis=1))
            cg = np.abs(c._c_n * c._gap_weighted)
            switching = np.maximum(zn, cg) <= 100 * rtol * largest
            if c.is_frictional:
                switching |= (c._status != OPEN) & (zn > 0)
            ok = ok and bool(np.all(switching[changed]))
        return self.comm.allreduce(ok, op=MPI.LAND)

    def cycling(self) -> bool:
        """True where the active sets come back to an earlier one. Collective."""
        h = self._history
        same = False
        for period in range(2, 6):
            if len(h) > 2 * period:
                same = same or all(
                    np.array_equal(h[-1 - k], h[-1 - k - period]) for k in range(period)
                )
        same = same and not np.array_equal(h[-1], h[-2]) if len(h) > 1 else False
        some = self.comm.allreduce(same, op=MPI.LOR)
        return bool(some)

    def initial_status(self, functions) -> dict | None:
        """States that the first solve begins with, or None. Collective."""
        forced = {}
        unheld = self._unheld()
        for c in self.contacts:
            state = c._initial_status(unheld)
            given = self.comm.allreduce(state is not None, op=MPI.LOR)
            if given:
                forced[id(c)] = state
        return forced or None

    def _unheld(self) -> bool:
        """True where Dirichlet conditions and ties leave a rigid motion free. Collective."""
        layout = self.layout
        group = list(range(len(layout.spaces)))
        for tie in self.ties:
            bodies = {layout.body(p.V) for p in [*tie.slave, *tie.master]}
            low = min(group[b] for b in bodies)
            group = [
                low if group[b] in {group[c] for c in bodies} else group[b]
                for b in range(len(group))
            ]
        x = self._reference.reshape(-1, 3)
        scale = self.comm.allreduce(float(np.max(np.abs(x), initial=0.0)), op=MPI.MAX) or 1.0
        grams = self._components(group, x / scale)
        return any(np.linalg.matrix_rank(G, tol=1e-10 * max(1.0, np.trace(G))) < 6 for G in grams)

    def _components(self, group, x) -> list[npt.NDArray[np.float64]]:
        """Gram matrices of the rigid modes at fixed dofs, one for each separate body."""
        labels = self._body_labels(group)
        grams = {}
        modes = np.zeros((len(x), 3, 6))
        modes[:, 0, 0] = modes[:, 1, 1] = modes[:, 2, 2] = 1.0
        modes[:, 1, 3], modes[:, 2, 3] = -x[:, 2], x[:, 1]
        modes[:, 0, 4], modes[:, 2, 4] = x[:, 2], -x[:, 0]
        modes[:, 0, 5], modes[:, 1, 5] = -x[:, 1], x[:, 0]
        rows = modes.reshape(-1, 6)
        names = sorted(set().union(*self.comm.allgather(set(labels.tolist()))))
        fixed = self.fixed_dofs
        for name in names:
            mine = fixed[labels[fixed // 3] == name]
            grams[name] = self.comm.allreduce(rows[mine].T @ rows[mine])
        return list(grams.values())

    def _body_labels(self, group) -> npt.NDArray[np.int64]:
        """A label of the separate body that each owned block belongs to. Collective."""
        labels = []
        layout = self.layout
        for b in range(len(layout.spaces)):
            label = layout.separate_bodies(b)
            labels.append(label[: layout.num_owned[b]] + 1000 * group[b])
        return np.concatenate(labels)

    def diagnose(self) -> str:
        """What may be behind a failure. Collective."""
        if not self.contacts:
            return ""
        counts = self.status_counts() if hasattr(self.contacts[0], "_law") else {"active": 0}
        if counts["active"] == 0 and self._unheld():
            return (
                " No slave node is in contact, and without contact a body is not held: bring the "
                "surfaces together (check tags and search_distance), prescribe displacements, or "
                "choose initial_active."
            )
        return ""

    def resultants(self, contact: Contact, z: npt.NDArray, u: npt.NDArray):
        """Forces and moments of a contact on slave and master, shapes (3,). Collective."""
        c = contact
        D, M = c._problem._create_z_by_u(), c._problem._create_z_by_u()
        cpp.integrate(c._data, c._configuration, D=D, M=M)
        x = (self._reference + (u if c.geometry == "current" else 0.0)).reshape(-1, 3)
        out = []
        for A, sign in ((D, -1.0), (M, 1.0)):
            A.assemble()
            v, w = A.createVecLeft(), A.createVecRight()
            v.array[:] = 0.0
            v.array[self.slice(c)] = z[self.slice(c)]
            A.multTranspose(v, w)
            f = sign * w.array.reshape(-1, 3)
            out.append(self.comm.allreduce(f.sum(axis=0)))
            out.append(self.comm.allreduce(np.cross(x, f).sum(axis=0)))
            A.destroy()
        return out[0], out[2], out[1], out[3]


def _elementwise(op):
    return lambda a, b: op(a, b)


_MIN, _MAX = _elementwise(np.minimum), _elementwise(np.maximum)
