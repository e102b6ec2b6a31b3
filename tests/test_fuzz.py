# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""A short run over random pairs of facets; fuzz/pairs.py says what must hold, and runs longer."""

import pytest
from fuzz import pairs

pytestmark = pytest.mark.serial


@pytest.mark.parametrize("seed", [1, 2])
def test_random_pairs(seed):
    assert pairs.run(2000, seed) == {}
