"""The page's own scripts and style: plain files, put into every report that needs them. Nothing is fetched.

`SCRIPTS` are joined in this order into one classic script; each adds to the one object ``WM``.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import files

SCRIPTS = ("unpack.js", "linear.js", "colours.js", "model.js", "pick.js", "gpu.js", "orbit.js", "panel.js", "scene.js",
           "page.js")  # fmt: skip


@cache
def style() -> str:
    """The style sheet of every report."""
    return _text("report.css")


@cache
def script() -> str:
    """All scripts of a page as one."""
    return "\n".join(["(() => {", "'use strict';", "const WM = {};", *map(_text, SCRIPTS), "window.WM = WM;", "})();"])


@cache
def viewer() -> tuple[str, str]:
    """Style and script of `windmark view`, behind those of every report."""
    return _text("view.css"), "\n".join(["(() => {", "'use strict';", _text("view.js"), _text("view_pov.js"), "})();"])


def _text(name: str) -> str:
    return files(__name__).joinpath(name).read_text(encoding="utf-8")
