# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""What tests need of DOLFINx and versions of it name differently."""

try:
    from dolfinx.io import gmsh as gmsh_reader
except ImportError:  # DOLFINx 0.9
    from dolfinx.io import gmshio as gmsh_reader

__all__ = ["gmsh_reader"]
