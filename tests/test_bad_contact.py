# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Contact that cannot be: the cause and the cure are named, and the state stays as it was."""

from mpi4py import MPI

import cases
import dolfinx_mortar as dm
import numpy as np
import pytest
import ufl
from blocks import FACES, NU, E, block
from dolfinx import fem, la
from test_bad_input import fails

comm = MPI.COMM_WORLD
FIELDS = ("multiplier", "pressure", "tangential_traction", "gap", "slip", "status")
LOST = ("No slave node is in contact", "not held", "search_distance", "prescribe")


class Blocks:
    """A block over a larger one, each a mesh of its own.

    Args:
        gap: Distance of the two; negative where they overlap.
        held: What the upper block's Dirichlet condition holds: "top", "sideways" (the top, but
            free to move up and down), "all" or None.
        held_below: What that of the lower block holds: "bottom" or "all".
        cells: Cells of both.
        energy: Material.
        prescribed: Components of the slave nodes whose displacement is prescribed as well.
        where: Which of the slave nodes that holds for.
        kind: Interface.
        condense, petsc_options, problem_options: See ContactProblem.
        options: Options of the interface.
    """

    def __init__(
        self,
        gap=0.0,
        held="top",
        held_below="bottom",
        *,
        cells=((3, 3, 2), (4, 4, 2)),
        energy=cases.neo_hooke,
        prescribed=(),
        where=lambda x: x[2] > -1,
        kind=dm.Contact,
        condense=None,
        petsc_options=None,
        problem_options=None,
        **options,
    ):
        parts = [
            block("upper", "hex8", (0.2, 0.2, 1 + gap), (0.8, 0.8, 1.6 + gap), cells[0]),
            block("lower", "hex8", (0, 0, 0), (1, 1, 1), cells[1]),
        ]
        bodies, _ = cases._bodies(comm, parts, False)
        self.u = [fem.Function(b.V) for b in bodies]
        dx = ufl.dx(metadata={"quadrature_degree": 3})
        forms = [ufl.derivative(energy(E, NU)(w) * dx, w) for w in self.u]
        upper, lower = bodies
        self.load = fem.Constant(upper.mesh, np.zeros(3))
        ds = ufl.ds(domain=upper.mesh, subdomain_data=upper.facet_tags)
        forms[0] -= ufl.inner(self.load, ufl.TestFunction(upper.V)) * ds(FACES["z+"])

        #: Motion of the held nodes of the upper block
        self.motion = fem.Constant(upper.mesh, np.zeros(3))
        end = {"top": 1.6 + gap, "sideways": 1.6 + gap, "all": None, None: -1.0}[held]
        below = at_height(lower.V, 0 if held_below == "bottom" else None)
        bcs = [fem.dirichletbc(np.zeros(3), below, lower.V)]
        if held == "sideways":
            bcs += [on_component(upper.V, c, lambda x: np.isclose(x[2], end))[0] for c in (0, 1)]
        elif held:
            bcs.append(fem.dirichletbc(self.motion, at_height(upper.V, end), upper.V))
        #: Prescribed components of the slave nodes
        self.slave_motion = {}
        for c in prescribed:
            bc, self.slave_motion[c] = on_component(
                upper.V, c, lambda x: np.isclose(x[2], 1 + gap) & where(x)
            )
            bcs.append(bc)
        sides = [
            [(upper.V, upper.facet_tags, FACES["z-"])],
            [(lower.V, lower.facet_tags, FACES["z+"])],
        ]
        self.contact = kind(slave=sides[0], master=sides[1], **options)
        self.problem = dm.ContactProblem(
            forms,
            self.u,
            bcs=bcs,
            interfaces=[self.contact],
            petsc_options_prefix="bad_",
            petsc_options=petsc_options,
            condense=condense,
            **(problem_options or {}),
        )
        self.solve = self.problem.solve

    def snapshot(self):
        """What a failed solve must leave alone."""
        c = self.contact
        values = {name: getattr(c, name).x.array.copy() for name in FIELDS}
        values |= {f"u{k}": w.x.array.copy() for k, w in enumerate(self.u)}
        return values | {"force": c.force, "active": c.num_active, "energy": c.dissipation}

    def numbers(self):
        """Numbers for the state that do not depend on the numbering of the mesh."""
        functions = [*self.u, *(getattr(self.contact, name) for name in FIELDS)]
        sums = []
        for f in functions:
            V = f.function_space
            n, bs = V.dofmap.index_map.size_local, V.dofmap.index_map_bs
            values, x = f.x.array[: n * bs].reshape(n, bs), V.tabulate_dof_coordinates()[:n]
            sums += [np.sum(values**2, axis=0), np.ravel(np.cos(3 * x).T @ values)]
        energy = np.array([self.contact.dissipation])
        return np.concatenate([comm.allreduce(np.concatenate(sums)), self.contact.force, energy])

    def is_as_in(self, snapshot):
        """Assert that the state is that of an earlier snapshot."""
        for name, value in self.snapshot().items():
            exact = name != "force"  # a sum over ranks, formed anew
            compare = np.testing.assert_array_equal if exact else np.testing.assert_allclose
            compare(value, snapshot[name], err_msg=name)


def at_height(V, z):
    """Dofs at a height, or all."""
    return fem.locate_dofs_geometrical(
        V, lambda x: np.isclose(x[2], z) if z is not None else x[2] > -9
    )


def on_component(V, component, where):
    """A condition on one component, and its values."""
    W, _ = V.sub(component).collapse()
    value = fem.Function(W)
    dofs = fem.locate_dofs_geometrical((V.sub(component), W), where)
    return fem.dirichletbc(value, dofs, V.sub(component)), value


def refused(blocks, *words):
    """The solve fails with these words, and leaves the state."""
    before = [w.x.array.copy() for w in blocks.u]
    error = fails(blocks.solve, *words, kind=dm.ConvergenceError)
    assert "error code" not in str(error)
    for w, values in zip(blocks.u, before, strict=True):
        np.testing.assert_array_equal(w.x.array, values)
    return error


# -- Contact that is not there ---------------------------------------------------------------------


@pytest.mark.parametrize("condense", [True, False])
@pytest.mark.parametrize("held", [None, "sideways"])
@pytest.mark.parametrize(
    ("gap", "load", "options"),
    [
        (0.0, 2.0, {}),
        (0.1, 2.0, {"friction": 0.3}),
        (5.0, -2.0, {}),
        (0.1, -2.0, {"initial_active": "none"}),
    ],
    ids=["pulled off", "pulled away", "out of reach", "none to begin with"],
)
def test_no_contact_reached(gap, load, options, held, condense):
    """Also where the factors of a singular matrix are finite, and the body flies away."""
    blocks = Blocks(gap, held, condense=condense, **options)
    blocks.load.value[2] = load
    error = refused(blocks, *LOST)
    assert len(error.history) <= 2  # as soon as contact is lost


@pytest.mark.parametrize(
    "options",
    [
        {"ksp_error_if_not_converged": True},
        {"mat_mumps_icntl_24": 1},
        {"ksp_type": "gmres", "pc_type": "gamg", "snes_max_it": 5},
    ],
    ids=["PETSc raises", "null pivots", "multigrid"],
)
def test_no_contact_reached_by_other_solvers(options):
    blocks = Blocks(0.0, "sideways", petsc_options=options)
    blocks.load.value[2] = 2.0
    refused(blocks, *LOST)


@pytest.mark.parametrize("friction", [None, 0.3])
def test_contact_lost_in_a_later_step(friction):
    blocks = Blocks(0.05, "sideways", friction=friction)
    blocks.load.value[:] = 1.0, 0.0, -20.0
    blocks.solve()
    before = blocks.snapshot()
    assert before["active"] > 0
    blocks.load.value[2] = 20.0
    refused(blocks, *LOST)
    blocks.is_as_in(before)

    # The run goes on as if nothing had been
    blocks.load.value[2] = -30.0
    blocks.solve()
    other = Blocks(0.05, "sideways", friction=friction)
    for load in (-20.0, -30.0):
        other.load.value[:] = 1.0, 0.0, load
        other.solve()
    np.testing.assert_allclose(blocks.numbers(), other.numbers(), rtol=1e-7, atol=1e-7)


def test_held_body_without_load_and_contact():
    """That is no error: the round-off of a body at rest is no force."""
    blocks = Blocks(0.3)
    assert blocks.solve() <= 1
    assert blocks.contact.num_active == 0


# -- Deep in the other body ------------------------------------------------------------------------

FINE = ((4, 4, 4), (6, 6, 6))
DIAMETER = np.hypot(1, 1) / 6  # the larger one: a facet of the lower block


@pytest.mark.parametrize(("depth", "held_below"), [(0.5, "bottom"), (1.0, "all")])
def test_overlap_at_the_start(depth, held_below):
    """As far as the search reaches it is solved: as if the block had come there step by step."""
    depth *= DIAMETER
    blocks = Blocks(-depth, held_below=held_below, cells=FINE)
    blocks.solve()
    pushed = Blocks(held_below=held_below, cells=FINE)
    for part in np.linspace(0, 1, 5)[1:]:
        pushed.motion.value[2] = -part * depth
        pushed.solve()
    assert blocks.contact.force[2] > 0
    for name in "force", "master_force", "moment":
        value, other = (getattr(b.contact, name) for b in (blocks, pushed))
        np.testing.assert_allclose(value, other, rtol=1e-8, atol=1e-8, err_msg=name)
    assert la.norm(blocks.u[1].x) == pytest.approx(la.norm(pushed.u[1].x), rel=1e-8)


def test_overlap_that_does_not_converge():
    """Smaller load steps are no cure where the first one begins with the overlap."""
    blocks = Blocks(-DIAMETER, cells=FINE, petsc_options={"snes_max_it": 2})
    refused(blocks, "overlap at the start", "begin with them apart")


@pytest.mark.parametrize("depth", [2.2, 3.5])
@pytest.mark.parametrize("geometry", ["current", "reference"])
def test_deep_overlap_at_the_start(depth, geometry):
    blocks = Blocks(-depth * DIAMETER, cells=FINE, geometry=geometry)
    words = (
        f"is {depth * DIAMETER:.3g} deep inside",
        "Begin with the bodies apart",
        "search_distance",
    )
    fails(blocks.solve, *words)
    assert all(np.all(w.x.array == 0) for w in blocks.u)
    assert np.all(blocks.contact.pressure.x.array == 0)
    with pytest.raises(RuntimeError, match="no solution"):
        _ = blocks.contact.force


def test_deep_overlap_within_a_given_distance():
    """The cure that the message names."""
    cells = ((10, 10, 2), (12, 12, 2))
    depth = 2.5 * np.hypot(1, 1) / 12
    blocks = Blocks(-depth, held_below="all", cells=cells)
    fails(blocks.solve, "search_distance")
    blocks = Blocks(-depth, held_below="all", cells=cells, search_distance=1.1 * depth)
    blocks.solve()
    assert blocks.contact.num_active == 121
    assert np.abs(blocks.contact.gap.x.array).max(initial=0) < 1e-8


def test_bodies_beside_each_other_are_no_overlap():
    """A slave facet in the box around a body with a bay is not in that body."""
    blocks = Blocks(0.3, energy=cases.linear_elastic)
    # The lower block's rim is bent up around the upper block
    V = blocks.u[1].function_space
    x = V.tabulate_dof_coordinates()
    bend = np.where(np.abs(x[:, 0] - 0.5) > 0.4, 1.0, 0.0)
    blocks.u[1].x.array[2::3] = bend[: len(blocks.u[1].x.array) // 3] * x[: len(bend), 2]
    blocks.problem.solve()
    # Nothing loads the bodies, so they end where they are at rest
    assert blocks.contact.num_active == 0
    assert max(np.abs(w.x.array).max(initial=0) for w in blocks.u) < 1e-10


@pytest.mark.parametrize("step", [0.7, 0.9])
def test_passing_through_in_one_step(step):
    blocks = Blocks(0.05, cells=FINE)
    blocks.motion.value[2] = -0.02
    blocks.solve()
    before = blocks.snapshot()
    blocks.motion.value[2] = -step
    refused(blocks, "deep inside a master body", "passed through", "smaller load steps")
    blocks.is_as_in(before)


def test_cut_steps_do_not_pass_through():
    blocks = Blocks(0.05, cells=FINE, energy=cases.linear_elastic)
    blocks.solve(adaptive=lambda t: blocks.motion.value.__setitem__(2, -0.5 * t))
    assert blocks.contact.num_active > 0 and blocks.contact.force[2] > 0


# -- Inside out ------------------------------------------------------------------------------------


def test_cells_inside_out():
    """A linear material does not mind being pressed through itself."""
    blocks = Blocks(held_below="all", energy=cases.linear_elastic)
    blocks.motion.value[2] = -0.2
    blocks.solve()
    before = blocks.snapshot()
    blocks.motion.value[2] = -0.9
    refused(blocks, "cells are turned inside out", "smaller load steps")
    blocks.is_as_in(before)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_slave_facets_inside_out(factor):
    """The slave surface is mirrored by prescribed motions."""
    blocks = Blocks(prescribed=(0,), energy=cases.linear_elastic)
    blocks.motion.value[2] = -0.02
    blocks.solve()
    before = blocks.snapshot()
    blocks.slave_motion[0].interpolate(lambda x: -(1 + factor) * (x[0] - 0.5))
    refused(blocks, "inside out", "smaller load step")
    blocks.is_as_in(before)


@pytest.mark.parametrize("load", [-1e6, -1e12])
def test_enormous_load(load):
    blocks = Blocks(held="sideways")
    blocks.load.value[2] = -10.0
    blocks.solve()
    before = blocks.snapshot()
    blocks.load.value[2] = load
    refused(blocks, "load step", "state is as before")
    blocks.is_as_in(before)


# -- Against Dirichlet conditions ------------------------------------------------------------------


@pytest.mark.parametrize("held_below", ["bottom", "all"])
def test_slave_without_free_nodes(held_below):
    words = ("No node of the slave surface (facet tag 14)", "prescribed", "other surface")
    fails(lambda: Blocks(held="all", held_below=held_below), *words)


@pytest.mark.parametrize("friction", [None, 0.3])
def test_normal_motion_prescribed(friction):
    blocks = Blocks(0.01, prescribed=(2,), friction=friction, petsc_options={"snes_max_it": 15})
    blocks.solve()
    before = blocks.snapshot()
    blocks.motion.value[2] = -0.05
    blocks.slave_motion[2].x.array[:] = -0.05
    refused(blocks, "0.04 inside the master", "contradict", "Dirichlet conditions")
    blocks.is_as_in(before)


@pytest.mark.parametrize("geometry", ["current", "reference"])
def test_some_nodes_prescribed(geometry):
    """Those at one side are pushed into the master, the others could give way."""
    blocks = Blocks(
        0.01, prescribed=(0, 1, 2), where=lambda x: np.isclose(x[0], 0.2), geometry=geometry
    )
    blocks.slave_motion[2].x.array[:] = -0.005
    blocks.solve()
    blocks.slave_motion[2].x.array[:] = -0.08
    refused(blocks, "inside the master", "contradict")


def test_prescribed_motion_along_the_surface():
    """What contact can work around is no contradiction."""
    blocks = Blocks(prescribed=(0, 1))
    blocks.motion.value[2] = -0.05
    blocks.solve()
    assert blocks.contact.num_active == 16


# -- Not converged, not finite ---------------------------------------------------------------------


def test_unconverged_step_with_friction():
    """All fields and the history of friction stay; the run goes on as one without that step."""

    def drag(blocks, x, z):
        blocks.motion.value[:] = x, 0.0, z
        return blocks.solve

    expected, blocks = Blocks(friction=0.3), Blocks(friction=0.3)
    for b in (expected, blocks):
        drag(b, 0.0, -0.02)()
        drag(b, 0.05, -0.02)()
    before = blocks.snapshot()
    assert before["energy"] > 0
    assert comm.allreduce(np.abs(before["slip"]).max(initial=0), MPI.MAX) > 0
    snes = blocks.problem.snes
    _, _, _, max_it = snes.getTolerances()
    snes.setTolerances(max_it=1)
    solve = drag(blocks, 0.1, -0.03)
    error = fails(solve, "DIVERGED_MAX_IT", "after 1 Newton", kind=dm.ConvergenceError)
    assert len(error.history) == 2
    blocks.is_as_in(before)
    snes.setTolerances(max_it=max_it)
    for b in (expected, blocks):
        drag(b, 0.1, -0.02)()
    np.testing.assert_allclose(blocks.numbers(), expected.numbers(), rtol=1e-7, atol=1e-7)


def test_step_whose_second_half_fails():
    """Nothing is left of the first half, which had been accepted."""
    blocks = Blocks(friction=0.3)
    for x in (0.0, 0.05):
        blocks.motion.value[:] = x, 0.0, -0.02
        blocks.solve()
    before = blocks.snapshot()
    calls = []

    def load(t):
        calls.append(t)
        bad = t > 0.5 or len(calls) == 1
        blocks.motion.value[:] = (np.nan if bad else 0.05 + 0.05 * t), 0.0, -0.02

    fails(
        lambda: blocks.solve(adaptive=load, max_cuts=2),
        "prescribed displacement is not a finite number",
        kind=dm.ConvergenceError,
    )
    assert 0.5 in calls
    blocks.is_as_in(before)


def test_load_that_is_not_a_number():
    blocks = Blocks(held="sideways")
    blocks.load.value[2] = np.nan
    refused(blocks, "residual force is not finite near X = (", "load")
    blocks.load.value[2] = -1e200
    refused(blocks, "residual is too large", "smaller load steps")
    blocks.load.value[2] = -1.0
    blocks.solve()


def test_prescribed_displacement_that_is_not_a_number():
    blocks = Blocks()
    blocks.motion.value[2] = np.nan
    refused(blocks, "prescribed displacement is not a finite number")
    blocks.motion.value[2] = -0.01
    blocks.solve()


def test_no_step_leads_on():
    """The message says where the residual is not finite, not that a callback has failed."""
    blocks = Blocks(held="sideways")
    blocks.load.value[2] = -1e12
    refused(blocks, "no admissible state", "not finite near X = (", "a cell is inside out")


def test_linear_solver_that_stops_early():
    options = {"ksp_type": "gmres", "pc_type": "jacobi", "ksp_max_it": 2, "snes_max_it": 4}
    blocks = Blocks(petsc_options=options)
    blocks.motion.value[2] = -0.05
    refused(blocks, "linear solver", "ksp_max_it")


@pytest.mark.serial
def test_singular_factors():
    """PETSc's own factorisation does not pivot, a saddle point has zeros on its diagonal."""
    options = {"pc_type": "lu", "pc_factor_mat_solver_type": "petsc"}
    blocks = Blocks(petsc_options=options, condense=False)
    blocks.motion.value[2] = -0.05
    refused(blocks, "linear solver", "A body", "held", "Dirichlet conditions")


# -- Another problem than before -------------------------------------------------------------------


@pytest.mark.parametrize("kind", [dm.Contact, dm.Tie])
def test_mesh_moved_between_steps(kind):
    blocks = Blocks(kind=kind)
    blocks.motion.value[2] = -0.01
    blocks.solve()
    before = [w.x.array.copy() for w in blocks.u]
    x = blocks.u[1].function_space.mesh.geometry.x
    kept = x.copy()
    x[:, 2] *= 0.9
    fails(blocks.solve, "mesh has been moved", "new ContactProblem")
    x[:] = kept
    assert all(np.array_equal(w.x.array, v) for w, v in zip(blocks.u, before, strict=True))
    blocks.motion.value[2] = -0.02
    blocks.solve()


def test_displacement_exchanged():
    blocks = Blocks()
    blocks.solve()
    u = blocks.problem.u
    blocks.problem.u = [u[0], fem.Function(u[1].function_space)]
    fails(blocks.solve, "Another displacement", "new ContactProblem")
    blocks.problem.u = u
    blocks.solve()


def test_conditions_on_other_nodes():
    blocks = Blocks()
    blocks.solve()
    V = blocks.u[0].function_space
    more = fem.dirichletbc(np.zeros(3), at_height(V, 1.3), V)
    blocks.problem.bcs.append(more)
    fails(blocks.solve, "Dirichlet conditions", "new ContactProblem")
    blocks.problem.bcs.remove(more)
    blocks.solve()


def test_interface_of_another_problem():
    blocks = Blocks()
    forms = [ufl.inner(w, ufl.TestFunction(w.function_space)) * ufl.dx for w in blocks.u]
    fails(
        lambda: dm.ContactProblem(forms, blocks.u, interfaces=[blocks.contact]),
        "part of another ContactProblem",
    )
    blocks.solve()
