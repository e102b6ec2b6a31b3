# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""When the memory of PETSc objects comes back.

Ranks free a PETSc object together, but Python forgets objects on each rank when it likes. PETSc
keeps what Python has forgotten, communicator by communicator, until it is asked to free what all
ranks have forgotten. With a mesh its communicator goes, and nobody could ask any more. So our
matrices and vectors are made on communicators that stay, and what DOLFINx makes is kept here.
"""

from __future__ import annotations

import itertools
import weakref
from collections.abc import Sequence
from typing import Any, TypeVar

from mpi4py import MPI
from petsc4py import PETSc

_T = TypeVar("_T", bound="Destroyable")
_communicators: list[MPI.Intracomm] = []
_counter = itertools.count()
#: Owner, and what holds its PETSc objects, by communicator and number
_kept: dict[int, dict[int, tuple[weakref.ref, Handle]]] = {}


def communicator(comm: MPI.Intracomm) -> MPI.Intracomm:
    """The communicator, of the same ranks in the same order, for all objects. Collective."""
    for known in _communicators:
        if MPI.Comm.Compare(known, comm) in (MPI.IDENT, MPI.CONGRUENT):
            return known
    _communicators.append(comm.Dup())
    return _communicators[-1]


def keep(owner: object, comm: MPI.Intracomm, obj: Any) -> Handle:
    """Keep what holds PETSc objects until all ranks have forgotten its owner. Collective.

    Args:
        owner: What needs it.
        comm: From :func:`communicator`.
        obj: What is kept.

    Returns:
        What holds it; to destroy that is to give it up.
    """
    handle = Handle(obj)
    _kept.setdefault(id(comm), {})[comm.bcast(next(_counter))] = weakref.ref(owner), handle
    return handle


def free_forgotten(comm: MPI.Intracomm, others: Sequence[MPI.Intracomm] = ()) -> None:
    """Free PETSc objects that Python has forgotten on all ranks. Collective.

    Args:
        comm: From :func:`communicator`.
        others: Communicators of the same ranks that may have such objects, as of vectors made from
            the matrix of a mesh.
    """
    kept = _kept.get(id(comm), {})
    mine = {number for number, (owner, _) in kept.items() if owner() is None}
    for number in sorted(set.intersection(*comm.allgather(mine))):
        kept.pop(number)[1].destroy()
    if comm.size > 1:  # one rank alone frees at once what it forgets
        for c in (comm, *others):
            PETSc.garbage_cleanup(c)


class Handle:
    """Holds an object until it is destroyed.

    Attributes:
        object: The object, or None.
    """

    def __init__(self, obj: Any):
        self.object: Any = obj

    def destroy(self) -> None:
        """Give up the object."""
        self.object = None


class Destroyable:
    """What holds PETSc objects and can be destroyed: ``_free`` destroys them.

    Attributes:
        comm: From :func:`communicator`.
    """

    comm: MPI.Intracomm
    _destroyed = False

    def _free(self) -> None:
        raise NotImplementedError

    def destroy(self) -> None:
        """Free matrices and solvers. Collective.

        The fields of the interfaces stay as they are, and nothing else can be done with them or
        with the problem. A problem that is dropped instead is freed by a later one, or by a later
        solve, on the same ranks. ``with ContactProblem(...) as problem:`` destroys it at the end.
        """
        if not self._destroyed:
            self._free()
            self._destroyed = True
            free_forgotten(self.comm)

    def _check_alive(self) -> None:
        if self._destroyed:
            raise RuntimeError(
                "The ContactProblem has been destroyed: only the fields of its interfaces are left."
            )

    def __enter__(self: _T) -> _T:
        return self

    def __exit__(self, kind: type | None, *_: object) -> None:
        if kind is None:  # other ranks may not know of an exception
            self.destroy()
