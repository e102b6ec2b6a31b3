"""What the README says: its example runs, its files are there."""

import re
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def test_example():
    (code,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    names = {"__name__": "readme"}
    exec(compile(code, "README.md", "exec"), names)
    problem, contact = names["problem"], names["contact"]
    assert problem.snes.getConvergedReason() > 0
    assert problem.history[-1]["force"] < 1e-9
    # Pressed from above, dragged against friction
    assert names["force"][2] > 0
    assert names["force"][0] < 0
    np.testing.assert_allclose(
        names["force"], -contact.master_force, atol=1e-10 * names["force"][2]
    )
    assert np.all(np.isfinite(names["pressure"].x.array))


@pytest.mark.serial
def test_files_are_there():
    files = re.findall(r"\]\(([^):]+)\)|`(demos/[^`]+)`", README)
    for name in (a or b for a, b in files):
        assert (ROOT / name).exists(), name


@pytest.mark.serial
def test_lists_all_demos():
    for path in ROOT.glob("demos/demo_*.py"):
        assert f"`demos/{path.name}`" in README
