"""The paper's marker study: how far detected centres lie from true ones (AIAA 2005-5007, section II.C, Figure 4).

Virtual markers are made as the paper makes them (11 x 11 sub-pixels, random centres and viewing angles, averages for
blur, white noise); the detector then has to find them in the image, knowing nothing but the reference radius.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.detection import detect
from windmark.detection.detect import REFINEMENTS
from windmark.errors import UsageError
from windmark.pipeline.clock import Progress, silent
from windmark.pipeline.study_bound import variance_bound
from windmark.scene import Detections
from windmark.synth import SheetTruth, marker_sheet

Array = NDArray[np.float64]
Record = dict[str, Any]

PAPER_RADII_PX = (2.0, 3.0, 4.0, 5.0)
BLUR_VARIANCE_PX2 = 2.0 / 3.0  # of one pass of the 3 x 3 average, per axis
ROUNDING_VARIANCE = 1.0 / 12.0  # of whole grey levels
WHITE = 65535  # grey level; images have 16 bits


@dataclass(frozen=True)
class StudySettings:
    """What is varied and what is fixed; the defaults are the paper's study.

    The paper gives neither its noise nor its blur nor its range of viewing angles: 3 %, one pass and 60 degrees are
    readings of its Figures 1 and 3.

    Parameters
    ----------
    radii_px : reference radii r0 that the detector is given
    span_px : real radii lie in r0 - span_px ... r0 + span_px
    steps : real radii per reference radius, evenly spaced
    markers : random markers per real radius, filled up to a rectangle of markers
    max_tilt_deg : viewing angles are uniform in 0 ... max_tilt_deg, their azimuths all round
    blur_passes : averages over 3 x 3 pixels
    noise_percent : standard deviation of the white noise, percent of ``depth``
    depth : light lost on a marker, grey levels; images are rounded to whole grey levels
    methods : refinements of `windmark.detect` that are compared; empty takes all there are
    seed : of every random choice
    """

    radii_px: tuple[float, ...] = PAPER_RADII_PX
    span_px: float = 0.5
    steps: int = 11
    markers: int = 144
    max_tilt_deg: float = 60.0
    blur_passes: int = 1
    noise_percent: float = 3.0
    depth: float = 150.0
    methods: tuple[str, ...] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "radii_px", tuple(dict.fromkeys(float(r) for r in self.radii_px)))
        object.__setattr__(self, "methods", tuple(dict.fromkeys(self.methods)) or tuple(REFINEMENTS))
        _check(self)

    @property
    def grid(self) -> tuple[int, int]:
        """(columns, rows) of the sheet: as square as can be, at least ``markers`` of them."""
        columns = int(np.ceil(np.sqrt(self.markers)))
        return columns, -(-self.markers // columns)

    @property
    def blur_px(self) -> float:
        """Standard deviation of the blur per axis, without the pixel's own."""
        return float(np.sqrt(BLUR_VARIANCE_PX2 * self.blur_passes))

    @property
    def noise(self) -> float:
        """Standard deviation of the noise in grey levels, rounding included."""
        return float(np.hypot(self.noise_percent / 100 * self.depth, np.sqrt(ROUNDING_VARIANCE)))

    def real_radii(self, r0: float) -> Array:
        """(steps,) real radii of one reference radius."""
        if self.steps == 1:
            return np.array([r0])
        return r0 + self.span_px * np.linspace(-1, 1, self.steps)


@dataclass(frozen=True)
class Study:
    """One row per reference radius, real radius and method; all (K,).

    Parameters
    ----------
    settings : what it was made with
    r0_px, radius_px, method : reference radius, real radius, refinement
    markers, missed, false_spots : markers on the sheet; of these not found within r0; spots that are no marker
    rms_x_px, rms_y_px, rms_px : RMS error of the found markers along x, along y, per axis (root of the mean square of
        both). NaN where none was found
    two_rms_px : 2 rms_px, the paper's uncertainty
    bias_x_px, bias_y_px : mean error, detected minus true
    crlb_px, crlb_found_px : Cramer-Rao bound of rms_px: of all markers on the sheet, of those found. What a method may
        be compared with is the latter; strongly tilted markers are found less often and known less well. NaN where some
        marker has no bound: without blur one that lies within a pixel may be anywhere in it
    """

    settings: StudySettings
    r0_px: Array
    radius_px: Array
    method: NDArray[np.str_]
    markers: NDArray[np.int64]
    missed: NDArray[np.int64]
    false_spots: NDArray[np.int64]
    rms_x_px: Array
    rms_y_px: Array
    rms_px: Array
    two_rms_px: Array
    bias_x_px: Array
    bias_y_px: Array
    crlb_px: Array
    crlb_found_px: Array

    def __len__(self) -> int:
        return len(self.r0_px)

    def columns(self) -> dict[str, NDArray[Any]]:
        """The columns of the table by name."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name != "settings"}

    def curve(self, r0: float, method: str) -> NDArray[np.int64]:
        """Rows of one curve of Figure 4, by real radius."""
        return np.flatnonzero((self.r0_px == r0) & (self.method == method))

    def summary(self) -> list[Record]:
        """One record per reference radius and method, over all real radii."""
        return [
            self._summed(r0, method, self.curve(r0, method))
            for r0 in self.settings.radii_px
            for method in self.settings.methods
        ]

    def _summed(self, r0: float, method: str, rows: NDArray[np.int64]) -> Record:
        found = self.markers[rows] - self.missed[rows]
        weight = found / max(int(found.sum()), 1)

        def pooled(rms: Array) -> float:
            some = found > 0
            return float(np.sqrt(np.sum(weight[some] * rms[rows][some] ** 2))) if some.any() else float("nan")

        rms, crlb = pooled(self.rms_px), pooled(self.crlb_found_px)
        return {
            "r0_px": r0,
            "method": method,
            "markers": int(self.markers[rows].sum()),
            "missed": int(self.missed[rows].sum()),
            "false_spots": int(self.false_spots[rows].sum()),
            "two_rms_px": 2 * rms,
            "worst_two_rms_px": float(np.nanmax(self.two_rms_px[rows])) if found.any() else float("nan"),
            "two_crlb_px": 2 * crlb,
            "rms_over_crlb": rms / crlb,
        }

    def record(self) -> Record:
        """Settings, summary and all rows, for JSON."""
        return {
            "settings": asdict(self.settings),
            "summary": self.summary(),
            "rows": {name: values.tolist() for name, values in self.columns().items()},
        }


def run_study(settings: StudySettings, progress: Progress = silent) -> Study:
    """Make the sheets, detect on each with every method, compare with the truth.

    A sheet depends on the seed, its reference radius and its real radius alone: other radii or methods in the same
    study do not change it.
    """
    rows: list[Record] = []
    for r0 in settings.radii_px:
        for k, radius in enumerate(settings.real_radii(r0)):
            progress(f"reference radius {r0:g} px, real radius {radius:g} px")
            image, truth = study_sheet(settings, r0, k)
            variance = bound(settings, truth)
            for method in settings.methods:
                spots = detect(image, radius_px=r0, refine=method)
                rows.append({"r0_px": r0, "radius_px": radius, "method": method, **measure(spots, truth, variance, r0)})
    return Study(settings, **{name: np.array([row[name] for row in rows]) for name in rows[0]})


def study_sheet(
    settings: StudySettings, r0: float, step: int, *, perfect: bool = False
) -> tuple[NDArray[np.uint16], SheetTruth]:
    """The image of one real radius (index ``step`` of `StudySettings.real_radii`), and the truth.

    ``perfect`` leaves out blur and noise: Figure 3a of the paper, the same markers as with them.
    """
    radius = float(settings.real_radii(r0)[step])
    # Room for windows of 2 r0, and for the fit of a blurred ellipse, round every centre.
    pitch = int(np.ceil(4 * (r0 + settings.span_px) + 10 * settings.blur_px + 6))
    rng = np.random.default_rng([settings.seed, round(r0 * 1e6), step])
    image, truth = marker_sheet(
        rng,
        radius_px=radius,
        grid=settings.grid,
        pitch_px=pitch,
        max_tilt_deg=settings.max_tilt_deg,
        blur_passes=0 if perfect else settings.blur_passes,
        noise=0.0 if perfect else settings.noise_percent / 100,
        level=_level(settings),
        depth=settings.depth,
    )
    return np.clip(np.rint(image), 0, WHITE).astype(np.uint16), truth


@dataclass(frozen=True)
class Example:
    """One sheet to look at: image, truth, the real radius, and the spots that each method found."""

    image: NDArray[np.uint16]
    truth: SheetTruth
    radius_px: float
    spots: dict[str, Detections]


def examples(settings: StudySettings, like_px: float = 3.0) -> tuple[Example, Example]:
    """The paper's Figure 3: one sheet without, and with, blur and noise, at the reference radius nearest to 3 px."""
    r0 = min(settings.radii_px, key=lambda r: abs(r - like_px))
    step = settings.steps // 2

    def example(perfect: bool) -> Example:
        image, truth = study_sheet(settings, r0, step, perfect=perfect)
        spots = {method: detect(image, radius_px=r0, refine=method) for method in settings.methods}
        return Example(image, truth, float(settings.real_radii(r0)[step]), spots)

    return example(True), example(False)


def bound(settings: StudySettings, truth: SheetTruth) -> Array:
    """(N, 2) Cramer-Rao bound of the variance of each centre of a sheet, px^2."""
    return variance_bound(truth, blur_passes=settings.blur_passes, level=_level(settings), noise=settings.noise)


def match(spots: Detections, truth: SheetTruth, r0: float) -> tuple[NDArray[np.bool_], Array]:
    """Which markers have a spot within r0 (N,), and the error of the nearest one, detected minus true (N, 2)."""
    if not len(spots):
        return np.zeros(len(truth), dtype=bool), np.full((len(truth), 2), np.nan)
    from scipy.spatial import cKDTree

    distance, nearest = cKDTree(spots.xy).query(truth.xy)
    return distance <= r0, spots.xy[nearest] - truth.xy


def measure(spots: Detections, truth: SheetTruth, variance: Array, r0: float) -> Record:
    """The figures of one row.

    Parameters
    ----------
    variance : (N, 2) Cramer-Rao bound of each marker's variance along x and y
    """
    found, error = match(spots, truth, r0)
    x, y = error[found].T
    rms = _rms(error[found])
    return {
        "markers": len(truth),
        "missed": int((~found).sum()),
        "false_spots": len(spots) - int(found.sum()),
        "rms_x_px": _rms(x),
        "rms_y_px": _rms(y),
        "rms_px": rms,
        "two_rms_px": 2 * rms,
        "bias_x_px": float(x.mean()) if found.any() else float("nan"),
        "bias_y_px": float(y.mean()) if found.any() else float("nan"),
        "crlb_px": _bound(variance),
        "crlb_found_px": _bound(variance[found]),
    }


def _bound(variance: Array) -> float:
    """Of the RMS error per axis; NaN where some marker has none, or there is no marker."""
    return float(np.sqrt(variance.mean())) if variance.size and np.isfinite(variance).all() else float("nan")


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def _level(settings: StudySettings) -> float:
    """Grey level of the surface: a third more than the depth, and room for the noise below."""
    return settings.depth * (4 / 3 + 5 * settings.noise_percent / 100)


def _check(settings: StudySettings) -> None:
    """Every wrong setting by its name."""

    def need(good: bool, name: str, expected: str) -> None:
        if not good:
            raise UsageError(f"{name} must be {expected}, got {getattr(settings, name)!r}")

    radii = np.array(settings.radii_px)
    brightest = _level(settings) + 6 * settings.noise_percent / 100 * settings.depth
    need(radii.size > 0 and bool(np.isfinite(radii).all() and (radii >= 1).all()), "radii_px", "radii of at least 1 px")
    need(0 <= settings.span_px < radii.min(), "span_px", "from 0 to less than the smallest reference radius")
    need(settings.steps >= 1, "steps", "at least 1")
    need(settings.markers >= 1, "markers", "at least 1")
    need(0 <= settings.max_tilt_deg < 90, "max_tilt_deg", "from 0 to less than 90 degrees")
    need(settings.blur_passes >= 0, "blur_passes", "0 or more")
    need(0 <= settings.noise_percent < np.inf, "noise_percent", "0 or more")
    need(0 < settings.depth < np.inf and brightest <= WHITE, "depth",
         f"more than 0, and the surface with its noise not above {WHITE} grey levels")  # fmt: skip
    need(set(settings.methods) <= set(REFINEMENTS), "methods", f"of {', '.join(REFINEMENTS)}")
    need(settings.seed >= 0, "seed", "0 or more")
