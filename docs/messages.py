# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Errors and warnings of the library, collected from its sources.

`python3 docs/messages.py` prints what is in the sources and not in messages.toml, and what is in
messages.toml and no longer in the sources. Causes and cures are in messages.toml, keyed by a piece
of the message; what a message consists of is always that of the sources, with … in place of values.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomllib

ROOT = Path(__file__).parents[1]
#: What C++ exceptions are in Python
_KINDS = {
    "std::invalid_argument": "ValueError",
    "std::length_error": "ValueError",
    "std::runtime_error": "RuntimeError",
    "nanobind::index_error": "IndexError",
    "nb::type_error": "TypeError",
    "ConvergenceError": "ConvergenceError",
}


@dataclass(frozen=True)
class Message:
    """A message, or a part of one.

    Attributes:
        text: Its words, with … in place of what is put in.
        kind: Exception that Python sees, ``"warning"`` or ``"information"``; empty where the source
            has only the words, and raises them elsewhere.
        file: Source, relative to the root of the project.
    """

    text: str
    kind: str
    file: str


@dataclass(frozen=True)
class Entry:
    """Cause and cure of the messages in which a piece stands."""

    topic: str
    piece: str
    cause: str
    cure: str
    kind: str = ""


def collect() -> list[Message]:
    """All messages of the sources, in the order of files and lines."""
    found: list[Message] = []
    for path in sorted((ROOT / "python" / "dolfinx_mortar").rglob("*.py")):
        found += _of_python(path)
    for path in sorted((ROOT / "cpp" / "dolfinx_mortar").rglob("*.*")):
        found += _of_cpp(path, everything=True)
    for path in sorted((ROOT / "python").glob("*.*")):
        found += _of_cpp(path, everything=False)
    return list(dict.fromkeys(found))


def entries() -> list[Entry]:
    """What messages.toml says."""
    return [
        Entry(topic["title"], **entry) for topic in _data()["topic"] for entry in topic["message"]
    ]


def parts() -> list[str]:
    """Words that are parts of other messages, or none."""
    return _data()["parts"]


def _data() -> dict[str, Any]:
    return tomllib.loads(Path(__file__).with_suffix(".toml").read_text())


def assign(messages: list[Message], known: list[Entry]) -> dict[str, list[Message]]:
    """The messages of each entry, by its piece: each belongs to the longest piece in it.

    Those of the piece ``""`` have no entry.
    """
    words = parts()
    found: dict[str, list[Message]] = {"": [], **{e.piece: [] for e in known}}
    for message in messages:
        pieces = [piece for piece in found if piece in message.text]
        if not any(part in message.text and len(pieces) == 1 for part in words):
            found[max(pieces, key=len)].append(message)
    return found


# -- Python ----------------------------------------------------------------------------------------


def _of_python(path: Path) -> Iterator[Message]:
    """All sentences of a file that are not documentation."""
    name = str(path.relative_to(ROOT))

    def visit(node: ast.AST, kind: str) -> Iterator[Message]:
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            return  # documentation
        if isinstance(node, ast.Constant | ast.JoinedStr | ast.BinOp):
            words = _tidy(_rendered(node))
            if _is_sentence(words):
                yield Message(words, kind, name)
            return
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            kind = called if called.endswith("Error") else kind
            kind = "warning" if called == "warnings.warn" else kind
        for child in ast.iter_child_nodes(node):
            yield from visit(child, kind)

    yield from visit(ast.parse(path.read_text()), "")


def _rendered(node: ast.expr) -> str:
    """The words of an expression, with … for what is not literal."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(map(_rendered, node.values))
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _rendered(node.left) + _rendered(node.right)
    return "…"


# -- C++ -------------------------------------------------------------------------------------------

_TOKEN = re.compile(
    r"""//[^\n]*|/\*.*?\*/|^[ \t]*\#[^\n]*|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])+'""",
    re.DOTALL | re.MULTILINE,
)


def _of_cpp(path: Path, everything: bool) -> Iterator[Message]:
    """Messages of a file: of all statements with sentences in them, or of those that throw.

    Within the library sentences are messages. The bindings have documentation as well.
    """
    if path.suffix not in (".h", ".cpp"):
        return
    name = str(path.relative_to(ROOT))
    for statement, literals in _statements(path.read_text()):
        first = next((text for text in literals if text != "…"), "")
        words = _tidy("".join(literals)).strip("… ")
        # What is before a literal is code, or a value if the literal goes on from it
        words = f"… {words}" if first.startswith((" ", ":")) and words[:1].islower() else words
        thrown = re.search(r"\bthrow ([\w:]+)", statement)
        if _is_sentence(words) and (thrown or everything) and "PetscPrintf" not in statement:
            informs = re.search(r"\blog_info\b", statement)
            kind = _KINDS[thrown[1]] if thrown else "information" if informs else ""
            yield Message(words, kind, name)


def _statements(source: str) -> Iterator[tuple[str, list[str]]]:
    """Statements without their literals, and their literals, with … for what is between these."""
    statement, literals, at = "", [], 0

    def code(text: str) -> Iterator[tuple[str, list[str]]]:
        nonlocal statement, literals
        for part in re.split(r"([;{}])", text):
            if part in (";", "{", "}"):
                yield statement, literals
                statement, literals = "", []
            elif part.strip():
                statement += part
                literals.append("…")

    for match in _TOKEN.finditer(source):
        yield from code(source[at : match.start()])
        at = match.end()
        if match[0][0] == '"':
            literals.append(ast.literal_eval(match[0]))
    yield from code(source[at:])
    yield statement, literals


def _is_sentence(text: str) -> bool:
    return len(re.findall(r"[A-Za-z'_]{2,}[,:;]? ", text + " ")) >= 3


def _tidy(text: str) -> str:
    text = re.sub(r"%[.\d]*[defg]", "…", re.sub(r"\s+", " ", text))
    return re.sub(r"…(\s*…)+", "…", text).strip()


if __name__ == "__main__":
    assigned = assign(collect(), entries())
    for message in assigned.pop(""):
        print(f"no entry: {message.file}: {message.text}")
    for piece, of_entry in assigned.items():
        if not of_entry:
            print(f"no message: {piece}")
