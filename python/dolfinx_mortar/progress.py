# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Lines and tables for people: progress of load steps, contacts in numbers."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

#: Columns of a report: heading, format and what is shown
_COLUMNS: tuple[tuple[str, str, Callable[[Mapping[str, Any]], Any]], ...] = (
    ("open", "6d", lambda s: s["open"]),
    ("stick", "6d", lambda s: s["stick"]),
    ("slip", "6d", lambda s: s["slip"]),
    ("area", "10.4g", lambda s: s["area"]),
    ("pressure", "10.4g", lambda s: s["mean_pressure"]),
    ("largest", "10.4g", lambda s: s["largest_pressure"]),
    ("overlap", "10.2e", lambda s: s["penetration"]),
    *((f"force {c}", "11.4g", lambda s, i=i: s["force"][i]) for i, c in enumerate("xyz")),
    *((f"centre {c}", "10.4g", lambda s, i=i: s["centre"][i]) for i, c in enumerate("xyz")),
    ("friction", "10.4g", lambda s: s["dissipation"]),
)


def report(contacts: Sequence[tuple[int, Mapping[str, Any]]]) -> str:
    """A table with a row for each contact: its number among the interfaces, and its summary."""
    widths = [int(form.split(".")[0].rstrip("d")) for _, form, _ in _COLUMNS]
    head = "contact" + "".join(f" {name:>{w}}" for (name, _, _), w in zip(_COLUMNS, widths))
    rows = [
        f"{number:7}" + "".join(f" {show(s):{form}}" for _, form, show in _COLUMNS)
        for number, s in contacts
    ]
    return "\n".join([head, *rows])


def progress_clock(n: int) -> Callable[[int, int, int, Mapping[str, Any]], str]:
    """A function that makes the line of a step.

    Args:
        n: Number of steps.

    Returns:
        Takes the number of the step, its Newton iterations, the number of parts that were tried
        and the last iterate.
    """
    start = time.perf_counter()

    def line(step: int, iterations: int, parts: int, last: Mapping[str, Any]) -> str:
        left = round((time.perf_counter() - start) / step * (n - step))
        cut = f" in {parts} parts" if parts > 1 else ""
        return (
            f"step {step:{len(str(n))}}/{n}  {iterations:3} iterations{cut}  "
            f"{last['active']:5} active, {last['stick']} stick, {last['slip']} slip  "
            f"{left // 60}:{left % 60:02} left"
        )

    return line
