"""The mean light of one camera's pictures of a kind at the nodes of a grid, and of several sets of them together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.errors import DataError
from windmark.paint import NotFitted, average_frames, node_shares
from windmark.tasks.psp.bends import Cells, joined_cells, mean_cells
from windmark.tasks.psp.lamps import Lamp, lit
from windmark.tasks.psp.sampling import ModelPicture, Samples, Sampling, sample_picture
from windmark.tasks.psp.scatter import Scatter, scatter_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BadPicture:
    """A picture that cannot be used: its name and camera, and why."""

    name: str
    camera: str
    why: str


@dataclass(frozen=True, eq=False)
class Reference:
    """Pictures of one state of the model that are a part of the reference light.

    Parameters
    ----------
    pictures : of it
    share : of all parts; shares add to 1
    bad : those of it that cannot be used
    name : in words
    why : none of it can be used, "" where it can
    """

    pictures: Sequence[ModelPicture]
    share: float = 1.0
    bad: Sequence[BadPicture] = ()
    name: str = "the reference"
    why: str = ""


@dataclass(frozen=True, eq=False)
class Level:
    """The mean of one camera's pictures of a kind at V nodes, light evened out by the lamps'.

    Parameters
    ----------
    lamps : (V,) their light where the pictures were taken
    light : of each set of pictures, how bright each of them is
    inverse : one over the number of pictures that the mean stands for
    shown : (V,) parts of the reference that show a node
    cells : of the nodes; None where values are interpolated
    scatter : of each set of pictures, how far they are apart
    """

    value: Array
    variance: Array
    columns: Array
    weight: Array
    lamps: Array
    light: tuple[Array, ...]
    inverse: float
    shown: Array
    cells: Cells | None
    scatter: tuple[Scatter, ...] = ()

    @property
    def draws(self) -> int:
        """Pictures beside the first one of each set."""
        return sum(len(g) - 1 for g in self.light)


def levels_of(part: Reference, how: Sampling, lamps: Sequence[Lamp], left_out: dict[str, str]) -> dict[str, Level]:
    """Of each camera that has pictures."""
    left_out.update({p.name: p.why for p in part.bad})
    out, widths = {}, sorted({p.moves.shape[2] for p in part.pictures})
    for name in dict.fromkeys(p.camera for p in part.pictures):
        lost = sum(p.camera == name for p in part.bad)
        out[name] = _level([p for p in part.pictures if p.camera == name], how, lamps, left_out, lost, widths)
    return out


def _level(
    pictures: Sequence[ModelPicture], how: Sampling, lamps: Sequence[Lamp], left_out: dict[str, str], lost: int,
    widths: Sequence[int],
) -> Level:  # fmt: skip
    samples = [_in_even_light(sample_picture(p, how, straight=True), p, lamps) for p in pictures]
    values, noise = np.stack([s.value for s in samples]), np.stack([s.variance - s.lasting for s in samples])
    mean = average_frames(values, noise, lost=lost)
    if isinstance(mean, NotFitted):
        raise DataError(f"the pictures of camera {pictures[0].camera} contradict each other: {mean.reason}")
    left_out.update({p.name: why for p, why, used in zip(pictures, mean.reasons, mean.used, strict=True) if not used})
    used = np.flatnonzero(mean.used)
    columns = _mean_columns([samples[k].columns for k in used], widths)
    weight = np.min([samples[k].weight for k in used], axis=0)
    planes = [p for p in (samples[k].planes for k in used) if p is not None]
    cells = mean_cells(planes, samples[used[0]].xy, mean.excess) if planes else None
    # Pictures of a kind show a node on about the same pixels, whose dark and flat levels err in all of them alike.
    shown = np.isfinite([samples[k].lasting for k in used])
    lasting = np.where(shown, [samples[k].lasting for k in used], 0.0).sum(axis=0) / np.maximum(shown.sum(axis=0), 1)
    there = lit(pictures[used[0]].mesh, lamps)
    light = mean.light[used, None]
    apart = scatter_of(values[used] / light, noise[used] / light**2, [pictures[k].name for k in used.tolist()])
    return Level(mean.value, mean.variance + lasting, columns, weight, there, (mean.light[used],),
                  1 / len(used), np.isfinite(mean.value).astype(float), cells,
                 () if apart is None else (apart,))  # fmt: skip


def _mean_columns(columns: Sequence[Array], widths: Sequence[int]) -> Array:
    """(V, sum of ``widths``) errors of a mean of pictures by those of each (V, F), F one of ``widths``.

    Each picture has a state of its own: errors of the mean are those of one, smaller by the root of their number.
    States that leave another number of directions open (a camera is missing, a part of the model is not seen) have
    columns of their own, the same for all cameras.
    """
    out = []
    for width in widths:
        own = [c for c in columns if c.shape[1] == width]
        part = len(own) / len(columns)
        out.append(part * np.mean(own, axis=0) / np.sqrt(len(own)) if own else np.zeros((len(columns[0]), width)))
    return np.concatenate(out, axis=1)


def together(parts: Sequence[tuple[float, Level]], some: bool) -> Level:
    """The sum of levels by their shares, where all show a node; with ``some`` their mean over those that do.

    Each part's registration has errors of its own.
    """
    if len(parts) == 1 and parts[0][0] == 1:
        return parts[0][1]
    levels = [level for _, level in parts]
    known = np.array([np.isfinite(of.value) for of in levels])
    share = node_shares(list(known if some else known & known.all(axis=0)), [s for s, _ in parts])
    on = np.abs(share).sum(axis=0) > 0

    def total(of: list[Array], by: Array = share) -> Array:
        return np.where(on, sum(np.where(s != 0, s * a, 0.0) for s, a in zip(by, of, strict=True)), np.nan)

    columns = np.concatenate([s[:, None] * np.nan_to_num(of.columns) for s, of in zip(share, levels, strict=True)], 1)
    weight = np.min([np.where(s != 0, of.weight, np.inf) for s, of in zip(share, levels, strict=True)], axis=0)
    # Whether it has a value there or not: what pictures show without one is a hole, and no side that they do not show.
    least = np.max([of.weight for of in levels], axis=0) if some else np.min([of.weight for of in levels], axis=0)
    lamps = np.where(on, total([of.lamps for of in levels]), np.mean([of.lamps for of in levels], axis=0))
    even = np.array([s for s, _ in parts]) / sum(s for s, _ in parts)
    cells = [of.cells for of in levels if of.cells is not None]
    return Level(
        total([of.value for of in levels]), total([of.variance for of in levels], share**2), columns,
        np.where(on, weight, least), lamps, tuple(g for of in levels for g in of.light),
        float(sum(s**2 * of.inverse for s, of in zip(even, levels, strict=True))), known.sum(axis=0).astype(float),
        joined_cells(cells, share) if len(cells) == len(levels) else None,
        tuple(s for of in levels for s in of.scatter),
    )  # fmt: skip


def _in_even_light(s: Samples, picture: ModelPicture, lamps: Sequence[Lamp]) -> Samples:
    light = lit(picture.mesh, lamps)
    columns = np.nan_to_num(s.columns / light[:, None])
    variance, lasting = s.variance / light**2, s.lasting / light**2
    return replace(s, value=s.value / light, variance=variance, columns=columns, lasting=lasting)
