# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Bounds of the tangential traction."""

from __future__ import annotations

from typing import Any

from dolfinx import fem

from . import arguments


class Frictional:
    """Coulomb's or Tresca's friction, whose numbers may change from one solve to the next."""

    _friction: float | fem.Constant | None
    _tresca: float | fem.Constant | None

    @property
    def friction(self) -> float | fem.Constant:
        """Coulomb's coefficient μ. May be changed between solves, alike on all ranks."""
        return 0.0 if self._friction is None else self._friction

    @friction.setter
    def friction(self, value: float | fem.Constant | None) -> None:
        self._friction = arguments.bound("friction", value)

    @property
    def tresca(self) -> float | fem.Constant | None:
        """Tresca's bound [traction] or None. May be changed between solves, as friction."""
        return self._tresca

    @tresca.setter
    def tresca(self, value: float | fem.Constant | None) -> None:
        self._tresca = arguments.bound("tresca", value)

    def _friction_arguments(self) -> dict[str, Any]:
        """What friction is at present, to be the same on all ranks.

        Raises:
            ValueError: A value that a user has changed meanwhile can not be.
        """
        friction = arguments.bound("friction", self._friction)
        tresca = arguments.bound("tresca", self._tresca)
        if arguments.value(friction) and tresca is not None:
            raise ValueError("Give either friction (Coulomb) or tresca, not both.")
        return {"friction": arguments.value(friction), "tresca": arguments.value(tresca)}

    @property
    def is_frictional(self) -> bool:
        """Tangential tractions are possible."""
        return bool(arguments.value(self._friction)) or self._tresca is not None
