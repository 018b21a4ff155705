"""The verb `register`: from unlabelled spots to labels and pose, without the user's help."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry import Camera, Pose
from windmark.geometry.order import median
from windmark.registration.labels import Fixed, fixed_pairs, used_spots
from windmark.registration.line import off_line, on_line
from windmark.registration.result import NotRegistered, Registration
from windmark.registration.task import Limits, Task, Visible
from windmark.scene import Detections, MarkerSet

if TYPE_CHECKING:
    from windmark.registration.search.layout import Layout

Array = NDArray[np.float64]

METHODS = ("hash", "ransac")
MIN_COUNT = 4
"""Three pairs fix a pose, a fourth is needed to check it."""
FOCAL_STEPS = 5
MOST_DEFORMATION = 0.1
DEFAULT_TOLERANCE, MAX_SPACING, TABLE_SIGMAS = 0.004, 0.2, 5.0
"""Neighbourhood: part of the image's diagonal or, where that is more, so many sigma of the table; and at most this part
of the spots' spacing."""
ROUND = 4
"""Neighbours all round a marker."""


def register(
    detections: Detections,
    markers: MarkerSet,
    camera: Camera,
    *,
    prior: Pose | None = None,
    prior_max_angle_deg: float = 30.0,
    prior_max_scale: float = 1.3,
    fixed: Fixed | None = None,
    excluded: ArrayLike | None = None,
    visible: Visible | None = None,
    free_focal: bool = False,
    focal_range: float = 1.5,
    max_focal_sigma: float = 0.05,
    tolerance_px: float | None = None,
    method: str = "hash",
    layout: Layout | None = None,
    max_hypotheses: int = 1_000_000,
    max_time_s: float | None = None,
    max_log10_nfa: float = -9.0,
    min_score: float = 60.0,
    min_margin: float = 10.0,
    max_table_error: float = 0.025,
    max_deformation: float = 0.05,
    seed: int = 0,
) -> Registration | NotRegistered:
    """Find which spot is which marker and where the camera was.

    Nothing is needed but the spots, the table of markers and the camera. A solution is accepted only if chance
    would not give it and no other solution comes near; otherwise the result is falsy and says why.

    Parameters
    ----------
    detections : spots of one image, best first; false ones and missing markers are expected
    markers : table of markers. Known normals halve the search and exclude what cannot be seen
    camera : interior parameters
    prior : expected pose; solutions too far from it are rejected (AIAA 2005-5007, section III.C)
    prior_max_angle_deg : largest angle between the solution and the prior
    prior_max_scale : largest ratio of the scales of solution and prior, either way; > 1
    fixed : labels that are known: spot index -> name or index of its marker. Every solution must have them; they decide
        between solutions that are about equally good. Where the spots clearly say otherwise the result is a refusal
    excluded : spots that take no part: indices, or a mask (M,)
    visible : ``visible(cam_from_model, camera)`` says which markers nothing hides, (N,) bool, as a ray cast against the
        model's mesh does. Hidden markers are not expected and cannot be matched
    free_focal : solve for the focal length too. On flat markers seen frontally it is not determined: refused
    focal_range : with free_focal, focal lengths from 1 / focal_range to focal_range times the camera's are started
    max_focal_sigma : largest relative 1 sigma at which a free focal length counts as determined
    tolerance_px : neighbourhood in which a projected marker looks for its spot during the search; None takes
        0.4 % of the image's diagonal, more where the table's sigmas ask for it, less where the spots are dense. The
        final gates follow the residuals
    method : "hash" looks local quads of spots up in a table of local quads of markers (`registration.search.quads`);
        "ransac" is the paper's search with the changes listed in `registration.search.ransac`
    layout : `prepare(markers)`, to save its milliseconds when many images are registered with the same markers
    max_hypotheses : links of three markers to three spots to try before giving up
    max_time_s : CPU time after which the search gives up, without that for the ``layout`` and ``visible``; None is no
        limit. In any case it gives up after the work that takes a quiet machine some 25 ms for 24 markers and 100 ms
        for 150 and as many spots (20 s with "ransac"), or ``max_time_s`` if that is more. Work is counted, so the
        result depends on the machine only if the time strikes
    max_log10_nfa, min_score, min_margin : limits of acceptance, see `registration.task.Limits`
    max_table_error : markers that are farther off their table (1 sigma per coordinate beyond its sigma, as part of the
        distance to the nearest other marker) are those of another model of the same design
    max_deformation : a model whose residuals show that it is bent or twisted may differ from its table by a smooth
        displacement of so much, as part of its largest extent; see `Deformation`. 0: it is rigid
    seed : of the random triplets

    Returns
    -------
    A `Registration`, or a falsy `NotRegistered` with its reason.

    Raises
    ------
    ValueError
        For options out of range.
    """
    limits = Limits(max_log10_nfa, min_score, min_margin, max_focal_sigma, max_table_error, max_deformation)
    options: dict[str, Any] = {
        "prior_max_angle_deg": prior_max_angle_deg, "prior_max_scale": prior_max_scale, "free_focal": free_focal,
        "focal_range": focal_range, "max_focal_sigma": max_focal_sigma, "tolerance_px": tolerance_px,
        "method": method, "max_hypotheses": max_hypotheses, "max_time_s": max_time_s,
        "max_log10_nfa": max_log10_nfa, "min_score": min_score, "min_margin": min_margin,
        "max_table_error": max_table_error, "max_deformation": max_deformation, "seed": seed,
    }  # fmt: skip
    _check_options(options, prior)
    if layout is not None and not layout.is_of(markers):
        raise ValueError(
            "register: layout must be prepared from the same markers; their coordinates, normals or walls differ"
        )
    options["prior"], options["occlusion"] = prior, visible is not None
    usable = used_spots(np.asarray(np.isfinite(camera.unproject(detections.xy)).all(axis=1)), excluded)
    pairs = fixed_pairs(fixed, detections, markers, usable)
    options["fixed"] = {int(np.flatnonzero(usable)[s]): str(markers.name[m]) for s, m in pairs}
    options["excluded"] = np.flatnonzero(~usable)
    xy, cov = detections.xy[usable], detections.cov[usable]
    refusal = _refuse_early(xy, cov, markers, layout)
    if refusal is not None:
        return NotRegistered(*refusal, options=options)
    options["tolerance_px"] = tolerance_px = tolerance_px or default_tolerance(xy, camera, markers)
    task = Task(
        markers, camera, xy, cov, tolerance_px, prior, float(np.radians(prior_max_angle_deg)), prior_max_scale,
        tuple(np.geomspace(1 / focal_range, focal_range, FOCAL_STEPS)) if free_focal else (1.0,), pairs,
        visible, detections.radius_px[usable],
    )  # fmt: skip
    from windmark.registration.solve import solve  # this brings numba; importing the verb should cost nothing

    return solve(task, layout, limits, np.flatnonzero(usable), options)


def prepare(markers: MarkerSet) -> Layout:
    """What the search with ``method="hash"`` needs to know of a set of markers, to use it for many images."""
    from windmark.registration.search.layout import Layout  # this brings numba

    return Layout(markers)


def _check_options(options: dict[str, Any], prior: Pose | None) -> None:
    if options["method"] not in METHODS:
        raise ValueError(f"register: method must be one of {', '.join(METHODS)}, got {options['method']!r}")
    check_ranges("register", options, prior)


def check_ranges(verb: str, options: dict[str, Any], prior: Pose | None) -> None:
    """Raise for a prior that is a batch, and for numbers out of range among the options that a verb has."""
    if prior is not None and prior.rotation.ndim != 2:
        raise ValueError(f"{verb}: prior must be a single pose, got a batch {prior.rotation.shape[:-2]}")
    positive = ("prior_max_angle_deg", "max_focal_sigma", "max_hypotheses", "max_time_s", "max_table_error")
    above_one = ("prior_max_scale", "focal_range")
    for name in positive:
        if options.get(name) is not None and not options[name] > 0:
            raise ValueError(f"{verb}: {name} must be > 0, got {options[name]}")
    for name in above_one:
        if name in options and not options[name] > 1:
            raise ValueError(f"{verb}: {name} is a ratio and must be > 1, got {options[name]}")
    tolerance = options["tolerance_px"]
    if tolerance is not None and not (np.isfinite(tolerance) and tolerance > 0):
        raise ValueError(f"{verb}: tolerance_px must be > 0 and finite, or None, got {tolerance}")
    if not 0 <= options.get("max_deformation", 0.0) <= MOST_DEFORMATION:
        raise ValueError(
            f"{verb}: max_deformation must be from 0 to {MOST_DEFORMATION} of the model's size, "
            f"got {options['max_deformation']}"
        )
    if options["min_margin"] < 0:
        raise ValueError(f"{verb}: min_margin must be >= 0, got {options['min_margin']}")


def _refuse_early(xy: Array, cov: Array, markers: MarkerSet, layout: Layout | None) -> tuple[str, Any] | None:
    """What needs no search to say no: (reason, cause) or None."""
    if not np.isfinite(cov).all():
        raise ValueError("register: detections.cov must be finite")
    for count, what in ((len(xy), "spots"), (len(markers), "markers")):
        if count < MIN_COUNT:
            return f"{count} {what}: three pairs fix a pose and a fourth is needed to check it", "too_few"
    width = off_line(xy)
    if width < 0.5 + float(np.sqrt(cov.max())):
        return f"all {len(xy)} spots lie on one line (within {width:.2g} px)", "degenerate"
    if layout.on_line if layout is not None else on_line(markers.xyz):
        return f"all {len(markers)} markers lie on one line", "degenerate"
    return None


def default_tolerance(xy: Array, camera: Camera, markers: MarkerSet) -> float:
    """Neighbourhood for table errors and a rough pose, small enough to tell neighbouring spots apart.

    How large the table's errors are in the picture is not known before the pose is, but how large they are beside the
    spacing of the markers is that of the spots: to the fourth neighbour, since an oblique view shortens one direction.
    """
    wanted = DEFAULT_TOLERANCE * float(np.hypot(*camera.size_px))
    if len(xy) < 2:
        return max(0.5, wanted)
    if (rough := roughness(markers)) > 0:
        wanted = max(wanted, rough * _spacing(xy, ROUND))
    return max(0.5, min(wanted, MAX_SPACING * _spacing(xy, 1)))


def roughness(markers: MarkerSet) -> float:
    """How far off its table a marker may be, as part of the distance to the fourth neighbour; 0 without sigmas."""
    sigma = np.where(np.isfinite(markers.sigma), markers.sigma, 0.0)
    if not sigma.any() or not (apart := _spacing(markers.xyz, ROUND)) > 0:
        return 0.0
    return TABLE_SIGMAS * median(sigma.ravel()) / apart


def _spacing(points: Array, neighbour: int) -> float:
    """Median distance to the so-manieth nearest other point, or to the farthest if there are fewer."""
    from windmark.registration.search.near import nearest  # this brings numba

    return median(nearest(points, min(neighbour, len(points) - 1))[1][:, -1])
