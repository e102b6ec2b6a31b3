# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""What DOLFINx's own readers refuse (20-node hexahedra, Abaqus files), and pairs of surfaces."""

from .abaqus import AbaqusMesh, read_abaqus
from .gmsh import model_to_hex20
from .hexahedra import create_hex20_mesh, hex20_permutation
from .pairs import Pair, find_pairs

__all__ = [
    "AbaqusMesh",
    "Pair",
    "create_hex20_mesh",
    "find_pairs",
    "hex20_permutation",
    "model_to_hex20",
    "read_abaqus",
]
