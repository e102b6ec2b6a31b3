# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Elimination of multipliers, node by node.

With ρ = Tᵀ (r_u - K du) at a slave node, D̃_p the entries of D̃ of its active multipliers z_p and c =
r_z - C_u du the constraints, the multipliers of the node satisfy

    Σ_p D̃_p dz_p = ρ,    C_z dz = c.

A node has one multiplier, and more only where it is in contact on several patches at an edge. With
one, dz = ρ / D̃, and what is left for du is c - C_z D̃⁻¹ ρ = 0. In general

    dz = L ρ + L_c c,    G c - H ρ = 0

where [L_c, L] is a left inverse of the matrix of the equations above, and [G, -H] spans its left
null space. All of it is local to the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from . import sparse


@dataclass
class ActiveNodes:
    """Multipliers in contact (or tied) and the displacement nodes they are at.

    Attributes:
        size_u, size_z: Numbers of displacement and multiplier dofs of this rank.
        flags: Flags of the active dofs of each multiplier node, shape (n, 3).
        own: First local displacement dof of the node of each multiplier node, shape (n,).
        diagonal: Entry of D̃ of each multiplier node, shape (n,).
        dz: Derivative of the constraints by the multipliers of the same node, shape (n, 3, 3).
        couplings: The same by those of another patch at the same displacement node: rows, columns
            (multiplier nodes, shape (k,)) and blocks, shape (k, 3, 3).
        directions: Directions of the constraints of each multiplier node, shape (n, 3, 3).
        across: What friction resists across the direction of slip: traction per weighted relative
            motion, symmetric and not negative, shape (n, 3, 3).
        normals: Normals of the multiplier nodes, shape (n, 3); of nodes that share a displacement
            node only.
        stick: Flags of multiplier nodes that stick, shape (n,).
    """

    size_u: int
    size_z: int
    flags: npt.NDArray[np.bool_]
    own: npt.NDArray[np.int32]
    diagonal: npt.NDArray[np.float64]
    dz: npt.NDArray[np.float64]
    couplings: tuple[npt.NDArray[np.int32], npt.NDArray[np.int32], npt.NDArray[np.float64]]
    directions: npt.NDArray[np.float64]
    across: npt.NDArray[np.float64]
    normals: npt.NDArray[np.float64]
    stick: npt.NDArray[np.bool_]

    def groups(self) -> list[npt.NDArray[np.int64]]:
        """Active multiplier nodes that share a displacement node, each list of one size.

        Returns:
            For each number m > 1 of patches at a node that occurs, nodes of shape (k, m).
        """
        nodes = np.flatnonzero(self.flags.any(axis=1))
        nodes = nodes[np.argsort(self.own[nodes], kind="stable")]
        _, first, count = np.unique(self.own[nodes], return_index=True, return_counts=True)
        return [nodes[first[count == m][:, None] + np.arange(m)] for m in np.unique(count) if m > 1]


@dataclass
class Elimination:
    """The matrices of the module, and what a preconditioner needs of the constraints.

    Attributes:
        G: Displacement by multiplier dofs.
        H: Displacement by displacement dofs.
        L: Multiplier by displacement dofs.
        L_c: Multiplier by multiplier dofs; None where no node has several multipliers.
        D: Entries of B̃ᵀ at the multipliers' own dofs: displacement by multiplier dofs.
        solve_constraints: du = - `solve_constraints` B̃ du satisfies the constraints at their own
            dofs, as far as these are constraints on displacements.
        constrained: Projection of displacements on the directions of the constraints.
        weight: Sum of D̃ over the multipliers at each displacement dof, zero at others.
    """

    G: PETSc.Mat
    H: PETSc.Mat
    L: PETSc.Mat
    L_c: PETSc.Mat | None
    D: PETSc.Mat
    solve_constraints: PETSc.Mat
    constrained: npt.NDArray[np.float64]
    weight: npt.NDArray[np.float64]

    def destroy(self) -> None:
        """Free the matrices."""
        sparse.destroy(self.G, self.H, self.L, self.L_c, self.D, self.solve_constraints)


class _Entries:
    """Entries of a matrix, collected block by block."""

    def __init__(self):
        self._i, self._j, self._v = [], [], []

    def add(self, i: npt.NDArray, j: npt.NDArray, values: npt.NDArray) -> None:
        """Add blocks.

        Args:
            i: Local rows, shape (k, r).
            j: Local columns, shape (k, c).
            values: Blocks, shape (k, r, c).
        """
        self._i.append(np.broadcast_to(i[:, :, None], values.shape).ravel())
        self._j.append(np.broadcast_to(j[:, None, :], values.shape).ravel())
        self._v.append(values.ravel())

    def matrix(self, comm, rows: int, columns: int) -> PETSc.Mat:
        """The matrix, without entries that are zero."""
        i, j, v = (np.concatenate(x) for x in (self._i, self._j, self._v))
        used = v != 0
        return sparse.local_entries(comm, rows, columns, i[used], j[used], v[used])


def eliminate(comm, nodes: ActiveNodes) -> Elimination:
    """Eliminate the active multipliers. Collective."""
    names = ("G", "H", "L", "L_c", "D", "solve")
    entries = {name: _Entries() for name in names}
    weight = np.zeros(nodes.size_u)
    constrained = np.zeros((nodes.size_u // 3, 3, 3))
    active = nodes.flags.any(axis=1)
    groups = nodes.groups()
    alone = active.copy()
    for group in groups:
        alone[group.ravel()] = False
    _add_single(nodes, np.flatnonzero(alone), entries, weight, constrained)
    for group in groups:
        _add_group(nodes, group, entries, weight, constrained)
    n_u, n_z = nodes.size_u, nodes.size_z
    several = sparse.any_rank(comm, len(groups) > 0)
    return Elimination(
        G=entries["G"].matrix(comm, n_u, n_z),
        H=entries["H"].matrix(comm, n_u, n_u),
        L=entries["L"].matrix(comm, n_z, n_u),
        L_c=_with_none(entries["L_c"]).matrix(comm, n_z, n_z) if several else None,
        D=entries["D"].matrix(comm, n_u, n_z),
        solve_constraints=entries["solve"].matrix(comm, n_u, n_z),
        constrained=constrained,
        weight=weight,
    )


def _with_none(entries: _Entries) -> _Entries:
    """The same; without this a rank that has added nothing would have nothing to concatenate."""
    empty = np.zeros((0, 0), dtype=np.int64)
    entries.add(empty, empty, np.zeros((0, 0, 0)))
    return entries


def _dofs(first: npt.NDArray) -> npt.NDArray[np.int64]:
    return first[:, None] + np.arange(3)


def _diagonal(flags: npt.NDArray, values: npt.NDArray) -> npt.NDArray[np.float64]:
    """Diagonal blocks with a value where a flag is set, shape (k, 3, 3)."""
    return np.where(flags, values[:, None], 0.0)[:, :, None] * np.eye(3)


def _add_single(nodes: ActiveNodes, j: npt.NDArray, entries, weight, constrained) -> None:
    """Nodes with one multiplier."""
    flags, d = nodes.flags[j], nodes.diagonal[j]
    u, z = _dofs(nodes.own[j]), _dofs(3 * j)
    both = flags[:, :, None] & flags[:, None, :]
    with np.errstate(divide="ignore"):
        inverse = 1.0 / d
    entries["G"].add(u, z, _diagonal(flags, np.ones(len(j))))
    entries["H"].add(u, u, np.where(both, nodes.dz[j] * inverse[:, None, None], 0.0))
    entries["L"].add(z, u, _diagonal(flags, inverse))
    entries["D"].add(u, z, _diagonal(flags, d))
    directions = np.where(both, nodes.directions[j], 0.0)
    entries["solve"].add(u, z, directions * inverse[:, None, None])
    constrained[nodes.own[j] // 3] = directions
    weight[u] = np.where(flags, d[:, None], 0.0)


def _add_group(nodes: ActiveNodes, group: npt.NDArray, entries, weight, constrained) -> None:
    """Nodes with several multipliers, shape (k, m)."""
    k, m = group.shape
    own = nodes.own[group[:, 0]]
    u = _dofs(own)
    z = (3 * group[:, :, None] + np.arange(3)).reshape(k, 3 * m)
    flags = nodes.flags[group[:, 0]]
    d = nodes.diagonal[group]
    total = d.sum(axis=1)
    weight[u] = np.where(flags, total[:, None], 0.0)
    C_z = _group_blocks(nodes, group)
    solve, projection, along = _group_directions(nodes, group)
    constrained[own // 3] = projection
    blocks = {
        "G": np.zeros((k, 3, 3 * m)),
        "H": np.zeros((k, 3, 3)),
        "L": np.zeros((k, 3 * m, 3)),
        "L_c": np.zeros((k, 3 * m, 3 * m)),
    }
    for i in range(k):
        # A component that is prescribed at the node is so for all its multipliers
        free = np.flatnonzero(flags[i])
        all_free = (3 * np.arange(m)[:, None] + free).ravel()
        own_entries = np.hstack([x * np.eye(len(free)) for x in d[i]])
        S = np.vstack([C_z[i][np.ix_(all_free, all_free)], own_entries / total[i]])
        n = len(free)
        left = np.linalg.svd(S)[0][:, -n:].T
        # Rows that look at the normals of their own patches, and at no other direction twice
        test = [np.outer(v, v) + along[i] for v in nodes.normals[group[i]]]
        test = np.vstack([t[np.ix_(free, free)] for t in test])
        left = np.linalg.solve(left[:, : n * m] @ test, left)
        inverse = np.linalg.pinv(S)
        blocks["G"][i][np.ix_(free, all_free)] = left[:, : n * m]
        blocks["H"][i][np.ix_(free, free)] = -left[:, n * m :] / total[i]
        blocks["L"][i][np.ix_(all_free, free)] = inverse[:, n * m :] / total[i]
        blocks["L_c"][i][np.ix_(all_free, all_free)] = inverse[:, : n * m]
    entries["G"].add(u, z, blocks["G"])
    entries["H"].add(u, u, blocks["H"])
    entries["L"].add(z, u, blocks["L"])
    entries["L_c"].add(z, z, blocks["L_c"])
    for p in range(m):
        z_p = _dofs(3 * group[:, p])
        entries["D"].add(u, z_p, _diagonal(flags, d[:, p]))
        entries["solve"].add(u, z_p, solve[:, p])


def _group_blocks(nodes: ActiveNodes, group: npt.NDArray) -> npt.NDArray[np.float64]:
    """C_z of the nodes of groups, shape (k, 3 m, 3 m)."""
    k, m = group.shape
    C_z = np.zeros((k, m, 3, m, 3))
    place = np.full((len(nodes.own), 2), -1)
    for p in range(m):
        C_z[:, p, :, p, :] = nodes.dz[group[:, p]]
        place[group[:, p]] = np.column_stack([np.arange(k), np.full(k, p)])
    for row, column, block in zip(*nodes.couplings):
        i, p = place[row]
        if i >= 0:
            C_z[i, p, :, place[column][1], :] = block
    return C_z.reshape(k, 3 * m, 3 * m)


def _group_directions(
    nodes: ActiveNodes, group: npt.NDArray
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Directions of the constraints of groups of nodes.

    Returns:
        Blocks of `solve_constraints`, shape (k, m, 3, 3); projections on the constrained
        directions, shape (k, 3, 3); projections on those that are tangential to all patches.
    """
    k, m = group.shape
    solve, projection, along = np.zeros((k, m, 3, 3)), np.zeros((k, 3, 3)), np.zeros((k, 3, 3))
    for i, members in enumerate(group):
        free = nodes.flags[members[0]].astype(float)
        n = nodes.normals[members] * free
        dual = np.linalg.pinv(n).T
        projection[i] = dual.T @ n
        d = nodes.diagonal[members]
        solve[i] = dual[:, :, None] * n[:, None, :] / d[:, None, None]
        along[i] = np.eye(3) - projection[i]
        if m == 2 and nodes.stick[members].all():
            # The law of friction along the edge is that of one patch
            lead = np.argmax(d)
            stuck = np.diag(free) @ along[i]
            solve[i, lead] += stuck / d[lead]
            projection[i] += stuck
    return solve, projection, along
