"""From pictures and rough markers to matched marks.

Rough coordinates and an unknown camera leave some pictures without a certain labelling. So: match with generous
gates, calibrate from the pictures that are certain, match all of them again with the calibrated camera and the refined
markers, and so on until no more pictures come in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from windmark import registration
from windmark.calibration import Calibration, Free, NotCalibrated
from windmark.calibration.self_calibrate import usual_free
from windmark.calibration.setup import FOCUS
from windmark.geometry import PARAMETERS, Camera
from windmark.options.calibration import MATCH_TIME_S
from windmark.options.registration import SEED
from windmark.registration import CONTRADICTED, NotRegistered, Registration
from windmark.scene import Detections, Doubt, MarkerSet, Observations, View
from windmark.tasks.calibrate.beside import beside_their_place
from windmark.tasks.calibrate.lens import FISHEYE_WIDTHS, in_lens, undecided, with_lens
from windmark.tasks.calibrate.marks import Marks, with_excess
from windmark.tasks.calibrate.picture import Picture, excess_px, lost_most
from windmark.tasks.calibrate.run import (
    EVERY,
    Calibrated,
    CalibrateSettings,
    adjusted,
    calibrate_marks,
    check_asked,
    explained,
)
from windmark.tasks.calibrate.stage import Stage, unnoticed

ROUGH_SPACING = 0.3
"""Neighbourhood in which a rough marker looks for its spot, as part of the spots' spacing."""
ROUGH_TABLE = 0.2
"""How far rough markers may be off (1 sigma), as part of the distance to the next one."""
ANY_FOCAL, GIVEN_FOCAL = 3.0, 1.5
"""Ratio either way within which focal lengths are tried in the first round: where nothing is known of the camera (round
the image's width), and where there is a start value."""
ROUGH_FOCAL, KNOWN_FOCAL = 10.0, 1.1
"""Relative sigma of the focal length up to which a labelling counts: the labels matter here, not the focal length.
It is free in all rounds, within this ratio from the second on: lens and focus must not cost a picture its labels."""
LEAD = 4.0
"""Lead over the next best labelling, in sigma of what chance gives. Two labellings whose misfits are both the markers'
errors differ by chance: N markers have 2 N residuals, and N log of the ratio of two variances that are estimated from
them scatters by sqrt(2 N)."""
REFOCUSED = 0.003
"""Relative sigma of the pictures' focal lengths while they are matched: as a consumer's camera focuses anew."""
LOOSE = 0.003
"""1 sigma of aspect, principal point (in diagonals) and lens (in the corners) from the second round on: a lens that
moves to focus takes them along, and this must not cost a picture its labels either."""
ROUNDS, LEAST_PICTURES = 6, 3
FEWER = (("focal_px", "cx", "cy", "k1", "k2"), ("focal_px", "k1"))
"""Parameters for a first calibration from too few pictures for all that were asked for."""


@dataclass(frozen=True)
class MatchSettings:
    """How spots are matched to rough markers.

    Parameters
    ----------
    tolerance_px : neighbourhood of the first round; None takes 0.3 of the spots' spacing
    max_time_s : CPU time per picture and round
    seed : of the matching
    """

    tolerance_px: float | None = None
    max_time_s: float = MATCH_TIME_S.default
    seed: int = SEED.default


@dataclass(frozen=True)
class MatchedPicture(Picture):
    """One picture: its spots, and which marker each is.

    Parameters
    ----------
    fixed : spot -> marker's name, as told by labels
    registration : the accepted matching, None if there is none
    cause : why there is none, as `NotRegistered` has it; "" where there is one
    """

    fixed: Mapping[int, str] = field(default_factory=dict)
    registration: Registration | None = None
    cause: str = ""

    @property
    def count(self) -> int:
        """Matched markers."""
        return 0 if self.registration is None else len(self.registration.matching)

    @property
    def rms_px(self) -> float | None:
        """Of the registration."""
        return None if self.registration is None else self.registration.rms_px

    @property
    def log10_nfa(self) -> float | None:
        """Of the registration."""
        return None if self.registration is None else self.registration.log10_nfa


def calibrate_matching(
    pictures: Sequence[MatchedPicture],
    markers: MarkerSet,
    cameras: Mapping[str, Camera],
    settings: CalibrateSettings,
    *,
    matching: MatchSettings | None = None,
    given: Mapping[str, Camera | None] | None = None,
    unknown_focal: bool = False,
    stage: Stage = unnoticed,
) -> tuple[Calibrated | NotCalibrated, tuple[MatchedPicture, ...]]:
    """Match the spots of pictures to rough markers, and calibrate.

    Parameters
    ----------
    pictures : with their spots, not matched yet
    markers : rough coordinates
    cameras : start values by name
    settings : of calibrating
    matching : of matching
    given : the cameras that a file tells, None for the others, whose start value is a stand-in; not said: all are told
    unknown_focal : whether the focal length of a camera is only a stand-in (`marks.start_camera`)
    stage : told of each stage

    Returns
    -------
    The calibration, or why there is none; and what became of each picture.
    """
    check_asked(markers, settings)
    told = dict(cameras) if given is None else given
    how_to_match, start = matching or MatchSettings(), in_lens(cameras, told, settings.lens)
    answer = _in_rounds(pictures, markers, start, told, how_to_match, settings, stage, unknown_focal)
    if isinstance(answer[0], NotCalibrated) and undecided(settings, told) and None in told.values():
        # A wide lens bends straight lines more than a search for a plain one follows.
        for widths in FISHEYE_WIDTHS if unknown_focal else (None,):
            wide = {
                k: c if told[k] is not None else
                Camera(c.size_px, c.focal_px if widths is None else widths * max(c.size_px), lens="fisheye")
                for k, c in start.items()
            }  # fmt: skip
            again = _in_rounds(pictures, markers, wide, told, how_to_match, settings, stage, unknown_focal)
            if isinstance(again[0], Calibrated):
                return _with_doubts(again, markers, settings)
    return _with_doubts(answer, markers, settings)


def _with_doubts(
    answer: tuple[Calibrated | NotCalibrated, tuple[MatchedPicture, ...]],
    markers: MarkerSet,
    settings: CalibrateSettings,
) -> tuple[Calibrated | NotCalibrated, tuple[MatchedPicture, ...]]:
    """With pictures whose labels contradict the others, and the markers that are beside their place.

    The latter not where the table is rough and only the start.
    """
    done, pictures = answer
    if isinstance(done, NotCalibrated):
        return answer
    doubts = list(done.result.doubts)
    if not isinstance(settings.datum, Free):
        doubts = [*beside_their_place(done.result, [(p, p.registration) for p in pictures], markers), *doubts]
    told = tuple(p.name for p in pictures if p.cause == "labels")
    if told:
        listed = ", ".join("{}" for _ in told)
        words = f"the labels in {listed} contradict the pictures without: if they are right, all names are wrong"
        doubts.insert(0, Doubt(told, words, "swapped"))
    return replace(done, result=replace(done.result, doubts=tuple(doubts))), pictures


def _in_rounds(
    pictures: Sequence[MatchedPicture],
    markers: MarkerSet,
    found: dict[str, Camera],
    given: Mapping[str, Camera | None],
    how_to_match: MatchSettings,
    settings: CalibrateSettings,
    stage: Stage,
    unknown_focal: bool,
) -> tuple[Calibrated | NotCalibrated, tuple[MatchedPicture, ...]]:
    """Match and calibrate in turns, from start values of the cameras."""
    nothing, pictures = unknown_focal and all(c.lens == "brown" for c in found.values()), list(pictures)
    known, how, excess, done = markers, _rough_options(markers, ANY_FOCAL if nothing else GIVEN_FOCAL), 0.0, 0
    doubtful: set[str] = set()
    for n in range(1, ROUNDS + 1):
        with stage("match"):
            anew = doubtful if n > 2 else {p.name for p in pictures}
            pictures = [
                _match(p, known, found[p.camera], how_to_match, how, n, excess, p.name in anew) for p in pictures
            ]
        matched = sum(p.registration is not None for p in pictures)
        if matched < LEAST_PICTURES:
            return _too_few(pictures, n), tuple(pictures)
        if n > 2 and matched <= done and not doubtful:
            break
        with stage("calibrate"):
            marks = _marks(pictures, markers, found, excess)
            calibration = _first(marks, settings)
        if isinstance(calibration, NotCalibrated):
            return explained(calibration, marks), tuple(pictures)
        found = {**found, **{k: replace(c, cov=None) for k, c in calibration.cameras.items()}}
        known, how, excess, done = _refined(markers, calibration), {}, excess_px(calibration, excess), matched
        # A picture that lost all of its marks is not suspect but gone.
        doubtful = {*lost_most(calibration), *calibration.dropped} & {p.name for p in pictures if p.count}
    pictures = [
        _without_labels(p, known, found[p.camera], how_to_match, excess) if p.name in doubtful else p for p in pictures
    ]
    marks = _marks(pictures, markers, found, excess)
    with stage("lens"):
        marks, lenses = with_lens(marks, settings, given, focal_known=True)
    outcome = calibrate_marks(marks, settings, stage, lenses)
    return outcome, tuple(replace(p, excess_px=excess) for p in pictures)


def _without_labels(
    picture: MatchedPicture, known: MarkerSet, camera: Camera, options: MatchSettings, excess_px: float
) -> MatchedPicture:
    """A picture that matches by itself, but most of whose marks contradict the others to the end.

    What the markers and the camera of the others say of it is the reason, if they say one.
    """
    problem = "most of its marks contradict the other pictures: wrong labels, or the markers moved"
    answer = registration.register(
        _as_uncertain(picture.detections, excess_px), known, camera, max_deformation=0.0,
        max_time_s=options.max_time_s, seed=options.seed,
    )  # fmt: skip
    if isinstance(answer, NotRegistered) and answer.cause in CONTRADICTED:
        problem = f"most of its marks contradict the other pictures: {answer.reason}"
    return replace(picture, registration=None, problem=problem, round=0)


def _too_few(pictures: Sequence[MatchedPicture], n: int) -> NotCalibrated:
    good = sum(p.registration is not None for p in pictures)
    one = next((p for p in pictures if p.problem), None)
    how = "to the rough markers" if n == 1 else "again"
    needed = f"{LEAST_PICTURES} are needed to go on from"
    reason = f"{good} of {len(pictures)} pictures were matched with certainty {how}; {needed}"
    reason += f". {one.name}: {one.problem}" if one else ": take more, from other sides"
    return NotCalibrated(reason, "too_few", dropped={p.name: p.problem for p in pictures if p.problem})


def _rough_options(markers: MarkerSet, focal_range: float) -> dict[str, Any]:
    """Options of `registration.register` for rough coordinates and an unknown focal length."""
    return {"max_table_error": ROUGH_TABLE, "focal_range": focal_range}


def _match(
    picture: MatchedPicture,
    markers: MarkerSet,
    camera: Camera,
    options: MatchSettings,
    how: dict[str, Any],
    n: int,
    excess_px: float,
    anew: bool,
) -> MatchedPicture:
    """Match one picture; ``how`` is empty where camera and markers are known, ``anew`` forgets the last labels.

    ``excess_px`` is what the residuals of the last calibration have beyond the detector's noise: here as there, lens
    and light leave it, and a judge who knows of none takes a real lens for a bent model.
    """
    if picture.unread:
        return picture
    xy = picture.detections.xy
    tolerance = options.tolerance_px
    if how and tolerance is None and len(xy) > 1:
        distance = np.linalg.norm(xy[:, None] - xy[None], axis=2)
        np.fill_diagonal(distance, np.inf)
        tolerance = ROUGH_SPACING * float(np.median(distance.min(axis=1)))
    # Labels of the first round are put to the test again, and later ones that contradict other pictures.
    last = None if anew else picture.registration
    answer = registration.register(
        _as_uncertain(picture.detections, excess_px), markers, camera if how else _as_loose(camera),
        fixed=picture.fixed, prior=last.cam_from_model if last else None,
        tolerance_px=tolerance if how else None, free_focal=True, max_focal_sigma=ROUGH_FOCAL, max_deformation=0.0,
        min_margin=LEAD * float(np.sqrt(2 * len(markers))),
        max_time_s=options.max_time_s, seed=options.seed, **(how or {"focal_range": KNOWN_FOCAL}),
    )  # fmt: skip
    if isinstance(answer, Registration):
        return replace(picture, registration=answer, problem="", cause="", round=picture.round or n)
    apart = "; the label of a marker in some pictures tells labellings apart"
    problem = answer.reason + apart * (answer.cause == "ambiguous")
    return replace(picture, registration=None, problem=problem, cause=answer.cause)


def _as_uncertain(spots: Detections, excess_px: float) -> Detections:
    """Spots with so much noise beyond the detector's."""
    return replace(spots, cov=with_excess(spots.cov, excess_px)) if excess_px else spots


def _as_loose(camera: Camera) -> Camera:
    """A camera as little known as `LOOSE`: calibrated from some of the pictures, and focused anew for others."""
    edge = 0.5 * float(np.hypot(*camera.size_px))
    middle, lens = 2 * LOOSE * edge, LOOSE * (camera.focal_px / edge) ** 2
    sigma = {"aspect": LOOSE, "cx": middle, "cy": middle, "k1": lens}
    return replace(camera, cov=np.diag([sigma.get(p, 0.0) ** 2 for p in PARAMETERS]))


def _marks(
    pictures: Sequence[MatchedPicture], markers: MarkerSet, cameras: Mapping[str, Camera], excess_px: float
) -> Marks:
    """The marks of all matched pictures, with so much noise beyond the detector's."""
    good = [p for p in pictures if p.registration is not None]
    view, point, xy, cov, ellipses, views = [], [], [], [], [], []
    for v, p in enumerate(good):
        assert p.registration is not None
        pairs = p.registration.matching
        view.append(np.full(len(pairs), v, dtype=np.int64))
        point.append(pairs.marker.astype(np.int64))
        xy.append(p.detections.xy[pairs.detection])
        cov.append(with_excess(p.detections.cov[pairs.detection], excess_px))
        # A flagged outline (cut by the border, touched, in clutter) is not that of the disc.
        clean = p.detections.flags[pairs.detection, None] == 0
        ellipses.append(np.where(clean, p.detections.ellipses[pairs.detection], np.nan))
        # No pose: that of the matching has a focal length of its own.
        views.append(View(p.name, p.camera, p.frame))
    observations = Observations(np.concatenate(view), np.concatenate(point), np.concatenate(xy), np.concatenate(cov))
    return Marks(observations, markers, {k: cameras[k] for k in cameras}, tuple(views), np.concatenate(ellipses))


def _first(marks: Marks, settings: CalibrateSettings) -> Calibration | NotCalibrated:
    """A calibration from the pictures so far, with fewer parameters where there are few; a free network.

    No rig yet: its cameras may have no instant in common among these pictures. Focal lengths may differ by `REFOCUSED`
    if nothing else is asked for: a camera that focuses by itself would have its lens and the markers bent until all
    pictures have one, and the pictures that are not in yet would contradict that.
    """
    settings = replace(settings, max_sigma0=np.inf, rig=False)
    if not settings.free_focal:
        focus = {**settings.prior_sigma, FOCUS: REFOCUSED}
        settings = replace(settings, free_focal=EVERY, prior_sigma=focus)
    usual = usual_free(marks.cameras.values()) if settings.free is None else settings.free
    result = adjusted(marks, settings, Free())
    for fewer in FEWER:
        if isinstance(result, Calibration):
            break
        free = tuple(p for p in fewer if p in usual)
        again = adjusted(marks, replace(settings, free=free), Free()) if free else result
        result = again if isinstance(again, Calibration) else result
    return result


def _refined(rough: MarkerSet, result: Calibration) -> MarkerSet:
    """The table with the coordinates that the calibration found; the others are as rough as these were."""
    place = {str(n): k for k, n in enumerate(rough.name)}
    index = np.array([place[str(n)] for n in result.markers.name])
    xyz = rough.xyz.copy()
    xyz[index] = result.markers.xyz
    sigma = np.full_like(xyz, float(np.sqrt(((xyz - rough.xyz)[index] ** 2).mean())))
    sigma[index] = result.markers.sigma
    return replace(rough, xyz=xyz, sigma=sigma)
