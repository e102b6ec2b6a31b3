# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Checks of what a user hands over, argument by argument.

What is asked for is returned. If something else is given, a ValueError says what it must be.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem


def as_list(x: Any) -> list:
    """Return the items of a list or tuple, or the one item that x is."""
    return list(x) if isinstance(x, list | tuple) else [x]


def _is_number(value: Any) -> bool:
    real = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    return real and bool(np.isfinite(value))


def number(name: str, value: Any) -> float:
    """Return a finite number."""
    if not _is_number(value):
        raise ValueError(f"{name} is {value!r}, but must be a finite number.")
    return float(value)


def positive(name: str, value: Any, what: str = "") -> float | None:
    """Return a positive number, or None.

    Args:
        name: Name of the argument.
        value: What is given.
        what: What the number is, with its unit.
    """
    if value is None:
        return None
    if not _is_number(value) or value <= 0:
        raise ValueError(
            f"{name} is {value!r}, but must be a positive number{what and f', {what}'}."
        )
    return float(value)


def whole(name: str, value: Any, low: int, high: int | None = None) -> int:
    """Return a whole number within bounds."""
    if not isinstance(value, int | np.integer) or isinstance(value, bool):
        raise ValueError(f"{name} is {value!r}, but must be a whole number.")
    if value < low or (high is not None and value > high):
        least = "positive" if low == 1 else f"{low} at least"
        most = "" if high is None else f", and {high} at most"
        raise ValueError(f"{name} is {value}, but must be {least}{most}.")
    return int(value)


def choice(name: str, value: Any, options: Iterable[str]) -> str:
    """Return one of several words."""
    options = list(options)
    if not isinstance(value, str) or value not in options:
        raise ValueError(
            f"{name} is {value!r}, but must be one of {', '.join(map(repr, options))}."
        )
    return value


def value(x: float | fem.Constant | None) -> float | None:
    """Return the present value of a number or a constant."""
    return float(x.value) if isinstance(x, fem.Constant) else x


def bound(name: str, x: Any) -> float | fem.Constant | None:
    """Return a finite number that is not negative, a constant whose value is one, or None."""
    if x is None:
        return None
    constant = isinstance(x, fem.Constant)
    if constant and np.shape(x.value) != ():
        raise ValueError(f"{name} is a Constant of shape {x.value.shape}, but must be a scalar.")
    number_ = number(name, float(x.value) if constant else x)
    if number_ < 0:
        raise ValueError(f"{name} is {number_}, but cannot be negative.")
    return x if constant else number_


def length(name: str, value: Any) -> float:
    """Return a positive number."""
    if value is None:
        raise ValueError(f"{name} is None, but must be a positive number, a length.")
    return positive(name, value, "a length") or 0.0


def vector(name: str, value: Any) -> list[float]:
    """Return three finite numbers."""
    try:
        v = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        v = np.empty(0)
    if v.shape != (3,) or not np.isfinite(v).all():
        raise ValueError(f"{name} is {value!r}, but must be three finite numbers.")
    return [float(x) for x in v]


def direction(name: str, value: Any) -> npt.NDArray[np.float64]:
    """Return a unit vector."""
    try:
        n = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        n = np.empty(0)
    if n.shape != (3,) or not np.isfinite(n).all() or not n.any():
        raise ValueError(f"{name} is {value!r}, but must be three finite numbers, not all zero.")
    return n / np.linalg.norm(n)


def petsc_options(prefix: Any, options: Any) -> dict[str, str]:
    """Return PETSc options as text."""
    options = {} if options is None else options
    if not isinstance(prefix, str):
        raise ValueError(f"petsc_options_prefix is {prefix!r}, but must be a string.")
    if not isinstance(options, dict) or any(not isinstance(key, str) for key in options):
        raise ValueError(
            f"petsc_options are {options!r}, but must be a dictionary whose keys are strings, "
            "names of PETSc options without the prefix."
        )

    def text(value: Any) -> str:
        if value is None:
            return ""
        if isinstance(value, bool):
            return str(value).lower()
        if isinstance(value, list | tuple):
            return ",".join(map(text, value))
        return str(value)

    return {key: text(value) for key, value in options.items()}
