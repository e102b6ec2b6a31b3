# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Pictures of surfaces, and films of pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .display import make_display
from .surfaces import Surface


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
    if not shown or not make_display():
        return
    drawn = [_coloured(faces, scalars, component) for faces, _ in shown]
    if clim is None and scalars is not None:
        clim = _limits(drawn)
    _draw(
        path,
        [(faces, lines) for faces, (_, lines) in zip(drawn, shown) if faces.n_points > 0],
        {"clim": clim, "cmap": cmap, "scalar_bar_args": _bar(label or scalars, size[1])},
        edges=edges,
        camera=(view, up, zoom),
        title=title,
        size=size,
    )


#: Name of the values that colour a surface
_SHOWN = "shown"


def _coloured(faces: Any, scalars: str | None, component: int | None) -> Any:
    """Faces with the values that colour them and no others."""
    values = np.asarray(faces.point_data[scalars]) if scalars in faces.point_data.keys() else None
    faces = faces.copy()
    faces.point_data.clear()
    if values is not None:
        if values.ndim == 2:
            length = np.linalg.norm(values, axis=1)
            values = length if component is None else values[:, component]
        faces.point_data[_SHOWN] = values
    return faces


def _limits(surfaces: Sequence[Any]) -> tuple[float, float]:
    """Smallest and largest value; round-off would be written at the end of the colour bar."""
    coloured = [faces for faces in surfaces if _SHOWN in faces.point_data.keys()]
    values = np.concatenate([faces.point_data[_SHOWN] for faces in coloured])
    low, high = (values.min(), values.max()) if values.size else (np.inf, -np.inf)
    tiny = 1e-9 * (high - low)
    return (0.0 if abs(low) < tiny else low), (0.0 if abs(high) < tiny else high)


def _bar(label: str | None, height: int) -> dict[str, Any]:
    """The colour bar of a picture of some height."""
    return {
        "title": f"{label}\n",
        "color": "black",
        "title_font_size": int(height * 0.03),
        "label_font_size": int(height * 0.024),
        "n_labels": 5,
        "fmt": "%.3g",
        "vertical": True,
        "position_x": 0.89,
        "position_y": 0.2,
        "width": 0.05,
        "height": 0.6,
    }


def _draw(
    path: str | Path,
    surfaces: Sequence[tuple[Any, Any]],
    colours: dict[str, Any],
    *,
    edges: bool,
    camera: tuple[Sequence[float], Sequence[float], float],
    title: str | None,
    size: tuple[int, int],
) -> None:
    """Draw faces, and their lines, into a file.

    Args:
        path: PNG file.
        surfaces: Faces with or without values, and lines.
        colours: How values become colours.
        edges: Whether to draw the lines.
        camera: Direction to the eye, direction that points up, magnification.
        title: Text above the picture.
        size: Pixels.
    """
    import pyvista as pv

    plotter = pv.Plotter(off_screen=True, window_size=list(size))
    plotter.set_background("white")
    for faces, lines in surfaces:
        coloured = _SHOWN in faces.point_data.keys()
        kind = {"scalars": _SHOWN, **colours} if coloured else {"color": "lightgrey"}
        look = {"smooth_shading": False, "ambient": 0.35, "diffuse": 0.75}
        mapper = plotter.add_mesh(faces, show_scalar_bar=coloured, **kind, **look).mapper
        # A little behind the lines that lie on them, or the lines would be broken
        mapper.SetResolveCoincidentTopologyToPolygonOffset()
        mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(1.0, 4.0)
        if edges:
            plotter.add_mesh(lines, color="black", line_width=1.5)
    if title:
        plotter.add_text(title, position="upper_edge", font_size=14, color="black")
    plotter.enable_anti_aliasing("ssaa")
    view, up, zoom = camera
    plotter.camera.focal_point = plotter.center
    plotter.camera.position = np.asarray(plotter.center) + np.asarray(view)
    plotter.camera.up = up
    plotter.reset_camera()
    plotter.camera.zoom(1.25 * zoom)
    # In the middle of what title and colour bar leave
    bar = any(_SHOWN in faces.point_data.keys() for faces, _ in surfaces)
    plotter.camera.SetWindowCenter(0.1 * bar, 0.06 * bool(title))
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
