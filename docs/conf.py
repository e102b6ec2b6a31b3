# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Configuration of Sphinx; docs/build.sh calls it."""

import os
import re
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

project = "dolfinx_mortar"
copyright = "2026, the dolfinx_mortar developers"
author = "the dolfinx_mortar developers"
# The one place that has the version
version = re.search(r"VERSION (\d+\.\d+\.\d+)", (HERE.parent / "CMakeLists.txt").read_text())[1]
release = version

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "breathe",
    "formulas",
    "headers",
    "tables",
]
# Parts of pages, not pages
exclude_patterns = ["gallery/*.md"]
nitpicky = True
# What others document, and what is not part of the interface
nitpick_ignore_regex = [
    ("py:.*", r"(?!dolfinx_mortar\.(Contact|Tie|Rigid|adjust|relocate|hex20|Interface)).*"),
    ("cpp:.*", r"(?!dolfinx_mortar::(ContactProblem|InterfaceOptions|ProblemOptions)).*"),
]

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist", "attrs_inline"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_class_signature = "mixed"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

breathe_projects = {"dolfinx_mortar": os.environ["MORTAR_DOXYGEN"]}
breathe_default_project = "dolfinx_mortar"
breathe_default_members = ("members",)
breathe_show_include = True

html_theme = "furo"
html_title = f"dolfinx_mortar {version}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {"navigation_with_keys": True}
pygments_style = "default"


def setup(app):
    """Called by Sphinx."""

    def begin_with_comment(app, what, name, obj, options, lines):
        # Napoleon takes what is before a colon in the first line of a property as its type
        if what in ("property", "attribute"):
            lines[:0] = ["..", ""]

    app.connect("autodoc-process-docstring", begin_with_comment, priority=400)
