# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""A block pressed on a block and dragged over it: a small problem for tests of the solver."""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

import cases
import dolfinx_mortar as dm
import numpy as np
import ufl
from blocks import FACES, NU, E, block
from dolfinx import fem


@dataclass
class Pressed:
    """The problem and what moves it."""

    problem: dm.ContactProblem
    interface: dm.Interface
    top: fem.Constant
    forms: list

    def move(self, x: float, z: float) -> int:
        """Prescribe the motion of the top and solve; number of Newton iterations."""
        self.top.value[:] = x, 0.0, z
        return self.problem.solve()

    def norms(self) -> np.ndarray:
        """Norms of displacements and multipliers, the same for any number of ranks."""
        p = self.problem
        vectors = [p.state.u, p.state.z]
        return np.sqrt([p.comm.allreduce(float(v @ v)) for v in vectors])


def pressed(
    kind: type,
    *,
    elements: tuple[str, str] = ("hex8", "hex8"),
    petsc_options: dict | None = None,
    condense: bool | None = None,
    slave_sides: tuple[str, ...] = ("z-",),
    **options,
) -> Pressed:
    """Two neo-Hookean blocks, each a mesh of its own; more options go to the interface.

    Slaves are the given sides of the upper one.
    """
    parts = [
        block("upper", elements[0], (0.2, 0.2, 1.0), (0.8, 0.8, 1.5), (3, 3, 2)),
        block("lower", elements[1], (0.0, 0.0, 0.5), (1.4, 1.0, 1.0), (4, 4, 2)),
    ]
    bodies, _ = cases._bodies(MPI.COMM_WORLD, parts, False)
    energy = cases.neo_hooke(E, NU)
    # With two points per direction hex27 has motions without energy
    dx = ufl.dx(metadata={"quadrature_degree": 5 if "hex27" in elements else 3})
    u = [fem.Function(b.V) for b in bodies]
    F = [ufl.derivative(energy(w) * dx, w, ufl.TestFunction(w.function_space)) for w in u]
    top, bottom = (fem.Constant(b.mesh, np.zeros(3)) for b in bodies)
    bcs = []
    for b, value, height in zip(bodies, (top, bottom), (1.5, 0.5), strict=True):
        dofs = fem.locate_dofs_geometrical(b.V, lambda x, h=height: np.isclose(x[2], h))
        bcs.append(fem.dirichletbc(value, dofs, b.V))
    interface = kind(
        slave=[(bodies[0].V, bodies[0].facet_tags, FACES[side]) for side in slave_sides],
        master=[(bodies[1].V, bodies[1].facet_tags, FACES["z+"])],
        **options,
    )
    problem = dm.ContactProblem(
        F,
        u,
        bcs=bcs,
        interfaces=[interface],
        petsc_options_prefix="pressed_",
        petsc_options=petsc_options,
        condense=condense,
    )
    return Pressed(problem, interface, top, F)
