"""Running the command line as a user does, in one process."""

import contextlib
import functools
import inspect
import json
import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import typer.testing
from matplotlib.figure import Figure
from typer.testing import CliRunner

from windmark.app.cli import app
from windmark.app.report import Report
from windmark.pipeline import simulate_board
from windmark.pipeline.simulate_cameras import simulate_cameras
from windmark.pipeline.simulate_deforming import simulate_deforming
from windmark.pipeline.simulate_infrared import simulate_infrared
from windmark.pipeline.simulate_psp import simulate_psp, write_psp_test
from windmark.synth import marker_sheet, psp_test
from windmark.synth.render import render

SMALL_FILM_PX = (180, 120)
SMALL_PX = {simulate_psp: (640, 400), simulate_deforming: (640, 400), simulate_infrared: (480, 384)}
"""Pictures of a third of the usual pixels, for time; the projects say the markers' radius."""
SMALL_BOARD = {"COLUMNS": 10, "ROWS": 8, "SIZE_PX": (680, 540)}
"""A board that still has its rings, dots as large as usual: commands say their radius."""


FEW_LOOKED_AT = 100
"""Nodes that tell whether a model throws light on itself: all 1000 take a seventh of a run, for one remark."""


def no_bar(largest, label, height):
    """In place of a film's colour bar, which is drawn in some of these tests and not in others."""
    return np.full((height, 27, 3), 255, np.uint8)


@pytest.fixture(scope="session")
def windmark():
    """``windmark("detect", ...)`` -> code, out (stdout), err (stderr), json."""
    # Its runner makes all commands with all options anew for each call, a tenth of a second.
    command = functools.cache(typer.testing._get_command)

    def call(*arguments):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(typer.testing, "_get_command", command)
            done = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
        record = json.loads(done.stdout) if "--json" in arguments and done.stdout else None
        return SimpleNamespace(code=done.exit_code, out=done.stdout, err=done.stderr, json=record)

    return call


@pytest.fixture(scope="module", autouse=True)  # other folders' tests may be next in the same process
def quick_pictures(request, coarse_grids):
    """Outlines in simulated pictures of 5 x 5 rays a pixel instead of 11 x 11: nothing in these tests is as fine.

    Grids are coarse but in modules with ``WHOLE_GRIDS``, which compare errors with their sigmas.
    """
    grids = contextlib.nullcontext() if getattr(request.module, "WHOLE_GRIDS", False) else coarse_grids()
    with pytest.MonkeyPatch.context() as patch, grids:
        patch.setitem(render.__kwdefaults__, "subpixels", 5)
        patch.setitem(simulate_cameras.__kwdefaults__, "size_px", (800, 640))
        yield


@pytest.fixture(scope="session")
def few_flats():
    """``few_flats(folder)``: six even pictures of each camera of a paint test; every process reads them all."""

    def leave(folder):
        for flat in (folder / "calibration").glob("flat-*"):
            if int(flat.stem.rpartition("-")[2]) >= 6:
                flat.unlink()

    return leave


SECOND_CAMERA = '[[camera]]\nname = "cam2"\nfile = "cam2.json"\n'
CAMERAS_NOISE = "gain = 1.855\nread_noise = 3.25"
"""Of a simulated paint camera, which the even pictures would say, too: that takes a tenth of a job."""


@pytest.fixture(scope="session")
def no_second_camera():
    """``no_second_camera(folder)``: the project of a paint test names its first camera only."""

    def changed(folder):
        text = (folder / "psp.toml").read_text()
        assert SECOND_CAMERA in text
        (folder / "psp.toml").write_text(text.replace(SECOND_CAMERA, ""))

    return changed


@pytest.fixture(scope="session")
def one_camera(few_flats, no_second_camera):
    """``one_camera(folder, test)``: write a paint test as its first camera alone sees it, whose noise is said.

    A second camera doubles the time of a job. Gives the test as it was written.
    """

    def written(folder, test):
        alone = replace(test, cameras={"cam1": test.cameras["cam1"]})
        write_psp_test(folder, alone)
        few_flats(folder)
        no_second_camera(folder)
        text = (folder / "psp.toml").read_text()
        (folder / "psp.toml").write_text(text.replace("[radiometry]", f"[radiometry]\n{CAMERAS_NOISE}"))
        return alone

    return written


@pytest.fixture(scope="session")
def bending(made_once):
    """``bending(n, folder)``: a copy of the synthetic deformation test of n frames, which is made once."""

    def copied(frames, folder):
        made = made_once(f"bending-{frames}", lambda place: simulate_deforming(place, 3, frames, (640, 400)))
        return shutil.copytree(made, folder, dirs_exist_ok=True)

    return copied


@pytest.fixture(scope="session")
def simulated(windmark, made_once, few_flats):
    """``simulated("--photos", 8)``: a folder as `windmark simulate` makes it, of small pictures; made once."""

    def folder(*options):
        def make(place):
            with pytest.MonkeyPatch.context() as patch:
                for simulate, size in SMALL_PX.items():
                    usual = inspect.signature(simulate).parameters["size_px"].default
                    given = tuple(size if value == usual else value for value in simulate.__defaults__)
                    patch.setattr(simulate, "__defaults__", given)
                for name, value in SMALL_BOARD.items():
                    patch.setattr(simulate_board, name, value)
                for kind in ("on_frames", "off_frames"):
                    patch.setitem(psp_test.__kwdefaults__, kind, 2)
                done = windmark("simulate", place / "out", *options)
            assert done.code == 0, done.err
            few_flats(place / "out")

        return made_once("simulated" + "".join(map(str, options)), make) / "out"

    return folder


@contextlib.contextmanager
def without_drawings():
    """Reports without scenes, with blank pictures and small films, for tests of the numbers: a third of their time."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from windmark.app import deform_film, deform_report, infrared_pictures, pictures, psp_pictures
    from windmark.tasks.psp import self_lit

    def blank(*_, **__):
        return Figure(figsize=(1, 1))

    def no_view(*_, **__):
        return SimpleNamespace(value=None, shade=None)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FigureCanvasAgg, "draw", FigureCanvasAgg.get_renderer)
        patch.setattr(pictures, "_names_are_no_formulas", lambda _: None)  # looks at every tick there could be
        patch.setattr(deform_report, "compared_picture", blank)
        for module in (infrared_pictures, psp_pictures):
            patch.setattr(module, "surface_view", no_view)
            patch.setattr(module, "surface_picture", blank)
        patch.setattr(Report, "drawing", lambda *_, **__: None)
        patch.setattr(Report, "scene", lambda *_, **__: None)
        patch.setattr(deform_film, "FILM_SIZE", SMALL_FILM_PX)
        patch.setattr(deform_film, "colour_bar", no_bar)
        patch.setattr(self_lit, "LOOKED_AT", FEW_LOOKED_AT)
        yield


@pytest.fixture(scope="session")
def without_pictures():
    """``with without_pictures():`` the same for a part of a test or of a fixture."""
    return without_drawings


@pytest.fixture
def undrawn():
    """For one test; what its module's fixtures have made before is drawn."""
    with without_drawings():
        yield


@pytest.fixture(scope="module")
def all_undrawn():
    """For all of a module, its fixtures, too, where `usefixtures` of the whole module names it."""
    with without_drawings():
        yield


@pytest.fixture(scope="session")
def sheet_image():
    """A flat sheet of 42 markers of radius 4 px. Not to be written into."""
    sheet, _ = marker_sheet(
        np.random.default_rng(3), radius_px=4.0, grid=(7, 6), pitch_px=48, max_tilt_deg=0.0, blur_passes=1, noise=0.02,
        level=150.0, depth=90.0,
    )  # fmt: skip
    return np.clip(np.rint(sheet), 0, 255).astype(np.uint8)


@pytest.fixture
def no_pictures(monkeypatch):
    """No picture can be drawn; called with what a verb answered: each is named there and, once, in the page."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    def broken(*_, **__):
        raise ValueError("no such colour")

    monkeypatch.setattr(FigureCanvasAgg, "draw", broken)
    monkeypatch.setattr("windmark.app.photo._url", broken)

    def named(done, count, page=None):
        assert done.code == 0, done.err
        missing = done.json["not_drawn"]
        assert len(missing) == count, missing
        assert all(": ValueError: no such colour (conftest.py:" in said for said in missing)
        if page is not None:
            text = page.read_text(encoding="utf-8")
            assert text.count("This part is missing: ") == count
            assert 'src="data:image/' not in text
        return missing

    return named
