# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Formulas by KaTeX, whose files are copied into the site: it needs no network."""

from __future__ import annotations

import html
import shutil
from pathlib import Path
from typing import Any

from docutils import nodes

KATEX = Path("/usr/share/javascript/katex")
_RENDER = """
document.addEventListener("DOMContentLoaded", () => {
  for (const e of document.querySelectorAll(".math")) {
    katex.render(e.textContent, e, {displayMode: e.tagName === "DIV", throwOnError: false});
  }
});
"""


def _write(tag: str) -> Any:
    """A visitor that writes a formula as it is, for KaTeX to find."""

    def visit(self: Any, node: Any) -> None:
        self.body.append(self.starttag(node, tag, "", CLASS="math notranslate"))
        self.body.append(f"{html.escape(node.astext())}</{tag}>")
        raise nodes.SkipNode

    return visit


def _copy(app: Any, error: Exception | None) -> None:
    if error is not None:
        return
    target = Path(app.outdir) / "_static" / "katex"
    (target / "fonts").mkdir(parents=True, exist_ok=True)
    for name in ("katex.min.js", "katex.min.css"):
        shutil.copyfile(KATEX / name, target / name)
    for font in (KATEX / "fonts").glob("*.woff2"):
        shutil.copyfile(font, target / "fonts" / font.name)
    (target / "render.js").write_text(_RENDER)


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_html_math_renderer("katex", (_write("span"), None), (_write("div"), None))
    app.config.html_math_renderer = "katex"
    app.add_css_file("katex/katex.min.css")
    app.add_js_file("katex/katex.min.js")
    app.add_js_file("katex/render.js")
    app.connect("build-finished", _copy)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
