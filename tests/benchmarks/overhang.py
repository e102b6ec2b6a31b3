# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Tying where the master is smaller than the slave: order of the error, and what the edge costs.

A block stands on a larger one, and its outline cuts facets of the larger one. Both are bent with
the stress sigma_zz = c x alone. Their displacements are quadratic, so that both bodies contain them
and the whole error is the coupling's. The rest of the larger block's surface has the exact traction
as its load, integrated on the pieces of facets outside of the outline. "Overhanging" has the larger
block's surface as the slave, "covered" the smaller one's. "Near" is the share of the energy of the
error within one cell of the large block from the outline, in both. "Order" is that of the line
through all errors: where the outline cuts facets differs from mesh to mesh. On one rank only.

    python3 tests/benchmarks/overhang.py [--element hex20 ...] [--multiplier NAME ...] [--level 4]
                                         [--out overhang.json]
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import dolfinx_mortar as dm
import numpy as np
import ufl
from dolfinx import fem
from scipy.sparse.linalg import spsolve

sys.path.insert(0, str(Path(__file__).parents[1]))

import blocks
import cases
import oracle

E, NU, C = blocks.E, blocks.NU, 10.0
# Lowest and highest corner of the blocks
LARGE = ((0.0, 0.0, 0.0), (1.2, 1.1, 0.6))
SMALL = ((0.23, 0.17, 0.6), (0.83, 0.72, 1.15))
# For k = 1: cells along x and y of the large and of the small block, if the large one is the slave
# with cells 3:2 or 2:3 of the master's
CELLS = {"3:2": (4, 3), "2:3": (6, 2)}
SPACES = ("dual-reproducing", "standard", "dual", "dual-linear")
SURFACE = {"large": blocks.FACES["z+"], "small": blocks.FACES["z-"]}


def exact(x):
    """Displacement of bending with the stress sigma_zz = C x, UFL or numbers."""
    ux = -(x[2] ** 2) - NU * x[0] ** 2 + NU * x[1] ** 2
    return [C / (2 * E) * u for u in (ux, -2 * NU * x[0] * x[1], 2 * x[0] * x[2])]


def two_blocks(element: str, ratio: str, k: int) -> cases.Case:
    """Meshes of the large block (part 0) and of the small one on it (part 1)."""
    large, small = (k * n for n in CELLS[ratio])
    parts = [
        blocks.block("large", element, *LARGE, (large, large, max(1, large // 2))),
        blocks.block("small", element, *SMALL, (small, small, small)),
    ]
    return blocks.assemble(parts, [], [])


def outside_load(body: cases.Body) -> fem.Function:
    """A traction on the whole upper surface with the nodal forces of c x outside of the outline."""
    tag = SURFACE["large"]
    surface, nodes = cases.oracle_surface(body.V, body.facet_tags, tag, None)
    corners = [(x, y, SMALL[0][2]) for y in (0, 1) for x in (0, 1)]
    corners = np.array([(SMALL[x][0], SMALL[y][1], z) for x, y, z in corners])
    footprint = oracle.Surface(corners, [("quad4", np.arange(4))], np.array([-1.0]))
    traction = C * surface.x[:, 0]
    covered = oracle.mortar(surface, footprint, "standard", points=5).D.T @ traction
    v, w = ufl.TestFunction(body.V), ufl.TrialFunction(body.V)
    ds = ufl.Measure("ds", body.mesh, subdomain_data=body.facet_tags)(tag)
    A = fem.assemble_matrix(fem.form(ufl.inner(w, v) * ds)).to_scipy().tocsc()
    x = ufl.SpatialCoordinate(body.mesh)
    whole = fem.assemble_vector(fem.form(C * x[0] * v[2] * ds)).array
    forces = whole.reshape(-1, 3)
    forces[nodes, 2] -= covered
    used = np.flatnonzero(A.diagonal())
    load = fem.Function(body.V)
    load.x.array[used] = spsolve(A[used][:, used], forces.ravel()[used])
    return load


def energy(body: cases.Body, e, weight=1) -> float:
    """Strain energy of a displacement, with a weight."""
    dx = ufl.Measure("dx", body.mesh, metadata={"quadrature_degree": 4})
    eps = ufl.sym(ufl.grad(e))
    lmbda, mu = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
    density = lmbda / 2 * ufl.tr(eps) ** 2 + mu * ufl.inner(eps, eps)
    return fem.assemble_scalar(fem.form(weight * density * dx))


def near_outline(x, size: float):
    """Whether a point is within a size of the master's outline, above or below the surface."""
    inside, outside = [], []
    for i in (0, 1):
        centre, half = (SMALL[1][i] + SMALL[0][i]) / 2, (SMALL[1][i] - SMALL[0][i]) / 2
        inside.append(ufl.lt(abs(x[i] - centre), half - size))
        outside.append(ufl.gt(abs(x[i] - centre), half + size))
    far = ufl.gt(abs(x[2] - SMALL[0][2]), size)
    return ufl.conditional(ufl.Or(far, ufl.Or(ufl.And(*inside), ufl.Or(*outside))), 0.0, 1.0)


def solve(element: str, ratio: str, k: int, slave: str, multiplier: str) -> dict:
    """Relative error in the energy norm, and the share near the outline."""
    case = two_blocks(element, ratio, k)
    large, small = case.bodies
    u = cases.displacements(case)
    forms = cases.residuals(case, u)
    x = ufl.SpatialCoordinate(small.mesh)
    top = ufl.Measure("ds", small.mesh, subdomain_data=small.facet_tags)(blocks.FACES["z+"])
    forms[1] -= C * x[0] * ufl.TestFunction(small.V)[2] * top
    surface = ufl.Measure("ds", large.mesh, subdomain_data=large.facet_tags)(SURFACE["large"])
    forms[0] -= ufl.inner(outside_load(large), ufl.TestFunction(large.V)) * surface
    given = fem.Function(large.V)
    given.interpolate(lambda x: np.array(exact(x)))
    bottom = large.facet_tags.find(blocks.FACES["z-"])
    bcs = [fem.dirichletbc(given, fem.locate_dofs_topological(large.V, 2, bottom))]
    order = (0, 1) if slave == "large" else (1, 0)
    names = ("large", "small")
    tie = dm.Tie(
        tuple(case.bodies[b].V for b in order),
        tuple(case.bodies[b].facet_tags for b in order),
        slave=SURFACE[names[order[0]]],
        master=SURFACE[names[order[1]]],
        multiplier=multiplier,
    )
    with dm.ContactProblem(forms, u, bcs=bcs, interfaces=[tie]) as problem:
        problem.solve()
    size = LARGE[1][0] / (k * CELLS[ratio][0])
    error, whole, near = 0.0, 0.0, 0.0
    for body, w in zip(case.bodies, u, strict=True):
        x = ufl.SpatialCoordinate(body.mesh)
        uh = ufl.as_vector(exact(x))
        error += energy(body, w - uh)
        near += energy(body, w - uh, near_outline(x, size))
        whole += energy(body, uh)
    return {
        "element": element,
        "slave": slave,
        "ratio": ratio if slave == "large" else ratio[::-1],
        "multiplier": multiplier,
        "k": k,
        "error": float(np.sqrt(error / whole)),
        "near": float(near / error),
        "dofs": sum(3 * b.V.dofmap.index_map.size_global for b in case.bodies),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--element", nargs="+", default=["tet10", "hex20", "hex27"])
    parser.add_argument("--multiplier", nargs="+", choices=SPACES, default=list(SPACES))
    parser.add_argument("--level", type=int, default=4, help="finest mesh, k = 1, 2, ...")
    parser.add_argument("--out", type=Path, help="write figures to this JSON file")
    arguments = parser.parse_args()
    rows = []
    print("| element | slave | slave : master | multiplier | errors | order | near |")
    print("|---|---|---|---|---|--:|--:|")
    for element in arguments.element:
        for slave in ("large", "small"):
            for ratio in ("3:2", "2:3"):
                for multiplier in arguments.multiplier:
                    if element == "hex27" and multiplier == "dual-reproducing":
                        continue  # "dual" there
                    study = [
                        solve(element, ratio, k, slave, multiplier)
                        for k in range(1, arguments.level + 1)
                    ]
                    rows += study
                    errors = [row["error"] for row in study]
                    sizes = np.log([row["k"] for row in study])
                    order = -np.polyfit(sizes, np.log(errors), 1)[0]
                    print(
                        f"| {element} | {slave} | {study[0]['ratio']} | {multiplier} | "
                        + ", ".join(f"{e:.2e}" for e in errors)
                        + f" | {order:.2f} | {study[-1]['near']:.0%} |",
                        flush=True,
                    )
    if arguments.out:
        arguments.out.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
