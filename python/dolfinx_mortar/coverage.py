# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""What to say of slave facets and nodes that masters hardly cover."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from dolfinx import log

if TYPE_CHECKING:
    from .interfaces import Interface

#: Share of its weight that must be covered for a slave node to carry a multiplier, by default.
#: A block that slides with friction over a coarser slave loses no step with 0.15 and 0.2 and
#: fails with 0.02, where nodes at its edges carry five times the pressure of the others; with 0.3
#: one node is left under it at times.
MIN_COVERAGE = 0.15

#: Share of a facet's area that may be left out without a word. Slivers and the seams between
#: curved facets take some per mille.
LOST = 0.05


def _point(x: Sequence[float]) -> str:
    return "({:.4g}, {:.4g}, {:.4g})".format(*x)


def _worst(interface: Interface, values: npt.NDArray, x: npt.NDArray) -> tuple[float, tuple]:
    """Largest of the values of all ranks and its place; (-inf, ...) where there are none."""
    mine = (-np.inf, (np.inf,) * 3)
    if len(values):
        k = int(np.argmax(values))
        mine = (float(values[k]), tuple(map(float, x[k])))
    return max(interface._layout.comm.allgather(mine))


def report_lost(interface: Interface) -> None:
    """Log a warning where steep masters are left out that nothing replaces. Collective.

    Only for facets of ties, and facets of contacts that a master is near of; once for each
    interface.
    """
    if interface._warned:
        return
    surface, nodal = interface._surface_slave, interface._nodal
    lost = nodal["lost"]
    facets = np.flatnonzero(lost > LOST)
    nodes = [surface.nodes[surface.offsets[f] : surface.offsets[f + 1]] for f in facets]
    if interface._leave_distant:
        near = [bool(np.any(nodal["near"][k])) for k in nodes]
        facets, nodes = facets[near], [k for k, use in zip(nodes, near) if use]
    x = np.array([surface.X[k].mean(axis=0) for k in nodes]).reshape(-1, 3)
    share, at = _worst(interface, lost[facets], x)
    if share < 0:
        return
    interface._warned = True
    if interface._layout.comm.rank == 0:
        log.log(
            log.LogLevel.WARNING,
            f"{share:.0%} of the slave facet near X = {_point(at)} (facet tag "
            f"{interface.slave[0].tag}) faces masters at more than max_angle = "
            f"{interface._max_angle:g} degrees, and takes no part in the interface. Tag only "
            "facets that face each other, or raise max_angle.",
        )


def find_barely_covered(interfaces: Sequence[Interface]) -> str:
    """Name a slave node with a multiplier that masters hardly cover. Collective.

    Returns:
        A sentence with its cause and its cure, empty where there is none.
    """
    for i in interfaces:
        n = i.num_owned
        use = i._data.carries[:n].astype(bool)
        share = i._nodal["coverage"][:n][use] / i._weights[:n][use]
        barely = share < MIN_COVERAGE
        worst, at = _worst(i, -share[barely], i._surface_slave.X[:n][use][barely])
        if np.isfinite(worst):
            return (
                f"The slave node at X = {_point(at)} (facet tag {i.slave[0].tag}) carries a "
                f"traction, but masters cover only {max(-worst, 0):.1%} of its surroundings, and "
                f"small motions change it much: raise min_coverage (it is {i._min_coverage:g}), "
                "refine the slave surface, or swap slave and master."
            )
    return ""
