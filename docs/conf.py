"""The documentation site: ``make docs`` builds it, without a network."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
sys.path.insert(0, str(HERE.parent / "src"))

import windmark  # noqa: E402

project = "windmark"
author = "the windmark authors"
release = version = windmark.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax"]
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 4
exclude_patterns = ["_build", "pictures", "*.py"]
source_suffix = {".md": "markdown"}
# Formulas are readable as they are where no MathJax is; nothing is fetched from another host.
mathjax_path = "mathjax-is-not-fetched.js"
napoleon_google_docstring = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"
html_theme = "furo"
html_title = f"windmark {version}"
html_static_path: list[str] = []
suppress_warnings = ["misc.highlighting_failure"]


def setup(app) -> None:  # type: ignore[no-untyped-def]
    """Write the pages that are made from the program itself."""
    from make_reference import write_reference

    app.connect("builder-inited", lambda _: write_reference(HERE / "reference"))
