"""Meshes from arrays, gmsh and Abaqus files, and what is drawn and written of them."""

from mpi4py import MPI

import basix
import dolfinx_mortar as dm
import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx_mortar import compat
from dolfinx_mortar.mesh import (
    create_hex20_mesh,
    create_mesh,
    hex20_permutation,
    model_to_hex20,
    read_abaqus,
    tags_from_nodes,
)
from dolfinx_mortar.mesh.arrays import node_order
from dolfinx_mortar.plotting import for_output, surface
from versions import gmsh_reader

comm = MPI.COMM_WORLD


def measure(mesh, tags=None, tag=None):
    """Volume of a mesh, or area of the facets with a tag."""
    one = fem.Constant(mesh, 1.0)
    if tags is None:
        form = one * ufl.dx(domain=mesh, metadata={"quadrature_degree": 8})
    else:
        ds = ufl.ds(domain=mesh, subdomain_data=tags, metadata={"quadrature_degree": 8})
        form = one * ds(tag)
    return mesh.comm.allreduce(fem.assemble_scalar(fem.form(form)), op=MPI.SUM)


@pytest.mark.parametrize("order", ["gmsh", "vtk"])
def test_hex20_orders_agree_with_the_formats_own(order):
    """DOLFINx knows both orders for 27 nodes, whose first 20 are those of hex20."""
    from dolfinx.cpp.io import perm_gmsh, perm_vtk
    from dolfinx.mesh import CellType

    theirs = {"gmsh": perm_gmsh, "vtk": perm_vtk}[order](CellType.hexahedron, 27)
    assert hex20_permutation(order) == list(theirs[:20])


def test_exodus_order():
    """Bottom 8-11, uprights 12-15, top 16-19."""
    p = hex20_permutation("exodus")
    x = np.empty((20, 3))
    x[p] = dm.hex20().basix_element.points
    assert (x[8:12, 2] == 0).all() and (x[12:16, 2] == 0.5).all() and (x[16:, 2] == 1).all()
    assert np.allclose(x[8:12, :2], (x[:4, :2] + np.roll(x[:4, :2], -1, axis=0)) / 2)
    assert np.allclose(x[12:16, :2], x[:4, :2])
    assert np.allclose(x[16:, :2], x[8:12, :2])


@pytest.mark.parametrize("order", ["gmsh", "vtk", "abaqus", "exodus", "basix"])
def test_two_curved_cells_from_arrays(order):
    """The volume of two cells with a curved common face does not depend on the face."""
    nodes = dm.hex20().basix_element.points
    left = nodes * (1, 1, 1)
    right = nodes + (1, 0, 0)
    points, cells = np.unique(np.vstack([left, right]), axis=0, return_inverse=True)
    cells = cells.reshape(2, 20)
    middle = points[:, 0] == 1
    points[middle, 0] += 0.2 * points[middle, 1] * (1 - points[middle, 2])
    there = np.empty_like(cells)
    there[:, hex20_permutation(order)] = cells
    if comm.rank > 0:
        points, there = points[:0], there[:0]
    mesh = create_hex20_mesh(comm, points, there, order=order)
    assert measure(mesh) == pytest.approx(2, rel=1e-13)
    assert mesh.topology.index_map(3).size_global == 2


ORDERS = ("gmsh", "vtk", "abaqus", "exodus", "basix")


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("cell", ["tet4", "tet10", "hex8", "hex20", "hex27"])
def test_cells_from_arrays(cell, order):
    """The map from the reference cell, with all of its nodes, is the identity."""
    if cell == "hex27" and order in ("abaqus", "exodus"):
        with pytest.raises(ValueError, match="hex27 cells are known"):
            node_order(cell, order)
        return
    name = {"t": "tetrahedron", "h": "hexahedron"}[cell[0]]
    element = dm.hex20() if cell == "hex20" else None
    if element is None:
        element = basix.ufl.element("Lagrange", name, 2 if cell in ("tet10", "hex27") else 1)
    nodes = element.basix_element.points * (1, 2, 3)
    there = np.empty((1, len(nodes)), dtype=np.int64)
    there[:, node_order(cell, order)] = np.arange(len(nodes))
    points, cells = (nodes, there) if comm.rank == 0 else (nodes[:0], there[:0])
    mesh = create_mesh(comm, points, cells, cell, order)
    volume = 1.0 if cell[0] == "t" else 6.0
    assert measure(mesh) == pytest.approx(volume, rel=1e-12)
    x = ufl.SpatialCoordinate(mesh)
    det = fem.form(ufl.det(ufl.Jacobian(mesh)) ** 2 * ufl.dx(degree=6))
    jacobian = comm.allreduce(fem.assemble_scalar(det))
    assert jacobian == pytest.approx(36 * volume, rel=1e-12)
    moment = comm.allreduce(fem.assemble_scalar(fem.form(x[2] ** 2 * ufl.dx(degree=6))))
    assert moment == pytest.approx(9 * volume / (10 if cell[0] == "t" else 3), rel=1e-12)


def test_tables_of_tetrahedra():
    """Abaqus's ten nodes: 12, 23, 31, 14, 24, 34; gmsh swaps the last two."""
    ends = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]
    corners = basix.geometry(basix.CellType.tetrahedron)
    points = basix.ufl.element("Lagrange", "tetrahedron", 2).basix_element.points
    for order, swapped in (("abaqus", False), ("vtk", False), ("exodus", False), ("gmsh", True)):
        theirs = np.empty((10, 3))
        theirs[node_order("tet10", order)] = points
        pairs = [*ends[:4], ends[5], ends[4]] if swapped else ends
        for k, (a, b) in enumerate(pairs):
            np.testing.assert_allclose(theirs[4 + k], (corners[a] + corners[b]) / 2)


def test_tags_from_nodes():
    """Bottom and one side of a row of cells, by their corner nodes; the cells' seam is no side."""
    x = np.array([(i, j, k) for i in range(9) for j in range(2) for k in range(2)], dtype=float)
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    corners += [(a, b, 1) for a, b, _ in corners]
    number = {tuple(p): n for n, p in enumerate(x)}
    cells = [[number[i + a, b, c] for a, b, c in corners] for i in range(8)]
    points, cells = (x, cells) if comm.rank == 0 else (x[:0], np.empty((0, 8)))
    mesh = create_mesh(comm, points, cells, "hex8")
    bottom, end = np.flatnonzero(x[:, 2] == 0), np.flatnonzero(x[:, 0] == 8)
    seam = np.flatnonzero(x[:, 0] == 1)
    tags = tags_from_nodes(mesh, {4: bottom, 7: end, 9: seam})
    for tag, area in ((4, 8.0), (7, 1.0), (9, 0.0)):
        assert measure(mesh, tags, tag) == pytest.approx(area, abs=1e-12)


def test_wrong_arrays():
    with pytest.raises(ValueError, match="cell is 'prism6'"):
        create_mesh(comm, np.empty((0, 3)), np.empty((0, 6)), "prism6")
    with pytest.raises(ValueError, match="tet10 cells have 10 nodes"):
        create_mesh(comm, np.empty((0, 3)), np.empty((0, 4)), "tet10")
    with pytest.raises(ValueError, match="order is 'ansys'"):
        create_mesh(comm, np.empty((0, 3)), np.empty((0, 4)), "tet4", order="ansys")
    with pytest.raises(ValueError, match="unknown node order 'ansys'"):
        hex20_permutation("ansys")
    with pytest.raises(ValueError, match="order is 'ansys'"):
        create_hex20_mesh(comm, np.empty((0, 3)), np.empty((0, 20)), order="ansys")
    with pytest.raises(ValueError, match="20 nodes"):
        create_hex20_mesh(comm, np.empty((0, 3)), np.empty((0, 27)))


def quarter_tube(order, incomplete, recombine=True):
    """gmsh model of a quarter of a tube: radii 1 and 2, height 1; inside tagged 5, outside 6."""
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", incomplete)
    gmsh.model.add("tube")
    geo = gmsh.model.geo
    centre = geo.addPoint(0, 0, 0)
    p = [geo.addPoint(*x, 0) for x in [(1, 0), (2, 0), (0, 2), (0, 1)]]
    lines = [
        geo.addLine(p[0], p[1]),
        geo.addCircleArc(p[1], centre, p[2]),
        geo.addLine(p[2], p[3]),
        geo.addCircleArc(p[3], centre, p[0]),
    ]
    face = geo.addPlaneSurface([geo.addCurveLoop(lines)])
    for line, n in zip(lines, (3, 7, 3, 7)):
        geo.mesh.setTransfiniteCurve(line, n)
    geo.mesh.setTransfiniteSurface(face)
    if recombine:
        geo.mesh.setRecombine(2, face)
    out = geo.extrude([(2, face)], 0, 0, 1, numElements=[2], recombine=recombine)
    geo.synchronize()
    volume = next(tag for dim, tag in out if dim == 3)
    gmsh.model.addPhysicalGroup(3, [volume], 9)
    gmsh.model.addPhysicalGroup(2, [out[5][1]], 5)
    gmsh.model.addPhysicalGroup(2, [out[3][1]], 6)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(order)
    return gmsh


def on_rank_zero(make, *args):
    """A gmsh model on rank 0 and nothing on the others."""
    if comm.rank == 0:
        gmsh = make(*args)
        return gmsh.model, gmsh.finalize
    pytest.importorskip("gmsh")
    return None, lambda: None


def test_gmsh_hex20_is_curved_and_tagged():
    model, finalize = on_rank_zero(quarter_tube, 2, 1)
    mesh, cell_tags, facet_tags = model_to_hex20(model, comm)
    finalize()
    assert compat.coordinate_element(mesh).dim == 20
    # Six cells around: the error of a quadratic arc is of fourth order, that of a chord of second.
    assert measure(mesh) == pytest.approx(3 * np.pi / 4, rel=2e-5)
    assert measure(mesh, facet_tags, 5) == pytest.approx(np.pi / 2, rel=2e-5)
    assert measure(mesh, facet_tags, 6) == pytest.approx(np.pi, rel=2e-5)
    local = mesh.topology.index_map(3).size_local
    assert comm.allreduce(np.count_nonzero(cell_tags.indices[cell_tags.values == 9] < local)) == 24


def test_gmsh_lagrange():
    model, finalize = on_rank_zero(quarter_tube, 2, 0)
    mesh, _, facet_tags = gmsh_reader.model_to_mesh(model, comm, 0, gdim=3)[:3]
    finalize()
    assert compat.geometry_dofmap(mesh).shape[1] == 27
    assert measure(mesh, facet_tags, 6) == pytest.approx(np.pi, rel=2e-5)


@pytest.mark.parametrize(
    "order, incomplete, recombine", [(2, 0, True), (1, 1, True), (2, 1, False)]
)
def test_gmsh_refuses_other_cells(order, incomplete, recombine):
    model, finalize = on_rank_zero(quarter_tube, order, incomplete, recombine)
    with pytest.raises(ValueError, match="SecondOrderIncomplete"):
        model_to_hex20(model, comm)
    finalize()


# -- Abaqus ---------------------------------------------------------------

# Two unit cells of C3D20 side by side, written by hand from Abaqus's element picture.
BRICKS = """*HEADING
 Two bricks
** a comment
*NODE, NSET=ALL
{nodes}
*ELEMENT, TYPE=C3D20R, ELSET=Left
11, 1, 2, 3, 4, 5, 6, 7, 8, 101, 102, 103, 104, 105, 106, 107,
    108, 109, 110, 111, 112
*Element, type=C3D20R,
  elset=Right
12, 2, 21, 22, 3, 6, 23, 24, 7, 201, 202, 203, 102, 204, 205, 206,
    106, 110, 207, 208, 111
*NSET, NSET=BOTTOM
1, 2, 3, 4, 21, 22, 101, 102, 103, 104
201, 202, 203
*ELSET, ELSET=BOTH, GENERATE
11, 12, 1
*SURFACE, NAME=Top, TYPE=ELEMENT
BOTH, S2
*SURFACE, NAME=End
12, S4
*MATERIAL, NAME=STEEL
*ELASTIC
210000., 0.3
"""

CORNERS = {
    **dict(zip(range(1, 9), [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)] + [None] * 4)),
    **{21: (2, 0, 0), 22: (2, 1, 0), 23: (2, 0, 1), 24: (2, 1, 1)},
}
for k in range(1, 5):
    CORNERS[k + 4] = (*CORNERS[k][:2], 1)
# Ends of the edge nodes.
MIDDLES = {
    **{101: (1, 2), 102: (2, 3), 103: (3, 4), 104: (4, 1), 105: (5, 6), 106: (6, 7)},
    **{107: (7, 8), 108: (8, 5), 109: (1, 5), 110: (2, 6), 111: (3, 7), 112: (4, 8)},
    **{201: (2, 21), 202: (21, 22), 203: (22, 3), 204: (6, 23), 205: (23, 24), 206: (24, 7)},
    **{207: (21, 23), 208: (22, 24)},
}


def bricks(**replace):
    x = {k: np.array(v, float) for k, v in CORNERS.items()}
    x.update({k: (x[a] + x[b]) / 2 for k, (a, b) in MIDDLES.items()})
    nodes = "\n".join(f"{k}, {v[0]}, {v[1]}, {v[2]:.3E}" for k, v in x.items())
    text = BRICKS.format(nodes=nodes)
    for old, new in replace.values():
        assert old in text
        text = text.replace(old, new)
    return text


@pytest.fixture
def write(tmp_path_factory):
    """Write a file on rank 0; its path on all ranks."""

    def _write(text):
        path = comm.bcast(tmp_path_factory.mktemp("inp") / "model.inp" if comm.rank == 0 else None)
        if comm.rank == 0:
            path.write_text(text)
        comm.barrier()
        return path

    return _write


def test_abaqus_bricks(write):
    data = read_abaqus(write(bricks()), comm)
    assert compat.coordinate_element(data.mesh).dim == 20
    assert measure(data.mesh) == pytest.approx(2, rel=1e-13)
    assert data.cell_sets == {"LEFT": 1, "RIGHT": 2}
    assert data.facet_sets == {"TOP": 1, "END": 2}
    assert measure(data.mesh, data.facet_tags, 1) == pytest.approx(2, rel=1e-13)
    assert measure(data.mesh, data.facet_tags, 2) == pytest.approx(1, rel=1e-13)
    left = data.cell_tags.indices[data.cell_tags.values == 1]
    nodes = compat.geometry_dofmap(data.mesh)[left]
    assert (data.mesh.geometry.x[nodes][..., 0] <= 1).all()


def test_abaqus_node_set_as_surface(write):
    data = read_abaqus(write(bricks()), comm, facet_sets=["end", "bottom"])
    assert data.facet_sets == {"END": 1, "BOTTOM": 2}
    assert measure(data.mesh, data.facet_tags, 2) == pytest.approx(2, rel=1e-13)
    # The face between the bricks has all its nodes in ALL but is not on the boundary.
    data = read_abaqus(write(bricks()), comm, facet_sets=["ALL"])
    assert measure(data.mesh, data.facet_tags, 1) == pytest.approx(10, rel=1e-13)


def test_abaqus_tetrahedra(write):
    """C3D10 with one curved edge: nodes 5 to 10 lie at 1-2, 2-3, 3-1, 1-4, 2-4, 3-4."""
    x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    edges = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]
    x = np.vstack([x, [(x[a] + x[b]) / 2 for a, b in edges]])
    nodes = "\n".join(f"{i + 1},{p[0]},{p[1]},{p[2]}" for i, p in enumerate(x))
    text = (
        f"*NODE\n{nodes}\n*ELEMENT,TYPE=C3D10M\n1,1,2,3,4,5,6,7,8,9,10\n"
        "*SURFACE,NAME=SLOPE\n1,S3\n*SURFACE,NAME=FLOOR\n1,S1\n"
    )
    data = read_abaqus(write(text), comm)
    assert measure(data.mesh) == pytest.approx(1 / 6, rel=1e-13)
    assert measure(data.mesh, data.facet_tags, 1) == pytest.approx(np.sqrt(3) / 2, rel=1e-13)
    assert measure(data.mesh, data.facet_tags, 2) == pytest.approx(0.5, rel=1e-13)
    assert data.mesh.basix_cell() == basix.CellType.tetrahedron


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("TYPE=C3D20R, ELSET=Left", "TYPE=C3D15, ELSET=Left", "C3D15 are not supported"),
        ("12, S4", "12, S2", "TOP and END overlap"),
        ("12, S4", "12, SPOS", "names no faces S1 to S6"),
        ("*HEADING", "*INCLUDE, INPUT=other.inp", "INCLUDE is not supported"),
        ("*HEADING", "*PART, NAME=A\n*END PART\n*PART, NAME=B", "2 parts"),
        ("11, 1, 2, 3,", "11, 1, 2, 333,", "node 333 is used but not defined"),
        ("108, 109, 110, 111, 112", "108, 109", "too few nodes"),
    ],
)
def test_abaqus_errors_on_all_ranks(write, old, new, message):
    with pytest.raises(ValueError, match=message):
        read_abaqus(write(bricks(change=(old, new))), comm)


def test_abaqus_unknown_surface_and_file(write):
    path = write(bricks())
    with pytest.raises(ValueError, match=r"no surface or node set 'SIDE'.*\['END', 'TOP'\]"):
        read_abaqus(path, comm, facet_sets=["side"])
    with pytest.raises(OSError):
        read_abaqus(path.with_name("absent.inp"), comm)


# -- What is drawn and written ----------------------------------------------


def test_surface_is_curved_and_whole():
    pytest.importorskip("pyvista")
    model, finalize = on_rank_zero(quarter_tube, 2, 1)
    mesh, _, facet_tags = model_to_hex20(model, comm)
    finalize()
    V = fem.functionspace(mesh, dm.hex20(shape=(3,)))
    u = fem.Function(V)
    u.interpolate(lambda x: np.stack([x[2], 0 * x[0], x[2]]))
    whole = surface(mesh, {"u": u}, displacement=u, factor=2.0)
    outside = surface(mesh, facets=facet_tags.find(6))
    # Half the cells: their boundary includes the cut.
    half = surface(mesh, where=lambda x: x[2] < 0.5)
    if comm.rank == 0:
        # Sheared by x += 2 z and stretched to the height of 3.
        assert whole.faces.volume == pytest.approx(3 * 3 * np.pi / 4, rel=2e-3)
        assert whole.faces.point_data["u"].shape == (whole.faces.n_points, 3)
        assert outside.faces.area == pytest.approx(np.pi, rel=1e-3)
        assert half.faces.volume == pytest.approx(3 * np.pi / 8, rel=2e-3)
    else:
        assert whole is outside is half is None


def test_output_of_hex20_is_exact():
    model, finalize = on_rank_zero(quarter_tube, 2, 1)
    mesh, _, _ = model_to_hex20(model, comm)
    finalize()
    V = fem.functionspace(mesh, dm.hex20(shape=(3,)))
    u = fem.Function(V, name="u")
    u.interpolate(lambda x: np.stack([x[0] * x[1], np.sin(x[2]), np.cos(x[1])]))
    w = for_output(u)
    assert w.name == "u"
    assert w.function_space.ufl_element().basix_element.dim == 27
    difference = fem.form(ufl.inner(u - w, u - w) * ufl.dx)
    assert comm.allreduce(fem.assemble_scalar(difference)) < 1e-26
    assert for_output(w) is w
