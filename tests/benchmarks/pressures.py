# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Contact pressures of all multiplier spaces on all kinds of second-order slave facets.

hertz     a hemisphere on a rigid plane (demo_hertz.py, small strains), against Hertz
fit       a solid shaft in a ring that is too narrow for it, against Lamé
pin       a sleeve on a rigid core, pressed into a larger hole, against a fine mesh
rollers   two layers on rigid cores, pressed on each other, against a fine mesh
sources   where errors of the fit come from: finer masters, larger oversizes, a fine master that has
          the shape of a coarse one

Each case prints a Markdown table. Errors are relative to the largest exact pressure, L2 errors to
the L2 norm of the exact pressure, both on the slave surface. "Nodal" is ``contact.pressure``, its
largest error that of the nodes with a multiplier. The other two fields have values at corners and
are (bi)linear between; they follow from the nodal contact forces f = Dᵀ z, which hold
b_c = ∫ ψ_c λ_h for the functions ψ of the corners: "lumped" is b_c / ∫ ψ_c, the average of λ_h
around the corner; "consistent" solves G p = b with G = ∫ ψ ψᵀ. Where two numbers are in a cell, the
second one is for the points within 0.85 of the contact zone. "Force" is the error of the resultant
that a prescribed motion meets, of the sign of the stiffness. On one rank only.

    python3 tests/benchmarks/pressures.py [--case fit] [--level 1] [--out pressures.json]
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import scipy.sparse as sparse
import ufl
from dolfinx import fem
from dolfinx_mortar.mesh import model_to_hex20
from scipy.sparse.linalg import spsolve

try:
    from dolfinx.io import gmsh as gmsh_reader
except ImportError:  # DOLFINx 0.9
    from dolfinx.io import gmshio as gmsh_reader

sys.path.insert(0, str(Path(__file__).parents[1]))

import nodal
import oracle
from demo_loader import load_demo

comm = MPI.COMM_WORLD
INNER, OUTER = 1, 2  # tags of facets
STIFF, SOFT = (210e3, 0.3), (70e3, 0.33)  # Young's modulus [MPa] and Poisson's ratio
SPACES = ("dual", "dual-linear", "dual-reproducing", "standard")


def spaces_on(element: str) -> tuple[str, ...]:
    """The spaces that differ on the facets of an element."""
    return tuple(s for s in SPACES if element != "hex27" or s != "dual-reproducing")


# -- Bodies ------------------------------------------------------------------------------------


@dataclass
class Sector:
    """A quarter of a cylinder or of a ring, extruded in z; lengths in mm.

    Attributes:
        element: "tet10", "hex20" or "hex27".
        radii: Inner and outer radius; an inner radius of 0 is for tetrahedra only.
        cells: Numbers of cells along the arcs, the radius and z.
        zone: Angle from the y axis up to which arcs have `cells[0]` equal cells; from there on
            `rest` cells, which grow.
        rest: See `zone`.
        growth: Ratio of adjacent cells along the radius, away from the contact surface.
        contact: Tag of the contact surface.
        centre: y of the axis.
        up: Whether angles are measured from the positive y axis.
        height: Thickness in z.
        arcs: Give the contact surface the shape of the quadratic arcs of so many cells instead of
            the circle's.
    """

    element: str
    radii: tuple[float, float]
    cells: tuple[int, int, int]
    zone: float = np.pi / 2
    rest: int = 0
    growth: float = 1.0
    contact: int = OUTER
    centre: float = 0.0
    up: bool = True
    height: float = 10.0
    arcs: int | None = None

    @property
    def size(self) -> float:
        """Length of the cells on the contact surface."""
        return self.radii[self.contact == OUTER] * self.zone / self.cells[0]

    def polar(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Radius and angle of points, shape (n, 3)."""
        y = (x[:, 1] - self.centre) * (1 if self.up else -1)
        return np.hypot(x[:, 0], y), np.arctan2(x[:, 0], y)

    def mesh(self) -> tuple:
        """The mesh, and tags of its inner and outer facets."""
        import gmsh

        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", int(self.element == "hex20"))
        gmsh.model.add("sector")
        self._build(gmsh.model)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        if self.element == "hex20":
            domain, _, tags = model_to_hex20(gmsh.model, comm)
        else:
            domain, _, tags = gmsh_reader.model_to_mesh(gmsh.model, comm, 0, gdim=3)[:3]
        gmsh.finalize()
        x = domain.geometry.x
        r, angle = self.polar(x)
        for radius in self.radii:
            # Midpoints of edges are on arcs but for a small part of their sag
            on = np.abs(r - radius) < 1e-3 * self.radii[1]
            assert np.all(np.abs(r[on] - radius) < 1e-5 * self.radii[1])
            new = np.full(on.sum(), radius)
            if self.arcs and radius == self.radii[self.contact == OUTER]:
                sector = np.pi / 2 / self.arcs
                s = 2 * (angle[on] / sector % 1) - 1
                new *= np.sqrt(1 + (1 - np.cos(sector / 2)) ** 2 * (s**4 - s**2))
            x[on, 0] = new * np.sin(angle[on])
            x[on, 1] = self.centre + (1 if self.up else -1) * new * np.cos(angle[on])
        return domain, tags

    def _build(self, model) -> None:
        geo = model.geo
        angles = [0.0, self.zone] + ([np.pi / 2] if self.rest else [])
        numbers, hexahedra = [self.cells[0], self.rest], self.element != "tet10"
        points, curves, faces = {}, {}, {}

        def point(i, k, z):
            """On the angle i and the radius k; there is one axis."""
            key = (i if self.radii[k] > 0 else 0, k, z)
            if key not in points:
                r, y = self.radii[k], self.centre
                s, c = np.sin(angles[i]), np.cos(angles[i])
                y += (1 if self.up else -1) * r * c
                points[key] = geo.addPoint(r * s, y, z * self.height)
            return key

        axis = [geo.addPoint(0, self.centre, z * self.height) for z in (0, 1)]

        def curve(p, q):
            if (p, q) not in curves:
                a, b = sorted((p, q))
                if a[0] != b[0] and a[1] == b[1]:
                    tag = geo.addCircleArc(points[a], axis[a[2]], points[b])
                    n, ratio = numbers[a[0]], 1.0
                    if a[0] == 1:  # grows from the size in the zone
                        first = self.zone / self.cells[0]
                        ratio = _ratio(first, n, np.pi / 2 - self.zone)
                else:
                    tag = geo.addLine(points[a], points[b])
                    n, ratio = (self.cells[2], 1.0) if a[2] != b[2] else (self.cells[1], 0)
                    if ratio == 0:
                        ratio = self.growth if self.contact == INNER else 1 / self.growth
                geo.mesh.setTransfiniteCurve(tag, n + 1, "Progression", ratio)
                curves[a, b], curves[b, a] = tag, -tag
            return curves[p, q]

        def face(corners, curved=False):
            corners = list(dict.fromkeys(corners))
            key = frozenset(corners)
            if key not in faces:
                turned = corners[1:] + corners[:1]
                loop = geo.addCurveLoop([curve(p, q) for p, q in zip(corners, turned)])
                add = geo.addSurfaceFilling if curved else geo.addPlaneSurface
                faces[key] = add([loop])
                if hexahedra:
                    geo.mesh.setTransfiniteSurface(faces[key])
                    geo.mesh.setRecombine(2, faces[key])
            return faces[key]

        volumes, tagged = [], {INNER: [], OUTER: []}
        for i in range(len(angles) - 1):
            plan = [(i, 0), (i + 1, 0), (i + 1, 1), (i, 1)]
            low, high = ([point(*c, z) for c in plan] for z in (0, 1))
            shell = [face(low), face(high)]
            for a, b, tag in ((0, 1, INNER), (1, 2, None), (2, 3, OUTER), (3, 0, None)):
                if low[a] != low[b]:
                    shell.append(face([low[a], low[b], high[b], high[a]], tag is not None))
                    if tag is not None:
                        tagged[tag].append(shell[-1])
            volumes.append(geo.addVolume([geo.addSurfaceLoop(shell)]))
            if hexahedra:
                geo.mesh.setTransfiniteVolume(volumes[-1])
        geo.synchronize()
        model.addPhysicalGroup(3, volumes, 1)
        for tag, members in tagged.items():
            if members:
                model.addPhysicalGroup(2, members, tag)


def _ratio(first: float, n: int, length: float) -> float:
    """Growth with which n cells, the first one given, fill a length."""
    low, high = 0.5, 10.0
    for _ in range(100):
        q = (low + high) / 2
        low, high = (q, high) if first * sum(q**i for i in range(n)) < length else (low, q)
    return q


@dataclass
class Body:
    """A meshed sector of a linear elastic material in plane strain.

    Attributes:
        sector: What is meshed.
        material: Young's modulus and Poisson's ratio.
        held: Radius at which displacements are prescribed, or None.
        motion: Displacement in y there.
    """

    sector: Sector
    material: tuple[float, float]
    held: float | None = None
    motion: float = 0.0
    made: tuple = field(default=(), repr=False)

    def __post_init__(self):
        self.made = self.made or self.sector.mesh()

    def forms(self) -> tuple[fem.Function, ufl.Form, list[fem.DirichletBC]]:
        """A new displacement, its residual and Dirichlet conditions."""
        domain, (E, nu), sector = self.made[0], self.material, self.sector
        second = ("Lagrange", 2, (3,))
        V = fem.functionspace(domain, dm.hex20(shape=(3,)) if sector.element == "hex20" else second)
        u, v = fem.Function(V), ufl.TestFunction(V)
        lmbda, mu = (fem.Constant(domain, c) for c in _lame(E, nu))
        eps = ufl.sym(ufl.grad(u))
        sigma = 2 * mu * eps + lmbda * ufl.tr(eps) * ufl.Identity(3)
        F = ufl.inner(sigma, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 5})
        near = 1e-6 * sector.radii[1]
        conditions = [
            (0, 0.0, lambda x: np.abs(x[0]) < near),
            (2, 0.0, lambda x: (x[2] < near) | (x[2] > sector.height - near)),
        ]
        if self.held is None:
            conditions.append((1, 0.0, lambda x: np.abs(x[1]) < near))
        else:
            for c, value in ((0, 0.0), (1, self.motion)):
                conditions.append(
                    (c, value, lambda x: np.abs(sector.polar(x.T)[0] - self.held) < near)
                )
        bcs = []
        for component, value, where in conditions:
            W = V.sub(component)
            dofs = fem.locate_dofs_geometrical((W, W.collapse()[0]), where)[0]
            bcs.append(fem.dirichletbc(value, dofs, W))
        return u, F, bcs


def _lame(E: float, nu: float) -> tuple[float, float]:
    return E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))


def press(
    slave: Body, master: Body, space: str, **options
) -> tuple[dm.Contact, int, Sequence[fem.Function]]:
    """Solve, in one step from zero; the contact, its Newton iterations, displacements."""
    bodies = (slave, master)
    u, F, bcs = zip(*(b.forms() for b in bodies), strict=True)
    contact = dm.Contact(
        [w.function_space for w in u],
        [b.made[1] for b in bodies],
        slave=slave.sector.contact,
        master=master.sector.contact,
        multiplier=space,
        **options,
    )
    problem = dm.ContactProblem(
        F,
        u,
        bcs=[bc for some in bcs for bc in some],
        interfaces=[contact],
        petsc_options_prefix="pressures_",
        condense=space != "standard",
    )
    return contact, problem.solve(), u


# -- Fields and their errors -------------------------------------------------------------------


class SlaveSurface:
    """Facets of the slave in the configuration of the mortar integrals, with a rule on each.

    Args:
        contact: After a solve.
        u: Displacement that moves the slave, or None.
    """

    def __init__(self, contact: dm.Contact, u: fem.Function | None = None):
        s = contact.data.slave
        self.contact, self.blocks = contact, np.array(s.local_blocks)
        nodes, offsets = np.array(s.nodes), np.array(s.offsets)
        self.facets = [nodes[a:b] for a, b in zip(offsets[:-1], offsets[1:], strict=True)]
        self.X = nodal.positions(contact)
        x = self.X if u is None else self.X + u.x.array.reshape(-1, 3)[self.blocks]
        self.kind = {6: "tri6", 8: "quad8", 9: "quad9"}[len(self.facets[0])]
        self.linear = oracle.linear_kind(self.kind)
        xi, w = oracle.facet_rule(self.kind, 8)
        self.N, dN = oracle.shape_functions(self.kind, xi)
        self.psi = oracle.shape_functions(self.linear, xi)[0]
        self.at = oracle.shape_functions(self.linear, oracle.REFERENCE_NODES[self.kind])[0]
        self.num_corners = oracle.num_corners(self.kind)
        a = np.einsum("qdn,fnx->fqdx", dN, x[np.array(self.facets)])
        self.measure = np.linalg.norm(np.cross(a[:, :, 0], a[:, :, 1]), axis=2) * w
        self.corners = np.unique([f[: self.num_corners] for f in self.facets])

    def recovered(self) -> dict[str, np.ndarray]:
        """Lumped and consistent pressure, shape (nodes,), linear between corners."""
        problem, n = self.contact.problem, len(self.X)
        rows, columns, values = self.contact.D.getValuesCSR()
        D = sparse.csr_matrix((values, columns, rows), shape=self.contact.D.getSize())
        f = (D.T @ np.array(problem.state.z)).reshape(-1, 3)[self.blocks]
        # Columns of P are the corners' functions: their values at all nodes
        P, nc = sparse.lil_matrix((n, n)), self.num_corners
        i, j, m = [], [], []
        for nodes, measure in zip(self.facets, self.measure, strict=True):
            P[np.ix_(nodes, nodes[:nc])] = self.at
            i.append(np.repeat(nodes[:nc], nc))
            j.append(np.tile(nodes[:nc], nc))
            m.append((self.psi.T @ (measure[:, None] * self.psi)).ravel())
        G = sparse.csr_matrix((np.concatenate(m), (np.concatenate(i), np.concatenate(j))), (n, n))
        P, c = P.tocsr()[:, self.corners], self.corners
        G, b = G[c][:, c], P.T @ f
        lumped = b / (G @ np.ones(len(c)))[:, None]
        consistent = np.column_stack([spsolve(G.tocsc(), b[:, k]) for k in range(3)])
        normals = nodal.normals(self.contact)[c]
        return {
            "lumped": P @ np.sum(lumped * normals, axis=1),
            "consistent": P @ np.sum(consistent * normals, axis=1),
        }

    def errors(self, exact: Callable, inside: Callable | None = None) -> dict[str, list[float]]:
        """Largest errors of nodes or corners, and of those inside if asked for, and L2 errors.

        Args:
            exact: Pressure at positions, shape (n, 3).
            inside: Flags of positions.
        """
        wanted, facets = exact(self.X), np.array(self.facets)
        points = np.einsum("qn,fnx->fqx", self.N, self.X[facets])
        there = exact(points.reshape(-1, 3)).reshape(points.shape[:2])
        fields = {"nodal": self.contact.pressure.x.array[self.blocks], **self.recovered()}
        found = {}
        for name, p in fields.items():
            at = nodal.has_multiplier(self.contact)
            if name != "nodal":
                at = np.isin(np.arange(len(p)), self.corners)
            e = np.abs(p - wanted) / there.max()
            values = np.einsum("qn,fn->fq", self.N, p[facets])
            square, norm = ((v**2 * self.measure).sum() for v in (values - there, there))
            found[name] = [float(e[at].max())]
            if inside is not None:
                found[name].append(float(e[at & inside(self.X)].max()))
            found[name].append(float(np.sqrt(square / norm)))
        return found


@dataclass
class Row:
    """A line of a table; strings say what failed."""

    setting: str
    space: str
    iterations: int = 0
    errors: dict[str, list[float]] = field(default_factory=dict)
    force: float | None = None
    failure: str = ""
    seconds: float = 0.0

    def __str__(self):
        cells = [self.setting, self.space]
        if self.failure:
            return f"| {' | '.join(cells)} | failed: {self.failure} |" + " |" * 7
        cells.append(str(self.iterations))
        for values in self.errors.values():
            cells.append(" / ".join(f"{v:.3f}" for v in values[:-1]))
            cells.append(f"{values[-1]:.4f}")
        cells.append("" if self.force is None else f"{self.force:+.4f}")
        return f"| {' | '.join(cells)} |"


HEADER = (
    "| slave on master, sizes | space | it. | nodal max | nodal L2 | lumped max | lumped L2 "
    "| consistent max | consistent L2 | force |\n|---|---|--:|--:|--:|--:|--:|--:|--:|--:|"
)


def attempt(setting: str, space: str, compute: Callable) -> Row:
    """A row of what a function returns, iterations, errors and force, or of how it fails."""
    row, start = Row(setting, space), time.perf_counter()
    try:
        row.iterations, row.errors, *rest = compute()
        row.force = rest[0] if rest else None
    except RuntimeError as error:
        row.failure = str(error).split("\n")[0][:120]
    row.seconds = time.perf_counter() - start
    print(row, flush=True)
    return row


# -- The cases ---------------------------------------------------------------------------------


def hertz(level: int) -> Iterator[Row]:
    """A hemisphere on a rigid plane: levels 0, 1 ... of demo_hertz.py."""
    demo, p = load_demo("demo_hertz"), 0.2
    largest, rho = demo.hertz(p)

    def radius(x):
        return np.hypot(x[:, 0], x[:, 1])

    def exact(x):
        return largest * np.sqrt(np.maximum(0, 1 - (radius(x) / rho) ** 2))

    def one(domain, tags, element, space):
        V = demo.displacement_space(domain, element)
        u, v = fem.Function(V), ufl.TestFunction(V)
        options = {"domain": domain, "metadata": {"quadrature_degree": 5}}
        top = ufl.ds(subdomain_data=tags, **options)(demo.TOP)
        F = ufl.derivative(demo.energy(u, "linear") * ufl.dx(**options), u, v) + p * v[2] * top
        contact = dm.Contact(
            V,
            tags,
            slave=demo.CAP,
            master=demo.MASTER,
            multiplier=space,
            geometry="reference",
            normal=(0, 0, -1),
            initial_active=lambda x: np.hypot(x[0], x[1]) < rho,
        )
        problem = dm.ContactProblem(
            F,
            u,
            bcs=demo.supports(V, tags, False),
            interfaces=[contact],
            petsc_options_prefix="pressures_",
            condense=space != "standard",
        )
        iterations = problem.solve()
        return iterations, SlaveSurface(contact).errors(exact, lambda x: radius(x) < 0.85 * rho)

    for element in ("tet10", "hex20", "hex27"):
        for number in range(level + 1):
            if (element, number) == ("tet10", 3):
                continue  # gmsh leaves tetrahedra of no volume in this mesh
            domain, tags, h = demo.levelled_mesh(element, p, number, False)
            for space in spaces_on(element):
                yield attempt(
                    f"{element} on plane, h = ρ/{rho / h:.1f}",
                    space,
                    lambda d=domain, t=tags, e=element, s=space: one(d, t, e, s),
                )


RADIUS, OUTSIDE, OVERSIZE = 20.0, 40.0, 0.02


def lame_pressure(shaft: tuple, ring: tuple, oversize: float) -> float:
    """Pressure of a solid shaft in a ring, in plane strain."""
    (E, nu), (Er, nur) = shaft, ring
    b = (OUTSIDE / RADIUS) ** 2
    soft = (1 + nu) * (1 - 2 * nu) / E + (1 + nur) * ((1 - 2 * nur) + b) / (b - 1) / Er
    return oversize / (RADIUS * soft)


def fit_bodies(shaft: tuple, ring: tuple, oversize=OVERSIZE) -> tuple[Sector, Sector]:
    """Sectors of a shaft and a ring, each given by its element and the size of its cells."""
    (s, hs), (r, hr) = shaft, ring
    arc, layers = np.pi / 2 * RADIUS, 10.0
    outer = RADIUS + oversize
    inside = Sector(s, (0.0, outer), (_count(arc, hs), _count(RADIUS, hs), _count(layers, hs)))
    radial = max(2, round((OUTSIDE - RADIUS) / hr / 1.3))
    cells = (_count(arc, hr), radial, _count(layers, hr))
    return inside, Sector(r, (RADIUS, OUTSIDE), cells, contact=INNER)


def _count(length: float, h: float) -> int:
    return max(1, round(length / h))


def fit_row(
    shaft, ring, slave, materials, space, made, setting="", oversize=OVERSIZE, arcs=None
) -> Row:
    """One press fit; `made` keeps meshes between calls."""
    sectors = fit_bodies(shaft, ring, oversize)
    sectors[1].arcs = arcs
    bodies = []
    for sector, material in zip(sectors, materials, strict=True):
        key = str(sector)
        made.setdefault(key, Body(sector, material).made)
        bodies.append(Body(sector, material, made=made[key]))
    order = bodies if slave == "shaft" else bodies[::-1]
    p = lame_pressure(*materials, oversize)

    def compute():
        contact, iterations, u = press(*order, space, initial_active="all")
        surface = SlaveSurface(contact, u[0])
        return iterations, surface.errors(lambda x: np.full(len(x), p))

    (s, hs), (r, hr) = shaft, ring
    if slave == "shaft":
        name = f"shaft {s} {hs:.3g} on {r} {hr:.3g}"
    else:
        name = f"ring {r} {hr:.3g} on {s} {hs:.3g}"
    name += ", stiff shaft" if materials[0] == STIFF else ", soft shaft"
    return attempt(name + setting, space, compute)


def fit(level: int) -> Iterator[Row]:
    """A shaft in a ring, as slaves finer and coarser than their masters."""
    made: dict = {}
    settings = [("tet10", 5.0, ring, 7.5, "shaft") for ring in ("hex27", "hex20")]
    settings += [("tet10", 7.5, ring, 5.0, "ring") for ring in ("hex20", "hex27")]
    if level > 0:
        for ring in ("hex27", "hex20"):
            settings += [("tet10", 2.5, ring, 3.75, "shaft"), ("tet10", 3.75, ring, 2.5, "shaft")]
        for ring in ("hex20", "hex27"):
            settings += [("tet10", 3.75, ring, 2.5, "ring"), ("tet10", 2.5, ring, 3.75, "ring")]
    for s, hs, r, hr, slave in settings:
        for materials in ((STIFF, SOFT), (SOFT, STIFF)):
            for space in spaces_on(s if slave == "shaft" else r):
                yield fit_row((s, hs), (r, hr), slave, materials, space, made)


def against_fine(make: Callable, pairs: Sequence[tuple], number: int, **options) -> Iterator[Row]:
    """Rows of pairs of bodies against a fine solution with hex27, a function of the angle.

    Args:
        make: Returns both sectors' bodies for elements and numbers of cells.
        pairs: Elements of slave and master and their numbers of cells.
        number: Of cells of the finest solution; one of half as many tells how far to trust it.
        options: Of the contact.
    """

    def thrust(contact, slave):
        return contact.force[1] / slave.sector.height

    fine = []
    for n in (number // 2, number):
        slave, master = make("hex27", n, "hex27", n, 1)
        contact, _, u = press(slave, master, "dual", **options)
        surface = SlaveSurface(contact, u[0])
        angle = np.round(slave.sector.polar(surface.X)[1], 9)
        at, which = np.unique(angle, return_inverse=True)
        p = surface.contact.pressure.x.array[surface.blocks]
        fine.append((at, np.bincount(which, p) / np.bincount(which), thrust(contact, slave)))
    (at, p, force), (coarse_at, coarse_p, coarse_force) = fine[1], fine[0]
    end = at[np.flatnonzero(p > 0)[-1]]
    apart = np.abs(np.interp(at, coarse_at, coarse_p) - p) / p.max()
    print(
        f"\nlargest pressure {p.max():.1f}, contact up to {np.degrees(end):.1f}°; a solution of "
        f"half the resolution differs by {apart.max():.4f}, by {apart[at < 0.85 * end].max():.4f} "
        f"inside, and its force by {coarse_force / force - 1:+.4f}\n\n{HEADER}"
    )
    for e, n, other, m in pairs:
        slave, master = make(e, n, other, m, None)

        def exact(x, slave=slave):
            return np.interp(slave.sector.polar(x)[1], at, p)

        def inside(x, slave=slave):
            return slave.sector.polar(x)[1] < 0.85 * end

        for space in spaces_on(e):

            def compute(slave=slave, master=master, space=space, exact=exact, inside=inside):
                contact, iterations, u = press(slave, master, space, **options)
                errors = SlaveSurface(contact, u[0]).errors(exact, inside)
                return iterations, errors, thrust(contact, slave) / force - 1

            sizes = [b.sector.size for b in (slave, master)]
            yield attempt(f"{e} {sizes[0]:.3g} on {other} {sizes[1]:.3g}", space, compute)


def pairs_of(counts: Sequence[tuple[int, int]]) -> list[tuple]:
    """Slaves of all elements on hex27, with numbers of cells along both contact surfaces."""
    return [(e, n, "hex27", m) for e in ("tet10", "hex20", "hex27") for n, m in counts]


def pin(level: int) -> Iterator[Row]:
    """A sleeve of radius 9.95 on a rigid core in a hole of radius 10, moved by 0.12."""
    hole, clearance, motion = 10.0, 0.05, 0.12

    def make(e, n, other, m, layers):
        height = 2.0 if layers is None else hole * np.pi / 2 / n
        r = hole - clearance
        lay = [layers or _count(height, hole * np.pi / 2 / k) for k in (n, m)]
        radial = [max(2, k // 4) for k in (n, m)]
        growth = [1.5 ** (8 / k) for k in (n, m)]
        slave = Sector(e, (4.0, r), (n, radial[0], lay[0]), growth=growth[0], height=height)
        master = Sector(
            other, (hole, 20.0), (m, radial[1], lay[1]), growth=growth[1], height=height
        )
        master.contact = INNER
        return Body(slave, STIFF, 4.0, motion), Body(master, SOFT, 20.0)

    counts = [(12, 8), (8, 12), (24, 16), (16, 24)][: 2 * (level + 1)]
    yield from against_fine(make, pairs_of(counts), 64)


def rollers(level: int) -> Iterator[Row]:
    """Layers of radii 5 to 10 on rigid cores, one moved by 0.15 onto the other."""
    radius, core, motion = 10.0, 5.0, 0.15

    def make(e, n, other, m, layers):
        height = 0.3 if layers is None else 0.2 * radius / n
        bodies = []
        for element, k, sign in ((e, n, 1), (other, m, -1)):
            lay = layers or _count(height, 0.2 * radius / k)
            rest = round(2.6 * k**0.5)
            growth = _ratio(0.2 * radius / k, rest, radius - core)
            sector = Sector(
                element,
                (core, radius),
                (k, rest, lay),
                zone=0.2,
                rest=rest,
                growth=growth,
                centre=sign * radius,
                up=sign < 0,
                height=height,
            )
            material, move = (STIFF, -motion) if sign > 0 else (SOFT, 0.0)
            bodies.append(Body(sector, material, core, move))
        return bodies

    counts = [(9, 6), (6, 9), (18, 12), (12, 18)][: 2 * (level + 1)]
    yield from against_fine(make, pairs_of(counts), 48, search_distance=0.5)


def sources(level: int) -> Iterator[Row]:
    """The fit of a tet10 shaft in a hex27 ring with one thing changed at a time."""
    made: dict = {}
    h = 5.0 / 2**level
    coarse = _count(np.pi / 2 * RADIUS, 1.5 * h)
    for space in ("dual", "dual-linear", "dual-reproducing"):

        def one(size, setting="", oversize=OVERSIZE, arcs=None, space=space):
            ring, both = ("hex27", size * h), (STIFF, SOFT)
            return fit_row(("tet10", h), ring, "shaft", both, space, made, setting, oversize, arcs)

        for size in (1.5, 1.0, 0.75):
            yield one(size)
        for factor in (4, 16):
            yield one(1.5, f", oversize x {factor}", factor * OVERSIZE)
        # Exactly a quarter of the coarse cells, whose arcs these follow closely
        quarter = np.pi / 2 * RADIUS / (4 * coarse) / h
        yield one(quarter)
        yield one(quarter, f", on {coarse} arcs", arcs=coarse)


CASES = {"hertz": hertz, "fit": fit, "pin": pin, "rollers": rollers, "sources": sources}


def main() -> None:
    """Run the cases that are asked for."""
    parser = argparse.ArgumentParser(description="Contact pressures of all multiplier spaces")
    parser.add_argument("--case", choices=CASES, nargs="+", default=list(CASES))
    parser.add_argument("--level", type=int, default=1, help="refinement, from 0")
    parser.add_argument("--out", type=Path, help="write the rows to this JSON file")
    args = parser.parse_args()
    if comm.size > 1:
        parser.error("runs on one rank only")
    rows = {}
    for name in args.case:
        start = time.perf_counter()
        print(f"\n**{name}**: {CASES[name].__doc__.splitlines()[0]}")
        if name not in ("pin", "rollers"):
            print(f"\n{HEADER}")
        rows[name] = [vars(row) for row in CASES[name](args.level)]
        print(f"\n{time.perf_counter() - start:.0f} s")
        if args.out:
            args.out.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
