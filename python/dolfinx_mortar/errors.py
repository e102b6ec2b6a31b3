# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Errors that users may want to catch."""


class ConvergenceError(RuntimeError):
    """A solve did not converge.

    Displacements, multipliers and active sets are as they were before it.

    Attributes:
        history: One dictionary per Newton iteration, see ``ContactProblem.history``.
    """

    def __init__(self, message: str, history: list[dict] | None = None):
        super().__init__(message)
        self.history = history or []
