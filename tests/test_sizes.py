# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Files and functions are short enough to be read at once."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PYTHON = sorted((ROOT / "python").rglob("*.py"))
CPP = sorted(
    p for d in ("cpp", "python") for p in (ROOT / d).rglob("*") if p.suffix in (".h", ".cpp")
)

#: Largest numbers of lines
FILE, PYTHON_FUNCTION, CPP_FUNCTION = 500, 60, 90

pytestmark = pytest.mark.serial


def without_text(source):
    """Source without comments, literals and preprocessor lines, each line where it was."""
    pattern = r'//[^\n]*|/\*.*?\*/|R"\((?:.*?)\)"|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])+\''
    pattern += r"|(?<=\n)[ \t]*#(?:\\\n|[^\n])*"

    def blank(match):
        # An apostrophe between digits separates thousands
        before = source[match.start() - 1] if match.start() else " "
        if match[0][0] == "'" and before.isalnum():
            return match[0]
        literal = "0" if match[0][0] in "R'\"" else " "
        return literal + "\n" * match[0].count("\n")

    return re.sub(pattern, blank, "\n" + source, flags=re.DOTALL)[1:]


def cpp_functions(source):
    """Function bodies at namespace or class level: first words, first and last line."""
    text = without_text(source)
    scopes, functions = [], []  # what each open brace belongs to
    parentheses, head, first, after, line = 0, "", 1, None, 1
    for k, c in enumerate(text):
        line += c == "\n"
        outside = all(kind == "scope" for kind, _, _ in scopes)
        if c == "{":
            words = re.sub(r"template\s*<[^{]*?>\s*(?=class|struct)", "", head).strip()
            if not outside or parentheses:
                scopes.append(("block", "", 0))
            elif after:  # an initialiser list goes on, or ends and the body begins
                scopes.append(("function", *after))
                after = None
            elif re.match(r"(inline\s+)?(namespace|class|struct|union|extern)\b", words):
                scopes.append(("scope", "", 0))
            else:
                scopes.append(("function" if ")" in words else "block", words, first))
        elif c == "}":
            kind, words, begin = scopes.pop()
            if kind == "function" and re.match(r"\s*[,{]", text[k + 1 :]):
                after = words, begin
            elif kind == "function":
                functions.append((words.split("\n")[0], begin, line))
        elif outside and c in "()":
            parentheses += 1 if c == "(" else -1
        if c in "{};" and not parentheses:
            head = ""
        elif outside and (head or not c.isspace()):
            first = first if head else line
            head += c
        if re.match(r"(public|private|protected)\s*:$", head):
            head = ""
    assert not scopes, "braces do not balance"
    return functions


def test_the_counter():
    source = """
#define BRACE {
namespace a
{
/// A comment {
template <typename T>
struct S : Base<T>
{
  S(int n)
      : x{n}, y(f({1, 2}))
  {
    g('{', "}", 1'000);
  }
  int x = 3;
  std::vector<int> z{1, 2};
};

enum class E
{
  one
};

template <typename F>
auto apply(F f, std::vector<int> v = {})
    -> int
{
  auto inner = [&](int i)
  {
    return i;
  };
  if (true)
  {
  }
  return inner(0);
}

const auto global = [](int i)
{ return i; };
} // namespace a
"""
    found = [last - first + 1 for _, first, last in cpp_functions(source)]
    assert found == [5, 13, 2]


@pytest.mark.parametrize("path", PYTHON + CPP, ids=lambda p: str(p.relative_to(ROOT)))
def test_files(path):
    assert len(path.read_text().splitlines()) <= FILE


@pytest.mark.parametrize("path", PYTHON, ids=lambda p: str(p.relative_to(ROOT)))
def test_python_functions(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            lines = node.end_lineno - node.lineno + 1
            assert lines <= PYTHON_FUNCTION, f"{node.name} has {lines} lines"


@pytest.mark.parametrize("path", CPP, ids=lambda p: str(p.relative_to(ROOT)))
def test_cpp_functions(path):
    for name, first, last in cpp_functions(path.read_text()):
        lines = last - first + 1
        assert lines <= CPP_FUNCTION, f"{name}, line {first}, has {lines} lines"
