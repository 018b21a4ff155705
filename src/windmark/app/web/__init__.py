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


def _text(name: str) -> str:
    return files(__name__).joinpath(name).read_text(encoding="utf-8")
