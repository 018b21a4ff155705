"""The verb `register`: from unlabelled spots to labels and pose, of one camera or a rig, without the user's help."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError, g2
from windmark.geometry import Camera, Pose
from windmark.options.registration import MAX_DEFORMATION, MAX_TABLE_ERROR, METHOD, PRIOR_MAX_ANGLE_DEG, PRIOR_MAX_SCALE
from windmark.registration.options import check_options, default_tolerance
from windmark.registration.result import Cause, NotRegistered, Registration, RigRegistration
from windmark.registration.task import (
    MIN_COUNT,
    ON_LINE_PX,
    Fixed,
    Limits,
    Task,
    Visible,
    fixed_pairs,
    ideal_pixels,
    near_px,
    off_line,
    on_line,
    used_spots,
)
from windmark.scene import Detections, MarkerSet
from windmark.scene.shown import check_kinds

if TYPE_CHECKING:
    from windmark.registration.search.layout import Layout

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

FOCAL_STEPS = 5


@overload
def register(
    detections: Detections, markers: MarkerSet, camera: Camera, *, cam_from_rig: None = None, **options: Any
) -> Registration | NotRegistered: ...
@overload
def register(
    detections: Sequence[Detections], markers: MarkerSet, camera: Sequence[Camera], *, cam_from_rig: Sequence[Pose],
    **options: Any,
) -> RigRegistration | NotRegistered: ...  # fmt: skip
def register(  # type: ignore[misc]  # the overloads leave the options to this one
    detections: Detections | Sequence[Detections],
    markers: MarkerSet,
    camera: Camera | Sequence[Camera],
    *,
    cam_from_rig: Sequence[Pose] | None = None,
    rig_cov: Sequence[ArrayLike | None] | None = None,
    prior: Pose | None = None,
    prior_max_angle_deg: float = PRIOR_MAX_ANGLE_DEG.default,
    prior_max_scale: float = PRIOR_MAX_SCALE.default,
    fixed: Fixed | Sequence[Fixed | None] | None = None,
    binding: bool = False,
    excluded: ArrayLike | Sequence[ArrayLike | None] | None = None,
    visible: Visible | None = None,
    free_focal: bool | Sequence[bool] = False,
    focal_range: float = 1.5,
    max_focal_sigma: float = 0.05,
    tolerance_px: float | None = None,
    method: str = METHOD.default,
    layout: Layout | None = None,
    max_hypotheses: int = 1_000_000,
    max_time_s: float | None = None,
    max_log10_nfa: float = -9.0,
    min_score: float = 60.0,
    min_margin: float = 10.0,
    max_table_error: float = MAX_TABLE_ERROR.default,
    max_deformation: float = MAX_DEFORMATION.default,
    seed: int = 0,
) -> Registration | RigRegistration | NotRegistered:
    """Find which spot is which marker and where the camera was, in one image or in those of a rig.

    Nothing is needed but the spots, the table of markers and the camera. A solution is accepted only if chance
    would not give it and no other explanation comes near; otherwise the result is falsy and says why. What the picture
    cannot tell is named in ``unchecked``.

    Of a bent model the pose is that of its root, which the picture does not tell: markers that stand still before the
    camera together with the model's root may be given the role "wall", then the pose is theirs. Otherwise it is the
    mean over all parts that may be the root, with a covariance that covers each. Where a rigid model leaves more than
    the noise, the covariance has what a deformation would change, as far as the residuals look like one. A bow that is
    lost in the noise is not in it: the pose is that of a straight model, and ``unchecked`` ("bending") says how large a
    bow would not show and how far the root would be turned by it. With ``max_deformation`` 0 there is none.

    With a rig each camera proposes poses by its own spots. Every proposal, also one that a camera alone would find
    weak, is carried to the other cameras; pose and labels settle in all of them together, and the sum of their evidence
    counts. An ambiguity of one camera that another one resolves is none.

    Parameters
    ----------
    detections : spots of one image, best first; false ones and missing markers are expected. Of a rig, of each of its C
        images; a camera without spots takes no part
    markers : table of markers. Known normals halve the search and exclude what cannot be seen
    camera : interior parameters; with ``Camera.cov`` they are found together with the pose as far as that leaves them
        open, and the pose's covariance has it. Of a rig, of each camera
    cam_from_rig : of a rig, where each camera is in its frame (any frame fixed to them, as that of one of them), in the
        markers' length unit. A camera that is elsewhere is a reason to refuse ("wrong_camera") and named, of two
        cameras both; where their places are slightly off the sigma of the pose has it, and ``unchecked`` says so
    rig_cov : (6, 6) of ``exp(delta) @ cam_from_rig`` of each camera, or None for one whose place is exact (as of the
        one whose frame it is). The places are then found together with the pose
    prior : expected pose (of a rig, rig_from_model); solutions too far from it are rejected (AIAA 2005-5007, section
        III.C)
    prior_max_angle_deg : largest angle between the solution and the prior
    prior_max_scale : largest ratio of the scales of solution and prior, either way; > 1
    fixed : labels that are known: spot index -> name or index of its marker. Every solution must have them; they decide
        between solutions that are about equally good. Where the spots clearly say otherwise the result is a refusal.
        Of a rig, for each camera
    binding : the fixed labels are facts: no other solution is compared with them, and no gate drops them
    excluded : spots that take no part: indices, or a mask (M,); of a rig, for each camera
    visible : ``visible(cam_from_model, camera)`` says which markers nothing hides, (N,) bool, as a ray cast against the
        model's mesh does. Hidden markers are not expected and cannot be matched
    free_focal : solve for the focal length too; of a rig, of all cameras or of those that are named. On flat markers
        seen frontally it is not determined: refused
    focal_range : with free_focal, focal lengths from 1 / focal_range to focal_range times the camera's are started
    max_focal_sigma : largest relative 1 sigma at which a free focal length counts as determined
    tolerance_px : neighbourhood in which a projected marker looks for its spot during the search; None takes
        0.4 % of the image's diagonal, more where the table's sigmas ask for it, less where the spots are dense. The
        final gates follow the residuals
    method : "hash" looks local quads of spots up in a table of local quads of markers (`registration.search.links`);
        "ransac" is the paper's search with the changes listed in `registration.search.search`
    layout : `prepare(markers)`, to save its milliseconds when many images are registered with the same markers
    max_hypotheses : links of three markers to three spots to try before giving up
    max_time_s : CPU time after which the search gives up, without that for the ``layout`` and ``visible``; None is no
        limit. In any case it gives up after the work that takes a quiet machine some 25 ms for 24 markers and 100 ms
        for 150 and as many spots (20 s with "ransac", 0.2 s for each camera of a rig), or ``max_time_s`` if that is
        more. Work is counted, so the result depends on the machine only if the time strikes
    max_log10_nfa, min_score, min_margin : limits of acceptance, see `registration.task.Limits`. A picture of
        few spots (at most twelve) that explains nearly all of them is judged by its odds, price of the pose included,
        which must be above ``min_score`` - 50 nats
    max_table_error : markers that are farther off their table (1 sigma per coordinate beyond its sigma, as part of the
        distance to the nearest other marker) are those of another model of the same design; another labelling that
        needs more than that is no rival
    max_deformation : a model whose residuals show that it is bent or twisted may differ from its table by a smooth
        displacement of so much, as part of its largest extent; see `Deformation`. 0: it is rigid
    seed : of the random triplets

    Returns
    -------
    A `Registration`, of a rig a `RigRegistration`, or a falsy `NotRegistered` with its reason.

    Raises
    ------
    ValueError
        For options out of range, and numbers of images, cameras and poses that differ.

    Examples
    --------
    >>> import windmark as wm
    >>> test = wm.synth.wind_tunnel(1, size_px=(640, 512), nodes=2000, clutter=None)
    >>> shot = test.shot("wind-off")
    >>> answer = wm.register(wm.detect(shot.image, radius_px=2.0), test.markers, test.cameras["cam1"])
    >>> bool(answer), answer.rms_px < 0.1
    (True, True)
    >>> float(answer.cam_from_model.angle_to(shot.view.cam_from_model)) < 1e-3
    True
    """
    verb = "register" if cam_from_rig is None else "register_rig"
    if cam_from_rig is None and not (isinstance(detections, list | tuple) and isinstance(camera, list | tuple)):
        check_kinds(verb, detections=(detections, Detections), markers=(markers, MarkerSet), camera=(camera, Camera))
    spots, cameras, poses = _of_cameras(verb, detections, camera, cam_from_rig)
    limits = Limits(max_log10_nfa, min_score, min_margin, max_focal_sigma, max_table_error, max_deformation)
    options: dict[str, Any] = {
        "prior_max_angle_deg": prior_max_angle_deg, "prior_max_scale": prior_max_scale, "free_focal": free_focal,
        "focal_range": focal_range, "max_focal_sigma": max_focal_sigma, "tolerance_px": tolerance_px,
        "method": method, "max_hypotheses": max_hypotheses, "max_time_s": max_time_s,
        "max_log10_nfa": max_log10_nfa, "min_score": min_score, "min_margin": min_margin,
        "max_table_error": max_table_error, "max_deformation": max_deformation, "seed": seed,
    }  # fmt: skip
    check_options(verb, options, prior)
    places = _place_covs(rig_cov, poses)
    if layout is not None and not layout.is_of(markers):
        raise ValueError(
            f"{verb}: layout must be prepared from the same markers; their coordinates, normals or walls differ"
        )
    options["prior"], options["occlusion"] = prior, visible is not None
    tasks, index = [], []
    for c, (d, one) in enumerate(zip(spots, cameras, strict=True)):
        if not np.isfinite(d.cov).all():
            where = "detections" if cam_from_rig is None else f"detections[{c}]"
            raise ValueError(f"{verb}: {where}.cov must be finite")
        task, used = _task(
            d, markers, one, prior if poses is None or prior is None else poses[c] @ prior,
            _of(fixed, c, poses), _of(excluded, c, poses), bool(_of(free_focal, c, poses)), visible, binding, options,
        )  # fmt: skip
        tasks.append(task)
        index.append(used)
    options["fixed"] = _told([_labels(t, u, markers) for t, u in zip(tasks, index, strict=True)], poses)
    options["excluded"] = _told(
        [np.delete(np.arange(len(d)), used) for d, used in zip(spots, index, strict=True)], poses
    )
    if (refusal := _refuse_early(tasks, markers, layout)) is not None:
        return NotRegistered(*refusal, options=options)
    options["tolerance_px"] = _told([task.tolerance_px for task in tasks], poses)
    from windmark.registration.solve import solve  # this brings numba; importing the verb should cost nothing

    return solve(tasks, poses, places, layout, limits, index, options)


def register_rig(
    detections: Sequence[Detections], markers: MarkerSet, cameras: Sequence[Camera], cam_from_rig: Sequence[Pose],
    **options: Any,
) -> RigRegistration | NotRegistered:  # fmt: skip
    """`register` of several images taken at once, with its options; ``cam_from_rig`` says where the cameras are.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> rng = np.random.default_rng(1)
    >>> markers = wm.MarkerSet.make([f"m{i}" for i in range(20)], rng.uniform(-1.0, 1.0, (20, 3)) * [2.0, 1.0, 0.2])
    >>> camera = wm.Camera((640, 480), 800.0)
    >>> poses = [wm.Pose.look_at([x, 0.3, 6.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]) for x in (-1.0, 1.0)]
    >>> cam_from_rig = [pose @ poses[0].inverse() for pose in poses]  # the first camera's frame is the rig's
    >>> spots = [wm.Detections.make(camera.project(pose.apply(markers.xyz))[0].round(1)) for pose in poses]
    >>> answer = wm.register_rig(spots, markers, [camera, camera], cam_from_rig)
    >>> bool(answer), bool(answer.rig_from_model.angle_to(poses[0]) < 1e-3)
    (True, True)
    """
    return register(detections, markers, cameras, cam_from_rig=cam_from_rig, **options)


def _of_cameras(
    verb: str, detections: Detections | Sequence[Detections], camera: Camera | Sequence[Camera],
    cam_from_rig: Sequence[Pose] | None,
) -> tuple[list[Detections], list[Camera], list[Pose] | None]:  # fmt: skip
    """Images, cameras and poses as lists; raises for numbers that differ."""
    if cam_from_rig is None:
        if not (isinstance(detections, Detections) and isinstance(camera, Camera)):
            raise UsageError(f"{verb}: several images need cam_from_rig, where their cameras are")
        return [detections], [camera], None
    spots, cameras, poses = list(detections), list(camera), list(cam_from_rig)  # type: ignore[arg-type]
    if not len(spots) == len(cameras) == len(poses) or not len(cameras):
        raise ValueError(
            f"{verb}: as many detections, cameras and poses are needed, and at least one, got {len(spots)}, "
            f"{len(cameras)} and {len(poses)}"
        )
    for n, pose in enumerate(poses):
        if pose.rotation.ndim != 2:
            raise ValueError(f"{verb}: cam_from_rig[{n}] must be a single pose, got a batch {pose.rotation.shape[:-2]}")
    return spots, cameras, poses


def _place_covs(
    rig_cov: Sequence[ArrayLike | None] | None, poses: Sequence[Pose] | None
) -> list[Array | None]:  # fmt: skip
    """The covariance of each camera's place, or None; raises for other shapes and numbers."""
    if rig_cov is None:
        return [None] * len(poses or (0,))
    covs = [None if cov is None else np.asarray(cov, dtype=float) for cov in rig_cov]
    if poses is None or len(covs) != len(poses):
        raise UsageError("register: rig_cov is for each camera of a rig, beside cam_from_rig")
    for n, cov in enumerate(covs):
        if cov is not None and not (cov.shape == (6, 6) and np.isfinite(cov).all()):
            raise ValueError(f"register: rig_cov[{n}] must be (6, 6) and finite, or None")
    return covs


def _of(given: Any, c: int, poses: Sequence[Pose] | None) -> Any:
    """An option of one camera: of a rig it may be given for each."""
    if poses is None or given is None or isinstance(given, bool):
        return given
    if len(given) != len(poses):
        raise ValueError(f"register_rig: fixed, excluded and free_focal are for each of {len(poses)} cameras, "
                         f"got {len(given)}")  # fmt: skip
    return given[c]


def _told(values: list[Any], poses: Sequence[Pose] | None) -> Any:
    """What is told of each camera: a value, or one for each."""
    return values[0] if poses is None else tuple(values)


def _task(
    detections: Detections, markers: MarkerSet, camera: Camera, prior: Pose | None, fixed: Fixed | None,
    excluded: ArrayLike | None, free_focal: bool, visible: Visible | None, binding: bool, options: dict[str, Any],
) -> tuple[Task, Ints]:  # fmt: skip
    """One camera's task, and which spots take part."""
    rays = camera.unproject(detections.xy)
    usable = used_spots(np.asarray(np.isfinite(rays).all(axis=1)), excluded)
    pairs = fixed_pairs(fixed, detections, markers, usable)
    xy, factor = detections.xy[usable], options["focal_range"]
    near = near_px(xy)
    task = Task(
        markers, camera, xy, detections.cov[usable],
        options["tolerance_px"] or default_tolerance(xy, camera, markers, near),
        prior, float(np.radians(options["prior_max_angle_deg"])), options["prior_max_scale"],
        tuple(np.geomspace(1 / factor, factor, FOCAL_STEPS)) if free_focal else (1.0,), pairs,
        visible, detections.radius_px[usable], binding,
    )  # fmt: skip
    task.__dict__.update(plane_xy=ideal_pixels(camera, rays[usable]), near_px=near)  # they would only be found again
    return task, np.flatnonzero(usable)


def _labels(task: Task, used: Ints, markers: MarkerSet) -> dict[int, str]:
    return {int(used[s]): str(markers.name[m]) for s, m in task.fixed}


def prepare(markers: MarkerSet) -> Layout:
    """What the search with ``method="hash"`` needs to know of a set of markers, to use it for many images."""
    from windmark.registration.search.layout import Layout  # this brings numba

    return Layout(markers)


def _refuse_early(tasks: list[Task], markers: MarkerSet, layout: Layout | None) -> tuple[str, Cause] | None:
    """What needs no search to say no: (reason, cause) or None."""
    most = max(len(task.xy) for task in tasks)
    where = "" if len(tasks) == 1 else " in the fullest image"
    for count, what, at in ((most, "spot", where), (len(markers), "marker", "")):
        if count < MIN_COUNT:
            found = f"{count} {what}{'' if count == 1 else 's'}{at}"
            return f"{found}: three pairs fix a pose and a fourth is needed to check it", "too_few"
    widths = [off_line(task.xy) for task in tasks if len(task.xy) >= MIN_COUNT]
    worst = max(float(task.cov.max()) for task in tasks if len(task.xy))
    if all(width < ON_LINE_PX + np.sqrt(worst) for width in widths):
        if len(tasks) == 1:
            return f"all {most} spots lie on one line (within {g2(widths[0])} px)", "degenerate"
        return "the spots of every image lie on one line", "degenerate"
    if layout.on_line if layout is not None else on_line(markers.xyz):
        return f"all {len(markers)} markers lie on one line", "degenerate"
    return None
