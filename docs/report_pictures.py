"""Take the guide's pictures of a report, as a browser shows it: ``python docs/report_pictures.py REPORT.html``.

The guide has NASA's plate: ``windmark run examples/nasa-upsp-cam5.toml``. Needs Chromium.
"""

from __future__ import annotations

import io
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "app"))
import browser  # noqa: E402

PARTS = {"report-3d": (".wm-scene", 1.0), "report-picture": (".wm-photo", 2 / 3)}
COLOURS = 200


def main(report: Path) -> None:
    """Save the pictures beside the others."""
    if browser.found() is None:
        raise SystemExit("no Chromium here (apt-get install chromium)")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder, browser.opened(folder, 1250, 900) as tab:
        tab.open(report)
        x, y = tab.centre(".wm-stage")
        for step in (1, 2):  # something under the cursor
            tab.mouse("mouseMoved", x + 20 * step, y - 40)
        tab.until("!document.querySelector('.wm-tip').hidden")
        for name, (selector, scale) in PARTS.items():
            box = tab.js(f"(() => {{ const r = document.querySelector('{selector}').getBoundingClientRect();"
                         " return [r.x + scrollX, r.y + scrollY, r.width, r.height]; })()")  # fmt: skip
            shot = Image.open(io.BytesIO(tab.shot(clip=box, whole=True))).convert("RGB")
            shot = shot.resize((round(shot.width * scale), round(shot.height * scale)), Image.Resampling.LANCZOS)
            small = shot.quantize(COLOURS, dither=Image.Dither.NONE)
            small.save(ROOT / "docs" / "pictures" / f"{name}.png", optimize=True)
        if said := tab.wrong():
            raise SystemExit(f"the page did what it must not: {said}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
