# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Surfaces: nodes, owners, exchange of values, and their making from DOLFINx spaces."""

import itertools
import re

from mpi4py import MPI

import basix
import basix.ufl
import dolfinx_mortar as dm
import numpy as np
import oracle
import pytest
from distributed import KIND, distribute, fails_on_all
from dolfinx import fem, mesh
from dolfinx.mesh import CellType, GhostMode
from dolfinx_mortar import compat, cpp

comm = MPI.COMM_WORLD
kinds = pytest.mark.parametrize("kind", oracle.KINDS)
ghost_modes = pytest.mark.parametrize("mode", [GhostMode.none, GhostMode.shared_facet])


# -- Surfaces of plain arrays ------------------------------------------------------------------


def dealt(kind, seed, **options):
    rng = np.random.default_rng(seed)
    source = oracle.patch(kind, (4, 3), shuffle=True, rng=rng)
    return distribute(comm, source, rng=rng, **options)


# Facets and nodes at random, all facets on the first rank, all nodes on the last
deals = pytest.mark.parametrize(
    "options",
    [{}, {"facet_rank": 0}, {"node_rank": comm.size - 1}, {"facet_rank": 0, "node_rank": 0}],
)


@kinds
@deals
def test_numbering(kind, options):
    d = dealt(kind, 1, **options)
    s = d.surface
    count = comm.allgather(s.num_owned)
    assert s.num_global == sum(count) == len(d.source.x)
    assert s.first_owned == sum(count[: comm.rank])
    # Owned nodes first, each with its place, by block number; ghosts have their owner's number
    owned = d.nodes[: s.num_owned]
    assert (d.owner[owned] == comm.rank).all()
    assert (d.owner[d.nodes[s.num_owned :]] != comm.rank).all()
    assert np.array_equal(s.numbers[: s.num_owned], s.first_owned + np.arange(s.num_owned))
    assert (np.diff(s.blocks[: s.num_owned]) > 0).all()
    pairs = list(zip(owned, s.numbers[: s.num_owned], strict=True))
    number = {k: n for part in comm.allgather(pairs) for k, n in part}
    assert len(number) == len(d.source.x)
    assert [number[k] for k in d.nodes] == s.numbers.tolist()
    assert len(set(s.numbers.tolist())) == s.num_nodes
    # What belongs to the nodes
    assert np.array_equal(s.blocks, d.block[d.nodes])
    assert np.array_equal(s.X, d.source.x[d.nodes])


@kinds
@deals
def test_facets(kind, options):
    d = dealt(kind, 2, **options)
    s = d.surface
    assert s.num_facets == len(d.facets)
    for f, g in enumerate(d.facets):
        assert KIND[int(s.types[f])] == kind
        assert s.orientation[f] == d.source.sign[g]
        assert np.array_equal(d.nodes[d.facet_nodes(f)], d.source.facets[g][1])
    # Ghosts are there for facets only
    assert set(range(s.num_owned, s.num_nodes)) <= set(s.nodes.tolist())


def test_unused_nodes():
    """A node that no facet touches is no node of the surface, wherever it is."""
    source = oracle.patch("tri3", (3, 3))
    far = oracle.Surface(source.x, source.facets[:4], source.sign[:4])
    d = distribute(comm, far, rng=np.random.default_rng(3))
    used = np.unique(np.concatenate([k for _, k in far.facets]))
    assert d.surface.num_global == len(used)
    nodes = np.concatenate(comm.allgather(d.nodes[: d.surface.num_owned]))
    assert np.array_equal(np.sort(nodes), used)


@deals
@pytest.mark.parametrize("dtype", [np.float64, np.int8, np.int32, np.int64])
@pytest.mark.parametrize("width", [(), (3,)])
def test_scatter_forward(options, dtype, width):
    d = dealt("quad9", 4, **options)
    values = np.random.default_rng(5).integers(-99, 99, (len(d.source.x), *width)).astype(dtype)
    local = values[d.nodes]
    local[d.surface.num_owned :] = 1
    cpp.scatter_forward(d.surface, local)
    assert np.array_equal(local, values[d.nodes])


@deals
@pytest.mark.parametrize("dtype", [np.float64, np.int8, np.int32, np.int64])
@pytest.mark.parametrize("width", [(), (3,)])
def test_scatter_reverse_add(options, dtype, width):
    """Owners end with the sum of what all ranks have; ghosts keep what they had."""
    d = dealt("tri6", 6, **options)
    rng = np.random.default_rng([7, comm.rank])
    local = rng.integers(-9, 9, (d.surface.num_nodes, *width)).astype(dtype)
    total = np.zeros((len(d.source.x), *width), dtype)
    total[d.nodes] = local
    total = comm.allreduce(total)
    added = local.copy()
    cpp.scatter_reverse_add(d.surface, added)
    n = d.surface.num_owned
    assert np.array_equal(added[:n], total[d.nodes[:n]])
    assert np.array_equal(added[n:], local[n:])


@deals
def test_current_positions(options):
    d = dealt("quad8", 8, **options)
    s = d.surface
    u = np.zeros((np.max(s.local_blocks, initial=-1) + 1, 3))
    move = np.random.default_rng(9).normal(size=d.source.x.shape)
    u[s.local_blocks] = move[d.nodes]
    assert np.allclose(cpp.current_positions(s, u), d.source.x[d.nodes] + move[d.nodes])


def test_bad_displacement():
    d = dealt("quad9", 10, node_rank=comm.size - 1)
    s = d.surface
    u = np.zeros((np.max(s.local_blocks, initial=-1) + 1, 3))
    if comm.rank == comm.size - 1:
        u[s.local_blocks[2], 1] = np.nan
    message = fails_on_all(comm, cpp.current_positions, s, u)
    assert "surface node at (" in message and "not finite" in message
    assert "too few" in fails_on_all(comm, cpp.current_positions, s, np.zeros(3))


def test_bad_arrays():
    """Errors on all ranks, whichever rank has the wrong array."""
    last = comm.rank == comm.size - 1

    def create(types, blocks, sign, numbers, owned, owners, X):
        types = [cpp.FacetType(t) for t in types]
        arrays = (np.array(blocks, np.int32), np.array(sign, np.int8), np.array(numbers, np.int64))
        rest = (owned, np.array(owners, np.int32), np.array(X, float))
        return cpp.create_surface(comm.py2f(), types, *arrays, *rest)

    numbers = 3 * comm.rank + np.arange(3)
    good = ([0], [0, 1, 2], [1], numbers, 3, [], np.eye(3))
    assert create(*good).num_global == 3 * comm.size
    for i, bad, message in (
        (0, [2], "do not fit"),
        (1, [0, 1], "do not fit"),
        (2, [], "do not fit"),
        (4, 4, "do not fit"),
        (5, [0], "do not fit"),
        (6, np.eye(2), "do not fit"),
        (1, [0, 1, 3], "does not have"),
        (1, [0, -1, 2], "does not have"),
        (3, numbers[::-1], "ascend"),
        (2, [0], "orientation"),
    ):
        changed = (*good[:i], bad, *good[i + 1 :]) if last else good
        assert message in fails_on_all(comm, create, *changed)
    for owner in (-1, comm.rank, comm.size):
        ghost = ([0], [0, 1, 2], [1], numbers, 2, [owner], np.eye(3))
        assert "owned by another rank" in fails_on_all(comm, create, *(ghost if last else good))


@pytest.mark.parametrize("function", [cpp.scatter_forward, cpp.scatter_reverse_add])
def test_bad_nodal_values(function):
    """A rank with too few or too many of them does not leave the others waiting."""
    s = dealt("tri6", 11).surface
    last = comm.rank == comm.size - 1
    good = np.zeros((s.num_nodes, 3))
    for bad in (good[:-1], np.zeros((s.num_nodes + 1, 3)), np.zeros((s.num_nodes, 3, 2))):
        assert "one row" in fails_on_all(comm, function, s, bad if last else good)
    function(s, good)


def test_bad_positions():
    """Positions or fixed components of the wrong size are an error on all ranks."""
    d = dealt("quad4", 12)
    last = comm.rank == comm.size - 1
    s, x, fixed = d.surface, d.x, np.zeros(d.x.shape, np.int8)
    for bad in (x[:-1], np.vstack([x, x])):
        here = bad if last else x
        assert "three values" in fails_on_all(comm, cpp.compute_normals, s, here)
        assert "slave surface" in fails_on_all(comm, cpp.check_areas, s, here, "slave surface")
    wrong = fixed[:-1] if last else fixed
    assert "three values" in fails_on_all(comm, cpp.compute_normals, s, x, wrong)
    cpp.check_areas(s, x)
    cpp.compute_normals(s, x, fixed)


# -- Surfaces of DOLFINx spaces ----------------------------------------------------------------


def lattice_mesh(element, n, warp=lambda x: x, mirror=False, mode=GhostMode.none):
    """Unit cube of n^3 cubes (each six tetrahedra), any coordinate element of degree 1 or 2.

    Args:
        element: Scalar element of the geometry.
        n: Number of cubes along each edge.
        warp: Moves points of shape (n, 3).
        mirror: Number the vertices of cells such that the Jacobians are negative.
        mode: Ghost mode.
    """
    points = element.basix_element.points
    corners = np.array(list(itertools.product((0, 1), repeat=3)))[:, ::-1]
    if element.cell_type == basix.CellType.hexahedron:
        x, y, z = points.T
        ends = [[1 - t, t] for t in (x, y, z)]
        blend = np.array([c * b * a for a, b, c in itertools.product(*ends[::-1])]).T
        shapes = [corners]
    else:
        blend = np.column_stack([1 - points.sum(axis=1), points])
        axes = itertools.permutations(np.eye(3, dtype=int))
        paths = [np.cumsum([np.zeros(3, int), *a], axis=0) for a in axes]
        shapes = [p if np.linalg.det(p[1:] - p[0]) > 0 else p[[0, 1, 3, 2]] for p in paths]
    if mirror:
        swap = [1, 0, 3, 2, 5, 4, 7, 6] if len(corners) == len(shapes[0]) else [0, 1, 3, 2]
        shapes = [s[swap] for s in shapes]
    origins = np.array(list(itertools.product(range(n), repeat=3)))
    places = np.array([np.rint(2 * blend @ (o + s)).astype(int) for o in origins for s in shapes])
    used, cells = np.unique(places.reshape(-1, 3), axis=0, return_inverse=True)
    cells, x = cells.reshape(len(places), -1).astype(np.int64), warp(used / (2.0 * n))
    if comm.rank > 0:
        x, cells = np.empty((0, 3)), np.empty((0, cells.shape[1]), np.int64)
    partitioner = compat.cell_partitioner(mode)
    return compat.create_mesh(comm, cells, basix.ufl.blocked_element(element, (3,)), x, partitioner)


def scalar_element(name):
    if name == "S2":
        return dm.hex20()
    cell = "tetrahedron" if name[0] == "P" else "hexahedron"
    return basix.ufl.element("Lagrange", cell, int(name[1]))


def space(msh, name):
    return fem.functionspace(msh, basix.ufl.blocked_element(scalar_element(name), (3,)))


def wavy(x):
    """Moves edges out of line, keeps the cube's boundary where it is told from the inside."""
    return x + 0.05 * np.sin(2 * x[:, [1, 2, 0]] + x[:, [2, 0, 1]] ** 2)


def all_facets(msh):
    msh.topology.create_entities(2)
    m = msh.topology.index_map(2)
    return np.arange(m.size_local + m.num_ghosts, dtype=np.int32)


def boundary(msh):
    """Facets with one cell, with those of ghost cells."""
    msh.topology.create_entities(2)
    msh.topology.create_connectivity(2, 3)
    cells = msh.topology.connectivity(2, 3)
    shared = set(msh.topology.interprocess_facets())
    return np.array(
        [f for f in all_facets(msh) if len(cells.links(f)) == 1 and f not in shared], np.int32
    )


def plane(msh, axis, value):
    """Facets in a plane, with those of ghost cells."""
    msh.topology.create_entities(2)
    return mesh.locate_entities(msh, 2, lambda x: np.isclose(x[axis], value))


def numbers(*spaces):
    return cpp.number_blocks([V.dofmap.index_map for V in spaces])


def surface(V, facets, name="surface"):
    return cpp.create_surface(V._cpp_object, facets, numbers(V)[0], name)


def integrate(s, x, f):
    """Sum over all ranks of the integral of f(x, n) over the surface."""
    total = 0.0
    for i in range(s.num_facets):
        kind = KIND[int(s.types[i])]
        nodes = x[s.nodes[s.offsets[i] : s.offsets[i + 1]]]
        xi, w = oracle.facet_rule(kind, 5)
        points, a = oracle.evaluate(kind, nodes, xi)
        n = s.orientation[i] * np.cross(a[:, 0], a[:, 1])
        total = total + w @ f(points, n)
    return comm.allreduce(total)


def integrated_volume(msh):
    """Integral of |det J| over the cells of all ranks."""
    cell = msh.basix_cell()
    points, weights = basix.make_quadrature(cell, 8)
    element = msh.ufl_domain().ufl_coordinate_element()
    slopes = element.sub_elements[0].tabulate(1, points)[1:]
    owned = msh.topology.index_map(3).size_local
    x = msh.geometry.x[compat.geometry_dofmap(msh)[:owned]]
    J = np.einsum("dpk,ckx->cpxd", slopes, x)
    return comm.allreduce((np.abs(np.linalg.det(J)) @ weights).sum())


combinations = pytest.mark.parametrize(
    "name,geometry",
    [
        ("P1", "P1"),
        ("P2", "P1"),
        ("P2", "P2"),
        ("P1", "P2"),
        ("Q1", "Q1"),
        ("S2", "Q1"),
        ("Q2", "Q1"),
        ("S2", "S2"),
        ("Q2", "S2"),
        ("Q2", "Q2"),
        ("Q1", "Q2"),
        ("S2", "Q2"),
    ],
)


@combinations
@ghost_modes
@pytest.mark.parametrize("mirror", [False, True])
def test_divergence_theorem(name, geometry, mode, mirror):
    """The boundary of a curved body is closed, turned outwards, and holds its volume.

    Each facet with its node order and orientation takes part in this, whatever rank it is on.
    """
    msh = lattice_mesh(scalar_element(geometry), 3, wavy, mirror, mode)
    V = space(msh, name)
    s = surface(V, boundary(msh))
    kind = {"P1": "tri3", "P2": "tri6", "Q1": "quad4", "S2": "quad8", "Q2": "quad9"}[name]
    assert {KIND[int(t)] for t in s.types} <= {kind}
    assert comm.allreduce(s.num_facets) == 6 * 9 * (2 if name[0] == "P" else 1)

    assert np.allclose(integrate(s, s.X, lambda x, n: n), 0, atol=1e-14)
    volume = integrate(s, s.X, lambda x, n: np.einsum("ij,ij->i", x, n)) / 3
    if (name[1], geometry[1]) != ("1", "2") and (name, geometry) != ("S2", "Q2"):
        assert np.isclose(volume, integrated_volume(msh), rtol=1e-13)
    assert volume > 0.9


@combinations
@ghost_modes
def test_positions(name, geometry, mode):
    """Nodes are where the geometry is at the points of the dofs; u moves them."""
    msh = lattice_mesh(scalar_element(geometry), 2, wavy, mode=mode)
    V = space(msh, name)
    s = surface(V, boundary(msh))
    u = fem.Function(V)
    u.interpolate(lambda x: x)
    assert np.allclose(s.X, u.x.array.reshape(-1, 3)[s.local_blocks], atol=1e-14)
    assert np.array_equal(s.blocks, numbers(V)[0][s.local_blocks])
    assert np.allclose(cpp.current_positions(s, u.x.array), 2 * s.X, atol=1e-14)


@pytest.mark.parametrize("name", ["P1", "P2", "Q1", "S2", "Q2"])
@ghost_modes
def test_plane_surface(name, mode):
    """One side of a cube: numbers of facets and nodes, and the normals."""
    n = 4
    msh = lattice_mesh(scalar_element(name[0].replace("S", "Q") + "1"), n, mode=mode)
    V = space(msh, name)
    s = surface(V, plane(msh, 0, 0.0))
    count = {"1": (n + 1) ** 2, "2": (2 * n + 1) ** 2}[name[1]] - (n**2 if name == "S2" else 0)
    assert s.num_global == count
    assert comm.allreduce(s.num_facets) == n**2 * (2 if name[0] == "P" else 1)
    assert np.allclose(cpp.compute_normals(s, s.X).n, [-1, 0, 0], atol=1e-14)


def test_two_bodies():
    """Numbers of the blocks of two bodies in one vector."""
    a = space(lattice_mesh(scalar_element("P1"), 2), "P2")
    b = space(lattice_mesh(scalar_element("Q1"), 3, mode=GhostMode.shared_facet), "S2")
    n = numbers(a, b)
    maps = [V.dofmap.index_map for V in (a, b)]
    owned = np.concatenate([x[: m.size_local] for x, m in zip(n, maps, strict=True)])
    start = comm.exscan(len(owned)) or 0
    assert np.array_equal(owned, start + np.arange(len(owned)))
    for V, x, m in zip((a, b), n, maps, strict=True):
        u = fem.Function(V)
        u.x.array[: 3 * m.size_local] = np.repeat(x[: m.size_local], 3)
        u.x.scatter_forward()
        assert np.array_equal(u.x.array[::3], x)
    assert np.array_equal(numbers(a)[0][: maps[0].size_local], np.arange(*maps[0].local_range))


def test_named_facets():
    """Facets may be named twice, in any order, and by all ranks that know them."""
    msh = lattice_mesh(scalar_element("Q1"), 3, mode=GhostMode.shared_facet)
    V = space(msh, "Q2")
    facets = plane(msh, 2, 1.0)
    s = surface(V, facets)
    t = surface(V, np.concatenate([facets[::-1], facets]).astype(np.int32))
    for name in ("types", "nodes", "orientation", "numbers", "blocks"):
        assert np.array_equal(getattr(s, name), getattr(t, name))
    tags = mesh.meshtags(msh, 2, np.sort(facets), np.full(len(facets), 4, np.int32))
    t = cpp.create_surface(V._cpp_object, tags._cpp_object, 4, "slave", numbers(V)[0])
    assert np.array_equal(s.nodes, t.nodes)


# -- Errors ------------------------------------------------------------------------------------


def refused(V, facets=None):
    facets = np.zeros(0, np.int32) if facets is None else facets
    arguments = (V._cpp_object, facets, numbers(V)[0], "slave surface")
    return fails_on_all(comm, cpp.create_surface, *arguments)


def cube(cell=CellType.hexahedron, **options):
    return mesh.create_unit_cube(comm, 2, 2, 2, cell, **options)


@pytest.mark.parametrize(
    "element,cause,cure",
    [
        (("Lagrange", 1), "1 component", "(3,)"),
        (("Lagrange", 2, (2,)), "2 component", "(3,)"),
        (("Lagrange", 1, (3, 3)), "9 component", "(3,)"),
        (("Serendipity", 2, (3,)), "edge dofs are moments", "dolfinx_mortar.hex20()"),
        (("Lagrange", 3, (3,)), "16 node(s)", "degree 1 or 2"),
        (("Discontinuous Lagrange", 1, (3,)), "discontinuous", "degree 1 or 2"),
        (("Discontinuous Lagrange", 0, (3,)), "discontinuous", "degree 1 or 2"),
        (("NCE", 1), "components of the space's element are coupled", "Lagrange"),
        (basix.ufl.quadrature_element("hexahedron", (3,), degree=2), "no basis", "hex20"),
        (
            basix.ufl.mixed_element(
                [
                    basix.ufl.element("Lagrange", "hexahedron", 2, shape=(3,)),
                    basix.ufl.element("Lagrange", "hexahedron", 1),
                ]
            ),
            "mixed",
            "space of their own",
        ),
    ],
)
def test_unsupported_element(element, cause, cure):
    message = refused(fem.functionspace(cube(), element))
    assert cause in message and cure in message


def test_unsupported_tetrahedra():
    for element, cause in (
        (("Lagrange", 3, (3,)), "10 node(s)"),
        (("N1curl", 1), "coupled"),
        (("CR", 1, (3,)), "1 node(s)"),
    ):
        assert cause in refused(fem.functionspace(cube(CellType.tetrahedron), element)), element


def test_subspace():
    V = fem.functionspace(cube(), ("Lagrange", 1, (3,))).sub(0)
    assert "part of another space" in refused(V)


def test_wrong_cells():
    assert "prism" in refused(fem.functionspace(cube(CellType.prism), ("Lagrange", 1, (3,))))
    square = mesh.create_unit_square(comm, 2, 2)
    message = refused(fem.functionspace(square, ("Lagrange", 1, (3,))))
    assert "three-dimensional" in message


@ghost_modes
@pytest.mark.parametrize("cell", [CellType.hexahedron, CellType.tetrahedron])
def test_facets_inside(cell, mode):
    msh = cube(cell, ghost_mode=mode)
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    message = refused(V, plane(msh, 1, 0.5))
    assert "slave surface has facets inside the mesh" in message
    # One such facet on one rank will do
    facets = plane(msh, 1, 0.5)
    cells = msh.topology.connectivity(2, 3)
    n = msh.topology.index_map(3).size_local
    mine = [f for f in facets if (cells.links(f) < n).all()][:1]
    if comm.allreduce(len(mine)):
        message = refused(V, np.array([*plane(msh, 0, 0.0), *mine], np.int32))
        assert "inside the mesh" in message


def test_no_facets():
    msh = cube()
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    facets = plane(msh, 0, 0.0)
    tags = mesh.meshtags(msh, 2, facets, np.full(len(facets), 3, np.int32))

    def create(tag, tags=tags, V=V):
        return cpp.create_surface(V._cpp_object, tags._cpp_object, tag, "master", numbers(V)[0])

    assert create(3).num_global == 9
    message = fails_on_all(comm, create, 9)
    assert "master surface (facet tag 9) has no facets on any rank" in message

    cells = mesh.meshtags(msh, 3, np.zeros(0, np.int32), np.zeros(0, np.int32))
    assert "dimension 3" in fails_on_all(comm, create, 3, cells)
    other = fem.functionspace(cube(), ("Lagrange", 1, (3,)))
    assert "another mesh" in fails_on_all(comm, create, 3, tags, other)


def test_wrong_indices():
    msh = cube()
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    facets = plane(msh, 0, 0.0)
    if comm.rank == comm.size - 1:
        facets = np.append(facets, np.int32(10**6))
    assert "out of range" in refused(V, facets)

    def create():
        n = numbers(V)[0]
        n = n[:-1] if comm.rank == comm.size - 1 else n
        return cpp.create_surface(V._cpp_object, plane(msh, 0, 0.0), n)

    assert "needs a number" in fails_on_all(comm, create)


@pytest.mark.parametrize("cell", [CellType.hexahedron, CellType.tetrahedron])
def test_collapsed_facet(cell):
    """A facet without area is named by where it is."""
    msh = cube(cell)
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    facets = plane(msh, 0, 0.0)
    x = msh.geometry.x
    # The middle node of the side moves onto a neighbour
    x[np.linalg.norm(x - [0, 0.5, 0.5], axis=1) < 1e-8] = [0, 0.5, 0]
    message = refused(V, facets)
    assert "no area" in message
    place = re.search(r"facet of the slave surface with midpoint \((.*?)\)", message)[1]
    assert np.linalg.norm(np.array(place.split(", "), float) - [0, 0.5, 0.25]) < 0.5
