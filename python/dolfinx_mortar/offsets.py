# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""What is added to the gap of a contact, evaluated at the slave nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from . import arguments, compat


class Offset:
    """An offset as a user gives it, and its values when a solve begins.

    Args:
        given: None, a number, or a scalar ``fem.Constant``, ``fem.Function`` or UFL expression on
            the mesh of the slave; where the slave surface is on several bodies also a list of
            these, one for each body.

    Raises:
        ValueError: It is none of these, or not a scalar.
    """

    def __init__(self, given: Any):
        self.given = given
        self._parts = [_checked(part) for part in arguments.as_list(given)]
        self._expressions: dict[int, fem.Expression] = {}

    def numbers(self) -> list:
        """What must be the same on all ranks: present numbers, and kinds of other parts."""
        present = [arguments.value(p) if _is_uniform(p) else type(p).__name__ for p in self._parts]
        return [arguments.number("offset", p) if isinstance(p, float) else p for p in present]

    def values(
        self, spaces: Sequence[fem.FunctionSpace], local_blocks: npt.NDArray
    ) -> npt.NDArray[np.float64]:
        """Values at local slave nodes; empty for no offset. Collective.

        Args:
            spaces: Scalar spaces of the slave bodies.
            local_blocks: Number of each slave node among the local dofs of these, body after body.

        Raises:
            ValueError: There are not as many parts as bodies, or one is on another mesh.
        """
        if self.given is None:
            return np.empty(0)
        if len(self._parts) not in (1, len(spaces)) or (
            len(spaces) > 1 and len(self._parts) == 1 and not _is_uniform(self._parts[0])
        ):
            raise ValueError(
                f"The slave surface is on {len(spaces)} bodies: offset must be a number, or a "
                "list with one part for each of them."
            )
        parts = self._parts * (len(spaces) // len(self._parts))
        at_dofs = [self._interpolated(k, p, W) for k, (p, W) in enumerate(zip(parts, spaces))]
        return np.concatenate(at_dofs)[local_blocks]

    def _interpolated(self, k: int, part: Any, W: fem.FunctionSpace) -> npt.NDArray[np.float64]:
        f = fem.Function(W)
        if _is_uniform(part):
            f.x.array[:] = 0.0 if part is None else arguments.value(part)
            return f.x.array
        domain = ufl.domain.extract_unique_domain(part)
        if domain is not None and domain is not W.mesh.ufl_domain():
            raise ValueError("offset is on another mesh than the slave surface.")
        if k not in self._expressions:
            self._expressions[k] = fem.Expression(part, compat.interpolation_points(W))
        f.interpolate(self._expressions[k])
        f.x.scatter_forward()
        return f.x.array


def _is_uniform(part: Any) -> bool:
    return part is None or isinstance(part, float | fem.Constant)


def _checked(part: Any) -> Any:
    if part is None:
        return None
    if isinstance(part, ufl.core.expr.Expr):
        if part.ufl_shape != ():
            raise ValueError(f"offset has the shape {part.ufl_shape}, but must be a scalar.")
        return part
    return arguments.number("offset", part)
