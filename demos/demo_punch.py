# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A soft punch into a block: two bodies at finite deformation
#
# A rounded punch is pushed into a block of about the same stiffness, and then along it. Both
# deform by tens of percent, and the surfaces slide on each other without friction. The bodies are
# meshed with different elements: 27-node hexahedra press on 20-node ones, each on a mesh of its
# own.
#
# Run it with `python3 demo_punch.py [--out DIR] [--level N]`, alone or under `mpirun`.

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
from dolfinx_mortar.mesh import create_hex20_mesh
from dolfinx_mortar.plotting import Writer, gif, picture, surface

comm = MPI.COMM_WORLD

parser = argparse.ArgumentParser(description="A soft punch pressed into a block, and dragged")
parser.add_argument("--out", type=Path, default=Path("output/punch"), help="folder to write")
parser.add_argument("--level", type=int, default=0, help="level + 2 cells along the block's height")
parser.add_argument("--steps", type=int, default=12, help="load steps")
options = parser.parse_args() if __name__ == "__main__" else parser.parse_args([])
# -

# ## Two bodies
#
# The block is $[-1.5, 1.5] \times [-1, 1] \times [-1, 0]$. The punch is a cube of side 1 whose
# lower side is drawn to a sphere of radius 1 that just touches the block. All cells of both are
# curved where they have to be: second-order geometry.


# +
SLAVE, MASTER, HELD = 3, 7, 1


def tags_where(domain, **places):
    """Tags of boundary facets by place."""
    domain.topology.create_connectivity(2, 3)
    found, values = [], []
    for tag, place in ((SLAVE, "slave"), (MASTER, "master"), (HELD, "held")):
        if place in places:
            facets = mesh.locate_entities_boundary(domain, 2, places[place])
            found.append(facets)
            values.append(np.full(len(facets), tag, dtype=np.int32))
    found, values = np.concatenate(found), np.concatenate(values)
    order = np.argsort(found)
    return mesh.meshtags(domain, 2, found[order], values[order])


def block(n):
    """The lower body, hex20, held at its bottom."""
    domain = hex20_box((-1.5, -1, -1), (1.5, 1, 0), (3 * n, 2 * n, n))
    tags = tags_where(
        domain, master=lambda x: np.isclose(x[2], 0), held=lambda x: np.isclose(x[2], -1)
    )
    return domain, tags, fem.functionspace(domain, dm.hex20(shape=(3,)))


def hex20_box(lower, upper, cells):
    """A box of 20-node hexahedra; nodes lie on a lattice of half the cells' size."""
    m = 2 * np.array(cells) + 1
    axes = [np.linspace(lower[i], upper[i], m[i]) for i in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    corner = np.stack(np.meshgrid(*(2 * np.arange(c) for c in cells), indexing="ij"), axis=-1)
    # Nodes of the reference cell in Basix's order: vertices, then edges
    import basix

    geometry = basix.geometry(basix.CellType.hexahedron)
    edges = basix.topology(basix.CellType.hexahedron)[1]
    local = np.vstack([2 * geometry, [geometry[e].sum(axis=0) for e in edges]]).astype(int)
    index = corner.reshape(-1, 1, 3) + local[None]
    numbers = (index[..., 0] * m[1] + index[..., 1]) * m[2] + index[..., 2]
    used, numbers = np.unique(numbers, return_inverse=True)
    numbers = numbers.reshape(-1, 20)
    if comm.rank > 0:
        return create_hex20_mesh(comm, np.empty((0, 3)), np.empty((0, 20), np.int64), "basix")
    return create_hex20_mesh(comm, points[used], numbers, "basix")


def punch(n):
    """The upper body, with quadratic displacements on trilinear cells."""
    domain = mesh.create_box(
        comm,
        [(-1.1, -0.5, 0.0), (-0.1, 0.5, 1.0)],
        (n, n, n),
        cell_type=mesh.CellType.hexahedron,
        ghost_mode=mesh.GhostMode.none,
    )
    tags = tags_where(
        domain, slave=lambda x: np.isclose(x[2], 0), held=lambda x: np.isclose(x[2], 1)
    )
    x = domain.geometry.x
    distance = (x[:, 0] + 0.6) ** 2 + x[:, 1] ** 2
    x[:, 2] += (1 - x[:, 2]) * (1 - np.sqrt(1 - distance))
    return domain, tags, fem.functionspace(domain, ("Lagrange", 2, (3,)))


# -

# ## Material and conditions
#
# Both are neo-Hooke materials, $\Psi = \mu/2 (I_1 - 3) - \mu \ln J + \lambda/2 (\ln J)^2$. The
# bottom of the block is held; the top of the punch moves down by 0.4 in the first half of the
# steps, and then by 1 to the right.


# +
MATERIALS = (10.0, 0.3), (5.0, 0.3)  # E, nu of punch and block


def internal_forces(u, E, nu):
    lmbda, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    F = ufl.Identity(3) + ufl.grad(u)
    J = ufl.det(F)
    psi = mu / 2 * (ufl.inner(F, F) - 3) - mu * ufl.ln(J) + lmbda / 2 * ufl.ln(J) ** 2
    dx = ufl.dx(domain=u.function_space.mesh, metadata={"quadrature_degree": 5})
    return ufl.derivative(psi * dx, u, ufl.TestFunction(u.function_space))


def motion(t):
    """Displacement of the punch's top at time t in [0, 1]."""
    return np.array([max(0.0, 2 * t - 1), 0.0, -0.4 * min(1.0, 2 * t)])


def run(options):
    options.out.mkdir(parents=True, exist_ok=True)
    n = options.level + 2
    domains, tags, spaces = zip(punch(2 * n), block(n))
    u = [fem.Function(V, name="displacement") for V in spaces]
    top = fem.Constant(domains[0], default_scalar_type((0, 0, 0)))
    bottom = fem.Constant(domains[1], default_scalar_type((0, 0, 0)))
    bcs = [
        fem.dirichletbc(c, fem.locate_dofs_topological(V, 2, t.find(HELD)), V)
        for c, V, t in zip((top, bottom), spaces, tags)
    ]
    contact = dm.Contact(spaces, tags, slave=SLAVE, master=MASTER)
    problem = dm.ContactProblem(
        [internal_forces(w, *material) for w, material in zip(u, MATERIALS)],
        u,
        bcs=bcs,
        interfaces=[contact],
        petsc_options_prefix="punch_",
    )

    def go_to(t):
        top.value[:] = motion(t)

    results, frames = [], []
    files = [Writer(options.out / f"{name}.bp", [w]) for name, w in zip(("punch", "block"), u)]
    for step in range(1, options.steps + 1):
        start, t0, t1 = time.perf_counter(), (step - 1) / options.steps, step / options.steps
        iterations = problem.solve(adaptive=lambda s, t0=t0, t1=t1: go_to(t0 + s * (t1 - t0)))
        for file in files:
            file.write(t1)
        force = contact.force
        pressure = contact.pressure
        results.append(
            {
                "time": t1,
                "newton_iterations": iterations,
                "active_nodes": contact.num_active,
                "largest_pressure": comm.allreduce(float(pressure.x.array.max()), op=MPI.MAX),
                "force": force.tolist(),
                "force_balance": float(np.abs(force + contact.master_force).max()),
                "residuals": [float(h["force"]) for h in problem.history],
                "seconds": time.perf_counter() - start,
            }
        )
        frames.append(options.out / f"step_{step:02d}.png")
        show(frames[-1], u, t1)
        r = results[-1]
        if comm.rank == 0:
            print(
                f"t = {t1:.3f}  {iterations} iterations  {r['active_nodes']:3} nodes in contact  "
                f"force ({force[0]:7.4f}, {force[2]:7.4f})  {r['seconds']:.1f} s",
                flush=True,
            )
    for file in files:
        file.close()
    if comm.rank == 0:
        gif(options.out / "punch.gif", frames, 0.2)
        (options.out / "results.json").write_text(json.dumps(results, indent=1))
        report(results, options.out)


# -

# ## Show
#
# The picture cuts both bodies in the plane $y = 0$, so that one looks into the contact. Colours are
# the equivalent stress of the Cauchy stress $\sigma = (\mu (F F^T - I) + \lambda \ln J \, I) / J$.


# +
def von_mises(u, E, nu):
    """Equivalent stress, linear in each cell."""
    mu = E / (2 * (1 + nu))
    F = ufl.Identity(3) + ufl.grad(u)
    s = mu / ufl.det(F) * ufl.dev(F * F.T)
    W = fem.functionspace(u.function_space.mesh, ("DG", 1))
    points = W.element.interpolation_points
    value = fem.Function(W, name="von_mises")
    value.interpolate(
        fem.Expression(ufl.sqrt(1.5 * ufl.inner(s, s)), points() if callable(points) else points)
    )
    return value


def show(path, u, t):
    parts = [
        surface(
            w.function_space.mesh,
            {"stress": von_mises(w, *material)},
            displacement=w,
            where=lambda x: x[1] > 0,
        )
        for w, material in zip(u, MATERIALS)
    ]
    picture(
        path,
        parts,
        "stress",
        label="von Mises",
        clim=(0, 2.5),
        cmap="YlOrRd",
        title=f"t = {t:.2f}",
        view=(0.4, -2.0, 0.8),
        zoom=1.05,
    )


def report(results, out):
    import matplotlib

    matplotlib.use("Agg", force=False)
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(1, 2, figsize=(12, 4.6))
    t = [r["time"] for r in results]
    axes[0].plot(t, [r["force"][2] for r in results], "o-", label="pressing force")
    axes[0].plot(t, [r["force"][0] for r in results], "s-", label="sideways")
    axes[0].set(xlabel="time", ylabel="force on the punch")
    axes[0].legend()
    for r in results:
        axes[1].semilogy(np.maximum(r["residuals"], 1e-16), "o-", color="C0", alpha=0.4)
    axes[1].set(xlabel="Newton iteration", title="residual force / forces at work, all steps")
    for axis in axes:
        axis.grid(alpha=0.25)
    fig.tight_layout()
    fig.savefig(out / "forces.png", dpi=150)
    plt.close(fig)


if __name__ == "__main__":
    run(options)
