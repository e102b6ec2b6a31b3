# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Pictures and files of deformed bodies, for the demos and for a first look.

Everything works in parallel: what is drawn is gathered on rank 0, which alone draws and writes.
Curved cells are drawn curved: their facets are cut into small triangles with the element's own
functions, so hex20, hex27 and tet10 look as they are.
"""

from .charts import convergence_plot
from .output import Writer, for_output
from .pictures import gif, picture
from .surfaces import Surface, surface

__all__ = ["Surface", "Writer", "convergence_plot", "for_output", "gif", "picture", "surface"]
