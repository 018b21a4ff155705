"""What is written of an aligned image, and its figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.pipeline.align2d.run import AlignedFile, Reference
from windmark.scene.detections import middle_sigma
from windmark.scene.levels import saturated_as_missing
from windmark.scene.repeated import PART, is_repeated
from windmark.tasks.align2d import ImageAlignment

Record = dict[str, Any]


def write_one(item: AlignedFile, reference: Reference, place: Path) -> None:
    """aligned.tif, sigma.tif, transformation.json and residuals.csv of an image into a folder of its own."""
    answer = item.alignment
    if answer is None:
        return
    place.mkdir()
    io.write_image(place / "aligned.tif", answer.image)
    io.write_image(place / "sigma.tif", answer.sigma_map())
    io.write_json(place / "transformation.json", {
        "reference": reference.path.name, "image": item.path.name, **answer.transform.record(),
        "hull": answer.hull, "held_out_px": answer.held_out_px,
    })  # fmt: skip
    io.write_table(place / "residuals.csv", residual_columns(answer, reference))


def residual_columns(answer: ImageAlignment, reference: Reference) -> dict[str, NDArray[Any]]:
    """Table of the pairs: places in both pictures, residual (mapped - seen), held-out residual, what became of each."""
    index = np.concatenate([answer.pairs, answer.rejected, answer.still])
    a, b = answer.reference_spots.xy[index[:, 0]], answer.image_spots.xy[index[:, 1]]
    used = np.arange(len(index)) < len(answer.pairs)
    status = ["used"] * len(answer.pairs) + ["rejected"] * len(answer.rejected) + ["still"] * len(answer.still)
    off = answer.transform.apply(a) - b
    held = np.vstack([answer.held_out, off[~used]])  # a rejected pair took no part in the fit
    names = (
        np.array([reference.named.names[k] for k in index[:, 0]], dtype=np.str_)
        if reference.named is not None
        else np.array([f"{k + 1}" for k in index[:, 0]], dtype=np.str_)
    )
    return {
        "name": names, "x_reference": a[:, 0], "y_reference": a[:, 1], "x": b[:, 0], "y": b[:, 1],
        "dx": off[:, 0], "dy": off[:, 1], "held_out_dx": held[:, 0], "held_out_dy": held[:, 1],
        "sigma_px": answer.transform.sigma_px(a), "status": np.array(status, dtype=np.str_),
    }  # fmt: skip


def record_of(item: AlignedFile, reference: Reference) -> Record:
    """Figures of one image for the summary."""
    answer = item.alignment
    if answer is None:
        return {"image": item.path.name, "aligned": False, "problem": item.problem, "seconds": item.seconds,
                "cause": None if item.answer is None else getattr(item.answer, "cause", None)}  # fmt: skip
    shift = np.hypot(*answer.shift_px.T)
    outside = answer.extrapolated() & np.isfinite(answer.image if answer.image.ndim == 2 else answer.image[..., 0])
    before, after = ratio_scatter(item, reference)
    return {
        "image": item.path.name, "aligned": True, "problem": "", "kind": answer.kind, "choice": answer.choice,
        "pairs": len(answer.pairs), "rejected_pairs": len(answer.rejected),
        "apart": parts_of(answer),
        "standing_still": len(answer.still), "still": still_part(answer, named=reference.named is not None),
        "reference_spots": len(answer.reference_spots), "image_spots": len(answer.image_spots),
        "held_out_rms_px": answer.held_out_px, "rms_px": answer.rms_px,
        "largest_shift_px": float(shift.max()), "median_shift_px": float(np.median(shift)),
        "log10_nfa": max(answer.log10_nfa, -999.0), "rival": answer.rival,
        "outside_the_markers": float(outside.mean()), "ratio_scatter_before": before, "ratio_scatter_after": after,
        "kinds": {t.kind: {"held_out_rms_px": None if t.fit is None else t.fit.held_out_px,
                           "rms_px": None if t.fit is None else t.fit.rms_px, "reason": t.reason}
                  for t in answer.trials},
        "seconds": item.seconds,
    }  # fmt: skip


def parts_of(answer: ImageAlignment) -> list[Record]:
    """Parts that moved by themselves: markers, where (smallest and largest x and y in the reference), how far."""
    out = []
    for part in answer.apart:
        i, j = answer.rejected[part].T
        there = answer.reference_spots.xy[i]
        off = np.hypot(*(answer.image_spots.xy[j] - answer.transform.apply(there)).T)
        out.append({"markers": len(part), **_extent(there), "off_px": float(np.median(off))})
    return out


def still_part(answer: ImageAlignment, *, named: bool) -> Record | None:
    """Where the markers are that stand still (smallest and largest x and y in the reference); None without any.

    ``copied``: so many show the reference's own noise, and the places are of these; 0 where most do not. Markers that
    were ``named`` by hand have no noise to compare.
    """
    if not len(answer.still):
        return None
    i, j = answer.still.T
    there, here = answer.reference_spots.xy[i], answer.image_spots.xy[j]
    one, sigma = np.arange(len(i)), middle_sigma(answer.image_spots.cov[j])
    copied = not named and is_repeated(one, there, one, here, sigma)
    if copied:
        there = there[np.abs(there - here).max(axis=1) < PART * sigma]
    return {**_extent(there), "copied": len(there) if copied else 0}


def _extent(there: NDArray[np.float64]) -> Record:
    """Smallest and largest x and y of places (N, 2)."""
    return {axis: [float(of.min()), float(of.max())] for axis, of in zip("xy", there.T, strict=True)}


def ratios(item: AlignedFile, reference: Reference) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
    """Reference by image, as taken and aligned, by the aligned one's median among the markers; None for colours.

    NaN where either picture has no light.
    """
    answer, image = item.alignment, item.image
    if answer is None or image is None or image.ndim != 2 or reference.image.ndim != 2:
        return None
    base = np.asarray(saturated_as_missing(reference.image)[0], dtype=np.float32)
    raw = np.full(base.shape, np.nan, np.float32)
    height, width = (min(m, n) for m, n in zip(base.shape, image.shape, strict=True))
    raw[:height, :width] = image[:height, :width]
    inside = ~answer.extrapolated()
    with np.errstate(divide="ignore", invalid="ignore"):
        before, after = (
            np.where((other > 0) & (base > 0), base / other, np.nan).astype(np.float32) for other in (raw, answer.image)
        )
    known = inside & np.isfinite(after)
    middle = np.median(after[known]) if known.any() else np.float32(1.0)
    return np.asarray(before / middle, dtype=np.float32), np.asarray(after / middle, dtype=np.float32)


def ratio_scatter(item: AlignedFile, reference: Reference) -> tuple[float | None, float | None]:
    """Robust 1 sigma of the ratio among the markers, as taken and aligned: moved edges, and real light."""
    pictures = ratios(item, reference)
    if pictures is None or item.alignment is None:
        return None, None
    inside = ~item.alignment.extrapolated() & np.isfinite(pictures[0]) & np.isfinite(pictures[1])
    if not inside.any():
        return None, None
    before, after = (float(np.diff(np.percentile(p[inside], [15.87, 84.13]))[0]) / 2 for p in pictures)
    return before, after
