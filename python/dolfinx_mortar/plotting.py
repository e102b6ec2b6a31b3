# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Pictures and files of deformed bodies, for the demos and for a first look.

Everything works in parallel: what is drawn is gathered on rank 0, which alone draws and writes.
Curved cells are drawn curved: their facets are cut into small triangles with the element's own
functions, so hex20, hex27 and tet10 look as they are.
"""

from __future__ import annotations

import atexit
import ctypes
import os
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import basix
import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from dolfinx.mesh import Mesh

from . import compat
from .elements import is_hex20

__all__ = ["Surface", "Writer", "convergence_plot", "for_output", "gif", "picture", "surface"]


# -- Files for ParaView -----------------------------------------------------


def for_output(u: fem.Function) -> fem.Function:
    """A function that DOLFINx's writers accept: hex20 is interpolated into Q2, exactly.

    VTX and VTK files know Lagrange elements only. Q2 contains the serendipity space, so nothing
    is lost; the values at vertices and edge midpoints are the same numbers.

    Args:
        u: Any function.

    Returns:
        ``u`` itself, or its interpolation into Q2 with the same name.
    """
    V = u.function_space
    if not is_hex20(V.ufl_element()):
        return u
    element = basix.ufl.element("Lagrange", "hexahedron", 2, shape=compat.value_shape(V))
    w = fem.Function(fem.functionspace(V.mesh, element), name=u.name)
    w.interpolate(u)
    return w


class Writer:
    """Time series of functions in a VTX folder for ParaView (5.12 or later).

    Args:
        path: Folder to write, customarily ``*.bp``.
        functions: Functions with the same mesh and element, with different names. hex20 is
            written as Q2, see :func:`for_output`.
    """

    def __init__(self, path: str | Path, functions: Sequence[fem.Function]):
        from dolfinx.io import VTXWriter

        self._functions = [(u, for_output(u)) for u in functions]
        comm = functions[0].function_space.mesh.comm
        self._writer = VTXWriter(comm, str(path), [w for _, w in self._functions], "BP4")

    def write(self, t: float) -> None:
        """Write the functions as they are now, as time ``t``."""
        for u, w in self._functions:
            if w is not u:
                w.interpolate(u)
        self._writer.write(t)

    def close(self) -> None:
        """Finish the files."""
        self._writer.close()

    def __enter__(self) -> Writer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


# -- Surfaces ---------------------------------------------------------------


class Surface(NamedTuple):
    """A surface as triangles, and its cell edges as lines (``pyvista.PolyData``)."""

    faces: Any
    edges: Any


def _lattice(
    cell: basix.CellType, n: int
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Points, triangles and boundary lines of a reference facet that is cut n times."""
    triangle = cell == basix.CellType.triangle
    nodes = [(i, j) for j in range(n + 1) for i in range(n + 1 - j * triangle)]
    number = {node: k for k, node in enumerate(nodes)}
    triangles = []
    for i, j in nodes:
        corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
        here = [number.get(corner, -1) for corner in corners]
        if here[1] >= 0 and here[3] >= 0:
            triangles.append((here[0], here[1], here[3]))
            if here[2] >= 0:
                triangles.append((here[1], here[2], here[3]))
    steps = range(n + 1)
    lines = [[(i, 0) for i in steps], [(0, i) for i in steps]]
    if triangle:
        lines += [[(i, n - i) for i in steps]]
    else:
        lines += [[(i, n) for i in steps], [(n, i) for i in steps]]
    return (
        np.array(nodes) / n,
        np.array(triangles),
        np.array([[number[node] for node in line] for line in lines]),
    )


def _boundary(mesh: Mesh, where: Callable | None) -> npt.NDArray[np.int32]:
    """Boundary facets of the chosen cells as pairs (cell, local facet), owned cells only."""
    tdim = mesh.topology.dim
    mesh.topology.create_connectivity(tdim, tdim - 1)
    num_cells = mesh.topology.index_map(tdim).size_local
    cell_facets = mesh.topology.connectivity(tdim, tdim - 1).array
    cell_facets = cell_facets.reshape(len(compat.geometry_dofmap(mesh)), -1)[:num_cells]
    chosen = np.ones(num_cells, dtype=bool)
    if where is not None:
        centres = mesh.geometry.x[compat.geometry_dofmap(mesh)[:num_cells]].mean(axis=1)
        chosen = np.asarray(where(centres.T), dtype=bool)

    # The cell behind a facet may be on another rank.
    count = la.vector(mesh.topology.index_map(tdim - 1), 1, np.float64)
    count.array[:] = 0
    np.add.at(count.array, cell_facets[chosen].ravel(), 1)
    count.scatter_reverse(la.InsertMode.add)
    count.scatter_forward()
    pairs = np.argwhere(chosen[:, None] & (count.array[cell_facets] == 1))
    return pairs.astype(np.int32)


def _evaluate(
    u: fem.Function, cells: npt.NDArray[np.int32], X: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Values of a point-valued function at reference points, shape (cells, points, values)."""
    V = u.function_space
    element = V.ufl_element()
    dofmap = compat.dofmap(V)
    scalar = element.sub_elements[0] if element.block_size > 1 else element
    basis = scalar.basix_element.tabulate(0, X)[0, :, :, 0]
    values = u.x.array.reshape(-1, dofmap.index_map_bs)[dofmap.list[cells]]
    return np.einsum("qn,cnb->cqb", basis, values)


def surface(
    mesh: Mesh,
    fields: Mapping[str, fem.Function] | None = None,
    *,
    displacement: fem.Function | None = None,
    factor: float = 1.0,
    where: Callable[[npt.NDArray[np.float64]], npt.NDArray[np.bool_]] | None = None,
    facets: npt.NDArray[np.int32] | None = None,
    subdivisions: int | None = None,
) -> Surface | None:
    """The boundary of a mesh, deformed, with fields on it; collective.

    Args:
        mesh: A mesh of tetrahedra or hexahedra.
        fields: Functions to carry along, by name; nodal or cell-wise elements, scalars or
            vectors.
        displacement: Displacement [length] by which points are moved.
        factor: Its scale.
        where: Takes cell centres, shape ``(3, num_cells)``, and tells which cells to show; cuts
            open a body.
        facets: Show these facets only (indices on this rank, such as ``tags.find(3)``).
        subdivisions: Cuts per facet edge; by default 1 for straight facets and 4 for curved.

    Returns:
        The surface on rank 0, ``None`` elsewhere.
    """
    tdim = mesh.topology.dim
    cell_type = mesh.basix_cell()
    if subdivisions is None:
        elements = [mesh.ufl_domain().ufl_coordinate_element()]
        if displacement is not None:
            elements.append(displacement.function_space.ufl_element())
        straight = all(element.embedded_superdegree == 1 for element in elements)
        subdivisions = 1 if straight and cell_type == basix.CellType.tetrahedron else 4

    pairs = _boundary(mesh, where)
    if facets is not None:
        local = mesh.topology.connectivity(tdim, tdim - 1)
        shown = np.array([local.links(cell)[i] for cell, i in pairs], np.int32)
        pairs = pairs[np.isin(shown, facets)]

    vertices = basix.geometry(cell_type)
    nodes = compat.geometry_dofmap(mesh)
    coordinates = mesh.ufl_domain().ufl_coordinate_element().sub_elements[0].basix_element
    fields = dict(fields or {})
    # DOLFINx's cells may be left-handed; triangles are to be numbered as seen from outside.
    axes = mesh.geometry.x[nodes[pairs[:, 0]][:, [1, 2, 3 if len(vertices) == 4 else 4]]]
    handed = np.linalg.det(axes - mesh.geometry.x[nodes[pairs[:, 0], :1]])
    normals = basix.cell.facet_outward_normals(cell_type)
    points, triangles, lines = [], [], []
    values: dict[str, list] = {name: [] for name in fields}
    offset = 0
    for i, corners in enumerate(basix.topology(cell_type)[tdim - 1]):
        reference, facet_triangles, facet_lines = _lattice(
            basix.cell.subentity_types(cell_type)[tdim - 1][i], subdivisions
        )
        origin, a, b = vertices[corners[:3]]
        X = origin + reference @ np.array([a - origin, b - origin])
        cells = pairs[pairs[:, 1] == i, 0]
        outward = np.cross(a - origin, b - origin) @ normals[i] * handed[pairs[:, 1] == i] > 0
        basis = coordinates.tabulate(0, X)[0, :, :, 0]
        x = np.einsum("qn,cnd->cqd", basis, mesh.geometry.x[nodes[cells]])
        if displacement is not None:
            x = x + factor * _evaluate(displacement, cells, X)
        shift = offset + len(X) * np.arange(len(cells))[:, None, None]
        points.append(x.reshape(-1, 3))
        facing = np.where(outward[:, None, None], facet_triangles, facet_triangles[:, ::-1])
        triangles.append((facing + shift).reshape(-1, 3))
        lines.append((facet_lines + shift).reshape(-1, subdivisions + 1))
        offset += len(X) * len(cells)
        for name, u in fields.items():
            value = _evaluate(u, cells, X)
            values[name].append(value.reshape(len(X) * len(cells), value.shape[2]))

    parts = mesh.comm.gather(
        [np.concatenate(part) for part in (points, triangles, lines, *values.values())]
    )
    if parts is None:
        return None

    import pyvista as pv

    start = np.cumsum([0] + [len(part[0]) for part in parts])
    all_points = np.concatenate([part[0] for part in parts])
    all_triangles = np.concatenate([part[1] + s for part, s in zip(parts, start)])
    all_lines = np.concatenate([part[2] + s for part, s in zip(parts, start)])
    faces = pv.PolyData(all_points, faces=np.insert(all_triangles, 0, 3, axis=1).ravel())
    edges = pv.PolyData(all_points, lines=np.insert(all_lines, 0, subdivisions + 1, axis=1).ravel())
    for k, name in enumerate(fields):
        value = np.concatenate([part[3 + k] for part in parts])
        faces.point_data[name] = value[:, 0] if value.shape[1] == 1 else value
    return Surface(faces, edges)


# -- Pictures -----------------------------------------------------------------


def _display() -> bool:
    """Make sure that VTK can draw; on a machine without a screen by a virtual one."""
    if not sys.platform.startswith("linux") or os.environ.get("DISPLAY"):
        return True
    from vtkmodules.vtkCommonCore import vtkVersion

    if (vtkVersion.GetVTKMajorVersion(), vtkVersion.GetVTKMinorVersion()) >= (9, 5):
        return True  # falls back to EGL or OSMesa by itself
    if shutil.which("Xvfb") is None:
        warnings.warn("no picture: there is no screen, and Xvfb is not installed", stacklevel=3)
        return False

    def end_with_parent() -> None:
        # Also when Python is killed and cannot clean up: prctl(PR_SET_PDEATHSIG, SIGTERM)
        ctypes.CDLL(None).prctl(1, 15)

    read, write = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", "1280x1024x24", "-nolisten", "tcp"],
        pass_fds=(write,),
        preexec_fn=end_with_parent,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(write)
    with os.fdopen(read) as pipe:
        number = pipe.readline().strip()
    if not number:
        warnings.warn("no picture: there is no screen, and Xvfb does not start", stacklevel=3)
        return False
    atexit.register(server.terminate)
    os.environ["DISPLAY"] = f":{number}"
    return True


def picture(
    path: str | Path,
    surfaces: Sequence[Surface | None],
    scalars: str | None = None,
    *,
    component: int | None = None,
    label: str | None = None,
    clim: tuple[float, float] | None = None,
    cmap: str = "viridis",
    edges: bool = True,
    view: tuple[float, float, float] = (1.0, -1.6, 0.9),
    up: tuple[float, float, float] = (0.0, 0.0, 1.0),
    zoom: float = 1.0,
    title: str | None = None,
    size: tuple[int, int] = (1500, 1000),
) -> None:
    """Draw surfaces, all with one colour scale, into a PNG file.

    Args:
        path: File to write, by rank 0.
        surfaces: From :func:`surface`; on other ranks than 0 nothing happens.
        scalars: Name of the field that colours them; grey if ``None``, and where a surface has
            no such field.
        component: Component of a vector field; its length if ``None``.
        label: Title of the colour bar.
        clim: Range of colours, by default that of the field.
        cmap: Colour map of matplotlib.
        edges: Whether to draw the cells' edges.
        view: Direction from the bodies to the eye.
        up: Direction that points up.
        zoom: Magnification.
        title: Text above the picture.
        size: Pixels.

    Raises:
        ValueError: No surface has the field.
    """
    shown = [part for part in surfaces if part is not None]
    names = {name for faces, _ in shown for name in faces.point_data.keys()}
    if shown and scalars is not None and scalars not in names:
        raise ValueError(
            f"No surface has a field {scalars!r}, they have {', '.join(sorted(names)) or 'none'}: "
            "hand it to surface(..., fields={...}) under this name."
        )
    if not shown or not _display():
        return
    import pyvista as pv

    plotter = pv.Plotter(off_screen=True, window_size=list(size))
    plotter.set_background("white")
    drawn, low, high = [], np.inf, -np.inf
    for faces, lines in shown:
        coloured = scalars is not None and scalars in faces.point_data.keys()
        if coloured:
            values = np.asarray(faces.point_data[scalars])
            if values.ndim == 2:
                length = np.linalg.norm(values, axis=1)
                values = length if component is None else values[:, component]
            faces = faces.copy()
            faces.point_data.clear()
            faces.point_data["shown"] = values
            if values.size:
                low, high = min(low, values.min()), max(high, values.max())
        drawn.append((faces, lines, coloured))
    if clim is None and scalars is not None:
        # Round-off would otherwise be written at the end of the colour bar.
        clim = tuple(0.0 if abs(end) < 1e-9 * (high - low) else end for end in (low, high))
    bar = dict(
        title=f"{label or scalars}\n",
        color="black",
        title_font_size=int(size[1] * 0.03),
        label_font_size=int(size[1] * 0.024),
        n_labels=5,
        fmt="%.3g",
        vertical=True,
        position_x=0.89,
        position_y=0.2,
        width=0.05,
        height=0.6,
    )
    for faces, lines, coloured in drawn:
        if faces.n_points == 0:
            continue
        plotter.add_mesh(
            faces,
            scalars="shown" if coloured else None,
            clim=clim,
            cmap=cmap if coloured else None,
            color=None if coloured else "lightgrey",
            smooth_shading=False,
            ambient=0.35,
            diffuse=0.75,
            scalar_bar_args=bar,
            show_scalar_bar=coloured,
        )
        if edges:
            plotter.add_mesh(lines, color="black", line_width=1.5)
    if title:
        plotter.add_text(title, position="upper_edge", font_size=14, color="black")
    plotter.enable_anti_aliasing("ssaa")
    plotter.camera.focal_point = plotter.center
    plotter.camera.position = np.asarray(plotter.center) + np.asarray(view)
    plotter.camera.up = up
    plotter.reset_camera()
    plotter.camera.zoom(1.25 * zoom)
    plotter.screenshot(str(path))
    plotter.close()


def gif(path: str | Path, pictures: Sequence[str | Path], seconds: float = 0.1) -> None:
    """Join pictures to an endless animation; call on one rank.

    Args:
        path: GIF file to write.
        pictures: PNG files in order, all of one size.
        seconds: Time that each is shown [s].
    """
    from PIL import Image

    frames = [Image.open(name).convert("RGB") for name in pictures if Path(name).exists()]
    if not frames:
        return
    # One palette for all frames keeps colours from flickering.
    palette = frames[-1].quantize(255)
    frames = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    frames[0].save(
        path, save_all=True, append_images=frames[1:], duration=int(1000 * seconds), loop=0
    )


def convergence_plot(
    path: str | Path,
    panels: Mapping[str, Mapping[str, tuple[Sequence[float], Sequence[float]]]],
    *,
    xlabel: str = "$h$",
    ylabel: str = "error",
    slopes: Sequence[float] = (),
    styles: Mapping[str, Mapping[str, Any]] | None = None,
) -> None:
    """Log-log plot of errors against mesh size, one panel beside the other; call on one rank.

    Args:
        path: PNG file to write.
        panels: Title of the panel to its curves: name to ``(h, errors)``. The order found between
            the two finest meshes is added to each name.
        xlabel: Label of the horizontal axes.
        ylabel: Label of the vertical axis.
        slopes: Orders to compare with; a triangle is drawn under curves that come near.
        styles: Keyword arguments of matplotlib's ``plot`` for some of the names.
    """
    import matplotlib

    matplotlib.use("Agg", force=False)
    import matplotlib.pyplot as plt

    panels = {title: curves for title, curves in panels.items() if curves}
    fig, axes = plt.subplots(
        1, len(panels), figsize=(5.0 * len(panels), 5.6), sharey=True, squeeze=False
    )
    for axis, (title, curves) in zip(axes[0], panels.items()):
        for name, (h, errors) in curves.items():
            h, errors = np.asarray(h, float), np.asarray(errors, float)
            order = ""
            if len(h) > 1:
                order = f"  ({np.log(errors[-2] / errors[-1]) / np.log(h[-2] / h[-1]):.2f})"
            style = {"marker": "o", **(styles or {}).get(name, {})}
            axis.loglog(h, errors, label=name + order, **style)
        _slope_triangles(axis, curves, slopes)
        axis.set(title=title, xlabel=xlabel)
        axis.grid(True, which="both", alpha=0.25)
        axis.legend(
            title="(order between the two finest)",
            fontsize=8,
            title_fontsize=8,
            ncols=2,
            loc="upper center",
            bbox_to_anchor=(0.5, -0.12),
            frameon=False,
        )
        for side in ("top", "right"):
            axis.spines[side].set_visible(False)
    axes[0, 0].set_ylabel(ylabel)
    fig.tight_layout()
    fig.savefig(path, dpi=150)
    plt.close(fig)


def _slope_triangles(
    axis: Any,
    curves: Mapping[str, tuple[Sequence[float], Sequence[float]]],
    slopes: Sequence[float],
) -> None:
    """Triangles for comparison, each under the lowest of the curves that are nearest to it."""
    lowest: dict[float, tuple[float, float, float]] = {}
    for h, errors in curves.values():
        if len(h) > 1 and min(errors) > 0 and slopes:
            found = np.log(errors[-2] / errors[-1]) / np.log(h[-2] / h[-1])
            slope = min(slopes, key=lambda s: abs(s - found))
            here = (errors[-1], h[-1], h[-2])
            lowest[slope] = min(lowest.get(slope, here), here)
    for slope, (error, left, right) in lowest.items():
        low = 0.55 * error
        left, right = 1.15 * left, 1.15 * left * (right / left) ** 0.75
        high = low * (right / left) ** slope
        axis.plot([left, right, right, left], [low, low, high, low], color="0.4", linewidth=1)
        axis.text(np.sqrt(left * right), low * 0.93, "1", ha="center", va="top", fontsize=8)
        axis.text(right * 1.04, np.sqrt(low * high), f"{slope:g}", va="center", fontsize=8)
