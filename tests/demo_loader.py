# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""The demos as modules, whose functions tests can call."""

import importlib.util
from pathlib import Path
from types import ModuleType


def load_demo(name: str) -> ModuleType:
    """Import a demo without running it.

    Args:
        name: Name of its file, without ending.
    """
    path = Path(__file__).parents[1] / "demos" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
