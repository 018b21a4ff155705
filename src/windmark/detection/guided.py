"""The verb `detect_at`: markers whose place, size and shape are roughly known, as in tracking.

Where a camera's pose is known nearly, or a frame before was seen, nothing has to be searched for in the whole image
and no shape has to be found: the disc is known, its place is not. That finds markers too faint for `detect`, and it is
fast. What has to be decided is whether the marker is there at all, and that is decided marker by marker.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.detection.guided_judge import ANSWERS, CLEAR, FOUND, UNSEEN, judge
from windmark.detection.image import check_polarity
from windmark.detection.options import PHOTOMETRIES
from windmark.detection.template.frame import fit_markers
from windmark.detection.template.learn import BLUR_SPREAD, BLUR_START, learn_frame
from windmark.detection.template.refine import LEAST_AXIS, check_places, fresh_request, known_blur, make_scene
from windmark.detection.template.request import Request, Scene
from windmark.detection.template.result import CONTAMINATED, Frame, TemplateFits
from windmark.detection.template.search import search
from windmark.errors import UsageError
from windmark.geometry.order import median
from windmark.options.detection import POLARITY, SEARCH_PX
from windmark.scene import Detections

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

FALSE_ALARMS = 1e-3  # see `detect_at`
LEARN = 10.0, 0.85  # depth over its sigma and correlation of markers that speak for a frame
OUTDATED = 1.4  # median residual variance over the expected one: the noise is not the one that was handed on
ENOUGH = 5  # clear markers that can say so


@dataclass(frozen=True)
class Guided:
    """M predictions and what was found there, in the order of the predictions.

    Parameters
    ----------
    xy : (M, 2) centres of the imaged ellipses; NaN where not found
    cov : (M, 2, 2) covariance of xy in px^2; NaN where not found
    axes_px, angle : (M, 2), (M,) half axes and direction of the ellipse: the predicted one, or the fitted one
    depth, depth_sigma : (M,) contrast in grey levels, positive for the chosen polarity, and its standard deviation: of
        the fit, and where that decides no smaller than that of the same filter on the surface round the marker
    correlation : (M,) of disc and window, both without their slope
    chi2 : (M,) residual variance over what the frame's noise lets expect; NaN where that is not known
    colour : (M, 2, 2) what the noise's correlation does to cov, to be handed on like `frame`; NaN where not found
    log10_nfa : (M,) false-alarm number: in how many predictions of this kind the surface alone would show such a depth
    flags : (M,) bits of `scene.FLAGS`
    answer : (M,) a code of `ANSWERS`; 0 is found
    frame : blur and noise of the frame, to be handed on to the next one
    """

    xy: Array
    cov: Array
    axes_px: Array
    angle: Array
    depth: Array
    depth_sigma: Array
    correlation: Array
    chi2: Array
    colour: Array
    log10_nfa: Array
    flags: Ints
    answer: Ints
    frame: Frame

    def __len__(self) -> int:
        return len(self.xy)

    @property
    def found(self) -> Bools:
        """Which predictions (M,) were met by a marker."""
        return np.asarray(self.answer == FOUND)

    @property
    def words(self) -> list[str]:
        """The answers in words."""
        return [ANSWERS[a] for a in self.answer.tolist()]

    @property
    def detections(self) -> Detections:
        """The markers that were found, in the order of the predictions; they have no merit (NaN)."""
        i = self.found
        return Detections.make(
            self.xy[i], cov=self.cov[i], radius_px=np.sqrt(self.axes_px[i].prod(axis=1)), axes_px=self.axes_px[i],
            angle=self.angle[i], depth=self.depth[i], flags=self.flags[i],
        )  # fmt: skip


def detect_at(
    image: ArrayLike,
    xy: ArrayLike,
    *,
    radius_px: ArrayLike | None = None,
    axes_px: ArrayLike | None = None,
    angle: ArrayLike = 0.0,
    search_px: float = SEARCH_PX.default,
    polarity: str = POLARITY.default,
    photometry: str | None = None,
    blur_px: float | None = None,
    frame: Frame | None = None,
    colour: ArrayLike | None = None,
    fit_shape: bool = False,
    reshape: bool = True,
    false_alarms: float = FALSE_ALARMS,
    mask: ArrayLike | None = None,
    saturation: float | None = None,
) -> Guided:
    """Find markers near predicted places.

    All places within `search_px` are tried with the predicted disc, blurred as the frame is, and the best correlated
    one is taken. Then centre, depth, background and slope are fitted, shape and blur held: six unknowns. A shape that
    is wrong by a tenth does not move the centre, by symmetry. Clear markers that do not look as predicted (by the
    frame's noise) are fitted again with all ten unknowns, robustly: the shape was wrong, or something lies on them.

    A marker is there if the surface alone would not show such a depth, and if what is there has the disc's shape. How
    deep the surface alone looks is measured with the same disc at 28 places round the marker, so paint, texture and
    dark blocks have their own scale; discs that stand out by 25 standard deviations need no such proof.

    Parameters
    ----------
    image : (H, W) grey levels, any real type, linear in light; pixels that are not finite are left out
    xy : (M, 2) predicted centres; they may lie outside the image
    radius_px : radius, one or (M,); or
    axes_px, angle : (M, 2) or (2,) half axes of the predicted ellipses and (M,) or one direction of the first from x
        towards y, radians, as `geometry.imaged_ellipse` gives them from camera, pose, normal and radius
    search_px : how far the predictions may be off along each axis, 0 to 64
    polarity, photometry : see `detect`
    blur_px : blur of the frame; None takes the given frame's, or else finds it from the markers that stand out
    frame : `Guided.frame` of a frame before: its blur and noise are taken unless this frame's are others
    colour : (M, 2, 2) `Guided.colour` of the same markers in a frame before, handed on with `frame`: it is taken
        instead of being computed, as it hardly changes within ten frames or so; where it is NaN it is computed
    fit_shape : all clear markers are fitted with ten unknowns
    reshape : clear markers that do not look as predicted are fitted again; without that they keep the predicted shape,
        are flagged, and their `chi2` says how little they look like it: a third of the time, for live measurements
    false_alarms : how many false markers per prediction are let pass where only the surface is
    mask, saturation : see `template.refine_template`

    Returns
    -------
    Guided
        In the order of the predictions, each with its answer.

    Raises
    ------
    ValueError
        An image that is not (H, W) real numbers, predictions that do not fit each other, an unknown option.

    Examples
    --------
    >>> import windmark as wm
    >>> image = wm.synth.disc_image((40, 60), [20.3, 15.6], [4.0, 4.0])
    >>> found = wm.detect_at(image, [[20.0, 15.0], [45.0, 25.0]], radius_px=4.0)
    >>> found.answer.tolist()  # 0: found; the second place has no marker
    [0, 2]
    >>> found.xy[0].round(1).tolist()
    [20.3, 15.6]
    """
    if photometry is not None and photometry not in PHOTOMETRIES:
        raise UsageError(f"photometry must be None or one of {', '.join(PHOTOMETRIES)}, got {photometry!r}")
    if not 0 <= search_px <= 64:
        raise UsageError(f"search_px must be a number of pixels from 0 to 64, got {search_px!r}")
    if not 0 < false_alarms < np.inf:
        raise UsageError(f"false_alarms must be a positive number, got {false_alarms!r}")
    light = photometry or ("multiplicative" if check_polarity(polarity) > 0 else "additive")
    scene = make_scene(image, polarity, light, mask, saturation)
    places, shape, radius = _predictions(xy, radius_px, axes_px, angle)
    steps = int(np.ceil(search_px))
    start = frame if frame is not None else Frame(BLUR_START, BLUR_SPREAD, None)
    if blur_px is not None:
        start = replace(start, blur_px=known_blur(blur_px)[0], blur_spread_px=known_blur(blur_px)[1])
    request = replace(fresh_request(places, radius, start), shape=shape, colour=_colour(colour, frame, len(places)))
    inside = _in_sight(scene, request, steps)
    request = request if inside.all() else request.take(inside)
    placed, found = search(scene, request, steps)
    if frame is None and len(placed.xy):
        start = _learn(scene, placed, found, start, blur=blur_px is None)
        known = replace(request, blur=np.full_like(request.blur, start.blur_px))
        placed, found = search(scene, known, steps)
    fits = fit_markers(scene, placed, start, robust=False)  # weights would take a wrong shape for contamination
    if frame is not None and _outdated(fits):
        start = _learn(scene, placed, found, start, blur=blur_px is None)
        blurs = np.full_like(placed.blur, start.blur_px), np.full_like(placed.blur, start.blur_spread_px)
        placed = replace(placed, colour=None, blur=blurs[0], blur_spread=blurs[1])
        fits = fit_markers(scene, placed, start, robust=False)
    verdict = judge(scene, request, placed, found, fits, steps, false_alarms)
    if reshape or fit_shape:
        fits = _reshaped(scene, placed, fits, start, verdict, every=fit_shape)
    return _answers(places, np.flatnonzero(inside), fits, *verdict, start)


def _predictions(
    xy: ArrayLike, radius_px: ArrayLike | None, axes_px: ArrayLike | None, angle: ArrayLike
) -> tuple[Array, Array, Array]:
    """Places (M, 2), shapes (M, 3) as L_xx, L_xy, L_yy of `disc_model.shape_matrix`, largest radii (M,)."""
    if (radius_px is None) == (axes_px is None):
        raise UsageError("detect_at: give either radius_px or axes_px")
    count = np.asarray(xy, dtype=float).size // 2
    given = np.asarray(radius_px if axes_px is None else axes_px, dtype=float)
    if axes_px is None and given.shape == (count,):
        given = given[:, None]
    try:
        axes = np.array(np.broadcast_to(given, (count, 2)))
        turn = np.broadcast_to(np.asarray(angle, dtype=float), count)
    except ValueError:
        raise ValueError(
            f"detect_at: expected radii, half axes and angles of {count} predictions, got {given.shape} and"
            f" {np.shape(angle)}"
        ) from None
    if not (np.isfinite(axes).all() and (axes >= LEAST_AXIS).all() and np.isfinite(turn).all()):
        raise UsageError(f"detect_at: half axes must be finite and at least {LEAST_AXIS} px, angles finite")
    places, radius = check_places(xy, axes.max(axis=1))
    c, s, (a, b) = np.cos(turn), np.sin(turn), axes.T
    return places, np.column_stack([a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c]), radius


def _colour(given: ArrayLike | None, frame: Frame | None, count: int) -> Array | None:
    """Colours (M, 2, 2) as given, checked; they say nothing about another frame's noise."""
    if given is None or frame is None:
        return None
    colour = np.asarray(given, dtype=float)
    if colour.shape != (count, 2, 2):
        raise ValueError(f"detect_at: colour must be ({count}, 2, 2) as Guided.colour is, got {colour.shape}")
    return colour


def _in_sight(scene: Scene, request: Request, steps: int) -> Bools:
    """Predictions (M,) whose searched square touches the image."""
    height, width = scene.image.shape
    x, y = request.xy.T
    return np.asarray((x > -1 - steps) & (y > -1 - steps) & (x < width + steps) & (y < height + steps))


def _learn(scene: Scene, placed: Request, found: Array, start: Frame, *, blur: bool) -> Frame:
    """Blur and noise of the frame from the markers that stand out; `start` where too few do."""
    rho = found[:, 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        z = rho * np.sqrt(np.pi) * placed.reach() / np.sqrt(1.0 - rho**2)
    good = np.flatnonzero((rho > LEARN[1]) & (z > LEARN[0]))
    good = good[np.argsort(-z[good], kind="stable")]
    if not good.size:
        return start
    free = replace(placed.take(good), shape=None, states=np.full((len(good), 10), np.nan), colour=None)
    learnt, _ = learn_frame(scene, free, blur=blur, noise=True)
    return learnt


def _outdated(fits: TemplateFits) -> bool:
    """Whether noise or blur that were handed on are not this frame's (or shapes are wrong: learning tells the same)."""
    chi2 = fits.chi2[np.isfinite(fits.chi2) & (fits.depth > LEARN[0] * fits.depth_sigma)]
    return len(chi2) >= ENOUGH and not 1.0 / OUTDATED < median(chi2) < OUTDATED


def _reshaped(
    scene: Scene, placed: Request, fits: TemplateFits, frame: Frame, verdict: tuple[Ints, Array, Array], *, every: bool
) -> TemplateFits:
    """Markers that stand out fitted again with all ten unknowns and weights: contaminated ones, or every one.

    Where that fails the first fit stays.
    """
    again = (verdict[0] == FOUND) & (fits.depth >= CLEAR * verdict[1])
    clear = np.flatnonzero(again & (every | ((fits.flags & CONTAMINATED) > 0)))
    if not clear.size:
        return fits
    free = replace(
        placed.take(clear), xy=fits.xy[clear], shape=None, states=np.full((len(clear), 10), np.nan), colour=None,
        blur=np.full(len(clear), frame.blur_px), blur_spread=np.full(len(clear), frame.blur_spread_px),
    )  # fmt: skip
    new = fit_markers(scene, free, frame, robust=True)
    good = new.converged & (np.hypot(*(new.xy - fits.xy[clear]).T) < placed.radius[clear])
    out = {f.name: np.array(getattr(fits, f.name)) for f in fields(fits) if f.name != "frame"}
    for name, column in out.items():
        column[clear[good]] = getattr(new, name)[good]
    return TemplateFits(**out, frame=fits.frame)


def _answers(
    places: Array, index: Ints, fits: TemplateFits, answer: Ints, sigma: Array, nfa: Array, frame: Frame
) -> Guided:
    """Columns for all M predictions; `index` (K,) are those in sight."""
    count, hit = len(places), answer == FOUND

    def column(values: Array, shape: tuple[int, ...] = ()) -> Array:
        if len(index) == count:
            return values
        out = np.full((count, *shape), np.nan)
        out[index] = values
        return out

    answers, flags = np.full(count, UNSEEN), np.zeros(count, dtype=np.int64)
    answers[index], flags[index] = answer, fits.flags
    return Guided(
        xy=column(np.where(hit[:, None], fits.xy, np.nan), (2,)),
        cov=column(np.where(hit[:, None, None], fits.cov, np.nan), (2, 2)),
        axes_px=column(fits.axes_px, (2,)),
        angle=column(fits.angle),
        depth=column(fits.depth),
        depth_sigma=column(sigma),
        correlation=column(fits.correlation),
        chi2=column(fits.chi2),
        colour=column(np.where(hit[:, None, None], fits.colour, np.nan), (2, 2)),
        log10_nfa=column(nfa),
        flags=flags,
        answer=answers,
        frame=frame,
    )
