"""Which law? The laws that a project names for its volumes, compared on frames of its sequence."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from windmark import io
from windmark.deformation import LawChoice, Volumes, compare_laws
from windmark.deformation.laws.catalog import CATALOG
from windmark.errors import UsageError
from windmark.pipeline.deform.entries import AlternativeEntry, VolumeEntry
from windmark.pipeline.deform.frames import instants_of
from windmark.pipeline.deform.load import Loaded, volumes_of
from windmark.pipeline.deform.names import key_of
from windmark.pipeline.deform.pictures import follow_deformation
from windmark.pipeline.deform.project import DeformProject
from windmark.pipeline.deform.wind_off import zeroed
from windmark.scene import View
from windmark.tasks.deform.states import what_is_free

DECISIVE = float(np.log(100.0))
"""Nats by which a law must be ahead of the next one: a hundred times likelier."""
WORSE = 1.05
"""Held-out markers speak against a law that predicts them worse by this factor than another one does."""
NONE = "none"


@dataclass(frozen=True)
class Score:
    """One law over all frames.

    Parameters
    ----------
    name : of the candidate
    parameters : free unknowns per frame, motion and cameras included
    rms_px : of the residuals, root mean square length
    chi2, dof : sum of squared whitened residuals and the number of observations less that of unknowns
    evidence : natural logarithm of the evidence, from the Bayesian information criterion, chi2 scaled by the misfit
        that no law explains; the best has 0
    held_out_px, held_out_chi2 : how far markers are from where the others' state puts them, and that whitened, per
        coordinate
    reason : why there is no result, "" where there is
    """

    name: str
    parameters: int
    rms_px: float
    chi2: float
    dof: int
    evidence: float
    held_out_px: float
    held_out_chi2: float
    reason: str = ""


@dataclass(frozen=True)
class LawsCompared:
    """Scores, best first; ``winner`` "" where the data cannot tell, with ``verdict`` in words.

    ``scale`` is the square of the misfit that is left to the best fitting law, 1 at least.
    """

    scores: tuple[Score, ...]
    frames: tuple[str, ...]
    lost: tuple[str, ...]
    winner: str
    verdict: str
    scale: float


def candidates(loaded: Loaded, texts: Sequence[str] = ()) -> dict[str, Volumes]:
    """The project's own laws, its alternatives, those of ``texts``, and no law: name -> volumes.

    Parameters
    ----------
    loaded : the project
    texts : ``[VOLUME/]LAW[:option=value;...]``, values as in a project file

    Raises
    ------
    ValueError, FileError
        For a text that is none, an unknown volume, a law that cannot be made.
    """
    project = loaded.project
    own = [v for v in project.volume if v.law]
    labels = "+".join(_label(v.law or "", v.options, v.options) for v in own)
    out = {f"{labels} (project)" if own else NONE: loaded.test.volumes}
    others = [(v, a) for v in project.volume for a in v.alternative]
    others += [_parsed(text, project, own) for text in texts]
    for volume, entry in others:
        name = ("" if len(own) < 2 else f"{volume.name}/") + _label(entry.law, entry.options, {})
        if name in out:
            name = f"{name} ({len(out)})"
        out[name] = _with(loaded, volume, entry)
    if project.motion.free and NONE not in out:
        bare = project.model_copy(update={"volume": tuple(_without(v) for v in project.volume)})
        out[NONE] = volumes_of(bare, loaded.test.markers)[0]
    return out


def _label(law: str, options: dict[str, object], common: dict[str, object]) -> str:
    own = {k: v for k, v in options.items() if k not in common}
    return law + (" " + ", ".join(f"{k}={v}" for k, v in own.items()) if own else "")


def _parsed(text: str, project: DeformProject, own: list[VolumeEntry]) -> tuple[VolumeEntry, AlternativeEntry]:
    """Volume and law of a text."""
    head, _, tail = text.partition(":") if ".py:" not in text else _own_file(text)
    first, slash, rest = head.partition("/")
    known = {v.name: v for v in project.volume}
    if slash and first in known:
        volume, law = known[first], rest
    elif len(own) == 1:
        volume, law = own[0], head
    else:
        raise UsageError(
            f"--law {text!r}: {len(own)} volumes have a law; say which, VOLUME/LAW with {', '.join(known)}"
        )
    options = {}
    for part in filter(None, (p.strip() for p in tail.split(";"))):
        key, equals, value = part.partition("=")
        try:
            options[key.strip()] = tomllib.loads(f"value = {value.strip()}")["value"]
        except tomllib.TOMLDecodeError:
            raise UsageError(f"--law {text!r}: expected option=value;... with values as in a project file, such as "
                             f"twist=[1, 2], got {part!r}") from None  # fmt: skip
        if not equals:
            raise UsageError(f"--law {text!r}: expected option=value;..., got {part!r}")
    return volume, AlternativeEntry(law=law, options=options)


def _own_file(text: str) -> tuple[str, str, str]:
    """A user's law: the name behind ``.py:`` belongs to it."""
    at = text.index(".py:") + 4
    name, colon, tail = text[at:].partition(":")
    return text[:at] + name, colon, tail


def _with(loaded: Loaded, volume: VolumeEntry, entry: AlternativeEntry) -> Volumes:
    """The volumes with another law of one."""
    project = loaded.project
    if entry.law == NONE:
        new = _without(volume)
    else:
        options = {**_inherited(volume, entry.law), **entry.options}
        new = volume.model_copy(update={"law": entry.law, "options": options, "parameters": entry.parameters})
    volumes = tuple(new if v.name == volume.name else v for v in project.volume)
    return volumes_of(project.model_copy(update={"volume": volumes}), loaded.test.markers)[0]


def _without(volume: VolumeEntry) -> VolumeEntry:
    return volume.model_copy(update={"law": None, "options": {}, "parameters": {}})


def _inherited(volume: VolumeEntry, law: str) -> dict[str, object]:
    """Options of the volume's own law that mean the same in another one."""
    if law == volume.law:
        return dict(volume.options)
    if law not in CATALOG:
        return {}
    there = {o.name: o.expected for o in CATALOG[law].options}
    here = {o.name: o.expected for o in CATALOG[volume.law].options} if volume.law and volume.law in CATALOG else there
    return {k: v for k, v in volume.options.items() if k in there and there[k] == here.get(k)}


def compare_project(
    loaded: Loaded, volumes: dict[str, Volumes], *, frames: int = 8, seed: int = 0,
    say: Callable[[str], None] = lambda text: None,
) -> LawsCompared:  # fmt: skip
    """Compare laws on some frames of a project, evenly spaced, each found for itself.

    Parameters
    ----------
    loaded : the project; its own laws label the spots
    volumes : see `candidates`
    frames : how many at most; those of the wind-off zero are left out
    seed : of the division of the markers that are left out in turn
    say : called with what is done

    Raises
    ------
    FileError
        When no frame gives a deformation with the project's own laws.
    """
    project, timeline = loaded.project, instants_of(loaded.project)
    zero = {key_of(k) for k in project.sequence.zero}
    say("find the wind-off zero")
    loaded = zeroed(loaded, timeline)[0]
    every = [f for f in timeline.frames if f.key not in zero]
    if not every:
        raise io.FileError(project.path, "there is no frame besides the wind-off ones", "sequence")
    picked = [every[k] for k in np.unique(np.linspace(0, len(every) - 1, min(frames, len(every))).round().astype(int))]
    choices: list[list[LawChoice]] = []
    used, lost, count = [], [], []
    for images in picked:
        say(f"frame {images.key}")
        frame = next(follow_deformation([images], loaded.test))
        if frame.state is None or frame.observations is None:
            lost.append(f"{images.key}: {frame.reason}")
            continue
        test = loaded.test
        views = [View(n, n, "", test.station(n).cam_from_tunnel) for n in frame.views]
        cameras = {n: test.station(n).camera for n in frame.views}
        choices.append(compare_laws(
            volumes, frame.observations, test.markers, cameras, views, seed=seed, marker_cov=test.marker_cov,
            **what_is_free(test, frame.views),
        ))  # fmt: skip
        used.append(images.key)
        count.append(len(frame.observations))
    if not used:
        raise io.FileError(project.path, f"no frame gave a deformation to compare laws on; {lost[0]}", "sequence")
    return judged(list(volumes), choices, tuple(used), tuple(lost))


def judged(
    names: Sequence[str], choices: Sequence[Sequence[LawChoice]], frames: tuple[str, ...], lost: tuple[str, ...]
) -> LawsCompared:
    """The verdict over frames from the choices of each."""
    scores = [_score(name, [next(c for c in frame if c.name == name) for frame in choices]) for name in names]
    good = [s for s, _ in scores if not s.reason]
    scale = max(1.0, min((s.chi2 / s.dof for s in good if s.dof > 0), default=1.0))
    raw = {s.name: -0.5 * (s.chi2 / scale + penalty) for s, penalty in scores if not s.reason}
    best = max(raw.values(), default=0.0)
    final = [
        Score(s.name, s.parameters, s.rms_px, s.chi2, s.dof, raw.get(s.name, np.nan) - best, s.held_out_px,
              s.held_out_chi2, s.reason)
        for s, _ in scores
    ]  # fmt: skip
    final.sort(key=lambda s: (bool(s.reason), -s.evidence if np.isfinite(s.evidence) else 0.0))
    winner, verdict = _verdict([s for s in final if not s.reason], scale)
    return LawsCompared(tuple(final), frames, lost, winner, verdict, scale)


def _score(name: str, parts: Sequence[LawChoice]) -> tuple[Score, float]:
    """A law over frames, its evidence not yet known, and the penalty for its unknowns."""
    bad = next((c.reason for c in parts if c.reason or c.state is None), "")
    if bad:
        nan = float("nan")
        return Score(name, 0, nan, nan, 0, nan, nan, nan, bad), 0.0
    n = np.array([len(c.state.used) for c in parts if c.state is not None])
    rms = np.array([c.state.rms_px for c in parts if c.state is not None])
    k = np.array([c.parameters for c in parts])
    cross = np.array([[c.cross_px, c.cross_chi2] for c in parts])
    held = np.sqrt((n * cross[:, 0] ** 2).sum() / n.sum()), (n * cross[:, 1]).sum() / n.sum()
    score = Score(
        name, round(float(k.mean())), float(np.sqrt((n * rms**2).sum() / n.sum())),
        float(sum(c.chi2 for c in parts)),
        int((2 * n - k).sum()), float("nan"), float(held[0]), float(held[1]),
    )  # fmt: skip
    return score, float((k * np.log(2 * n)).sum())


def _verdict(good: Sequence[Score], scale: float) -> tuple[str, str]:
    """The winner, "" for none, and why."""
    if not good:
        return "", "no law could be identified"
    misfit = (
        ""
        if scale < 4
        else (
            f"; yet residuals are {np.sqrt(scale):.1f} times what the spots' noise is: no law given explains them all"
        )
    )
    first = good[0]
    if len(good) == 1:
        return "", f"only {first.name} could be identified: there is nothing to compare it with"
    near = [s for s in good if first.evidence - s.evidence < DECISIVE]
    if len(near) > 1:
        simplest = min(near, key=lambda s: s.parameters)
        names = ", ".join(s.name for s in near)
        return "", f"the data cannot tell {names} from each other; the simplest of them is {simplest.name}{misfit}"
    known = [s for s in good if np.isfinite(s.held_out_chi2)]
    better = min(known, key=lambda s: s.held_out_chi2, default=first)
    if known and not np.isfinite(first.held_out_chi2):
        return "", (
            f"the evidence is for {first.name}, which could not be tried on markers that it has not seen, as "
            f"{better.name} could: neither is settled{misfit}"
        )
    if better is not first and not first.held_out_chi2 <= WORSE * better.held_out_chi2:
        return "", (
            f"the evidence is for {first.name}, but {better.name} predicts markers that it has not seen better "
            f"({better.held_out_px:.3f} px, {first.held_out_px:.3f} px): neither is settled{misfit}"
        )
    ahead = first.evidence - good[1].evidence
    return first.name, f"{first.name}: e^{ahead:.0f} times likelier than the next one, {good[1].name}{misfit}"
