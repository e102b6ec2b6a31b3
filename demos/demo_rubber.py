# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A rubber cylinder whose side folds onto the plate
#
# A short cylinder of rubber, glued to a press above, is pressed on a plate with friction. Rubber
# keeps its volume, so the cylinder bulges until its side comes to lie on the plate: contact rolls
# over the sharp rim. Bottom and side are both slave; the library splits them at the edge, each with
# its own normals.
#
# Run it with `python3 demo_rubber.py [--out DIR] [--level N]`, alone or under `mpirun`.

# +
import argparse
import json
from pathlib import Path

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import ufl
from dolfinx import default_scalar_type, fem, mesh
from dolfinx_mortar.plotting import Surface, Writer, gif, picture, surface

try:
    from dolfinx.io import gmsh as gmsh_reader
except ImportError:  # DOLFINx 0.9
    from dolfinx.io import gmshio as gmsh_reader

comm = MPI.COMM_WORLD

parser = argparse.ArgumentParser(description="A rubber cylinder folds onto a plate")
parser.add_argument("--out", type=Path, default=Path("output/rubber"), help="folder to write")
parser.add_argument("--level", type=int, default=1, help="refinement, from 0")
parser.add_argument("--friction", type=float, default=0.5, help="coefficient of friction")
parser.add_argument("--compression", type=float, default=0.5, help="of the height 1, at the end")
options = parser.parse_args() if __name__ == "__main__" else parser.parse_args([])


def say(text):
    if comm.rank == 0:
        print(text, flush=True)


# -

# ## Bodies
#
# Radius and height are 1. A quarter is meshed with tetrahedra of second order; the plate is a few
# first-order hexahedra of a material a thousand times stiffer.

# +
SLAVE, TOP, PLANE_X, PLANE_Y = 1, 2, 3, 4  # tags of facets


def cylinder(size):
    """Mesh of a quarter of the cylinder, and tags of its facets."""
    model = None
    if comm.rank == 0:
        import gmsh

        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        model = gmsh.model
        volume = model.occ.addCylinder(0, 0, 0, 0, 0, 1, 1, angle=np.pi / 2)
        model.occ.synchronize()
        groups = {SLAVE: [], TOP: [], PLANE_X: [], PLANE_Y: []}
        for _, face in model.getEntities(2):
            low, high = np.array(model.getBoundingBox(2, face)).reshape(2, 3)
            flat = high - low < 1e-3
            if flat[2]:
                groups[TOP if low[2] > 0.5 else SLAVE].append(face)
            else:
                groups[PLANE_X if flat[0] else PLANE_Y if flat[1] else SLAVE].append(face)
        for tag, faces in groups.items():
            model.addPhysicalGroup(2, faces, tag)
        model.addPhysicalGroup(3, [volume], 1)
        model.mesh.setSize(model.getEntities(0), size)
        model.mesh.generate(3)
        model.mesh.setOrder(2)
    domain, _, tags = gmsh_reader.model_to_mesh(model, comm, 0, gdim=3)[:3]
    if comm.rank == 0:
        gmsh.finalize()
    return domain, tags


def plate():
    """Mesh of the plate, and tags of its upper side."""
    domain = mesh.create_box(
        comm, [[-0.5, -0.5, -0.5], [2.5, 2.5, 0]], [3, 3, 1], mesh.CellType.hexahedron
    )
    top = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 0))
    return domain, mesh.meshtags(domain, 2, np.sort(top), 1)


# -

# ## Rubber
#
# Neo-Hooke's material with a bulk modulus of five times the shear modulus,
#
# $$\Psi = \frac{G}{2} \left(J^{-2/3} I_1 - 3\right) + \frac{K}{4} \left(J^2 - 1 - 2 \ln J\right).$$


# +
def energy(u, G, K):
    F = ufl.Identity(3) + ufl.grad(u)
    J = ufl.det(F)
    return G / 2 * (J ** (-2 / 3) * ufl.inner(F, F) - 3) + K / 4 * (J**2 - 1 - 2 * ufl.ln(J))


def problem(size, friction):
    """The problem, the displacement of the press and its Dirichlet condition."""
    (domain, tags), (below, below_tags) = cylinder(size), plate()
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 2, (3,))), name="displacement")
    w = fem.Function(fem.functionspace(below, ("Lagrange", 1, (3,))), name="displacement")
    V, W = u.function_space, w.function_space
    dx = ufl.dx(metadata={"quadrature_degree": 5})
    F = [
        ufl.derivative(energy(f, *material) * dx(f.function_space.mesh), f)
        for f, material in ((u, (1.0, 5.0)), (w, (1e3, 5e3)))
    ]
    press = fem.Constant(domain, default_scalar_type((0, 0, 0)))
    top = fem.dirichletbc(press, fem.locate_dofs_topological(V, 2, tags.find(TOP)), V)
    bcs = [top]
    for component, tag in ((0, PLANE_X), (1, PLANE_Y)):
        dofs = fem.locate_dofs_topological(V.sub(component), 2, tags.find(tag))
        bcs.append(fem.dirichletbc(default_scalar_type(0), dofs, V.sub(component)))
    low = fem.locate_dofs_geometrical(W, lambda x: x[2] < -0.4)
    bcs.append(fem.dirichletbc(np.zeros(3, dtype=default_scalar_type), low, W))
    contact = dm.Contact((V, W), (tags, below_tags), slave=SLAVE, master=1, friction=friction)
    return (
        dm.ContactProblem(F, [u, w], bcs=bcs, interfaces=[contact], petsc_options_prefix="rubber_"),
        press,
        top,
    )


# -

# ## Press
#
# `problem.steps` sets the loads, solves, halves steps that do not converge, and tells how it goes.
# The force of the press (`problem.reaction`) is what contact carries, to the solver's tolerance.


# +
def run(options):
    options.out.mkdir(parents=True, exist_ok=True)
    p, press, top = problem(0.3 / 1.5**options.level, options.friction)
    (contact,), u = p.interfaces, p.u[0]
    steps, frames = [], []

    def load(t):
        press.value[2] = -options.compression * t

    with Writer(options.out / "rubber.bp", [u]) as file:
        for t in p.steps(round(options.compression / 0.025), load):
            file.write(t)
            s, force = contact.summary(), p.reaction(top)
            steps.append(
                {
                    "compression": -press.value[2],
                    "press": force.tolist(),
                    **{k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in s.items()},
                    "newton_iterations": len(p.history) - 1,
                }
            )
            frames.append(draw(options.out, u, steps))
    worst = max(abs(s["press"][2] / s["force"][2] + 1) for s in steps)
    say("\n" + p.report())
    say(f"\nThe press carries the contact force to {worst:.1e}")
    say(f"side on the plate: {on_the_plate(u, contact):.3f} of the height")
    if comm.rank == 0:
        (options.out / "results.json").write_text(json.dumps(steps, indent=1))
        gif(options.out / "rubber.gif", frames, 0.15)
        curve(options.out / "force.png", steps)
    say(f"Written to {options.out}")


def on_the_plate(u, contact):
    """Height up to which the side has come to lie on the plate."""
    x = u.function_space.tabulate_dof_coordinates()
    y = x + u.x.array.reshape(-1, 3)
    lies = (np.hypot(x[:, 0], x[:, 1]) > 1 - 1e-6) & (y[:, 2] < 1e-3)
    return comm.allreduce(float(x[lies, 2].max(initial=0.0)), op=MPI.MAX)


def von_mises(u, G):
    """Equivalent of Cauchy's stress, linear in each cell."""
    F = ufl.Identity(3) + ufl.grad(u)
    s = G * ufl.det(F) ** (-5 / 3) * ufl.dev(F * F.T)
    W = fem.functionspace(u.function_space.mesh, ("DG", 1))
    points = W.element.interpolation_points
    value = fem.Function(W, name="von_mises")
    value.interpolate(
        fem.Expression(ufl.sqrt(1.5 * ufl.inner(s, s)), points() if callable(points) else points)
    )
    return value


def draw(out, u, steps):
    """The deformed quarter, coloured by its equivalent stress, between plate and press."""
    height = 1 - steps[-1]["compression"]
    parts = [surface(u.function_space.mesh, {"stress": von_mises(u, 1.0)}, displacement=u)]
    if comm.rank == 0:
        import pyvista as pv

        plate, press = (-0.2, 1.5, -0.2, 1.5, -0.12, 0), (0, 1, 0, 1, height, height + 0.12)
        parts += [Surface(box, box.extract_all_edges()) for box in map(pv.Box, (plate, press))]
    (out / "frames").mkdir(exist_ok=True)
    path = out / "frames" / f"{len(steps):03}.png"
    picture(
        path,
        parts,
        "stress",
        label="von Mises",
        clim=(0.0, 4.0),
        cmap="YlOrRd",
        view=(-0.5, -1.6, 0.4),
        zoom=0.95,
        title=f"Compression {1 - height:.3f}",
        size=(900, 700),
    )
    return path


def curve(path, steps):
    """Force of the press and area of contact over the compression."""
    import matplotlib

    matplotlib.use("Agg", force=False)
    import matplotlib.pyplot as plt

    fig, axis = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
    x = [s["compression"] for s in steps]
    axis.plot(x, [-4 * s["press"][2] for s in steps], "o-", label="force of the press")
    axis.plot(x, [4 * s["area"] for s in steps], "s--", label="area in contact")
    axis.axhline(np.pi, color="k", linewidth=0.8, label="area of the bottom, undeformed")
    axis.set(xlabel="compression", ylim=(0, None))
    axis.legend()
    axis.grid(alpha=0.3)
    fig.savefig(path, dpi=150)
    plt.close(fig)


if __name__ == "__main__":
    run(options)
