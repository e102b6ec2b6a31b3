# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""A slow, independent reference for the mortar integrals.

The library computes D, M, the weighted gap and the dual functions in compiled code that is written
for speed. This file computes the same quantities from their definitions, in plain NumPy, with
other algorithms wherever there is a choice: shape functions by inverting a Vandermonde matrix,
polygons cut half-plane by half-plane, a collapsed Gauss-Legendre rule of high order. It knows
nothing of meshes, MPI or DOLFINx: an interface is two `Surface` objects made of plain arrays.

Definition of the integrals (the segment variant):

* every facet is split into linear sub-facets (tri6: four triangles, quad8: four corner triangles
  and the quadrilateral of the edge nodes, quad9: four quadrilaterals);
* the plane of a slave sub-facet passes through the mean of its nodes, normal to n0, its outward
  unit normal at the centre;
* slave and master sub-facets whose normals oppose (n0 . n_master < 0) are projected along n0 on
  this plane; the intersection of both polygons is covered;
* a point p of the covered part belongs to that point of the real slave facet and to that point of
  the real master facet which lie on the line p + t n0;
* the measure is the current area of the real slave facet,
  dgamma = dA |a1 x a2| / |(a1 x a2) . n0|.

Nodes are ordered as in the Basix reference facet on [0, 1]^2: vertices, then edges, then the
centre. Triangles: vertices (0,0) (1,0) (0,1), edges (1,2) (0,2) (0,1). Quadrilaterals: vertices in
tensor order (0,0) (1,0) (0,1) (1,1), edges (0,1) (0,2) (1,3) (2,3). Lengths are in any one unit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

KINDS = ("tri3", "tri6", "quad4", "quad8", "quad9")
MULTIPLIERS = ("dual", "dual-linear", "dual-reproducing", "standard")

# They put the centroid of a corner's transformed function on its node.
ALPHA = {"tri6": 1 / 12, "quad8": 1 / 5}

_TRIANGLE = [(0, 0), (1, 0), (0, 1)]
_SQUARE = [(0, 0), (1, 0), (0, 1), (1, 1)]
_TRIANGLE_EDGES = [(1, 2), (0, 2), (0, 1)]
_SQUARE_EDGES = [(0, 1), (0, 2), (1, 3), (2, 3)]


def _with_midpoints(vertices, edges, centre=False):
    v = np.array(vertices, dtype=float)
    nodes = [v, np.array([(v[a] + v[b]) / 2 for a, b in edges])]
    if centre:
        nodes.append(v.mean(axis=0)[None])
    return np.vstack(nodes)


REFERENCE_NODES = {
    "tri3": np.array(_TRIANGLE, dtype=float),
    "tri6": _with_midpoints(_TRIANGLE, _TRIANGLE_EDGES),
    "quad4": np.array(_SQUARE, dtype=float),
    "quad8": _with_midpoints(_SQUARE, _SQUARE_EDGES),
    "quad9": _with_midpoints(_SQUARE, _SQUARE_EDGES, centre=True),
}

# Monomials x^p y^q that span the polynomial space of each facet.
EXPONENTS = {
    "tri3": [(0, 0), (1, 0), (0, 1)],
    "tri6": [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)],
    "quad4": [(0, 0), (1, 0), (0, 1), (1, 1)],
    "quad8": [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (2, 1), (1, 2)],
    "quad9": [(p, q) for q in range(3) for p in range(3)],
}

# Linear sub-facets as local nodes, with the sense of the facet; quadrilaterals in tensor order.
SUB_FACETS = {
    "tri3": [(0, 1, 2)],
    "tri6": [(0, 5, 4), (5, 1, 3), (4, 3, 2), (3, 4, 5)],
    "quad4": [(0, 1, 2, 3)],
    "quad8": [(0, 4, 5), (1, 6, 4), (2, 5, 7), (3, 7, 6), (4, 6, 5, 7)],
    "quad9": [(0, 4, 5, 8), (4, 1, 8, 6), (5, 8, 2, 7), (8, 6, 7, 3)],
}


def num_corners(kind: str) -> int:
    """Number of vertices of a facet kind."""
    return 3 if kind.startswith("tri") else 4


def edges(kind: str) -> list[tuple[int, int]]:
    """The two corners of each edge node; empty for first-order facets."""
    if kind in ("tri3", "quad4"):
        return []
    return _TRIANGLE_EDGES if kind == "tri6" else _SQUARE_EDGES


def linear_kind(kind: str) -> str:
    """The first-order facet with the same corners."""
    return "tri3" if kind.startswith("tri") else "quad4"


def shape_functions(kind: str, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and derivatives of the nodal shape functions.

    Args:
        kind: Facet kind.
        xi: Reference coordinates, shape (points, 2).

    Returns:
        Values, shape (points, nodes), and derivatives, shape (points, 2, nodes).
    """
    xi = np.atleast_2d(np.asarray(xi, dtype=float))
    nodes = REFERENCE_NODES[kind]
    p, q = np.array(EXPONENTS[kind]).T

    def powers(points):
        return points[:, :1] ** p, points[:, 1:] ** q

    def slopes(points):
        return p * points[:, :1] ** np.maximum(p - 1, 0), q * points[:, 1:] ** np.maximum(q - 1, 0)

    (x, y), (dx, dy), (node_x, node_y) = powers(xi), slopes(xi), powers(nodes)
    coefficients = np.linalg.inv(node_x * node_y)
    derivatives = np.stack([dx * y @ coefficients, x * dy @ coefficients], axis=1)
    return x * y @ coefficients, derivatives


def evaluate(kind: str, x: np.ndarray, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and tangents of a facet.

    Args:
        kind: Facet kind.
        x: Node coordinates, shape (nodes, 3).
        xi: Reference coordinates, shape (points, 2).

    Returns:
        Points, shape (points, 3), and tangents a1, a2, shape (points, 2, 3).
    """
    values, derivatives = shape_functions(kind, xi)
    return values @ x, derivatives @ x


def is_reproducing(kind: str, multiplier: str) -> bool:
    """Whether multiplier functions are made of the (bi)linear functions of the corners."""
    return multiplier == "dual-reproducing" and kind in ("tri6", "quad8")


def space_on(kind: str, multiplier: str) -> str:
    """The space that a facet of some kind has: "dual" in place of "dual-reproducing" on most."""
    other = multiplier == "dual-reproducing" and not is_reproducing(kind, multiplier)
    return "dual" if other else multiplier


def transformation(kind: str, multiplier: str, nonnegative: np.ndarray | None = None) -> np.ndarray:
    """T of one facet, N~^T = N^T T, so that the dofs transform as d~ = T^-1 d.

    Args:
        kind: Facet kind.
        multiplier: One of MULTIPLIERS ("standard" leaves N as it is).
        nonnegative: Flags of the facet's nodes, for "dual-reproducing": edges of partly covered
            facets.

    Returns:
        Square matrix; column k holds N~_k in terms of N.
    """
    T = np.eye(len(REFERENCE_NODES[kind]))
    corners, multiplier = num_corners(kind), space_on(kind, multiplier)
    if multiplier == "dual-reproducing":
        share, own = ALPHA[kind], 1.0
    elif multiplier == "dual" and kind in ALPHA:
        share, own = ALPHA[kind], 1 - 2 * ALPHA[kind]
    elif multiplier == "dual-linear" and kind in ("tri6", "quad8", "quad9"):
        share, own = 1 / 2, 1.0
    else:
        return T
    for e, pair in enumerate(edges(kind)):
        flagged = multiplier == "dual-reproducing" and nonnegative is not None
        T[corners + e, list(pair)] = 1 / 2 if flagged and nonnegative[corners + e] else share
        T[corners + e, corners + e] = own
    if multiplier == "dual-linear" and kind == "quad9":
        T[8, :4] = 1 / 4
    return T


def multiplier_nodes(kind: str, multiplier: str) -> np.ndarray:
    """Local nodes of a facet that have multiplier functions."""
    if space_on(kind, multiplier) == "dual":
        return np.arange(len(REFERENCE_NODES[kind]))
    if multiplier == "standard" and kind == "quad9":
        return np.arange(9)
    return np.arange(num_corners(kind))


def _primal_functions(kind: str, multiplier: str, xi: np.ndarray) -> np.ndarray:
    """The functions that span the multiplier space on a facet, shape (points, multiplier nodes):
    N~ for the dual spaces ((bi)linear ones for "dual-reproducing"), Phi itself for the standard
    one."""
    count, multiplier = len(multiplier_nodes(kind, multiplier)), space_on(kind, multiplier)
    if multiplier == "dual":
        return shape_functions(kind, xi)[0] @ transformation(kind, multiplier)
    if count == num_corners(kind):
        return shape_functions(linear_kind(kind), xi)[0]
    return shape_functions(kind, xi)[0]


@dataclass
class Surface:
    """One side of an interface.

    Attributes:
        x: Current node coordinates, shape (nodes, 3).
        facets: Kind and node numbers of each facet, in Basix reference facet order.
        sign: +1 for each facet whose a1 x a2 points out of its body, -1 for the others.
    """

    x: np.ndarray
    facets: list[tuple[str, np.ndarray]]
    sign: np.ndarray

    def moved(self, displacement: np.ndarray) -> Surface:
        """The same surface with displaced nodes, displacement of shape (nodes, 3) or (3,)."""
        return Surface(self.x + displacement, self.facets, self.sign)

    def facet(self, f: int) -> tuple[str, np.ndarray, np.ndarray, float]:
        """Kind, node numbers, node coordinates and sign of facet f."""
        kind, nodes = self.facets[f]
        return kind, nodes, self.x[nodes], float(self.sign[f])


def unit_normals(kind: str, x: np.ndarray, xi: np.ndarray, sign: float) -> np.ndarray:
    """Outward unit normals of the real facet at xi, shape (points, 3)."""
    _, a = evaluate(kind, x, xi)
    n = sign * np.cross(a[:, 0], a[:, 1])
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def averaged_normals(surface: Surface, fixed: np.ndarray | None = None) -> np.ndarray:
    """Nodal normals: the normalised sum of the unit normals of the facets at each node.

    Args:
        surface: The slave surface.
        fixed: Booleans, shape (nodes, 3): components of the sum to drop before normalising, because
            the displacement is prescribed there (symmetry planes).

    Returns:
        Shape (nodes, 3); zero at nodes without facets.
    """
    total = np.zeros_like(surface.x, dtype=float)
    for f in range(len(surface.facets)):
        kind, nodes, x, sign = surface.facet(f)
        total[nodes] += unit_normals(kind, x, REFERENCE_NODES[kind], sign)
    if fixed is not None:
        total[fixed] = 0
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.divide(total, length, out=np.zeros_like(total), where=length > 0)


def gauss_triangle(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Collapsed Gauss-Legendre rule on the reference triangle, exact to degree 2 points - 2.

    Returns:
        Points, shape (points^2, 2), and weights that sum to 1/2.
    """
    s, w = np.polynomial.legendre.leggauss(points)
    s, w = (s + 1) / 2, w / 2
    u, v = np.meshgrid(s, s, indexing="ij")
    weights = np.outer(w * (1 - s), w)
    return np.column_stack([u.ravel(), (v * (1 - u)).ravel()]), weights.ravel()


def gauss_square(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre rule on [0, 1]^2, exact to degree 2 points - 1 in each direction."""
    s, w = np.polynomial.legendre.leggauss(points)
    s, w = (s + 1) / 2, w / 2
    u, v = np.meshgrid(s, s, indexing="ij")
    return np.column_stack([u.ravel(), v.ravel()]), np.outer(w, w).ravel()


def facet_rule(kind: str, points: int) -> tuple[np.ndarray, np.ndarray]:
    """A Gauss rule on the reference facet of a kind."""
    return gauss_triangle(points) if kind.startswith("tri") else gauss_square(points)


def polygon_area(polygon: np.ndarray) -> float:
    """Signed area of a plane polygon, shape (vertices, 2), positive if counter-clockwise."""
    if len(polygon) < 3:
        return 0.0
    # Relative to a vertex: far from the origin the cross products would cancel.
    x, y = (polygon - polygon[0]).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def clip(subject: np.ndarray, window: np.ndarray) -> np.ndarray:
    """Intersection of two convex counter-clockwise polygons, cut half-plane by half-plane.

    Args:
        subject: Shape (vertices, 2).
        window: Shape (vertices, 2).

    Returns:
        The intersection, shape (vertices, 2), with no vertices if it is empty.
    """
    polygon = [np.asarray(p, dtype=float) for p in subject]
    for start, end in zip(window, np.roll(window, -1, axis=0), strict=True):
        if not polygon:
            break
        edge = end - start
        height = [edge[0] * (p[1] - start[1]) - edge[1] * (p[0] - start[0]) for p in polygon]
        kept = []
        for i, p in enumerate(polygon):
            q, hp, hq = polygon[i - 1], height[i], height[i - 1]
            if (hp > 0) != (hq > 0):
                kept.append(q + (p - q) * (hq / (hq - hp)))
            if hp > 0:
                kept.append(p)
        polygon = kept
    return np.array(polygon).reshape(-1, 2)


def _convex_pieces(polygon: np.ndarray) -> list[np.ndarray]:
    """A projected sub-facet as counter-clockwise convex polygons: a warped quadrilateral seen at an
    angle can have one reflex corner, at which it is then split."""
    if polygon_area(polygon) < 0:
        polygon = polygon[::-1]
    before, after = np.roll(polygon, 1, axis=0), np.roll(polygon, -1, axis=0)
    a, b = polygon - before, after - polygon
    turn = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    reflex = np.flatnonzero(turn < 0)
    if len(reflex) == 0:
        return [polygon]
    if len(reflex) > 1:
        raise ValueError("the projection of a quadrilateral sub-facet crosses itself")
    p = np.roll(polygon, -reflex[0], axis=0)
    return [p[[0, 1, 2]], p[[0, 2, 3]]]


def _cyclic(nodes: Sequence[int]) -> list[int]:
    return list(nodes) if len(nodes) == 3 else [nodes[0], nodes[1], nodes[3], nodes[2]]


def sub_facet_normal(x: np.ndarray, sign: float) -> np.ndarray:
    """Outward unit normal at the centre of a linear sub-facet, x of shape (3 or 4, 3)."""
    n = np.cross(x[1] - x[0], x[2] - x[0]) if len(x) == 3 else np.cross(x[3] - x[0], x[2] - x[1])
    return sign * n / np.linalg.norm(n)


def _plane_axes(n: np.ndarray) -> np.ndarray:
    """Two unit vectors normal to n and to each other: shape (3,) gives (2, 3), (points, 3) gives
    (points, 2, 3)."""
    e = np.eye(3)[np.argmin(np.abs(n), axis=-1)]
    e1 = e - np.sum(e * n, axis=-1, keepdims=True) * n
    e1 = e1 / np.linalg.norm(e1, axis=-1, keepdims=True)
    return np.stack([e1, np.cross(n, e1)], axis=-2)


def project(
    kind: str, x: np.ndarray, points: np.ndarray, directions: np.ndarray, start: np.ndarray
) -> np.ndarray:
    """Reference coordinates of the facet's points on the lines points + t directions.

    The facet's polynomial is continued beyond its edges.

    Args:
        kind: Facet kind.
        x: Node coordinates, shape (nodes, 3).
        points: Shape (points, 3).
        directions: Unit vectors, shape (3,) or (points, 3).
        start: First guess, shape (2,) or (points, 2).

    Returns:
        Shape (points, 2); NaN where Newton's method finds no intersection.
    """
    axes = np.broadcast_to(_plane_axes(np.asarray(directions)), (len(points), 2, 3))
    xi = np.array(np.broadcast_to(start, (len(points), 2)), dtype=float)
    for _ in range(60):
        y, a = evaluate(kind, x, xi)
        residual = np.einsum("pai,pi->pa", axes, y - points)
        jacobian = np.einsum("pai,pbi->pab", axes, a)
        determinant = np.linalg.det(jacobian)
        lost = ~np.isfinite(determinant) | (np.abs(determinant) < 1e-300)
        jacobian[lost], residual[lost] = np.eye(2), 0
        step = np.linalg.solve(jacobian, residual[:, :, None])[:, :, 0]
        xi = np.where(lost[:, None], np.nan, xi - step)
        # The last step of a quadratically convergent iteration says how far the iterate was off.
        if np.all(np.nan_to_num(np.abs(step), nan=0.0) < 1e-14 * (1 + np.abs(np.nan_to_num(xi)))):
            break
    y, _ = evaluate(kind, x, np.nan_to_num(xi))
    size = np.linalg.norm(np.ptp(x, axis=0))
    error = np.linalg.norm(np.einsum("pai,pi->pa", axes, y - points), axis=1)
    scale = size + np.abs(x).max()
    return np.where((error < 1e-12 * scale)[:, None], xi, np.nan)


@dataclass
class FacetPoints:
    """Integration points on the covered part of one slave facet.

    Attributes:
        xi: Reference coordinates on the slave facet, shape (points, 2).
        eta: Reference coordinates on the master facet, shape (points, 2).
        master: Master facet of each point, shape (points,).
        weight: Quadrature weights in current slave area, shape (points,).
    """

    xi: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    eta: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    master: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    weight: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @staticmethod
    def joined(parts: Sequence[FacetPoints]) -> FacetPoints:
        """All points of several sets."""
        if not parts:
            return FacetPoints()
        columns = ("xi", "eta", "master", "weight")
        return FacetPoints(*(np.concatenate([getattr(p, c) for p in parts]) for c in columns))


def facet_area(surface: Surface, f: int, points: int = 12) -> float:
    """Current area of a whole facet."""
    kind, _, x, _ = surface.facet(f)
    xi, w = facet_rule(kind, points)
    _, a = evaluate(kind, x, xi)
    return float(w @ np.linalg.norm(np.cross(a[:, 0], a[:, 1]), axis=1))


Rule = tuple[np.ndarray, np.ndarray]


def segment_points(
    slave: Surface,
    master: Surface,
    points: int = 12,
    rule: Rule | None = None,
    max_angle: float = 90.0,
) -> list[FacetPoints]:
    """Integration points of the segment variant, defined at the head of this file.

    Args:
        slave: Slave surface.
        master: Master surface.
        points: Gauss points per direction on each triangle of a clipped polygon.
        rule: Another rule on the reference triangle, points and weights, instead.
        max_angle: Sub-facets of the master whose normals are further than this [degrees] from
            opposing the slave's are left out.

    Returns:
        One entry per slave facet.
    """
    rule, rule_weights = rule or gauss_triangle(points)
    limit = -np.cos(np.radians(max_angle)) if max_angle < 90 else 0.0
    master_subs = []
    for f in range(len(master.facets)):
        kind, _, x, sign = master.facet(f)
        for sub in SUB_FACETS[kind]:
            master_subs.append((f, sub, sub_facet_normal(x[list(sub)], sign)))

    result = []
    for f in range(len(slave.facets)):
        kind, _, x, sign = slave.facet(f)
        parts = []
        for sub in SUB_FACETS[kind]:
            corners = x[list(sub)]
            x0, n0 = corners.mean(axis=0), sub_facet_normal(corners, sign)
            axes = _plane_axes(n0)
            pieces = _convex_pieces((x[_cyclic(sub)] - x0) @ axes.T)
            low = np.min([p.min(axis=0) for p in pieces], axis=0)
            high = np.max([p.max(axis=0) for p in pieces], axis=0)
            for g, master_sub, normal in master_subs:
                if n0 @ normal >= limit:
                    continue
                m_kind, _, m_x, _ = master.facet(g)
                polygon = (m_x[_cyclic(master_sub)] - x0) @ axes.T
                if np.any(polygon.max(axis=0) < low) or np.any(polygon.min(axis=0) > high):
                    continue
                flat, flat_weights = _rule_on_overlap(
                    pieces, _convex_pieces(polygon), rule, rule_weights
                )
                if len(flat) == 0:
                    continue
                p = x0 + flat @ axes
                start = REFERENCE_NODES[kind][list(sub)].mean(axis=0)
                m_start = REFERENCE_NODES[m_kind][list(master_sub)].mean(axis=0)
                xi = project(kind, x, p, n0, start)
                eta = project(m_kind, m_x, p, n0, m_start)
                if np.isnan(xi).any() or np.isnan(eta).any():
                    raise ValueError(f"slave facet {f}, master facet {g}: projection failed")
                _, a = evaluate(kind, x, xi)
                normals = np.cross(a[:, 0], a[:, 1])
                measure = np.linalg.norm(normals, axis=1) / np.abs(normals @ n0)
                weight = flat_weights * measure
                parts.append(FacetPoints(xi, eta, np.full(len(xi), g), weight))
        result.append(FacetPoints.joined(parts))
    return result


def _rule_on_overlap(pieces, m_pieces, rule, rule_weights):
    """The triangle rule on a fan of each overlap of convex polygons: points, shape (points, 2),
    and weights."""
    flat, weights = [np.zeros((0, 2))], [np.zeros(0)]
    for piece in pieces:
        for m_piece in m_pieces:
            polygon = clip(piece, m_piece)
            for i in range(1, len(polygon) - 1):
                a, b, c = polygon[0], polygon[i], polygon[i + 1]
                area = polygon_area(np.array([a, b, c]))
                if area <= 0:
                    continue
                flat.append(a + rule @ np.array([b - a, c - a]))
                weights.append(2 * area * rule_weights)
    return np.concatenate(flat), np.concatenate(weights)


def element_points(
    slave: Surface,
    master: Surface,
    rules: dict[str, Rule],
    tolerance: float = 1e-10,
) -> list[FacetPoints]:
    """Integration points of the element variant.

    Each Gauss point of the slave facet is projected along the facet's own unit normal there. Of the
    master facets that are hit within their edges, from the front, the nearest one counts; a point
    that hits none is left out.

    Args:
        slave: Slave surface.
        master: Master surface.
        rules: Points, shape (points, 2), and weights on the reference facet, for each slave kind.
        tolerance: How far outside its reference facet a hit may lie.

    Returns:
        One entry per slave facet.
    """
    result = []
    for f in range(len(slave.facets)):
        kind, _, x, sign = slave.facet(f)
        xi, w = rules[kind]
        y, a = evaluate(kind, x, xi)
        normals = np.cross(a[:, 0], a[:, 1])
        weight = w * np.linalg.norm(normals, axis=1)
        n = unit_normals(kind, x, xi, sign)
        best = np.full(len(xi), np.inf)
        hit, eta = np.full(len(xi), -1), np.full((len(xi), 2), np.nan)
        for g in range(len(master.facets)):
            m_kind, _, m_x, m_sign = master.facet(g)
            candidate = _project_inside(m_kind, m_x, y, n, tolerance)
            found = ~np.isnan(candidate[:, 0])
            if not found.any():
                continue
            z, _ = evaluate(m_kind, m_x, candidate[found])
            m_n = unit_normals(m_kind, m_x, candidate[found], m_sign)
            distance = np.abs(np.einsum("pi,pi->p", z - y[found], n[found]))
            distance[np.einsum("pi,pi->p", m_n, n[found]) >= 0] = np.inf
            better = np.flatnonzero(found)[distance < best[found]]
            best[found] = np.minimum(best[found], distance)
            hit[better], eta[better] = g, candidate[better]
        kept = hit >= 0
        result.append(FacetPoints(np.asarray(xi)[kept], eta[kept], hit[kept], weight[kept]))
    return result


def _project_inside(kind, x, points, directions, tolerance):
    """As `project`, but only hits within the facet's edges; several first guesses, since a line can
    meet the continued polynomial of a curved facet elsewhere too."""
    result = np.full((len(points), 2), np.nan)
    centre = REFERENCE_NODES[kind][: num_corners(kind)].mean(axis=0)
    for start in [centre, *((centre + v) / 2 for v in REFERENCE_NODES[kind])]:
        todo = np.flatnonzero(np.isnan(result[:, 0]))
        if len(todo) == 0:
            break
        with np.errstate(all="ignore"):
            eta = project(kind, x, points[todo], directions[todo], start)
        bounds = [eta[:, 0], eta[:, 1]]
        if kind.startswith("tri"):
            bounds.append(1 - eta[:, 0] - eta[:, 1])
        else:
            bounds += [1 - eta[:, 0], 1 - eta[:, 1]]
        inside = np.min(bounds, axis=0) >= -tolerance
        result[todo[inside]] = eta[inside]
    return result


@dataclass
class Mortar:
    """Mortar quantities of one interface. Rows without multiplier are zero.

    Attributes:
        D: Slave matrix in the nodal basis, int Phi_j N_k, shape (slave nodes, slave nodes).
        D_tilde: The same in the transformed basis, int Phi_j N~_k; D = D_tilde T^-1.
        M: Master matrix, int Phi_j (N_l o P), shape (slave nodes, master nodes).
        gap: Weighted gap -int Phi_j n . (x_s - x_m), shape (slave nodes,), length times area.
        relative: Weighted relative position int Phi_j (x_s - x_m), shape (slave nodes, 3).
        weight: int Phi_j, shape (slave nodes,), area.
        T: Basis transformation of the slave nodes.
        T_inverse: Its exact inverse.
        has_multiplier: Booleans, shape (slave nodes,): nodes that have a multiplier; they need a
            facet that is covered at least in part.
        coefficients: A_e per slave facet (identity for "standard", None where nothing is covered).
        area: Covered area per slave facet.
        slivers: Slave facets left out because too little of them is covered.
    """

    D: np.ndarray
    D_tilde: np.ndarray
    M: np.ndarray
    gap: np.ndarray
    relative: np.ndarray
    weight: np.ndarray
    T: np.ndarray
    T_inverse: np.ndarray
    has_multiplier: np.ndarray
    coefficients: list[np.ndarray | None]
    area: np.ndarray
    slivers: list[int]


def global_transformation(
    slave: Surface, multiplier: str, nonnegative: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """T and T^-1 for all nodes of a surface.

    Raises:
        ValueError: Facets of different kinds ask for different functions at a shared edge.
    """
    T, known = np.eye(len(slave.x)), {}
    for kind, nodes in slave.facets:
        flags = None if nonnegative is None else nonnegative[nodes]
        local = transformation(kind, multiplier, flags)
        for i, row in enumerate(local):
            entries = {int(nodes[k]): value for k, value in enumerate(row) if value != 0}
            if known.setdefault(int(nodes[i]), entries) != entries:
                raise ValueError(f"node {nodes[i]}: facets disagree on the basis transformation")
            T[nodes[i]] = 0
            T[nodes[i], list(entries)] = list(entries.values())
    return T, np.linalg.inv(T)


def dual_coefficients(primal: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """A_e = D_e M_e^-1 from values at integration points (equation 4.7).

    Args:
        primal: N~ at the points, shape (points, functions).
        weight: Quadrature weights, shape (points,).

    Returns:
        Shape (functions, functions), Phi_j = sum_k A_jk N~_k.
    """
    mass = primal.T @ (weight[:, None] * primal)
    scale = 1 / np.sqrt(np.diag(mass))
    inverse = scale[:, None] * np.linalg.inv(mass * np.outer(scale, scale)) * scale
    return (weight @ primal)[:, None] * inverse


def mortar(
    slave: Surface,
    master: Surface,
    multiplier: str = "dual",
    *,
    dropped: Iterable[int] = (),
    fixed: np.ndarray | None = None,
    points: int = 12,
    facet_points: list[FacetPoints] | None = None,
    normals: np.ndarray | None = None,
    sliver: float = 1e-10,
    whole_facet_rules: dict[str, Rule] | None = None,
    nonnegative: np.ndarray | None = None,
) -> Mortar:
    """All mortar integrals of one interface.

    Args:
        slave: Slave surface.
        master: Master surface.
        multiplier: One of MULTIPLIERS.
        dropped: Slave nodes that have no multiplier; on each facet their functions are shared
            equally among the facet's remaining multiplier nodes.
        fixed: Displacement components prescribed at slave nodes, shape (nodes, 3), for the normals.
        points: Gauss points per direction on each triangle (segment variant).
        facet_points: Other integration points, for instance from `element_points`.
        normals: Other nodal normals, shape (nodes, 3), instead of the averaged ones.
        sliver: Facets with a smaller covered part, relative to their area, count as uncovered.
        whole_facet_rules: For each slave kind a rule on the reference facet. With it, dual
            coefficients come from the whole facet, covered or not, and D~ is made diagonal by
            putting the row sums of M there, as 4C does for second order. With rules that are not
            exact, the functions are then biorthogonal only nearly.
        nonnegative: Flags of the slave nodes, see `transformation`.

    Returns:
        D, M, gap and what belongs to them.

    Raises:
        ValueError: A covered facet is left without multiplier nodes.
    """
    if facet_points is None:
        facet_points = segment_points(slave, master, points)
    if normals is None:
        normals = averaged_normals(slave, fixed)
    T, T_inverse = global_transformation(slave, multiplier, nonnegative)
    n_slave, n_master = len(slave.x), len(master.x)
    D, D_tilde = np.zeros((n_slave, n_slave)), np.zeros((n_slave, n_slave))
    M, gap, weight = np.zeros((n_slave, n_master)), np.zeros(n_slave), np.zeros(n_slave)
    relative = np.zeros((n_slave, 3))
    drop = np.zeros(n_slave, dtype=bool)
    drop[list(dropped)] = True
    has_multiplier = np.zeros(n_slave, dtype=bool)
    coefficients: list[np.ndarray | None] = []
    area, slivers = np.zeros(len(slave.facets)), []

    for f, quadrature in enumerate(facet_points):
        kind, nodes, x, _ = slave.facet(f)
        local = multiplier_nodes(kind, multiplier)
        area[f] = quadrature.weight.sum()
        if area[f] <= sliver * facet_area(slave, f):
            if area[f] > 0:
                slivers.append(f)
            coefficients.append(None)
            continue
        has_multiplier[nodes[local]] |= ~drop[nodes[local]]
        w, xi = quadrature.weight, quadrature.xi
        N = shape_functions(kind, xi)[0]
        primal = _primal_functions(kind, multiplier, xi)
        flags = None if nonnegative is None else nonnegative[nodes]
        N_tilde = N @ transformation(kind, multiplier, flags)
        if multiplier == "standard":
            A = np.eye(len(local))
        elif is_reproducing(kind, multiplier):
            biorthogonal = N_tilde[:, : len(local)]
            mixed = primal.T @ (w[:, None] * biorthogonal)
            A = (w @ biorthogonal)[:, None] * np.linalg.inv(mixed)
        elif whole_facet_rules is None:
            A = dual_coefficients(primal, w)
        else:
            A = _whole_facet_coefficients(kind, x, multiplier, whole_facet_rules[kind])
        coefficients.append(A)
        phi = primal @ A.T
        phi = phi @ _sharing(drop[nodes[local]], f)
        rows = nodes[local]

        normal = N @ normals[nodes]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        x_master = np.empty((len(w), 3))
        for g in np.unique(quadrature.master):
            here = quadrature.master == g
            m_kind, m_nodes, m_x, _ = master.facet(g)
            m_N = shape_functions(m_kind, quadrature.eta[here])[0]
            x_master[here] = m_N @ m_x
            M[np.ix_(rows, m_nodes)] += phi[here].T @ (w[here, None] * m_N)
        difference = N @ x - x_master
        D[np.ix_(rows, nodes)] += phi.T @ (w[:, None] * N)
        D_tilde[np.ix_(rows, nodes)] += phi.T @ (w[:, None] * N_tilde)
        weight[rows] += w @ phi
        gap[rows] -= (w * np.einsum("pi,pi->p", normal, difference)) @ phi
        relative[rows] += phi.T @ (w[:, None] * difference)
    if whole_facet_rules is not None:
        D_tilde = np.diag(M.sum(axis=1))
        D = D_tilde @ T_inverse
    return Mortar(
        D=D,
        D_tilde=D_tilde,
        M=M,
        gap=gap,
        relative=relative,
        weight=weight,
        T=T,
        T_inverse=T_inverse,
        has_multiplier=has_multiplier,
        coefficients=coefficients,
        area=area,
        slivers=slivers,
    )


def _whole_facet_coefficients(kind, x, multiplier, rule):
    xi, w = rule
    _, a = evaluate(kind, x, xi)
    weight = w * np.linalg.norm(np.cross(a[:, 0], a[:, 1]), axis=1)
    return dual_coefficients(_primal_functions(kind, multiplier, xi), weight)


def _sharing(drop: np.ndarray, f: int) -> np.ndarray:
    """S with phi_new = phi S: gives the functions of dropped nodes to the others, equally."""
    S = np.diag((~drop).astype(float))
    if drop.any():
        if drop.all():
            raise ValueError(f"slave facet {f} has no node left that has a multiplier")
        S[np.ix_(drop, ~drop)] = 1 / (~drop).sum()
    return S


def derivative(
    f: Callable[[np.ndarray], np.ndarray],
    x: np.ndarray,
    direction: np.ndarray,
    step: float,
    levels: int = 7,
    ratio: float = 2.0,
) -> tuple[np.ndarray, float]:
    """Directional derivative by central differences with Richardson extrapolation.

    Args:
        f: Function of an array, smooth within `step` of x.
        x: Where to differentiate.
        direction: Same shape as x.
        step: Largest step, in multiples of `direction`.
        levels: Number of steps tried, each smaller by `ratio`.
        ratio: Quotient of successive steps.

    Returns:
        The derivative, shaped as f(x), and an estimate of its largest absolute error.
    """
    best, best_error, row = None, np.inf, []
    for level in range(levels):
        h = step / ratio**level
        new = [(np.asarray(f(x + h * direction)) - np.asarray(f(x - h * direction))) / (2 * h)]
        for order in range(len(row)):
            factor = ratio ** (2 * (order + 1))
            new.append((factor * new[order] - row[order]) / (factor - 1))
            # Truncation and round-off both show in the spread of neighbours in the table.
            error = max(
                float(np.max(np.abs(new[-1] - new[order]))),
                float(np.max(np.abs(new[-1] - row[order]))),
            )
            if error < best_error:
                best, best_error = new[-1], error
        row = new
    return best, best_error


def jacobian(
    f: Callable[[np.ndarray], np.ndarray], x: np.ndarray, step: float, levels: int = 7
) -> tuple[np.ndarray, float]:
    """All partial derivatives of f, by `derivative` along each entry of x.

    Returns:
        Shape f(x).shape + x.shape, and an estimate of the largest absolute error.
    """
    x = np.asarray(x, dtype=float)
    columns, error = [], 0.0
    for i in range(x.size):
        direction = np.zeros(x.size)
        direction[i] = 1.0
        column, e = derivative(f, x, direction.reshape(x.shape), step, levels)
        columns.append(column)
        error = max(error, e)
    result = np.stack(columns, axis=-1)
    return result.reshape(result.shape[:-1] + x.shape), error


def patch(
    kind: str,
    cells: tuple[int, int],
    *,
    lower: tuple[float, float] = (0.0, 0.0),
    upper: tuple[float, float] = (1.0, 1.0),
    height: Callable[[np.ndarray, np.ndarray], np.ndarray] | float = 0.0,
    outward: float = 1.0,
    distort: float = 0.0,
    bend: float = 0.0,
    shuffle: bool = False,
    rng: np.random.Generator | None = None,
) -> Surface:
    """A surface over a rectangle of the x-y plane, for tests.

    Args:
        kind: Facet kind; triangles come two per cell.
        cells: Number of cells in x and y.
        lower: Smallest x and y.
        upper: Largest x and y.
        height: z as a function of x and y, or one number.
        outward: +1 if the outward normal points to +z, -1 if to -z.
        distort: Random in-plane move of the interior vertices, relative to the cell size.
        bend: Random move, in all directions, of the nodes that are not vertices, relative likewise.
        shuffle: Whether to number each facet from another vertex and in another sense.
        rng: Random numbers; needed for the last three.
    """
    nx, ny = cells
    spacing = (np.array(upper) - np.array(lower)) / cells
    grid = np.stack(np.meshgrid(range(nx + 1), range(ny + 1), indexing="ij"), axis=-1)
    vertices = np.array(lower) + spacing * grid
    if distort:
        inner = vertices[1:-1, 1:-1]
        inner += distort * spacing * rng.uniform(-1, 1, inner.shape)
    numbers: dict[tuple[int, int], int] = {}
    x: list[np.ndarray] = []
    vertex: list[bool] = []
    facets, sign = [], []
    reference = REFERENCE_NODES[kind]
    blend = shape_functions(linear_kind(kind), reference)[0]
    corners = num_corners(kind)
    for i in range(nx):
        for j in range(ny):
            square = np.array([(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)])
            sets = [square] if corners == 4 else [square[[0, 1, 2]], square[[3, 2, 1]]]
            for lattice in sets:
                if shuffle:
                    lattice = lattice[_random_symmetry(corners, rng)]
                places = np.rint(2 * blend @ lattice).astype(int)
                positions = blend @ vertices[lattice[:, 0], lattice[:, 1]]
                nodes = []
                for k, (place, position) in enumerate(zip(places, positions, strict=True)):
                    key = (int(place[0]), int(place[1]))
                    if key not in numbers:
                        numbers[key] = len(x)
                        x.append(position)
                        vertex.append(k < corners)
                    nodes.append(numbers[key])
                edge = lattice[1:3] - lattice[0]
                turn = np.sign(edge[0, 0] * edge[1, 1] - edge[0, 1] * edge[1, 0])
                facets.append((kind, np.array(nodes)))
                sign.append(outward * turn)
    xy = np.array(x)
    z = height(*xy.T) if callable(height) else np.full(len(xy), float(height))
    coordinates = np.column_stack([xy, np.broadcast_to(z, len(xy))])
    if bend:
        move = bend * spacing.min() * rng.uniform(-1, 1, coordinates.shape)
        coordinates[~np.array(vertex)] += move[~np.array(vertex)]
    return Surface(coordinates, facets, np.array(sign))


def _random_symmetry(corners: int, rng: np.random.Generator) -> list[int]:
    """A random renumbering of the vertices that keeps neighbours."""
    if corners == 3:
        return [int(i) for i in rng.permutation(3)]
    cyclic = [0, 1, 3, 2]
    start, step = int(rng.integers(4)), int(rng.choice([-1, 1]))
    a, b, d, c = (cyclic[(start + step * k) % 4] for k in range(4))
    return [a, b, c, d]
