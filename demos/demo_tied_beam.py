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
# solution in closed form; with it we measure how the error falls when both meshes are refined.
# This is the first example (section 6.1) of
#
# > A. Popp, B. I. Wohlmuth, M. W. Gee, W. A. Wall: *Dual quadratic mortar finite element methods
# > for 3D finite deformation contact*, SIAM J. Sci. Comput. 34 (2012), B421-B446.
#
# Run it with `python3 demo_tied_beam.py [--out DIR] [--level N]`, alone or under `mpirun`.

# +
import argparse
import json
import time
from pathlib import Path

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import ufl
from dolfinx import default_scalar_type, fem, mesh
from dolfinx_mortar import compat
from dolfinx_mortar.mesh import model_to_hex20
from dolfinx_mortar.plotting import Writer, convergence_plot, picture, surface

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
# gmsh meshes two boxes that share no point, cut at $x = -1$. Across the interface the left body has
# $6k \times 3k$ cells and the right one $4k \times 2k$, so $h_s : h_m = 3 : 2$ if the right one is
# the slave. The grids are structured, each of their cells being one hexahedron or six tetrahedra;
# $k = 1, 2, 3, \dots$ refines both uniformly. The right body is a row of two blocks, so that there
# are nodes on the plane $x = 0$, where the beam is supported.
#
# The result is *one* DOLFINx mesh with two disconnected bodies, which is what
# `dm.Tie(V, facet_tags, ...)` takes.

# +
CUT = -1.0


def two_boxes(element, k, tilt):
    """Mesh both bodies with gmsh.

    Args:
        element: "tet4", "hex8", "tet10", "hex20" or "hex27".
        k: Refinement, see above.
        tilt: Slope dx/dy of a plane cut.

    Returns:
        The model, with bodies tagged 1, 2 and the sides of the cut 1 (left), 2 (right).
    """
    import gmsh

    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", int(element == "hex20"))
    gmsh.model.add("beam")
    geo = gmsh.model.geo
    corners = [(-ly / 2, -lz / 2), (ly / 2, -lz / 2), (ly / 2, lz / 2), (-ly / 2, lz / 2)]

    def section(x, slope, n):
        """A rectangle across the beam with 2n by n cells: its points, its edges, its face."""
        points = [geo.addPoint(x + slope * y, y, z) for y, z in corners]
        edges = [geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
        for i, edge in enumerate(edges):
            geo.mesh.setTransfiniteCurve(edge, (2 - i % 2) * n + 1)
        return points, edges, geo.addPlaneSurface([geo.addCurveLoop(edges)])

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

    left = [section(-lx / 2, 0, 3 * k), section(CUT, tilt, 3 * k)]
    right = [section(CUT, tilt, 2 * k), section(0, 0, 2 * k), section(lx / 2, 0, 2 * k)]
    bodies = [[block(*left, 2 * k)], [block(*right[:2], 2 * k), block(*right[1:], 3 * k)]]
    geo.synchronize()
    for i, volumes in enumerate(bodies):
        gmsh.model.addPhysicalGroup(3, volumes, i + 1)
    gmsh.model.addPhysicalGroup(2, [left[1][2]], 1)
    gmsh.model.addPhysicalGroup(2, [right[0][2]], 2)
    gmsh.model.addPhysicalGroup(2, [left[0][2], right[2][2]], ENDS)
    gmsh.model.mesh.generate(3)
    if element in ("tet10", "hex20", "hex27"):
        gmsh.model.mesh.setOrder(2)
    return gmsh.model


# -

# For the *curved* cut every node, also those at edges and in faces, is then moved along $x$: those
# of the cut onto a sphere of radius 2, the others by less the farther they are from it. With
# second-order cells all of the left body is then curved. Were it curved near the cut only, the
# other cells would contain the quadratic solution exactly, and we would measure little but the
# coupling; that is what the *plane* cut below is for.


# +
def bend(x):
    """Move points, shape (n, 3), so that the cut becomes a part of a sphere."""
    radius, y0, z0 = 2.0, 0.3, 0.1  # not centred: no symmetry is to help
    depth = np.sqrt(radius**2 - (x[:, 1] - y0) ** 2 - (x[:, 2] - z0) ** 2) - radius
    left, right = (x[:, 0] + lx / 2) / (CUT + lx / 2), x[:, 0] / CUT
    x[:, 0] += np.clip(np.minimum(left, right), 0, 1) * (depth + 0.25)


def beam(element, k, cut, slave):
    """Mesh of both bodies, and tags of facets.

    Args:
        element, k: See `two_boxes`.
        cut: "curved" or "plane" (tilted).
        slave: "coarse" (h_s : h_m = 3 : 2) or "fine" (2 : 3).
    """
    tilt = 0.3 if cut == "plane" else 0.0
    model = two_boxes(element, k, tilt) if comm.rank == 0 else None
    if element == "hex20":
        domain, _, tags = model_to_hex20(model, comm)
    else:
        domain, _, tags = compat.model_to_mesh(model, comm)
    if comm.rank == 0:
        import gmsh

        gmsh.finalize()
    if cut == "curved":
        bend(domain.geometry.x)

    # The left side of the cut has the smaller facets.
    role = {1: MASTER, 2: SLAVE} if slave == "coarse" else {1: SLAVE, 2: MASTER}
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
# those of section 4.4.2 on the corners. Dual multipliers are eliminated locally.

# +
ELEMENTS = {"tet4": 1, "hex8": 1, "tet10": 2, "hex20": 2, "hex27": 2}


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


def facet_size(k, slave):
    """Length of a slave facet's edges on the plane cut."""
    return lz / (2 * k) if slave == "coarse" else lz / (3 * k)


def measure(element, multiplier, k, cut, slave="coarse"):
    """Solve one case, print a line and append it to the results."""
    start = time.perf_counter()
    domain, tags = beam(element, k, cut, slave)
    u, tie = solve(domain, tags, element, multiplier)
    error, norm = energy_error(u)
    V = u.function_space
    results.append(
        {
            "element": element,
            "multiplier": multiplier,
            "cut": cut,
            "slave": slave,
            "h": facet_size(k, slave),
            "ndofs": 3 * compat.dofmap(V).index_map.size_global,
            "energy_error": error,
            "relative_error": error / norm,
            "seconds": time.perf_counter() - start,
        }
    )
    r = results[-1]
    say(
        f"{cut:6} cut  {element:5} {multiplier:11} h = {r['h']:<7.4g} {r['ndofs']:7} dofs   "
        f"error {error:.3e}   {r['seconds']:5.1f} s"
    )
    return u, tie


def multipliers(element):
    return ("standard", "dual", "dual-linear")[: 1 + ELEMENTS[element]]


def refinements(element):
    return [(3 - ELEMENTS[element]) * k for k in range(1, options.level + 1)]


def run():
    options.out.mkdir(parents=True, exist_ok=True)
    results.clear()
    for element in ELEMENTS:
        for k in refinements(element):
            for multiplier in multipliers(element):
                u, tie = measure(element, multiplier, k, "curved")
                if k == 2 and multiplier == "dual":
                    show(u, tie, element)

    # On the plane cut the error is the coupling's alone.
    for slave in ("coarse", "fine"):
        for element in ("tet10", "hex27"):
            for k in refinements(element):
                for multiplier in multipliers(element):
                    measure(element, multiplier, k, "plane", slave)
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


def curve(element, multiplier, cut, slave="coarse"):
    rows = [
        (r["h"], r["energy_error"])
        for r in results
        if (r["element"], r["multiplier"], r["cut"], r["slave"])
        == (element, multiplier, cut, slave)
    ]
    return tuple(zip(*rows))


def order(h, errors):
    """Order between the two finest meshes; none where only round-off is left."""
    if errors[-1] < 1e-8:
        return None
    if len(h) < 2:
        return float("nan")
    return float(np.log(errors[-2] / errors[-1]) / np.log(h[-2] / h[-1]))


def report():
    """Table and files, by rank 0."""
    if comm.rank > 0:
        return
    (options.out / "results.json").write_text(json.dumps(results, indent=1))

    print("\nError in the energy norm (exact solution: 5.16)")
    for cut, slave in (("curved", "coarse"), ("plane", "coarse"), ("plane", "fine")):
        ratio = "3 : 2" if slave == "coarse" else "2 : 3"
        what = "" if cut == "curved" else ": coupling error"
        print(f"\n{cut} cut, h_s : h_m = {ratio}{what}")
        for degree in (1, 2):
            rows = [
                (element, multiplier, curve(element, multiplier, cut, slave))
                for element in ELEMENTS
                if ELEMENTS[element] == degree
                for multiplier in multipliers(element)
            ]
            rows = [row for row in rows if row[2]]
            if rows:
                heads = "".join(f"{f'h = {h:.4g}':>13}" for h in rows[0][2][0])
                print(f"{'element':8}{'multiplier':12}{heads}{'order':>8}")
            for element, multiplier, found in rows:
                slope = order(*found)
                numbers = "".join(f"{error:13.3e}" for error in found[1])
                last = "exact" if slope is None else f"{slope:.2f}"
                print(f"{element:8}{multiplier:12}{numbers}{last:>8}")

    colours = {"tet4": "C0", "hex8": "C0", "tet10": "C1", "hex20": "C2", "hex27": "C3"}
    lines = {"standard": ("-", "o"), "dual": ("--", "s"), "dual-linear": (":", "^")}
    panels = {"hexahedra": {}, "tetrahedra": {}, "plane cut (coupling alone)": {}}
    styles = {}
    for element in ELEMENTS:
        for multiplier in multipliers(element):
            name = f"{element} {multiplier}"
            line, marker = lines[multiplier]
            styles[name] = {
                "color": colours[element],
                "linestyle": line,
                "marker": marker,
                "fillstyle": "none",
            }
            kind = "hexahedra" if element.startswith("hex") else "tetrahedra"
            panels[kind][name] = curve(element, multiplier, "curved")
            found = curve(element, multiplier, "plane")
            if found and order(*found) is not None:
                panels["plane cut (coupling alone)"][name] = found
    convergence_plot(
        options.out / "convergence.png",
        panels,
        xlabel="$h$ of the slave side",
        ylabel="error in the energy norm",
        slopes=(1, 1.5, 2),
        styles=styles,
    )
    print(f"\nWritten to {options.out}")


if __name__ == "__main__":
    run()
