# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""State and residual of all interfaces of a problem."""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from . import cpp, plausibility, rigidity, sparse
from .active_sets import ActiveSets
from .contact import Contact
from .interfaces import Interface, Tie
from .layout import Layout
from .multipliers import Multipliers

# What the fields of a contact are made of
_STATE = (
    "_total_slip",
    "_dissipation",
    "_configuration",
    "_nodal",
    "_law",
    "_gap_weighted",
    "_scale",
    "_c_n",
    "_c_t",
)


class Coupling:
    """Forces and constraints of the interfaces of a problem.

    Args:
        layout: Displacement dofs.
        interfaces: Interfaces.
        bcs: Dirichlet conditions.

    Attributes:
        multipliers: Numbers and matrices of the multipliers.
        active_sets: States of contact nodes in the course of the iteration.
        B, B_tilde: Mortar matrix [D, -M] of all interfaces at the last :meth:`evaluate`, and the
            same in the transformed basis; None without interfaces.
        B_contact: The part of B of contacts, or None.
        B_ties: B and B̃ of the ties, or None.
        B_old: B of contacts at the last accepted step, or None where there is no friction.
    """

    def __init__(
        self, layout: Layout, interfaces: Sequence[Interface], bcs: Sequence[fem.DirichletBC]
    ):
        self.layout, self.comm = layout, layout.comm
        self.multipliers = Multipliers(layout, interfaces, bcs)
        self.interfaces = self.multipliers.interfaces
        self.ties, self.contacts = self.multipliers.ties, self.multipliers.contacts
        self.active_sets = ActiveSets(self.comm, self.contacts)
        self.B: PETSc.Mat | None = None
        self.B_tilde: PETSc.Mat | None = None
        self.B_old: PETSc.Mat | None = None
        #: A sentence on bodies that overlap when the first solve begins
        self.start_overlap = ""
        self.B_ties = self.multipliers.integrate_ties()
        self._contact_pair: tuple[PETSc.Mat, PETSc.Mat] | None = None
        #: B and B̃ of ties and contacts together, where there are both
        self._combined: tuple[PETSc.Mat, PETSc.Mat] | None = None
        self._reference = layout.positions()
        self._accepted: tuple[npt.NDArray, npt.NDArray] | None = None

    @property
    def has_contact(self) -> bool:
        """Inequality constraints are present."""
        return len(self.contacts) > 0

    @property
    def fixed_dofs(self) -> npt.NDArray[np.int32]:
        """Local displacement dofs with a Dirichlet condition."""
        return self.multipliers.fixed_dofs

    @property
    def B_contact(self) -> PETSc.Mat | None:
        """See the class."""
        return None if self._contact_pair is None else self._contact_pair[0]

    def split(self, z: npt.NDArray[np.float64]) -> list[npt.NDArray[np.float64]]:
        """Multipliers of the owned nodes of each contact, shape (num_owned, 3)."""
        return [z[self.multipliers.slice(c)].reshape(-1, 3) for c in self.contacts]

    # -- Steps --------------------------------------------------------------------

    def set_parameters(self, diagonal: npt.NDArray[np.float64]) -> None:
        """Default complementarity parameters from the diagonal of the tangent."""
        for c in self.contacts:
            blocks = c._surface_slave.blocks[: c.num_owned] - self.layout.first_u // 3
            k = np.abs(diagonal.reshape(-1, 3)[blocks]).mean(axis=1)
            c._set_parameters(k)

    def begin(self, u_all: npt.NDArray, u: npt.NDArray) -> None:
        """Prepare a solve that starts from the displacement ``u``. Collective."""
        self.active_sets.clear()
        if not self.contacts:
            return
        if self._accepted is None:
            self._accepted = u_all.copy(), u.copy()
        self._release_matrices()
        changed = [c for c in self.contacts if self.multipliers.choose(c, self._current(c, u_all))]
        changed += self.multipliers.share_positive(self.interfaces)
        self._change_basis(changed)
        for c in self.contacts:
            c._drop_uncovered(c._nodal)
            if not hasattr(c, "_total_slip"):
                c._total_slip = np.zeros((c.num_owned, 3))
        if any(c.is_frictional for c in self.contacts):
            # The old matrices need the multipliers of this step
            self.B_old = self._assemble_contacts(self._accepted[0])[0]

    def check_start(self, u_all: npt.NDArray) -> None:
        """Refuse to begin with bodies deep inside each other. Collective.

        Raises:
            RuntimeError: They are; the message says where.
        """
        deepest = max((c._overlap() for c in self.contacts), default=0.0)
        self.start_overlap = ""
        if deepest > 0.5:
            self.start_overlap = (
                f" The bodies overlap at the start, by {deepest:.2g} of a facet's size: begin with "
                "them apart, and bring them together in load steps."
            )
        for c in self.contacts:
            # Frozen geometry is that without displacements
            x = np.zeros_like(u_all) if c.geometry == "reference" else u_all
            overlap = plausibility.find_overlap(c, self.layout, x)
            if overlap:
                raise RuntimeError(
                    f"{overlap} Begin with the bodies apart, and bring them together in load "
                    "steps; or give the contact a search_distance of at least that depth, if it "
                    "is to push them apart in one step."
                )

    def find_blocked(self) -> str:
        """Where Dirichlet conditions contradict contact in the state of the last :meth:`evaluate`.

        Collective. A sentence, empty where they do not.
        """
        text = ""
        for c in self.contacts:
            text = text or plausibility.find_blocked(c, self.layout, self._u)
        return text

    def find_implausible(self, functions: Sequence[fem.Function]) -> str:
        """What too large a step may have led to, in the state of the last :meth:`evaluate`.

        Collective. A sentence, empty where all is well.
        """
        current = [c for c in self.contacts if c.geometry == "current"]
        text = plausibility.find_inverted(self.layout, functions) if current else ""
        u_all = self.layout.all_local(functions)
        for c in current:
            if not text:
                text = plausibility.find_overlap(c, self.layout, u_all)
                text = text or plausibility.find_crossing(c, self._accepted[0], u_all)
                text = text and f"{text} It has passed through the surface in this step."
        return text

    def accept(self, u_all: npt.NDArray) -> None:
        """The present state is that of an accepted step. Collective."""
        for c in self.contacts:
            if c.is_frictional:
                c._accept_slip()
        if self.contacts:
            self._accepted = u_all.copy(), self._u.copy()

    def resume(self, u_all: npt.NDArray, u: npt.NDArray, z: npt.NDArray) -> None:
        """Make a state that was read from a file the last accepted one. Collective."""
        self.active_sets.clear()
        self._release_matrices()
        if self.contacts:
            self._accepted = u_all.copy(), u.copy()
            self.begin(u_all, u)
            self.evaluate(u_all, u, z, None)

    def _change_basis(self, changed: Sequence[Interface]) -> None:
        """Form what depends on the basis of some interfaces anew. Collective."""
        if changed:
            self.multipliers.update_transformation()
        if any(i in self.ties for i in changed):
            sparse.destroy(*self.B_ties)
            self.B_ties = self.multipliers.assemble(self.ties)

    def state(self):
        """What :meth:`restore` brings back."""
        # None of these is changed in place
        contacts = [
            (
                c,
                {k: getattr(c, k) for k in _STATE if hasattr(c, k)},
                c._data.carries,
                c._data.idle,
            )
            for c in self.contacts
        ]
        return self._accepted, contacts, [i._data.positive for i in self.interfaces]

    def restore(self, state) -> None:
        """Go back to an earlier state. Collective."""
        # Part of a step may have been accepted before the rest of it failed
        self._accepted, contacts, basis = state
        changed = []
        for i, positive in zip(self.interfaces, basis):
            differs = bool(np.any(positive != i._data.positive))
            if self.comm.allreduce(differs, op=MPI.LOR):
                i._set_positive(positive)
                changed.append(i)
        self._change_basis(changed)
        for c, values, carries, idle in contacts:
            for name, value in values.items():
                setattr(c, name, value)
            c._data.carries, c._data.idle = carries, idle

    def _release_matrices(self) -> None:
        """Forget matrices of earlier states."""
        sparse.destroy(*(self._contact_pair or ()), *(self._combined or ()), self.B_old)
        self._contact_pair = self._combined = self.B_old = None

    def destroy(self) -> None:
        """Free all matrices. Collective."""
        self._release_matrices()
        sparse.destroy(*(self.B_ties or ()), self.B, self.B_tilde)
        self.B_ties = self.B = self.B_tilde = None
        self.multipliers.destroy()

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
        force = sparse.product_transposed(self.B, z)
        if self.B_ties is not None:
            jump = sparse.product(self.B_ties[0], u)
            for tie in self.ties:
                rows, active = self.multipliers.slice(tie), self.multipliers.tied(tie)
                f_z[rows] = np.where(active, jump[rows], z[rows])
        if self.contacts:
            self._evaluate_laws(u, z, f_z, forced)
        return force, f_z

    @staticmethod
    def _current(contact: Contact, u_all: npt.NDArray) -> npt.NDArray | None:
        return None if contact.geometry == "reference" else u_all

    def _assemble_contacts(self, u_all: npt.NDArray) -> tuple[PETSc.Mat, PETSc.Mat]:
        for c in self.contacts:
            c._configuration = c._configure(self._current(c, u_all))
        return self.multipliers.assemble(self.contacts)

    def _evaluate_contacts(self, u_all: npt.NDArray) -> None:
        frozen = all(c.geometry == "reference" for c in self.contacts)
        if frozen and self._contact_pair is not None:
            return
        sparse.destroy(*(self._contact_pair or ()))
        self._contact_pair = self._assemble_contacts(u_all)

    def _combine(self) -> None:
        """B of ties and contacts together."""
        pairs = [p for p in (self._contact_pair, self.B_ties) if p is not None]
        if len(pairs) == 1:
            self.B, self.B_tilde = pairs[0]
            return
        sparse.destroy(*(self._combined or ()))
        self.B = pairs[0][0].copy()
        self.B.axpy(1.0, pairs[1][0])
        if self.multipliers.T is None:
            self.B_tilde = self.B
        else:
            self.B_tilde = pairs[0][1].copy()
            self.B_tilde.axpy(1.0, pairs[1][1])
        self._combined = self.B, self.B_tilde

    def _evaluate_laws(self, u, z, f_z, forced) -> None:
        B = self.B_contact
        old = moved = moved_old = None
        if self.B_old is not None:
            old = sparse.product(self.B_old, self._reference + u)
        if any(c.geometry == "reference" for c in self.contacts):
            moved = sparse.product(B, u)
            if self.B_old is not None:
                moved_old = sparse.product(B, self._accepted[1])
        for c in self.contacts:
            rows, n = self.multipliers.slice(c), c.num_owned
            gap, motion = c._nodal["gap"][:n], None
            if c.geometry == "reference":
                motion_total = moved[rows].reshape(-1, 3)
                gap = gap - np.sum(c._configuration.normals[:n] * motion_total, axis=1)
                if c.is_frictional:
                    motion = moved_old[rows].reshape(-1, 3) - motion_total
            elif c.is_frictional:
                motion = c._nodal["offset"][:n] - old[rows].reshape(-1, 3)
            state = None if forced is None else forced.get(id(c))
            c._set_arguments(z[rows].reshape(-1, 3).copy(), gap, motion, state)
            f_z[rows] = c._evaluate_law().ravel()

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
            f_z[self.multipliers.slice(c)] = c._evaluate_law(damped=True).ravel()
        return f_z

    def force_scale(self, stiffness: npt.NDArray) -> npt.NDArray[np.float64]:
        """Factors that make forces of the constraints, shape (size_z,).

        Args:
            stiffness: Diagonal of the tangent, shape (size_u,).
        """
        scale = np.ones(self.multipliers.size)
        for i in self.interfaces:
            weight = np.repeat(np.abs(i._weights[: i.num_owned]), 3)
            rows = self.multipliers.slice(i)
            if isinstance(i, Contact):
                scale[rows] = weight
            else:
                scale[rows] = stiffness[self.multipliers.own_dofs(i)] / weight
        return scale

    def constraint_measure(self, f_z: npt.NDArray, z: npt.NDArray, length: float) -> float:
        """Largest violation of a constraint, relative to displacements or tractions. Collective.

        Args:
            f_z: Residual of the constraints.
            z: Owned multipliers.
            length: Largest displacement on any rank.
        """
        worst = 0.0
        for i in self.interfaces:
            rows = self.multipliers.slice(i)
            values = np.abs(f_z[rows])
            if isinstance(i, Tie):
                active = self.multipliers.tied(i)
                weight = np.repeat(np.abs(i._nodal["weight"][: i.num_owned]), 3)
                jump = values[active] / weight[active]
                if length > 0:
                    worst = max(worst, float(np.max(jump, initial=0.0)) / length)
            else:
                violation = float(np.max(values, initial=0.0))
                worst = max(worst, violation / i._largest_traction(z[rows]))
        return self.comm.allreduce(worst, op=MPI.MAX)

    # -- What surrounds the iteration ------------------------------------------------

    def positions(self, u: npt.NDArray) -> npt.NDArray[np.float64]:
        """Positions of the owned nodes after displacements ``u``, shape (size_u,)."""
        return self._reference + u

    def is_held(self) -> bool:
        """Whether no body can move rigidly without contact. Collective."""
        return rigidity.is_held(self.layout, self.ties, self.fixed_dofs)

    def loose_motions(self, K: PETSc.Mat, u: npt.NDArray) -> npt.NDArray[np.float64]:
        """Rigid motions of the owned displacement dofs that contact alone resists. Collective.

        Args:
            K: Tangent of the bodies.
            u: Owned displacements.
        """
        x = self.positions(u)
        motions = rigidity.free_motions(self.layout, self.ties, self.fixed_dofs, x)
        return rigidity.unresisted(motions, K, self.fixed_dofs)

    def diagnose(self) -> str:
        """What may be behind a failure after contact was lost. Collective."""
        if self.contacts and not self.is_held():
            return (
                " No slave node is in contact, and without contact a body is not held: bring the "
                "surfaces together (check tags and search_distance), prescribe displacements, or "
                "choose initial_active."
            )
        return ""

    def resultants(self, contact: Contact, z: npt.NDArray, u: npt.NDArray):
        """Forces and moments of a contact. Collective.

        Args:
            contact: Contact.
            z: Owned multipliers.
            u: Owned displacements.

        Returns:
            Force on the slave, on the master, moment on the slave, on the master, shapes (3,).
        """
        c = contact
        D, M = self.multipliers.z_by_u(), self.multipliers.z_by_u()
        cpp.integrate(c._data, c._configuration, D=D, M=M)
        x = (self._reference + (u if c.geometry == "current" else 0.0)).reshape(-1, 3)
        own = z * self.multipliers.mask([c])
        forces, moments = [], []
        for A, sign in ((D, -1.0), (M, 1.0)):
            A.assemble()
            f = sign * sparse.product_transposed(A, own).reshape(-1, 3)
            forces.append(self.comm.allreduce(f.sum(axis=0)))
            moments.append(self.comm.allreduce(np.cross(x, f).sum(axis=0)))
            A.destroy()
        return *forces, *moments
