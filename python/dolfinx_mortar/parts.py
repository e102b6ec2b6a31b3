# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Tagged facets that make up one side of an interface.

If something does not fit, a ValueError says what.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from mpi4py import MPI

import numpy as np
from dolfinx import fem
from dolfinx.mesh import MeshTags

from . import agreement, arguments


class Part(NamedTuple):
    """Tagged facets of one body."""

    V: fem.FunctionSpace
    tags: MeshTags
    tag: int

    def checked(self, name: str) -> Part:
        """The part, whose parts are what they must be.

        Args:
            name: ``"slave"`` or ``"master"``.
        """
        return _check_part(self, name)


def communicator(*arguments: Any) -> MPI.Intracomm | None:
    """What the spaces among (nested) arguments have in common; None where there is none."""
    found, left = [], list(arguments)
    while left:
        item = left.pop(0)
        if isinstance(item, fem.FunctionSpace):
            found.append(item.mesh.comm)
        elif isinstance(item, list | tuple):
            left.extend(item)
    return agreement.common(found) if found else None


def read(V: Any, facet_tags: Any, side: int, which: Any, name: str) -> list[Part]:
    """Parts of a surface from the short and the long way to say it.

    Args:
        V: Space, or those of slave and master; None with the long way.
        facet_tags: Facet tags, likewise.
        side: 0 for the slave, 1 for the master.
        which: Tag, or a list of ``(V, facet_tags, tag)``.
        name: ``"slave"`` or ``"master"``.
    """
    if isinstance(which, list | tuple):
        if any(not isinstance(p, list | tuple) or len(p) != 3 for p in which):
            raise ValueError(f"{name} is {which!r}, but must be a list of (V, facet_tags, tag).")
        parts = [Part(*p) for p in which]
        if not parts:
            raise ValueError(f"The {name} surface has no parts.")
        return [_check_part(p, name) for p in parts]
    if V is None or facet_tags is None:
        raise ValueError(
            f"{name}={which} is a facet tag, so the interface needs a function space and facet "
            "tags: Tie(V, facet_tags, slave=..., master=...)."
        )
    if isinstance(V, list | tuple) or isinstance(facet_tags, list | tuple):
        pairs = [x for x in (V, facet_tags) if isinstance(x, list | tuple) and len(x) == 2]
        if len(pairs) != 2:
            raise ValueError(
                "Two bodies need two spaces and two sets of facet tags: "
                "Tie((V_slave, V_master), (tags_slave, tags_master), ...)."
            )
        V, facet_tags = V[side], facet_tags[side]
    return [_check_part(Part(V, facet_tags, which), name)]


def check_sides(slave: list[Part], master: list[Part]) -> None:
    """Refuse a surface that is on both sides."""
    for a in slave:
        for b in master:
            if a.tag == b.tag and a.tags is b.tags:
                raise ValueError(
                    f"Slave and master are the same surface (facet tag {a.tag}): give the two "
                    "sides of the interface different tags."
                )


def _check_part(part: Part, name: str) -> Part:
    V, tags, tag = part
    if not isinstance(V, fem.FunctionSpace):
        raise ValueError(
            f"The {name} surface needs a dolfinx.fem.FunctionSpace, that of the displacement, but "
            f"has a {type(V).__name__}."
        )
    if not isinstance(tags, MeshTags):
        raise ValueError(
            f"The {name} surface needs dolfinx.mesh.MeshTags of facets, but has a "
            f"{type(tags).__name__}."
        )
    if tags.values.dtype != np.int32:
        raise ValueError(
            f"The facet tags of the {name} surface are of type {tags.values.dtype}, but must be "
            "int32: give mesh.meshtags values.astype(np.int32)."
        )
    return Part(V, tags, arguments.whole(f"{name} (a facet tag)", tag, -(2**31), 2**31 - 1))
