"""Whether pictures show another camera than the one that is given, and what one would do that goes unnoticed.

The camera is taken as exact. So it is freed once, within what cameras of another file are off by, in an adjustment of
everything; how far it goes then, beside what is left of its prior, tells whether it is another one (Baarda 1967;
`calibration.hypotheses`), and which part of it alone would explain that. Where nothing strikes, the markers are less
sure by just what the camera's errors do to them: from that follows how far one that the test mostly misses would carry
them (external reliability, Baarda 1968).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, chdtri, chndtrinc, fdtri

from windmark.adjust.chance import chance
from windmark.calibration import Calibration, Distance, Free
from windmark.calibration.agreement import FALSE
from windmark.calibration.datum import Datum
from windmark.calibration.view_changes import NOTICED
from windmark.geometry import PARAMETERS, Camera
from windmark.registration.settle.views import doubted_camera
from windmark.scene import MarkerSet
from windmark.tasks.reconstruct.structure import Structure, adjusted
from windmark.tasks.reconstruct.task import Task

Array = NDArray[np.float64]

FOCAL = "focal length"
THINGS = {"lens distortion": ("k1", "k2"), "principal point": ("cx", "cy"), FOCAL: ("focal_px",),
          "aspect ratio": ("aspect",)}  # fmt: skip
"""What may be wrong of a camera, and its parameters."""
FOCAL_OFF = 0.05
"""1 sigma of a focal length as part of itself: one that is farther off fails before anything is adjusted."""
EXCESS = 2.0
"""Square of the residuals over what is stated, from which more than half of it is no noise."""
LIKELY = 0.01
"""Probability of such a fall by chance, below which another camera is what explains residuals that are too large for
their sigmas; stated sigmas that are too small explain them as well, and then nothing singles the camera out."""
MOVES = 1.0
"""Root mean square of the markers' shifts in their sigmas, from which another camera matters."""


@dataclass(frozen=True)
class Freed:
    """An adjustment of everything with the cameras free within their doubt.

    Parameters
    ----------
    structure, result : see `adjusted`
    given : the cameras that it began with
    names : parameters that were freed for it
    """

    structure: Structure
    result: Calibration
    given: Mapping[str, Camera]
    names: tuple[str, ...]

    @property
    def squares(self) -> float:
        """Weighted sum of squared residuals with the cameras free."""
        return float(self.result.sigma0**2 * self.result.redundancy)


@dataclass(frozen=True)
class Equations:
    """What an adjustment says of one camera: its normal equations, everything else eliminated, and their right side.

    Parameters
    ----------
    names : (P,) the parameters
    told : (P, P) weights by marks and known markers
    prior : (P,) weights of the prior
    side : (P,) right side at the given camera
    """

    names: tuple[str, ...]
    told: Array
    prior: Array
    side: Array

    @classmethod
    def of(cls, freed: Freed, camera: str) -> Equations:
        """From the covariance of the free camera, and how far it went."""
        seen, given, names = freed.result.cameras[camera], freed.given[camera], freed.names
        columns = [PARAMETERS.index(n) for n in names]
        known = freed.result.options["prior_sigma"]  # one that was contradicted is left out
        prior = np.array([1 / known[n] ** 2 if n in known else 0.0 for n in names])
        assert seen.cov is not None
        cov = seen.cov[np.ix_(columns, columns)] / max(1.0, freed.result.sigma0**2)
        size = np.sqrt(np.diagonal(cov))
        normal = np.linalg.inv(cov / np.outer(size, size)) / np.outer(size, size)
        step = np.array([getattr(seen, n) - getattr(given, n) for n in names])
        return cls(names, normal - np.diag(prior), prior, normal @ step)

    def only(self, things: Sequence[str]) -> tuple[float, dict[str, float]]:
        """By how much the sum of squares falls if just these are free, and what they go to beside the given camera."""
        own = [k for k, n in enumerate(self.names) if any(n in THINGS[t] for t in things)]
        if not own:
            return 0.0, {}
        normal, size = (self.told + np.diag(self.prior))[np.ix_(own, own)], np.sqrt(self.prior[own] + 1e-300)
        size = np.maximum(size, np.sqrt(np.diagonal(normal)))
        step = np.linalg.solve(normal / np.outer(size, size), self.side[own] / size) / size
        return float(step @ self.side[own]), {self.names[k]: float(s) for k, s in zip(own, step, strict=True)}


@dataclass(frozen=True)
class Shown:
    """What the pictures show of one camera.

    Parameters
    ----------
    camera : its name
    things : those of `THINGS` that explain it together
    instead : others that would explain it about as well
    steps : {parameter: how far from the given one}, for each of both
    fall : by how much the sum of squares falls
    """

    camera: str
    things: tuple[str, ...]
    instead: tuple[str, ...]
    steps: Mapping[str, float]
    fall: float

    @property
    def all(self) -> tuple[str, ...]:
        """Everything that it may be."""
        return (*self.things, *self.instead)


def freed(
    task: Task, structure: Structure, datum: Datum | None = None, names: Sequence[str] | None = None,
    table: MarkerSet | None = None, distances: Sequence[Distance] = (),
) -> Freed | None:  # fmt: skip
    """Everything adjusted with the cameras free, in a frame (see `adjusted`; by default the points hold it).

    None where nothing was to be asked (the parameters are free anyway), or there is no solution.
    """
    more = tuple(n for of in THINGS.values() for n in of if n not in task.free)
    if not more:
        return None
    prior = {n: max(_doubted(camera)[n] for camera in task.cameras.values()) for n in more}
    free = (*task.free, *more)
    answer = adjusted(task, structure, datum or Free(), free, names, table, distances, prior_sigma=prior)
    return Freed(*answer, structure.cameras, more) if isinstance(answer, tuple) else None


def others(of: Freed, base: float = np.nan) -> list[Shown]:
    """Cameras that are another one by an adjustment, what explains most first.

    Either the fall of the squares is no chance beside what is left of them, or hardly any (`LIKELY`) while ``base``,
    sigma0 with the given camera, contradicts the marks' sigmas, and what is left does not.
    """
    redundancy, found = of.result.redundancy, []
    for camera in of.result.cameras:
        equations = Equations.of(of, camera)
        fall, _ = equations.only(list(THINGS))
        each = {t: equations.only([t])[0] for t in THINGS}
        whole = of.squares + fall
        counts = {t: sum(n in of.names for n in THINGS[t]) for t in THINGS}
        likely = min(chance(f, counts[t], whole, redundancy) for t, f in each.items()) * len(THINGS)
        likely = min(likely, chance(fall, len(of.names), whole, redundancy))
        excess = _contradicts(base, redundancy) and of.result.sigma0**2 < EXCESS and likely < LIKELY
        if likely < FALSE / 2 or excess:
            found.append(_shown(camera, equations, each, fall, max(1.0, of.result.sigma0**2)))
    return sorted(found, key=lambda s: -s.fall)


def moved(of: Freed, base: Calibration) -> tuple[float, float]:
    """How far another camera takes the markers (length, root mean square), and that in their sigmas by coordinate."""
    mine, its = _in_both(base.markers, of.result.markers)
    shift = of.result.markers.xyz[its] - base.markers.xyz[mine]
    sigma = base.markers.sigma[mine]
    known = sigma > 0
    times = float(np.sqrt(((shift[known] / sigma[known]) ** 2).mean())) if known.any() else 0.0
    return float(np.sqrt((shift**2).sum(axis=1).mean())) if len(shift) else 0.0, times


def unnoticed(of: Freed, base: Calibration) -> tuple[float, float]:
    """How far another camera that mostly goes unnoticed may take a marker, along an axis: length, and in its sigmas."""
    count, rest = len(of.names), of.result.redundancy - len(of.names)
    mine, its = _in_both(base.markers, of.result.markers)
    if rest < 1 or not len(mine):
        return 0.0, 0.0
    limit = count * float(fdtri(count, rest, 1 - FALSE / 2))
    size = np.sqrt(chndtrinc(limit, count, 1 - NOTICED)) * max(1.0, of.result.sigma0)
    by_camera = (of.result.markers.sigma[its] / max(1.0, of.result.sigma0)) ** 2
    by_camera -= (base.markers.sigma[mine] / max(1.0, base.sigma0)) ** 2
    reach, sigma = size * np.sqrt(np.maximum(by_camera, 0.0)), base.markers.sigma[mine]
    times = np.where(sigma > 0, reach / np.where(sigma > 0, sigma, 1.0), 0.0)
    at = np.unravel_index(int(times.argmax()), times.shape)
    return float(reach[at]), float(times[at])


def _shown(camera: str, equations: Equations, each: Mapping[str, float], fall: float, scale: float) -> Shown:
    """Which things explain it: the best one, and as many more as what it leaves asks for."""
    things, explained = [max(each, key=lambda t: each[t])], max(each.values())
    while len(things) < len(THINGS):
        left = sum(n in equations.names for t in THINGS if t not in things for n in THINGS[t])
        if not left or fall - explained < scale * chdtri(left, FALSE):
            break
        rest = {t: equations.only([*things, t])[0] for t in THINGS if t not in things}
        things.append(max(rest, key=lambda t: rest[t]))
        explained = rest[things[-1]]
    # Likelihoods within odds of what is called chance: nothing tells one from the other.
    near = scale * 2 * np.log(1 / FALSE)
    instead = [t for t, f in each.items() if t not in things and len(things) == 1 and explained - f < near]
    steps: dict[str, float] = {}
    for some in (things, *([t] for t in instead)):
        steps |= equations.only(some)[1]
    return Shown(camera, tuple(things), tuple(instead), steps, fall)


def _contradicts(sigma0: float, redundancy: int) -> bool:
    """Whether residuals are no chance of the stated sigmas, and more than half of them no noise."""
    return bool(sigma0**2 > EXCESS and chdtrc(redundancy, sigma0**2 * redundancy) < FALSE)


def _doubted(camera: Camera) -> dict[str, float]:
    """1 sigma of the parameters of a camera of another file: as `register` doubts it, of k2 as far at the corners."""
    loose = doubted_camera(camera)
    corner = np.hypot(*(np.array(camera.size_px) / 2)) / camera.focal_px
    return {
        "focal_px": FOCAL_OFF * camera.focal_px, "aspect": float(loose[1, 1]), "cx": float(loose[2, 2]),
        "cy": float(loose[3, 3]), "k1": float(loose[4, 4]), "k2": float(loose[4, 4] / corner**2),
    }  # fmt: skip


def _in_both(a: MarkerSet, b: MarkerSet) -> tuple[Any, Any]:
    """Rows of the markers that both have, in each."""
    row = {n: k for k, n in enumerate(b.name.tolist())}
    pairs = [(k, row[n]) for k, n in enumerate(a.name.tolist()) if n in row]
    return tuple(np.array([p[s] for p in pairs], dtype=np.int64) for s in (0, 1))  # type: ignore[return-value]
