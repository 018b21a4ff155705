"""Take the guide's pictures of reports, as a browser shows them:
``python docs/report_pictures.py RUN.html ALIGN.html``.

The guide has NASA's plate, ``windmark run examples/nasa-upsp-cam5.toml``, and ``windmark align`` of the pictures
cam1-0000 and cam1-0003 of ``windmark simulate FOLDER --deforming 4``. Needs Chromium.
"""

from __future__ import annotations

import io
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "app"))
import browser  # noqa: E402

PARTS = (
    {"report-3d": (".wm-scene", 1.0), "report-picture": (".wm-photo", 2 / 3)},
    {"align-2d-residuals": (".wm-photo", 2 / 3)},
)
"""Of each report: name -> where it is, and its size."""
GREYS, VIVID = 130, 110
"""Colours of the picture, and of what is drawn in bright ones: thin lines would share the picture's else."""


def main(reports: list[Path]) -> None:
    """Save the pictures beside the others."""
    if browser.found() is None:
        raise SystemExit("no Chromium here (apt-get install chromium)")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder, browser.opened(folder, 1250, 900) as tab:
        for report, parts in zip(reports, PARTS, strict=False):
            take(tab, report, parts)


def take(tab: browser.Page, report: Path, parts: dict[str, tuple[str, float]]) -> None:
    """Save the parts of one report."""
    tab.open(report)
    if "report-3d" in parts:
        x, y = tab.centre(".wm-stage")
        for step in (1, 2):  # something under the cursor
            tab.mouse("mouseMoved", x + 20 * step, y - 40)
        tab.until("!document.querySelector('.wm-tip').hidden")
    for name, (selector, scale) in parts.items():
        box = tab.js(f"(() => {{ const r = document.querySelector('{selector}').getBoundingClientRect();"
                     " return [r.x + scrollX, r.y + scrollY, r.width, r.height]; })()")  # fmt: skip
        shot = Image.open(io.BytesIO(tab.shot(clip=box, whole=True))).convert("RGB")
        shot = shot.resize((round(shot.width * scale), round(shot.height * scale)), Image.Resampling.LANCZOS)
        few_colours(shot).save(ROOT / "docs" / "pictures" / f"{name}.png", optimize=True)
    if said := tab.wrong():
        raise SystemExit(f"the page did what it must not: {said}")


def few_colours(shot: Image.Image) -> Image.Image:
    """A picture of so few colours, those of thin lines among them."""
    pixels = np.asarray(shot)
    vivid = np.ptp(pixels.astype(int), axis=2) > 60
    palette: list[int] = []
    for some, count in ((pixels[~vivid], GREYS), (pixels[vivid], VIVID)):
        if len(some):
            few = Image.fromarray(some[None]).quantize(count, dither=Image.Dither.NONE)
            palette += (few.getpalette() or [])[: 3 * count]
    chosen = Image.new("P", (1, 1))
    chosen.putpalette(palette)
    return shot.quantize(palette=chosen, dither=Image.Dither.NONE)


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]])
