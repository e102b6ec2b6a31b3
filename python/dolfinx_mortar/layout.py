# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Numbering of the unknowns of a coupled problem."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from . import compat, cpp, memory


class Layout:
    """Where the dofs of bodies and multipliers are in the vectors of a coupled problem.

    Displacements: the part of a rank is ``[body 0 owned, body 1 owned, ...]``. A *block* is the
    three components of a node, ``dof = 3 * block + component``.

    Args:
        spaces: Displacement space of each body.

    Attributes:
        comm: Communicator of all matrices and vectors.
        blocks: For each body the number of each local (owned and ghost) block.
        num_owned: For each body the number of owned blocks.
        num_local: For each body the number of local blocks.
        size_u: Number of displacement dofs of this rank.
    """

    def __init__(self, spaces: Sequence[fem.FunctionSpace]):
        self.spaces = list(spaces)
        self.comm = memory.communicator(self.spaces[0].mesh.comm)
        memory.free_forgotten(self.comm)
        self._scalar: dict[int, fem.FunctionSpace] = {}
        self._parts: dict[int, npt.NDArray[np.int64]] = {}
        maps = [V.dofmap.index_map for V in self.spaces]
        self.blocks = [
            np.asarray(b) for b in cpp.number_blocks([getattr(m, "_cpp_object", m) for m in maps])
        ]
        self.num_owned = [m.size_local for m in maps]
        self.num_local = [m.size_local + m.num_ghosts for m in maps]
        starts = np.cumsum([0, *self.num_owned])
        #: First displacement dof, of this rank's part, of each body
        self.starts = 3 * starts
        self.size_u = int(self.starts[-1])
        #: First displacement dof of this rank
        self.first_u = self.comm.exscan(self.size_u) or 0

    def local_start(self, body: int) -> int:
        """First of a body's local blocks in :meth:`all_local`."""
        return int(sum(self.num_local[:body]))

    def all_local(self, u: Sequence[fem.Function]) -> npt.NDArray[np.float64]:
        """Owned and ghost values of all bodies, one body after the other."""
        arrays = [f.x.array[: 3 * n] for f, n in zip(u, self.num_local)]
        return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)

    def scalar_space(self, body: int) -> fem.FunctionSpace:
        """Scalar space of the displacement's element; its dofs are the body's blocks."""
        if body not in self._scalar:
            self._scalar[body] = self.spaces[body].sub(0).collapse()[0]
        return self._scalar[body]

    def positions(self) -> npt.NDArray[np.float64]:
        """Reference positions of the owned dofs of all bodies, shape ``(size_u,)``."""
        return np.concatenate(
            [V.tabulate_dof_coordinates()[:n].ravel() for V, n in zip(self.spaces, self.num_owned)]
        )

    def separate_bodies(self, body: int) -> npt.NDArray[np.int64]:
        """Number of the connected part of the mesh that each owned block is on. Collective.

        One mesh may hold several disconnected bodies.
        """
        if body in self._parts:
            return self._parts[body]
        V = self.spaces[body]
        dofs = V.dofmap.list
        num = self.num_local[body]
        rows = np.repeat(dofs[:, 0], dofs.shape[1])
        graph = coo_matrix((np.ones(dofs.size), (rows, dofs.ravel())), shape=(num, num))
        _, local = connected_components(graph, directed=False)
        # Local parts that share a node across ranks are one
        vector = la.vector(V.dofmap.index_map, 1, dtype=np.float64)
        mine = local + 1e6 * self.comm.rank
        vector.array[:] = mine
        vector.scatter_forward()
        pairs = np.unique(np.column_stack([mine, vector.array]), axis=0)
        pairs = np.vstack(self.comm.allgather(pairs))
        names, index = np.unique(pairs, return_inverse=True)
        index = index.reshape(-1, 2)
        graph = coo_matrix(
            (np.ones(len(index)), (index[:, 0], index[:, 1])), shape=(len(names), len(names))
        )
        _, part = connected_components(graph, directed=False)
        label = part[np.searchsorted(names, mine)].astype(np.int64)
        self._parts[body] = label[: self.num_owned[body]]
        return self._parts[body]

    def forward(self, body: int, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Copy rows of owned blocks of a body to their ghosts, shape (n, columns). Collective."""
        columns = values.shape[1]
        vector = la.vector(self.spaces[body].dofmap.index_map, columns, dtype=np.float64)
        vector.array[:] = values.ravel()
        vector.scatter_forward()
        return vector.array.reshape(-1, columns).copy()

    def complete(self, body: int, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Fill rows that are NaN (on any rank) with the values other ranks have. Collective."""
        columns = values.shape[1]
        known = ~np.isnan(values).any(axis=1)
        vector = la.vector(self.spaces[body].dofmap.index_map, columns + 1, dtype=np.float64)
        array = vector.array.reshape(-1, columns + 1)
        array[:, :columns] = np.where(known[:, None], values, 0.0)
        array[:, columns] = known
        vector.scatter_reverse(la.InsertMode.add)
        array = vector.array.reshape(-1, columns + 1)
        owned = self.num_owned[body]
        count = np.maximum(array[:owned, columns:], 1.0)
        # Ranks agree on the values of a node; do not let an average round
        mean = array[:owned, :columns] / count
        out = np.zeros_like(values)
        out[:owned] = np.where(known[:owned, None], values[:owned], mean)
        return self.forward(body, out)

    def body(self, V: fem.FunctionSpace) -> int:
        """Index of the body that a space belongs to.

        Raises:
            ValueError: The space is none of the problem's.
        """
        for b, W in enumerate(self.spaces):
            if W is V or W == V:
                return b
        raise ValueError(
            "An interface is on a function space that is not the space of one of the problem's "
            "unknowns: give it the space of u."
        )

    def gather(self, u: Sequence[fem.Function]) -> npt.NDArray[np.float64]:
        """Owned values of all bodies, shape ``(size_u,)``."""
        return np.concatenate([f.x.array[: 3 * n] for f, n in zip(u, self.num_owned)])

    def scatter(self, values: npt.NDArray[np.float64], u: Sequence[fem.Function]) -> None:
        """Set functions, ghosts included, from owned values of shape ``(size_u,)``. Collective."""
        for b, f in enumerate(u):
            f.x.array[: 3 * self.num_owned[b]] = values[self.starts[b] : self.starts[b + 1]]
            f.x.scatter_forward()

    def prescribed(self, bcs: Sequence[fem.DirichletBC]) -> list[npt.NDArray[np.int8]]:
        """Flags of dofs with a Dirichlet condition, for each body all local dofs.

        Raises:
            ValueError: A condition is on none of the problem's spaces.
        """
        flags = [np.zeros(3 * n, dtype=np.int8) for n in self.num_local]
        for bc in bcs:
            flags[self.body_of_bc(bc)][bc.dof_indices()[0]] = 1
        return flags

    def prescribed_values(self, bcs: Sequence[fem.DirichletBC]) -> npt.NDArray[np.float64]:
        """Values of Dirichlet conditions at the owned dofs, else zero, shape ``(size_u,)``."""
        values = [np.zeros(3 * n) for n in self.num_local]
        for bc in bcs:
            compat.set_bc_values(bc, values[self.body_of_bc(bc)])
        return np.concatenate([v[: 3 * n] for v, n in zip(values, self.num_owned)])

    def body_of_bc(self, bc: fem.DirichletBC) -> int:
        """Index of the body that a Dirichlet condition is on."""
        space = bc.function_space
        space = getattr(space, "_cpp_object", space)
        for b, V in enumerate(self.spaces):
            if V._cpp_object == space or V._cpp_object.contains(space):
                return b
        raise ValueError("A Dirichlet condition is on a space of none of the problem's unknowns.")
