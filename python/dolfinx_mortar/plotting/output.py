# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Files for ParaView."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import basix.ufl
from dolfinx import fem

from ..elements import hex20


def for_output(u: fem.Function) -> fem.Function:
    """A function that DOLFINx's writers accept: hex20 is interpolated into Q2, exactly.

    VTX and VTK files know Lagrange elements only. Q2 contains the serendipity space, so nothing
    is lost; the values at vertices and edge midpoints are the same numbers.

    Args:
        u: Any function.

    Returns:
        ``u`` itself, or its interpolation into Q2 with the same name.
    """
    V = u.function_space
    element = V.ufl_element()
    scalar = element.sub_elements[0] if element.block_size > 1 else element
    if scalar != hex20():
        return u
    element = basix.ufl.element(
        "Lagrange", "hexahedron", 2, shape=V.ufl_element().reference_value_shape
    )
    w = fem.Function(fem.functionspace(V.mesh, element), name=u.name)
    w.interpolate(u)
    return w


class Writer:
    """Time series of functions in a VTX folder for ParaView (5.12 or later).

    Args:
        path: Folder to write, customarily ``*.bp``.
        functions: Functions with the same mesh and element, with different names. hex20 is
            written as Q2, see :func:`for_output`.
    """

    def __init__(self, path: str | Path, functions: Sequence[fem.Function]):
        from dolfinx.io import VTXWriter

        self._functions = [(u, for_output(u)) for u in functions]
        comm = functions[0].function_space.mesh.comm
        self._writer = VTXWriter(comm, str(path), [w for _, w in self._functions], "BP4")

    def write(self, t: float) -> None:
        """Write the functions as they are now, as time ``t``."""
        for u, w in self._functions:
            if w is not u:
                w.interpolate(u)
        self._writer.write(t)

    def close(self) -> None:
        """Finish the files."""
        self._writer.close()

    def __enter__(self) -> Writer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
