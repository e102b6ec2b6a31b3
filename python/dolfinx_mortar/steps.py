# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Load steps that are cut where they do not converge."""

from __future__ import annotations

from collections.abc import Callable

from mpi4py import MPI

from . import agreement
from .errors import ConvergenceError
from .interrupts import Interrupts


def solve_in_parts(
    solve: Callable[[], int],
    load: Callable[[float], None],
    max_cuts: int,
    comm: MPI.Comm,
    interrupts: Interrupts,
) -> int:
    """Solve a step, in parts where it does not converge as a whole. Collective.

    Args:
        solve: Solves for the present loads; number of Newton iterations.
        load: User's function that sets loads for a fraction of the step.
        max_cuts: How often a step may be halved.
        comm: Communicator.
        interrupts: Interrupts that wait while ``solve`` is at work.

    Returns:
        Number of Newton iterations of the parts that converged.

    Raises:
        ConvergenceError: The smallest part does not converge.
    """
    done, part, total = 0.0, 1.0, 0
    while done < 1.0:
        target = min(1.0, done + part)
        with agreement.alike(comm), interrupts.at_once():
            load(target)
        try:
            total += solve()
        except ConvergenceError:
            part /= 2
            if part < 0.5**max_cuts:
                raise
            continue
        done = target
        part = min(2 * part, 1.0 - done) if done < 1.0 else part
    return total
