"""What a step that fails leaves behind, and numbers for which there is no solution."""

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import pytest
import ufl
from dolfinx import fem, la, mesh

NUMBERS = ("force", "master_force", "moment", "num_active", "dissipation")


class Blocks:
    """A small block on a larger one, with friction."""

    def __init__(self):
        (self.u1, tags1, F1), (self.u2, tags2, F2) = (
            self.body([0.2, 0.2, 1.0], [0.8, 0.8, 1.6], 2),
            self.body([0.0, 0.0, 0.0], [1.0, 1.0, 1.0], 3),
        )
        V1, V2 = self.u1.function_space, self.u2.function_space
        self.motion = fem.Constant(V1.mesh, np.array([0.0, 0.0, -0.05]))
        self.contact = dm.Contact((V1, V2), (tags1, tags2), slave=1, master=1, friction=0.3)
        self.alone = dm.Contact((V1, V2), (tags1, tags2), slave=1, master=1)
        bcs = [
            fem.dirichletbc(self.motion, self.side(V1, 1.6), V1),
            fem.dirichletbc(np.zeros(3), self.side(V2, 0.0), V2),
        ]
        self.problem = dm.ContactProblem(
            [F1, F2], [self.u1, self.u2], bcs=bcs, interfaces=[self.contact]
        )

    @staticmethod
    def body(low, high, n):
        domain = mesh.create_box(MPI.COMM_WORLD, [low, high], [n] * 3, mesh.CellType.hexahedron)
        facets = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 1))
        u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (3,))))
        strain = ufl.sym(ufl.grad(u))
        energy = 50 * ufl.inner(strain, strain) + 40 * ufl.tr(strain) ** 2
        return u, mesh.meshtags(domain, 2, facets, 1), ufl.derivative(energy * ufl.dx, u)

    @staticmethod
    def side(V, z):
        return fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[2], z))

    def drag(self, t):
        self.motion.value[:] = [0.02 * t, 0.0, -0.05]


@pytest.mark.parametrize("name", NUMBERS)
def test_no_solution_yet(name):
    blocks = Blocks()
    with pytest.raises(RuntimeError, match="solve"):
        getattr(blocks.contact, name)
    with pytest.raises(RuntimeError, match="ContactProblem"):
        getattr(blocks.alone, name)


def test_step_that_fails_in_its_second_half():
    """Friction goes on from the state before the step, not from the half that was accepted."""
    expected, blocks = Blocks(), Blocks()
    for b in (expected, blocks):
        b.problem.solve()
    expected.drag(1.0)
    expected.problem.solve()

    before = blocks.u1.x.array.copy()
    calls = []

    def load(t):
        calls.append(t)
        blocks.drag(t)
        if len(calls) == 1 or t > 0.5:
            blocks.motion.value[0] = np.nan

    with pytest.raises(dm.ConvergenceError):
        blocks.problem.solve(adaptive=load, max_cuts=2)
    assert 0.5 in calls
    np.testing.assert_array_equal(blocks.u1.x.array, before)

    blocks.drag(1.0)
    blocks.problem.solve()
    # Not node by node: the same mesh may be numbered otherwise when it is made again
    assert la.norm(blocks.u2.x) == pytest.approx(la.norm(expected.u2.x), rel=1e-9)
    np.testing.assert_allclose(blocks.contact.force, expected.contact.force, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(blocks.contact.moment, expected.contact.moment, rtol=1e-8, atol=1e-9)
