# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A bolted lap joint: tighten, pull, slip
#
# Two steel plates overlap; a bolt through a wider hole in the upper one, and in the thread of the
# lower one, presses them together. Friction carries what pulls at the plates until it cannot: then
# the upper plate slips below the bolt's head and over the lower plate, until the wall of its hole
# meets the shank.
#
# The bolt is *tied* into its thread. It is tightened by an *offset* at the head: the gap there is
# said to be smaller than it is, as if the shank were shorter. Three contacts, a tie and all bodies
# are in one mesh.
#
# Run it with `python3 demo_bolt.py [--out DIR] [--level N]`, alone or under `mpirun`.

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
from dolfinx_mortar.plotting import Writer, picture, surface

try:
    from dolfinx.io import gmsh as gmsh_reader
except ImportError:  # DOLFINx 0.9
    from dolfinx.io import gmshio as gmsh_reader

comm = MPI.COMM_WORLD

parser = argparse.ArgumentParser(description="A bolted lap joint, tightened and pulled")
parser.add_argument("--out", type=Path, default=Path("output/bolt"), help="folder to write")
parser.add_argument("--level", type=int, default=1, help="refinement, from 0")
parser.add_argument("--friction", type=float, default=0.2, help="coefficient of friction, not zero")
options = parser.parse_args() if __name__ == "__main__" else parser.parse_args([])


def say(text):
    if comm.rank == 0:
        print(text, flush=True)


# -

# ## The joint
#
# Millimetres, newtons, megapascals. The plane $y = 0$, through the axis of the bolt and in the
# direction of the pull, is one of symmetry: half of the joint is meshed, by gmsh with curved
# tetrahedra of second order. Forces in tables are those of the whole joint.

# +
SHANK, HOLE, HEAD = 5.0, 5.06, 8.5  # radii
UPPER, LOWER, CAP = 8.0, 12.0, 6.0  # thickness of the plates, height of the head
WIDTH, OVERLAP, LENGTH = 15.0, 20.0, 40.0  # half width; from the axis to the ends of the plates
E, NU = 210e3, 0.3
PRELOAD = 30e3
# Displacements of the pulled end
PATH = (0.006, 0.012, 0.018, 0.03, 0.042, 0.054, 0.066, 0.08, 0.095, 0.12, 0.14)

# Tags of facets
(BELOW_HEAD, UPPER_TOP, UPPER_BOTTOM, LOWER_TOP, THREAD, THREADED_HOLE, SHANK_WALL, HOLE_WALL) = (
    range(1, 9)
)
PULLED, HELD, SYMMETRY = 9, 10, 11
BOLT, ABOVE, UNDER = 1, 2, 3  # tags of cells


def joint(size):
    """Mesh of the half, tags of its cells (bodies) and of its facets.

    Args:
        size: Size of the cells at the bolt.
    """
    model = None
    if comm.rank == 0:
        import gmsh

        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        model = gmsh.model
        occ = model.occ

        def cylinder(radius, low, height):
            return occ.addCylinder(0, 0, low, 0, 0, height, radius, angle=np.pi)

        parts = [
            cylinder(SHANK, -LOWER, LOWER),
            cylinder(SHANK, 0, UPPER),
            cylinder(HEAD, UPPER, CAP),
        ]
        bolt, _ = occ.fragment([(3, parts[0])], [(3, part) for part in parts[1:]])
        upper = occ.addBox(-OVERLAP, 0, 0, OVERLAP + LENGTH, WIDTH, UPPER)
        lower = occ.addBox(-LENGTH, 0, -LOWER, OVERLAP + LENGTH, WIDTH, LOWER)
        occ.cut([(3, upper)], [(3, cylinder(HOLE, 0, UPPER))])
        occ.cut([(3, lower)], [(3, cylinder(SHANK, -LOWER, LOWER))])
        occ.synchronize()
        for tag, faces in faces_by_place(model, [tag for _, tag in bolt], upper, lower).items():
            model.addPhysicalGroup(2, faces, tag)
        for tag, volumes in ((BOLT, [v for _, v in bolt]), (ABOVE, [upper]), (UNDER, [lower])):
            model.addPhysicalGroup(3, volumes, tag)
        # Larger cells away from the bolt
        field = model.mesh.field
        field.add("MathEval", 1)
        away = f"(Sqrt(x^2+y^2)-{HEAD + 1})"
        field.setString(1, "F", f"{size}*(1+0.2*({away}+Fabs({away}))/2)")
        field.setAsBackgroundMesh(1)
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
        model.mesh.generate(3)
        model.mesh.setOrder(2)
    domain, cells, tags = gmsh_reader.model_to_mesh(model, comm, 0, gdim=3)[:3]
    if comm.rank == 0:
        gmsh.finalize()
    return domain, cells, tags


def faces_by_place(model, bolt, upper, lower):
    """Faces of the model by tag: where they are, and to which body they belong."""

    def faces(volumes):
        boundary = model.getBoundary([(3, v) for v in volumes], combined=True, oriented=False)
        for _, face in boundary:
            yield face, *np.array(model.getBoundingBox(2, face)).reshape(2, 3)

    groups = {tag: [] for tag in range(1, 12)}

    def flat(low, high, axis, at):
        return abs(low[axis] - at) < 1e-3 and abs(high[axis] - at) < 1e-3

    def round_wall(low, high):
        return high[0] < (SHANK + HEAD) / 2 and np.min(high - low) > 1e-3

    for face, low, high in faces(bolt):
        if flat(low, high, 1, 0):
            groups[SYMMETRY].append(face)
        elif flat(low, high, 2, UPPER):
            groups[BELOW_HEAD].append(face)
        elif round_wall(low, high):
            groups[THREAD if low[2] < -1 else SHANK_WALL].append(face)
    plates = (
        (upper, {UPPER_TOP: UPPER, UPPER_BOTTOM: 0}, HOLE_WALL, PULLED, LENGTH),
        (lower, {LOWER_TOP: 0}, THREADED_HOLE, HELD, -LENGTH),
    )
    for plate, heights, wall, far, end in plates:
        for face, low, high in faces([plate]):
            if flat(low, high, 1, 0):
                groups[SYMMETRY].append(face)
            elif flat(low, high, 0, end):
                groups[far].append(face)
            elif round_wall(low, high):
                groups[wall].append(face)
            for tag, height in heights.items():
                if flat(low, high, 2, height):
                    groups[tag].append(face)
    return groups


# -

# ## The problem
#
# The far end of the lower plate is held, that of the upper one is moved along the joint and guided
# across. Strains are small, so the material is linear; contact is that of the deformed bodies.
# Slaves are chosen such that no node belongs to two of them, since it would carry no multiplier.


# +
def stress(u):
    lmbda, mu = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
    eps = ufl.sym(ufl.grad(u))
    return 2 * mu * eps + lmbda * ufl.tr(eps) * ufl.Identity(3)


class Joint:
    """The problem, with names for what is changed and what is asked."""

    def __init__(self, size, friction):
        """Take the size of the cells at the bolt, and the coefficient of friction."""
        domain, self.bodies, tags = joint(size)
        V = fem.functionspace(domain, ("Lagrange", 2, (3,)))
        self.u = fem.Function(V, name="displacement")
        F = ufl.inner(stress(self.u), ufl.grad(ufl.TestFunction(V)))
        self.pull = fem.Constant(domain, default_scalar_type(0))
        zero = fem.Constant(domain, default_scalar_type(0))

        def fix(component, tag, value=zero):
            W = V.sub(component)
            return fem.dirichletbc(value, fem.locate_dofs_topological(W, 2, tags.find(tag)), W)

        self.end = fix(0, PULLED, self.pull)
        bcs = [self.end, fix(2, PULLED), fix(1, SYMMETRY), *(fix(c, HELD) for c in range(3))]
        self.head = dm.Contact(
            V, tags, slave=BELOW_HEAD, master=UPPER_TOP, friction=friction, offset=0.0
        )
        self.plates = dm.Contact(V, tags, slave=LOWER_TOP, master=UPPER_BOTTOM, friction=friction)
        self.wall = dm.Contact(V, tags, slave=HOLE_WALL, master=SHANK_WALL)
        thread = dm.Tie(V, tags, slave=THREAD, master=THREADED_HOLE)
        self.problem = dm.ContactProblem(
            F * ufl.dx(metadata={"quadrature_degree": 4}),
            self.u,
            bcs=bcs,
            interfaces=[self.head, self.plates, self.wall, thread],
            petsc_options_prefix="bolt_",
        )

    def tighten(self, preload, tolerance=1e-3):
        """Shorten the shank until the head presses with the preload; the force then.

        The force grows nearly in proportion to the offset.
        """
        offset = -0.02
        for _ in range(6):
            self.head.offset = offset
            self.problem.solve()
            force = 2 * self.head.force[2]
            say(f"offset {offset:8.5f} mm: the bolt pulls with {force:8.1f} N")
            if abs(force / preload - 1) < tolerance:
                break
            offset *= preload / force
        return force


# -

# ## Pull
#
# Tightening spreads the plates, and since their ends are held the pull begins below zero. At first
# the joint is as stiff as one piece. The plates slip over each other when the friction between them
# is used up, $\mu N_\mathrm{plates}$. Below the head the plate sticks for longer: it takes the head
# along and bends the shank, which is softer. When all slips, equilibrium of the upper plate says
#
# $$F = \mu (N_\mathrm{plates} + N_\mathrm{head}),$$
#
# about $2 \mu N_0$ with the preload $N_0$: the pull is eccentric, and the guide at its end holds
# the upper plate up, so that it presses less on the lower one than the head on it. Then the wall
# of the hole meets the shank, and the force grows again.


# +
def measure(j):
    """One state of the joint; forces on the upper plate are those of the whole joint."""
    head, plates, wall = (c.summary() for c in (j.head, j.plates, j.wall))
    pull = 2 * j.problem.reaction(j.end)[0]
    friction = {"plates": 2 * plates["force"][0], "head": 2 * head["force"][0]}
    normal = {"plates": -2 * plates["force"][2], "head": 2 * head["force"][2]}
    bearing = 0.0 - 2 * wall["force"][0]
    return {
        "displacement": float(j.pull.value),
        "pull": float(pull),
        "friction": friction,
        "normal": normal,
        "bearing": float(bearing),
        "balance": float(pull - friction["plates"] - friction["head"] - bearing),
        "used": sum(friction.values()) / (j.head.friction * sum(normal.values())),
        "stick": {"plates": plates["stick"], "head": head["stick"]},
        "slip": {"plates": plates["slip"], "head": head["slip"]},
        "newton_iterations": len(j.problem.history) - 1,
    }


def pull(j, path):
    """Pull along a path of displacements; yield what is measured after each step.

    Args:
        j: The tightened joint.
        path: Displacements of the end [mm].
    """
    times = np.linspace(0, 1, len(path) + 1)

    def load(t):
        j.pull.value = np.interp(t, times, [0.0, *path])

    for _ in j.problem.steps(len(path), load):
        yield measure(j)


def slip_load(j, states):
    """Pull when all has slipped, and the shank is not yet reached: measured, and by equilibrium.

    Returns:
        The pull, and the coefficient of friction times the normal forces; None where no state is
        of this kind.
    """
    slipping = [s for s in states if not any(s["stick"].values()) and s["bearing"] == 0]
    if not slipping:
        return None
    last = slipping[-1]
    return last["pull"], j.head.friction * sum(last["normal"].values())


def run(options):
    options.out.mkdir(parents=True, exist_ok=True)
    start = time.perf_counter()
    j = Joint(3.6 / 1.3**options.level, options.friction)
    say(f"tet10, {3 * j.u.function_space.dofmap.index_map.size_global} dofs")
    preload = j.tighten(PRELOAD)
    say("\nTightened. Contacts of the half: head, plates, wall of the hole\n" + j.problem.report())
    states = [measure(j)]
    say("")
    with Writer(options.out / "bolt.bp", [j.u, j.plates.traction, j.head.traction]) as file:
        file.write(0.0)
        for state in pull(j, PATH):
            states.append(state)
            file.write(state["displacement"])
    say("\nPulled\n" + j.problem.report() + "\n")
    table(states)
    found = slip_load(j, states)
    if found is not None:
        say(f"\nThe joint slips at {found[0]:.0f} N; by equilibrium at {found[1]:.0f} N,")
        say(f"with the normal forces before the pull at {2 * options.friction * preload:.0f} N")
    draw(options.out / "joint.png", j)
    if comm.rank == 0:
        results = {"preload": preload, "seconds": time.perf_counter() - start, "states": states}
        (options.out / "results.json").write_text(json.dumps(results, indent=1))
        curve(options.out / "curve.png", states, options.friction * preload)
    say(f"\nWritten to {options.out} after {time.perf_counter() - start:.0f} s")


def table(states):
    say("displacement   force [N]      plates        head     bearing  friction   nodes that stick")
    say("        [mm]                                                       used      plates  head")
    for s in states:
        say(
            f"{s['displacement']:12.4f} {s['pull']:11.1f} {s['friction']['plates']:11.1f} "
            f"{s['friction']['head']:11.1f} {s['bearing']:11.1f} {s['used']:9.4f} "
            f"{s['stick']['plates']:11} {s['stick']['head']:5}"
        )


# -

# ## Show
#
# The joint cut through the axis of the bolt, after the pull, and the force over the displacement.
# Where displacements are enlarged, so must be the clearance of the hole, and the shank is drawn
# as short as the offset makes it.


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


def draw(path, j, factor=10):
    V = j.u.function_space
    shown = fem.Function(V)
    x, moved = V.tabulate_dof_coordinates(), factor * j.u.x.array.reshape(-1, 3)
    above, bolt = (np.unique(V.dofmap.list[j.bodies.find(body)]) for body in (ABOVE, BOLT))
    r = np.hypot(x[above, 0], x[above, 1])[:, None]
    wider = (factor - 1) * (HOLE - SHANK) * np.clip((HEAD - r) / (HEAD - HOLE), 0, 1)
    moved[above, :2] += wider * x[above, :2] / r
    moved[bolt, 2] += factor * j.head.offset * np.clip(x[bolt, 2] / UPPER, 0, 1)
    shown.x.array[:] = moved.ravel()
    body = surface(V.mesh, {"stress": von_mises(j.u)}, displacement=shown)
    picture(
        path,
        [body],
        "stress",
        label="von Mises [MPa]",
        clim=(0.0, 500.0),
        view=(0.25, -2.0, 0.7),
        zoom=1.45,
        size=(2000, 900),
        title=f"The joint in bearing, displacement and clearance {factor} times enlarged",
    )


def curve(path, states, friction):
    """Force over displacement, and who carries it."""
    import matplotlib

    matplotlib.use("Agg", force=False)
    import matplotlib.pyplot as plt

    fig, axis = plt.subplots(figsize=(7.2, 4.8), layout="constrained")
    x = [s["displacement"] for s in states]
    lines = {
        "pull": [s["pull"] for s in states],
        "friction between the plates": [s["friction"]["plates"] for s in states],
        "friction below the head": [s["friction"]["head"] for s in states],
        "bearing on the shank": [s["bearing"] for s in states],
    }
    for (label, values), style in zip(lines.items(), ("ko-", "s--", "^--", "v--")):
        axis.plot(x, np.array(values) / 1e3, style, markersize=4, label=label)
    for k in (1, 2):
        axis.axhline(k * friction / 1e3, color="0.5", linewidth=0.8, linestyle=":")
        label = "\u03bcN\u2080" if k == 1 else "2\u03bcN\u2080"
        axis.text(0.6 * x[-1], k * friction / 1e3, label, va="bottom", color="0.4")
    axis.set(xlabel="displacement of the end [mm]", ylabel="force [kN]", xlim=(0, None))
    axis.legend()
    axis.grid(alpha=0.3)
    fig.savefig(path, dpi=150)
    plt.close(fig)


if __name__ == "__main__":
    run(options)
