# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # Two half-cylindrical shells: large sliding with Coulomb friction
#
# A shell is pressed onto another one and slides over it, at large deformation, without friction
# and with the coefficient $\mu = 0.3$. This is the third example (section 6.3) of
#
# > A. Popp, B. I. Wohlmuth, M. W. Gee, W. A. Wall: *Dual quadratic mortar finite element methods
# > for 3D finite deformation contact*, SIAM J. Sci. Comput. 34 (2012), B421-B446.
#
# Run it with `python3 demo_sliding.py [--out DIR] [--level N]`, alone or under `mpirun`. Level 1
# is coarse and takes some minutes.

# +
import argparse
import json
import time
from pathlib import Path

from mpi4py import MPI

import basix
import dolfinx_mortar as dm
import numpy as np
import ufl
from dolfinx import fem, la, mesh
from dolfinx_mortar.mesh import create_hex20_mesh
from dolfinx_mortar.plotting import Writer, gif, picture, surface

comm = MPI.COMM_WORLD

parser = argparse.ArgumentParser(description="Two half-cylindrical shells with friction")
parser.add_argument("--out", type=Path, default=Path("output/sliding"), help="folder to write")
parser.add_argument("--level", type=int, default=1, help="refinement, from 0")
parser.add_argument(
    "--friction", type=float, nargs="+", default=[0.0, 0.3], help="coefficients of friction"
)
parser.add_argument(
    "--multiplier", default="dual", help="or dual-linear, dual-reproducing: see the README"
)
parser.add_argument("--stop", type=int, default=80, help="last of the 80 load steps to compute")
options = parser.parse_args() if __name__ == "__main__" else parser.parse_args([])


def say(text):
    if comm.rank == 0:
        print(text, flush=True)


# -

# ## Geometry
#
# The axes of both cylinders point in $y$. The upper body (slave) has the radii 0.09 and 0.13 and
# the length 0.11, the lower body (master) 0.13, 0.17 and 0.17. Between them is a gap of 0.01, and
# the upper body is 0.02 off the middle of the lower one, in negative $y$ direction.
#
# The paper has no drawing of the problem, only a description. It is read here as an upper shell
# that is open to the top, like a U, above a lower shell that is open to the bottom, like an arch:
# their crowns face each other with the gap between them. The plane end faces of U and arch are then
# the surfaces "right" and "left" (positive and negative $x$) of the description: A, C of the lower
# body and B, D of the upper one. So each body rests on its two ends, and what the crowns carry goes
# into them; the reactions are checked against the contact force below.

# +
STEPS = 80
LENGTH = {"upper": 0.11, "lower": 0.17}
RADII = {"upper": (0.09, 0.13), "lower": (0.13, 0.17)}
GAP, OFFSET = 0.01, -0.02
AXIS = {"upper": RADII["lower"][1] + GAP + RADII["upper"][1], "lower": 0.0}  # height z

SLAVE, MASTER, A, B, C, D = 1, 2, 3, 4, 5, 6  # tags of facets
UPPER, LOWER = 1, 2  # tags of cells


def shell(body, n):
    """Nodes and cells of half a cylinder.

    Args:
        body: "upper" or "lower".
        n: Cells along the circumference, the length and the thickness.

    Returns:
        Points, shape (points, 3), on the true cylinders, and 20-node hexahedra in Basix's order.
    """
    n = np.array(n)
    lattice = 2 * n + 1
    numbers = np.stack(np.meshgrid(*map(np.arange, lattice), indexing="ij"), axis=-1)
    numbers = numbers.reshape(-1, 3)
    # Vertices and edge midpoints: at most one odd number
    nodes = numbers[np.sum(numbers % 2, axis=1) < 2]
    s = nodes / (lattice - 1)
    angle = np.pi * (s[:, 0] + (body == "upper"))
    inner, outer = RADII[body]
    radius = inner + s[:, 2] * (outer - inner)
    y = (s[:, 1] - 0.5) * LENGTH[body] + (OFFSET if body == "upper" else 0.0)
    points = np.stack([radius * np.cos(angle), y, AXIS[body] + radius * np.sin(angle)], axis=1)

    index = np.zeros(lattice, dtype=np.int64)
    index[tuple(nodes.T)] = np.arange(len(nodes))
    hexahedron = basix.CellType.hexahedron
    vertices = basix.geometry(hexahedron)
    edges = [vertices[list(edge)].mean(axis=0) for edge in basix.topology(hexahedron)[1]]
    local = np.rint(2 * np.vstack([vertices, edges])).astype(int)
    first = 2 * np.stack(np.meshgrid(*map(np.arange, n), indexing="ij"), axis=-1).reshape(-1, 3)
    cells = first[:, None, :] + local
    return points, index[cells[..., 0], cells[..., 1], cells[..., 2]]


def resolution(level):
    """Cells of the upper and the lower body along circumference, length and thickness."""
    if level < 1:
        return (12, 4, 1), (16, 4, 1)
    k = 2 ** (level - 1)
    return (16 * k, 4 * k, k), (18 * k, 5 * k, k)


def two_shells(level):
    """One mesh with both bodies, tags of cells and tags of facets."""
    upper, lower = resolution(level)
    x, cells = shell("upper", upper)
    y, more = shell("lower", lower)
    x, cells = np.vstack([x, y]), np.vstack([cells, more + len(x)])
    if comm.rank > 0:
        x, cells = x[:0], cells[:0]
    domain = create_hex20_mesh(comm, x, cells, "basix")

    def near(value, x):
        return np.abs(x - value) < 1e-8

    def radius(body, x):
        return np.hypot(x[0], x[2] - AXIS[body])

    places = {
        SLAVE: lambda x: near(RADII["upper"][1], radius("upper", x)),
        MASTER: lambda x: near(RADII["lower"][1], radius("lower", x)),
        A: lambda x: near(AXIS["lower"], x[2]) & (x[0] > 0),
        B: lambda x: near(AXIS["upper"], x[2]) & (x[0] > 0),
        C: lambda x: near(AXIS["lower"], x[2]) & (x[0] < 0),
        D: lambda x: near(AXIS["upper"], x[2]) & (x[0] < 0),
    }
    middle = RADII["lower"][1] + GAP / 2
    bodies = {UPPER: lambda x: x[2] > middle, LOWER: lambda x: x[2] < middle}

    def tags(dim, locate, where):
        found = {tag: locate(domain, dim, marker) for tag, marker in where.items()}
        entities = np.concatenate(list(found.values()))
        values = np.repeat(list(found), [len(f) for f in found.values()]).astype(np.int32)
        order = np.argsort(entities)
        return mesh.meshtags(domain, dim, entities[order], values[order])

    return (
        domain,
        tags(3, mesh.locate_entities, bodies),
        tags(2, mesh.locate_entities_boundary, places),
    )


# -

# ## Materials
#
# Both bodies are compressible neo-Hookean with the stored energy
#
# $$\Psi = c\,(I_1 - 3) + \frac{c}{\beta} \left(J^{-2\beta} - 1\right), \quad
# c = \frac{E}{4(1+\nu)}, \quad \beta = \frac{\nu}{1 - 2\nu}.$$

# +
MATERIAL = {UPPER: (120.0, 0.3), LOWER: (60.0, 0.25)}  # E, nu


def energy(u, E, nu):
    F = ufl.Identity(3) + ufl.grad(u)
    c, beta = E / (4 * (1 + nu)), nu / (1 - 2 * nu)
    return c * (ufl.inner(F, F) - 3) + c / beta * (ufl.det(F) ** (-2 * beta) - 1)


# -

# ## Boundary conditions
#
# A is fixed. B is fixed in $x$ and $y$ and moves by $u_z = -0.1$. C is fixed in $y$ and $z$, D in
# $y$ and moves by $u_z = -0.12$; both are free in $x$. All in 80 equal steps.


# +
class Supports:
    """Dirichlet conditions of a load step."""

    def __init__(self, V, facet_tags):
        domain = V.mesh
        self.down_B, self.down_D = fem.Constant(domain, 0.0), fem.Constant(domain, 0.0)
        zero = fem.Constant(domain, 0.0)
        conditions = [(A, 0, zero), (A, 1, zero), (A, 2, zero)]
        conditions += [(B, 0, zero), (B, 1, zero), (B, 2, self.down_B)]
        conditions += [(C, 1, zero), (C, 2, zero), (D, 1, zero), (D, 2, self.down_D)]
        self.bcs = []
        for tag, component, value in conditions:
            W = V.sub(component)
            dofs = fem.locate_dofs_topological(W, 2, facet_tags.find(tag))
            self.bcs.append(fem.dirichletbc(value, dofs, W))

    def set_step(self, step):
        self.down_B.value = -0.1 * step / STEPS
        self.down_D.value = -0.12 * step / STEPS


# -

# ## Solve
#
# One line for the contact, one for the problem, one for each step. Everything nonlinear is solved
# in one Newton iteration: large deformation, material, the active set, stick and slip.
#
# Friction takes energy in each step, $\sum_j z_j \cdot \tilde u_{\tau j}$, and never gives any.


# +
def solve(friction, level, clock, show):
    """All load steps with one coefficient of friction.

    Args:
        friction: Coefficient.
        level: Refinement.
        clock: Tells the time left.
        show: Called after each step with its number, displacement and contact.

    Returns:
        What is written to results.json.
    """
    domain, cell_tags, facet_tags = two_shells(level)
    V = fem.functionspace(domain, dm.hex20(shape=(3,)))
    u, v = fem.Function(V, name="displacement"), ufl.TestFunction(V)
    dx = ufl.dx(domain=domain, subdomain_data=cell_tags, metadata={"quadrature_degree": 5})
    F = sum(ufl.derivative(energy(u, *MATERIAL[body]) * dx(body), u, v) for body in (UPPER, LOWER))
    supports = Supports(V, facet_tags)
    contact = dm.Contact(
        V,
        facet_tags,
        slave=SLAVE,
        master=MASTER,
        friction=friction,
        multiplier=options.multiplier,
    )
    problem = dm.ContactProblem(
        F, u, bcs=supports.bcs, interfaces=[contact], petsc_options_prefix="sliding_"
    )
    ndofs = 3 * V.dofmap.index_map.size_global
    say(f"Friction {friction:g}: {ndofs} displacements\n")

    forces = fem.form(F)
    ends = fem.locate_dofs_topological(V, 2, facet_tags.indices[np.isin(facet_tags.values, (B, D))])

    def reaction():
        """Force of the supports B and D on the upper body."""
        f = fem.assemble_vector(forces)
        f.scatter_reverse(la.InsertMode.add)
        mine = ends[ends < V.dofmap.index_map.size_local]
        return comm.allreduce(f.array.reshape(-1, 3)[mine].sum(axis=0))

    steps = []
    for step in range(1, options.stop + 1):
        supports.set_step(step)
        iterations = problem.solve()
        last = problem.history[-1]
        steps.append(
            {
                "step": step,
                "newton_iterations": iterations,
                "active": last["active"],
                "stick": last["stick"],
                "slip": last["slip"],
                "residuals": [h["residual"] for h in problem.history],
                "changes": [h["changes"] for h in problem.history],
                "contact_force": contact.force.tolist(),
                "reaction": reaction().tolist(),
                "dissipation": contact.dissipation,
            }
        )
        show(step, u, contact)
        force = steps[-1]["contact_force"]
        sets = f"{last['active']:4} active"
        if friction > 0:
            sets += f", {last['stick']:4} stick, {last['slip']:4} slip"
        say(
            f"step {step:2}  {iterations:2} iterations  {sets}  force "
            f"({force[0]:9.2e}, {force[1]:9.2e}, {force[2]:9.2e})  {clock(step)}"
        )
    return {"friction": friction, "ndofs": ndofs, "steps": steps}


# -

# ## Pictures
#
# Stages of the deformation, coloured by $u_z$ (Figure 6.8 of the paper); the tractions on the
# upper body, seen from below (Figure 6.9); and Newton's residuals in one step (Figure 6.10).
#
# The lower body is curved and no finer than the upper one, where nodal pressures show the master's
# kinks as spots. So the tractions are the recovered ones, averages around corners: on such masters
# they have a quarter to a ninth of the error of nodal values.

# +
STAGES = (20, 40, 60, 80)
VIEW = (0.55, -1.6, 0.55)


class Show:
    """Pictures of one run; paths of the files by stage."""

    def __init__(self, out, friction):
        self.out, self.name = out, f"friction_{friction:g}"
        (out / "frames").mkdir(parents=True, exist_ok=True)
        self.title = f"friction {friction:g}" if friction else "without friction"
        self.stages, self.frames, self.writer = {}, [], None

    def __call__(self, step, u, contact):
        if self.writer is None:
            self.writer = [
                Writer(self.out / f"{self.name}.bp", [u]),
                None,
            ]
        self.writer[0].write(step / STEPS)
        domain = u.function_space.mesh
        if step % 2 == 0 or step == 1:
            body = surface(domain, {"u": u}, displacement=u)
            path = self.out / "frames" / f"{self.name}_{step:02}.png"
            picture(
                path,
                [body],
                "u",
                component=2,
                label="u_z",
                clim=(-0.12, 0.0),
                view=VIEW,
                zoom=0.85,
                title=f"{self.title}, step {step}",
                size=(900, 800),
            )
            self.frames.append(path)
            if step in STAGES:
                self.stages[step] = path
        if step == options.stop:
            self.tractions(u, contact)
            self.writer[0].close()

    def tractions(self, u, contact):
        """Normal and tangential tractions at the end, recovered."""
        domain = u.function_space.mesh
        pressure = contact.recovered_pressure
        tangential = fem.Function(pressure.function_space, name="tangential")
        squares = np.sum(contact.recovered_traction.x.array.reshape(-1, 3) ** 2, axis=1)
        tangential.x.array[:] = np.sqrt(np.maximum(squares - pressure.x.array**2, 0))
        fields = {"pressure": pressure, "tangential": tangential}
        facets = contact.slave[0].tags.find(SLAVE)
        slave = surface(domain, fields, displacement=u, facets=facets)
        with Writer(self.out / f"{self.name}_tractions.bp", [contact.tangential_traction]) as file:
            file.write(1.0)
        self.patches = slave


def montage(path, rows):
    """Join pictures, a list of rows, into one."""
    from PIL import Image

    pictures = [[Image.open(name) for name in row] for row in rows]
    width, height = pictures[0][0].size
    sheet = Image.new("RGB", (width * max(map(len, pictures)), height * len(pictures)), "white")
    for i, row in enumerate(pictures):
        for j, part in enumerate(row):
            sheet.paste(part, (j * width, i * height))
    sheet.save(path)


def draw(out, runs, shows):
    """The pictures that compare runs; on rank 0."""
    if all(show.stages for show in shows):
        montage(out / "deformation.png", [list(show.stages.values()) for show in shows])
    # Same colours with and without friction
    fields = ("pressure", "tangential")
    highest = [
        max(np.max(np.abs(s.patches.faces.point_data[name])) for s in shows) for name in fields
    ]
    sheets = []
    for show in shows:
        row = []
        for name, top in zip(fields, highest):
            row.append(out / "frames" / f"{show.name}_{name}.png")
            picture(
                row[-1],
                [show.patches],
                name,
                label=f"{name}\ntraction" if name == "tangential" else name,
                clim=(0.0, top or 1.0),
                cmap="YlOrRd",
                view=(0.5, -1.0, -1.4),
                zoom=0.85,
                title=f"{show.title}, step {options.stop}",
                size=(1000, 700),
            )
        sheets.append(row)
    montage(out / "tractions.png", sheets)
    newton(out / "newton.png", runs, step=min(60, options.stop))
    pairs = []
    for k, frames in enumerate(zip(*(show.frames for show in shows))):
        pairs.append(out / "frames" / f"pair_{k:02}.png")
        montage(pairs[-1], [frames])
    gif(out / "motion.gif", pairs, 0.12)


def newton(path, runs, step):
    """Residual forces of each iteration of one step, relative to the first with the new loads."""
    import matplotlib

    matplotlib.use("Agg", force=False)
    import matplotlib.pyplot as plt

    fig, axis = plt.subplots(figsize=(6.4, 4.4))
    for run in runs:
        found = run["steps"][step - 1]
        # The prescribed displacements enter with the first iteration
        r = np.array(found["residuals"][1:])
        changes = np.array(found["changes"][1:])
        k = np.arange(1, len(r) + 1)
        name = f"friction {run['friction']:g}" if run["friction"] else "without friction"
        (line,) = axis.semilogy(k, r / r[0], marker="o", label=name)
        changed = changes > 0
        axis.plot(k[changed], (r / r[0])[changed], "o", mfc="white", color=line.get_color())
    axis.set(
        xlabel="Newton iteration",
        ylabel=r"$\|r_k\|_2 / \|r_1\|_2$",
        title=f"Load step {step} (hollow: active, stick or slip set changed)",
    )
    axis.xaxis.get_major_locator().set_params(integer=True)
    axis.grid(True, which="major", alpha=0.3)
    axis.legend()
    fig.tight_layout()
    fig.savefig(path, dpi=150)
    plt.close(fig)


# -

# ## Run


# +
def run(options):
    options.out.mkdir(parents=True, exist_ok=True)
    start = time.perf_counter()
    runs, shows = [], []

    def clock(step):
        """Time that is left if all steps take as long as those so far."""
        done = len(runs) * options.stop + step
        passed = time.perf_counter() - start
        left = passed / done * (len(options.friction) * options.stop - done)
        return f"{int(left) // 60}:{int(left) % 60:02} left"

    for friction in options.friction:
        shows.append(Show(options.out, friction))
        runs.append(solve(friction, options.level, clock, shows[-1]))
        report(runs[-1])
    if comm.rank == 0:
        (options.out / "results.json").write_text(json.dumps(runs, indent=1))
        draw(options.out, runs, shows)
    say(f"{time.perf_counter() - start:.0f} s in all, see {options.out}")


def report(run):
    """Iterations, balance of forces and energy of a run."""
    steps = run["steps"]
    iterations = [s["newton_iterations"] for s in steps]
    balance = [np.linalg.norm(np.add(s["contact_force"], s["reaction"])) for s in steps]
    force = max(np.linalg.norm(s["contact_force"]) for s in steps)
    lost = [s["dissipation"] for s in steps]
    say(
        f"\n{np.mean(iterations):.2f} Newton iterations per step, at most {max(iterations)}\n"
        f"supports carry the contact force to {max(balance) / max(force, 1e-300):.1e}\n"
        f"energy lost to friction {sum(lost):.3e}, in a step at least {min(lost):.1e}\n"
    )


if __name__ == "__main__":
    run(options)
