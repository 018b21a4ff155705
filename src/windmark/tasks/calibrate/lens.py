"""The lens model of the cameras: as asked for, or the one that the marks speak for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from windmark.calibration import Calibration, NotCalibrated, StartFocal, start_focal
from windmark.calibration.lens_choice import WIDE_DEG, LensTried, as_lens, choose_lens, field_deg
from windmark.errors import WindmarkError
from windmark.geometry import Camera
from windmark.geometry.lens import LENSES
from windmark.options.calibration import MAX_SIGMA0
from windmark.tasks.calibrate.marks import Marks
from windmark.tasks.calibrate.run import CalibrateSettings, adjusted

FISHEYE_WIDTHS = (0.42, 0.33, 0.55)
"""Focal lengths in widths of the picture, per radian, that an unknown fisheye lens is tried with: 140, 175, 105 deg."""


def in_lens(cameras: Mapping[str, Camera], given: Mapping[str, Camera | None], lens: str | None) -> dict[str, Camera]:
    """Start values with the lens that was asked for; as they are where none was.

    A ``given`` camera is converted, so that it sees the same; of an unknown one nothing but the focal length is kept.
    """
    if lens is None:
        return dict(cameras)
    return {
        name: replace(camera, lens=lens) if given.get(name) is None else as_lens(camera, lens)
        for name, camera in cameras.items()
    }


def undecided(settings: CalibrateSettings, given: Mapping[str, Camera | None]) -> bool:
    """Whether nothing says which lens the cameras have."""
    asked = settings.lens is not None or settings.free is not None
    return not asked and all(c is None or c.lens == "brown" for c in given.values())


def with_lens(
    marks: Marks, settings: CalibrateSettings, given: Mapping[str, Camera | None], *, focal_known: bool = False
) -> tuple[Marks, tuple[LensTried, ...]]:
    """The marks with start values of the lens model that they speak for, and the models that were compared.

    Only where nothing was asked for, and no file says which lens it is (``given``): Brown's first, and where it leads
    to no solution, does not fit or is wider than `WIDE_DEG`, it against the rational and the fisheye lens. With
    ``settings.lens`` a start is found for that one.
    """
    if settings.lens is not None or settings.free is not None:
        if settings.lens != "fisheye" or focal_known or any(c is not None for c in given.values()):
            return marks, ()
        return replace(marks, cameras=_from_nothing(marks, "fisheye", settings.seed)), ()
    if not undecided(settings, given) or any(c.lens != "brown" for c in marks.cameras.values()):
        return marks, ()

    def calibrate(cameras: Mapping[str, Camera]) -> Calibration | NotCalibrated:
        try:
            return adjusted(replace(marks, cameras=cameras), replace(settings, max_sigma0=np.inf))
        except WindmarkError as error:
            return NotCalibrated(str(error), "degenerate")

    plain = calibrate(marks.cameras)
    if isinstance(plain, Calibration) and not _doubted(plain, settings):
        return marks, ()
    starts = {lens: {k: as_lens(c, lens) for k, c in marks.cameras.items()} for lens in LENSES}
    if not focal_known and all(c is None for c in given.values()):
        starts["fisheye"] = _from_nothing(marks, "fisheye", settings.seed)
    tried = choose_lens(calibrate, starts, len(marks.observations))
    best = tried[0]
    if not isinstance(best.outcome, Calibration) or best.lens == "brown":
        return marks, tried
    return replace(marks, cameras={k: replace(c, cov=None) for k, c in best.outcome.cameras.items()}), tried


def _doubted(plain: Calibration, settings: CalibrateSettings) -> bool:
    """Whether Brown's lens does not fit, or is so wide that another may do better."""
    limit = min(settings.max_sigma0, MAX_SIGMA0.default)
    return plain.sigma0 > limit or any(field_deg(c) >= WIDE_DEG for c in plain.cameras.values())


def _from_nothing(marks: Marks, lens: str, seed: int) -> dict[str, Camera]:
    """Cameras of a lens with the focal length that the marks tell, where they do."""
    obs, out = marks.observations, {}
    for name, camera in marks.cameras.items():
        mine = [v for v, view in enumerate(marks.views) if view.camera == name]
        pairs = [(marks.markers.xyz[obs.point[obs.view == v]], obs.xy[obs.view == v]) for v in mine]
        told = start_focal(pairs, camera.size_px, seed=seed, lens=lens)
        start = Camera(camera.size_px, camera.focal_px, lens=lens)
        out[name] = replace(start, focal_px=told.focal_px) if isinstance(told, StartFocal) else start
    return out
