# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A pin in its hole: contact that grows far round
#
# A pin lies in the hole of a plate with a small clearance and is pressed to its side. The more it
# is loaded, the further round contact reaches; Hertz's theory, for which both bodies are half
# spaces, ends soon. Persson (1964) solved the problem in closed form for any angle.
#
# Run it with `python3 demo_pin.py [--out DIR] [--level N]`, alone or under `mpirun`.

# +
import argparse
import json
import time
from pathlib import Path

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import ufl
from dolfinx import default_scalar_type, fem
from dolfinx_mortar.plotting import Surface, Writer, picture, surface

try:
    from dolfinx.io import gmsh as gmsh_reader
except ImportError:  # DOLFINx 0.9
    from dolfinx.io import gmshio as gmsh_reader

comm = MPI.COMM_WORLD

parser = argparse.ArgumentParser(description="A pin in the hole of a plate")
parser.add_argument("--out", type=Path, default=Path("output/pin"), help="folder to write")
parser.add_argument("--level", type=int, default=1, help="refinement, from 0")
parser.add_argument("--multiplier", help="instead of the default, see the README")
parser.add_argument("--rim", type=float, default=20.0, help="the plate's radius over the pin's")
options = parser.parse_args() if __name__ == "__main__" else parser.parse_args([])


def say(text):
    if comm.rank == 0:
        print(text, flush=True)


# -

# ## Persson's solution
#
# Pin and plate are of the same material, in plane strain, without friction. The force $Q$ per
# thickness acts at the centre of the pin and is held far away in the plate. With the radius $R$,
# the clearance $\Delta R$ of the radii, $E^* = E / (1 - \nu^2)$, the half-angle of contact
# $\epsilon$ and $b = \tan(\epsilon / 2)$
#
# $$\frac{E^* \Delta R}{Q} = \frac{2 - \ln(b^2 + 1) - 2 b^4}{\pi b^2 (b^2 + 1)},$$
#
# and at the angle $\theta$, with $y = \tan(\theta / 2)$ and $r = \sqrt{b^2 - y^2}$, the pressure is
#
# $$\frac{R p}{Q} = \frac{2}{\pi \sqrt{b^2 + 1}} \frac{r}{1 + y^2} + \frac{1}{2 \pi b^2 (1 + b^2)}
# \ln \frac{\sqrt{b^2 + 1} + r}{\sqrt{b^2 + 1} - r}.$$
#
# (As in M. Ciavarella, P. Decuzzi, Int. J. Solids Structures 38, 4507-4523, 2001.) Two things are
# easily checked: the pressure carries $Q$, and for small angles $b^2 = 2 Q / (\pi E^* \Delta R)$,
# as Hertz has it. The right side of the first formula is zero at 85 degrees, which no load exceeds.

# +
R, CLEARANCE, L = 10.0, 0.01, 0.5  # radius of the hole, clearance of the radii, thickness [mm]
E, NU = 210e3, 0.3  # [MPa]
ANGLES = (20.0, 40.0, 60.0)  # half-angles of contact [degrees]


def load_at(degrees):
    """Load per thickness at which contact reaches a half-angle."""
    b2 = np.tan(np.radians(degrees) / 2) ** 2
    ratio = (2 - np.log(b2 + 1) - 2 * b2**2) / (np.pi * b2 * (b2 + 1))
    return E / (1 - NU**2) * CLEARANCE / ratio


def persson(degrees, y, lib=np):
    """Pressure where the tangent of half the angle is y; with `lib=ufl` as an expression."""
    b = float(np.tan(np.radians(degrees) / 2))
    largest = np.maximum if lib is np else ufl.max_value
    r, root = lib.sqrt(largest(b**2 - y**2, 0.0)), np.sqrt(b**2 + 1)
    direct = 2 / (np.pi * root) * r / (1 + y**2)
    log = lib.ln if lib is ufl else np.log
    return (
        load_at(degrees)
        / R
        * (direct + log((root + r) / (root - r)) / (2 * np.pi * b**2 * root**2))
    )


def resultant(degrees):
    """Force that the pressure of the closed solution carries; it is the load."""
    # Points in t, angles eps sin(t), where the integrand is smooth
    t, w = np.polynomial.legendre.leggauss(64)
    eps = np.radians(degrees)
    theta = eps * np.sin(np.pi / 2 * t)
    p = persson(degrees, np.tan(theta / 2))
    return float(R * np.sum(w * np.pi / 2 * p * np.cos(theta) * eps * np.cos(np.pi / 2 * t)))


# -

# ## Two meshes
#
# Half of each body, one layer of hex27 whose ends cannot move along the axis. Cells are fine around
# the lower part of the hole, and larger elsewhere. Nodes of second order lie on the circles, and
# those of the plate do not meet those of the pin.

# +
CONTACT, SYMMETRY, ENDS, RIM = 1, 2, 3, 4  # tags of facets
FINE = 75.0  # up to this angle cells are fine [degrees]


def to_dolfinx(build):
    """Mesh a model on rank 0; the mesh and the tags of its facets."""
    model = None
    if comm.rank == 0:
        import gmsh

        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        model = gmsh.model
        build(model)
        tag_faces(model)
        model.mesh.generate(3)
        model.mesh.setOrder(2)
    domain, _, tags = gmsh_reader.model_to_mesh(model, comm, 0, gdim=3)[:3]
    if comm.rank == 0:
        gmsh.finalize()
    return domain, tags


def blocks(model, points, quadrilaterals, arcs, cells):
    """Extruded quadrilateral faces, with cells in rows.

    Args:
        model: gmsh's model.
        points: Polar coordinates by name, the angle [degrees] from the direction of the load.
        quadrilaterals: Names of the four corners of each face, in order.
        arcs: Pairs of points that an arc joins.
        cells: Number of cells, and ratio of the length of one to the length of the one before, for
            pairs of points in the direction of the ratio.
    """
    occ = model.occ
    centre = occ.addPoint(0, 0, 0)
    at = {
        name: occ.addPoint(r * np.sin(np.radians(a)), -r * np.cos(np.radians(a)), 0)
        for name, (r, a) in points.items()
    }
    curves = {}
    for pair in cells:
        a, b = (at[name] for name in pair)
        curves[pair] = occ.addCircleArc(a, centre, b) if pair in arcs else occ.addLine(a, b)
    loops = []
    for corners in quadrilaterals:
        sides = list(zip(corners, corners[1:] + corners[:1]))
        loops.append(
            occ.addCurveLoop([curves[s] if s in curves else -curves[s[::-1]] for s in sides])
        )
    faces = [occ.addPlaneSurface([loop]) for loop in loops]
    occ.remove([(0, centre)])
    occ.extrude([(2, face) for face in faces], 0, 0, L, [1], recombine=True)
    occ.synchronize()
    for pair, (n, ratio) in cells.items():
        model.mesh.setTransfiniteCurve(curves[pair], n + 1, "Progression", ratio)
    for face, corners in zip(faces, quadrilaterals):
        model.mesh.setTransfiniteSurface(face, cornerTags=[at[name] for name in corners])
        model.mesh.setRecombine(2, face)


def pin(model, h):
    """Three blocks around a core. Cells of h [degrees] lie in contact."""
    radius, core, around, inward = R - CLEARANCE, 0.45 * R, round(FINE / h), round(20 / h)
    beside = max(2, round((180 - 2 * FINE) / (3 * h)))
    points = {
        f"{name}{k}": (r, a)
        for name, r in (("i", core), ("o", radius))
        for k, a in enumerate((0.0, FINE, 180 - FINE, 180.0))
    }
    cells = {(f"o{k}", f"i{k}"): (inward, 1.0 + 0.8 / inward) for k in range(4)}
    for name in "io":
        for k, n in enumerate((around, beside, around)):
            cells[f"{name}{k}", f"{name}{k + 1}"] = (n, 1.0)
    cells["i0", "i3"] = (beside, 1.0)
    faces = [(f"i{k}", f"o{k}", f"o{k + 1}", f"i{k + 1}") for k in range(3)]
    arcs = [(f"o{k}", f"o{k + 1}") for k in range(3)]
    blocks(model, points, [*faces, ("i0", "i1", "i2", "i3")], arcs, cells)


def plate(model, h, rim):
    """Two blocks from the hole to the rim, which has a radius of so many radii of the hole."""
    around, rest = round(FINE / (1.3 * h)), max(3, round((180 - FINE) / (6 * h)))
    ratio = 1.0 + 0.12 * h / 2.5
    first = np.radians(1.3 * h)  # length of the first cell over R
    outward = round(np.log(1 + (rim - 1) * (ratio - 1) / first) / np.log(ratio))
    points = {
        f"{name}{k}": (r, a)
        for name, r in (("i", R), ("o", rim * R))
        for k, a in enumerate((0.0, FINE, 180.0))
    }
    cells = {(f"i{k}", f"o{k}"): (outward, ratio) for k in range(3)}
    for name in "io":
        cells |= {(f"{name}0", f"{name}1"): (around, 1.0), (f"{name}1", f"{name}2"): (rest, 1.0)}
    faces = [(f"i{k}", f"o{k}", f"o{k + 1}", f"i{k + 1}") for k in range(2)]
    arcs = [(f"{name}{k}", f"{name}{k + 1}") for name in "io" for k in range(2)]
    blocks(model, points, faces, arcs, cells)


def tag_faces(model):
    """Tags by place: symmetry, ends, the circle where both bodies meet, and the rim."""
    groups = {CONTACT: [], SYMMETRY: [], ENDS: [], RIM: []}
    for _, face in model.getBoundary(model.getEntities(3), oriented=False):
        x = np.array(model.occ.getCenterOfMass(2, face))
        low, high = np.array(model.getBoundingBox(2, face)).reshape(2, 3)
        if np.ptp([low[2], high[2]]) < 1e-3:
            groups[ENDS].append(face)
        elif high[0] - low[0] < 1e-3:
            groups[SYMMETRY].append(face)
        else:
            groups[CONTACT if np.hypot(*x[:2]) < 1.1 * R else RIM].append(face)
    for tag, faces in groups.items():
        if faces:
            model.addPhysicalGroup(2, faces, tag)
    model.addPhysicalGroup(3, [volume for _, volume in model.getEntities(3)], 1)


# -

# ## Load
#
# A force at a point would be singular. With $s = |x| / r_0$ the body force
#
# $$f = \frac{8 Q}{\pi r_0^2} (1 - s^2)^2 \left(1 - \tfrac{5}{2} s^2\right), \quad s < 1,$$
#
# has the resultant $Q$ and no second moment. Elastic fields are biharmonic, so that outside of
# $r_0$ it acts *exactly* as a force at the centre. What remains is the rim of the plate, held at
# twenty radii, where Persson has none, and a clearance that is not infinitely small. Both cost
# little: at 60 degrees a rim at ten radii raises the largest pressure by 0.3 % and takes 0.14
# degrees off the half-angle; three times the clearance changes them by 0.1 % and 0.08 degrees
# (level 1).

# +
REACH = 0.9 * R  # r_0


def stress(u):
    lmbda, mu = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
    eps = ufl.sym(ufl.grad(u))
    return 2 * mu * eps + lmbda * ufl.tr(eps) * ufl.Identity(3)


def body(domain, tags, load=None):
    """Displacement, residual and conditions; with a load also its body force."""
    V = fem.functionspace(domain, ("Lagrange", 2, (3,)))
    u, v = fem.Function(V, name="displacement"), ufl.TestFunction(V)
    F = ufl.inner(stress(u), ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 6})
    if load is not None:
        x = ufl.SpatialCoordinate(domain)
        s2 = (x[0] ** 2 + x[1] ** 2) / REACH**2
        density = 8 * load / (np.pi * REACH**2) * (1 - s2) ** 2 * (1 - 2.5 * s2)
        pull = ufl.conditional(s2 < 1, density, 0.0)
        F += pull * v[1] * ufl.dx(metadata={"quadrature_degree": 8})
    bcs = []
    for components, tag in (((0,), SYMMETRY), ((2,), ENDS), ((0, 1, 2), RIM)):
        for component in components:
            W = V.sub(component)
            dofs = fem.locate_dofs_topological(W, 2, tags.find(tag))
            bcs.append(fem.dirichletbc(default_scalar_type(0), dofs, W))
    return u, F, bcs


def problem(h, multiplier=None, rim=20.0):
    """The problem, and its load per thickness.

    Args:
        h: Size of the cells in contact [degrees].
        multiplier: Multiplier space, by default the library's.
        rim: Radius of the plate over that of the pin.
    """
    meshes = [to_dolfinx(lambda m: pin(m, h)), to_dolfinx(lambda m: plate(m, h, rim))]
    load = fem.Constant(meshes[0][0], default_scalar_type(0))
    u, F, bcs = zip(body(*meshes[0], load), body(*meshes[1]))
    contact = dm.Contact(
        [w.function_space for w in u],
        [tags for _, tags in meshes],
        slave=CONTACT,
        master=CONTACT,
        **({} if multiplier is None else {"multiplier": multiplier}),
    )
    return (
        dm.ContactProblem(
            F,
            u,
            bcs=[bc for some in bcs for bc in some],
            interfaces=[contact],
            petsc_options_prefix="pin_",
        ),
        load,
    )


# -

# ## Measure
#
# The square of the pressure goes to zero as a polynomial in $y^2$, and a polynomial through the
# nodal values tells where. Deviations in the $L_2$ norm are those of nodal values, interpolated.
#
# The pin is the slave. Multipliers are those at all nodes (`"dual"`, the default of hex27): their
# profiles deviate by 1.1, 0.6 and 0.4 %, those of `"dual-linear"`, which cannot bend where the
# pressure falls to zero, by 4.1, 1.9 and 1.2 %; half-angles by 0.3 % against 0.8 % at most.


# +
def nodal_values(contact):
    """Tangents of half the angles, and pressures, of the slave's nodes in one of the ends."""
    W = contact.pressure.function_space
    dofs = fem.locate_dofs_topological(W, 2, contact.slave[0].tags.find(CONTACT))
    dofs = dofs[dofs < W.dofmap.index_map.size_local]
    x, p = W.tabulate_dof_coordinates()[dofs], contact.pressure.x.array[dofs]
    corners = np.isclose(x[:, 2], 0)
    values = np.column_stack([half_tangent(x.T), p])[corners]
    values = np.concatenate(comm.allgather(values))
    return values[np.argsort(values[:, 0])].T


def half_tangent(x):
    return np.tan(np.arctan2(x[0], -x[1]) / 2)


def half_angle(y, p):
    """Angle [degrees] at which a polynomial for the square of the pressure vanishes."""
    inside = p > 0.1 * p.max()
    degree = min(3, np.count_nonzero(inside) // 3)
    roots = np.polynomial.Polynomial.fit(y[inside] ** 2, p[inside] ** 2, degree).roots().real
    b2 = roots[np.argmin(np.abs(roots - y[inside].max() ** 2))]
    return float(2 * np.degrees(np.arctan(np.sqrt(b2))))


def profile_error(contact, degrees):
    """Deviation of the pressure from the closed solution in L2, relative."""
    W, tags = contact.pressure.function_space, contact.slave[0].tags
    metadata = {"quadrature_degree": 12}
    ds = ufl.Measure("ds", W.mesh, subdomain_data=tags, metadata=metadata)(CONTACT)
    x = ufl.SpatialCoordinate(W.mesh)
    y = x[0] / (ufl.sqrt(x[0] ** 2 + x[1] ** 2) - x[1] + 1e-12)
    exact = persson(degrees, y, ufl)
    squares = [((contact.pressure - exact) ** 2, ds), (exact**2, ds)]
    error, size = (comm.allreduce(fem.assemble_scalar(fem.form(f * m))) for f, m in squares)
    return float(np.sqrt(error / size))


def measure(p, load, degrees):
    """Solve with the load of a half-angle; what comes out against the closed solution."""
    start = time.perf_counter()
    load.value = load_at(degrees)
    iterations = p.solve()
    contact = p.interfaces[0]
    y, pressure = nodal_values(contact)
    exact = float(persson(degrees, 0.0))
    summary = contact.summary()
    return {
        "half_angle": degrees,
        "load": float(load.value),
        "multiplier": contact.multiplier_space,
        "force_error": float(2 * contact.force[1] / (load.value * L) - 1),
        "found_half_angle": half_angle(y, pressure),
        "largest_pressure": summary["largest_pressure"],
        "largest_pressure_error": summary["largest_pressure"] / exact - 1,
        "profile_error": profile_error(contact, degrees),
        "newton_iterations": iterations,
        "ndofs": sum(3 * V.dofmap.index_map.size_global for V in p.spaces),
        "seconds": time.perf_counter() - start,
        "nodes": {"y": y.tolist(), "p": pressure.tolist()},
    }


def run(options):
    options.out.mkdir(parents=True, exist_ok=True)
    p, load = problem(5.0 / 2**options.level, options.multiplier, options.rim)
    say(f"hex27, {sum(3 * V.dofmap.index_map.size_global for V in p.spaces)} dofs; errors in %\n")
    say("half-angle      load     found  error   largest p  error   profile (L2)   iterations")
    results = []
    files = [Writer(options.out / "pin.bp", [p.u[0], p.interfaces[0].traction])]
    files.append(Writer(options.out / "plate.bp", [p.u[1]]))
    for degrees in ANGLES:
        results.append(r := measure(p, load, degrees))
        for file in files:
            file.write(r["load"])
        say(
            f"{degrees:10.1f} {r['load']:9.2f} {r['found_half_angle']:9.2f} "
            f"{100 * (r['found_half_angle'] / degrees - 1):+6.2f} {r['largest_pressure']:11.3f} "
            f"{100 * r['largest_pressure_error']:+6.2f} {100 * r['profile_error']:14.2f} "
            f"{r['newton_iterations']:12}   {r['seconds']:5.1f} s"
        )
    for file in files:
        file.close()
    say("\n" + p.report())
    show(options.out, p.u, p.interfaces[0])
    if comm.rank == 0:
        curves(options.out / "profiles.png", results)
        (options.out / "results.json").write_text(json.dumps(results, indent=1))
    say(f"\nWritten to {options.out}")


# -

# ## Show
#
# The equivalent stress (von Mises) of both bodies below the largest load, and the pressure of all
# loads over the angle, with Hertz's for comparison. Where displacements are enlarged, so must be
# the clearance, or the bodies would seem to overlap. The picture is mirrored, and shows a
# rectangle of the plate; lines are the outlines of hole and pin.


# +
def von_mises(u):
    """Equivalent stress, linear in each cell."""
    W = fem.functionspace(u.function_space.mesh, ("DG", 1))
    s = ufl.dev(stress(u))
    points = W.element.interpolation_points
    value = fem.Function(W, name="von_mises")
    value.interpolate(
        fem.Expression(ufl.sqrt(1.5 * ufl.inner(s, s)), points() if callable(points) else points)
    )
    return value


def show(out, u, contact):
    factor, parts = 50, []
    sides = (contact.slave[0], (factor - 1) * CLEARANCE / R), (contact.master[0], 0.0)
    for w, (side, shrink) in zip(u, sides):
        V = w.function_space
        shown = fem.Function(V)
        x = V.tabulate_dof_coordinates() * (1, 1, 0)
        shown.x.array[:] = factor * w.x.array - shrink * x.ravel()
        body = surface(V.mesh, {"stress": von_mises(w)}, displacement=shown)
        circle = surface(V.mesh, displacement=shown, facets=side.tags.find(CONTACT))
        if comm.rank == 0:
            faces = body.faces.clip("x", (1.9 * R, 0, 0))
            faces = faces.clip("y", (0, 1.2 * R, 0)).clip("-y", (0, -2 * R, 0))
            half = Surface(faces, circle.edges)
            parts += [half, Surface(*(mesh.reflect((1, 0, 0)) for mesh in half))]
    picture(
        out / "pin.png",
        parts,
        "stress",
        label="von Mises [MPa]",
        clim=(0.0, 180.0),
        view=(0, 0, 1),
        up=(0, 1, 0),
        zoom=1.1,
        title=f"Pin and plate, displacement and clearance {factor} times enlarged",
    )


def curves(path, results):
    """Pressure over the angle: nodes, and the closed solution."""
    import matplotlib

    matplotlib.use("Agg", force=False)
    import matplotlib.pyplot as plt

    fig, axis = plt.subplots(figsize=(7.2, 4.8), layout="constrained")
    for k, r in enumerate(results):
        y, p = np.array(r["nodes"]["y"]), np.array(r["nodes"]["p"])
        end = np.tan(np.radians(r["half_angle"]) / 2)
        fine = end * np.sin(np.linspace(0, np.pi / 2, 200))
        label = f"Q = {r['load']:.0f} N/mm"
        angle = 2 * np.degrees(np.arctan(fine))
        axis.plot(angle, persson(r["half_angle"], fine), f"C{k}", label=f"{label}, Persson")
        hertz = np.sqrt(8 * r["load"] * (1 - NU**2) / (np.pi * E * CLEARANCE))  # half-angle
        t = np.linspace(0, hertz, 200)
        pressure = 2 * r["load"] / (np.pi * R * hertz) * np.sqrt(1 - (t / hertz) ** 2)
        axis.plot(np.degrees(t), pressure, f"C{k}:", linewidth=1, label="Hertz")
        shown = y < np.tan(np.radians(r["half_angle"] + 8) / 2)
        axis.plot(2 * np.degrees(np.arctan(y[shown])), p[shown], f"C{k}o", markersize=4)
    axis.set(xlabel="angle [degrees]", ylabel="pressure [MPa]", xlim=(0, None), ylim=(0, None))
    axis.legend()
    axis.grid(alpha=0.3)
    fig.savefig(path, dpi=150)
    plt.close(fig)


if __name__ == "__main__":
    run(options)
