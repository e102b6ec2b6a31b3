# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Slave nodes that masters hardly cover carry no traction, and are named where they do."""

from mpi4py import MPI

import cases
import dolfinx_mortar as dm
import nodal
import numpy as np
import pytest
import ufl
from blocks import FACES, NU, E, block
from dolfinx import fem
from dolfinx_mortar import cpp
from dolfinx_mortar.interfaces import MIN_COVERAGE

comm = MPI.COMM_WORLD


class Overhang:
    """A block pressed on a slab, the slave, that is coarser and stands over all its edges.

    Args:
        kind: Interface.
        options: Options of the interface.
    """

    def __init__(self, kind=dm.Contact, **options):
        parts = [
            block("slab", "hex8", (-5, -5, -3.3), (5, 5, -1.3), (7, 7, 1)),
            block("block", "hex8", (-1, -1, -1), (1, 1, 1), (2, 2, 2)),
        ]
        bodies, _ = cases._bodies(comm, parts, False)
        self.u = [fem.Function(b.V) for b in bodies]
        energy = cases.neo_hooke(E, NU)
        dx = ufl.dx(metadata={"quadrature_degree": 3})
        self.load = fem.Constant(bodies[1].mesh, np.zeros(3))
        energies = [energy(u) for u in self.u]
        energies[1] -= ufl.inner(self.load, self.u[1])
        forms = [ufl.derivative(e * dx, u) for e, u in zip(energies, self.u, strict=True)]
        self.top = fem.Constant(bodies[1].mesh, np.zeros(3))
        zero = fem.Constant(bodies[0].mesh, np.zeros(3))
        bcs = []
        for b, value, z in zip(bodies, (zero, self.top), (-3.3, 1.0), strict=True):
            dofs = fem.locate_dofs_geometrical(b.V, lambda x, z=z: np.isclose(x[2], z))
            bcs.append(fem.dirichletbc(value, dofs, b.V))
        slab, upper = bodies
        self.interface = kind(
            slave=[(slab.V, slab.facet_tags, FACES["z+"])],
            master=[(upper.V, upper.facet_tags, FACES["z-"])],
            **options,
        )
        self.problem = dm.ContactProblem(forms, self.u, bcs=bcs, interfaces=[self.interface])

    def press(self, x, z):
        self.top.value[:] = x, x, z
        self.problem.solve()
        return self.interface.num_multiplier_nodes

    def shares(self):
        """Covered shares of all nodes that carry a multiplier."""
        c = self.interface
        n, use = nodal.number(c), nodal.has_multiplier(c)
        mine = c.evaluation.nodal.coverage[:n][use] / c.weights[:n][use]
        return np.concatenate(comm.allgather(mine))


def largest_pressure(o):
    return comm.allreduce(np.abs(o.interface.pressure.x.array).max(initial=0), op=MPI.MAX)


def test_sliding_past_nodes():
    """No node on the way carries a multiple of what the others carry, and no step fails."""
    o = Overhang(multiplier="standard", friction=0.1)
    o.press(0.0, -0.6)
    o.press(0.0, -0.9)
    pressures = []
    for x in np.arange(0.0, 1.3, 0.1):
        assert 3 <= o.press(x, -0.9)
        pressures.append(largest_pressure(o))
    assert max(pressures) < 4 * min(pressures)


@pytest.mark.parametrize("kind", [dm.Tie, dm.Contact])
def test_share_is_an_option(kind):
    """Nodes carry a multiplier from the given share on."""
    options = {} if kind is dm.Tie else {"initial_active": "all"}
    numbers = []
    for share in (0.0, 0.02, 0.15, 0.3):
        o = Overhang(kind, search_distance=1.0, min_coverage=share, **options)
        numbers.append(o.press(0.35 if kind is dm.Tie else 0.0, -0.35))
        assert o.shares().min() > share
    assert numbers == sorted(numbers, reverse=True)
    assert Overhang(kind).interface.min_coverage == 0.15


@pytest.mark.parametrize("share", [-0.1, 1.0, np.nan])
def test_shares_that_make_no_sense(share):
    with pytest.raises(ValueError, match="min_coverage"):
        Overhang(dm.Tie, min_coverage=share)


def test_barely_covered_nodes_are_named():
    """Where a step fails or a residual is not finite, they are the likely cause."""
    o = Overhang(min_coverage=0.0)
    for z in (-0.2, -0.4):
        o.press(0.0, z)
    o.press(0.45, -0.4)
    worst = o.shares().min()
    assert worst < MIN_COVERAGE
    text = cpp.describe_barely_covered(o.problem._cpp_object)
    for words in ("slave node at X = (", f"only {worst:.1%} of", "min_coverage (it is 0)", "swap"):
        assert words in text
    o.load.value[0] = np.nan
    with pytest.raises(dm.ConvergenceError, match="not finite near X = .*The slave node at X = "):
        o.press(0.45, -0.4)

    o = Overhang()
    o.press(0.0, -0.4)
    assert cpp.describe_barely_covered(o.problem._cpp_object) == ""
    o.load.value[0] = np.nan
    with pytest.raises(dm.ConvergenceError, match="not finite near X = .*a load is not"):
        o.press(0.0, -0.4)
