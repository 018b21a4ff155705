"""From pictures and rough markers to a calibration: read, find the spots; `tasks.calibrate` matches and calibrates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from windmark import io
from windmark.calibration import NotCalibrated
from windmark.errors import UsageError, WindmarkError
from windmark.geometry import Camera
from windmark.pipeline.calibrate.read import MatchOptions, find_spots, picture_names, read_image, read_pictures
from windmark.pipeline.clock import Clock
from windmark.scene import MarkerSet
from windmark.tasks.blur import spot_blur
from windmark.tasks.calibrate import Calibrated, CalibrateSettings, MatchedPicture, MatchSettings, calibrate_matching
from windmark.tasks.calibrate.marks import Taken
from windmark.tasks.labels import fixed_spots

LABEL_PX = 10.0
"""A label means the spot within so many pixels of its place."""


def calibrate_pictures(
    paths: Sequence[io.PictureFile],
    markers: MarkerSet,
    cameras: Mapping[str, Camera | None],
    options: MatchOptions,
    settings: CalibrateSettings,
    clock: Clock,
    focal_px: float | None = None,
    patterns: Mapping[str, str] | None = None,
) -> tuple[Calibrated | NotCalibrated, tuple[MatchedPicture, ...]]:
    """Detect, match and calibrate.

    Parameters
    ----------
    paths : the pictures
    markers : rough coordinates
    cameras : by name; None for a camera of which nothing is known
    options, settings : of matching and of calibrating
    clock : of the stages
    focal_px : rough focal length of unknown cameras
    patterns : camera -> pattern of its pictures' names, see `marks.taken_by`

    Returns
    -------
    The calibration, or why there is none; and what became of each picture.

    Raises
    ------
    ValueError
        For fewer than two readable pictures, sizes that differ, labels of no picture or of no spot.
    """
    _check_labels(picture_names(paths), markers, options)

    def look(path: io.PictureFile, name: str, taken: Taken) -> MatchedPicture:
        return _detect(path, name, taken, options)

    with clock("detect"):
        pictures, found = read_pictures(paths, cameras, patterns or {}, focal_px, look, clock.progress)
    return calibrate_matching(
        pictures, markers, found, settings,
        matching=MatchSettings(options.tolerance_px, options.max_time_s, options.seed),
        given=cameras, unknown_focal=focal_px is None and None in cameras.values(), stage=clock,
    )  # fmt: skip


def _check_labels(names: Sequence[str], markers: MarkerSet, options: MatchOptions) -> None:
    unknown = sorted(set(options.labels) - set(names))
    if unknown:
        raise UsageError(f"a label is for the picture {unknown[0]!r}; there are {', '.join(names[:5])}")
    table = set(markers.name.tolist())
    wrong = sorted({n for labels in options.labels.values() for n in labels} - table)
    if wrong:
        raise UsageError(f"a label names the marker {wrong[0]!r}, which is not in the table of markers")


def _detect(path: io.PictureFile, name: str, taken: Taken, options: MatchOptions) -> MatchedPicture:
    image, mask = read_image(path, options)
    spots = find_spots(image, mask, options)
    try:
        fixed = fixed_spots(spots, options.labels.get(name, {}), LABEL_PX)
    except WindmarkError as error:
        raise UsageError(f"picture {name}: {error!s}") from None
    size = (int(image.shape[1]), int(image.shape[0]))
    blur, radius = spot_blur(image, spots, options.polarity)
    return MatchedPicture(
        name, taken.camera, size, spots, taken.frame, blur_px=blur, radius_px=radius, fixed=fixed
    )  # fmt: skip
