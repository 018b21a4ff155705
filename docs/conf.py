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
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 4
exclude_patterns = ["_build", "pictures", "*.py"]
source_suffix = {".md": "markdown"}
# Formulas are MathML, which browsers draw by themselves: no script, and nothing is fetched from another host.
html_math_renderer = "mathml"
napoleon_google_docstring = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"
html_theme = "furo"
html_title = f"windmark {version}"
html_static_path: list[str] = []
suppress_warnings = ["misc.highlighting_failure"]


def formula(translator, node) -> None:  # type: ignore[no-untyped-def]
    """A formula, in a line or by itself, as MathML; one that cannot be converted ends the build."""
    from docutils import nodes
    from docutils.utils.math.latex2mathml import tex2mathml

    block = isinstance(node, nodes.math_block)
    written = tex2mathml(node.astext(), as_block=block)
    translator.body.append(f'<div class="math">{written}</div>' if block else written)
    raise nodes.SkipNode


def setup(app) -> None:  # type: ignore[no-untyped-def]
    """Write the pages that are made from the program itself."""
    from make_reference import write_reference

    app.add_html_math_renderer("mathml", inline_renderers=(formula, None), block_renderers=(formula, None))
    app.connect("builder-inited", lambda _: write_reference(HERE / "reference"))
