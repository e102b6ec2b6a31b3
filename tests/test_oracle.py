# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Checks of the slow reference itself, against closed forms and exact properties."""

import itertools

import numpy as np
import oracle
import pytest

# The oracle is serial: once is enough.
pytestmark = pytest.mark.serial

DUAL = ("dual", "dual-linear")
BASIX_CELLS = {
    "tri3": "triangle",
    "tri6": "triangle",
    "quad4": "quadrilateral",
    "quad9": "quadrilateral",
}


def wavy(x, y):
    return 0.05 * np.sin(2 * x + 1) * np.cos(1.5 * y)


def curved_pair(slave_kind, master_kind, seed=0, cells=((2, 2), (3, 2)), cover=1.0):
    """Two distorted, curved surfaces; the master covers the slave up to x = cover, or all of it."""
    rng = np.random.default_rng(seed)
    bend = {"distort": 0.15, "bend": 0.03, "shuffle": True, "rng": rng}
    slave = oracle.patch(slave_kind, cells[0], height=wavy, outward=1, **bend)
    right = cover if cover < 1 else 1.2
    master = oracle.patch(
        master_kind,
        cells[1],
        lower=(-0.2, -0.2),
        upper=(right, 1.2),
        height=lambda x, y: 0.03 + 0.9 * wavy(x, y),
        outward=-1,
        **bend,
    )
    return slave, master


def rotation(seed=1):
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


@pytest.mark.parametrize("kind", oracle.KINDS)
def test_shape_functions(kind):
    nodes = oracle.REFERENCE_NODES[kind]
    N, _ = oracle.shape_functions(kind, nodes)
    assert np.allclose(N, np.eye(len(nodes)), atol=1e-14)
    xi = np.random.default_rng(0).uniform(-0.2, 1.2, (20, 2))
    N, dN = oracle.shape_functions(kind, xi)
    assert np.allclose(N.sum(axis=1), 1, atol=1e-13)
    for i in range(2):
        difference, _ = oracle.derivative(
            lambda p: oracle.shape_functions(kind, p)[0], xi, np.eye(2)[i] + 0 * xi, 0.1, levels=3
        )
        assert np.allclose(difference, dN[:, i], atol=1e-12)


@pytest.mark.parametrize("kind", BASIX_CELLS)
def test_node_order_is_that_of_basix(kind):
    basix = pytest.importorskip("basix")
    element = basix.create_element(
        basix.ElementFamily.P,
        getattr(basix.CellType, BASIX_CELLS[kind]),
        2 if kind in ("tri6", "quad9") else 1,
        basix.LagrangeVariant.gll_warped,
    )
    assert np.allclose(element.points, oracle.REFERENCE_NODES[kind], atol=1e-15)
    xi = np.random.default_rng(0).uniform(0, 1, (10, 2))
    table = element.tabulate(1, xi)[..., 0]
    N, dN = oracle.shape_functions(kind, xi)
    assert np.allclose(table[0], N, atol=1e-13)
    assert np.allclose(np.moveaxis(table[1:], 0, 1), dN, atol=1e-12)


@pytest.mark.parametrize("multiplier", oracle.MULTIPLIERS)
@pytest.mark.parametrize("kind", oracle.KINDS)
def test_transformed_functions(kind, multiplier):
    """int N~ > 0, partition of unity, and the hats of the first-order facet for "dual-linear"."""
    T = oracle.transformation(kind, multiplier)
    xi, w = oracle.facet_rule(kind, 6)
    N = oracle.shape_functions(kind, xi)[0]
    N_tilde = N @ T
    if multiplier == "dual":
        assert np.allclose(N_tilde.sum(axis=1), 1)
        assert (w @ N_tilde > 0).all()
    if multiplier == "dual-linear":
        hats = oracle.shape_functions(oracle.linear_kind(kind), xi)[0]
        assert np.allclose(N_tilde[:, : oracle.num_corners(kind)], hats, atol=1e-14)
    if multiplier == "standard":
        assert np.array_equal(T, np.eye(len(T)))


def test_corner_functions_need_the_transformation():
    """Equations 4.3 and 4.4: a corner function of quad8 integrates to -1/12, of tri6 to zero."""
    for kind, value in (("quad8", -1 / 12), ("tri6", 0.0)):
        xi, w = oracle.facet_rule(kind, 6)
        assert w @ oracle.shape_functions(kind, xi)[0][:, 0] == pytest.approx(value, abs=1e-15)


def test_inverse_transformation():
    """Equation 4.6, and the hierarchical basis of section 4.4.2."""
    for kind, alpha in oracle.ALPHA.items():
        inverse = np.linalg.inv(oracle.transformation(kind, "dual"))
        corners = oracle.num_corners(kind)
        expected = np.eye(len(inverse))
        for e, pair in enumerate(oracle.edges(kind)):
            expected[corners + e, corners + e] = 1 / (1 - 2 * alpha)
            expected[corners + e, list(pair)] = -alpha / (1 - 2 * alpha)
        assert np.allclose(inverse, expected, atol=1e-15)
    for kind in ("tri6", "quad8", "quad9"):
        T = oracle.transformation(kind, "dual-linear")
        assert np.allclose(np.linalg.inv(T), 2 * np.eye(len(T)) - T, atol=1e-15)


@pytest.mark.parametrize("kind", oracle.ALPHA)
def test_centroids_of_corner_functions_are_on_their_nodes(kind):
    """What decides on alpha: linear tractions are then reproduced by the corners."""
    xi, w = oracle.facet_rule(kind, 6)
    values = oracle.shape_functions(kind, xi)[0] @ oracle.transformation(kind, "dual")
    for c in range(oracle.num_corners(kind)):
        centroid = (w * values[:, c]) @ xi / (w @ values[:, c])
        assert np.allclose(centroid, oracle.REFERENCE_NODES[kind][c], atol=1e-14)


@pytest.mark.parametrize("points", [1, 3, 7])
def test_quadrature_rules(points):
    xi, w = oracle.gauss_triangle(points)
    for p, q in itertools.product(range(2 * points - 1), repeat=2):
        if p + q <= 2 * points - 2:
            exact = _factorial(p) * _factorial(q) / _factorial(p + q + 2)
            assert w @ (xi[:, 0] ** p * xi[:, 1] ** q) == pytest.approx(exact, rel=1e-12)
    xi, w = oracle.gauss_square(points)
    p = 2 * points - 1
    assert w @ (xi[:, 0] ** p * xi[:, 1] ** p) == pytest.approx(1 / (p + 1) ** 2, rel=1e-12)


def _factorial(n):
    return float(np.prod(np.arange(1, n + 1)))


def test_sub_facets_tile_the_facet():
    for kind in oracle.KINDS:
        nodes = oracle.REFERENCE_NODES[kind]
        areas = [oracle.polygon_area(nodes[oracle._cyclic(s)]) for s in oracle.SUB_FACETS[kind]]
        assert min(areas) > 0
        assert sum(areas) == pytest.approx(0.5 if kind.startswith("tri") else 1.0)
        for sub in oracle.SUB_FACETS[kind]:
            flat = np.column_stack([nodes[list(sub)], np.zeros(len(sub))])
            assert np.allclose(oracle.sub_facet_normal(flat, 1.0), [0, 0, 1])


def test_clip_closed_forms():
    square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=float)
    moved = square + [0.25, 0.5]
    assert oracle.polygon_area(oracle.clip(square, moved)) == pytest.approx(0.375)
    assert len(oracle.clip(square, square + [2, 0])) == 0
    assert abs(oracle.polygon_area(oracle.clip(square, square + [1, 0]))) < 1e-15
    assert oracle.polygon_area(oracle.clip(square, square)) == pytest.approx(1)
    c, s = np.sqrt(0.5), np.sqrt(0.5)
    turned = (square - 0.5) @ np.array([[c, s], [-s, c]]) + 0.5
    # A regular octagon of apothem 1/2.
    assert oracle.polygon_area(oracle.clip(square, turned)) == pytest.approx(2 * (np.sqrt(2) - 1))
    assert oracle.polygon_area(oracle.clip(turned, square)) == pytest.approx(2 * (np.sqrt(2) - 1))


def test_clip_against_sampling_of_the_corners():
    """The vertices of an intersection are the vertices of one polygon inside the other and the
    crossings of edges: collected by brute force, they must span the same area."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        a, b = (_random_convex(rng, k) for k in (4, 3))
        b = b + rng.uniform(-0.7, 0.7, 2)
        points = [p for p in a if _inside(p, b)] + [p for p in b if _inside(p, a)]
        for i, j in itertools.product(range(len(a)), range(len(b))):
            d, e = a[i] - a[i - 1], b[j] - b[j - 1]
            s, t = np.linalg.solve(np.column_stack([d, -e]), b[j - 1] - a[i - 1])
            if 0 <= s <= 1 and 0 <= t <= 1:
                points.append(a[i - 1] + s * d)
        area = 0.0
        if len(points) > 2:
            p = np.array(points)
            angle = np.arctan2(*(p - p.mean(axis=0)).T[::-1])
            area = oracle.polygon_area(p[np.argsort(angle)])
        assert oracle.polygon_area(oracle.clip(a, b)) == pytest.approx(area, abs=1e-12)


def _random_convex(rng, corners):
    angles = np.arange(corners) * 2 * np.pi / corners + rng.uniform(0, 0.8, corners)
    return np.column_stack([np.cos(angles), np.sin(angles)])


def _inside(p, polygon):
    edge = np.roll(polygon, -1, axis=0) - polygon
    d = p - polygon
    return bool(np.all(edge[:, 0] * d[:, 1] - edge[:, 1] * d[:, 0] >= 0))


@pytest.mark.parametrize("kind", oracle.KINDS)
def test_projection_finds_the_point(kind):
    rng = np.random.default_rng(5)
    surface = oracle.patch(kind, (1, 1), height=wavy, bend=0.1, shuffle=True, rng=rng)
    _, _, x, _ = surface.facet(0)
    xi = rng.uniform(0.1, 0.4, (30, 2))
    y, _ = oracle.evaluate(kind, x, xi)
    direction = np.array([0.1, -0.2, 1.0]) / np.linalg.norm([0.1, -0.2, 1.0])
    lifted = y + rng.uniform(-0.3, 0.3, (30, 1)) * direction
    found = oracle.project(kind, x, lifted, direction, np.array([0.3, 0.3]))
    assert np.allclose(found, xi, atol=1e-12)


def test_averaged_normals_of_a_sphere():
    rng = np.random.default_rng(0)
    for kind in oracle.KINDS:
        errors = []
        for n in (4, 8):
            cap = oracle.patch(
                kind,
                (n, n),
                lower=(-0.5, -0.5),
                upper=(0.5, 0.5),
                height=lambda x, y: np.sqrt(1 - x**2 - y**2),
                shuffle=True,
                rng=rng,
            )
            inner = np.abs(cap.x[:, :2]).max(axis=1) < 0.49
            normals = oracle.averaged_normals(cap)
            assert np.allclose(np.linalg.norm(normals, axis=1), 1)
            errors.append(np.abs(normals - cap.x)[inner].max())
        assert errors[1] < 0.7 * errors[0] < 0.1


def test_averaged_normals_drop_fixed_components():
    cap = oracle.patch("quad4", (2, 2), height=lambda x, y: -(x**2) - y**2)
    fixed = np.zeros((len(cap.x), 3), dtype=bool)
    fixed[:, 0] = cap.x[:, 0] == 0
    normals = oracle.averaged_normals(cap, fixed)
    assert np.all(normals[fixed[:, 0], 0] == 0)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)


def test_closed_form_of_a_partly_covered_square():
    """A unit square covered on x < c: int N_k and the mass matrix of the hats are elementary."""
    c = 0.3
    slave = oracle.patch("quad4", (1, 1))
    master = oracle.patch("tri3", (2, 3), lower=(-1, -1), upper=(c, 2), height=0.5, outward=-1)
    result = oracle.mortar(slave, master, "standard")
    hats = np.array([c - c**2 / 2, c**2 / 2])
    mass_x = np.array([[c - c**2 + c**3 / 3, c**2 / 2 - c**3 / 3], [c**2 / 2 - c**3 / 3, c**3 / 3]])
    mass_y = np.array([[1 / 3, 1 / 6], [1 / 6, 1 / 3]])
    # Node numbers of the patch follow the facet, tensor order with x first.
    assert np.allclose(result.D, np.kron(mass_y, mass_x), atol=1e-14)
    assert np.allclose(result.weight, np.kron([0.5, 0.5], hats), atol=1e-14)
    assert np.allclose(result.gap, 0.5 * result.weight, atol=1e-14)
    assert np.allclose(result.relative, -0.5 * np.outer(result.weight, [0, 0, 1]), atol=1e-14)
    assert result.area[0] == pytest.approx(c)
    dual = oracle.mortar(slave, master, "dual")
    assert np.allclose(dual.D, np.diag(np.kron([0.5, 0.5], hats)), atol=1e-13)


@pytest.mark.parametrize("cover", [1.0, 0.63])
@pytest.mark.parametrize("multiplier", oracle.MULTIPLIERS)
@pytest.mark.parametrize("slave_kind", oracle.KINDS)
def test_exact_properties_on_curved_surfaces(slave_kind, multiplier, cover):
    """Biorthogonality, row sums, D = D~ T^-1, and the gap against the relative position."""
    master_kind = oracle.KINDS[(oracle.KINDS.index(slave_kind) + 2) % 5]
    slave, master = curved_pair(slave_kind, master_kind, cover=cover)
    r = oracle.mortar(slave, master, multiplier, points=5)
    has_multiplier = np.flatnonzero(r.has_multiplier)
    assert np.allclose(r.D.sum(axis=1), r.M.sum(axis=1), atol=1e-14)
    assert np.allclose(r.D.sum(axis=1), r.weight, atol=1e-14)
    assert np.allclose(r.D_tilde @ r.T_inverse, r.D, atol=1e-13)
    assert r.weight.sum() == pytest.approx(r.area.sum())
    assert np.all(r.area <= 1.0)
    if multiplier in DUAL:
        corners = r.D_tilde[np.ix_(has_multiplier, has_multiplier)]
        assert np.allclose(corners, np.diag(r.weight[has_multiplier]), atol=1e-13)
        # Over a part of a second-order facet int N~ can have either sign.
        if cover == 1 or multiplier == "dual-linear" or slave_kind in ("tri3", "quad4"):
            assert np.all(r.weight[has_multiplier] > 0)


@pytest.mark.parametrize(
    "slave_kind,master_kind", list(itertools.product(oracle.KINDS, oracle.KINDS))
)
def test_flat_surfaces_reproduce_linear_fields(slave_kind, master_kind):
    """On a common plane D x_s = M x_m whatever the facets, and the area is the overlap's."""
    rng = np.random.default_rng(7)
    slave = oracle.patch(slave_kind, (2, 2), distort=0.2, shuffle=True, rng=rng)
    master = oracle.patch(
        master_kind, (3, 2), lower=(0.2, -0.1), upper=(1.3, 1.1), outward=-1, shuffle=True, rng=rng
    )
    r = oracle.mortar(slave, master, "dual", points=4)
    assert r.area.sum() == pytest.approx(0.8)
    assert np.allclose(r.D @ slave.x, r.M @ master.x, atol=1e-14)
    assert np.allclose(r.relative, 0, atol=1e-14)


def test_rigid_motion_of_both_sides():
    slave, master = curved_pair("quad8", "tri6", cover=0.7)
    a = oracle.mortar(slave, master, points=6)
    Q, c = rotation(), np.array([3.0, -2.0, 1.0])
    turned = [oracle.Surface(s.x @ Q.T + c, s.facets, s.sign) for s in (slave, master)]
    b = oracle.mortar(*turned, points=6)
    assert np.allclose(a.D, b.D, atol=1e-13)
    assert np.allclose(a.M, b.M, atol=1e-13)
    assert np.allclose(a.gap, b.gap, atol=1e-13)
    assert np.allclose(a.relative @ Q.T, b.relative, atol=1e-13)


def test_numbering_of_the_facets_does_not_matter():
    rng = np.random.default_rng(2)
    plain = oracle.patch("quad8", (2, 1), height=wavy)
    shuffled = oracle.patch("quad8", (2, 1), height=wavy, shuffle=True, rng=rng)
    master = oracle.patch(
        "quad9", (2, 2), lower=(-0.1, -0.1), upper=(0.8, 1.1), height=0.1, outward=-1
    )
    order = [int(np.argmin(np.linalg.norm(shuffled.x - p, axis=1))) for p in plain.x]
    a, b = (oracle.mortar(s, master, points=6) for s in (plain, shuffled))
    assert np.allclose(a.D, b.D[np.ix_(order, order)], atol=1e-13)
    assert np.allclose(a.M, b.M[order], atol=1e-13)
    assert np.allclose(a.gap, b.gap[order], atol=1e-13)


@pytest.mark.parametrize("multiplier", oracle.MULTIPLIERS)
def test_quadrature_has_converged(multiplier):
    slave, master = curved_pair("quad9", "quad8", cover=0.6, cells=((1, 1), (2, 1)))
    a = oracle.mortar(slave, master, multiplier, points=10)
    b = oracle.mortar(slave, master, multiplier, points=14)
    for name in ("D", "M", "gap", "relative"):
        assert np.allclose(getattr(a, name), getattr(b, name), atol=1e-12)


@pytest.mark.parametrize("multiplier", oracle.MULTIPLIERS)
def test_dropped_nodes_hand_their_functions_on(multiplier):
    slave, master = curved_pair("tri6", "quad4", cover=0.8)
    full = oracle.mortar(slave, master, multiplier, points=5)
    dropped = np.flatnonzero(slave.x[:, 0] < 1e-12)
    r = oracle.mortar(slave, master, multiplier, points=5, dropped=dropped)
    for name in ("D", "M", "gap", "relative", "weight"):
        assert np.all(getattr(r, name)[dropped] == 0)
        assert np.allclose(getattr(r, name).sum(axis=0), getattr(full, name).sum(axis=0))
    assert not r.has_multiplier[dropped].any()
    if multiplier in DUAL:
        kept = np.flatnonzero(r.has_multiplier)
        off_diagonal = r.D_tilde[np.ix_(kept, kept)]
        assert np.allclose(off_diagonal, np.diag(np.diag(off_diagonal)), atol=1e-13)


def test_coefficients_from_the_whole_facet():
    """With exact rules on a covered plane facet they are the same; elsewhere sums still agree."""
    rng = np.random.default_rng(4)
    slave = oracle.patch("quad8", (2, 2), shuffle=True, rng=rng)
    cover = {"height": 0.1, "outward": -1, "shuffle": True, "rng": rng}
    rules = {"quad8": oracle.gauss_square(3)}
    whole = oracle.patch("tri6", (3, 3), lower=(-1, -1), upper=(2, 2), **cover)
    a = oracle.mortar(slave, whole, points=5)
    b = oracle.mortar(slave, whole, points=5, whole_facet_rules=rules)
    assert np.allclose(a.D, b.D, atol=1e-13)
    assert np.allclose(a.M, b.M, atol=1e-13)
    part = oracle.patch("tri6", (3, 3), lower=(-1, -1), upper=(0.6, 2), **cover)
    c = oracle.mortar(slave, part, points=5, whole_facet_rules=rules)
    assert not np.allclose(c.D, oracle.mortar(slave, part, points=5).D, atol=1e-3)
    assert np.allclose(c.D.sum(axis=1), c.M.sum(axis=1), atol=1e-14)


def test_a_facet_without_multiplier_nodes_is_an_error():
    slave, master = curved_pair("quad4", "quad4")
    with pytest.raises(ValueError, match="no node left"):
        oracle.mortar(slave, master, dropped=slave.facets[0][1])


def test_facing_away_is_not_covered():
    slave, master = curved_pair("quad4", "tri3")
    away = oracle.Surface(master.x, master.facets, -master.sign)
    r = oracle.mortar(slave, away, points=3)
    assert r.area.sum() == 0
    assert np.all(r.D == 0) and np.all(r.M == 0)


def test_slivers_are_left_out():
    slave = oracle.patch("quad4", (2, 1))
    master = oracle.patch("quad4", (1, 1), upper=(0.5 + 1e-12, 1), height=0.1, outward=-1)
    r = oracle.mortar(slave, master)
    assert r.slivers == [1]
    assert r.coefficients[1] is None
    assert np.array_equal(r.has_multiplier, slave.x[:, 0] < 0.75)
    assert r.weight.sum() == pytest.approx(0.5)


@pytest.mark.parametrize("slave_kind", oracle.KINDS)
def test_element_variant_agrees_on_a_common_plane(slave_kind):
    """Without kinks below a slave facet, both variants are exact."""
    slave = oracle.patch(slave_kind, (2, 2), shuffle=True, rng=np.random.default_rng(0))
    master = oracle.patch(
        "quad4", (1, 1), lower=(-1, -1), upper=(2, 2), height=lambda x, y: 0.1 + 0.1 * x, outward=-1
    )
    rules = {slave_kind: oracle.facet_rule(slave_kind, 6)}
    element = oracle.element_points(slave, master, rules)
    a = oracle.mortar(slave, master, facet_points=element)
    b = oracle.mortar(slave, master)
    assert a.area.sum() == pytest.approx(1.0)
    for name in ("D", "M", "gap", "relative"):
        assert np.allclose(getattr(a, name), getattr(b, name), atol=1e-13)


def test_element_variant_takes_the_nearest_and_only_hits():
    slave = oracle.patch("quad4", (1, 1))
    near = oracle.patch("tri3", (1, 1), upper=(0.5, 1), height=0.2, outward=-1)
    far = oracle.patch("quad8", (1, 1), upper=(1.0, 0.5), height=1.0, outward=-1)
    joined = oracle.Surface(
        np.vstack([near.x, far.x]),
        [*near.facets, *((k, n + len(near.x)) for k, n in far.facets)],
        np.concatenate([near.sign, far.sign]),
    )
    rule = oracle.gauss_square(8)
    (points,) = oracle.element_points(slave, joined, {"quad4": rule})
    x, y = points.xi.T
    assert np.all((x < 0.5) | (y < 0.5))
    assert points.weight.sum() == pytest.approx(0.75)
    assert np.array_equal(points.master == 2, x > 0.5)


def test_derivative_knows_its_error():
    def f(x):
        return np.array([np.exp(x[0] * x[1]), np.sin(x[0])])

    x = np.array([0.7, -1.2])
    exact = np.array([[x[1], x[0]], [0, 0]]) * np.exp(x[0] * x[1])
    exact[1] = [np.cos(x[0]), 0]
    J, error = oracle.jacobian(f, x, 0.2)
    assert np.abs(J - exact).max() <= max(error, 1e-13) < 1e-10


def test_gap_varies_smoothly_with_the_nodes():
    """Away from changes of the clipped polygons the integrals are smooth: the estimated error of
    the numerical derivative is far below what a wrong term in a linearisation would make."""
    slave, master = curved_pair("quad4", "tri3", cells=((1, 1), (1, 1)), cover=0.6)
    direction = np.random.default_rng(0).normal(size=slave.x.shape)

    def gap(x):
        return oracle.mortar(oracle.Surface(x, slave.facets, slave.sign), master, points=6).gap

    value, error = oracle.derivative(gap, slave.x, direction, 1e-2)
    assert error < 1e-9 * np.abs(value).max()
