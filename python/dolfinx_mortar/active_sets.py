# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""States of contact nodes in the course of Newton's iteration."""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from .contact import OPEN, SLIP, STICK, Contact


class ActiveSets:
    """States of all contact nodes, one record for each Newton iteration.

    Args:
        comm: Communicator.
        contacts: Contacts of the problem.
    """

    def __init__(self, comm, contacts: Sequence[Contact]):
        self.comm = comm
        self.contacts = list(contacts)
        self._records: list[npt.NDArray[np.int8]] = []

    def _present(self) -> npt.NDArray[np.int8]:
        states = [c._status for c in self.contacts]
        return np.concatenate(states) if states else np.empty(0, dtype=np.int8)

    def clear(self) -> None:
        """Begin a new iteration."""
        self._records = []

    def counts(self) -> dict[str, int]:
        """Numbers of nodes in contact. Collective."""
        s = self._present()
        counts = [int(np.sum(s != OPEN)), int(np.sum(s == STICK)), int(np.sum(s == SLIP))]
        total = self.comm.allreduce(np.array(counts))
        return {"active": int(total[0]), "stick": int(total[1]), "slip": int(total[2])}

    def record(self) -> int:
        """Note the present states; number of nodes that changed. Collective."""
        s = self._present()
        before = self._records[-1] if self._records else np.full_like(s, OPEN)
        self._records.append(s.copy())
        return self.comm.allreduce(int(np.sum(s != before)))

    def undecided(self, z: Sequence[npt.NDArray[np.float64]], rtol: float) -> bool:
        """Whether all nodes that just changed have neither gap nor traction. Collective.

        Round-off moves such nodes to and fro; either state solves the problem.

        Args:
            z: Multipliers of the owned nodes of each contact, shape (num_owned, 3).
            rtol: Relative tolerance of the iteration.
        """
        if len(self._records) < 2:
            return False
        ok = True
        start = 0
        for c, zc in zip(self.contacts, z):
            part = slice(start, start + c.num_owned)
            start = part.stop
            changed = self._records[-1][part] != self._records[-2][part]
            largest = c._largest_traction(zc)
            zn = np.abs(np.sum(zc * c._configuration.normals[: c.num_owned], axis=1))
            cg = np.abs(c._c_n * c._gap_weighted)
            switching = np.maximum(zn, cg) <= 100 * rtol * largest
            if c.is_frictional:
                switching |= (c._status != OPEN) & (zn > 0)
            ok = ok and bool(np.all(switching[changed]))
        return self.comm.allreduce(ok, op=MPI.LAND)

    def cycling(self) -> bool:
        """Whether the states come back to earlier ones, with a period of 2 to 5. Collective."""
        r = self._records
        for period in range(2, 6):
            repeats = len(r) > 2 * period and all(
                np.array_equal(r[-1 - k], r[-1 - k - period]) for k in range(period)
            )
            moves = repeats and any(not np.array_equal(r[-1 - k], r[-2 - k]) for k in range(period))
            # The states of all ranks together have the period
            if self.comm.allreduce(repeats, op=MPI.LAND) and self.comm.allreduce(moves, op=MPI.LOR):
                return True
        return False
