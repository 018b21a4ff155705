"""The ratio wind-off / wind-on on the model: pictures to nodes, means over pictures, cameras merged."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from windmark.errors import DataError
from windmark.paint import CamerasApart, NodeField, NotFitted, enough, form_ratio, merge_cameras
from windmark.tasks.psp.bends import bend_of_ratio
from windmark.tasks.psp.lamps import Lamp
from windmark.tasks.psp.levels import BadPicture, Level, Reference, levels_of, together
from windmark.tasks.psp.sampling import ModelPicture, Sampling
from windmark.tasks.psp.scatter import Scatter
from windmark.tasks.psp.self_lit import Change, Reflecting, own_light
from windmark.tasks.psp.unlit import without_unlit

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DIRECTIONS = 3
"""Of a registration's errors at most so many are kept as modes, those that change the ratio most; the others count as
noise. Fewer with more than two cameras, each of which brings a mode of its own: a field has 30 (`MOST_MODES`)."""
BELIEVED = 1e-3
"""A flicker known beforehand counts while pictures as uneven as these have at least this chance under it."""
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
    flicker : relative standard deviation of the lamps from picture to picture that counts, see `ratio_of`; NaN where
        nothing says it, and no sigma has it
    left_out : picture -> why it does not count
    apart : of each two cameras, see `CamerasApart`
    scatter : of the pictures of each camera and kind
    self_lit : what taking off the light that the model throws on itself changed; None where that was not asked for
    unlit : (V,) nodes without a value because they have next to no light wind-off
    shown : (V,) nodes that a camera shows with wind and without, and lamps light, whether they have a value or not
    """

    ratio: NodeField
    cameras: Mapping[str, CameraRatio]
    source: NDArray[np.int8]
    systematic: float
    flicker: float
    left_out: Mapping[str, str] = field(default_factory=dict)
    self_lit: Change | None = None
    apart: tuple[CamerasApart, ...] = ()
    scatter: tuple[Scatter, ...] = ()
    unlit: Mask = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    shown: Mask = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))


def ratio_of(
    on: Sequence[ModelPicture],
    off: Sequence[ModelPicture] | Iterable[Reference],
    *,
    how: Sampling | None = None,
    lamps: Sequence[Lamp] = (),
    reflecting: Reflecting | None = None,
    bad: Sequence[BadPicture] = (),
    own: bool = False,
    flicker: float | None = None,
) -> MergedRatio:
    """Ratio at the nodes of a grid from pictures of one point by any number of cameras.

    Every picture is taken to the nodes where they were in it, so nothing has to be aligned. Of one camera, pictures of
    a kind are averaged (lamps that flicker are evened out; one that contradicts the others does not count); the mean's
    errors by pose and deformation are the modes ``registration wind-on`` and ``registration wind-off``, which all
    cameras share, and the lamps' the mode ``lamps``. Cameras count by their inverse variance, and fade where they end.

    Parameters
    ----------
    on, off : pictures with wind and without, of the same cameras and grid; or the parts of the reference, which are
        taken one after the other, each by the mean of its own pictures. A node counts where all parts show it
    how : of sampling
    lamps : the light that the model moves in; none given: it is taken as the same
    reflecting : the paint throws back some of its own light, which is taken off; None: it is left
    bad : pictures with wind that cannot be used; they count where a camera has too few left (`paint.enough`)
    own : the reference is the mean of a run that the pictures with wind are one part of and ``off`` the others, of each
        node over the parts that show it. What wind-on is wrong by is in both and cancels by that part. One that cannot
        be used is left out as a picture is
    flicker : what is known of it beforehand: a relative standard deviation from picture to picture. It counts unless
        the pictures show more than chance lets it (1 in 1000). None: the pictures alone say it, where any mean is of
        several

    Raises
    ------
    DataError
        Where no camera has pictures of both kinds, none shows a node in both, or too few pictures of one can be used.
    """
    how = Sampling() if how is None else how
    left_out: dict[str, str] = {}
    by_camera = levels_of(Reference(on, 1.0, bad), how, lamps, left_out)
    parts = _parts(_as_parts(off), how, lamps, left_out, own)
    needed = any if own else all
    names = [n for n in by_camera if parts and needed(n in of for _, of in parts)]
    if not names:
        raise DataError("no camera has pictures with wind and without")
    levels = {
        WIND_ON: {name: by_camera[name] for name in names},
        WIND_OFF: {name: together([(share, of[name]) for share, of in parts if name in of], own) for name in names},
    }  # fmt: skip
    whole = levels[WIND_OFF]
    levels[WIND_OFF], unlit = without_unlit(whole, how, on[0].mesh)
    # Markers on unlit surface are not called so, but no more of it is shown than of the paint round them.
    dark = _some_value(whole) & ~_some_value(levels[WIND_OFF])
    flicker, factor = _flicker(levels, flicker)
    fields = {kind: _as_fields(of, kind) for kind, of in levels.items()}
    cameras = {}
    for name in names:
        up, down = levels[WIND_ON][name], levels[WIND_OFF][name]
        ratio = form_ratio(fields[WIND_OFF][name], fields[WIND_ON][name])
        if up.cells is not None and down.cells is not None:
            taken, added = bend_of_ratio(ratio.value, down.cells, up.cells, on[0].mesh.triangles)
            ratio = replace(ratio, value=ratio.value - taken, white=ratio.white + added)
        if flicker > 0:
            part = factor * flicker * np.sqrt(up.inverse + down.inverse)
            ratio = ratio.with_mode("lamps", np.where(ratio.known, part * ratio.value, 0.0))
        if own:  # (s I + (1 - s) I_others) / I
            rest = down.shown / (down.shown + 1)
            ratio = ratio.applied(1 - rest + rest * ratio.value, rest)
        weight = np.minimum(up.weight, down.weight)
        cameras[name] = CameraRatio(_without_nan(ratio), np.where(ratio.known, weight, 0.0))
    tapers = np.stack([of.weight for of in cameras.values()])
    merged = merge_cameras([of.ratio for of in cameras.values()], names, tapers=tapers, gain="none")
    if isinstance(merged, NotFitted) or not merged.field.known.any():
        raise DataError("no node of the grid is seen both with wind and without")
    ratio, change = merged.field, None
    if reflecting is not None:
        # Unlit surface has no ratio, but its light is known: next to nothing is thrown by it.
        fields[WIND_OFF] = _as_fields(whole, WIND_OFF)
        lights = {kind: {name: _as_it_left(fields[kind][name], levels[kind][name].lamps) for name in names}
                  for kind in levels}  # fmt: skip
        for taper, name in zip(tapers, names, strict=True):
            taper[unlit] = np.minimum(levels[WIND_ON][name].weight, whole[name].weight)[unlit]
        ratio, change = own_light(ratio, lights, tapers, reflecting, (WIND_OFF, WIND_ON))
    scatter = tuple(s for of in levels.values() for level in of.values() for s in level.scatter)
    return MergedRatio(ratio, cameras, merged.source, merged.systematic, flicker, left_out, change, merged.apart,
                       scatter, unlit, _shown(levels, names) & ~dark)  # fmt: skip


def _shown(levels: Mapping[str, Mapping[str, Level]], names: Sequence[str]) -> Mask:
    """(V,) nodes that one of the cameras shows in pictures of all kinds and that the lamps light there."""
    return np.any([np.all([(of[name].weight > 0) & np.isfinite(of[name].lamps) for of in levels.values()], axis=0)
                   for name in names], axis=0)  # fmt: skip


def _some_value(of: Mapping[str, Level]) -> Mask:
    """(V,) nodes of which a camera has a value."""
    return np.any([np.isfinite(level.value) for level in of.values()], axis=0)


def _as_parts(off: Sequence[ModelPicture] | Iterable[Reference]) -> Iterable[Reference]:
    """The parts of a reference; pictures alone are one."""
    pictures = []
    for one in off:
        if isinstance(one, Reference):
            yield one
        else:
            pictures.append(one)
    if pictures:
        yield Reference(pictures)


def _parts(
    parts: Iterable[Reference], how: Sampling, lamps: Sequence[Lamp], left_out: dict[str, str], own: bool
) -> list[tuple[float, dict[str, Level]]]:
    """Shares and levels; of the mean of a run without the parts that cannot be used, as long as enough are left."""
    out, lost = [], {}
    for part in parts:
        try:
            if part.why:
                raise DataError(part.why)
            out.append((part.share, levels_of(part, how, lamps, left_out)))
        except DataError as error:
            if not own:
                raise
            lost[part.name] = str(error)
    count = len(out) + len(lost)
    if lost and not enough(len(out), count):
        name, why = next(iter(lost.items()))
        raise DataError(f"only {len(out)} of {count} other points can be used for the mean of its run; the first that "
                        f"cannot is {name}: {why}")  # fmt: skip
    left_out.update(lost)
    return out


def _as_it_left(even: NodeField, lamps: Array) -> NodeField:
    """The light of a level as it left the surface: with that of the lamps (V,) in it."""
    seen = even.known & np.isfinite(lamps)
    return NodeField.make(np.where(seen, even.value * lamps, np.nan), np.where(seen, np.sqrt(even.white) * lamps, 0.0))


def _without_nan(field_: NodeField) -> NodeField:
    """The same field; what is not known has no error, so that it can be given the weight 0."""
    on = field_.known
    return replace(field_, white=np.where(on, field_.white, 0.0), modes=np.where(on[:, None], field_.modes, 0.0))


def _flicker(levels: Mapping[str, Mapping[str, Level]], known: float | None) -> tuple[float, float]:
    """Standard deviation of the lamps and the factor on it: as known beforehand, 1; pooled over pictures, Student's.

    Cameras see the same lamps at the same time: the pictures of one of them, of each kind, are the draws.
    """
    from scipy.special import chdtrc, stdtrit

    several = [g for of in levels.values() for level in of.values() for g in level.light if len(g) > 1]
    if not several:
        return (float("nan") if known is None else known), 1.0
    square = sum(float(((g / g.mean() - 1) ** 2).sum()) for g in several)
    draws = sum(max(level.draws for level in of.values()) for of in levels.values())
    shown = float(np.sqrt(square / sum(len(g) - 1 for g in several)))
    if known is not None and (shown <= known or (known and chdtrc(draws, draws * (shown / known) ** 2) > BELIEVED)):
        return known, 1.0
    return shown, float(stdtrit(draws, 0.975)) / 1.959964


def _as_fields(levels: Mapping[str, Level], kind: str) -> dict[str, NodeField]:
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
