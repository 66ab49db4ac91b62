"""How the documentation is built: ``sphinx-build -W --keep-going docs docs/_build``."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]

import reference  # noqa: E402

import seismo3d  # noqa: E402

project = "seismo3d"
author = "The seismo3d developers"
copyright = author  # noqa: A001 - the name that Sphinx reads
release = version = seismo3d.__version__
extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.extlinks",
    "sphinx.ext.viewcode",
    "numpydoc",
    "myst_parser",
    "math_as_mathml",
]
source_suffix = {".rst": "restructuredtext", ".md": "markdown"}
exclude_patterns = ["_build"]
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = "seismo3d"
html_static_path = ["_static"]
html_css_files = ["style.css"]
html_show_sourcelink = False
html_math_renderer = "mathml"
extlinks = {"doi": ("https://doi.org/%s", "doi:%s")}
autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
viewcode_line_numbers = True


def setup(app: Any) -> None:
    """Write the generated pages before anything is read."""
    app.connect("builder-inited", lambda _: reference.write_pages(HERE))
    app.connect("autodoc-process-docstring", _number_references)


def _number_references(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Take out numbered references that a docstring lists and does not cite, which would be warned of."""
    text = "\n".join(lines)
    for number in re.findall(r"^\s*\.\. \[(\w+)\]", text, re.MULTILINE):
        if f"[{number}]_" not in text:
            text = re.sub(rf"^(\s*)\.\. \[{number}\] ", r"\1* ", text, flags=re.MULTILINE)
    lines[:] = text.split("\n")
