# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Pictures of bodies, not all of which have the field that is shown."""

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem, mesh
from dolfinx_mortar import plotting

pytest.importorskip("pyvista")


def box(x, field):
    domain = mesh.create_box(
        MPI.COMM_SELF, [np.array([x, 0, 0]), np.array([x + 1, 1, 1])], [2, 2, 2]
    )
    f = fem.Function(fem.functionspace(domain, ("Lagrange", 1)))
    f.interpolate(lambda x: x[2])
    return plotting.surface(domain, {"height": f} if field else {})


@pytest.mark.serial
def test_a_body_without_the_field_is_grey(tmp_path):
    from PIL import Image

    surfaces = [box(0.0, True), box(1.5, False)]
    plotting.picture(tmp_path / "a.png", surfaces, "height", edges=False, view=(0, -1, 0))
    if not (tmp_path / "a.png").exists():
        pytest.skip("there is no screen")
    image = np.asarray(Image.open(tmp_path / "a.png").convert("RGB"), dtype=int)
    spread = image.max(axis=2) - image.min(axis=2)
    body = image.sum(axis=2) < 3 * 250
    left, right = (np.s_[:, :600], np.s_[:, 800:1250])
    assert (spread[left] > 40).any()
    assert body[right].any() and not (spread[right] > 40).any()


@pytest.mark.serial
def test_a_field_that_no_body_has(tmp_path):
    with pytest.raises(ValueError, match="'pressure'.*height"):
        plotting.picture(tmp_path / "a.png", [box(0.0, True)], "pressure")


def test_one_body_of_a_mesh():
    """Chosen cells have a boundary of their own, as those at chosen places; ranks may have none."""
    comm = MPI.COMM_WORLD
    domain = mesh.create_unit_cube(comm, 2, 2, 2, mesh.CellType.hexahedron)
    local = np.arange(domain.topology.index_map(3).size_local, dtype=np.int32)
    upper = local[mesh.compute_midpoints(domain, 3, local)[:, 2] > 0.5]
    a = plotting.surface(domain, cells=upper, subdivisions=1)
    b = plotting.surface(domain, where=lambda x: x[2] > 0.5, subdivisions=1)
    if comm.rank == 0:
        assert a.faces.n_cells == b.faces.n_cells == 2 * (2 * 4 + 4 * 2)
        assert a.faces.points[:, 2].min() == pytest.approx(0.5)
