# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""The code of pages: `python3 docs/code_of_pages.py PAGE.md... > script.py`."""

import re
import sys
from pathlib import Path


def blocks(path: Path) -> list[str]:
    """Blocks of Python in a page."""
    return re.findall(r"^```python\n(.*?)^```", path.read_text(), re.DOTALL | re.MULTILINE)


if __name__ == "__main__":
    print("\n".join(block for name in sys.argv[1:] for block in blocks(Path(name))), end="")
