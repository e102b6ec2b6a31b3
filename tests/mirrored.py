# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Contact problems as a whole, and cut by planes of symmetry.

The mesh of a quarter is mirrored, so that a part has the very cells of the whole.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mpi4py import MPI

import cases
import dolfinx_mortar as dm
import numpy as np
import ufl
from blocks import FACES, NU, E
from dolfinx import fem

# Order of the vertices of a cell that a mirror has turned inside out
_TURNED = {4: [1, 0, 2, 3], 8: [1, 0, 3, 2, 5, 4, 7, 6]}
COORDINATES = {0, 1}


def mirror(points: np.ndarray, cells: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """A mesh together with its image beyond the plane on which a coordinate is zero.

    Args:
        points: Shape (n, 3).
        cells: In DOLFINx order, shape (cells, 4 or 8).
        axis: The coordinate.
    """
    on = cases.near(0)(points[:, axis])
    image = np.where(on, np.arange(len(points)), len(points) + np.cumsum(~on) - 1)
    flipped = points[~on].copy()
    flipped[:, axis] *= -1
    turned = image[cells][:, _TURNED[cells.shape[1]]]
    return np.vstack([points, flipped]), np.vstack([cells, turned])


def fix(V: fem.FunctionSpace, component: int, where: Callable, value: fem.Constant | None = None):
    """Prescribe a component where `where(x)` holds, x of shape (3, nodes)."""
    scalar, _ = V.sub(component).collapse()
    dofs, _ = fem.locate_dofs_geometrical((V.sub(component), scalar), where)
    value = fem.Constant(V.mesh, 0.0) if value is None else value
    return fem.dirichletbc(value, dofs, V.sub(component))


def symmetry(V: fem.FunctionSpace, planes: Sequence[int]) -> list[fem.DirichletBC]:
    """Conditions on planes on which a coordinate, 0 or 1, is zero."""
    return [fix(V, axis, lambda x, axis=axis: cases.near(0)(x[axis])) for axis in planes]


@dataclass
class Model:
    """The problem, its interfaces, the upper one first, and what moves it."""

    problem: dm.ContactProblem
    interfaces: list[dm.Interface]
    top: fem.Constant

    @property
    def contact(self) -> dm.Contact:
        """The upper interface."""
        return self.interfaces[0]

    def press(self, depth: float) -> int:
        """Prescribe the motion of the top and solve; number of Newton iterations."""
        self.top.value = -depth
        return self.problem.solve()


@dataclass
class Layer:
    """A body between two surfaces z(x, y) over a square about the z axis.

    Attributes:
        element: Its element.
        width: Half the side of the square.
        cells: Number of cells of a quarter in each direction.
        surfaces: Bottom and top.
    """

    element: str
    width: float
    cells: tuple[int, int, int]
    surfaces: tuple[Callable, Callable]


def nose(x, y):
    """Bottom of a rounded punch."""
    return 1 + 0.25 * (0.7 * x**2 + y**2)


def hump(x, y):
    """Top of what it is pressed on."""
    return 1 - 0.15 * (x**2 + 0.5 * y**2)


def level(z: float) -> Callable:
    """A plane surface."""
    return lambda x, y: z


def punch(elements: tuple[str, str], base: bool = False) -> list[Layer]:
    """Layers of a punch on a plate, on request with a base below."""
    layers = [
        Layer(elements[0], 0.5, (2, 2, 1), (nose, level(1.6))),
        Layer(elements[1], 0.75, (3, 3, 1), (level(0.5), hump)),
    ]
    return layers + base * [Layer("hex8", 0.75, (2, 2, 1), (level(0.0), level(0.5)))]


def crossed_cylinders(elements: tuple[str, str]) -> list[Layer]:
    """Layers with cylinders for surfaces, the upper one along the y axis, the lower along x."""

    def sag(x):
        return 1.5 - np.sqrt(1.5**2 - x**2)

    return [
        Layer(elements[0], 0.5, (4, 2, 1), (lambda x, y: 1 + sag(x), level(1.6))),
        Layer(elements[1], 0.75, (3, 6, 1), (level(0.5), lambda x, y: 1 - sag(y))),
    ]


def model(
    layers: list[Layer],
    kinds: list[tuple[type, dict]],
    planes: Sequence[int],
    *,
    comm: MPI.Comm = MPI.COMM_WORLD,
    petsc_options: dict | None = None,
) -> Model:
    """Layers pressed on each other, the upper one of two always the slave.

    Args:
        layers: The layers, from the top.
        kinds: Class and options of each interface between them.
        planes: Coordinates, some of 0 and 1, that are positive in the part that is left.
        comm: Communicator.
        petsc_options: Of the problem.
    """
    energy = cases.neo_hooke(E, NU)
    parts = [_part(f"layer {i}", layer, energy, planes) for i, layer in enumerate(layers)]
    bodies, _ = cases._bodies(comm, parts, False)
    spaces, tags = [b.V for b in bodies], [b.facet_tags for b in bodies]
    u = [fem.Function(V, name="u") for V in spaces]
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    F = [ufl.derivative(energy(w) * dx, w, ufl.TestFunction(w.function_space)) for w in u]
    top = fem.Constant(bodies[0].mesh, 0.0)
    high, low = (layers[i].surfaces[k](0, 0) for i, k in ((0, 1), (-1, 0)))
    bcs = [bc for V in spaces for bc in symmetry(V, planes)]
    for axis in range(3):
        value = top if axis == 2 else None
        bcs.append(fix(spaces[0], axis, lambda x: cases.near(high)(x[2]), value))
        bcs.append(fix(spaces[-1], axis, lambda x: cases.near(low)(x[2])))
    interfaces = [
        kind(spaces[i : i + 2], tags[i : i + 2], slave=FACES["z-"], master=FACES["z+"], **options)
        for i, (kind, options) in enumerate(kinds)
    ]
    problem = dm.ContactProblem(
        F,
        u,
        bcs=bcs,
        interfaces=interfaces,
        petsc_options_prefix="mirrored_",
        petsc_options=petsc_options,
    )
    return Model(problem, interfaces, top)


def _part(name: str, layer: Layer, energy: cases.Energy, planes: Sequence[int]) -> cases.Part:
    sides = (np.linspace(0, layer.width, n + 1) for n in layer.cells[:2])
    tetrahedra = layer.element.startswith("tet")
    points, cells = cases.extrude(*cases.grid(*sides), *layer.surfaces, layer.cells[2], tetrahedra)
    for axis in COORDINATES - set(planes):
        points, cells = mirror(points, cells, axis)

    def tag(x):
        side = np.any(cases.near(layer.width)(np.abs(x[:, :2])), axis=1)
        for axis in planes:
            side |= cases.near(0)(x[:, axis])
        middle = sum(surface(0, 0) for surface in layer.surfaces) / 2
        return np.select([side, x[:, 2] < middle], [0, FACES["z-"]], FACES["z+"])

    return cases.Part(name, layer.element, energy, points, cells, tag)
