"""What the documentation says: its code runs, its files are there, its tables are complete."""

import ast
import os
import re
import sys
import textwrap
from pathlib import Path

import dolfinx_mortar as dm
import pytest

pytest.importorskip("tomllib", reason="Python is older than 3.11")

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS))

import code_of_pages  # noqa: E402
import defaults  # noqa: E402
import messages  # noqa: E402

PAGES = sorted(p for p in DOCS.rglob("*.md") if p.parent.name != "gallery")
TEXT = {page: page.read_text() for page in [*PAGES, ROOT / "README.md", ROOT / "CONTRIBUTING.md"]}
MODEL = DOCS / "howto" / "model.md"

pytestmark = pytest.mark.serial


def name_of(page):
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize(
    "page", [p for p in PAGES if code_of_pages.blocks(p) and p != MODEL], ids=name_of
)
def test_code(page, tmp_path, monkeypatch):
    """Blocks of a page share their names; those of how-to's go on from those of the model."""
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "page"}
    for source in [MODEL, page] if page.parent == MODEL.parent else [page]:
        for k, block in enumerate(code_of_pages.blocks(source)):
            exec(compile(block, f"{name_of(source)}, block {k + 1}", "exec"), names)


def test_every_block_is_run():
    """A fence in another spelling, or indented, would not be found."""
    for page in PAGES:
        marked = re.findall(r"```\s*\{?(?:code-block\}? *)?py", TEXT[page])
        assert len(marked) == len(code_of_pages.blocks(page)), page


COMMANDS = r"(\./run|python3|pip|mpirun|conda|apt-get|cmake|env/bin/pip|MORTAR_)"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_indented_code(page):
    """What is indented are commands, or a piece of Python whose names of the package exist."""
    import dolfinx_mortar as dm
    import dolfinx_mortar.mesh

    text = re.sub(r"^```.*?^```", "", TEXT[page], flags=re.DOTALL | re.MULTILINE)
    for block in re.findall(r"(?:^|\n\n)((?:    .*\n?|\n)+)", text):
        code = textwrap.dedent(block.strip("\n"))
        if not code or re.match(COMMANDS, code):
            continue
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "dm":
                assert hasattr(dm, node.attr), node.attr
            if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "dm.mesh":
                assert hasattr(dolfinx_mortar.mesh, node.attr), node.attr


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", without_code(TEXT[page])):
        if re.match(r"[a-z]+:", target):
            continue
        file, _, heading = target.partition("#")
        path = (page.parent / file).resolve() if file else page
        assert path.exists(), target
        if heading:
            assert heading in headings(path), target


@pytest.mark.parametrize("page", TEXT, ids=name_of)
def test_named_files(page):
    """Paths in back quotes are those of files of the project, as in `docs/conf.py`."""
    roots = [ROOT, ROOT / "cpp" / "dolfinx_mortar"]
    folders = {p.name for root in roots for p in root.iterdir() if p.is_dir()} - {"output"}
    for name in re.findall(r"`([\w./-]+/[\w.-]+)`", TEXT[page]):
        if name.split("/")[0] in folders:
            assert any((root / name).exists() for root in roots), name


def test_every_page_is_in_a_table_of_contents():
    listed = set(re.findall(r"^([\w/-]+)$", TEXT[DOCS / "index.md"], re.MULTILINE))
    pages = {str(p.relative_to(DOCS).with_suffix("")) for p in PAGES} - {"index"}
    pages |= {str(p.relative_to(DOCS).with_suffix("")) for p in DOCS.rglob("*.rst")}
    assert pages == listed


def test_messages():
    """Each message of the sources has cause and cure, and each of these a message."""
    known, collected = messages.entries(), messages.collect()
    assert len({e.piece for e in known}) == len(known)
    assigned = messages.assign(collected, known)
    assert not assigned.pop(""), "without an entry in docs/messages.toml"
    assert not [piece for piece, found in assigned.items() if not found], "no longer in the sources"
    unused = [p for p in messages.parts() if not any(p in m.text for m in collected)]
    assert not unused, "parts that are no longer in the sources"
    for entry in known:
        assert entry.cause.endswith(".") and entry.cure.endswith("."), entry.piece
        assert entry.kind or any(m.kind for m in assigned[entry.piece]), entry.piece


def test_quoted_messages():
    """What the decision table quotes in italics are words of messages."""
    texts = [m.text for m in messages.collect()]
    rows = re.findall(r"^\| (.*?) \|", TEXT[DOCS / "howto" / "convergence.md"], re.MULTILINE)
    quoted = [q for row in rows for q in re.findall(r"\*([^*]+)\*", row)]
    assert len(quoted) > 10
    for piece in [p.strip() for q in quoted for p in q.split("…")]:
        assert any(piece in text for text in texts), piece


def test_topics():
    topics = list(dict.fromkeys(e.topic for e in messages.entries()))
    assert re.findall(r"^```\{messages\} (.*)$", TEXT[DOCS / "messages.md"], re.MULTILINE) == topics


def test_the_collector_of_messages(tmp_path, monkeypatch):
    monkeypatch.setattr(messages, "ROOT", tmp_path)
    python = tmp_path / "python" / "dolfinx_mortar" / "a.py"
    python.parent.mkdir(parents=True)
    python.write_text(
        '"""Words of a docstring."""\nraise ValueError(f"{name} is {x!r}, but " "must be y.")\n'
    )
    cpp = tmp_path / "cpp" / "dolfinx_mortar" / "a.cpp"
    cpp.parent.mkdir(parents=True)
    cpp.write_text(
        '// Words of a comment;\nvoid f()\n{\n  throw std::runtime_error("One; of "\n'
        '    + to_string(x) + " is \\"bad\\".");\n}\n'
    )
    found = [(m.kind, m.text) for m in messages.collect()]
    assert found == [
        ("ValueError", "… is …, but must be y."),
        ("RuntimeError", 'One; of … is "bad".'),
    ]


def test_defaults():
    assert not defaults.undescribed()
    assert len(defaults.fixed_numbers()) > 20


def test_demos_are_in_the_gallery():
    shown = set(re.findall(r"^```\{demo\} (\w+)$", TEXT[DOCS / "gallery.md"], re.MULTILINE))
    assert shown == {p.stem.removeprefix("demo_") for p in ROOT.glob("demos/demo_*.py")}


def test_directories_of_pictures():
    """What is in the gallery belongs to a demo, or is shown by a page."""
    stems = {p.stem.removeprefix("demo_") for p in ROOT.glob("demos/demo_*.py")}
    for path in (DOCS / "gallery").iterdir():
        used = any(f"gallery/{path.name}" in text for text in TEXT.values())
        assert path.stem in stems | {"README"} or used, path
        assert os.path.getsize(path) < 1_000_000, path


def test_versions():
    """All copies of the version are that of CMake, and the citation has the release's date."""

    def found(file, pattern):
        return re.search(pattern, (ROOT / file).read_text(), re.MULTILINE).groups()

    version = found("CMakeLists.txt", r"^  VERSION (\d+\.\d+\.\d+)$")
    assert found("packaging/conda/recipe.yaml", r'^  version: "(.*)"$') == version
    assert found(".github/ISSUE_TEMPLATE/bug.yml", r"dolfinx_mortar (\d\S*),") == version
    assert (dm.__version__,) == version
    newest = found("CHANGELOG.md", r"^## (\d\S*) - (\d{4}-\d\d-\d\d)$")
    assert newest[:1] == version
    assert found("CITATION.cff", r"^version: (.*)\ndate-released: (.*)$") == newest


def without_code(text):
    """Text without blocks of code, fenced or indented, and without code in back quotes."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"^    .*$|`[^`\n]*`", "", text, flags=re.MULTILINE)


def headings(path):
    """Anchors of the headings of a page."""
    found = re.findall(r"^#+ (.*)$", without_code(path.read_text()), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-") for h in found}
