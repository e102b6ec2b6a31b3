# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Integrals where positions are far from the origin, and where they are not finite."""

from mpi4py import MPI

import numpy as np
import oracle
import pytest
from distributed import distribute, fails_on_all
from dolfinx_mortar import cpp
from facet_pairs import PAIRINGS, Pairing, random_pairing

comm = MPI.COMM_WORLD
STEP = 2.0**-20


def moved(p, by):
    """Both surfaces, moved; positions are binary fractions, so that this is exact."""
    surfaces = []
    for s in (p.slave, p.master):
        x = STEP * np.round(s.x / STEP) + by
        surfaces.append(oracle.Surface(x, s.facets, s.sign))
    return Pairing(*surfaces)


@pytest.mark.serial
@pytest.mark.parametrize("pairing", PAIRINGS[::3], ids="-".join)
@pytest.mark.parametrize("integration", ["segment", "element"])
def test_places_do_not_matter(pairing, integration):
    """Nor does the place for derivatives."""
    p = random_pairing(*pairing, 3, covered=False)
    z = np.random.default_rng(2).normal(size=p.slave.x.shape)
    options = {"z": z, "derivatives": cpp.Derivatives.gap_and_slip}
    expected = moved(p, 0.0).integrate("dual", integration, **options)
    far = moved(p, [3e8, -1e8, 2e8]).integrate("dual", integration, **options)
    for name in ("area", "D", "M", "gap", "jump", "d_force", "d_gap", "d_jump"):
        value, other = np.asarray(expected[name]), np.asarray(far[name])
        assert np.abs(value - other).max() < 1e-11 * np.abs(value).max(), name


@pytest.mark.serial
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e308, 1e80])
@pytest.mark.parametrize("side", ["slave", "master"])
def test_positions_that_are_not_finite(value, side):
    p = random_pairing("quad8", "tri6", 3)
    getattr(p, side).x[:, 1] = value
    for integration in ("segment", "element"):
        with pytest.raises(RuntimeError, match="not finite .* the solver has diverged"):
            p.integrate("dual", integration, normals=np.tile([0, 0, 1.0], (8, 1)))


@pytest.mark.parametrize("value", [np.nan, 1e308])
@pytest.mark.parametrize("side", [0, 1])
def test_surfaces_that_are_not_finite(value, side):
    """The search refuses them on all ranks, whichever rank has the node."""
    slave = oracle.patch("quad4", (3, 3))
    master = oracle.patch("tri3", (2, 2), height=0.1, outward=-1)
    rng = np.random.default_rng(1)
    d = [
        distribute(comm, slave, rng=rng),
        distribute(comm, master, first_block=10**6, rng=rng),
    ]
    x = [s.x.copy() for s in d]
    if comm.rank == comm.size - 1 and len(x[side]):
        x[side][-1, 2] = value
    if comm.allreduce(not np.all(np.abs(x[side]) < 1e75), op=MPI.LOR):
        message = fails_on_all(
            comm, cpp.find_candidates, d[0].surface, x[0], d[1].surface, x[1], None
        )
        assert "not finite" in message
