"""The C++ demos, built in a clean folder against an installed library."""

import re
import shutil
import sys
from pathlib import Path

from mpi4py import MPI

import dolfinx_mortar as dm
import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from programs import BUILD, run

DEMO = Path(__file__).parents[1] / "demos" / "cpp"

pytestmark = [pytest.mark.serial, pytest.mark.slow]


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    if not (BUILD / "CMakeCache.txt").is_file() or shutil.which("cmake") is None:
        pytest.skip("needs the CMake build folder that dolfinx_mortar was imported from")
    folder = tmp_path_factory.mktemp("cpp_demo")
    prefix, work = folder / "prefix", folder / "build"
    run("cmake", "--install", BUILD, "--prefix", prefix)
    assert not list(prefix.rglob("*.cpp"))
    paths = f"-DCMAKE_PREFIX_PATH={prefix};{sys.prefix}"
    # With assertions; without optimisation, as the compiler takes longest
    run("cmake", "-G", "Ninja", "-S", DEMO, "-B", work, paths, "-DCMAKE_CXX_FLAGS_RELEASE=-O0")
    run("cmake", "--build", work)
    return work


def test_matrices(programs):
    found = []
    for ranks in (1, 2, 3):
        output = run("mpirun", "-n", ranks, programs / "matrices")
        numbers = [float(n) for n in re.findall(r": +([-+.e0-9]+)", output)]
        assert len(numbers) >= 5, output
        multipliers, norm_d, norm_m, difference, area = numbers[:5]
        assert multipliers == 49  # Q2 on 3 x 3 facets
        assert difference < 1e-14
        assert area == pytest.approx(0.49, rel=1e-12)
        found.append((norm_d, norm_m))
    assert found[1] == pytest.approx(found[0], rel=1e-11)
    assert found[2] == pytest.approx(found[0], rel=1e-11)


def create_block(low, high, cells, mu, lmbda):
    domain = mesh.create_box(MPI.COMM_SELF, [low, high], cells, mesh.CellType.hexahedron)
    facets = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 1))
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 2, (3,))))
    G = ufl.Identity(3) + ufl.grad(u)
    ln_det = ufl.ln(ufl.det(G))
    mu, lmbda = fem.Constant(domain, mu), fem.Constant(domain, lmbda)  # one form for both blocks
    energy = mu / 2 * (ufl.inner(G, G) - 3 - 2 * ln_det) + lmbda / 2 * ln_det**2
    return u, mesh.meshtags(domain, 2, facets, 1), ufl.derivative(energy * ufl.dx(degree=4), u)


def prescribe(u, z, value):
    dofs = fem.locate_dofs_geometrical(u.function_space, lambda x: np.isclose(x[2], z))
    return fem.dirichletbc(value, dofs, u.function_space)


def solve_in_python():
    """What a line of `contact` shows, for each step: numbers of nodes and iterations, values."""
    u1, tags1, F1 = create_block([0.2, 0.2, 1.0], [0.8, 0.8, 1.5], [3, 3, 2], 50.0, 75.0)
    u2, tags2, F2 = create_block([0.0, 0.0, 0.5], [1.2, 1.0, 1.0], [4, 4, 2], 200.0, 300.0)
    motion = fem.Constant(u1.function_space.mesh, [0.0, 0.0, 0.0])
    rest = fem.Constant(u2.function_space.mesh, [0.0, 0.0, 0.0])
    bcs = [prescribe(u1, 1.5, motion), prescribe(u2, 0.5, rest)]
    spaces = (u1.function_space, u2.function_space)
    contact = dm.Contact(spaces, (tags1, tags2), slave=1, master=1, friction=0.3)
    options = {"snes_rtol": 1e-12}
    steps = []
    with dm.ContactProblem(
        [F1, F2], [u1, u2], bcs=bcs, interfaces=[contact], petsc_options=options
    ) as problem:
        for x, down in [(0, 0.02), (0, 0.04), (0.02, 0.04), (0.04, 0.04), (0.06, 0.04)]:
            motion.value = [x, 0, -down]
            iterations = problem.solve()
            status = contact.state.status
            numbers = [len(steps) + 1, iterations, np.sum(status == 1), np.sum(status == 2)]
            steps.append((numbers, contact.force, contact.pressure.x.array.max()))
    return steps


NUMBER = r"([-+.e0-9]+)"
LINE = re.compile(
    f"step: {NUMBER}, iterations: {NUMBER}, force: {NUMBER} {NUMBER} {NUMBER}, "
    f"stick: {NUMBER}, slip: {NUMBER}, largest pressure: {NUMBER}\n"
)


def test_contact_agrees_with_python(programs, tmp_path):
    steps = solve_in_python()
    sticking, slipping = zip(*[numbers[2:] for numbers, _, _ in steps])
    assert max(sticking) > 0 and sticking[-1] == 0  # the block is dragged until it slides
    assert max(slipping) == 49
    for ranks in (1, 2, 3):
        folder = tmp_path / str(ranks)
        folder.mkdir()
        output = run("mpirun", "-n", ranks, programs / "contact", cwd=folder)
        found = [[float(n) for n in line] for line in LINE.findall(output)]
        assert len(found) == len(steps), output
        for line, (numbers, force, pressure) in zip(found, steps, strict=True):
            step, iterations, fx, fy, fz, stick, slip, largest = line
            assert [step, iterations, stick, slip] == numbers
            size = np.linalg.norm(force)
            np.testing.assert_allclose([fx, fy, fz], force, rtol=1e-10, atol=1e-10 * size)
            assert largest == pytest.approx(pressure, rel=1e-10)
        for name in "upper", "lower":
            assert any((folder / f"{name}.bp").iterdir())
