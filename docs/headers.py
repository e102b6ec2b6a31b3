# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""The directive `cpp-header`: all that a header declares, in its order.

Breathe has one for files as well, which declares the namespace anew for each of them.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective

_CLASSES = ("class", "struct")
_MEMBERS = ("function", "enum", "typedef", "variable")


def _location(element: Any) -> tuple[str, int]:
    found = element.find("location")
    return found.get("file"), int(found.get("line"))


def _declarations(folder: Path) -> Iterator[tuple[tuple[str, int], str, str]]:
    """Place, kind and name of what namespaces declare; of overloads with their arguments."""
    index = ElementTree.parse(folder / "index.xml").getroot()
    for entry in index.findall("compound"):
        if entry.get("kind") not in (*_CLASSES, "namespace"):
            continue
        compound = ElementTree.parse(folder / f"{entry.get('refid')}.xml").getroot()[0]
        name = compound.findtext("compoundname")
        if entry.get("kind") in _CLASSES:
            yield _location(compound), entry.get("kind"), name
            continue
        members = [m for m in compound.iter("memberdef") if m.get("kind") in _MEMBERS]
        number = Counter(m.findtext("name") for m in members)
        for member in members:
            title = f"{name}::{member.findtext('name')}"
            if member.get("kind") == "function" and number[member.findtext("name")] > 1:
                title += member.findtext("argsstring")
            yield _location(member), member.get("kind"), title


class Header(SphinxDirective):
    """What a header declares."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        folder = Path(os.environ["MORTAR_DOXYGEN"])
        wanted = f"dolfinx_mortar/{self.arguments[0]}"
        found = sorted(d for d in _declarations(folder) if d[0][0].endswith(wanted))
        if not found:
            raise self.error(f"There is nothing in {wanted}.")
        lines = []
        names = {name for _, _, name in found}
        for _, kind, name in found:
            # Classes within classes come with these
            if kind in _CLASSES and name.rpartition("::")[0] in names:
                continue
            lines += [f".. doxygen{kind}:: {name}"]
            lines += ["   :members:", "   :undoc-members:"] if kind in _CLASSES else []
            lines += [""]
        node = nodes.container()
        self.state.nested_parse(StringList(lines, wanted), 0, node)
        return node.children


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_directive("cpp-header", Header)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
