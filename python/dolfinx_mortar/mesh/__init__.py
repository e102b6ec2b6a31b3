# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Meshes of 20-node hexahedra, from Abaqus files and arrays; tags from nodes; pairs of surfaces."""

from .abaqus import AbaqusMesh, read_abaqus
from .arrays import create_hex20_mesh, create_mesh, tags_from_nodes
from .gmsh import model_to_hex20
from .hexahedra import hex20_permutation
from .pairs import Pair, find_pairs

__all__ = [
    "AbaqusMesh",
    "Pair",
    "create_hex20_mesh",
    "create_mesh",
    "find_pairs",
    "hex20_permutation",
    "model_to_hex20",
    "read_abaqus",
    "tags_from_nodes",
]
