# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Reference problems of 4C, rebuilt from their geometric descriptions as DOLFINx meshes.

4C (formerly BACI) is the code in which the authors of the method implemented it; its regression
cases carry displacements to compare with. A problem is a `Case`: parts (bodies), interfaces between
them, conditions, and expected values with their source. Every part gets a mesh of its own, or, with
`one_mesh=True` and where all parts have the same element, all parts share one mesh.

    case = cases.tied_hex27()
    u = cases.displacements(case)
    F = cases.residuals(case, u)
    bcs = cases.DirichletConditions(case)
    for t in case.times:
        bcs.set_time(t)
        ...                                        # solve F = 0 with bcs.bcs and the interfaces
    cases.check_expected(case, u, tolerance=1e-6)

Units are those of the original: any consistent ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from mpi4py import MPI

import basix.ufl
import numpy as np
import oracle
import ufl
from dolfinx import fem, la
from dolfinx import mesh as dmesh
from dolfinx_mortar import compat, hex20

# Bulk quadrature of 4C: hex8 2x2x2 points, hex20 and hex27 3x3x3, tet10 4 points, tet4 one.
QUADRATURE_DEGREE = {"tet4": 1, "tet10": 2, "hex8": 3, "hex20": 5, "hex27": 5}
FACET_KIND = {"tet4": "tri3", "tet10": "tri6", "hex8": "quad4", "hex20": "quad8", "hex27": "quad9"}

Energy = Callable[[ufl.core.expr.Expr], ufl.core.expr.Expr]


# -- Materials ---------------------------------------------------------------------------------


def _constants(u: fem.Function, *values: float) -> list[fem.Constant]:
    """Numbers that a form is not compiled anew for."""
    return [fem.Constant(u.function_space.mesh, float(value)) for value in values]


def _lame(E: float, nu: float) -> tuple[float, float]:
    return E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))


def neo_hooke(E: float, nu: float) -> Energy:
    """Psi = c (I1 - 3) + c / beta (J^(-2 beta) - 1), 4C's ELAST_CoupNeoHooke, per volume.

    c = E / (4 (1 + nu)), beta = nu / (1 - 2 nu); its limit for nu = 0 is c (I1 - 3) - 2 c ln J.
    """

    def energy(u):
        c, beta = _constants(u, E / (4 * (1 + nu)), nu / (1 - 2 * nu))
        F = ufl.Identity(3) + ufl.grad(u)
        J = ufl.det(F)
        volumetric = -2 * c * ufl.ln(J) if nu == 0 else c / beta * (J ** (-2 * beta) - 1)
        return c * (ufl.inner(F, F) - 3) + volumetric

    return energy


def st_venant_kirchhoff(E: float, nu: float) -> Energy:
    """Psi = lambda / 2 tr(E)^2 + mu E : E with the Green-Lagrange strain E, per volume."""

    def energy(u):
        lmbda, mu = _constants(u, *_lame(E, nu))
        F = ufl.Identity(3) + ufl.grad(u)
        strain = (F.T * F - ufl.Identity(3)) / 2
        return lmbda / 2 * ufl.tr(strain) ** 2 + mu * ufl.inner(strain, strain)

    return energy


def linear_elastic(E: float, nu: float) -> Energy:
    """Psi = lambda / 2 tr(eps)^2 + mu eps : eps with the small strain, per volume."""

    def energy(u):
        lmbda, mu = _constants(u, *_lame(E, nu))
        strain = ufl.sym(ufl.grad(u))
        return lmbda / 2 * ufl.tr(strain) ** 2 + mu * ufl.inner(strain, strain)

    return energy


# -- What a case consists of -------------------------------------------------------------------


@dataclass
class Part:
    """One body before it becomes a mesh.

    Attributes:
        name: For messages.
        element: "tet4", "tet10", "hex8", "hex20" or "hex27".
        energy: Stored energy of a displacement.
        points: Vertex coordinates, shape (vertices, 3).
        cells: Vertices of straight-sided cells in DOLFINx order, shape (cells, 4 or 8).
        tag: Facet tags from facet midpoints, shape (facets, 3) to (facets,); 0 means none.
        isoparametric: The geometry has the displacement's nodes, in the middle of straight edges.
    """

    name: str
    element: str
    energy: Energy
    points: np.ndarray
    cells: np.ndarray
    tag: Callable[[np.ndarray], np.ndarray]
    isoparametric: bool = False


@dataclass
class Body:
    """A mesh with its displacement space. The cells of part p are tagged p + 1."""

    mesh: dmesh.Mesh
    cell_tags: dmesh.MeshTags
    facet_tags: dmesh.MeshTags
    element: str
    V: fem.FunctionSpace


Side = list[tuple[int, int]]


@dataclass
class Interface:
    """A "tie" or "contact" interface.

    Attributes:
        kind: Which of them.
        slave: Part and facet tag of each piece of the slave surface.
        master: The same of the master surface.
        friction: Coulomb's coefficient.
        initially_active: Whether contact is closed at the start.
    """

    kind: str
    slave: Side
    master: Side
    friction: float | None = None
    initially_active: bool = True


@dataclass
class Dirichlet:
    """Prescribed displacement components at the nodes of a part for which `where(x)` holds.

    Attributes:
        part: Part number.
        where: From coordinates of shape (3, nodes) to booleans.
        components: Some of 0, 1, 2.
        value: Displacement vector as a function of time; zero if omitted.
    """

    part: int
    where: Callable[[np.ndarray], np.ndarray]
    components: Sequence[int] = (0, 1, 2)
    value: Callable[[float], Sequence[float]] = lambda t: (0.0, 0.0, 0.0)


@dataclass
class SurfaceLoad:
    """Dead load per reference area on tagged facets."""

    part: int
    tag: int
    traction: tuple[float, float, float]


@dataclass
class NodalLoad:
    """Dead forces at vertices, points and forces of shape (vertices, 3); first order only."""

    part: int
    points: np.ndarray
    forces: np.ndarray


@dataclass
class Expected:
    """A displacement of a node at the end of the last step, with the tolerance 4C has for it."""

    part: int
    point: tuple[float, float, float]
    component: int
    value: float
    tolerance: float


@dataclass
class Case:
    """A reference problem. `body[p]` is the number of the mesh that holds part p."""

    source: str
    parts: list[Part]
    bodies: list[Body]
    body: list[int]
    interfaces: list[Interface]
    dirichlet: list[Dirichlet]
    surface_loads: list[SurfaceLoad] = field(default_factory=list)
    nodal_loads: list[NodalLoad] = field(default_factory=list)
    times: tuple[float, ...] = (1.0,)
    expected: list[Expected] = field(default_factory=list)
    exact: Callable[[int, np.ndarray], np.ndarray] | None = None


# -- Meshes ------------------------------------------------------------------------------------


def grid(x: Sequence[float], y: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Points, shape (points, 2), and quadrilaterals in tensor order of a rectangular grid."""
    points = np.array([(a, b) for b in y for a in x])
    n = len(x)
    quads = [
        (i + j * n, i + 1 + j * n, i + (j + 1) * n, i + 1 + (j + 1) * n)
        for j in range(len(y) - 1)
        for i in range(n - 1)
    ]
    return points, np.array(quads)


def mapped_grid(corners: Sequence, n: int, m: int) -> tuple[np.ndarray, np.ndarray]:
    """A grid of n by m on a plane quadrilateral, corners in tensor order."""
    points, quads = grid(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1))
    return oracle.shape_functions("quad4", points)[0] @ np.array(corners), quads


def triangles_as_quads(triangles: Sequence, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Each triangle cut into three quadrilaterals that meet at its centroid, and these into n by n.

    Every quadrilateral has a vertex inside its triangle, so none lies on the outline alone.

    Args:
        triangles: Corners of each triangle, shape (triangles, 3, 2), counter-clockwise.
        n: Subdivisions of each quadrilateral.
    """
    numbers: dict[tuple[float, float], int] = {}
    cells = []
    for a, b, c in np.array(triangles, dtype=float):
        g = (a + b + c) / 3
        for p, q, r in ((a, b, c), (b, c, a), (c, a, b)):
            points, quads = mapped_grid([p, (p + q) / 2, (p + r) / 2, g], n, n)
            keys = [(float(x), float(y)) for x, y in np.round(points, 12) + 0.0]
            new = np.array([numbers.setdefault(key, len(numbers)) for key in keys])
            cells.append(new[quads])
    return np.array(list(numbers)), np.vstack(cells)


def extrude(
    plan: np.ndarray,
    quads: np.ndarray,
    bottom: Callable[[np.ndarray, np.ndarray], np.ndarray],
    top: Callable[[np.ndarray, np.ndarray], np.ndarray],
    layers: int,
    tetrahedra: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Columns of cells between two surfaces over a plane mesh of quadrilaterals.

    Args:
        plan: Points in the x-y plane, shape (points, 2).
        quads: Quadrilaterals in tensor order, cut along their second diagonal into triangles where
            tetrahedra are asked for.
        bottom: z of the bottom as a function of x and y.
        top: z of the top.
        layers: Number of cells on top of each other.
        tetrahedra: Whether to cut each hexahedron into six tetrahedra.

    Returns:
        Points, shape (points, 3), and cells in DOLFINx order.
    """
    x, y = plan.T
    low, high = bottom(x, y) + 0 * x, top(x, y) + 0 * x
    points = np.vstack(
        [np.column_stack([x, y, low + (high - low) * k / layers]) for k in range(layers + 1)]
    )
    n, cells = len(plan), []
    for k in range(layers):
        for quad in quads:
            if not tetrahedra:
                cells.append([*(quad + k * n), *(quad + (k + 1) * n)])
                continue
            # The diagonals of the columns' sides rise from the smaller to the larger number, so
            # that neighbours agree.
            for triangle in (quad[[0, 1, 3]], quad[[0, 2, 3]]):
                a, b, c = np.sort(triangle) + k * n
                a1, b1, c1 = a + n, b + n, c + n
                cells += [[a, b, c, c1], [a, b, b1, c1], [a, a1, b1, c1]]
    return points, np.array(cells)


def box(
    lower: Sequence[float], upper: Sequence[float], cells: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """A rectangular block of hexahedra."""
    x, y = (np.linspace(lower[i], upper[i], cells[i] + 1) for i in range(2))
    return extrude(*grid(x, y), lambda x, y: lower[2], lambda x, y: upper[2], cells[2])


def _space(mesh: dmesh.Mesh, element: str) -> fem.FunctionSpace:
    if element == "hex20":
        return fem.functionspace(mesh, hex20(shape=(3,)))
    degree = 1 if element in ("tet4", "hex8") else 2
    return fem.functionspace(mesh, ("Lagrange", degree, (3,)))


def _raised(mesh: dmesh.Mesh, element: str) -> dmesh.Mesh:
    """A mesh with geometry nodes where a displacement's element has nodes."""
    V = _space(mesh, element)
    cell = mesh.topology.cell_name()
    coordinates = (
        hex20(shape=(3,))
        if element == "hex20"
        else basix.ufl.element("Lagrange", cell, V.ufl_element().degree, shape=(3,))
    )
    owned = mesh.topology.index_map(3).size_local
    dofs = V.dofmap.list[:owned]
    nodes = V.dofmap.index_map.local_to_global(dofs.ravel().astype(np.int32)).reshape(dofs.shape)
    x = V.tabulate_dof_coordinates()[: V.dofmap.index_map.size_local]
    return compat.create_mesh(mesh.comm, nodes.astype(np.int64), coordinates, x)


def _body(comm: MPI.Comm, parts: Sequence[Part], numbers: Sequence[int]) -> Body:
    element = parts[0].element
    offsets = np.cumsum([0, *(len(p.points) for p in parts)])
    points = np.vstack([p.points for p in parts])
    cells = np.vstack([p.cells + o for p, o in zip(parts, offsets[:-1], strict=True)])
    labels = np.concatenate(
        [np.full(len(p.cells), n + 1) for p, n in zip(parts, numbers, strict=True)]
    )
    if comm.rank > 0:
        points, cells, labels = points[:0], cells[:0], labels[:0]
    cell_type = "tetrahedron" if element.startswith("tet") else "hexahedron"
    coordinates = basix.ufl.element("Lagrange", cell_type, 1, shape=(3,))
    mesh = compat.create_mesh(comm, cells.astype(np.int64), coordinates, points)
    if parts[0].isoparametric:
        assert len(parts) == 1, "tags of cells are found by the vertices of the first mesh"
        mesh = _raised(mesh, element)
        local = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
        cell_tags = dmesh.meshtags(mesh, 3, local, np.full(len(local), numbers[0] + 1, np.int32))
    else:
        cell_tags = compat.tags_from_vertices(
            mesh, 3, cells.astype(np.int64), labels.astype(np.int32)
        )

    topology = mesh.topology
    topology.create_entities(2)
    topology.create_connectivity(2, 3)
    topology.create_connectivity(3, 2)
    facets = dmesh.exterior_facet_indices(topology)
    midpoints = dmesh.compute_midpoints(mesh, 2, facets).reshape(-1, 3)
    label_of_cell = np.zeros(topology.index_map(3).size_local + topology.index_map(3).num_ghosts)
    label_of_cell[cell_tags.indices] = cell_tags.values
    to_cell = topology.connectivity(2, 3)
    owners = np.array([label_of_cell[to_cell.links(f)[0]] for f in facets])
    values = np.zeros(len(facets), dtype=np.int32)
    for part, number in zip(parts, numbers, strict=True):
        mine = owners == number + 1
        values[mine] = part.tag(midpoints[mine])
    kept = values > 0
    facet_tags = dmesh.meshtags(mesh, 2, facets[kept], values[kept])
    return Body(mesh, cell_tags, facet_tags, element, _space(mesh, element))


def _bodies(comm: MPI.Comm, parts: Sequence[Part], one_mesh: bool) -> tuple[list[Body], list[int]]:
    if one_mesh:
        if len({p.element for p in parts}) > 1:
            raise ValueError("parts with different elements cannot share a mesh")
        return [_body(comm, parts, range(len(parts)))], [0] * len(parts)
    return [_body(comm, [p], [i]) for i, p in enumerate(parts)], list(range(len(parts)))


def near(value: float) -> Callable[[np.ndarray], np.ndarray]:
    """Test for equality of coordinates up to round-off of a mesh of size one to ten."""
    return lambda x: np.abs(x - value) < 1e-8


# -- Forms, conditions, results ----------------------------------------------------------------


def displacements(case: Case) -> list[fem.Function]:
    """One zero displacement function per body."""
    return [fem.Function(body.V, name="u") for body in case.bodies]


def residuals(case: Case, u: Sequence[fem.Function]) -> list[ufl.Form]:
    """Internal minus external virtual work of each body, without the interfaces."""
    forms = []
    for b, (body, u_b) in enumerate(zip(case.bodies, u, strict=True)):
        v = ufl.TestFunction(body.V)
        degree = {"quadrature_degree": QUADRATURE_DEGREE[body.element]}
        dx = ufl.Measure("dx", body.mesh, subdomain_data=body.cell_tags, metadata=degree)
        ds = ufl.Measure("ds", body.mesh, subdomain_data=body.facet_tags)
        mine = [p for p in range(len(case.parts)) if case.body[p] == b]
        F = 0
        for energy in dict.fromkeys(case.parts[p].energy for p in mine):
            these = tuple(p + 1 for p in mine if case.parts[p].energy is energy)
            # A body of one material has the form of all such bodies
            where = dx if len(these) == len(mine) else dx(these)
            F += ufl.derivative(energy(u_b) * where, u_b, v)
        for tag in dict.fromkeys(load.tag for load in case.surface_loads):
            # Zero where the load is another body's, which then has the same form
            loads = [s.traction for s in case.surface_loads if s.tag == tag and s.part in mine]
            traction = fem.Constant(body.mesh, np.sum([np.zeros(3), *loads], axis=0))
            F -= ufl.inner(traction, v) * ds(tag)
        for load in case.nodal_loads:
            if load.part in mine:
                F -= _nodal_work(case, load, v)
        forms.append(F)
    return forms


def _nodal_work(case: Case, load: NodalLoad, v: ufl.Argument) -> ufl.Form:
    """Virtual work of forces at vertices: f . v at the vertices of cells, where f is the force per
    lumped volume."""
    body = case.bodies[case.body[load.part]]
    if body.element not in ("tet4", "hex8"):
        raise ValueError("nodal loads need first-order elements")
    vertices = {"quadrature_rule": "vertex", "quadrature_degree": 1}
    dx = ufl.Measure("dx", body.mesh, subdomain_data=body.cell_tags, metadata=vertices)
    one = fem.Constant(body.mesh, np.ones(3))
    volume = fem.assemble_vector(fem.form(ufl.inner(one, v) * dx))
    volume.scatter_reverse(la.InsertMode.add)
    volume.scatter_forward()
    f = fem.Function(body.V, name="nodal_load")
    x, dofs = _part_nodes(case, load.part)
    for point, force in zip(load.points, load.forces, strict=True):
        for d in dofs[np.linalg.norm(x[dofs] - point, axis=1) < 1e-8]:
            f.x.array[3 * d : 3 * d + 3] += force / volume.array[3 * d : 3 * d + 3]
    return ufl.inner(f, v) * dx


def _part_nodes(case: Case, part: int) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates of all nodes of the part's body, and the local nodes of the part."""
    body = case.bodies[case.body[part]]
    cells = body.cell_tags.find(part + 1)
    dofs = [body.V.dofmap.cell_dofs(c) for c in cells]
    numbers = np.unique(np.concatenate(dofs)) if dofs else np.zeros(0, dtype=int)
    return body.V.tabulate_dof_coordinates(), numbers


class DirichletConditions:
    """The Dirichlet conditions of a case, for all bodies.

    Attributes:
        bcs: For the solver.
    """

    def __init__(self, case: Case) -> None:
        self.bcs: list[fem.DirichletBC] = []
        self._values: list[tuple[fem.Constant, int | None, Callable]] = []
        for condition in case.dirichlet:
            body = case.bodies[case.body[condition.part]]
            if tuple(condition.components) == (0, 1, 2):
                dofs = fem.locate_dofs_geometrical(body.V, condition.where)
                self._add(body, dofs, body.V, None, condition.value)
                continue
            for i in condition.components:
                scalar, _ = body.V.sub(i).collapse()
                dofs, _ = fem.locate_dofs_geometrical((body.V.sub(i), scalar), condition.where)
                self._add(body, dofs, body.V.sub(i), i, condition.value)
        self.set_time(case.times[0])

    def _add(self, body, dofs, V, component, value):
        constant = fem.Constant(body.mesh, np.zeros(3) if component is None else 0.0)
        self.bcs.append(fem.dirichletbc(constant, dofs, V))
        self._values.append((constant, component, value))

    def set_time(self, t: float) -> None:
        """Set all values to those of time t."""
        for constant, component, value in self._values:
            vector = np.array(value(t), dtype=float)
            constant.value = vector if component is None else vector[component]


def make_interfaces(case: Case, **options) -> list:
    """The interfaces of a case as `dolfinx_mortar.Tie` and `Contact` objects.

    Args:
        case: The case.
        **options: For all of them, such as `multiplier`.
    """
    import dolfinx_mortar as dm

    def surface(side):
        bodies = [case.bodies[case.body[part]] for part, _ in side]
        return [(b.V, b.facet_tags, tag) for b, (_, tag) in zip(bodies, side, strict=True)]

    made = []
    for i in case.interfaces:
        more = dict(options)
        if i.kind == "contact":
            more.setdefault("friction", i.friction)
            more.setdefault("initial_active", "all" if i.initially_active else "gap")
        kind = dm.Tie if i.kind == "tie" else dm.Contact
        made.append(kind(slave=surface(i.slave), master=surface(i.master), **more))
    return made


@dataclass
class Solvable:
    """A case made into a problem."""

    u: list
    interfaces: list
    conditions: DirichletConditions
    problem: object

    @property
    def contact(self):
        """The only interface."""
        (interface,) = self.interfaces
        return interface

    def step(self, t: float) -> int:
        """Set boundary values for a time and solve; number of Newton iterations."""
        self.conditions.set_time(t)
        return self.problem.solve()


def make_problem(case: Case, forms=None, condense=None, petsc_options=None, **options) -> Solvable:
    """The `dolfinx_mortar.ContactProblem` of a case.

    Args:
        case: The case.
        forms: Residual forms, by default those of the case.
        condense, petsc_options: Of the problem.
        **options: For all interfaces, such as `multiplier`.
    """
    import dolfinx_mortar as dm

    u = displacements(case)
    interfaces = make_interfaces(case, **options)
    conditions = DirichletConditions(case)
    problem = dm.ContactProblem(
        forms or residuals(case, u),
        u,
        bcs=conditions.bcs,
        interfaces=interfaces,
        condense=condense,
        petsc_options_prefix="case_",
        petsc_options=petsc_options,
    )
    return Solvable(u, interfaces, conditions, problem)


def displacement_at(
    case: Case, u: Sequence[fem.Function], part: int, point: Sequence[float]
) -> np.ndarray:
    """Displacement of a node of a part, the same on all ranks.

    Raises:
        ValueError: There is no node at the point.
    """
    body = case.bodies[case.body[part]]
    x, dofs = _part_nodes(case, part)
    dofs = dofs[dofs < body.V.dofmap.index_map.size_local]
    found = dofs[np.linalg.norm(x[dofs] - np.array(point), axis=1) < 1e-5]
    values = u[case.body[part]].x.array.reshape(-1, 3)
    local = [values[d].tolist() for d in found]
    gathered = [v for vs in body.mesh.comm.allgather(local) for v in vs]
    if not gathered:
        raise ValueError(f"{case.parts[part].name}: no node at {tuple(point)}")
    return np.array(gathered[0])


def check_expected(case: Case, u: Sequence[fem.Function], tolerance: float | None = None) -> float:
    """Compare with the expected values.

    Args:
        case: The case.
        u: Displacements of all bodies at the last time.
        tolerance: Absolute; 4C's own for each value if omitted.

    Returns:
        The largest deviation.
    """
    worst = 0.0
    for e in case.expected:
        value = displacement_at(case, u, e.part, e.point)[e.component]
        limit = e.tolerance if tolerance is None else tolerance
        deviation = abs(value - e.value)
        worst = max(worst, deviation)
        assert deviation <= limit, (
            f"{case.source}: u[{e.component}] at {e.point} is {value:.12g}, "
            f"expected {e.value:.12g}, off by {deviation:.2e} > {limit:.0e}"
        )
    return worst


def largest_error(case: Case, u: Sequence[fem.Function]) -> float:
    """Largest deviation of a nodal displacement from the exact solution, over all parts."""
    worst = 0.0
    for part in range(len(case.parts)):
        x, dofs = _part_nodes(case, part)
        if len(dofs):
            values = u[case.body[part]].x.array.reshape(-1, 3)[dofs]
            worst = max(worst, float(np.abs(values - case.exact(part, x[dofs].T).T).max()))
    return case.bodies[0].mesh.comm.allreduce(worst, op=MPI.MAX)


def set_exact(case: Case, u: Sequence[fem.Function]) -> None:
    """Set the displacements to the exact solution at all nodes."""
    for part in range(len(case.parts)):
        x, dofs = _part_nodes(case, part)
        values = u[case.body[part]].x.array.reshape(-1, 3)
        values[dofs] = case.exact(part, x[dofs].T).T


def oracle_surface(
    V: fem.FunctionSpace, facet_tags: dmesh.MeshTags, tag: int, u: fem.Function | None = None
) -> tuple[oracle.Surface, np.ndarray]:
    """Tagged facets as a surface of plain arrays, for comparison with the oracle (serial).

    Args:
        V: Vector space of the displacement.
        facet_tags: Facet tags.
        tag: Which facets.
        u: Displacement that moves the nodes; none leaves them in the reference configuration.

    Returns:
        The surface, and for each of its nodes the (blocked) dof of V.
    """
    mesh = V.mesh
    topology = mesh.topology
    topology.create_connectivity(2, 3)
    topology.create_connectivity(3, 2)
    to_cell, to_facet = topology.connectivity(2, 3), topology.connectivity(3, 2)
    layout = V.dofmap.dof_layout
    x = V.tabulate_dof_coordinates().copy()
    if u is not None:
        x += u.x.array.reshape(-1, 3)
    count = len(layout.entity_closure_dofs(2, 0))
    kind = {3: "tri3", 6: "tri6", 4: "quad4", 8: "quad8", 9: "quad9"}[count]
    centre = oracle.REFERENCE_NODES[kind][: oracle.num_corners(kind)].mean(axis=0)
    facets, sign = [], []
    for f in facet_tags.find(tag):
        cell = to_cell.links(f)[0]
        local = int(np.flatnonzero(to_facet.links(cell) == f)[0])
        dofs = V.dofmap.cell_dofs(cell)
        nodes = dofs[layout.entity_closure_dofs(2, local)]
        middle, _ = oracle.evaluate(kind, x[nodes], centre[None])
        outward = oracle.unit_normals(kind, x[nodes], centre[None], 1.0)[0]
        sign.append(np.sign(outward @ (middle[0] - x[dofs].mean(axis=0))))
        facets.append(nodes)
    used = np.unique(facets)
    new = [(kind, np.searchsorted(used, nodes)) for nodes in facets]
    return oracle.Surface(x[used], new, np.array(sign)), used


def interface_surfaces(
    case: Case, interface: Interface, u: Sequence[fem.Function] | None = None
) -> list[tuple[oracle.Surface, np.ndarray]]:
    """Slave and master surface of an interface, for comparison with the oracle (serial).

    Returns:
        For each side the surface, and for each of its nodes the number of the body and the
        (blocked) dof, shape (nodes, 2).
    """
    sides = []
    for side in (interface.slave, interface.master):
        x, facets, sign, nodes = [], [], [], []
        for part, tag in side:
            b = case.body[part]
            body = case.bodies[b]
            surface, dofs = oracle_surface(
                body.V, body.facet_tags, tag, None if u is None else u[b]
            )
            start = sum(map(len, x))
            x.append(surface.x)
            facets += [(kind, numbers + start) for kind, numbers in surface.facets]
            sign.append(surface.sign)
            nodes.append(np.column_stack([np.full(len(dofs), b), dofs]))
        merged = oracle.Surface(np.vstack(x), facets, np.concatenate(sign))
        sides.append((merged, np.vstack(nodes)))
    return sides


# -- The cases ---------------------------------------------------------------------------------


def tied_patch_overhang(comm: MPI.Comm = MPI.COMM_WORLD, one_mesh: bool = False) -> Case:
    """Tied patch test with a slave surface (part 0, tag 1) larger than the master (part 1, tag 2).

    A block 5 x 5 x 4 on a block 10 x 10 x 4 under unit pressure; nodal forces on the uncovered part
    of the slave surface, which ends within slave facets, make the stress uniform.
    """
    lower = Part(
        "lower block",
        "hex8",
        neo_hooke(1000, 0),
        *box((-5, -5, -2), (5, 5, 2), (5, 5, 3)),
        lambda x: np.where(near(2)(x[:, 2]), 1, 0),
    )
    upper = Part(
        "upper block",
        "hex8",
        neo_hooke(1000, 0),
        *box((-2.5, -2.5, 2), (2.5, 2.5, 6), (3, 3, 3)),
        lambda x: np.select([near(2)(x[:, 2]), near(6)(x[:, 2])], [2, 3], 0),
    )
    # Uniaxial stress: E / 2 (lambda - 1 / lambda) = -1.
    stretch = -1 / 1000 + np.sqrt(1 + 1 / 1000**2)

    def exact(part, x):
        return np.stack([0 * x[0], 0 * x[0], (stretch - 1) * (x[2] + 2)])

    # int N_k over the slave surface less the footprint of the master; both are products of
    # integrals of hats in x and y.
    s = np.linspace(-5, 5, 6)
    whole = np.array([_hat_integral(a, 2.0, max(-5, a - 2), min(5, a + 2)) for a in s])
    under = np.array([_hat_integral(a, 2.0, -2.5, 2.5) for a in s])
    forces = -(np.outer(whole, whole) - np.outer(under, under))
    points = np.array([(a, b, 2.0) for a in s for b in s])
    load = NodalLoad(0, points, np.column_stack([np.zeros((36, 2)), forces.ravel()]))

    def at(*point):
        return lambda x: np.all([near(c)(x[i]) for i, c in enumerate(point)], axis=0)

    parts = [lower, upper]
    z = -0.003998000000500191
    return Case(
        "4C regression case meshtying3D_patch_lin_duallagr",
        parts,
        *_bodies(comm, parts, one_mesh),
        interfaces=[Interface("tie", [(0, 1)], [(1, 2)])],
        dirichlet=[
            Dirichlet(0, lambda x: near(-2)(x[2]), (2,)),
            Dirichlet(0, at(-5, -5, -2), (0, 1)),
            Dirichlet(0, at(-5, -3, -2), (0,)),
            Dirichlet(0, at(-3, -5, -2), (1,)),
        ],
        surface_loads=[SurfaceLoad(1, 3, (0.0, 0.0, -1.0))],
        nodal_loads=[load],
        expected=[
            Expected(part, point, i, value, 1e-8)
            for part, point in ((0, (-3, -3, 2)), (1, (-2.5, -2.5, 2)))
            for i, value in enumerate((0.0, 0.0, z))
        ],
        exact=exact,
    )


def _hat_integral(centre: float, width: float, lower: float, upper: float) -> float:
    """Integral of max(0, 1 - |s - centre| / width) from lower to upper."""

    def primitive(s):
        t = np.clip((s - centre) / width, -1, 1)
        return width * (t - np.sign(t) * t**2 / 2)

    return float(primitive(upper) - primitive(lower))


def tied_hex27(comm: MPI.Comm = MPI.COMM_WORLD, one_mesh: bool = False) -> Case:
    """Two tied unit cubes of hex27 at finite strain; slave is the upper one (part 0, tag 1).

    4C integrates the interface with a 7-point rule per triangle, too few for these functions, and
    displacements therefore agree to about 1e-6 only.
    """
    material = st_venant_kirchhoff(40000, 0.3)
    upper = Part(
        "upper cube",
        "hex27",
        material,
        *box((0.5, 0.5, 0.5), (1.5, 1.5, 1.5), (2, 2, 2)),
        lambda x: np.where(near(0.5)(x[:, 2]), 1, 0),
    )
    lower = Part(
        "lower cube",
        "hex27",
        material,
        *box((0.5, 0.5, -0.5), (1.5, 1.5, 0.5), (3, 3, 3)),
        lambda x: np.where(near(0.5)(x[:, 2]), 2, 0),
    )
    parts = [upper, lower]
    values = (0.09243866594428587, 0.15935058640433006, -0.1649821083274725)
    return Case(
        "4C regression case meshtying3D_structure_quad_const",
        parts,
        *_bodies(comm, parts, one_mesh),
        interfaces=[Interface("tie", [(0, 1)], [(1, 2)])],
        dirichlet=[
            Dirichlet(0, lambda x: near(1.5)(x[2]), value=lambda t: (0.2 * t, 0.3 * t, -0.3 * t)),
            Dirichlet(1, lambda x: near(-0.5)(x[2])),
        ],
        expected=[Expected(0, (0.75, 1.25, 0.5), i, v, 1e-8) for i, v in enumerate(values)],
    )


def tied_patch_seven(comm: MPI.Comm = MPI.COMM_WORLD) -> Case:
    """Tied patch test with five element types and all five kinds of facets.

    A prism 3 x 3 x 8 under a dead traction of 1000 at the top is cut by the sloping plane
    z = (x + y) / 3 and by vertical planes through the z axis: below along y = x (x < 0, interface
    1), y = -x (x < 0, interface 2) and y = 0 (x > 0, interface 3), above along y = 0 (x < 0,
    interface 4), y = x (x > 0, interface 5) and y = -x (x > 0, interface 6). Only the sloping
    plane, interface 7, carries traction; it has three parts on either side. Cuts, elements and
    pairs of facets are those of 4C, subdivisions nearly.

    Parts: 0 tet10, 2 hex8, 4 hex27 below; 1 tet4, 3 hex8, 5 hex20 above. Facet tags are 10 i + 1 on
    the slave side of interface i and 10 i + 2 on the master side. The exact displacement is u_z =
    (lambda - 1) (z + 4) with lambda^3 - lambda = 2 * 1000 / 22500.
    """
    c = 1.5
    material = st_venant_kirchhoff(22500, 0.0)

    def slope(x, y):
        return (x + y) / 3

    def floor(x, y):
        return -4 + 0 * x

    def ceiling(x, y):
        return 4 + 0 * x

    def on(value):
        return np.abs(value) < 1e-8

    def part(name, element, plan, layers, above, tag):
        surfaces = (slope, ceiling) if above else (floor, slope)
        cells = extrude(*plan, *surfaces, layers, tetrahedra=element.startswith("tet"))
        return Part(name, element, material, *cells, tag)

    def tag(rules):
        def evaluate(m):
            x, y, z = m.T
            slanted = on(z - (x + y) / 3)
            conditions = [test(x, y, z) & (slanted == flat) for test, flat, _ in rules]
            return np.select(conditions, [value for _, _, value in rules], 0)

        return evaluate

    def always(x, y, z):
        return np.full(len(x), True)

    o, e, w = (0, 0), (c, 0), (-c, 0)
    ne, nw, sw, se = (c, c), (-c, c), (-c, -c), (c, -c)
    on_12 = (lambda x, y, z: on(y - x) & (x < 0), lambda x, y, z: on(y + x) & (x < 0))
    on_56 = (lambda x, y, z: on(y - x) & (x > 0), lambda x, y, z: on(y + x) & (x > 0))

    def on_3(x, y, z):
        return on(y) & (x > 0)

    def on_4(x, y, z):
        return on(y) & (x < 0)

    def load(x, y, z):
        return on(z - 4)

    parts = [
        part(
            "tet10 below",
            "tet10",
            triangles_as_quads([(o, nw, w), (o, w, sw)], 1),
            4,
            False,
            tag(
                [
                    (on_12[0], False, 12),
                    (on_12[1], False, 22),
                    (always, True, 71),
                ]
            ),
        ),
        part(
            "tet4 above",
            "tet4",
            triangles_as_quads([(o, se, e), (o, e, ne)], 1),
            5,
            True,
            tag(
                [
                    (on_56[0], False, 52),
                    (on_56[1], False, 62),
                    (always, True, 72),
                    (load, False, 900),
                ]
            ),
        ),
        part(
            "hex8 below",
            "hex8",
            mapped_grid([o, e, nw, ne], 3, 3),
            6,
            False,
            tag(
                [
                    (on_12[1], False, 21),
                    (on_3, False, 32),
                    (always, True, 71),
                ]
            ),
        ),
        part(
            "hex8 above",
            "hex8",
            mapped_grid([o, w, se, sw], 3, 3),
            6,
            True,
            tag(
                [
                    (on_4, False, 41),
                    (on_56[1], False, 61),
                    (always, True, 72),
                    (load, False, 900),
                ]
            ),
        ),
        part(
            "hex27 below",
            "hex27",
            mapped_grid([o, sw, e, se], 3, 3),
            5,
            False,
            tag(
                [
                    (on_12[0], False, 11),
                    (on_3, False, 31),
                    (always, True, 71),
                ]
            ),
        ),
        part(
            "hex20 above",
            "hex20",
            mapped_grid([o, ne, w, nw], 3, 3),
            5,
            True,
            tag(
                [
                    (on_4, False, 42),
                    (on_56[0], False, 51),
                    (always, True, 72),
                    (load, False, 900),
                ]
            ),
        ),
    ]
    bodies, body = _bodies(comm, parts, False)
    pairs = ((4, 0), (2, 0), (4, 2), (3, 5), (5, 1), (3, 1))
    interfaces = [
        Interface("tie", [(slave, 10 * i + 1)], [(master, 10 * i + 2)])
        for i, (slave, master) in enumerate(pairs, start=1)
    ]
    interfaces.append(Interface("tie", [(p, 71) for p in (0, 2, 4)], [(p, 72) for p in (1, 3, 5)]))
    stretch = 1.0417885347182534

    def exact(part, x):
        return np.stack([0 * x[0], 0 * x[0], (stretch - 1) * (x[2] + 4)])

    return Case(
        "4C regression case meshtying3D_patch_bound",
        parts,
        bodies,
        body,
        interfaces=interfaces,
        dirichlet=[Dirichlet(p, lambda x: near(-4)(x[2])) for p in (0, 2, 4)],
        surface_loads=[SurfaceLoad(p, 900, (0.0, 0.0, 1000.0)) for p in (1, 3, 5)],
        exact=exact,
    )


def contact_patch(comm: MPI.Comm = MPI.COMM_WORLD, one_mesh: bool = False) -> Case:
    """Frictionless contact patch test, small strain; slave is the upper cube (part 0, tag 1).

    A cube of side 0.5 on a block 1 x 1 x 0.5 under a pressure of 100, which also acts on the free
    part of the block's top; the master surface (part 1, tag 2) is the footprint only. One linear
    step: use `geometry="reference"`.
    """
    material = linear_elastic(1000, 0.4)
    upper = Part(
        "cube",
        "hex8",
        material,
        *box((0.1, 0.1, 0), (0.6, 0.6, 0.5), (7, 7, 7)),
        lambda x: np.select([near(0)(x[:, 2]), near(0.5)(x[:, 2])], [1, 3], 0),
    )

    def lower_tag(x):
        inside = np.all((x[:, :2] > 0.1) & (x[:, :2] < 0.6), axis=1)
        return np.where(near(0)(x[:, 2]), np.where(inside, 2, 4), 0)

    lower = Part("block", "hex8", material, *box((0, 0, -0.5), (1, 1, 0), (10, 10, 5)), lower_tag)
    parts = [upper, lower]

    def exact(part, x):
        start = 0.1 if part == 0 else 0.0
        return np.stack([0.04 * (x[0] - start), 0.04 * (x[1] - start), -0.1 * (x[2] + 0.5)])

    def at(*point):
        return lambda x: np.all([near(c)(x[i]) for i, c in enumerate(point)], axis=0)

    return Case(
        "4C regression case contact3D_patch_linstatic",
        parts,
        *_bodies(comm, parts, one_mesh),
        interfaces=[Interface("contact", [(0, 1)], [(1, 2)])],
        dirichlet=[
            Dirichlet(1, lambda x: near(-0.5)(x[2]), (2,)),
            Dirichlet(1, lambda x: near(-0.5)(x[2]) & near(0)(x[0]), (0,)),
            Dirichlet(1, lambda x: near(-0.5)(x[2]) & near(0)(x[1]), (1,)),
            Dirichlet(0, at(0.1, 0.1, 0.5), (0, 1)),
            Dirichlet(0, at(0.6, 0.1, 0.5), (1,)),
            Dirichlet(0, at(0.1, 0.6, 0.5), (0,)),
        ],
        surface_loads=[
            SurfaceLoad(0, 3, (0.0, 0.0, -100.0)),
            SurfaceLoad(1, 4, (0.0, 0.0, -100.0)),
        ],
        expected=[
            Expected(0, (0.1, 0.6, 0.0), i, v, 1e-8) for i, v in enumerate((0.0, 0.02, -0.05))
        ],
        exact=exact,
    )


def rotated_block(comm: MPI.Comm = MPI.COMM_WORLD, one_mesh: bool = False) -> Case:
    """A stiff turned block of one hex8 (part 0, tag 1: slave) pressed into a slab, then moved.

    Frictionless, finite deformation. The slab is 4 x 4 x 1, held along the four bottom edges. The
    block comes down by 1 until t = 0.5 and goes by (0.2, 0.2) until t = 0.6. 4C computes it with
    inertia and a little damping, both negligible: expect agreement to about 1e-4 in statics.
    """
    a, b, low, high = 0.70922, 0.233029, 1.05, 2.1352425
    plan = np.array([(-b, -a), (a, -b), (-a, b), (b, a)])
    block = Part(
        "block",
        "hex8",
        neo_hooke(2100, 0.3),
        *extrude(plan, np.array([[0, 1, 2, 3]]), lambda x, y: low, lambda x, y: high, 1),
        lambda x: np.where(near(low)(x[:, 2]), 1, 0),
    )
    slab = Part(
        "slab",
        "hex8",
        neo_hooke(210, 0.3),
        *box((-2, -2, 0), (2, 2, 1), (8, 8, 2)),
        lambda x: np.where(near(1)(x[:, 2]), 2, 0),
    )
    parts = [block, slab]

    def motion(t):
        along = np.interp(t, [0.5, 0.6], [0.0, 0.2])
        return along, along, -np.interp(t, [0.0, 0.5], [0.0, 1.0])

    def edges(x):
        rim = near(-2)(x[0]) | near(2)(x[0]) | near(-2)(x[1]) | near(2)(x[1])
        return near(0)(x[2]) & rim

    values = (0.20156472917911633, 0.19701685928539145, -0.9765437761276978)
    return Case(
        "4C regression case contact3D_lin_duallagr",
        parts,
        *_bodies(comm, parts, one_mesh),
        interfaces=[Interface("contact", [(0, 1)], [(1, 2)], initially_active=False)],
        dirichlet=[
            Dirichlet(0, lambda x: near(high)(x[2]), value=motion),
            Dirichlet(1, edges),
        ],
        times=tuple(0.02 * (k + 1) for k in range(30)),
        expected=[Expected(0, (-b, -a, low), i, v, 1e-8) for i, v in enumerate(values)],
    )


def sliding_block(comm: MPI.Comm = MPI.COMM_WORLD, one_mesh: bool = False) -> Case:
    """A stiff hex20 cube (part 0, tag 1: slave) pressed on five soft hex20 and then dragged.

    Coulomb friction 0.8, three steps: down by 0.12, by 0.22, then 0.1 along x. The gap is 0.02 at
    the start; in the converged states all eight slave nodes stick.

    4C integrates with 7 points per triangle, too few for these functions, and takes its dual
    functions from the whole facet: `oracle.mortar` with a rule of degree 5 and `whole_facet_rules`
    of 3 x 3 points gives its displacements to 5e-8. Exact integration differs from them by 1.7e-6.
    """
    cube = Part(
        "cube",
        "hex20",
        st_venant_kirchhoff(21000, 0.0),
        *box((-0.5, -0.5, -0.48), (0.5, 0.5, 0.52), (1, 1, 1)),
        lambda x: np.where(near(-0.48)(x[:, 2]), 1, 0),
    )
    base = Part(
        "base",
        "hex20",
        st_venant_kirchhoff(210, 0.0),
        *box((-0.7, -0.55, -1.5), (4.3, 0.55, -0.5), (5, 1, 1)),
        lambda x: np.where(near(-0.5)(x[:, 2]), 2, 0),
    )
    parts = [cube, base]

    def motion(t):
        along = 0.2 * np.interp(t, [2.0, 4.0], [0.0, 1.0])
        return along, 0.0, np.interp(t, [0.0, 2.0], [-0.02, -0.22])

    values = (0.09376124226643313, -0.00015669084706571, -0.2133021497887758)
    return Case(
        "4C regression case contact3D_slidingblock_lagrange_hex20",
        parts,
        *_bodies(comm, parts, one_mesh),
        interfaces=[Interface("contact", [(0, 1)], [(1, 2)], friction=0.8, initially_active=False)],
        dirichlet=[
            Dirichlet(0, lambda x: near(0.52)(x[2]), value=motion),
            Dirichlet(1, lambda x: near(-1.5)(x[2])),
        ],
        times=(1.0, 2.0, 3.0),
        expected=[Expected(0, (-0.5, -0.5, -0.48), i, v, 1e-7) for i, v in enumerate(values)],
    )
