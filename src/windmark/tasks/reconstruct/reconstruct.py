"""The verb `reconstruct`: unknown markers in the frame of a few known ones, from pictures without labels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.calibration import Calibration, Distance
from windmark.errors import UsageError
from windmark.geometry import Camera
from windmark.scene import Detections, Doubt, MarkerCovariance, MarkerSet, Tracks, View
from windmark.scene.repeated import ONCE_MORE
from windmark.scene.shown import by_name, check_kinds, list_of, optional
from windmark.tasks.reconstruct.again import Answers, asked_again
from windmark.tasks.reconstruct.doubts import Sight, labels_that_differ, radii_differ
from windmark.tasks.reconstruct.focal import refuse_gross, with_focals
from windmark.tasks.reconstruct.frame import Frame, FreeFrame, Held, holding
from windmark.tasks.reconstruct.free import frame_words, in_posed_frame
from windmark.tasks.reconstruct.groups import Framed, framed, why_left
from windmark.tasks.reconstruct.normals import with_normals
from windmark.tasks.reconstruct.off_table import off_their_table
from windmark.tasks.reconstruct.other_camera import judged, refuse_other
from windmark.tasks.reconstruct.pairwise import open_spots
from windmark.tasks.reconstruct.primaries import check_primaries, with_sigma
from windmark.tasks.reconstruct.result import NotReconstructed, Reconstruction
from windmark.tasks.reconstruct.structure import Structure, adjusted, compact, linked, marks_of, rows_of
from windmark.tasks.reconstruct.task import FEWEST_SPOTS, Labels, Refused, Task
from windmark.tasks.reconstruct.two_places import two_places

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FINAL_ROUNDS = 3
SAME_LINKS = 0.001
"""Part of the links that may differ where they are called the same."""
ASKED = 6
"""Times that pictures may move after everything was adjusted; then they are left out."""
ALONE = "nothing connects it with the others"
LIMIT_3D = 16.27
"""99.9 % point of chi-square with three degrees of freedom."""


def reconstruct(
    detections: Sequence[Detections],
    cameras: Camera | Mapping[str, Camera],
    primary: MarkerSet | None,
    *,
    primary_cov: MarkerCovariance | None = None,
    views: Sequence[View] | None = None,
    labels: Labels | None = None,
    rough: MarkerSet | None = None,
    free: Sequence[str] = (),
    model_px: float = 0.0,
    distances: Sequence[Distance] = (),
    seed: int = 0,
) -> Reconstruction | NotReconstructed:
    """Find which spot of which picture is which marker, and where the markers are (AIAA 2005-5007, section VI).

    Two pictures are matched by their constellations; all others are registered to the points these give; then the
    spots of all pictures are linked by geometry alone, everything is adjusted together, and the primary markers,
    recognised by their mutual distances or by labels, give the frame and the scale.

    Parameters
    ----------
    detections : spots of each picture, in any order; false ones, missing ones and useless pictures are expected
    cameras : interior parameters, one camera or several by name; known from a calibration, or roughly with ``free``
    primary : known markers: three with labels, four or more without (six are safe); their ``sigma`` counts, and is
        1e-4 of their extent where there is none
        None: a free frame, see `free`; the scale is that of given poses or of ``distances``, or free
    primary_cov : joint covariance of primaries whose errors are correlated, in place of their ``sigma``
    views : one per picture: its name, its camera, and ``cam_from_model`` in the primaries' frame where it is known,
        roughly. None: one camera, pictures named by their numbers
    labels : {name of a view: {spot: name}} where some are known. Four primaries in a picture give its pose; any seven
        names, also of markers that are no primaries, that two pictures share give their epipolar geometry
    rough : rough coordinates of some or all markers, in the primaries' frame: pictures are registered to them
    free : interior parameters to be found, too, in the last adjustment; see `self_calibrate`
    model_px : 1 sigma per coordinate of what the spots' covariances do not hold: what lens, light and compression
        leave. A calibration with the same camera measures it (`windmark calibrate`: beyond the detector's noise)
    distances : known distances between labelled markers, which give a free frame its scale
    seed : of every random search

    Returns
    -------
    A `Reconstruction`, or a falsy `NotReconstructed` with its reason.

    Raises
    ------
    ValueError
        For arguments that do not fit together.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> xyz = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3)) * [2.0, 1.5, 0.2]
    >>> camera, eyes = wm.Camera((640, 480), 800.0), [(-1, 0, 6), (1, 0, 6), (0, 1, 6)]
    >>> poses = [wm.Pose.look_at(eye, [0, 0, 0], [0, 1, 0]) for eye in eyes]
    >>> spots = [wm.Detections.make(camera.project(pose.apply(xyz))[0].round(2), sigma_px=0.01) for pose in poses]
    >>> known = wm.MarkerSet.make(["a", "b", "c", "d", "e", "f"], xyz[:6], role="primary")
    >>> views = [wm.View(f"view{i}", cam_from_model=pose) for i, pose in enumerate(poses)]
    >>> found = wm.reconstruct(spots, camera, known, views=views)  # nothing says which spot is which marker
    >>> bool(found), len(found.markers), set(known.name) <= set(found.markers.name)
    (True, 20, True)
    """
    check_kinds(
        "reconstruct", detections=(detections, list_of(Detections)), cameras=(cameras, by_name(Camera)),
        primary=(primary, optional(MarkerSet)),
    )  # fmt: skip
    task = Task.checked(detections, cameras, primary, views, labels, free, seed, model_px, primary_cov)
    options: dict[str, Any] = {
        "free": tuple(free), "model_px": model_px, "seed": seed, "rough": rough is not None,
        "poses": len(task.given), "distances": tuple(distances),
        "primary_cov": primary_cov is not None,
    }  # fmt: skip
    dropped = {
        v.name: f"{len(d)} spots, at least {FEWEST_SPOTS} are needed"
        for v, d in zip(task.views, task.detections, strict=True)
        if len(d) < FEWEST_SPOTS
    }
    dropped |= {
        task.views[v].name: f"{task.views[first].name} once more: {ONCE_MORE}" for v, first in task.repeated.items()
    }
    if distances and primary is not None:
        raise UsageError("reconstruct: distances give a free frame its scale; with primaries leave them out")
    try:
        if primary is not None:
            check_primaries(primary)
        known = framed(task, rough)
        refuse_gross(task, known.group.structure)
        begun: Frame = Held(task, known.group.structure, known.located) if known.located else FreeFrame(task, distances)
        structure, result, names, linked_marks, how, said = _confirmed(task, known, begun, free)
        held = holding(begun, names)
        other = judged(task, structure, result, **held)
        focals = refuse_gross(task, structure, **held) if other.may_be_focal else []
    except Refused as refusal:
        dropped |= {task.views[v].name: "could not be connected with the others" for v in refusal.alone}
        return NotReconstructed(refusal.reason, refusal.cause, dropped, options)  # type: ignore[arg-type]
    for v, view in enumerate(task.views):
        if v not in structure.poses and view.name not in dropped:
            dropped[view.name] = why_left(task, known.others, v) or said.out.get(v, ALONE)
    calibration, frame_doubts = other.calibration, list[Doubt]()
    if not known.located:
        structure, calibration, frame_doubts = in_posed_frame(task, structure, calibration)
    out = _result(task, structure, calibration, names, linked_marks, dropped, how, options)
    frame, unitless = ("", False) if known.located else frame_words(task, structure, distances)
    out = replace(out, frame=frame, free_scale=unitless, open_spots=open_spots(task, out))
    out = _doubted(task, out, said.doubts)
    return replace(out, doubts=(*with_focals(focals, other), *frame_doubts, *out.doubts), unchecked=other.unchecked)


def _doubted(task: Task, out: Reconstruction, said: Sequence[Doubt]) -> Reconstruction:
    """With what speaks against it."""
    sight = Sight.of(out.markers, out.tracks, out.views, out.cameras)
    why, off = off_their_table(task.primary, out.calibration, sight, out.views, out.cameras)
    pictures = {str(v): view.name for v, view in enumerate(task.views)}
    labels = labels_that_differ(task, out.tracks, out.markers)
    radii = radii_differ(task, out.markers, out.tracks, out.views)
    doubts = (*radii, *(d.renamed(pictures) for d in said), *labels, *two_places(out.markers, sight), *off)
    return replace(out, doubts=doubts, unrecognised=why)


def _confirmed(
    task: Task, known: Framed, frame: Frame, free: Sequence[str]
) -> tuple[Structure, Calibration, list[str], Mask, dict[int, str], Answers]:
    """`_in_frame`, with every picture where the finished structure puts it, how each got there, and what they said."""
    structure, out, answers = known.group.structure, dict[int, str](), Answers({}, {}, False)
    how = known.group.found_by
    for asked in range(ASKED + 2):
        structure, result, names, linked_marks = _in_frame(task, structure, frame, free)
        # All were asked with these links already, and with these cameras.
        same = structure.posed == sorted(task.usable) and _same_links(structure, known.group.structure.asked)
        if asked > ASKED or (asked == 0 and same and not free):
            break
        answers = asked_again(task, task.usable, structure, result, names, how, last=asked == ASKED)
        how = how | dict.fromkeys(answers.moved, "register")
        out = {v: why for v, why in out.items() if v not in answers.moved} | dict(answers.out)
        if not answers.changed:
            break
        structure = compact(answers.applied(structure))
    return structure, result, names, linked_marks, how, replace(answers, out=out)


def _same_links(structure: Structure, links: frozenset[tuple[int, int]]) -> bool:
    """Whether a structure has these links (view, spot)."""
    return len(structure.links ^ links) <= SAME_LINKS * len(structure.point)


def _in_frame(
    task: Task, structure: Structure, frame: Frame, free: Sequence[str]
) -> tuple[Structure, Calibration, list[str], Mask]:
    """Everything adjusted in the frame that was asked for, with all links that the final poses allow.

    Names of the points, and which marks of the adjustment are links, are given, too.
    """
    for linkings in range(FINAL_ROUNDS + 1):
        structure, names = frame.prepared(structure)
        result = adjusted(task, structure, frame.datum, free, names, frame.table, frame.distances)
        if not isinstance(result, tuple):
            refuse_other(task, structure, result.reason, **holding(frame, names))
            raise Refused("adjustment", result.reason)
        before = structure
        structure, calibration = result
        frame.adjusted(structure, names)
        again = compact(linked(task, structure))
        if linkings == FINAL_ROUNDS or _same_links(before, again.links):
            break
        structure = again
    structure, kept = _with_left_out(before, structure, calibration, names, again)
    return structure, calibration, names, kept


def _with_left_out(
    before: Structure, structure: Structure, calibration: Calibration, names: list[str], again: Structure
) -> tuple[Structure, Mask]:
    """The links of an adjustment, and those that it left out but that geometry, asked ``again``, gives the same point.

    Given as a structure, and as a mask (O,) of the adjustment's marks.

    The tests of an adjustment say which marks are good enough to measure with. Which marker a spot is, is another
    question: one beside its place by more than its noise, but with no other marker near, is still that marker.
    """
    view, point, spot = marks_of(before, rows_of(names, calibration), calibration)
    owner = {(v, s): p for v, s, p in zip(again.view.tolist(), again.spot.tolist(), again.point.tolist(), strict=True)}
    votes: dict[int, Counter[int]] = {}
    for v, p, s in zip(structure.view.tolist(), structure.point.tolist(), structure.spot.tolist(), strict=True):
        if (v, s) in owner:
            votes.setdefault(p, Counter())[owner[v, s]] += 1
    same = {p: count.most_common(1)[0][0] for p, count in votes.items()}
    kept = calibration.used.copy()
    for k in np.flatnonzero(~kept):
        kept[k] = owner.get((int(view[k]), int(spot[k])), -1) == same.get(int(point[k]), -2)
    return replace(structure, view=view[kept], point=point[kept], spot=spot[kept]), kept


def _other_primaries(task: Task, calibration: Calibration) -> dict[str, str]:
    """{name: primary} of points that are where the table has a primary that took no part in finding the frame.

    It must be the only one within the uncertainty (99.9 %) of the place.
    """
    markers = calibration.markers
    if not len(task.primary):
        return {}
    table, taken = with_sigma(task.primary), set(markers.name.tolist())
    out: dict[str, str] = {}
    for name, place, sigma in zip(table.name, table.xyz, table.sigma, strict=True):
        if str(name) in taken:
            continue
        gap = markers.xyz - place
        cov = calibration.marker_cov + np.diag(sigma**2)
        near = np.flatnonzero(np.einsum("ni,nij,nj->n", gap, np.linalg.inv(cov), gap) < LIMIT_3D)
        if len(near) == 1 and str(markers.name[near[0]]) not in out:
            out[str(markers.name[near[0]])] = str(name)
    return out


def _taken_for_primaries(task: Task, calibration: Calibration) -> dict[str, str]:
    """{primary: other name} of markers that were taken for primaries, which the others put elsewhere, and are not.

    No label says that they are, and they are no nearer to the primary's place than other markers are to them: a place
    was all that named them.
    """
    places = calibration.markers.xyz
    if len(places) < 2:
        return {}
    at = dict(zip(calibration.markers.name.tolist(), places, strict=True))
    table = dict(zip(task.primary.name.tolist(), task.primary.xyz, strict=True))
    labelled = {str(task.primary.name[p]) for mine in task.labels for p in mine.values()}
    out: dict[str, str] = {}
    for name in dict.fromkeys(n for d in calibration.doubts if d.cause == "control" for n in d.names):
        if name in table and name in at and name not in labelled:
            next_to = np.sort(np.linalg.norm(places - at[name], axis=1))[1]
            if np.linalg.norm(at[name] - table[name]) > 0.5 * next_to:
                out[name] = f"s{len(at) + len(out) + 1:03d}"  # numbers go up to that of all markers at most
    return out


def _result(
    task: Task, structure: Structure, calibration: Calibration, names: list[str], linked_marks: Mask,
    dropped: dict[str, str], found_by: dict[int, str], options: dict[str, Any],
) -> Reconstruction:  # fmt: skip
    known, more = set(task.primary.name.tolist()), _other_primaries(task, calibration)
    more |= _taken_for_primaries(task, calibration)
    row = {n: k for k, n in enumerate(names)}
    place = {row[str(n)]: k for k, n in enumerate(calibration.markers.name)}
    name = np.array([more.get(str(n), str(n)) for n in calibration.markers.name])
    role = ["primary" if n in known else "secondary" for n in name]
    kept = np.array([int(p) in place for p in structure.point], dtype=np.bool_)
    track = np.array([place[int(p)] for p in structure.point[kept]], dtype=np.int64)
    views = tuple(replace(v, cam_from_model=structure.poses.get(k)) for k, v in enumerate(task.views))
    # What is said of a primary's place in its table is of that primary, whatever the marker is called.
    renamed = {n: m for n, m in more.items() if n not in known}
    renamed |= {str(k): v.name for k, v in enumerate(task.views) if str(k) not in row}
    calibration = replace(
        calibration, markers=replace(calibration.markers, name=name),
        views=tuple(replace(v, name=task.views[int(v.name)].name) for v in calibration.views),
        dropped={renamed.get(n, n): why for n, why in calibration.dropped.items()},
        suspect=tuple(renamed.get(n, n) for n in calibration.suspect),
        doubts=tuple(d.renamed(renamed) for d in calibration.doubts),
        swapped=tuple((more.get(a, a), more.get(b, b), renamed.get(v, v)) for a, b, v in calibration.swapped),
    )  # fmt: skip
    tracks = Tracks(track, structure.view[kept], structure.spot[kept])
    markers, normal_sigma = with_normals(
        replace(calibration.markers, role=np.array(role)), tracks, task.detections, views, calibration.cameras
    )
    return Reconstruction(
        markers, calibration.marker_cov, normal_sigma, np.bincount(track, minlength=len(name)), views,
        calibration.cameras, tracks, linked_marks, calibration, dropped,
        {task.views[v].name: how for v, how in found_by.items() if v in structure.poses}, options,
    )  # fmt: skip
