"""Self-calibration of thin and contradictory data: does it say no, or name what is wrong?

    python benchmarks/calibration_contradictions.py [TRIALS] [KIND ...] [--seed S]

Plates of 690 mm with 40 markers, of which 8 stand up to 120 mm above it, 0.1 px of noise with covariances that say so.
Ten pictures unless the kind says otherwise; every trial has a scene of its own. `self_calibrate` starts from markers
off by 3 mm (but the control that is given), no poses and a focal length 10 % off.

An accepted result is WRONG where the focal length, the principal point or a marker is more than six of its stated
sigmas from the truth and nothing is named (``suspect``, ``swapped``, ``warnings``). Of a scene in which nothing is
wrong "named" is a false alarm. "right": accepted, within six sigmas. "right name": what is named contains what was
changed.
"z": of the focal length and of the markers' coordinates over all accepted results without a name, 1 for a true sigma.

What it leaves out: pictures (marks are given), rigs, lenses that the model does not have.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import _contradictions as contradictions
import _networks as nets
from windmark.calibration import Calibration, Distance, Fixed, Free, Weighted, self_calibrate
from windmark.geometry.similarity import align

Array = NDArray[np.float64]

SEED, TRIALS = 2_950_000, 30
MARKERS, RAISED = 40, 8
SIGMA = 0.05
"""mm, of the control and the bars."""
BEYOND = 6.0


@dataclass
class Case:
    """What a kind changes, and what should be named then."""

    scene: nets.Scenario
    xy: Array
    known: Array
    """(N, 3) coordinates that the control is given from."""
    datum: Any
    options: dict[str, Any] = field(default_factory=dict)
    named: tuple[str, ...] = ()


def plate(rng: np.random.Generator, views: int = 10) -> Case:
    """A scene in which nothing is wrong, its four outermost markers known."""
    xyz = rng.uniform(-345, 345, (MARKERS, 3)) * [1, 0.8, 0]
    xyz[:, 2] = rng.normal(0, 3, MARKERS)
    xyz[:RAISED, 2] = rng.uniform(20, 120, RAISED)
    scene = nets.pictures("plate", xyz, views, 0.9, rng)
    known = xyz + rng.normal(0, SIGMA, xyz.shape)
    return Case(scene, scene.noisy(rng), known, Weighted(names(scene.primaries), SIGMA))


def names(index: NDArray[np.int64]) -> list[str]:
    """Names of markers by number."""
    return [f"m{int(n):04d}" for n in index]


def free(rng: np.random.Generator, views: int) -> Case:
    """A free network of few pictures."""
    case = plate(rng, views)
    case.datum = Free()
    return case


def fixed(rng: np.random.Generator) -> Case:
    """Four markers held where they are."""
    case = plate(rng)
    case.known, case.datum = case.scene.truth.points.copy(), Fixed(names(case.scene.primaries))
    return case


def bars(rng: np.random.Generator, count: int, off: float = 0.0) -> Case:
    """A free network with bars, one of which is off by so many sigmas."""
    case = free(rng, 10)
    xyz, ends = case.scene.truth.points, []
    for n in range(count):
        a, b = rng.choice(MARKERS, 2, replace=False)
        while np.linalg.norm(xyz[a] - xyz[b]) < 300:
            a, b = rng.choice(MARKERS, 2, replace=False)
        length = float(np.linalg.norm(xyz[a] - xyz[b])) + rng.normal(0, SIGMA) + (off * SIGMA if n == 0 else 0.0)
        ends.append(Distance(*names(np.array([a, b])), length, SIGMA))
    case.options["distances"] = tuple(ends)
    if off:
        case.named = (ends[0].first, ends[0].second)
    return case


def control(rng: np.random.Generator, off: float, held: bool = False, wide: bool = False) -> Case:
    """One of four (or eight) known markers is elsewhere, by so many of its sigmas."""
    case = fixed(rng) if held else plate(rng)
    who = int(rng.choice(case.scene.primaries))
    if wide:
        more = np.setdiff1d(np.arange(MARKERS), case.scene.primaries)[:4]
        case.datum = Weighted(names(np.concatenate([case.scene.primaries, more])), SIGMA)
    step = rng.normal(size=3)
    case.known[who] += off * SIGMA * step / np.linalg.norm(step)
    case.named = tuple(names(np.array([who])))
    return case


def moved(rng: np.random.Generator, free_net: bool, late: bool) -> Case:
    """A marker stands 2 mm elsewhere in half of the pictures that show it, never in most: there it is where it is."""
    case = free(rng, 10) if free_net else plate(rng)
    who = int(rng.choice(np.setdiff1d(np.arange(MARKERS), case.scene.primaries)))
    step = rng.normal(size=3)
    xyz = case.scene.truth.points.copy()
    xyz[who] += 2 * step / np.linalg.norm(step)
    mine = case.scene.point == who
    shown = np.sort(case.scene.view[mine])
    half = len(shown) // 2
    views = shown[len(shown) - half :] if late else rng.choice(shown, half, replace=False)
    return _seen_otherwise(case, case.scene.truth, xyz, views, mine, tuple(names(np.array([who]))))


def refocused(rng: np.random.Generator, count: int, by: float = 0.003) -> Case:
    """The focal length is another one in some of the pictures."""
    case = plate(rng)
    views = rng.choice(10, count, replace=False)
    camera = nets.replace(nets.CAMERA, focal_px=nets.CAMERA.focal_px * (1 + by))
    truth = nets.replace(case.scene.truth, cameras=(camera,))
    every = np.ones(len(case.xy), bool)
    return _seen_otherwise(case, truth, truth.points, views, every, (*(f"v{v:03d}" for v in views), "focal length"))


def shifted(rng: np.random.Generator, count: int, by: float) -> Case:
    """The principal point is ``by`` px off, in a direction of its own in each of some pictures (cut; a loose lens)."""
    case = plate(rng)
    views = rng.choice(10, count, replace=False)
    for v in views:
        turn = rng.uniform(0, 2 * np.pi)
        case.xy[case.scene.view == v] += by * np.array([np.cos(turn), np.sin(turn)])
    case.named = (*(f"v{v:03d}" for v in views), "principal point")
    return case


def _seen_otherwise(case: Case, truth: Any, xyz: Array, views: Array, which: Array, named: tuple[str, ...]) -> Case:
    scene = case.scene
    mine = np.isin(scene.view, views) & which
    frames, v, p = truth.frames, scene.view[mine], scene.point[mine]
    at = np.einsum("oij,oj->oi", frames.rotation[v], xyz[p]) + frames.translation[v]
    case.xy[mine] += truth.cameras[0].project(at)[0] - scene.xy[mine]
    case.named = named
    return case


def exchanged(rng: np.random.Generator, pictures: int) -> Case:
    """Two markers bear each other's name in some of the pictures."""
    case = plate(rng)
    a, b = rng.choice(np.setdiff1d(np.arange(MARKERS), case.scene.primaries), 2, replace=False)
    for v in rng.choice(10, pictures, replace=False):
        mine = [np.flatnonzero((case.scene.view == v) & (case.scene.point == k)) for k in (a, b)]
        if len(mine[0]) and len(mine[1]):
            case.xy[[mine[0][0], mine[1][0]]] = case.xy[[mine[1][0], mine[0][0]]]
    case.named = tuple(names(np.array([a, b])))
    return case


def prior(rng: np.random.Generator, off: float) -> Case:
    """The principal point was believed to be elsewhere, by so many sigmas of 2 px."""
    case = plate(rng)
    case.options["prior_sigma"] = {"cx": 2.0}
    case.options["_cx"] = nets.CAMERA.cx + rng.normal(0, 2.0) + 2.0 * off
    case.named = ("cx",) if off else ()
    return case


KINDS: dict[str, Callable[[np.random.Generator], Case]] = {
    "clean: weighted": plate,
    "clean: held": fixed,
    "clean: three bars": lambda rng: bars(rng, 3),
    "clean: prior": lambda rng: prior(rng, 0.0),
    **{f"clean: {n} pictures": (lambda rng, n=n: free(rng, n)) for n in (2, 3, 4, 5, 6)},
    **{f"control off {k} sigma": (lambda rng, k=k: control(rng, k)) for k in (15, 25, 100, 1000)},
    "control off 25 sigma, of 8": lambda rng: control(rng, 25, wide=True),
    "held off 1 mm": lambda rng: control(rng, 20, held=True),
    "held off 10 mm": lambda rng: control(rng, 200, held=True),
    "two bars, 25 sigma": lambda rng: bars(rng, 2, 25),
    "two bars, 50 sigma": lambda rng: bars(rng, 2, 50),
    "four bars, 25 sigma": lambda rng: bars(rng, 4, 25),
    "marker moved, free": lambda rng: moved(rng, True, False),
    "marker moved late": lambda rng: moved(rng, False, True),
    "one picture refocused": lambda rng: refocused(rng, 1),
    "half refocused": lambda rng: refocused(rng, 5),
    **{f"{n} shifted by {k} px": (lambda rng, n=n, k=k: shifted(rng, n, k)) for n, k in ((1, 6), (1, 40), (10, 6))},
    "labels exchanged in 1": lambda rng: exchanged(rng, 1),
    "labels exchanged in 5": lambda rng: exchanged(rng, 5),
    "prior off 25 sigma": lambda rng: prior(rng, 25.0),
}


def outcome(case: Case, rng: np.random.Generator) -> contradictions.Outcome:
    """What came of it, its name if something is named, and the z of focal length and markers."""
    scene = case.scene
    given = np.zeros(MARKERS, bool)
    if not isinstance(case.datum, Free):
        given[[int(n[1:]) for n in case.datum.markers]] = True
    rough = np.where(given[:, None], case.known, scene.truth.points + rng.normal(0, 3.0, (MARKERS, 3)))
    options = dict(case.options)
    cx = options.pop("_cx", None)
    nouns = scene.nouns(case.xy, rough, 1.1)
    if cx is not None:
        nouns[2]["cam"] = nets.replace(nouns[2]["cam"], cx=float(cx))
    result = self_calibrate(*nouns, datum=case.datum, **options)
    if not isinstance(result, Calibration):
        words = f"{result.reason} {' '.join(result.weak)}"
        return "refused", "right name" if any(n in words for n in case.named) else f"({result.cause})", np.zeros(0)
    z, said = deviations(result, scene, options), words_of(result)
    wrong = max(z) > BEYOND
    if said:
        name = "right name" if any(n in said for n in case.named) else "other name"
        return "named", name, np.zeros(0) if wrong else z
    return ("WRONG" if wrong else "right"), "", z


def words_of(result: Calibration) -> str:
    """All that it names."""
    swapped = [name for pair in result.swapped for name in pair]
    # That nothing checks the focus of few pictures names nothing.
    found = [d for d in getattr(result, "doubts", ()) if d.cause != "focus"]
    return " ".join([*result.suspect, *swapped, *map(str, found)])


def deviations(result: Calibration, scene: nets.Scenario, options: dict[str, Any]) -> Array:
    """Deviations from the truth in stated sigmas: focal length, principal point, then the markers' coordinates."""
    index = [int(n[1:]) for n in result.markers.name]
    xyz, truth, cov = result.markers.xyz, scene.truth.points[index], result.marker_cov
    if isinstance(result.options["datum"], Free):
        fit = align(xyz, truth, scale=not options.get("distances"))
        xyz, cov = fit.apply(xyz), cov * fit.scale**2
    sigma = np.sqrt(np.maximum(np.diagonal(cov, axis1=1, axis2=2), 0.0))
    seen = sigma > 1e-9
    camera = result.cameras["cam"]
    off = {p: abs(getattr(camera, p) - getattr(nets.CAMERA, p)) for p in ("focal_px", "cx", "cy")}
    inner = [value / result.sigma("cam", p) for p, value in off.items()]
    return np.array([*inner, *(np.abs(xyz - truth)[seen] / sigma[seen]).tolist()])


def main() -> None:
    """One row a kind."""
    figures = {
        "z f": lambda done: contradictions.rms([z[:1] for what, z in done if what != "named"]),
        "z xyz": lambda done: contradictions.rms([z[3:] for what, z in done if what != "named"]),
    }
    contradictions.table(__doc__ or "", KINDS, outcome, figures, TRIALS, SEED)


if __name__ == "__main__":
    main()
