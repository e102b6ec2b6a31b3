# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A hemisphere on a rigid plane: frictionless contact and Hertz's solution
#
# A soft hemisphere is pressed onto a rigid plane by a pressure on its flat top. For small strains
# Hertz gave the contact pressure in closed form. The mesh is refined towards the pole, and what is
# computed is compared with it. This is the second example (section 6.2) of
#
# > A. Popp, B. I. Wohlmuth, M. W. Gee, W. A. Wall: *Dual quadratic mortar finite element methods
# > for 3D finite deformation contact*, SIAM J. Sci. Comput. 34 (2012), B421-B446.
#
# Run it with `python3 demo_hertz.py [--out DIR] [--level N]`, alone or under `mpirun`; with
# `--element`, `--material` or `--pressure` it computes those cases only.

# +
import argparse
import json
import time
import weakref
from pathlib import Path

from mpi4py import MPI

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

ELEMENTS = {"hex8": 1, "hex20": 2, "hex27": 2, "tet10": 2}
MATERIALS = ("neo-hooke", "st-venant-kirchhoff", "neo-hooke-log", "linear")

parser = argparse.ArgumentParser(description="Hertz: a hemisphere pressed onto a rigid plane")
parser.add_argument("--out", type=Path, default=Path("output/hertz"), help="folder to write")
parser.add_argument("--level", type=int, default=2, help="finest level; h is 2/3 rho / (level + 1)")
parser.add_argument("--element", choices=ELEMENTS, help="only this one")
parser.add_argument("--material", choices=MATERIALS, help="only this one")
parser.add_argument("--pressure", type=float, help="on the flat top, instead of 0.2 and 0.05")
parser.add_argument("--full", action="store_true", help="the whole hemisphere, not a quarter")
parser.add_argument("--multipliers", action="store_true", help="also compare all multiplier spaces")
parser.add_argument(
    "--convergence", action="store_true", help="also the error in the energy norm (takes long)"
)
options = parser.parse_args() if __name__ == "__main__" else parser.parse_args([])
# -

# ## The problem
#
# The sphere has the radius $R = 8$, touches the plane $z = 0$ in its pole, the origin, and is cut
# at $z = 8$; $E = 200$, $\nu = 0.3$. A dead pressure $p$ on the cut presses with the force
# $F = \pi R^2 p$. With $E^* = E / (1 - \nu^2)$, Hertz's contact radius and pressure are
#
# $$\rho = \left(\frac{3 F R}{4 E^*}\right)^{1/3}, \quad
# \lambda(r) = \lambda_{\max} \sqrt{1 - r^2 / \rho^2}, \quad
# \lambda_{\max} = \frac{3 F}{2 \pi \rho^2}.$$

# +
R, E, nu = 8.0, 200.0, 0.3
lmbda, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))


def hertz(p):
    """Largest pressure and contact radius by Hertz."""
    force = np.pi * R**2 * p
    rho = (0.75 * force * R * (1 - nu**2) / E) ** (1 / 3)
    return 1.5 * force / (np.pi * rho**2), rho


# -

# Hertz's hemisphere is a half space. What a hemisphere at finite strain does depends on its
# material; these are the largest pressure (per deformed area) and the deformed contact radius
# (lower and upper bound) of independent axisymmetric computations with very fine meshes.

REFERENCE = {
    ("linear", 0.2): (17.97, (1.018, 1.023)),
    ("linear", 0.05): (11.32, (0.643, 0.648)),
    ("neo-hooke", 0.2): (18.533, (1.021, 1.026)),
    ("neo-hooke", 0.05): (11.559, (0.643, 0.648)),
    ("st-venant-kirchhoff", 0.2): (16.507, (1.055, 1.060)),
    ("st-venant-kirchhoff", 0.05): (10.760, (0.658, 0.663)),
}

# The paper reports that its $\lambda_{\max}$ differs from Hertz's by these parts.

PAPER = {0.2: 0.028, 0.05: 0.017}


# ## Materials
#
# Stored energies per reference volume. The paper names St. Venant-Kirchhoff; its deviations from
# Hertz are those of the first one.


# +
def energy(u, material):
    identity = ufl.Identity(3)
    if material == "linear":
        strain = ufl.sym(ufl.grad(u))
        return lmbda / 2 * ufl.tr(strain) ** 2 + mu * ufl.inner(strain, strain)
    F = ufl.variable(identity + ufl.grad(u))
    J, I1 = ufl.det(F), ufl.inner(F, F)
    if material == "neo-hooke":
        c, beta = mu / 2, nu / (1 - 2 * nu)
        return c * (I1 - 3) + c / beta * (J ** (-2 * beta) - 1)
    if material == "neo-hooke-log":
        return mu / 2 * (I1 - 3) - mu * ufl.ln(J) + lmbda / 2 * ufl.ln(J) ** 2
    strain = (F.T * F - identity) / 2
    return lmbda / 2 * ufl.tr(strain) ** 2 + mu * ufl.inner(strain, strain)


# -

# ## A mesh that is fine at the pole
#
# gmsh fills nested cubes with a corner (for the full model: the middle of a side) at the origin: a
# uniform cube of side $a$, where contact will be, and three blocks around it whose cells grow
# geometrically up to the side $2R$. One more cell is the rigid plane, the master.

# +
BODY, PLANE = 1, 2  # tags of cells
TOP, CURVED, SYMMETRY_X, SYMMETRY_Y, MASTER, CAP = 1, 2, 3, 4, 5, 6  # tags of facets

SHIFT = 4.0  # gmsh meshes the plane at some distance, so that it shares no nodes


def cubes(element, a, n, layers, growth, full):
    """Mesh the cubes with gmsh.

    Args:
        element: One of ELEMENTS.
        a: Side of the uniform cube.
        n: Cells along this side.
        layers: Cells between the cubes.
        growth: Ratio of the thicknesses of adjacent layers.
        full: Put four such cubes together.
    """
    import gmsh

    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", int(element == "hex20"))
    gmsh.model.add("hemisphere")
    geo = gmsh.model.geo
    points, lines, faces = {}, {}, {}
    groups = {tag: set() for tag in (TOP, CURVED, SYMMETRY_X, SYMMETRY_Y, MASTER)}

    def line(p, q, number):
        """The edge between two corners, the same for all blocks that share it."""
        for corner in (p, q):
            if corner not in points:
                points[corner] = geo.addPoint(*corner)
        if (p, q) not in lines:
            # Edges between the cubes point outwards
            inner, outer = sorted((p, q), key=lambda x: max(map(abs, x)))
            tag = geo.addLine(points[inner], points[outer])
            sizes = [max(map(abs, x)) for x in (inner, outer)]
            if sizes[0] == a and sizes[1] == 2 * R:
                geo.mesh.setTransfiniteCurve(tag, layers + 1, "Progression", growth)
            else:
                geo.mesh.setTransfiniteCurve(tag, number + 1)
            lines[inner, outer], lines[outer, inner] = tag, -tag
        return lines[p, q]

    def block(corners, number):
        """A hexahedron; its corners in tensor order."""
        sides = []
        for loop in (
            *((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4)),
            *((2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)),
        ):
            p = [corners[i] for i in loop]
            edges = [line(p[i], p[(i + 1) % 4], number) for i in range(4)]
            key = frozenset(p)
            if key not in faces:
                faces[key] = geo.addPlaneSurface([geo.addCurveLoop(edges)])
                geo.mesh.setTransfiniteSurface(faces[key])
                if element != "tet10":
                    geo.mesh.setRecombine(2, faces[key])
            x = np.array(p)
            if x[0, 2] < 0:
                if np.all(x[:, 2] == -SHIFT):
                    groups[MASTER].add(faces[key])
            elif np.all(x[:, 2] == 0):
                groups[CURVED].add(faces[key])
            elif np.all(x[:, 0] == 0):
                groups[SYMMETRY_X].add(faces[key])
            elif np.all(x[:, 1] == 0):
                groups[SYMMETRY_Y].add(faces[key])
            elif np.any(np.all(np.abs(x) == 2 * R, axis=0)):
                groups[TOP].add(faces[key])
            sides.append(faces[key])
        volume = geo.addVolume([geo.addSurfaceLoop(sides)])
        if element != "tet10":
            geo.mesh.setTransfiniteVolume(volume)
        return volume

    def box(x, y, z):
        return [(float(i), float(j), float(k)) for k in z for j in y for i in x]

    body = []
    for sx, sy in ((1, 1), (-1, 1), (-1, -1), (1, -1)) if full else ((1, 1),):
        inner = box((0, sx * a), (0, sy * a), (0, a))
        outer = box((0, sx * 2 * R), (0, sy * 2 * R), (0, 2 * R))
        body.append(block(inner, n))
        for i, j, k, m in ((1, 3, 5, 7), (2, 3, 6, 7), (4, 5, 6, 7)):
            corners = [cube[q] for cube in (inner, outer) for q in (i, j, k, m)]
            body.append(block(corners, n))
    side = (-3 * a if full else 0.0, 3 * a)
    plane = block(box(side, side, (-SHIFT - 1, -SHIFT)), 1)
    geo.synchronize()
    gmsh.model.addPhysicalGroup(3, body, BODY)
    gmsh.model.addPhysicalGroup(3, [plane], PLANE)
    if full:  # planes of symmetry are inside
        del groups[SYMMETRY_X], groups[SYMMETRY_Y]
    for tag, members in groups.items():
        gmsh.model.addPhysicalGroup(2, sorted(members), tag)
    gmsh.model.mesh.generate(3)
    if ELEMENTS[element] == 2:
        gmsh.model.mesh.setOrder(2)
    return gmsh.model


# -

# The cubes become the hemisphere in two steps. First the outer cube's surface is drawn radially
# onto a sphere of radius $2R$ around the pole, the inner cube staying as it is. Then an inversion
# in the sphere of radius $2R$ around the opposite pole $(0, 0, 2R)$ maps the half space $z < 0$
# onto the ball, its boundary onto the surface of the ball, and the half sphere onto the plane
# $z = R$. It keeps angles, and near the pole also lengths. All nodes of second-order cells are
# moved, so the cells are curved and the sphere is round.


# +
def bend(x, a):
    """Map points of the cubes to the hemisphere, shape (n, 3), in place."""
    plane = x[:, 2] < 0
    x[plane, 2] += SHIFT
    y = x[~plane]
    size, radius = np.abs(y).max(axis=1), np.linalg.norm(y, axis=1)
    w = np.clip((size - a) / (2 * R - a), 0, 1)
    y *= (1 - w + w * size / np.where(radius > 0, radius, 1))[:, None]
    y[:, 2] *= -1
    y -= (0, 0, 2 * R)
    x[~plane] = y * (4 * R**2 / np.sum(y**2, axis=1))[:, None] + (0, 0, 2 * R)


straight = weakref.WeakKeyDictionary()  # nodes of the cubes, for interpolation between meshes


def hemisphere(element, a, n, layers, growth, full=False):
    """Mesh of the body and the plane, and tags of facets."""
    model = cubes(element, a, n, layers, growth, full) if comm.rank == 0 else None
    if element == "hex20":
        domain, _, tags = model_to_hex20(model, comm)
    else:
        domain, _, tags = gmsh_reader.model_to_mesh(model, comm, 0, gdim=3)[:3]
    if comm.rank == 0:
        import gmsh

        gmsh.finalize()
    straight[domain] = domain.geometry.x.copy()
    bend(domain.geometry.x, a)

    # The part of the curved surface that may come into contact
    values = tags.values.copy()
    middle = mesh.compute_midpoints(domain, 2, tags.indices)
    near = np.linalg.norm(middle.reshape(-1, 3)[:, :2], axis=1) < 1.6 * a
    values[(values == CURVED) & near] = CAP
    return domain, mesh.meshtags(domain, 2, tags.indices, values)


# -

# ## Contact in a few lines
#
# The curved surface near the pole is the slave, the plane the master. For the small strains of the
# linear material `geometry="reference"` keeps mortar integrals and normals of the undeformed
# bodies; of the two surfaces' normals, which differ by $r / R$, the plane's are taken.
#
# The hemisphere is held by contact alone: with an empty active set it would be loose. The first
# active set has the nodes inside of Hertz's radius; the default, those nearest to the plane, would
# do as well.
#
# Multipliers at all nodes (`dual`) resolve a pressure that varies within few cells best, and the
# plane is no coarse curved master, with which they would do badly; see the comparison below.


# +
def displacement_space(domain, element):
    if element == "hex20":
        return fem.functionspace(domain, dm.hex20(shape=(3,)))
    return fem.functionspace(domain, ("Lagrange", ELEMENTS[element], (3,)))


def supports(V, tags, full):
    """Symmetry planes, and the rigid plane, all dofs of whose one cell are fixed."""
    domain = V.mesh
    for dim in (2, 3):
        domain.topology.create_connectivity(dim, 3)
    bcs = []

    def fix(component, dofs):
        bcs.append(fem.dirichletbc(default_scalar_type(0), dofs, V.sub(component)))

    for component, tag in ((0, SYMMETRY_X), (1, SYMMETRY_Y)):
        fix(component, fem.locate_dofs_topological(V.sub(component), 2, tags.find(tag)))
    if full:
        # Without friction nothing else keeps it from sliding and from turning about its axis
        for component in (0, 1):
            W, _ = V.sub(component).collapse()
            axis = fem.locate_dofs_geometrical(
                (V.sub(component), W),
                lambda x: (np.hypot(x[0], x[1]) < 1e-8 * R) & (x[2] > R / 2),
            )
            bcs.append(fem.dirichletbc(fem.Function(W), axis, V.sub(component)))
        rim = fem.locate_dofs_geometrical(
            (V.sub(1), W), lambda x: np.linalg.norm(x.T - (R, 0, R), axis=1) < 1e-8 * R
        )
        bcs.append(fem.dirichletbc(fem.Function(W), rim, V.sub(1)))
    cells = mesh.locate_entities(domain, 3, lambda x: x[2] < 1e-10)
    for component in range(3):
        fix(component, fem.locate_dofs_topological(V.sub(component), 3, cells))
    return bcs


# Tangents are half of the work of a nonlinear material, and are assembled in half of the time by
# code that the compiler may vectorise, for this machine.

FAST = {"cffi_extra_compile_args": ["-O3", "-march=native", "-ffast-math"]}


def solve(
    domain,
    tags,
    element,
    material,
    p,
    full=False,
    petsc_options=None,
    multiplier="dual",
    master=MASTER,
):
    """Displacement, contact, problem and number of Newton iterations of one load.

    The master may be `dm.RigidPlane((0, 0, 0), (0, 0, 1))` as well.
    """
    V = displacement_space(domain, element)
    u, v = fem.Function(V, name="displacement"), ufl.TestFunction(V)
    degree = {"hex8": 3, "tet10": 4}.get(element, 5)
    dx = ufl.dx(domain=domain, metadata={"quadrature_degree": degree})
    ds = ufl.ds(domain=domain, subdomain_data=tags, metadata={"quadrature_degree": degree})
    load = fem.Constant(domain, default_scalar_type(p))
    F = ufl.derivative(energy(u, material) * dx, u, v) + load * v[2] * ds(TOP)

    small = {"geometry": "reference", "normal": (0, 0, -1)} if material == "linear" else {}
    contact = dm.Contact(
        V,
        tags,
        slave=CAP,
        master=master,
        initial_active=lambda x: np.hypot(x[0], x[1]) < hertz(p)[1],
        multiplier=multiplier,
        **small,
    )
    problem = dm.ContactProblem(
        F,
        u,
        bcs=supports(V, tags, full),
        interfaces=[contact],
        petsc_options_prefix="hertz_",
        petsc_options=petsc_options,
        jit_options=FAST,
    )
    iterations = problem.solve()
    return u, contact, problem, iterations


# -

# ## Measure
#
# The nodal multiplier is the contact pressure. The contact radius is the mean of the largest
# deformed radius of a node in contact and the smallest one of an open node; nodes are half a facet
# apart.
#
# With dual functions a nodal value is the average of the pressure around the node, weighted by the
# node's own transformed function: wide at corners, narrow at edges. So nodes at the same radius
# differ a little, most of all where the pressure falls like a root, at the end of the contact
# zone. No nodal pressure is negative. `contact.recovered_pressure` has averages around corners
# alone, linear in between: it is smooth, and for this pressure less accurate.

# +
CUBE = 1.26  # side of the uniform cube over Hertz's radius
results, curves = [], {}


def say(text):
    if comm.rank == 0:
        print(text, flush=True)


def grading(h, layers, size):
    """Growth with which layers, the first of thickness h, fill a size."""
    low, high = 1.0 + 1e-9, 100.0
    for _ in range(200):
        q = (low + high) / 2
        low, high = (q, high) if h * (q**layers - 1) / (q - 1) < size else (low, q)
    return q


def levelled_mesh(element, p, level, full):
    """Mesh of a level: 2, 4, 6 ... cells along the fine cube; h at the pole."""
    a = CUBE * hertz(p)[1]
    n, layers = 2 * (level + 1), 3 * (level + 1)
    growth = grading(a / 2, 3, 2 * R - a) ** (1 / (level + 1))
    return *hemisphere(element, a, n, layers, growth, full), a / n


def nodal_values(u, contact):
    """Deformed radius, pressure and status of the slave nodes that carry a multiplier, on rank 0.

    The gap tells slave nodes from others: it is zero where there is no multiplier.
    """
    pressure, gap, status = contact.pressure, contact.gap, contact.status
    W = pressure.function_space
    owned = W.dofmap.index_map.size_local
    x = u.function_space.tabulate_dof_coordinates()[:owned] + u.x.array.reshape(-1, 3)[:owned]
    active = status.x.array[:owned] > 0
    chosen = active | (gap.x.array[:owned] > 0)
    values = np.column_stack([np.hypot(x[:, 0], x[:, 1]), pressure.x.array[:owned], active])[chosen]
    return np.vstack(comm.allgather(values))


def pressure_error(pressure, tags, p):
    """Relative error of a pressure against Hertz in the L2 norm of the slave surface."""
    domain = pressure.function_space.mesh
    x, (largest, rho) = ufl.SpatialCoordinate(domain), hertz(p)
    inside = 1 - (x[0] ** 2 + x[1] ** 2) / rho**2
    exact = largest * ufl.sqrt(ufl.conditional(inside > 0, inside, 0.0))
    ds = ufl.ds(domain=domain, subdomain_data=tags, metadata={"quadrature_degree": 12})
    squares = [(pressure - exact) ** 2 * ds(CAP), exact**2 * ds(CAP)]
    error, norm = [comm.allreduce(fem.assemble_scalar(fem.form(s))) for s in squares]
    return float(np.sqrt(error / norm))


def applied_force(domain, tags, p):
    one = fem.Constant(domain, default_scalar_type(p))
    ds = ufl.ds(domain=domain, subdomain_data=tags, metadata={"quadrature_degree": 5})
    return comm.allreduce(fem.assemble_scalar(fem.form(one * ds(TOP))))


def measure(element, material, p, level, full=False):
    """Solve one case, print a line and append it to the results."""
    start = time.perf_counter()
    domain, tags, h = levelled_mesh(element, p, level, full)
    u, contact, problem, iterations = solve(domain, tags, element, material, p, full)
    values = nodal_values(u, contact)
    r, pressure, active = values[:, 0], values[:, 1], values[:, 2] > 0
    results.append(
        {
            "element": element,
            "material": material,
            "pressure": p,
            "h": h,
            "ndofs": 3 * u.function_space.dofmap.index_map.size_global,
            "lambda_max": float(pressure.max()),
            "contact_radius": float((r[active].max() + r[~active].min()) / 2),
            "newton_iterations": iterations,
            "active_nodes": int(active.sum()),
            "residuals": [float(step["force"]) for step in problem.history],
            "constraints": [float(step["constraint"]) for step in problem.history],
            "smallest_pressure": float(pressure[active].min()),
            "force_error": float(abs(contact.force[2] / applied_force(domain, tags, p) - 1)),
            "seconds": time.perf_counter() - start,
        }
    )
    if material == "linear":
        results[-1]["pressure_error"] = pressure_error(contact.pressure, tags, p)
    curves[element, material, p] = values
    q = results[-1]
    say(
        f"{element:6}{material:20} p = {p:<5g} h = {h:.4f} {q['ndofs']:7} dofs   "
        f"lambda_max {q['lambda_max']:7.3f}  radius {q['contact_radius']:.3f}  "
        f"{q['active_nodes']:4} active  {iterations} iterations  {q['seconds']:5.1f} s"
    )
    return u, contact


# -

# ## Run
#
# By default hex20 computes all materials of the table at both loads, and the other elements
# the first material at the larger load.


# +
def cases(options):
    """Element, material and pressure of what is asked for."""
    if options.element or options.material or options.pressure is not None:
        for p in (0.2, 0.05) if options.pressure is None else (options.pressure,):
            yield options.element or "hex20", options.material or "neo-hooke", p
        return
    for material in ("neo-hooke", "st-venant-kirchhoff", "linear"):
        for p in (0.2, 0.05):
            yield "hex20", material, p
    for element in ("hex8", "hex27", "tet10"):
        yield element, "neo-hooke", 0.2


def run(options):
    options.out.mkdir(parents=True, exist_ok=True)
    results.clear()
    curves.clear()
    spaces.clear()
    for number, (element, material, p) in enumerate(cases(options)):
        for level in range(options.level + 1):
            u, contact = measure(element, material, p, level, options.full)
        if number == 0:
            show(u, contact, p, options)
    if options.multipliers:
        compare_spaces(options)
    if options.convergence:
        energy_convergence(options)
    report(options.out)


# -

# ## Multiplier spaces
#
# Small strains, against Hertz. Two fields of each space: nodal values, and the recovered pressure.
# Errors are relative, in the norm L2 on the slave surface, and the largest one of the surface's
# nodes within 0.85 of Hertz's radius, in front of the end of the contact zone, where the curve is
# steep. With `--multipliers`, hex20 and p = 0.2, in %:
#
# | | h | nodal L2 | largest | recovered L2 | largest |
# |---|--:|--:|--:|--:|--:|
# | dual | 0.650 | 19.9 | 10.8 | 31.4 | 20.7 |
# | | 0.325 | 9.5 | 5.3 | 16.1 | 10.3 |
# | | 0.217 | 6.9 | 5.4 | 10.1 | 7.0 |
# | dual-linear | 0.650 | 30.0 | 16.3 | 30.0 | 16.4 |
# | | 0.325 | 15.7 | 8.9 | 15.7 | 8.9 |
# | | 0.217 | 9.2 | 5.1 | 9.3 | 5.1 |
# | dual-reproducing | 0.650 | 28.2 | 28.9 | 32.8 | 25.7 |
# | | 0.325 | 14.5 | 21.0 | 15.3 | 11.0 |
# | | 0.217 | 7.7 | 10.9 | 10.8 | 9.0 |
# | standard | 0.650 | 27.5 | 25.7 | 33.7 | 25.7 |
# | | 0.325 | 15.2 | 28.7 | 15.1 | 11.5 |
# | | 0.217 | 8.3 | 16.2 | 10.8 | 8.8 |
#
# So the pictures and curves here show nodal values of `dual`.


# +
spaces = []


def largest_error(pressure, tags, p):
    """Largest error at slave nodes within 0.85 of Hertz's radius, of the largest pressure."""
    W, (largest, rho) = pressure.function_space, hertz(p)
    dofs = fem.locate_dofs_topological(W, 2, tags.find(CAP))
    r = np.linalg.norm(W.tabulate_dof_coordinates()[dofs, :2], axis=1)
    dofs, r = dofs[r < 0.85 * rho], r[r < 0.85 * rho]
    errors = np.abs(pressure.x.array[dofs] / largest - np.sqrt(1 - r**2 / rho**2))
    return comm.allreduce(float(errors.max(initial=0.0)), op=MPI.MAX)


def compare_spaces(options, element="hex20", p=0.2):
    """Errors of the pressure with all multiplier spaces, on all levels."""
    say(
        f"\n{element}, errors of the pressure in %:       nodal L2, largest   recovered L2, largest"
    )
    for multiplier in ("dual", "dual-linear", "dual-reproducing", "standard"):
        for level in range(options.level + 1):
            domain, tags, h = levelled_mesh(element, p, level, options.full)
            _, contact, _, iterations = solve(
                domain, tags, element, "linear", p, options.full, multiplier=multiplier
            )
            fields = {"nodal": contact.pressure, "recovered": contact.recovered_pressure}
            row = {"element": element, "multiplier": multiplier, "h": h, "iterations": iterations}
            for name, field in fields.items():
                row[f"{name}_error"] = pressure_error(field, tags, p)
                row[f"{name}_largest_error"] = largest_error(field, tags, p)
            spaces.append(row)
            say(
                f"  {multiplier:18} h = {h:.4f}  {iterations:2} iterations  "
                + "".join(
                    f"{100 * row[f'{name}_error']:14.2f} {100 * row[f'{name}_largest_error']:8.2f}"
                    for name in fields
                )
            )
    if comm.rank == 0:
        (options.out / "multipliers.json").write_text(json.dumps(spaces, indent=1))


# -

# ## Error in the energy norm
#
# There is no closed form of the displacement, so a finer mesh stands in for it. Its nodes take the
# values of the coarse solution at the same points of the cubes, where cells are straight; the norm
# is that of linear elasticity.


# +
errors = {}


def energy_convergence(options, p=0.2, material="neo-hooke"):
    fine = options.level + 2
    domain, tags, _ = levelled_mesh("hex20", p, fine, False)
    u_fine = solve(domain, tags, "hex20", material, p)[0]
    V = u_fine.function_space
    w = fem.Function(V)
    dx = ufl.dx(domain=domain, metadata={"quadrature_degree": 5})
    square = fem.form(energy(u_fine - w, "linear") * dx)
    cells = np.arange(domain.topology.index_map(3).size_local, dtype=np.int32)
    cells = cells[mesh.compute_midpoints(domain, 3, cells)[:, 2] > 0]
    for element in ("hex8", "hex20"):
        found = []
        for level in range(options.level + 1):
            coarse_domain, coarse_tags, h = levelled_mesh(element, p, level, False)
            u = solve(coarse_domain, coarse_tags, element, material, p)[0]
            meshes = (domain, coarse_domain)
            bent = [m.geometry.x.copy() for m in meshes]
            for m in meshes:
                m.geometry.x[:] = straight[m]
            data = fem.create_interpolation_data(V, u.function_space, cells, padding=1e-6)
            w.x.array[:] = 0
            w.interpolate_nonmatching(u, cells, data)
            w.x.scatter_forward()
            for m, x in zip(meshes, bent):
                m.geometry.x[:] = x
            error = np.sqrt(2 * comm.allreduce(fem.assemble_scalar(square)))
            found.append((h, error))
            say(f"{element:6} h = {h:.4f}   error in the energy norm {error:.3e}")
        errors[element] = tuple(zip(*found))


# -

# ## Show


# +
COLOURS = {"neo-hooke": "C0", "st-venant-kirchhoff": "C1", "linear": "C2", "neo-hooke-log": "C3"}
MARKERS = {"hex20": "o", "hex8": "s", "hex27": "D", "tet10": "^"}


def show(u, contact, p, options):
    """The deformed body: pressure at the pole, and the whole."""
    pressure, domain = contact.pressure, u.function_space.mesh
    with Writer(options.out / "displacement.bp", [u, contact.traction]) as file:
        file.write(0.0)
    with Writer(options.out / "contact.bp", [pressure, contact.gap, contact.status]) as file:
        file.write(0.0)
    body = surface(domain, {"p": pressure}, displacement=u, where=lambda x: x[2] > 0)
    # The square of equal facets around the pole
    facets = contact.slave[0].tags.find(CAP)
    middle = mesh.compute_midpoints(domain, 2, facets)
    pole = np.abs(middle[:, :2]).max(axis=1) < CUBE * hertz(p)[1]
    cap = surface(domain, {"p": pressure}, displacement=u, facets=facets[pole])
    look = {
        "label": "contact pressure",
        "clim": (0.0, results[-1]["lambda_max"]),
        "cmap": "YlOrRd",
    }
    picture(
        options.out / "hemisphere.png",
        [body],
        "p",
        title=f"Deformed hemisphere, p = {p:g}",
        view=(-1.2, -1.6, -0.7),
        zoom=0.8,
        **look,
    )
    picture(
        options.out / "contact_zone.png",
        [cap],
        "p",
        title=f"Contact zone from below, p = {p:g}",
        view=(0, 0, -1),
        up=(0, 1, 0),
        zoom=0.9,
        **look,
    )


def report(out):
    """Table, files and plots, by rank 0."""
    if comm.rank > 0:
        return
    (out / "results.json").write_text(json.dumps(results, indent=1))
    finest = {(r["element"], r["material"], r["pressure"]): r for r in results}

    print("\nFinest meshes:    lambda_max  (difference to table, to Hertz)    radius (table)")
    for (element, material, p), r in finest.items():
        largest, rho = hertz(p)
        table = REFERENCE.get((material, p))
        to_table = f"{100 * (r['lambda_max'] / table[0] - 1):+6.2f} %" if table else "       -"
        bounds = f"{table[1][0]:.3f}-{table[1][1]:.3f}" if table else "-"
        print(
            f"{element:6}{material:20} p = {p:<5g} {r['lambda_max']:7.3f}  ({to_table}, "
            f"{100 * (r['lambda_max'] / largest - 1):+6.2f} %)   {r['contact_radius']:.3f} "
            f"({bounds}; Hertz {rho:.3f}; facet {r['h']:.3f})"
        )
    for r in finest.values():
        if "pressure_error" in r:
            print(
                f"relative L2 error of the pressure against Hertz: {r['pressure_error']:.4f} "
                f"(p = {r['pressure']:g}, h = {r['h']:.4f})"
            )
    for p, part in PAPER.items():
        print(
            f"p = {p:g}: the paper is {100 * part:.1f} % off Hertz; by the table "
            + ", ".join(
                f"{m} {100 * (v[0] / hertz(p)[0] - 1):+.1f} %"
                for (m, q), v in REFERENCE.items()
                if q == p
            )
        )

    import matplotlib

    matplotlib.use("Agg", force=False)
    import matplotlib.pyplot as plt

    plot_profiles(plt, out, finest)
    plot_largest(plt, out)
    plot_newton(plt, out, finest)
    if errors:
        convergence_plot(
            out / "energy_error.png",
            {"energy norm, against a fine mesh": errors},
            xlabel="$h$ at the pole",
            slopes=(1, 1.5),
        )
    print(f"\nWritten to {out}")


def plot_profiles(plt, out, finest):
    """Pressure against radius, with Hertz's curve."""
    loads = sorted({p for _, _, p in finest}, reverse=True)
    fig, axes = plt.subplots(1, len(loads), figsize=(6.4 * len(loads), 4.8), squeeze=False)
    for axis, p in zip(axes[0], loads):
        largest, rho = hertz(p)
        r = np.linspace(0, rho, 400)
        axis.plot(r, largest * np.sqrt(1 - r**2 / rho**2), "k-", label="Hertz")
        for (element, material, q), values in curves.items():
            if q == p and (element == "hex20" or len(finest) < 3):
                near = values[:, 0] < 1.4 * rho
                axis.plot(
                    *values[near, :2].T,
                    MARKERS[element],
                    color=COLOURS[material],
                    markersize=4,
                    alpha=0.7,
                    label=f"{element}, {material}",
                )
        axis.set(title=f"$p = {p:g}$", xlabel="deformed radius", ylabel="contact pressure")
        axis.legend(fontsize=8)
        axis.grid(alpha=0.25)
    fig.tight_layout()
    fig.savefig(out / "pressure.png", dpi=150)
    plt.close(fig)


def plot_largest(plt, out):
    """Largest pressure against mesh size, with table, Hertz and paper."""
    loads = sorted({r["pressure"] for r in results}, reverse=True)
    size = (6.4 * len(loads), 5.8)
    fig, axes = plt.subplots(1, len(loads), figsize=size, squeeze=False, layout="constrained")
    for axis, p in zip(axes[0], loads):
        shown = {}
        for r in results:
            if r["pressure"] == p:
                shown.setdefault((r["element"], r["material"]), []).append(
                    (r["h"], r["lambda_max"])
                )
        axis.axhline(hertz(p)[0], color="k", linewidth=1, label="Hertz")
        if p in PAPER:
            level = hertz(p)[0] * (1 + PAPER[p])
            label = "paper, finest mesh"
            axis.axhline(level, color="k", linestyle=(0, (1, 3)), linewidth=2, label=label)
        for material in dict.fromkeys(m for _, m in shown):
            if (material, p) in REFERENCE:
                axis.axhline(
                    REFERENCE[material, p][0],
                    color=COLOURS[material],
                    linestyle="--",
                    linewidth=1,
                    label=f"axisymmetric reference, {material}",
                )
        for (element, material), rows in shown.items():
            axis.plot(
                *zip(*rows),
                marker=MARKERS[element],
                color=COLOURS[material],
                linestyle="-" if element == "hex20" else ":",
                fillstyle="full" if element == "hex20" else "none",
                label=f"{element}, {material}",
            )
        axis.set(title=f"$p = {p:g}$", xlabel="$h$ at the pole", ylabel=r"$\lambda_{\max}$")
        axis.set_xlim(left=0)
        axis.grid(alpha=0.25)
    # Below, where it hides no point; the first load has all elements
    lines = axes[0, 0].get_legend_handles_labels()
    fig.legend(*lines, fontsize=8, loc="outside lower center", ncols=2 * len(loads))
    fig.savefig(out / "lambda_max.png", dpi=150)
    plt.close(fig)


def plot_newton(plt, out, finest):
    """Residual of each Newton iteration on the finest meshes: forces, and contact conditions."""
    fig, axes = plt.subplots(1, 2, figsize=(12.8, 5.4), layout="constrained")
    for axis, key in zip(axes, ("residuals", "constraints")):
        for (element, material, p), r in finest.items():
            values = np.array(r[key], dtype=float)
            steps = np.arange(len(values))
            good = np.isfinite(values) & (values > 0)
            axis.semilogy(
                steps[good],
                values[good],
                marker=MARKERS[element],
                color=COLOURS[material],
                linestyle="-" if p == max(q for _, _, q in finest) else ":",
                label=f"{element}, {material}, p = {p:g}",
            )
        axis.axhline(1e-9, color="k", linewidth=0.8, linestyle=(0, (4, 4)))
        axis.set(xlabel="Newton iteration")
        axis.grid(alpha=0.25)
    axes[0].set(title="residual force / forces at work")
    axes[1].set(title="contact conditions / largest pressure")
    fig.legend(
        *axes[0].get_legend_handles_labels(), fontsize=8, loc="outside lower center", ncols=5
    )
    fig.savefig(out / "newton.png", dpi=150)
    plt.close(fig)


if __name__ == "__main__":
    run(options)
