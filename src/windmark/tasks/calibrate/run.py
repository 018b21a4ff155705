"""A calibration and all that says how good it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from windmark.calibration import Calibration, Distance, NotCalibrated, self_calibrate
from windmark.calibration.bar_scale import other_unit
from windmark.calibration.datum import Datum
from windmark.calibration.lens_choice import LensTried
from windmark.calibration.quality import SplitHalf, split_half
from windmark.calibration.setup import Job, bars_of
from windmark.calibration.sides import side_unseen
from windmark.errors import UsageError, WindmarkError
from windmark.options.calibration import ECCENTRICITY, MAX_SIGMA0, REJECT, RIG, SOLVER
from windmark.options.registration import SEED
from windmark.scene import MarkerSet, Observations
from windmark.tasks.calibrate.diagnose import diagnosis
from windmark.tasks.calibrate.marks import Marks
from windmark.tasks.calibrate.stage import Stage, unnoticed

EVERY = ("all",)
"""In place of names: every picture has a focal length (a principal point) of its own."""


@dataclass(frozen=True)
class CalibrateSettings:
    """Options of `calibration.self_calibrate`; see there. No datum is for boards only: see `calibrate_dots`.

    ``free_focal``, ``free_principal``: names of pictures, or `EVERY`.
    ``lens``: model of all cameras, `geometry.lens.LENSES`; None: that of the start values, and where nothing is said of
    the free parameters either, the one that the marks speak for, see `lens.with_lens`.
    """

    datum: Datum | None
    free: tuple[str, ...] | None = None
    distances: tuple[Distance, ...] = ()
    rig: bool = RIG.default
    free_focal: tuple[str, ...] = ()
    free_principal: tuple[str, ...] = ()
    prior_sigma: dict[str, float] = field(default_factory=dict)
    eccentricity: str = ECCENTRICITY.default
    reject: bool = REJECT.default
    max_sigma0: float = MAX_SIGMA0.default
    seed: int = SEED.default
    solver: str = SOLVER.default
    lens: str | None = None


@dataclass(frozen=True)
class Calibrated:
    """A calibration, what it started from, and its halves.

    Parameters
    ----------
    result : the calibration
    marks : what it started from
    halves : every second picture against the others, or why that could not be done
    lenses : the lens models that were compared, the best first; empty where there was no question
    unchecked : what the marks cannot tell, though the result rests on it, as a sentence; "" for nothing
    """

    result: Calibration
    marks: Marks
    halves: SplitHalf | NotCalibrated
    lenses: tuple[LensTried, ...] = ()
    unchecked: str = ""


def check_asked(markers: MarkerSet, settings: CalibrateSettings) -> None:
    """What can be known to be wrong before a picture is looked at: names, sigmas, bars of the datum and their unit.

    Raises
    ------
    UsageError
        As `self_calibrate`, which would say it after the search for focal length and lens.
    """
    nothing = Observations(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)))
    if settings.datum is None:
        return
    job = Job(nothing, markers, (), {}, (), settings.datum, settings.distances, False, (), {})
    job.chosen(settings.datum.markers, "datum")
    job.known_sigma()
    bars_of(job)
    if why := other_unit(markers, settings.distances):
        raise UsageError(why)


def calibrate_marks(
    marks: Marks, settings: CalibrateSettings, stage: Stage = unnoticed, lenses: tuple[LensTried, ...] = ()
) -> Calibrated | NotCalibrated:
    """Calibrate, then check with halves of the pictures; ``lenses`` are the models that these marks were given to."""
    with stage("calibrate"):
        result = adjusted(marks, settings)
    if isinstance(result, NotCalibrated):
        return explained(result, marks)
    with stage("halves of the pictures"):
        halves = _halves(result, settings.seed)
    return Calibrated(result, marks, halves, lenses, side_unseen(marks.markers, result))


def explained(refusal: NotCalibrated, marks: Marks) -> NotCalibrated:
    """The refusal with what strikes about the pictures."""
    if refusal.cause == "misfit":
        return refusal
    return replace(refusal, reason="; ".join([refusal.reason, *diagnosis(marks)]))


def adjusted(marks: Marks, settings: CalibrateSettings, datum: Datum | None = None) -> Calibration | NotCalibrated:
    """The adjustment alone, perhaps in another datum."""
    used = {v.name for v in marks.views}
    chosen = datum or settings.datum
    if chosen is None:
        raise UsageError("settings.datum: what fixes position, direction and size is never guessed; got None")
    own_focal, own_principal = (
        [v.name for v in marks.views] if asked == EVERY else [n for n in asked if n in used or not datum]
        for asked in (settings.free_focal, settings.free_principal)
    )
    return self_calibrate(
        marks.observations, marks.markers, marks.cameras, marks.views, datum=chosen,
        free=settings.free, distances=_known(settings.distances, marks) if datum else settings.distances,
        rig=settings.rig, free_focal=own_focal, free_principal=own_principal,
        prior_sigma=settings.prior_sigma, eccentricity=settings.eccentricity, ellipses=marks.ellipses,
        reject=settings.reject, max_sigma0=settings.max_sigma0, solver=settings.solver, seed=settings.seed,
    )  # fmt: skip


def _known(distances: Sequence[Distance], marks: Marks) -> tuple[Distance, ...]:
    """Distances whose ends are among the markers that are seen."""
    seen = set(marks.markers.name[marks.observations.point].tolist())
    return tuple(d for d in distances if {d.first, d.second} <= seen)


def _halves(result: Calibration, seed: int) -> SplitHalf | NotCalibrated:
    try:
        return split_half(result, seed=seed)
    except WindmarkError as error:  # a half in which a rig's camera has no picture, or too few markers in common
        return NotCalibrated(str(error), "too_few")
