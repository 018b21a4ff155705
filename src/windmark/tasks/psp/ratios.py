"""The ratio wind-off / wind-on on the model: pictures to nodes, means over pictures, cameras merged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from windmark.errors import DataError
from windmark.paint import NodeField, NotFitted, average_frames, form_ratio, merge_cameras
from windmark.tasks.psp.lamps import Lamp, lit
from windmark.tasks.psp.sampling import ModelPicture, Samples, Sampling, sample_picture
from windmark.tasks.psp.self_lit import Change, Reflecting, own_light

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DIRECTIONS = 3
"""Of a registration's errors at most so many are kept as modes, those that change the ratio most; the others count as
noise. Fewer with more than two cameras, each of which brings a mode of its own: a field has 30 (`MOST_MODES`)."""
WIND_ON, WIND_OFF = "wind-on", "wind-off"


@dataclass(frozen=True, eq=False)
class CameraRatio:
    """What one camera says.

    Parameters
    ----------
    ratio : (V) wind-off / wind-on
    weight : (V,) see `Samples`
    """

    ratio: NodeField
    weight: Array


@dataclass(frozen=True, eq=False)
class MergedRatio:
    """What all cameras say.

    Parameters
    ----------
    ratio : (V) wind-off / wind-on
    cameras : each camera's own
    source : (V,) int8, which camera counts most; -1 for none
    systematic : part by which cameras differ beyond noise; NaN where none sees what another does
    flicker : relative standard deviation of the lamps from picture to picture, as the pictures show it
    left_out : picture -> why it does not count
    self_lit : what taking off the light that the model throws on itself changed; None where that was not asked for
    """

    ratio: NodeField
    cameras: Mapping[str, CameraRatio]
    source: NDArray[np.int8]
    systematic: float
    flicker: float
    left_out: Mapping[str, str] = field(default_factory=dict)
    self_lit: Change | None = None


def ratio_of(
    on: Sequence[ModelPicture],
    off: Sequence[ModelPicture],
    *,
    how: Sampling | None = None,
    lamps: Sequence[Lamp] = (),
    reflecting: Reflecting | None = None,
) -> MergedRatio:
    """Ratio at the nodes of a grid from pictures of one point by any number of cameras.

    Every picture is taken to the nodes where they were in it, so nothing has to be aligned. Of one camera, pictures of
    a kind are averaged (lamps that flicker are evened out; one that contradicts the others does not count); the mean's
    errors by pose and deformation are the modes ``registration wind-on`` and ``registration wind-off``, which all
    cameras share, and the lamps' the mode ``lamps``. Cameras count by their inverse variance, and fade where they end.

    Parameters
    ----------
    on, off : pictures with wind and without, of the same cameras and grid
    how : of sampling
    lamps : the light that the model moves in; none given: it is taken as the same
    reflecting : the paint throws back some of its own light, which is taken off; None: it is left

    Raises
    ------
    DataError
        Where no camera has pictures of both kinds, or none shows a node in both.
    """
    how = Sampling() if how is None else how
    names = [n for n in dict.fromkeys(p.camera for p in on) if any(p.camera == n for p in off)]
    if not names:
        raise DataError("no camera has pictures with wind and without")
    levels: dict[str, dict[str, _Level]] = {}
    left_out: dict[str, str] = {}
    for kind, pictures in ((WIND_ON, on), (WIND_OFF, off)):
        levels[kind] = {name: _level([p for p in pictures if p.camera == name], how, lamps, left_out) for name in names}
    flicker, factor = _flicker(levels)
    fields = {kind: _as_fields(of, kind) for kind, of in levels.items()}
    cameras = {}
    for name in names:
        ratio = form_ratio(fields[WIND_OFF][name], fields[WIND_ON][name])
        # What was taken off for the bend of the light is as unsure as it is large, but for what both kinds share.
        bend = ratio.value * (levels[WIND_ON][name].bent - levels[WIND_OFF][name].bent)
        ratio = replace(ratio, white=ratio.white + np.nan_to_num(bend) ** 2)
        n_on, n_off = levels[WIND_ON][name].count, levels[WIND_OFF][name].count
        if flicker > 0:
            part = factor * flicker * np.sqrt(1 / n_on + 1 / n_off)
            ratio = ratio.with_mode("lamps", np.where(ratio.known, part * ratio.value, 0.0))
        weight = np.minimum(levels[WIND_ON][name].weight, levels[WIND_OFF][name].weight)
        cameras[name] = CameraRatio(_without_nan(ratio), np.where(ratio.known, weight, 0.0))
    tapers = np.stack([of.weight for of in cameras.values()])
    merged = merge_cameras([of.ratio for of in cameras.values()], names, tapers=tapers, gain="none")
    if isinstance(merged, NotFitted) or not merged.field.known.any():
        raise DataError("no node of the grid is seen both with wind and without")
    ratio, change = merged.field, None
    if reflecting is not None:
        lights = {kind: {name: _as_it_left(fields[kind][name], next(p for p in of if p.camera == name), lamps)
                         for name in names} for kind, of in ((WIND_ON, on), (WIND_OFF, off))}  # fmt: skip
        ratio, change = own_light(ratio, lights, tapers, reflecting, (WIND_OFF, WIND_ON))
    return MergedRatio(ratio, cameras, merged.source, merged.systematic, flicker, left_out, change)


def _as_it_left(even: NodeField, picture: ModelPicture, lamps: Sequence[Lamp]) -> NodeField:
    """The light of a level as it left the surface: with that of the lamps in it."""
    there = lit(picture.mesh, lamps)
    seen = even.known & np.isfinite(there)
    return NodeField.make(np.where(seen, even.value * there, np.nan), np.where(seen, np.sqrt(even.white) * there, 0.0))


def _without_nan(field_: NodeField) -> NodeField:
    """The same field; what is not known has no error, so that it can be given the weight 0."""
    on = field_.known
    return replace(field_, white=np.where(on, field_.white, 0.0), modes=np.where(on[:, None], field_.modes, 0.0))


@dataclass(frozen=True, eq=False)
class _Level:
    """The mean of one camera's pictures of a kind at V nodes, light evened out by the lamps'; ``bent`` relative."""

    value: Array
    variance: Array
    columns: Array
    weight: Array
    bent: Array
    light: Array
    count: int


def _level(pictures: Sequence[ModelPicture], how: Sampling, lamps: Sequence[Lamp], left_out: dict[str, str]) -> _Level:
    samples = [_in_even_light(sample_picture(p, how), p, lamps) for p in pictures]
    mean = average_frames(np.stack([s.value for s in samples]), np.stack([s.variance - s.lasting for s in samples]))
    if isinstance(mean, NotFitted):
        raise DataError(f"the pictures of camera {pictures[0].camera} contradict each other: {mean.reason}")
    left_out.update({p.name: why for p, why, used in zip(pictures, mean.reasons, mean.used, strict=True) if not used})
    used = np.flatnonzero(mean.used)
    # Each picture has a state of its own: errors of the mean are those of one, smaller by the root of their number.
    columns = np.mean([samples[k].columns for k in used], axis=0) / np.sqrt(len(used))
    weight = np.min([samples[k].weight for k in used], axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        bent = np.nan_to_num(np.mean([samples[k].bent for k in used], axis=0) / mean.value)
    # Pictures of a kind show a node on about the same pixels, whose dark and flat levels err in all of them alike.
    shown = np.isfinite([samples[k].lasting for k in used])
    lasting = np.where(shown, [samples[k].lasting for k in used], 0.0).sum(axis=0) / np.maximum(shown.sum(axis=0), 1)
    return _Level(mean.value, mean.variance + lasting, columns, weight, bent, mean.light[used], len(used))


def _in_even_light(s: Samples, picture: ModelPicture, lamps: Sequence[Lamp]) -> Samples:
    light = lit(picture.mesh, lamps)
    columns = np.nan_to_num(s.columns / light[:, None])
    bent = np.nan_to_num(s.bent / light)
    variance, lasting = s.variance / light**2, s.lasting / light**2
    return replace(s, value=s.value / light, variance=variance, columns=columns, bent=bent, lasting=lasting)


def _flicker(levels: Mapping[str, Mapping[str, _Level]]) -> tuple[float, float]:
    """Pooled standard deviation of the lamps, 0 where every mean is of one picture; and Student's factor on it.

    Cameras see the same lamps at the same time: the pictures of one of them, of each kind, are the draws.
    """
    from scipy.special import stdtrit

    several = [level.light for of in levels.values() for level in of.values() if level.count > 1]
    if not several:
        return 0.0, 1.0
    square = sum(float(((g / g.mean() - 1) ** 2).sum()) for g in several)
    draws = sum(max(level.count for level in of.values()) - 1 for of in levels.values())
    return float(np.sqrt(square / sum(len(g) - 1 for g in several))), float(stdtrit(draws, 0.975)) / 1.959964


def _as_fields(levels: Mapping[str, _Level], kind: str) -> dict[str, NodeField]:
    """The means with their registration's leading directions as modes, the same for all cameras."""
    relative = [np.nan_to_num(of.columns / of.value[:, None]) for of in levels.values()]
    _, axes = np.linalg.eigh(sum(r.T @ r for r in relative))
    axes, most = axes[:, ::-1], max(1, min(DIRECTIONS, (11 - len(levels)) // 2))
    out = {}
    for name, of in levels.items():
        turned = of.columns @ axes
        rest = (turned[:, most:] ** 2).sum(axis=1)
        kept = turned[:, :most]
        names = tuple(f"registration {kind}:{k + 1}" for k in range(kept.shape[1]))
        white = np.where(np.isfinite(of.variance), of.variance, 0.0) + rest
        out[name] = NodeField(of.value, white, kept, names)
    return out
