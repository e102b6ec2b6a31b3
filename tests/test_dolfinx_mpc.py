"""A tie, handed to dolfinx_mpc as constraints: the same displacements as those of the problem."""

from mpi4py import MPI

import blocks
import cases
import dolfinx_mortar as dm
import numpy as np
import pytest
import ufl
from dolfinx import fem

dolfinx_mpc = pytest.importorskip("dolfinx_mpc", reason="dolfinx_mpc is not installed")


@pytest.mark.parametrize("element", ["hex8", "tet10"])
def test_two_blocks(element):
    strain = 1e-3 * np.array([[1.0, 2, 0], [2, 3, 1], [0, 1, -2]])
    case = blocks.stressed_blocks(element, element, strain, one_mesh=True)
    u = cases.displacements(case)
    (tie,) = cases.make_interfaces(case)
    (F,) = cases.residuals(case, u)
    bcs = cases.DirichletConditions(case).bcs
    dm.ContactProblem(F, u[0], bcs=bcs, interfaces=[tie]).solve()

    V = u[0].function_space
    zero, trial = fem.Function(V), ufl.TrialFunction(V)
    mpc = dolfinx_mpc.MultiPointConstraint(V)
    mpc.add_constraint(V, *tie.constraints())
    mpc.finalize()
    tangent = ufl.replace(ufl.derivative(F, u[0], trial), {u[0]: zero})
    load = -ufl.replace(F, {u[0]: zero})
    options = {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}
    tied = dolfinx_mpc.LinearProblem(tangent, load, mpc, bcs=bcs, petsc_options=options).solve()
    n = 3 * V.dofmap.index_map.size_local
    difference = np.abs(tied.x.array[:n] - u[0].x.array[:n]).max(initial=0)
    scale = np.abs(u[0].x.array).max(initial=0)
    assert difference < 1e-9 * V.mesh.comm.allreduce(scale, MPI.MAX)
