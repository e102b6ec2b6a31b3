# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A rubber foot dragged over a steel plate: stick, slip, and back
#
# A block of rubber is pressed onto a plate of steel and dragged over it, forth and back. At first
# the block shears, and most of it sticks to the plate. Slip enters from the edges, and the zone
# that sticks shrinks until all of it slides. When the motion turns round, the block sticks again.
#
# Statics knows the force without any computation. When everything slides in one direction, the
# traction is $\mu p$ everywhere, so the drag is $H = \mu N$ whatever the distribution of the
# pressure; before that it is less.
#
# Run it with `python3 demo_drag.py [--out DIR] [--level N]`, alone or under `mpirun`. Units are
# mm, N and MPa.

# +
import argparse
import json
import time
from pathlib import Path

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import ufl
from dolfinx import default_scalar_type, fem, la, mesh
from dolfinx_mortar.plotting import Writer, gif, picture, surface

comm = MPI.COMM_WORLD

parser = argparse.ArgumentParser(description="A rubber foot dragged over a steel plate")
parser.add_argument("--out", type=Path, default=Path("output/drag"), help="folder to write")
parser.add_argument("--level", type=int, default=1, help="refinement, from 0")
parser.add_argument("--friction", type=float, default=0.3, help="Coulomb's coefficient")
options = parser.parse_args() if __name__ == "__main__" else parser.parse_args([])


def say(text):
    if comm.rank == 0:
        print(text, flush=True)


# -

# ## Two meshes
#
# The block is made of hex20 cells, the plate of tet10 cells, each on a mesh of its own. Their nodes
# do not meet, and the block slides over the edges of the plate's triangles. Its sides lean outwards
# like those of a machine's foot, which keeps the trailing edge from lifting off.

# +
BLOCK = (20.0, 14.0, 6.0)  # length, width, height
TAPER = np.array([0.2, 0.1])  # how much longer and wider it is at its top
PLATE = (40.0, 24.0, 4.0)
PLATE_LEFT = -17.0
CONTACT, HELD = 1, 2


def box(low, size, cells, cell_type, contact, held):
    """A box with tagged facets.

    Args:
        low: Its lowest corner.
        size: Lengths of its sides.
        cells: Cells in each direction.
        cell_type: Hexahedra or tetrahedra.
        contact, held: Heights z of the facets to be tagged so.

    Returns:
        Mesh and tags of its facets.
    """
    low = np.array(low)
    domain = mesh.create_box(
        comm, [low, low + size], cells, cell_type=cell_type, ghost_mode=mesh.GhostMode.none
    )
    domain.topology.create_connectivity(2, 3)
    facets = [
        mesh.locate_entities_boundary(domain, 2, lambda x, z=z: np.isclose(x[2], z))
        for z in (contact, held)
    ]
    values = np.repeat(np.int32([CONTACT, HELD]), [len(f) for f in facets])
    facets = np.concatenate(facets)
    order = np.argsort(facets)
    return domain, mesh.meshtags(domain, 2, facets[order], values[order])


def foot(cells):
    """The block, touching the plane z = 0."""
    low = (-BLOCK[0] / 2, -BLOCK[1] / 2, 0.0)
    domain, tags = box(low, BLOCK, cells, mesh.CellType.hexahedron, 0.0, BLOCK[2])
    x = domain.geometry.x
    x[:, :2] *= 1 + TAPER * x[:, 2:] / BLOCK[2]
    return domain, tags


def ground(cells):
    """The plate under it."""
    low = (PLATE_LEFT, -PLATE[1] / 2, -PLATE[2])
    return box(low, PLATE, cells, mesh.CellType.tetrahedron, 0.0, -PLATE[2])


def meshes(level):
    """Block and plate, each with tags of its facets."""
    if level < 1:
        return foot((4, 3, 1)), ground((4, 3, 1))
    n = 2 ** (level - 1)
    return foot((8 * n, 6 * n, 2 * n)), ground((7 * n, 5 * n, n))


# -

# ## Materials
#
# The rubber is neo-Hookean, $\Psi = G/2\,(I_1 - 3) - G \ln J + \lambda/2\,(\ln J)^2$. The steel is
# 70000 times stiffer, so the plate stays plane to about $10^{-6}$, which makes $H = \mu N$ a sharp
# test; on a soft plate the block would have to climb out of its own dent as well. Steel strains so
# little that $\Psi = G\,E : E + \lambda/2\,(\operatorname{tr} E)^2$ will do. Made from $\nabla u$,
# $E$ is free of the round-off of $F - 1$.

# +
RUBBER, STEEL = (3.0, 0.4), (210e3, 0.3)  # E, nu


def lame(E, nu):
    return E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))


def rubber(u):
    G, lmbda = lame(*RUBBER)
    F = ufl.Identity(3) + ufl.grad(u)
    J = ufl.det(F)
    return G / 2 * (ufl.inner(F, F) - 3) - G * ufl.ln(J) + lmbda / 2 * ufl.ln(J) ** 2


def steel(u):
    G, lmbda = lame(*STEEL)
    H = ufl.grad(u)
    E = (H + H.T + H.T * H) / 2
    return G * ufl.inner(E, E) + lmbda / 2 * ufl.tr(E) ** 2


# -

# ## Motion
#
# The plate's bottom is held. The block's top is glued to a stamp that goes down first, then to the
# right, to the left, and to the right again. Short steps follow the shrinking of the zone that
# sticks; once all slides, long ones do.


# +
def motion(short=(9, 10, 10), long=(4, 4, 4)):
    """Where the stamp is after each step.

    Args:
        short: Number of short steps of each drag, while stick turns into slip.
        long: Number of steps of length 1.5 of each drag.

    Returns:
        Coordinates (x, z), shape (steps, 2), and the number of the last step of each part.
    """
    parts = [[(0.0, -0.2)] * 3]
    for way, n, m in zip((1.35, -2.0, 2.0), short, long):
        parts.append([(way / n, 0.0)] * n + [(np.copysign(1.5, way), 0.0)] * m)
    return np.cumsum(np.concatenate(parts), axis=0), np.cumsum([len(p) for p in parts])


# -

# ## Solve
#
# One `Contact`, one `ContactProblem`, and one `solve()` for each step: large deformation, contact,
# stick and slip are found in one Newton iteration.


# +
class Drag:
    """Block and plate, at rest.

    Args:
        level: Refinement.
        friction: Coulomb's coefficient.
    """

    def __init__(self, level, friction):
        self.domains, self.tags = zip(*meshes(level))
        block, plate = self.domains
        self.spaces = (
            fem.functionspace(block, dm.hex20(shape=(3,))),
            fem.functionspace(plate, ("Lagrange", 2, (3,))),
        )
        self.u = [fem.Function(V, name="displacement") for V in self.spaces]
        energies = [
            energy(u) * ufl.dx(domain=domain, metadata={"quadrature_degree": 5})
            for energy, u, domain in zip((rubber, steel), self.u, self.domains)
        ]
        forces = [ufl.derivative(e, u) for e, u in zip(energies, self.u)]
        self.stamp, rest = (
            fem.Constant(domain, default_scalar_type((0, 0, 0))) for domain in self.domains
        )
        held = [
            fem.locate_dofs_topological(V, 2, t.find(HELD)) for V, t in zip(self.spaces, self.tags)
        ]
        bcs = [
            fem.dirichletbc(value, dofs, V)
            for value, dofs, V in zip((self.stamp, rest), held, self.spaces)
        ]
        self.contact = dm.Contact(
            self.spaces, self.tags, slave=CONTACT, master=CONTACT, friction=friction
        )
        self.problem = dm.ContactProblem(
            forces,
            self.u,
            bcs=bcs,
            interfaces=[self.contact],
            petsc_options_prefix="drag_",
            petsc_options={"snes_rtol": 1e-10},
        )

        self.ndofs = 3 * sum(V.dofmap.index_map.size_global for V in self.spaces)
        self._energies = [fem.form(e) for e in energies]
        self._forces = fem.form(forces[0])
        owned = self.spaces[0].dofmap.index_map.size_local
        nodes = fem.locate_dofs_topological(self.spaces[0], 2, self.tags[0].find(CONTACT))
        self._top, self._nodes = held[0][held[0] < owned], nodes[nodes < owned]

    def stored(self):
        """Elastic energy of both bodies."""
        return comm.allreduce(sum(fem.assemble_scalar(e) for e in self._energies))

    def reaction(self):
        """Force of the stamp on the block, from the stresses in the block."""
        f = fem.assemble_vector(self._forces)
        f.scatter_reverse(la.InsertMode.add)
        return comm.allreduce(f.array.reshape(-1, 3)[self._top].sum(axis=0))

    def nodes(self):
        """Nodes of the block's bottom: position, pressure, tangential traction, state, slip."""
        c = self.contact

        def nodal(function, shape=()):
            return function.x.array.reshape(-1, *shape)[self._nodes]

        x = self.spaces[0].tabulate_dof_coordinates()[self._nodes] + nodal(self.u[0], (3,))
        traction, slip = nodal(c.tangential_traction, (3,)), nodal(c.slip, (3,))
        own = [x, nodal(c.pressure), traction, nodal(c.status), slip]
        return [np.concatenate(part) for part in zip(*comm.allgather(own))]


# -

# ## Checks of each step
#
# * All tractions are inside of the cone, $|t_\tau| \le \mu p$, and no node slips along with its
#   traction.
# * The stamp carries what contact carries.
# * Friction only takes energy; and the stamp's work is what is stored and what friction took.
#   The work is summed up with the trapezoidal rule and friction with the tractions at the end of
#   each step, so they differ by an error that goes to zero with the length of the steps.


# +
def drag(level, friction, path, show=None):
    """All steps.

    Args:
        level: Refinement.
        friction: Coulomb's coefficient.
        path: Positions (x, z) of the stamp.
        show: Called after each step with the problem, the results so far and the nodes.

    Returns:
        What is written to results.json.
    """
    model = Drag(level, friction)
    contact, problem = model.contact, model.problem
    results = {"friction": friction, "ndofs": model.ndofs, "steps": []}
    say(f"{model.ndofs} displacements\n")
    say("step   x [mm]  Newton  stick  slip    N [N]    H [N]   H/(mu N)")
    old, slip, work, lost = np.zeros(3), None, 0.0, 0.0
    start = time.perf_counter()
    for step, (x, z) in enumerate(path, 1):
        moved = np.array([x, 0.0, z]) - model.stamp.value
        model.stamp.value[:] = x, 0.0, z
        iterations = problem.solve()

        last, force, reaction = problem.history[-1], contact.force, model.reaction()
        nodes = model.nodes()
        _, p, t, state, total = nodes
        touching = p > 0
        cone = np.linalg.norm(t[touching], axis=1) / (friction * p[touching]) - 1
        # Slip is counted from the moment a node comes into contact
        along = np.sum(t * (total - (0 if slip is None else slip)), axis=1)[state > 0]
        slip = total
        work += 0.5 * (old + reaction) @ moved
        old = reaction
        lost += contact.dissipation
        r = {
            "step": step,
            "displacement": x,
            "newton_iterations": iterations,
            "active": last["active"],
            "stick": last["stick"],
            "slip": last["slip"],
            "normal_force": force[2],
            "drag_force": -force[0],
            "ratio": -force[0] / (friction * force[2]),
            "dissipation": contact.dissipation,
            "residuals": [h["force"] for h in problem.history],
            "changes": [h["changes"] for h in problem.history],
            "outside_cone": float(cone.max(initial=-1.0)),
            "along_traction": float(along.max(initial=0.0)),
            "balance": float(np.abs(force + reaction).max() / np.abs(force).max()),
            "work": work,
            "stored": model.stored(),
            "lost": lost,
        }
        results["steps"].append(r)
        if show is not None:
            show(model, results, nodes)
        left = (time.perf_counter() - start) / step * (len(path) - step)
        say(
            f"{step:4} {x:8.2f} {iterations:7} {r['stick']:6} {r['slip']:5} "
            f"{r['normal_force']:8.2f} {r['drag_force']:8.2f} {r['ratio']:10.6f}"
            f"   {int(left) // 60}:{int(left) % 60:02} left"
        )
    return results


# -

# ## Pictures
#
# The film shows the bodies, the contact surface as seen from above, and the drag. On the surface
# each point has the colour of its nearest node's state.

# +
STATES = {"opens": "#d9d9d9", "sticks": "#2c6fad", "slides": "#f28e2b"}


def pyplot():
    import matplotlib

    matplotlib.use("Agg", force=False)
    import matplotlib.pyplot as plt

    return plt


class Show:
    """Writes files and keeps what the pictures need.

    Args:
        out: Folder.
        steps: Number of steps.
        stages: Steps to show in the picture of the zones.
    """

    def __init__(self, out, steps, stages):
        (out / "frames").mkdir(parents=True, exist_ok=True)
        self.out, self.last, self.chosen = out, steps, stages
        self.stages, self.frames, self.files = [], [], []

    def __call__(self, model, results, nodes):
        r = results["steps"][-1]
        if not self.files:
            self.traction = fem.Function(model.spaces[0], name="traction")
            self.lag = [fem.Function(V) for V in model.spaces]
            written = {"block": model.u[0], "plate": model.u[1], "traction": self.traction}
            self.files = [Writer(self.out / f"{name}.bp", [f]) for name, f in written.items()]
            self.plate = surface(model.domains[1], facets=model.tags[1].find(CONTACT))
        self.traction.x.array[:] = model.contact.traction.x.array
        for file in self.files:
            file.write(r["step"])
            if r["step"] == self.last:
                file.close()
        patch = surface(
            model.domains[0],
            displacement=model.u[0],
            facets=model.tags[0].find(CONTACT),
            subdivisions=8,
        )
        # How far the block is behind the stamp
        self.lag[0].x.array[:] = model.u[0].x.array
        self.lag[0].x.array[0::3] -= r["displacement"]
        bodies = [
            surface(u.function_space.mesh, {"lag": lag}, displacement=u)
            for u, lag in zip(model.u, self.lag)
        ]
        if comm.rank == 0:
            zones = Zones(patch, nodes, r)
            if r["step"] in self.chosen:
                self.stages.append(zones)
            self.film(bodies, zones, results["steps"])

    def film(self, bodies, zones, steps):
        """One picture of the film, on rank 0."""
        plt = pyplot()
        r = steps[-1]
        view = self.out / "frames" / "view.png"
        picture(
            view,
            bodies,
            "lag",
            component=0,
            label="lag [mm]",
            clim=(-1.2, 1.2),
            cmap="RdBu",
            view=(0.35, -1.5, 0.8),
            zoom=1.12,
            size=(1200, 640),
        )
        fig = plt.figure(figsize=(14.4, 5.2), dpi=75)
        axis = fig.add_axes((0.0, 0.0, 0.62, 0.94))
        if view.exists():
            axis.imshow(plt.imread(view))
        axis.axis("off")
        doing = "pressing" if r["displacement"] == 0 else "dragging"
        fig.text(
            0.29, 0.91, f"step {r['step']}, {doing}: $x$ = {r['displacement']:.2f} mm",
            fontsize=17, ha="center",
        )  # fmt: skip
        axis = fig.add_axes((0.66, 0.52, 0.33, 0.4))
        draw_lines(axis, lines_of(self.plate), color="0.75", linewidths=0.7, zorder=0)
        zones.draw_states(axis)
        axis.set(xlim=(-17.5, 23.5), ylim=(-12.5, 12.5), xticks=[], yticks=[])
        legend(axis, loc="lower center", bbox_to_anchor=(0.5, 0.98), fontsize=13)
        axis = fig.add_axes((0.685, 0.12, 0.3, 0.34))
        loop(axis, steps, "ratio")
        axis.plot(r["displacement"], r["ratio"], "o", color="black", markersize=9, zorder=5)
        axis.set(xlim=(-1.3, 8.0), ylim=(-1.2, 1.2))
        axis.set_xlabel("displacement $x$ [mm]", fontsize=12)
        axis.set_ylabel(r"drag $H\,/\,(\mu N)$", fontsize=12)
        self.frames.append(self.out / "frames" / f"step_{r['step']:03}.png")
        fig.savefig(self.frames[-1])
        plt.close(fig)
        view.unlink(missing_ok=True)


def lines_of(part):
    """Edges of cells on a surface, seen from above: shape (edges, points, 2)."""
    lines = part.edges.lines.reshape(-1, part.edges.lines[0] + 1)[:, 1:]
    return np.asarray(part.edges.points)[lines][:, :, :2]


def draw_lines(axis, lines, **style):
    from matplotlib.collections import LineCollection

    axis.add_collection(LineCollection(lines, **style))
    axis.set_aspect("equal")


def legend(axis, **where):
    from matplotlib.patches import Patch

    axis.legend(
        handles=[Patch(color=STATES[name], label=name) for name in ("sticks", "slides")],
        ncols=2,
        frameon=False,
        handlelength=1.2,
        **where,
    )


class Zones:
    """The block's bottom after a step, seen from above; on rank 0."""

    def __init__(self, patch, nodes, result):
        self.result, self.lines = result, lines_of(patch)
        self.nodes, self.traction, state = nodes[0][:, :2], nodes[2][:, :2], nodes[3]
        self.points = np.asarray(patch.faces.points)[:, :2]
        self.triangles = patch.faces.faces.reshape(-1, 4)[:, 1:]
        centres = self.points[self.triangles].mean(axis=1)
        distance = np.linalg.norm(centres[:, None] - self.nodes, axis=2)
        self.state = state[distance.argmin(axis=1)]

    def move(self, x):
        """Show it at another place."""
        for points in (self.points, self.lines, self.nodes):
            points[..., 0] += x

    def draw_states(self, axis):
        from matplotlib.colors import ListedColormap

        axis.tripcolor(
            *self.points.T,
            self.triangles,
            facecolors=self.state,
            cmap=ListedColormap(list(STATES.values())),
            vmin=-0.5,
            vmax=2.5,
        )
        draw_lines(axis, self.lines, color="black", linewidths=0.4, alpha=0.5)

    def draw_traction(self, axis, top):
        size = np.linalg.norm(self.traction, axis=1)
        # Multipliers of dual functions are averages around nodes: linear between them
        drawn = axis.tripcolor(
            *self.nodes.T, size, shading="gouraud", cmap="magma_r", vmin=0, vmax=top
        )
        # All arrows of one length: they show directions, colours show sizes
        arrows = self.traction / np.maximum(size, 1e-6)[:, None]
        axis.quiver(
            *self.nodes.T, *arrows.T, color="white", edgecolor="black", linewidth=0.4,
            angles="xy", scale=20, width=0.007, pivot="mid",
        )  # fmt: skip
        axis.set_aspect("equal")
        return drawn


def loop(axis, steps, key):
    """A quantity over the displacement, each way in its own colour."""
    x = np.array([s["displacement"] for s in steps])
    y = np.array([s[key] for s in steps])
    way = np.sign(np.diff(x))
    turns = [k for k in range(1, len(way)) if way[k] * way[k - 1] < 0]
    ends = [0, *turns, len(x) - 1]
    for k, name in enumerate(("to the right", "to the left", "to the right again")):
        if k + 1 < len(ends):
            part = slice(ends[k], ends[k + 1] + 1)
            axis.plot(x[part], y[part], "o-", label=name, markersize=4.5, zorder=4 - k)
    if key == "ratio":
        for value in (-1, 1):
            axis.axhline(value, color="0.4", linestyle="--", linewidth=1.2, zorder=1)
    axis.grid(alpha=0.25)


def draw(out, results, show):
    """The pictures of the whole; on rank 0."""
    plt = pyplot()
    steps = results["steps"]
    fig, axes = plt.subplots(
        2, 1, figsize=(8.4, 7.2), sharex=True, height_ratios=(2.2, 1), layout="constrained"
    )
    loop(axes[0], steps, "ratio")
    axes[0].legend(fontsize=13, loc="center", bbox_to_anchor=(0.55, 0.5), frameon=False)
    axes[0].set_ylim(-1.25, 1.25)
    for value, sign in ((1.06, ""), (-1.17, "-")):
        axes[0].text(
            0.5, value, rf"statics: $H = {sign}\mu N$", color="0.3", ha="center", fontsize=12,
            transform=axes[0].get_yaxis_transform(),
        )  # fmt: skip
    axes[0].set_ylabel(r"drag $H\,/\,(\mu N)$", fontsize=13)
    axes[0].set_title("A rubber foot dragged over steel, forth and back", fontsize=14)
    loop(axes[1], [{**s, "share": 100 * s["stick"] / max(s["active"], 1)} for s in steps], "share")
    axes[1].set_ylim(-6, 106)
    axes[1].set_xlabel("displacement of the stamp $x$ [mm]", fontsize=13)
    axes[1].set_ylabel("nodes that stick [%]", fontsize=13)
    fig.savefig(out / "hysteresis.png", dpi=150)
    plt.close(fig)

    top = np.percentile(np.concatenate([np.abs(z.traction[:, 0]) for z in show.stages]), 98)
    count = len(show.stages)
    fig = plt.figure(figsize=(3.9 * count + 1.4, 6.0), layout="constrained")
    grid = fig.add_gridspec(2, count + 1, width_ratios=[1] * count + [0.06])
    axes = grid[:, :count].subgridspec(2, count).subplots(sharex=True, sharey=True, squeeze=False)
    for k, zones in enumerate(show.stages):
        r = zones.result
        zones.move(-r["displacement"])
        zones.draw_states(axes[0, k])
        drawn = zones.draw_traction(axes[1, k], top)
        axes[0, k].set_title(
            f"$x = {r['displacement']:.2f}$ mm, $H = {r['ratio']:.2f}\\,\\mu N$", fontsize=15
        )
        axes[1, k].set_xlabel("from the stamp's middle [mm]", fontsize=12)
    for axis in axes[:, 0]:
        axis.set_ylabel("across [mm]", fontsize=12)
    legend(axes[0, 0], loc="lower left", bbox_to_anchor=(-0.04, -0.2), fontsize=14)
    bar = fig.colorbar(drawn, cax=fig.add_subplot(grid[1, count]), extend="max")
    bar.set_label("tangential traction [MPa]", fontsize=12)
    fig.savefig(out / "zones.png", dpi=110)
    plt.close(fig)
    gif(out / "motion.gif", show.frames, 0.25)


# -

# ## Run


# +
def report(results, ends):
    """What statics says of the ends of the drags, and the checks of all steps; on rank 0."""
    steps = results["steps"]
    say("\nEnds of the drags, where everything slides:\n")
    say("step   x [mm]     N [N]     H [N]   |H|/(mu N) - 1")
    for end in ends[1:]:
        r = steps[end - 1]
        say(
            f"{r['step']:4} {r['displacement']:8.2f} {r['normal_force']:9.3f} "
            f"{r['drag_force']:9.3f} {abs(r['ratio']) - 1:16.1e}"
        )
    iterations = [s["newton_iterations"] for s in steps]
    most = max(abs(s["ratio"]) for s in steps if s["stick"] > 0)
    energy = abs(steps[-1]["work"] - steps[-1]["stored"] - steps[-1]["lost"]) / steps[-1]["work"]
    say(
        f"\nwhile some nodes stick |H| is at most {most:.4f} mu N\n"
        f"{np.mean(iterations):.2f} Newton iterations per step, at most {max(iterations)}\n"
        f"tractions leave the cone by at most {max(s['outside_cone'] for s in steps):.1e}, "
        f"slip along the traction {max(s['along_traction'] for s in steps):.1e}\n"
        f"the stamp carries the contact force to {max(s['balance'] for s in steps):.1e}\n"
        f"friction took {steps[-1]['lost']:.1f} mJ, in a step at least "
        f"{min(s['dissipation'] for s in steps):.1e}; work and energy differ by {energy:.1e}"
    )


def run(options):
    start = time.perf_counter()
    options.out.mkdir(parents=True, exist_ok=True)
    path, ends = motion()
    turn = ends[1]
    show = Show(options.out, len(path), (ends[0] + 2, ends[0] + 5, turn, turn + 7))
    results = drag(options.level, options.friction, path, show)
    report(results, ends)
    if comm.rank == 0:
        (options.out / "results.json").write_text(json.dumps(results, indent=1))
        draw(options.out, results, show)
    say(f"\n{time.perf_counter() - start:.0f} s in all, see {options.out}")


if __name__ == "__main__":
    run(options)
