# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Forms of another kind, number, mesh or space than a problem needs are refused by name."""

from mpi4py import MPI

import cases
import dolfinx_mortar as dm
import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx_mortar import forms
from test_bad_input import LOWER, UPPER, fails, two_cubes
from timers import counted

comm = MPI.COMM_WORLD
ASSEMBLE = "~mortar: assemble"


class Bodies:
    """Two cubes in contact, a mesh each: their forms, and problems of other forms."""

    def __init__(self):
        self.case = two_cubes(kind="contact")
        self.u = cases.displacements(self.case)
        self.F = [self.form(w) for w in self.u]
        self.J = [ufl.derivative(f, w) for f, w in zip(self.F, self.u, strict=True)]

    @staticmethod
    def form(w):
        """Linear elasticity of a function, a trial function or a test function."""
        v = ufl.TestFunction(w.ufl_function_space())
        return ufl.inner(ufl.sym(ufl.grad(w)), ufl.grad(v)) * ufl.dx

    def problem(self, F=None, J=None, u=None):
        tags = [b.facet_tags for b in self.case.bodies]
        spaces = [w.function_space for w in self.u]
        contact = dm.Contact(spaces, tags, slave=UPPER, master=LOWER)
        bcs = cases.DirichletConditions(self.case).bcs
        return dm.ContactProblem(
            self.F if F is None else F, u or self.u, J=J, bcs=bcs, interfaces=[contact]
        )


@pytest.fixture
def bodies():
    return Bodies()


def test_bilinear_residual(bodies):
    """What LinearProblem takes is not what a nonlinear problem is."""
    F = [bodies.form(ufl.TrialFunction(w.function_space)) for w in bodies.u]
    fails(lambda: bodies.problem(F), "F is bilinear", "TrialFunction", "residual")
    fails(lambda: bodies.problem([bodies.F[0], F[1]]), "F[1] is bilinear")
    compiled = [fem.form(f) for f in F]
    fails(lambda: bodies.problem(compiled, bodies.J), "F is bilinear")


def test_energy_as_residual(bodies):
    energy = [ufl.inner(w, w) * ufl.dx for w in bodies.u]
    fails(lambda: bodies.problem(energy), "F is a number", "ufl.derivative")


def test_residual_without_displacement(bodies):
    v = ufl.TestFunction(bodies.u[0].function_space)
    load = ufl.inner(ufl.as_vector([0.0, 0.0, 1.0]), v) * ufl.dx
    fails(lambda: bodies.problem([load, bodies.F[1]]), "F does not contain the displacement")
    other = fem.Function(bodies.u[0].function_space)
    fails(lambda: bodies.problem([bodies.form(other), bodies.F[1]]), "F does not contain")


def test_things_that_are_no_forms(bodies):
    fails(lambda: bodies.problem([bodies.F[0], 3.0]), "F[1] is a float", "UFL form")
    fails(lambda: bodies.problem([bodies.F[0], bodies.F[1] == 0]), "F[1] is a ")
    fails(lambda: bodies.problem(u=[w.function_space for w in bodies.u]), "u is a FunctionSpace")
    fails(lambda: bodies.problem(u=[bodies.u[0], bodies.u[0]]), "same function space")


def test_jacobian_of_another_kind_or_number(bodies):
    fails(lambda: bodies.problem(J=bodies.J[:1]), "J has 1 forms for 2 displacements")
    fails(lambda: bodies.problem(J=bodies.F), "J is linear", "bilinear")
    fails(lambda: bodies.problem(J=[bodies.J[0], bodies.F[1]]), "J[1] is linear")


def test_forms_of_another_mesh_or_space(bodies):
    fails(lambda: bodies.problem(F=bodies.F[::-1]), "F has a test or trial function", "mesh")
    fails(lambda: bodies.problem(J=bodies.J[::-1]), "J has a test or trial function", "mesh")
    V = fem.functionspace(bodies.case.bodies[0].mesh, ("Lagrange", 2, (3,)))
    other = bodies.form(fem.Function(V))
    fails(lambda: bodies.problem(F=[other, bodies.F[1]]), "F has a test", "another space")
    J = bodies.form(ufl.TrialFunction(V))
    fails(lambda: bodies.problem(J=[J, bodies.J[1]]), "J has a test", "another space")
    v = ufl.TestFunction(bodies.u[1].function_space)
    mixed = bodies.F[1] + ufl.inner(bodies.u[0], v) * ufl.dx(domain=bodies.case.bodies[1].mesh)
    fails(lambda: bodies.problem(F=[bodies.F[0], mixed]), "F[1] has functions", "another mesh")


def test_compiled_forms(bodies):
    """They cannot be differentiated, but else they do."""
    F = [fem.form(f) for f in bodies.F]
    fails(lambda: bodies.problem(F), "compiled", "give J")
    p = bodies.problem(F, [fem.form(j) for j in bodies.J])
    p.solve()
    expected = Bodies()
    expected.problem().solve()
    for a, b in zip(bodies.u, expected.u, strict=True):
        assert np.isclose(blocks_norm(a), blocks_norm(b), rtol=1e-9, atol=1e-12)


def blocks_norm(u):
    """Norm of a function that does not depend on the numbering of its mesh."""
    owned = u.x.array[: 3 * u.function_space.dofmap.index_map.size_local]
    return np.sqrt(comm.allreduce(float(owned @ owned)))


def test_derivative_without_dead_loads(bodies):
    """Residuals that differ in these alone share the compiled derivative; springs are in it."""
    F, u = bodies.F[0], bodies.u[0]
    load = fem.Constant(u.function_space.mesh, np.ones(3))
    signatures = []
    for traction in (None, load, -load[0] * u):
        f = F
        if traction is not None:
            f -= ufl.inner(traction, ufl.TestFunction(u.function_space)) * ufl.ds
        signatures.append(forms.derivatives([f], [u])[0].signature())
    without, with_load, with_springs = signatures
    assert with_load == without != with_springs


def test_conditions_and_interfaces_of_another_kind(bodies):
    F, u = bodies.F, bodies.u
    fails(lambda: dm.ContactProblem(F, u, bcs=[3]), "bcs hold a int")
    fails(lambda: dm.ContactProblem(F, u, interfaces=[bodies]), "interfaces hold a Bodies")
    sides = bodies.problem().interfaces[0]
    contact = dm.Contact(slave=sides.slave, master=sides.master)
    twice = [contact, contact]
    fails(lambda: dm.ContactProblem(F, u, interfaces=twice), "named twice")
    fails(lambda: dm.Interface(slave=sides.slave, master=sides.master), "Tie or a Contact")
    assert dm.ContactProblem(F, u, interfaces=contact).interfaces == (contact,)


@pytest.mark.parametrize("linear", [True, False])
def test_tangent_follows_what_it_depends_on(bodies, linear):
    """It is assembled if displacements or constants have changed, and not without."""
    stiffness = [fem.Constant(w.function_space.mesh, 1.0) for w in bodies.u]
    F = []
    for k, w, f in zip(stiffness, bodies.u, bodies.F, strict=True):
        v = ufl.TestFunction(w.function_space)
        F.append(k * f if linear else k * f + k * ufl.inner(w, w) * ufl.inner(w, v) * ufl.dx)
    iterations, assembled, forces = [], [], []
    with bodies.problem(F) as problem:
        for factor in (1.0, 2.0):
            for k in stiffness:
                k.value = factor
            before = counted(ASSEMBLE)
            iterations.append(problem.solve())
            assembled.append(counted(ASSEMBLE) - before)
            forces.append(problem.interfaces[0].force)
    # The second solution is that of the first solve, with forces of twice the size
    assert np.linalg.norm(forces[0]) > 0
    np.testing.assert_allclose(forces[1], 2 * forces[0], rtol=1e-6, atol=1e-9)
    expected = [len(bodies.u) * (1 if linear else max(n, 1)) for n in iterations]
    assert assembled == expected
