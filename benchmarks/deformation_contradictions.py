"""Deformation from data that contradict the laws: does `identify` say no, or name what is wrong?

    python benchmarks/deformation_contradictions.py [TRIALS] [KIND ...] [--seed S]

Swept wings of 400 to 700 mm span on a body, 40 to 60 markers on the wing (16 or 24 where it is said), 10 on the body,
10 on a flap where there is one, 14 on a wall behind where cameras may be held by it; two cameras of 1.3 Mpx 60 degrees
apart (one, or three, where the kind says so), 0.03 to 0.1 px of noise with covariances that say so. Every trial has a
wing, a state, a rigid motion and cameras of its own; labels are given, the search starts at rest.

The result is judged by where it puts 40 points of the wing (and 10 of the flap), in the tunnel and by the laws alone,
and by the laws' parameters where the law is the true one. An accepted result is WRONG where one of these is more than
six of its stated sigmas off and nothing is named (``warnings``, ``suspect``). Of a scene in which nothing is wrong
"named" is a false alarm. "right name": what is named contains what was changed; "unchecked": ``unchecked`` alone says
so (it is said of right scenes, too: what no picture can tell). "out %": coordinates outside their 95 %
intervals, over all accepted results. "z": over accepted results in which nothing is named; 1 for a true sigma.

What it leaves out: pictures (marks are given), time (each instant is by itself).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import _contradictions as contradictions
from windmark.deformation import Deformation, Volume, Volumes, identify
from windmark.deformation.laws import Beam, CantileverModes, Hinge, Powers, TorsionModes
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet, Observations, View

Array = NDArray[np.float64]

SEED, TRIALS = 5_310_000, 50
BEYOND, FLOOR = 6.0, 1e-3
"""Stated sigmas; and mm: coordinates that do not move by so much more than that are left out (the clamped root)."""
CAMERA = Camera((1280, 1024), 2090.0)


@dataclass
class Case:
    """One instant: what is true, what is given, and what should be named."""

    markers: MarkerSet
    truth: Volumes
    q: Array
    motion: Pose
    views: list[View]
    noise: float
    probe: tuple[Array, NDArray[np.str_]]
    laws: Volumes
    options: dict[str, Any] = field(default_factory=dict)
    named: tuple[str, ...] = ()
    seen: Observations | None = None

    def look(self, rng: np.random.Generator, poses: dict[str, Pose] | None = None, xyz: Array | None = None) -> None:
        """Take the pictures; ``poses`` of cameras that stand elsewhere, ``xyz`` of markers that do."""
        xyz = self.markers.xyz if xyz is None else xyz
        wall = self.markers.role == "wall"
        place = self.truth.bind(xyz, np.where(wall, "", self.markers.volume)).place(self.q)
        place = np.where(wall[:, None], xyz, self.motion.apply(place))
        view, point, xy = [], [], []
        for k, v in enumerate(self.views):
            pixel, valid = CAMERA.project((poses or {}).get(v.name, v.cam_from_model).apply(place))
            own = np.flatnonzero(valid & CAMERA.in_image(pixel))
            view += [k] * len(own)
            point += own.tolist()
            xy.append(pixel[own] + self.noise * rng.standard_normal((len(own), 2)))
        cov = np.tile(self.noise**2 * np.eye(2), (len(view), 1, 1))
        self.seen = Observations(np.array(view), np.array(point), np.concatenate(xy), cov)


def wing(
    rng: np.random.Generator, cameras: int = 2, *, walls: bool = False, flap: bool = False, shapes: Any = None,
    known: Any = None, attached: bool = True, q: Array | None = None, count: int = 0,
) -> Case:  # fmt: skip
    """A scene in which nothing is wrong but what `shapes` (the true ones) and `known` (the law's) differ in."""
    span, sweep, count = rng.uniform(400, 700), np.radians(rng.uniform(0, 30)), count or int(rng.integers(40, 61))
    root = 0.12 * span
    y = rng.uniform(root, span, count)
    chord = 0.45 * span - 0.22 * y
    x = np.tan(sweep) * y + rng.uniform(0.05, 0.75, count) * chord
    on_wing = np.stack([x, y, rng.uniform(-5, 5, count)], axis=1)
    body = rng.uniform([-0.2 * span, -20, 10], [0.6 * span, 0.8 * root, 50], (10, 3))
    parts, volume = [on_wing, body], ["wing"] * count + ["body"] * 10
    ends = np.array([0.55, 0.95]) * span
    line = np.stack([np.tan(sweep) * ends + 0.8 * (0.45 * span - 0.22 * ends), ends, np.zeros(2)], axis=1)
    if flap:
        along = rng.uniform(0, 1, 10)
        on_flap = line[0] + along[:, None] * (line[1] - line[0])
        on_flap[:, 0] += rng.uniform(0.02, 0.2, 10) * 0.3 * span
        parts.append(on_flap)
        volume += ["flap"] * 10
    if walls:
        parts.append(rng.uniform([-0.3 * span, 0, -160], [0.9 * span, span, -140], (14, 3)))
        volume += ["wall"] * 14
    names = [f"m{k:03d}" for k in range(len(volume))]
    role = ["wall" if v == "wall" else "model" for v in volume]
    markers = MarkerSet.make(names, np.vstack(parts), volume=volume, role=role)
    axis = {
        "root": (0.25 * 0.45 * span + np.tan(sweep) * root, root, 0.0),
        "tip": (0.25 * 0.45 * span + np.tan(sweep) * span, span, 0.0),
        "section": (0.0, 1.0, 0.0),
        "unit": "mm",
    }
    axis = {k: tuple(map(float, v)) if isinstance(v, tuple) else v for k, v in axis.items()}

    def volumes(of: Any, fixed: bool) -> Volumes:
        out = [Volume("body"), Volume("wing", None if of is None else Beam(**axis, **of), parent="body")]
        if flap:
            hinge = Hinge(tuple(line[0].tolist()), tuple(line[1].tolist()))
            out.append(Volume("flap", hinge, parent="wing" if fixed else "body"))
        return Volumes.of(out)

    shapes = {} if shapes is None else shapes
    truth, laws = volumes(shapes, True), volumes(shapes if known is None else known.get("of"), attached)
    if q is None:
        scale = {"bend": 0.012 * span, "twis": 0.7, "angl": 8.0}
        q = np.array([scale.get(n.split(".")[1][:4], 1.0) * rng.normal() for n in truth.names])
    target = np.array([0.35 * span, 0.5 * span, 0.0])
    angles = {1: (20,), 2: (-30, 30), 3: (-35, 0, 35)}[cameras]
    views = []
    for k, degrees in enumerate(angles):
        a = np.radians(degrees + rng.uniform(-4, 4))
        eye = target + 1.9 * span * np.array([rng.uniform(-0.1, 0.1), np.sin(a), np.cos(a)])
        views.append(View(f"cam{k + 1}", "c", "", Pose.look_at(eye, target, [1, 0, 0])))
    turn, shift = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
    motion = Pose.from_rotvec(np.radians(1.0) * turn, 10.0 * shift)
    at = np.stack([np.linspace(root, span, 20)] * 2)
    edge = np.array([[0.05], [0.75]]) * (0.45 * span - 0.22 * at)
    probe = np.stack([np.tan(sweep) * at + edge, at, np.zeros_like(at)], axis=-1).reshape(-1, 3)
    where = np.full(len(probe), "wing", dtype="<U4")
    if flap:
        probe, where = np.vstack([probe, on_flap]), np.append(where, np.full(10, "flap"))
    case = Case(markers, truth, q, motion, views, rng.uniform(0.03, 0.1), (probe, where), laws)
    case.look(rng)
    return case


def gross(rng: np.random.Generator, share: float) -> Case:
    """Spots that are no markers'."""
    case = wing(rng)
    bad = rng.random(len(case.seen)) < share
    case.seen.xy[bad] += rng.uniform(-40, 40, (int(bad.sum()), 2))
    return case


def exchanged(
    rng: np.random.Generator, cameras: int, pairs: int, *, every: bool = False, near: bool = False, count: int = 0
) -> Case:
    """Markers of the wing bear each other's name, in one view or in all."""
    case = wing(rng, cameras, count=count)
    mine = np.flatnonzero(case.markers.volume == "wing")
    pick, seen, who = rng.permutation(mine), case.seen, []
    for k in range(pairs):
        a = pick[2 * k]
        b = pick[2 * k + 1]
        if near:
            away = np.linalg.norm(case.markers.xyz[mine] - case.markers.xyz[a], axis=1)
            b = mine[np.argsort(away)[1]]
        for v in range(cameras) if every else [int(rng.integers(cameras))]:
            one, two = (np.flatnonzero((seen.view == v) & (seen.point == m)) for m in (a, b))
            if len(one) and len(two):
                seen.xy[[one[0], two[0]]] = seen.xy[[two[0], one[0]]]
        who += [str(case.markers.name[a]), str(case.markers.name[b])]
    case.named = tuple(who)
    return case


def lacking(rng: np.random.Generator, what: str, cameras: int = 2) -> Case:
    """The law lacks something that the wing does."""
    sign = float(rng.choice([-1, 1]))
    both = {"bend": CantileverModes(2), "twist": TorsionModes(1)}
    if what == "second bending":
        one = {"bend": CantileverModes(1), "twist": TorsionModes(1)}
        case = wing(rng, cameras, shapes=both, known={"of": one}, q=np.array([sign * 8, rng.choice([-1, 1]), 0.5]))
    elif what == "twist":
        one = {"bend": CantileverModes(2), "twist": Powers(())}
        case = wing(rng, cameras, shapes=both, known={"of": one}, q=np.array([sign * 8, 0.5, rng.choice([-0.3, 0.3])]))
    elif what == "sway":
        case = wing(rng, cameras, shapes={"sway": Powers((2,))}, known={"of": {}},
                    q=np.array([sign * 5, 2, 0.5, 0.2, rng.choice([-0.5, 0.5])]))  # fmt: skip
    else:
        case = wing(rng, cameras, shapes=both, known={"of": None}, q=np.array([sign * 8, 0.5, 0.5]))
    case.named = ("too simple", "wing deforms and has no law")
    return case


def moved(rng: np.random.Generator, cameras: int, walls: bool, degrees: float) -> Case:
    """A camera that should stand still turned and shifted."""
    case = wing(rng, cameras, walls=walls)
    who = case.views[int(rng.integers(cameras))]
    turn, shift = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
    case.look(rng, {who.name: Pose.from_rotvec(np.radians(degrees) * turn, 10 * degrees * shift) @ who.cam_from_model})
    case.named = (who.name,)
    return case


def late(rng: np.random.Generator, cameras: int, walls: bool) -> Case:
    """One camera's picture is of another moment: its wing is bent and twisted 0.2 to 0.8 times as much."""
    case, who = wing(rng, cameras, walls=walls), int(rng.integers(cameras))
    now, q = case.seen, case.q
    case.q = rng.uniform(0.2, 0.8) * q
    case.look(rng)
    then, case.q = case.seen, q
    assert now is not None
    assert then is not None
    parts = [(now, now.view != who), (then, then.view == who)]
    case.seen = Observations(*(np.concatenate([getattr(seen, name)[own] for seen, own in parts])
                               for name in ("view", "point", "xy", "cov")))  # fmt: skip
    case.named = ("different moments",)
    return case


def displaced(rng: np.random.Generator, every: bool, by: float) -> Case:
    """The table of markers is off, or one marker stands elsewhere."""
    case = wing(rng)
    off = by * rng.standard_normal(case.markers.xyz.shape)
    who = int(rng.integers(30))
    if not every:
        off[np.arange(len(off)) != who] = 0.0
        off[who] *= 1 / np.linalg.norm(off[who]) * by
    case.look(rng, xyz=case.markers.xyz + off)
    case.named = ("sigma0",) if every else (str(case.markers.name[who]),)
    return case


def noisier(rng: np.random.Generator, by: float) -> Case:
    """The spots are less certain than their covariances say."""
    case = wing(rng)
    case.seen.cov[:] /= by**2
    case.named = ("sigma0",)
    return case


def unattached(rng: np.random.Generator, cameras: int, attached: bool) -> Case:
    """The flap is fixed to the wing, and the laws have it on the body."""
    case = wing(rng, cameras, flap=True, attached=attached)
    case.named = () if attached else ("flap",)
    return case


def apart(rng: np.random.Generator, rest: bool) -> Case:
    """The flap stands on the body beside a wing that moves (or rests), and the laws say so."""
    q = np.array([0.0, 0.0, 0.0, 0.0, 5.0]) if rest else None
    case = wing(rng, flap=True, attached=False, q=q)
    case.truth = case.laws
    case.look(rng)
    return case


def shaken(rng: np.random.Generator) -> Case:
    """Cameras that may move, held by markers on a wall."""
    case = wing(rng, walls=True)
    case.look(rng, {v.name: Pose.from_rotvec(1e-3 * rng.normal(size=3), rng.normal(size=3)) @ v.cam_from_model
                    for v in case.views})  # fmt: skip
    case.options["free_poses"] = True
    return case


KINDS: dict[str, Callable[[np.random.Generator], Case]] = {
    "clean: two cameras": wing,
    "clean: one camera": lambda rng: wing(rng, 1),
    "clean: three cameras, walls": lambda rng: wing(rng, 3, walls=True),
    "clean: shaken, walls": shaken,
    "clean: flap attached": lambda rng: unattached(rng, 2, True),
    "clean: flap on the body": lambda rng: apart(rng, False),
    "clean: flap on the body, at rest": lambda rng: apart(rng, True),
    "gross: 5 %": lambda rng: gross(rng, 0.05),
    "gross: 25 %": lambda rng: gross(rng, 0.25),
    "exchanged: one camera": lambda rng: exchanged(rng, 1, 1),
    "exchanged: one camera, neighbours": lambda rng: exchanged(rng, 1, 1, near=True),
    "exchanged: one camera, three pairs": lambda rng: exchanged(rng, 1, 3),
    "exchanged: one camera, 16 markers": lambda rng: exchanged(rng, 1, 1, count=16),
    "exchanged: one camera, 24, two pairs": lambda rng: exchanged(rng, 1, 2, count=24),
    "exchanged: one of two": lambda rng: exchanged(rng, 2, 1),
    "exchanged: both": lambda rng: exchanged(rng, 2, 1, every=True),
    "flap not attached": lambda rng: unattached(rng, 2, False),
    "flap not attached, one camera": lambda rng: unattached(rng, 1, False),
    "lacks 1 mm of second bending": lambda rng: lacking(rng, "second bending"),
    "lacks 0.3 deg of twist": lambda rng: lacking(rng, "twist"),
    "lacks 0.5 mm of sway": lambda rng: lacking(rng, "sway"),
    "lacks all of it": lambda rng: lacking(rng, "all"),
    "lacks all of it, one camera": lambda rng: lacking(rng, "all", 1),
    "moved 0.03 deg: 1 of 2, walls": lambda rng: moved(rng, 2, True, 0.03),
    "moved 0.3 deg: 1 of 2, walls": lambda rng: moved(rng, 2, True, 0.3),
    "moved 0.3 deg: 1 of 2": lambda rng: moved(rng, 2, False, 0.3),
    "moved 0.03 deg: 1 of 3": lambda rng: moved(rng, 3, False, 0.03),
    "moved 0.3 deg: 1 of 3": lambda rng: moved(rng, 3, False, 0.3),
    "late: 1 of 2": lambda rng: late(rng, 2, False),
    "late: 1 of 2, walls": lambda rng: late(rng, 2, True),
    "late: 1 of 3": lambda rng: late(rng, 3, False),
    "marker 2 mm off": lambda rng: displaced(rng, False, 2.0),
    "table off by 0.2 mm": lambda rng: displaced(rng, True, 0.2),
    "noise 2 times the stated": lambda rng: noisier(rng, 2.0),
}


def outcome(case: Case, _: np.random.Generator) -> contradictions.Outcome:
    """What came of it, its name if something is named, and the deviations in stated sigmas."""
    answer = identify(case.seen, case.markers, case.laws, CAMERA, case.views, **case.options)
    if not isinstance(answer, Deformation):
        right = any(n in f"{answer.reason} {' '.join(answer.weak)}" for n in case.named)
        return "refused", "right name" if right else f"({answer.cause})", np.zeros(0)
    z = deviations(answer, case)
    said = " ".join((*answer.warnings, *answer.suspect))
    left = " ".join(map(str, answer.unchecked))
    if z.max() > BEYOND and not said and any(n in left for n in case.named):
        return "named", "unchecked", z
    if said:
        return "named", "right name" if any(n in said for n in case.named) else "other name", z
    return ("WRONG" if z.max() > BEYOND else "right"), "", z


def deviations(answer: Deformation, case: Case) -> Array:
    """Of the probes' coordinates, then of the parameters."""
    xyz, volume = case.probe
    bent, every = case.truth.bind(xyz, volume).place(case.q), []
    for frame, true in (("tunnel", case.motion.apply(bent)), ("model", bent)):
        place, cov = answer.place(xyz, volume, frame=frame)
        sigma = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
        off = np.abs(place - true)
        counts = (sigma > FLOOR) | (off > BEYOND * FLOOR)
        every.append(off[counts] / np.maximum(sigma[counts], 1e-9))
    z = np.concatenate(every)
    if case.laws.names == case.truth.names:
        sigma = np.array([answer.sigma[n] for n in case.laws.names])
        z = np.append(z, np.abs(answer.q - case.q) / sigma)
    return z


def main() -> None:
    """One row a kind."""
    figures = {
        "out %": _beyond,
        "z": lambda done: contradictions.rms([z for what, z in done if what in ("right", "WRONG")]),
    }
    contradictions.table(__doc__ or "", KINDS, outcome, figures, TRIALS, SEED)


def _beyond(done: Sequence[tuple[str, Array]]) -> float:
    """Per cent of all deviations beyond their 95 % intervals."""
    every = np.concatenate([np.zeros(0), *(z for _, z in done)])
    return 100 * float(np.mean(every > 1.96)) if len(every) else float("nan")


if __name__ == "__main__":
    main()
