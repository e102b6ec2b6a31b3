# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Newton system of the bodies and their interfaces."""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx.common import Timer

from . import cpp, sparse
from .contact import OPEN, SLIP, STICK, Contact
from .coupling import Coupling
from .elimination import ActiveNodes


@dataclass
class NewtonSystem:
    """Blocks of the linearised system, rows of Dirichlet dofs not yet treated.

        (K + K_c) du + Bᵀ dz = r_u
        C_u du + C_z dz = r_z

    Attributes:
        K: Tangent of the bodies, n_u by n_u.
        K_c: Derivative of the contact forces, n_u by n_u, or None.
        B: Mortar matrix [D, -M], n_z by n_u.
        B_tilde: The same with slave columns in the transformed basis.
        T: Basis transformation minus the identity, n_u by n_u, or None where that vanishes.
        C_u: Derivative of the constraints by displacements, n_z by n_u; rows outside ``active``
            are empty.
        C_z: Derivative of the constraints by multipliers, n_z by n_z.
        active: Local multiplier dofs (ascending) whose constraint involves displacements.
        own: Local displacement dof of the node of each of ``active``.
        diagonal: Entry of D̃ of each of ``active``.
        nodes: The same node by node.
        fixed: Local displacement dofs with a Dirichlet condition.
        tied: True where all active constraints are ties (then K may be kept symmetric).
    """

    K: PETSc.Mat
    K_c: PETSc.Mat | None
    B: PETSc.Mat
    B_tilde: PETSc.Mat
    T: PETSc.Mat | None
    C_u: PETSc.Mat
    C_z: PETSc.Mat
    active: npt.NDArray[np.int32]
    own: npt.NDArray[np.int32]
    diagonal: npt.NDArray[np.float64]
    nodes: ActiveNodes
    fixed: npt.NDArray[np.int32]
    tied: bool

    def destroy(self) -> None:
        """Give up all matrices."""
        sparse.destroy(self.K, self.K_c, self.B, self.B_tilde, self.T, self.C_u, self.C_z)

    def multiply(
        self, u: npt.NDArray[np.float64], z: npt.NDArray[np.float64]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """The system's left-hand side for (du, dz); rows of Dirichlet dofs are unit rows."""
        f_u = sparse.product(self.K, u) + sparse.product_transposed(self.B, z)
        if self.K_c is not None:
            f_u += sparse.product(self.K_c, u)
        f_u[self.fixed] = u[self.fixed]
        return f_u, sparse.product(self.C_u, u) + sparse.product(self.C_z, z)


def linearise(coupling: Coupling, K: PETSc.Mat, z: npt.NDArray[np.float64]) -> NewtonSystem:
    """Newton system at the state of the last :meth:`Coupling.evaluate`. Collective.

    Args:
        coupling: Interfaces.
        K: Tangent of the bodies; the system takes it over.
        z: Owned multipliers.
    """
    m = coupling.multipliers
    if coupling.B is None:
        coupling.B, coupling.B_tilde = m.empty_B()
        coupling.B.assemble()
    nodes = _active_nodes(coupling)
    active = np.flatnonzero(nodes.flags).astype(np.int32)
    C_z = sparse.empty(m.comm, m.size, m.size)
    rows = _first_dofs(m.first, m.size // 3)
    cpp.add_blocks(C_z, rows, rows, nodes.dz)
    _add_couplings(C_z, m.first, m.first, 3, *nodes.couplings)
    C_z.assemble()

    K_c = None
    if coupling.contacts:
        with Timer("~mortar: linearise"):
            C_u, K_c = _contact_derivative(coupling, z)
    else:
        C_u = m.z_by_u()
        C_u.assemble()
    if coupling.B_ties is not None:
        mask = np.zeros(m.size)
        for tie in coupling.ties:
            mask[m.slice(tie)] = m.tied(tie)
        tied = sparse.scale_rows(coupling.B_ties[0].copy(), mask)
        C_u.axpy(1.0, tied)
        tied.destroy()
    return NewtonSystem(
        K=K,
        K_c=K_c,
        # A line search forms these anew at other points, while this system is in use
        B=sparse.share(coupling.B),
        B_tilde=sparse.share(coupling.B_tilde),
        T=sparse.share(m.T_minus_one),
        C_u=C_u,
        C_z=C_z,
        active=active,
        own=nodes.own[active // 3] + active % 3,
        diagonal=nodes.diagonal[active // 3],
        nodes=nodes,
        fixed=coupling.fixed_dofs,
        tied=not coupling.contacts,
    )


def _active_nodes(coupling: Coupling) -> ActiveNodes:
    """What is known node by node."""
    m = coupling.multipliers
    n = m.size // 3
    flags, stick = np.zeros((n, 3), dtype=bool), np.zeros(n, dtype=bool)
    blocks, directions, across = np.zeros((3, n, 3, 3))
    diagonal, own, normals = np.zeros(n), np.zeros(n, dtype=np.int32), np.zeros((n, 3))
    couplings = [(np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int32), np.empty((0, 3, 3)))]
    eye = np.eye(3)
    for i in coupling.interfaces:
        nodes, size = m.nodes(i), i.num_owned
        own[nodes] = m.own_dofs(i)[::3]
        diagonal[nodes] = i._nodal["diagonal"][:size]
        directions[nodes] = eye
        if isinstance(i, Contact):
            flags[nodes] = (i._status != OPEN)[:, None] & (i._fixed[:size] == 0)
            blocks[nodes] = i._law["dz"]
            normal, sliding = i._configuration.normals[:size], i._status == SLIP
            directions[nodes][sliding] = normal[sliding, :, None] * normal[sliding, None, :]
            if i.is_frictional:
                across[nodes] = _across_slip(i)
            normals[nodes], stick[nodes] = normal, i._status == STICK
            c = i._law["couplings"]
            couplings.append((nodes.start + c["rows"], nodes.start + c["columns"], c["dz"]))
        else:
            flags[nodes] = m.tied(i).reshape(-1, 3)
            blocks[nodes] = eye * ~flags[nodes][:, :, None]
    return ActiveNodes(
        size_u=coupling.layout.size_u,
        size_z=m.size,
        flags=flags,
        own=own,
        diagonal=diagonal,
        dz=blocks,
        couplings=tuple(np.concatenate(c) for c in zip(*couplings)),
        directions=directions,
        across=across,
        normals=normals,
        stick=stick,
    )


def _across_slip(c: Contact) -> npt.NDArray[np.float64]:
    """Stiffness of the law of friction at the owned nodes, see :class:`ActiveNodes`.

    Tractions turn with the motion: a node that has just begun to slip resists a motion across its
    direction nearly as one that sticks. Along it the traction only follows the pressure.
    """
    slips = c._status == SLIP
    slips[c._law["couplings"]["rows"]] = False  # the law of an edge is one of two nodes
    stiffness = np.zeros((c.num_owned, 3, 3))
    normals = c._configuration.normals[: c.num_owned][slips]
    axes = np.linalg.svd(normals[:, None, :])[2][:, 1:, :]  # two tangents as rows
    by_z, by_w = (axes @ c._law[k][slips] @ axes.transpose(0, 2, 1) for k in ("dz", "dw"))
    # Where slip begins the law does not depend on the traction across: the node sticks
    least = 1e-6 * np.maximum(np.sum(by_z**2, axis=(1, 2)), 1e-300)
    det = np.linalg.det(by_z)
    det = np.where(np.abs(det) < least, least, det)
    cofactors = np.trace(by_z, axis1=1, axis2=2)[:, None, None] * np.eye(2) - by_z
    S = cofactors @ by_w / det[:, None, None]
    values, vectors = np.linalg.eigh((S + S.transpose(0, 2, 1)) / 2)
    S = (vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.transpose(0, 2, 1)
    stiffness[slips] = axes.transpose(0, 2, 1) @ S @ axes
    return stiffness


def _first_dofs(first: int, n: int, size: int = 3) -> npt.NDArray[np.int64]:
    """First dofs of n blocks one after the other."""
    return first + size * np.arange(n, dtype=np.int64)


def _add_couplings(A: PETSc.Mat, row: int, column: int, size: int, rows, columns, blocks) -> None:
    """Add blocks between the patches at a node.

    Args:
        A: Matrix.
        row: Row of multiplier node 0.
        column: Column of multiplier node 0.
        size: Columns of a block.
        rows: Multiplier nodes, shape (k,).
        columns: Multiplier nodes, shape (k,).
        blocks: Shape (k, 3, size).
    """
    i, j = (np.asarray(x, dtype=np.int64) for x in (rows, columns))
    cpp.add_blocks(A, row + 3 * i, column + size * j, np.ascontiguousarray(blocks))


def _contact_derivative(
    coupling: Coupling, z: npt.NDArray[np.float64]
) -> tuple[PETSc.Mat, PETSc.Mat | None]:
    """Derivatives by displacements of the constraints of contacts, and of their forces.

    The constraints C depend on weighted gaps g, normals n and motions w,

        C_u = W_g (∂g/∂u + ∂g/∂n ∂n/∂u) + W_n ∂n/∂u + W_w ∂w/∂u.

    Returns:
        C_u, and ∂(Bᵀz)/∂u or None where all geometry is frozen.
    """
    m, comm = coupling.multipliers, coupling.comm
    n_u, n_z = coupling.layout.size_u, m.size
    n_n, first, first_n = n_z // 3, m.first, m.first // 3
    current = [c for c in coupling.contacts if c.geometry == "current"]
    frozen = [c for c in coupling.contacts if c.geometry == "reference"]
    frictional = [c for c in coupling.contacts if c.is_frictional]

    W_g, W_n = sparse.empty(comm, n_z, n_n), sparse.empty(comm, n_z, n_z)
    W_w = sparse.empty(comm, n_z, n_z) if frictional else None
    gap, gap_normal = sparse.empty(comm, n_n, n_u), sparse.empty(comm, n_n, n_z)
    normals = m.z_by_u()
    offset = m.z_by_u() if frictional else None
    force = sparse.empty(comm, n_u, n_u) if current else None
    against = sparse.empty(comm, n_n, n_z) if frozen else None
    for c in coupling.contacts:
        start, start_n = first + m.slice(c).start, first_n + m.nodes(c).start
        row, row_n = _first_dofs(start, c.num_owned), _first_dofs(start_n, c.num_owned, 1)
        law, both = c._law, c._law["couplings"]
        pairs = both["rows"], both["columns"]
        cpp.add_blocks(W_g, row, row_n, np.ascontiguousarray(law["dg"][:, :, None]))
        _add_couplings(W_g, start, start_n, 1, *pairs, both["dg"][:, :, None])
        cpp.add_blocks(W_n, row, row, law["dn"])
        _add_couplings(W_n, start, start, 3, *pairs, both["dn"])
        if W_w is not None:
            sign = 1.0 if c.geometry == "current" else -1.0
            cpp.add_blocks(W_w, row, row, sign * law["dw"])
            _add_couplings(W_w, start, start, 3, *pairs, sign * both["dw"])
        closed = c._status != OPEN
        if c.geometry == "reference":
            n = np.where(closed[:, None], -c._configuration.normals[: c.num_owned], 0.0)
            cpp.add_blocks(against, row_n, row, np.ascontiguousarray(n[:, None, :]))
            continue
        active = np.zeros(c.num_nodes, dtype=np.int8)
        active[: c.num_owned] = closed
        cpp.scatter_forward(c._surface_slave, active)
        cpp.integrate_derivatives(
            c._data,
            c._configuration,
            m.local(z, c),
            active,
            force=force,
            gap=gap,
            gap_normal=gap_normal,
            offset=offset if c.is_frictional else None,
        )
        cpp.differentiate_normals(c._data, c._configuration, normals)
    parts = [W_g, W_n, W_w, gap, gap_normal, normals, offset, against]
    for A in [*parts, force]:
        if A is not None:
            A.assemble()

    G = gap_normal.matMult(normals)
    G.axpy(1.0, gap)
    if frozen:
        F = against.matMult(coupling.B_contact)
        G.axpy(1.0, F)
        F.destroy()
    C_u = W_g.matMult(G)
    N = W_n.matMult(normals)
    C_u.axpy(1.0, N)
    if frictional:
        # Motion: offset - B_old x (current geometry), B u_old - B u (frozen)
        _add_rows(offset, -1.0, coupling.B_old, m.mask([c for c in current if c in frictional]))
        _add_rows(offset, 1.0, coupling.B_contact, m.mask([c for c in frozen if c in frictional]))
        S = W_w.matMult(offset)
        C_u.axpy(1.0, S)
        S.destroy()
    sparse.destroy(*parts, G, N)
    return C_u, force


def _add_rows(A: PETSc.Mat, factor: float, B: PETSc.Mat, mask: npt.NDArray[np.float64]) -> None:
    """Add the rows of B where mask is one, times a factor, to A. Collective."""
    if A.comm.tompi4py().allreduce(bool(np.any(mask))):
        R = sparse.scale_rows(B.copy(), mask)
        A.axpy(factor, R)
        R.destroy()
