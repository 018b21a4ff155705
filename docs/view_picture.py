"""Take the guide's picture of the viewer, as a browser shows it: ``python docs/view_picture.py PROJECT.toml``.

The guide has the simulated test of ``windmark simulate my-test``. Needs Chromium.
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
import viewing  # noqa: E402

SCALE = 0.72
READY = "document.documentElement?.dataset.view === 'run 1' && document.documentElement.dataset.ready === 'yes'"
MOVED = ("(() => {{ const box = document.querySelectorAll('.wm-sliders input[type=number]')[{0}];"
         " box.value = Number(box.value) + {1}; box.dispatchEvent(new Event('input')); }})()")  # fmt: skip


def main(project: Path) -> None:
    """Save the picture beside the others: the grid from another point of view, and a spot that is named."""
    if browser.found() is None:
        raise SystemExit("no Chromium here (apt-get install chromium)")
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        viewing.viewing(project) as client,
        browser.opened(folder, 1250, 1180) as tab,
    ):
        tab.open(client.server.address)
        tab.until(READY, 300)
        tab.js("document.querySelector('.wm-pov').open = true")
        tab.until("!!document.querySelector('.live')")
        tab.js(MOVED.format(2, 2.5))
        tab.until("parseFloat(document.querySelector('.wm-pov-words').textContent.split('·')[2]) > 1")
        tab.js("[...document.querySelector('.wm-view').querySelectorAll('circle.matched')]"
               ".find((one) => one.textContent.startsWith('W17')).id = 'clicked'")  # fmt: skip
        tab.click("#clicked")
        tab.js("scrollTo(0, document.querySelector('.wm-view').getBoundingClientRect().y + scrollY)")
        tab.settle()
        if said := tab.wrong():
            raise SystemExit(f"the page did what it must not: {said}")
        shot = Image.open(io.BytesIO(tab.shot())).convert("RGB")
    small = shot.resize((round(shot.width * SCALE), round(shot.height * SCALE)), Image.Resampling.LANCZOS)
    small.save(ROOT / "docs" / "pictures" / "view.png", optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
