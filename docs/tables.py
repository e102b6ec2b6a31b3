# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Directives that make tables of what is read from the sources."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

import defaults
import messages
from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective


def _plain(text: str) -> str:
    """Text whose characters mean nothing to Markdown."""
    return re.sub(r"([\\`*_\[\]<>$#|{}~])", r"\\\1", text)


class _Table(SphinxDirective):
    """A table of Markdown cells."""

    optional_arguments = 1
    final_argument_whitespace = True
    head: tuple[str, ...] = ()
    widths: tuple[int, ...] = ()

    def rows(self) -> Iterable[Sequence[str]]:
        raise NotImplementedError

    def run(self) -> list[nodes.Node]:
        table = nodes.table(classes=["colwidths-given", "from-sources"])
        group = nodes.tgroup(cols=len(self.head))
        table += group
        for width in self.widths:
            group += nodes.colspec(colwidth=width)
        for part, rows in ((nodes.thead(), [self.head]), (nodes.tbody(), self.rows())):
            part += [self._row(cells) for cells in rows]
            group += part
        return [table]

    def _row(self, cells: Sequence[str]) -> nodes.row:
        row = nodes.row()
        for cell in cells:
            entry = nodes.entry()
            lines = StringList(cell.split("\n"), self.env.doc2path(self.env.docname))
            self.state.nested_parse(lines, 0, entry)
            row += entry
        return row


class Messages(_Table):
    """Messages of one topic, with causes and cures."""

    head = ("Message", "Cause and cure")
    widths = (55, 45)

    def rows(self) -> Iterable[Sequence[str]]:
        known = messages.entries()
        assigned = messages.assign(messages.collect(), known)
        for entry in known:
            if entry.topic == self.arguments[0]:
                yield self._cells(entry, assigned[entry.piece])

    def _cells(self, entry: messages.Entry, found: list[messages.Message]) -> tuple[str, str]:
        texts = dict.fromkeys(_plain(m.text) for m in found)
        kinds = dict.fromkeys(m.kind for m in found if m.kind)
        files = dict.fromkeys(m.file for m in found)
        names = ", ".join(f"`{f.removeprefix('cpp/').removeprefix('python/')}`" for f in files)
        kind = entry.kind or ", ".join(kinds)
        return (
            "\n\n".join(texts) + f"\n\n*{kind}*, {names}",
            f"{entry.cause}\n\n{entry.cure}",
        )


class Defaults(_Table):
    """Defaults of the arguments of a call, or of a group of PETSc options."""

    head = ("Name", "Default", "What it changes and costs")
    widths = (31, 19, 50)

    def rows(self) -> Iterable[Sequence[str]]:
        name = self.arguments[0]
        if name.startswith("petsc."):
            group = name.removeprefix("petsc.")
            values, texts = defaults.of_options(group), defaults.effects()["petsc"][group]
        else:
            values, texts = defaults.of_call(name), defaults.effects()["call"][name]
        for argument, value in values.items():
            yield f"`{argument}`", f"`{value}`", texts[argument]


class Fixed(_Table):
    """Numbers that the sources fix."""

    head = ("Name and file", "Value", "What it is")
    widths = (36, 14, 50)

    def rows(self) -> Iterable[Sequence[str]]:
        for n in defaults.fixed_numbers():
            yield f"`{n.name}`\n\n`{n.file}`", f"`{n.value}`", _plain(n.comment)


class Degrees(_Table):
    """Degrees of quadrature by pairs of facets."""

    head = ("Slave", *(f"on {m}" for m in defaults.FACETS))
    widths = (25, 15, 15, 15, 15, 15)

    def rows(self) -> Iterable[Sequence[str]]:
        degrees = defaults.quadrature_degrees()
        for slave in defaults.FACETS:
            yield (slave, *(str(degrees[slave, master]) for master in defaults.FACETS))


class Equations(_Table):
    """Equations of the paper that the sources name, and the files that do."""

    head = ("Equation", "Files")
    widths = (20, 80)

    def rows(self) -> Iterable[Sequence[str]]:
        files: dict[tuple[int, int], dict[str, None]] = {}
        for path in sorted(defaults.CPP.glob("*/*.*")):
            # A comment may break the line between the word and its numbers
            text = re.sub(r"\s*\n\s*///? ?", " ", path.read_text())
            for numbers in re.findall(r"equations? ((?:\d\.\d+(?:, | and | to )?)+)", text):
                for chapter, number in re.findall(r"(\d)\.(\d+)", numbers):
                    name = str(path.relative_to(defaults.CPP))
                    files.setdefault((int(chapter), int(number)), {})[name] = None
        for (chapter, number), names in sorted(files.items()):
            yield f"({chapter}.{number})", ", ".join(f"`{name}`" for name in names)


class Demo(SphinxDirective):
    """What a demo shows, in its own words; its command, picture and results."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        name = self.arguments[0]
        source = defaults.ROOT / "demos" / f"demo_{name}.py"
        gallery = defaults.ROOT / "docs" / "gallery"
        command = ["```text", f"./run python3 demos/{source.name}", "```"]
        lines = [*_introduction(source.read_text()), "", *command, ""]
        pictures = {gallery / f"{name}.png": "gallery", source.with_name(f"{name}.png"): "../demos"}
        found = [f"{folder}/{path.name}" for path, folder in pictures.items() if path.exists()]
        if found:
            lines += [f"![Picture of {source.name}]({found[0]})", ""]
        results = gallery / f"{name}.md"
        if results.exists():
            lines += results.read_text().splitlines()
        node = nodes.container()
        self.state.nested_parse(StringList(lines, str(source)), 0, node)
        return node.children


def _introduction(source: str) -> list[str]:
    """The text of a demo below its title, up to the next section."""
    text = [line for line in source.split("\n# +\n")[0].splitlines() if line.startswith("#")]
    words = [line.removeprefix("#").removeprefix(" ") for line in text]
    begin = next(k for k, line in enumerate(words) if line.startswith("# ")) + 1
    words = words[begin:]
    end = next((k for k, line in enumerate(words) if line.startswith("## ")), len(words))
    paragraphs = "\n".join(words[:end]).split("\n\n")
    kept = [p for p in paragraphs if not p.strip().startswith("Run it with")]
    return "\n\n".join(kept).splitlines()


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_directive("messages", Messages)
    app.add_directive("defaults", Defaults)
    app.add_directive("fixed-numbers", Fixed)
    app.add_directive("demo", Demo)
    app.add_directive("equations", Equations)
    app.add_directive("quadrature-degrees", Degrees)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
