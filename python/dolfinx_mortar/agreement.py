# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""What ranks do alike: they are given the same arguments, and raise together or not at all."""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from mpi4py import MPI


def common(comms: Sequence[MPI.Intracomm]) -> MPI.Intracomm:
    """The communicator that meshes share.

    Raises:
        ValueError: They do not have the same ranks in the same order.
    """
    for comm in comms[1:]:
        if MPI.Comm.Compare(comms[0], comm) not in (MPI.IDENT, MPI.CONGRUENT):
            raise ValueError(
                f"The meshes are on different communicators, of {comms[0].size} and {comm.size} "
                "ranks: make all meshes of a problem on the same one."
            )
    return comms[0]


@contextmanager
def alike(comm: MPI.Intracomm | None) -> Iterator[dict[str, Any]]:
    """A block that ranks leave alike: what one raises in it, all raise. Collective.

    Nothing inside may be collective: a rank that raises would let the others wait for it.

    Args:
        comm: Communicator, or None where there is none yet; then nothing is compared.

    Yields:
        A dictionary to be filled with what must be the same on all ranks: its name in a message,
        and a value whose ``repr`` says all.

    Raises:
        ValueError: A value differs between ranks.
    """
    values: dict[str, Any] = {}
    error = None
    try:
        yield values
    except BaseException as e:
        error = e
    if comm is not None:
        texts = {name: repr(value) for name, value in values.items()}
        gathered = comm.allgather((_portable(error), texts))
        first = next((r for r, (e, _) in enumerate(gathered) if e is not None), None)
        if first is None:
            error = _difference([texts for _, texts in gathered])
        elif first != comm.rank:
            error = gathered[first][0]
    if error is not None:
        raise error


def _portable(error: BaseException | None) -> BaseException | None:
    """The error, or one that says the same where it cannot be sent to another rank."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def _difference(values: Sequence[dict[str, str]]) -> ValueError | None:
    for name in {name: None for texts in values for name in texts}:
        first = values[0].get(name)
        for rank, texts in enumerate(values):
            if texts.get(name) != first:
                return ValueError(
                    f"{name} is {first} on rank 0, but {texts.get(name)} on rank {rank}: give it "
                    "the same value on all ranks."
                )
    return None
