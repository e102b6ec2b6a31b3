# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Charts of convergence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np


def convergence_plot(
    path: str | Path,
    panels: Mapping[str, Mapping[str, tuple[Sequence[float], Sequence[float]]]],
    *,
    xlabel: str = "$h$",
    ylabel: str = "error",
    slopes: Sequence[float] = (),
    styles: Mapping[str, Mapping[str, Any]] | None = None,
) -> None:
    """Log-log plot of errors against mesh size, one panel beside the other; call on one rank.

    Args:
        path: PNG file to write.
        panels: Title of the panel to its curves: name to ``(h, errors)``. The order found between
            the two finest meshes is added to each name.
        xlabel: Label of the horizontal axes.
        ylabel: Label of the vertical axis.
        slopes: Orders to compare with; a triangle is drawn under curves that come near.
        styles: Keyword arguments of matplotlib's ``plot`` for some of the names.
    """
    import matplotlib

    matplotlib.use("Agg", force=False)
    import matplotlib.pyplot as plt

    panels = {title: curves for title, curves in panels.items() if curves}
    fig, axes = plt.subplots(
        1, len(panels), figsize=(5.0 * len(panels), 5.6), sharey=True, squeeze=False
    )
    for axis, (title, curves) in zip(axes[0], panels.items()):
        for name, curve in curves.items():
            h, errors = (np.asarray(values, float) for values in curve)
            order = ""
            if len(h) > 1:
                order = f"  ({np.log(errors[-2] / errors[-1]) / np.log(h[-2] / h[-1]):.2f})"
            style = {"marker": "o", **(styles or {}).get(name, {})}
            axis.loglog(h, errors, label=name + order, **style)
        _slope_triangles(axis, curves, slopes)
        axis.set(title=title, xlabel=xlabel)
        axis.grid(True, which="both", alpha=0.25)
        axis.legend(
            title="(order between the two finest)",
            fontsize=9,
            title_fontsize=9,
            ncols=2,
            loc="upper center",
            bbox_to_anchor=(0.5, -0.12),
            frameon=False,
        )
        for side in ("top", "right"):
            axis.spines[side].set_visible(False)
    axes[0, 0].set_ylabel(ylabel)
    fig.tight_layout()
    fig.savefig(path, dpi=150)
    plt.close(fig)


def _slope_triangles(
    axis: Any,
    curves: Mapping[str, tuple[Sequence[float], Sequence[float]]],
    slopes: Sequence[float],
) -> None:
    """Triangles for comparison, each under the lowest of the curves that are nearest to it."""
    lowest: dict[float, tuple[float, float, float]] = {}
    for h, errors in curves.values():
        if len(h) > 1 and min(errors) > 0 and slopes:
            found = np.log(errors[-2] / errors[-1]) / np.log(h[-2] / h[-1])
            slope = min(slopes, key=lambda s: abs(s - found))
            here = (errors[-1], h[-1], h[-2])
            lowest[slope] = min(lowest.get(slope, here), here)
    for slope, (error, left, right) in lowest.items():
        low = 0.55 * error
        left, right = 1.15 * left, 1.15 * left * (right / left) ** 0.75
        high = low * (right / left) ** slope
        axis.plot([left, right, right, left], [low, low, high, low], color="0.4", linewidth=1)
        axis.text(np.sqrt(left * right), low * 0.93, "1", ha="center", va="top", fontsize=9)
        axis.text(right * 1.04, np.sqrt(low * high), f"{slope:g}", va="center", fontsize=9)
