"""Attacks 1 to 4: layouts of markers that fit in more ways than one. Each takes a seed and makes a trial."""

from __future__ import annotations

import numpy as np

import _attack_models as models
from _attack_pictures import Array, Bools, Trial, bent, near, picture, rigid_fits, seen_by, trial_of, view
from windmark.geometry import Camera, Pose
from windmark.scene import Detections, MarkerSet

# --- 1: one pair holds the pose ---------------------------------------------------------------


def one_row(seed: int, *, relief: float = 0.0, left: int = 1, false: float = 0.0, normals: bool = True) -> Trial:
    """Two parallel rows, of the second only so many spots; 0 leaves one stray spot near its place."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(7, 15))
    markers = models.rows(rng, count, apart=rng.uniform(0.12, 0.6), relief=relief)
    camera, pose = view(rng, markers, least=2 * count - 2)
    xy, seen = seen_by(markers, camera, pose)
    keep = np.ones(len(markers), dtype=bool)
    second = rng.permutation(np.arange(count, 2 * count)[seen[count:]])
    keep[count:] = False
    keep[second[:left]] = True
    stray = None
    if not left:
        stray = xy[second[:1]] + rng.normal(0, 0.02 * np.hypot(*camera.size_px), (1, 2))
    shot = picture(rng, markers, camera, pose, keep=keep, false=false, extra=stray)
    return trial_of(shot, markers if normals else models.without_normals(markers))


def grazing(seed: int) -> Trial:
    """A roof: one row faces the camera, the other is on a slope seen at grazing angle, all but one spot unseen."""
    rng = np.random.default_rng(seed)
    count = 8
    flat = models.rows(rng, count, apart=rng.uniform(0.2, 0.5), relief=0.002)
    slope = np.radians(rng.uniform(55, 75))
    normal = flat.normal.copy()
    normal[count:] = [0.0, np.sin(slope), np.cos(slope)]
    markers = models.table(flat.xyz, normal)
    for _ in range(200):
        camera, pose = view(rng, markers, tilt_max_deg=40, least=count)
        eye = pose.center - markers.xyz[count:]
        angle = np.degrees(np.arccos(np.einsum("ij,ij->i", normal[count:], eye) / np.linalg.norm(eye, axis=1)))
        if 68 < angle.mean() < 82:
            break
    keep = np.ones(2 * count, dtype=bool)
    keep[count:] = False
    keep[count + rng.integers(count)] = True
    return trial_of(picture(rng, markers, camera, pose, keep=keep, false=rng.choice([0.0, 0.3])), markers)


def eight_left(seed: int, *, false: float = 0.0) -> Trial:
    """Eight neighbouring spots of a rounded body; other poses show eight alone, with the rest turned away."""
    rng = np.random.default_rng(seed)
    markers = models.some(rng, (models.scenes.wing_and_body, models.building, models.fuselage, models.delta))
    camera, pose = view(rng, markers, tilt_max_deg=80, least=16)
    xy, seen = seen_by(markers, camera, pose)
    index = np.flatnonzero(seen)
    middle = xy[rng.choice(index)]
    nearest = index[np.argsort(np.linalg.norm(xy[index] - middle, axis=1))[:8]]
    keep = np.isin(np.arange(len(markers)), nearest)
    shot = picture(rng, markers, camera, pose, keep=keep, false=false)
    return trial_of(shot, markers)


def part_and_stray(seed: int, *, false: float = 0.0) -> Trial:
    """A row, some neighbours or a strip of the markers, and one or two stray spots near others; the rest is hidden."""
    rng = np.random.default_rng(seed)
    count, kind = int(rng.integers(7, 15)), rng.choice(["row", "neighbours", "strip"])
    if kind == "row":
        markers = models.rows(rng, count, apart=rng.uniform(0.12, 1.0), relief=rng.choice([0.003, 0.01, 0.02, 0.04]))
    else:
        several = (models.scenes.wing_and_body, models.building, models.fuselage, models.delta, models.flat_wing)
        markers = models.some(rng, several)
    camera, pose = view(rng, markers, tilt_max_deg=60, least=2 * count - 2 if kind == "row" else 16)
    xy, seen = seen_by(markers, camera, pose)
    index = np.flatnonzero(seen)
    off = xy[index] - xy[rng.choice(index)]
    away = np.linalg.norm(off, axis=1) if kind == "neighbours" else np.abs(off @ _direction(rng))
    keep = np.isin(np.arange(len(markers)), index[np.argsort(away)[:count]])
    if kind == "row":
        keep = np.arange(2 * count) < count
    rest = index[~keep[index]]
    others = rng.choice(rest, min(int(rng.integers(1, 3)), len(rest)), replace=False)
    sigma = rng.choice([0.003, 0.01, 0.02, 0.05]) * np.hypot(*camera.size_px)
    stray = xy[others] + rng.normal(0, sigma, (len(others), 2))
    return trial_of(picture(rng, markers, camera, pose, keep=keep, false=false, extra=stray), markers)


def _direction(rng: np.random.Generator) -> Array:
    """(2,) a random unit vector."""
    turn = rng.uniform(0, 2 * np.pi)
    return np.array([np.cos(turn), np.sin(turn)])


def oblique(seed: int, *, left: int = 1) -> Trial:
    """Two rows on a flat plate that is itself seen at 64 to 74 degrees, of the second so many spots."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(7, 15))
    markers = models.rows(rng, count, apart=rng.uniform(0.3, 0.8), relief=0.002)
    for _ in range(500):
        camera, pose = view(rng, markers, tilt_max_deg=74)
        eye = pose.center - markers.xyz.mean(axis=0)
        if eye[2] < np.cos(np.radians(64)) * np.linalg.norm(eye) and seen_by(markers, camera, pose)[1].sum() > count:
            break
    keep = np.arange(2 * count) < count
    keep[count + rng.permutation(count)[:left]] = True
    return trial_of(picture(rng, markers, camera, pose, keep=keep, false=rng.choice([0.0, 0.3])), markers)


# --- 2: ties never looked at ------------------------------------------------------------------


def equal_pitch(seed: int, *, normals: bool = True, jitter: float = 0.0, prior: bool = False) -> Trial:
    """Two to four rows of equal pitch, at one side half hidden in one piece."""
    rng = np.random.default_rng(seed)
    columns, rows = int(rng.integers(7, 15)), int(rng.integers(2, 5))
    xyz = models.grid(columns, rows).xyz * [1.0, rng.uniform(0.7, 2.0), 1.0]
    xyz[:, 0] += 0.5 * (xyz[:, 1].round(6) % 2 > 1) * rng.integers(2)
    xyz[:, :2] += rng.normal(0, jitter, xyz[:, :2].shape)
    markers = models.table(xyz, np.tile([0.0, 0.0, 1.0], (len(xyz), 1)))
    camera, pose = view(rng, markers, least=len(markers) - 4)
    keep = _one_piece(rng, xyz[:, 0], rng.uniform(0.35, 0.6))
    shot = picture(rng, markers, camera, pose, keep=keep, hidden=rng.choice([0.0, 0.1]), false=rng.choice([0.0, 0.3]))
    options = {"prior": near(rng, pose, xyz, 8.0, 0.05)} if prior else {}
    return trial_of(shot, markers if normals else models.without_normals(markers), options=options)


def _one_piece(rng: np.random.Generator, x: Array, hidden: float) -> Bools:
    """All but so large a part at one end (N,)."""
    x = x if rng.random() < 0.5 else -x
    return np.asarray(x > np.quantile(x, hidden))


# --- 3: grids ---------------------------------------------------------------------------------


def odd_hidden(seed: int, *, prior: bool = False) -> Trial:
    """A grid of which one marker is displaced, and that one is hidden."""
    rng = np.random.default_rng(seed)
    columns, rows = int(rng.integers(5, 10)), int(rng.integers(4, 8))
    xyz = models.grid(columns, rows).xyz
    odd = int(rng.integers(len(xyz)))
    xyz[odd, :2] += rng.uniform(0.2, 0.4) * np.array([1.0, 0.4])
    markers = models.table(xyz, np.tile([0.0, 0.0, 1.0], (len(xyz), 1)))
    camera, pose = view(rng, markers, least=len(markers) - 4)
    shot = picture(rng, markers, camera, pose, keep=np.arange(len(xyz)) != odd, hidden=rng.uniform(0, 0.3),
                   false=rng.choice([0.0, 0.3]))  # fmt: skip
    return trial_of(shot, markers, options={"prior": near(rng, pose, xyz, 15.0, 0.1)} if prior else {})


def beyond_frame(seed: int, *, jitter: float = 0.0, prior: bool = False) -> Trial:
    """A grid half hidden in one piece, the rest at the border: a shifted rival has its hidden part outside."""
    rng = np.random.default_rng(seed)
    columns, rows = int(rng.integers(8, 13)), int(rng.integers(4, 7))
    xyz = models.grid(columns, rows).xyz
    xyz[:, :2] += rng.normal(0, jitter, xyz[:, :2].shape)
    markers = models.table(xyz, np.tile([0.0, 0.0, 1.0], (len(xyz), 1)))
    keep = _one_piece(rng, xyz[:, 0], rng.uniform(0.4, 0.6))
    end = xyz[keep].mean(axis=0) * 2 - xyz.mean(axis=0)
    camera, pose = view(rng, markers, tilt_max_deg=35, least=len(markers) - 4)
    for _ in range(40):
        # Turn the camera about its eye until the visible end has come to the border of the picture.
        xy, ok = camera.project(pose.apply(xyz[keep]))
        if not ok.all() or not camera.in_image(xy).all():
            break
        ray = pose.apply(end) / np.linalg.norm(pose.apply(end))
        axis = np.cross(ray, [0.0, 0.0, 1.0])
        step = Pose.from_rotvec(-0.02 * axis / max(np.linalg.norm(axis), 1e-9), np.zeros(3))
        pose = step @ pose
    shot = picture(rng, markers, camera, pose, keep=keep, hidden=rng.choice([0.0, 0.1]), false=rng.choice([0.0, 0.3]))
    return trial_of(shot, markers, options={"prior": near(rng, pose, xyz, 8.0, 0.05)} if prior else {})


# --- 4: mirrored ------------------------------------------------------------------------------

MIRROR = ("mirror", "mirrored")


def _flipped(detections: Detections, camera: Camera) -> Detections:
    """The spots of the mirrored picture."""
    xy = detections.xy.copy()
    xy[:, 0] = 2 * camera.cx - xy[:, 0]
    return Detections.make(xy, sigma_px=np.sqrt(detections.cov[:, 0, 0]))


def _mirrored_table(markers: MarkerSet, axis: int) -> MarkerSet:
    flip = np.ones(3)
    flip[axis] = -1.0
    return models.table(markers.xyz * flip, markers.normal * flip)


def aircraft(seed: int, *, what: str = "picture", half: bool = False, normals: bool = True) -> Trial:
    """A symmetric aircraft, irregular by 1 mm in 1 m; its picture or its table mirrored, or neither.

    With ``half`` one of its halves is hidden; the other is the mirror image of the hidden one.
    """
    rng = np.random.default_rng(seed)
    markers = models.aircraft(rng, 0.001)
    camera, pose = view(rng, markers, tilt_max_deg=45, least=24)
    side = markers.xyz[:, 1] * rng.choice([-1, 1]) > 0
    shot = picture(rng, markers, camera, pose, keep=side if half else None, hidden=rng.choice([0.0, 0.2]),
                   false=rng.choice([0.0, 0.3]))  # fmt: skip
    given = markers if normals else models.without_normals(markers)
    if what == "neither":
        return trial_of(shot, given, unseen=MIRROR)
    if what == "table":
        return trial_of(shot, _mirrored_table(given, 1), poses=(), unseen=MIRROR)
    one = trial_of(shot, given, poses=(), unseen=MIRROR)
    return Trial(_flipped(shot.detections, camera), one.markers, camera, one.truth, {}, one.unseen)


def relief_reversed(seed: int, *, normals: bool = True) -> Trial:
    """A nearly flat table with relief of 1 to 3 %, its z with the wrong sign."""
    rng = np.random.default_rng(seed)
    markers = models.flat_wing(rng)
    xyz = markers.xyz + np.outer(rng.uniform(-1, 1, len(markers)), [0, 0, 1]) * rng.uniform(0.01, 0.03)
    real = models.moved(markers, xyz)
    camera, pose = view(rng, real, least=20)
    shot = picture(rng, real, camera, pose, hidden=rng.choice([0.0, 0.3]), false=rng.choice([0.0, 0.3]))
    given = models.moved(markers, xyz * [1, 1, -1])
    given = given if normals else models.without_normals(given)
    return trial_of(shot, given, real=xyz, unseen=MIRROR)


def flat_mirrored(seed: int, *, normals: bool, relief: float = 0.0) -> Trial:
    """A flat table whose y has the wrong sign; seen from behind it is as it was."""
    rng = np.random.default_rng(seed)
    markers = models.flat_wing(rng)
    xyz = markers.xyz + np.outer(rng.normal(0, relief, len(markers)), [0, 0, 1])
    real = models.moved(markers, xyz)
    camera, pose = view(rng, real, least=20)
    shot = picture(rng, real, camera, pose, hidden=rng.choice([0.0, 0.3]), false=rng.choice([0.0, 0.3]))
    given = models.table(xyz * [1, -1, 1], markers.normal)
    return trial_of(shot, given if normals else models.without_normals(given), poses=(), unseen=MIRROR)


def behind(seed: int, *, irregular: float | None = None) -> Trial:
    """A flat table without normals of a body that bends by 2 to 4 %, also under a long lens.

    With ``irregular`` the layout is symmetric but for so much (1 sigma, as part of the span), so that it looks nearly
    the same from behind.
    """
    rng = np.random.default_rng(seed)
    markers = models.flat_wing(rng)
    if irregular is not None:
        half = markers.xyz[:14] * [1, 0.5, 1] + [0, 0.05, 0]
        other = half * [1, -1, 1] + rng.normal(0, irregular, half.shape) * [1, 1, 0]
        markers = models.table(np.concatenate([half, other]), markers.normal)
    real, _ = bent(markers.xyz, rng.choice([-1, 1]) * rng.uniform(0.02, 0.04))
    camera, pose = view(rng, markers, fov_deg=((4, 10), (20, 50))[rng.integers(2)], least=22)
    shot = picture(rng, models.moved(markers, real), camera, pose, hidden=rng.choice([0.0, 0.3]),
                   false=rng.choice([0.0, 0.3]))  # fmt: skip
    poses = rigid_fits(camera, pose, markers.xyz, real, shot.seen)
    return trial_of(shot, models.without_normals(markers), real=real, poses=poses, unseen=MIRROR)
