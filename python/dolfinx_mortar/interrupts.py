# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Ctrl-C while PETSc is at work.

Python raises KeyboardInterrupt wherever it happens to be. Out of a function that PETSc has called
that leaves vectors locked, and on one rank alone it leaves the others waiting.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from mpi4py import MPI

from . import agreement


class Interrupts:
    """Interrupts that wait for a place where work may end.

    Args:
        handler: What Python would have called at once.
    """

    def __init__(self, handler: Any):
        self._handler = handler
        self._pending = False

    def note(self, *_: object) -> None:
        """Remember that there was one."""
        self._pending = True

    def handle(self) -> None:
        """Do now what should have been done."""
        if self._pending:
            self._pending = False
            self._handler(signal.SIGINT, None)

    def handle_together(self, comm: MPI.Intracomm) -> None:
        """The same, and raise on all ranks what it raises on one. Collective."""
        with agreement.alike(comm):
            self.handle()

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """A block in which interrupts do not wait."""
        waiting = signal.getsignal(signal.SIGINT) == self.note
        if waiting:
            signal.signal(signal.SIGINT, self._handler)
        try:
            yield
        finally:
            if waiting:
                signal.signal(signal.SIGINT, self.note)


@contextmanager
def deferred() -> Iterator[Interrupts]:
    """Let interrupts wait to the end of a block, or until they are handled inside."""
    handler = signal.getsignal(signal.SIGINT)
    interrupts = Interrupts(handler)
    # Only the main thread gets signals; a handler that is no function is not Python's
    if not callable(handler) or threading.current_thread() is not threading.main_thread():
        yield interrupts
        return
    signal.signal(signal.SIGINT, interrupts.note)
    try:
        yield interrupts
    finally:
        signal.signal(signal.SIGINT, handler)
        interrupts.handle()
