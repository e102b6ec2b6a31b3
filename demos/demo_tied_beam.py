# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A beam in two pieces: mesh tying with dual multipliers
#
# A beam is cut in two by a curved surface. The two bodies are meshed separately, so that no node
# of one meets a node of the other, and are tied by a mortar method. Pure bending has a quadratic
# solution in closed form, which tells how the error falls when both meshes are refined. This is
# the first example (section 6.1) of
#
# > A. Popp, B. I. Wohlmuth, M. W. Gee, W. A. Wall: *Dual quadratic mortar finite element methods
# > for 3D finite deformation contact*, SIAM J. Sci. Comput. 34 (2012), B421-B446.
#
# Run it with `python3 demo_tied_beam.py [--out DIR] [--level N]`, alone or under `mpirun`.

# +
import argparse
import gc
import json
import time
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

import dolfinx_mortar as dm
import numpy as np
import ufl
from dolfinx import default_scalar_type, fem, mesh
from dolfinx_mortar.mesh import model_to_hex20
from dolfinx_mortar.plotting import Writer, convergence_plot, picture, surface

try:
    from dolfinx.io import gmsh as gmsh_reader
except ImportError:  # DOLFINx 0.9
    from dolfinx.io import gmshio as gmsh_reader

comm = MPI.COMM_WORLD

parser = argparse.ArgumentParser(description="Mesh tying: bending of a beam in two pieces")
parser.add_argument("--out", type=Path, default=Path("output/tied_beam"), help="folder to write")
parser.add_argument("--level", type=int, default=3, help="number of meshes per curve")
options = parser.parse_args() if __name__ == "__main__" else parser.parse_args([])
# -

# ## The problem
#
# The beam has the sides $l_x = 4$, $l_y = 2$, $l_z = 1$ and is centred at the origin; Hooke's law
# has $E = 1000$ and $\nu = 0.3$. The loads $f_x = \pm 2 p y / l_y$, $p = 100$, on the ends
# $x = \pm l_x / 2$ bend it about the $z$ axis, with the displacement (6.3):
#
# $$u_x = \frac{2p}{E l_y} x y, \quad u_y = \frac{p}{E l_y} (-x^2 - \nu y^2 + \nu z^2), \quad
# u_z = -\frac{2 p \nu}{E l_y} y z.$$

# +
lx, ly, lz = 4.0, 2.0, 1.0
E, nu, p = 1000.0, 0.3, 100.0

SLAVE, MASTER, ENDS = 3, 7, 5  # tags of facets


def exact(x):
    """Displacement (6.3) as a UFL expression."""
    ux = 2 * p / (E * ly) * x[0] * x[1]
    uy = p / (E * ly) * (-(x[0] ** 2) - nu * x[1] ** 2 + nu * x[2] ** 2)
    uz = -2 * p * nu / (E * ly) * x[1] * x[2]
    return ufl.as_vector((ux, uy, uz))


def epsilon(u):
    return ufl.sym(ufl.grad(u))


def sigma(u):
    lmbda, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    return lmbda * ufl.tr(epsilon(u)) * ufl.Identity(3) + 2 * mu * epsilon(u)


# -

# ## Two meshes in one
#
# gmsh meshes two bodies that share no point. The *curved* cut is a piece of a sphere, not centred,
# so that no symmetry helps; across it the left body has $6k \times 3k$ cells and the right one
# $4k \times 2k$, and $k = 1, 2, 3, \dots$ refines both. The grids are structured, each of their
# cells being one hexahedron or six tetrahedra. Second-order cells follow the sphere with their edge
# and face nodes; the small gaps and overlaps left between the two sides are of third order.
#
# The right body is a row of two blocks, so that there are nodes on the plane $x = 0$, where the
# beam is supported. Away from the cut second-order cells have straight edges and contain the exact
# solution: few of them are enough at the right end, and more than second order may be expected.
#
# The *plane* cut is tilted, but for hex20, whose functions are all quadratic ones in boxes only.
# All second-order cells then contain the exact solution, so what error is left is the coupling's
# alone.

# +
CENTRE, RADIUS = np.array((-2.75, 0.3, 0.1)), 2.0  # curved cut, at x = -1 or so
TILT = 0.3  # plane cut, x = -1 + TILT y

ELEMENTS = {"tet4": 1, "hex8": 1, "tet10": 2, "hex20": 2, "hex27": 2}


def two_bodies(element, k, cut):
    """Mesh both bodies with gmsh.

    Args:
        element: One of ELEMENTS.
        k: Refinement, see above.
        cut: "curved" or "plane".

    Returns:
        The model, with bodies tagged 1, 2 and the sides of the cut 1 (left), 2 (right).
    """
    import gmsh

    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", int(element == "hex20"))
    gmsh.model.add("beam")
    geo = gmsh.model.geo
    corners = np.array([(-ly, -lz), (ly, -lz), (ly, lz), (-ly, lz)]) / 2

    def section(x, n):
        """A surface across the beam with 2n by n cells: its points, its edges, its face.

        ``x`` is a number for a plane section, or "curved" or "plane" for the cut.
        """
        if x == "curved":
            x = CENTRE[0] + np.sqrt(RADIUS**2 - ((corners - CENTRE[1:]) ** 2).sum(axis=1))
            arcs = True
        else:
            tilt = 0 if element == "hex20" else TILT
            x, arcs = (-1 + tilt * corners[:, 0] if x == "plane" else [x] * 4), False
        points = [geo.addPoint(xi, y, z) for xi, (y, z) in zip(x, corners)]
        edges = []
        for i in range(4):
            ends = points[i], points[(i + 1) % 4]
            if arcs:  # where the sphere meets a side of the beam
                middle = CENTRE.copy()
                middle[2 - i % 2] = corners[i][1 - i % 2]
                edges.append(geo.addCircleArc(ends[0], geo.addPoint(*middle), ends[1]))
            else:
                edges.append(geo.addLine(*ends))
            geo.mesh.setTransfiniteCurve(edges[-1], (2 - i % 2) * n + 1)
        loop = [geo.addCurveLoop(edges)]
        if arcs:
            face = geo.addSurfaceFilling(loop, sphereCenterTag=geo.addPoint(*CENTRE))
        else:
            face = geo.addPlaneSurface(loop)
        return points, edges, face

    def block(first, last, n):
        """The volume between two sections, n cells long."""
        (p0, e0, f0), (p1, e1, f1) = first, last
        rails = [geo.addLine(a, b) for a, b in zip(p0, p1)]
        for rail in rails:
            geo.mesh.setTransfiniteCurve(rail, n + 1)
        faces = [f0, f1]
        for i in range(4):
            loop = geo.addCurveLoop([e0[i], rails[(i + 1) % 4], -e1[i], -rails[i]])
            faces.append(geo.addPlaneSurface([loop]))
        volume = geo.addVolume([geo.addSurfaceLoop(faces)])
        for face in faces:
            geo.mesh.setTransfiniteSurface(face)
            if element.startswith("hex"):
                geo.mesh.setRecombine(2, face)
        geo.mesh.setTransfiniteVolume(volume)
        return volume

    near, far = (2 * k, k if ELEMENTS[element] == 2 else 4 * k) if cut == "curved" else (k, k)
    left = [section(-lx / 2, 3 * k), section(cut, 3 * k)]
    right = [section(x, 2 * k) for x in (cut, 0, lx / 2)]
    bodies = [[block(*left, near)], [block(*right[:2], near), block(*right[1:], far)]]
    geo.synchronize()
    for i, volumes in enumerate(bodies):
        gmsh.model.addPhysicalGroup(3, volumes, i + 1)
    gmsh.model.addPhysicalGroup(2, [left[1][2]], 1)
    gmsh.model.addPhysicalGroup(2, [right[0][2]], 2)
    gmsh.model.addPhysicalGroup(2, [left[0][2], right[2][2]], ENDS)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(ELEMENTS[element])
    return gmsh.model


# -

# The model becomes *one* DOLFINx mesh with two disconnected bodies, which is what
# `dm.Tie(V, facet_tags, ...)` takes. Which side of the cut is the slave is a matter of tags.


# +
def beam(element, k, cut, ratio):
    """Mesh of both bodies, and tags of facets.

    Args:
        element, k, cut: See `two_bodies`.
        ratio: Of facet sizes h_s : h_m, "2:3" (the left side is the slave) or "3:2".
    """
    model = two_bodies(element, k, cut) if comm.rank == 0 else None
    if element == "hex20":
        domain, _, tags = model_to_hex20(model, comm)
    else:
        domain, _, tags = gmsh_reader.model_to_mesh(model, comm, 0, gdim=3)[:3]
    if comm.rank == 0:
        import gmsh

        gmsh.finalize()
    role = {1: SLAVE, 2: MASTER} if ratio == "2:3" else {1: MASTER, 2: SLAVE}
    values = np.array([role.get(value, value) for value in tags.values], dtype=np.int32)
    return domain, mesh.meshtags(domain, 2, tags.indices, values)


# -

# ## Supports
#
# Six displacements at three points, (6.2), hold the beam: all at the origin, $u_x = u_z = 0$ at
# $(0, l_y/2, 0)$ and $u_z = 0$ at $(l_x/2, 0, 0)$. The loads are in equilibrium, so the supports
# carry nothing, and single nodes may hold a body of any refinement.


# +
def supports(V):
    def point(*place):
        return lambda x: np.linalg.norm(x.T - place, axis=1) < 1e-8

    domain = V.mesh
    domain.topology.create_connectivity(0, 3)
    bcs = []
    for place, components in (
        ((0, 0, 0), (0, 1, 2)),
        ((0, ly / 2, 0), (0, 2)),
        ((lx / 2, 0, 0), (2,)),
    ):
        vertices = mesh.locate_entities(domain, 0, point(*place))
        for i in components:
            dofs = fem.locate_dofs_topological(V.sub(i), 0, vertices)
            bcs.append(fem.dirichletbc(default_scalar_type(0), dofs, V.sub(i)))
    return bcs


# -

# ## Solve
#
# The tie is one line, and so is the problem. `multiplier` chooses the space of the coupling
# tractions: `standard` uses displacement shape functions (for tet10 and hex20 the linear ones of
# the corners), `dual` the biorthogonal functions of section 4.4.1 on all nodes, `dual-linear`
# those of section 4.4.2 on the corners. `dual-reproducing`, the default, is made of the linear
# functions of the corners for tet10 and hex20, and is `dual` for other cells. Dual multipliers are
# eliminated locally.


# +
def displacement_space(domain, element):
    if element == "hex20":
        return fem.functionspace(domain, dm.hex20(shape=(3,)))
    return fem.functionspace(domain, ("Lagrange", ELEMENTS[element], (3,)))


def solve(domain, tags, element, multiplier):
    """Displacement and tie of the beam."""
    V = displacement_space(domain, element)
    u, v = fem.Function(V, name="displacement"), ufl.TestFunction(V)
    # Three points per direction integrate second-order cells with straight edges exactly.
    metadata = {"quadrature_degree": {1: 3, 2: 5}[ELEMENTS[element]]}
    dx = ufl.dx(domain=domain, metadata=metadata)
    ds = ufl.ds(domain=domain, subdomain_data=tags, metadata=metadata)
    x, n = ufl.SpatialCoordinate(domain), ufl.FacetNormal(domain)
    F = ufl.inner(sigma(u), epsilon(v)) * dx - 2 * p * x[1] / ly * n[0] * v[0] * ds(ENDS)

    tie = dm.Tie(V, tags, slave=SLAVE, master=MASTER, multiplier=multiplier)
    problem = dm.ContactProblem(
        F,
        u,
        bcs=supports(V),
        interfaces=[tie],
        petsc_options_prefix="beam_",
        petsc_options={
            "snes_type": "ksponly",
            "ksp_type": "preonly",
            "pc_type": "lu",
            "pc_factor_mat_solver_type": "mumps",
        },
    )
    problem.solve()
    return u, tie


def energy_error(u):
    """Error in the energy norm (6.4), and the energy norm of the exact solution."""
    domain = u.function_space.mesh
    u_exact = exact(ufl.SpatialCoordinate(domain))
    dx = ufl.dx(domain=domain, metadata={"quadrature_degree": 6})
    squares = [ufl.inner(sigma(w), epsilon(w)) * dx for w in (u_exact - u, u_exact)]
    return [np.sqrt(comm.allreduce(fem.assemble_scalar(fem.form(s)))) for s in squares]


# -

# ## Refine and measure
#
# First-order cells start with twice as many cells per edge, which makes the systems as large.

# +
results = []


def say(text):
    if comm.rank == 0:
        print(text, flush=True)


def measure(element, multiplier, k, cut, ratio, picture=False):
    """Solve one case, print a line and append it to the results."""
    start = time.perf_counter()
    domain, tags = beam(element, k, cut, ratio)
    u, tie = solve(domain, tags, element, multiplier)
    error, norm = energy_error(u)
    r = {
        "element": element,
        "multiplier": multiplier,
        "cut": cut,
        "ratio": ratio,
        "h": lz / (3 * k if ratio == "2:3" else 2 * k),  # of the slave's facets
        "ndofs": 3 * u.function_space.dofmap.index_map.size_global,
        "energy_error": error,
        "relative_error": error / norm,
        "seconds": time.perf_counter() - start,
    }
    results.append(r)
    say(
        f"{cut:6} cut, {ratio}  {element:5} {multiplier:16} h = {r['h']:<7.4g}"
        f"{r['ndofs']:7} dofs   error {error:.3e}   {r['seconds']:5.1f} s"
    )
    if picture:
        show(u, tie, element)

    # In parallel, petsc4py frees matrices only where all ranks ask for it
    del tie
    gc.collect()
    PETSc.garbage_cleanup(domain.comm)


def multipliers(element):
    if element in ("tet10", "hex20"):
        return "standard", "dual", "dual-linear", "dual-reproducing"
    return ("standard", "dual", "dual-linear")[: 1 + ELEMENTS[element]]


# -

# Three studies. The first is the paper's: its Figure 6.2 has the slave side finer. A coarser slave
# leaves more of the master's freedom uncontrolled; the second study shows what that costs. The
# third has the plane cut, once each way.
#
# The error has two parts: what the tied meshes can approximate, $O(h^{2.5})$ here, and what the
# multipliers leave of the traction. The standard ones reproduce linear tractions, and so do the
# dual ones of quadrilaterals with nine nodes and `dual-reproducing`; these keep the order 2.5
# whichever side is the slave, and are exact on the plane cut. The functions `dual` on the nodes of
# tri6 and quad8 reproduce constant tractions only, as those of edges have their centroids inside of
# the facet: in the end that is $O(h^{1.5})$. With the finer side as the slave this part is so small
# that it does not show on these meshes. With the coarser side it is some thirty times larger for
# hex20, nearly all of it in the master, whose functions resolve what the slave's do not, and sets
# the order 1.5. For tet10 it grows less, and the order falls from 2.3 to 1.9 on further refinement.


# +
def curved_cut(elements, ratio):
    for element in elements:
        meshes = [(3 - ELEMENTS[element]) * k for k in range(1, options.level + 1)]
        for k in meshes:
            for multiplier in multipliers(element):
                shown = (ratio, multiplier, k) == ("2:3", "dual", meshes[:2][-1])
                measure(element, multiplier, k, "curved", ratio, picture=shown)


def plane_cut(ratio):
    for element in ("tet10", "hex20", "hex27"):
        for multiplier in multipliers(element):
            for k in range(1, options.level + 2):
                measure(element, multiplier, k, "plane", ratio)
                if k > 1 and results[-1]["energy_error"] < EXACT:
                    break  # finer meshes would show round-off again


EXACT = 1e-8


def run():
    options.out.mkdir(parents=True, exist_ok=True)
    results.clear()
    curved_cut(ELEMENTS, "2:3")
    curved_cut(("tet10", "hex20", "hex27"), "3:2")
    plane_cut("2:3")
    plane_cut("3:2")
    report()


# -

# ## Show
#
# Each element's displacement and interface traction go into VTX folders for ParaView, and the
# bent beam into a picture.


# +
def show(u, tie, element):
    with Writer(options.out / f"{element}.bp", [u, tie.traction]) as file:
        file.write(0.0)
    body = surface(u.function_space.mesh, {"u": u}, displacement=u, factor=3.0)
    picture(
        options.out / f"beam_{element}.png",
        [body],
        "u",
        component=1,
        label="u_y",
        title=f"{element}, displacement 3 times enlarged",
        view=(-0.5, -0.7, 1.6),
        up=(0, 1, 0),
    )


def curve(element, multiplier, cut, ratio):
    """Mesh sizes and errors of one curve."""
    key = (element, multiplier, cut, ratio)
    rows = [r for r in results if (r["element"], r["multiplier"], r["cut"], r["ratio"]) == key]
    return [r["h"] for r in rows], [r["energy_error"] for r in rows]


def order(h, errors):
    """Order between the two finest meshes; None where only round-off is left."""
    if errors[-1] < EXACT:
        return None
    if len(h) < 2:
        return float("nan")
    return float(np.log(errors[-2] / errors[-1]) / np.log(h[-2] / h[-1]))


def table(cut, ratio):
    print(f"\n{cut} cut, h_s : h_m = {ratio}{': coupling error' if cut == 'plane' else ''}")
    for degree in (1, 2):
        rows = [
            (f"{element:8}{multiplier:17}", *curve(element, multiplier, cut, ratio))
            for element in ELEMENTS
            if ELEMENTS[element] == degree
            for multiplier in multipliers(element)
        ]
        rows = [row for row in rows if row[1]]
        sizes = max((row[1] for row in rows), key=len, default=[])
        if rows:
            print(f"{'':25}" + "".join(f"{f'h = {h:.4g}':>13}" for h in sizes) + f"{'order':>8}")
        for name, h, errors in rows:
            numbers = "".join(f"{error:13.3e}" for error in errors).ljust(13 * len(sizes))
            slope = order(h, errors)
            print(f"{name}{numbers}{'exact' if slope is None else f'{slope:.2f}':>8}")


def report():
    """Tables, files and the plot, by rank 0."""
    if comm.rank > 0:
        return
    (options.out / "results.json").write_text(json.dumps(results, indent=1))

    print("\nError in the energy norm (that of the exact solution is 5.16)")
    table("curved", "2:3")
    table("curved", "3:2")
    table("plane", "2:3")
    table("plane", "3:2")

    # Quadratic hexahedra; those of first order and tetrahedra are in the tables
    looks = {
        "standard": ("C0", "o"),
        "dual": ("C1", "s"),
        "dual-linear": ("C3", "^"),
        "dual-reproducing": ("C2", "x"),
    }
    ratios = {"slave side finer, 2:3": "2:3", "slave side coarser, 3:2": "3:2"}
    panels = {title: {} for title in ratios}
    styles = {}
    for element, line in (("hex20", "-"), ("hex27", "--")):
        for multiplier in multipliers(element):
            name = f"{element} {multiplier}"
            colour, marker = looks[multiplier]
            styles[name] = {
                "color": colour,
                "linestyle": line,
                "marker": marker,
                "fillstyle": "none",
            }
            for title, ratio in ratios.items():
                panels[title][name] = curve(element, multiplier, "curved", ratio)
    convergence_plot(
        options.out / "convergence.png",
        panels,
        xlabel="$h$ of the slave side",
        ylabel="error in the energy norm",
        slopes=(1.5, 2.5),
        styles=styles,
    )
    print(f"\nWritten to {options.out}")


if __name__ == "__main__":
    run()
