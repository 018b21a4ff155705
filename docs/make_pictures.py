"""Draw the guide's pictures with windmark itself: ``python docs/make_pictures.py`` (a minute)."""

from __future__ import annotations

import tempfile
from pathlib import Path

from windmark.app import pictures
from windmark.app.figures import alignment_figure, matching_figure, surface_figure, wireframe_figure
from windmark.pipeline.job import run_project
from windmark.pipeline.project import read_project
from windmark.pipeline.simulate import simulate

HERE = Path(__file__).parent / "pictures"


def main() -> None:
    """Run the virtual test and save its pictures."""
    HERE.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        simulate(Path(folder), seed=1)
        result = run_project(read_project(Path(folder) / "project.toml"))
    item = result.images[-1]
    drawn = {
        "matching": matching_figure(item, result.markers),
        "wireframe": wireframe_figure(item, result.mesh),
        "surface": surface_figure(item, result.mesh),
        "view-top": pictures.view_picture(item.views[0], "mm"),
        "section": pictures.section_picture(item.sections[0], "mm"),
        "alignment": alignment_figure(item, result),
    }
    for name, figure in drawn.items():
        (HERE / f"{name}.png").write_bytes(pictures.png(figure, dpi=80))


if __name__ == "__main__":
    main()
