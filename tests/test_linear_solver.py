# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""The condensed system gives the steps of the saddle point, whatever solves it."""

import dolfinx_mortar as dm
import numpy as np
import pytest
from pressed import pressed

SADDLE = {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}
MULTIGRID = {"ksp_type": "gmres", "ksp_rtol": 1e-12, "ksp_max_it": 300, "pc_type": "gamg"}
KINDS = {
    "tie": (dm.Tie, {}),
    "contact": (dm.Contact, {}),
    "friction": (dm.Contact, {"friction": 0.3}),
    "corners": (dm.Contact, {"multiplier": "dual-linear"}),
}


def history(p):
    steps = []
    for x, z in ((0.0, -0.01), (0.03, -0.02)):
        p.move(x, z)
        steps.append([(h["active"], h["stick"], h["slip"]) for h in p.problem.history])
    return steps


@pytest.mark.parametrize("name", KINDS)
def test_same_iterates_condensed_and_saddle_point(name):
    kind, options = KINDS[name]
    p = pressed(kind, elements=("hex20", "hex8"), **options)
    q = pressed(kind, elements=("hex20", "hex8"), condense=False, **options)
    assert history(p) == history(q)
    assert np.allclose(p.norms(), q.norms(), rtol=1e-10)
    for a, b in zip(p.problem.history[:-1], q.problem.history[:-1], strict=True):
        # Rounding shows in residuals that are next to nothing
        assert np.isclose(a["force"], b["force"], rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("name", KINDS)
def test_multigrid_behind_the_constraints(name):
    kind, options = KINDS[name]
    p = pressed(kind, elements=("hex20", "hex8"), **options)
    q = pressed(kind, elements=("hex20", "hex8"), petsc_options=MULTIGRID, **options)
    assert history(p) == history(q)
    assert np.allclose(p.norms(), q.norms(), rtol=1e-8)
    assert q.problem._solver.ksp.getIterationNumber() < 100
