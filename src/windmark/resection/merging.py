"""Several pictures of one model merged on its surface (AIAA 2005-5007, section III.D: "to combine several views").

Every picture's value at a point counts by the information that it has about the surface there: pixels per area
(distance, obliquity and lens, by the derivative of the projection) over the variance of its noise, and that fades
smoothly to nothing where the picture's validity ends, so that no seam jumps. Grey levels of two cameras have gains of
their own; these come from what both see, with their sigma.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.resection.gains import LEAST_OVERLAP, Gains, overlap_gains
from windmark.resection.merged_views import MergedViews, NotMerged, combined_values, stacked_values, take_values
from windmark.resection.seams import find_seams
from windmark.resection.sources import Picture, Prepared, Taken, prepare
from windmark.resection.visibility import NodeView, checked_angle, see_nodes
from windmark.scene import Mesh
from windmark.scene.shown import check_kinds, list_of

Array = NDArray[np.float64]

GAINS = ("none", "overlap")
WELL = 0.3
"""Taper above which a picture sees a node well enough to tell its gain."""
SOUND = 0.01
"""Taper above which a value is not one of an outline's mixed pixels."""
REGIONS = 10
"""Regions of the surface along the mesh's size."""
MOST = 127
"""Pictures that can be merged."""


def merge_views(
    mesh: Mesh,
    pictures: Sequence[Picture],
    *,
    gain: str = "overlap",
    offset: bool = False,
    black: float = 0.0,
    reference: str | None = None,
    max_obliquity_deg: float = 80.0,
    taper_deg: float = 15.0,
    taper_px: float = 12.0,
    interpolation: str = "cubic",
    tolerance: float | None = None,
) -> MergedViews | NotMerged:
    """Merge pictures of one instant, taken by any number of cameras, on the surface.

    Parameters
    ----------
    mesh : the surface, where it was when the pictures were taken
    pictures : with their cameras and poses; names must differ
    gain : "overlap" estimates each picture's gain from the nodes that it shares with others; "none" takes the values as
        they are (ratios of two pictures, calibrated cameras)
    offset : with "overlap", each picture's grey level without light is unknown, too; needs values that differ over the
        overlap
    black : grey level without light, taken off all pictures
    reference : the picture whose grey levels the others are brought to; None: the first of those that are joined by
        overlaps and see most together
    max_obliquity_deg : surface seen more obliquely by a picture takes nothing from it
    taper_deg, taper_px : over which angle below that limit, and over which distance to the picture's border and to
        outlines, the weight falls to nothing. Points that no other picture sees keep their value
    interpolation, tolerance : see `interpolate_image`, `see_nodes`

    Returns
    -------
    MergedViews; or NotMerged, when fewer than two pictures see the surface, or their gains cannot be compared because
    they do not overlap. A picture that sees nothing, is the copy of another, or does not overlap is left out and named.

    Raises
    ------
    ValueError
        For wrong shapes or options, names that are there twice, no or more than 127 pictures.

    Notes
    -----
    Source: AIAA 2005-5007, section III.D. Weights do not follow the noise of single values, so they do not bend the
    mean. Nodes are sampled at points: nodes coarser than pixels are not averaged over their cells. Markers and dirt are
    part of the picture: they are at the same place in all of them.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> y, x = np.mgrid[-1:1:10j, -1:1:10j]  # a plate of 10 by 10 nodes
    >>> i = (np.arange(9) + 10 * np.arange(9)[:, None]).ravel()
    >>> triangles = np.r_[np.c_[i, i + 1, i + 11], np.c_[i, i + 11, i + 10]]
    >>> plate = wm.Mesh.make(np.c_[x.ravel(), y.ravel(), 0.0 * x.ravel()], triangles)
    >>> camera, light = wm.Camera((128, 96), 120.0), np.tile(np.linspace(5.0, 6.0, 96)[:, None], 128)
    >>> poses = [wm.Pose.look_at([x, 0.0, 4.0], [x, 0.0, 0.0], [0.0, 1.0, 0.0]) for x in (-0.2, 0.2)]
    >>> left, right = wm.Picture("left", light, camera, poses[0]), wm.Picture("right", 2.0 * light, camera, poses[1])
    >>> merged = wm.merge_views(plate, [left, right], reference="left")
    >>> merged.gains.gain.round(3).tolist()  # the right picture is twice as bright
    [1.0, 2.0]
    """
    check_kinds("merge_views", mesh=(mesh, Mesh), pictures=(pictures, list_of(Picture)))
    _check(pictures, gain, offset, reference, max_obliquity_deg, taper_deg, taper_px)
    options = {
        "gain": gain, "offset": offset, "black": float(black), "max_obliquity_deg": float(max_obliquity_deg),
        "taper_deg": float(taper_deg), "taper_px": float(taper_px), "interpolation": interpolation,
    }  # fmt: skip
    shown, left = _shown(mesh, pictures, options, tolerance)
    if len(shown) < 2:
        return NotMerged(_too_few([s.source.picture.name for s in shown], left), left)
    names = [s.source.picture.name for s in shown]
    value, variance, weight = stacked_values([s.taken for s in shown])
    well = np.stack([s.taken.taper > WELL for s in shown]) & np.isfinite(value)
    gains = overlap_gains(
        value, variance, well, regions(mesh), place=mesh.vertices,
        reference=names.index(reference) if reference in names else None, offset=offset, estimate=gain == "overlap",
    )  # fmt: skip
    keep = np.flatnonzero(gains.linked)
    if len(keep) < len(shown):
        others = " and ".join(names[k] for k in keep)
        for name in (names[k] for k in np.flatnonzero(~gains.linked)):
            left[name] = (
                f"shares fewer than {LEAST_OVERLAP} well-seen nodes with {others}, so its gain is unknown;"
                ' gain = "none" merges it as it is'
            )
        if len(keep) < 2:
            why = "; ".join(f"{name} {reason}" for name, reason in left.items())
            return NotMerged(f"the pictures do not overlap: {others} stands alone; {why}", left)
        shown, gains = [shown[k] for k in keep], _part(gains, keep)
        value, variance, weight, well = value[keep], variance[keep], weight[keep], well[keep]
    nodes, own, own_variance = combined_values(value, variance, weight, gains)
    by_gain = gains.cov[: len(shown), : len(shown)] / np.outer(gains.gain, gains.gain)
    sound = np.stack([s.taken.taper > SOUND for s in shown])
    seams = find_seams(mesh.triangles, nodes.source, own, own_variance, sound, by_gain)
    kept = tuple(s.source.picture.name for s in shown)
    return MergedViews(
        mesh, kept, nodes, tuple(s.view for s in shown), own, np.sqrt(own_variance), gains, seams, well,
        left, {**options, "reference": kept[gains.reference]}, tuple(s.source for s in shown),
    )  # fmt: skip


class _Shown(NamedTuple):
    """One picture and what it shows of the nodes."""

    source: Prepared
    view: NodeView
    taken: Taken


def _shown(mesh: Mesh, pictures: Sequence[Picture], options: Mapping[str, Any], tolerance: float | None
           ) -> tuple[list[_Shown], dict[str, str]]:  # fmt: skip
    """The pictures that show any of the nodes, and why others do not take part."""
    shown: list[_Shown] = []
    left: dict[str, str] = {}
    normals = mesh.vertex_normals()
    for k, picture in enumerate(pictures):
        source = prepare(picture, mesh, options["interpolation"], "merge_views")
        same = next((p.name for p in pictures[:k] if _same(p, picture)), None)
        if same is not None:
            left[picture.name] = f"is the same picture as {same}, pixel by pixel: it tells nothing new"
            continue
        view = see_nodes(mesh, picture.camera, picture.cam_from_model, tolerance=tolerance,
                         max_obliquity_deg=options["max_obliquity_deg"])  # fmt: skip
        taken = take_values(source, view, mesh.vertices, normals, options)
        if np.isfinite(taken.value).any():
            shown.append(_Shown(source, view, taken))
        else:
            left[picture.name] = "sees no node of the grid"
    return shown, left


def _check(pictures: Sequence[Picture], gain: str, offset: bool, reference: str | None, max_obliquity_deg: float,
           taper_deg: float, taper_px: float) -> None:  # fmt: skip
    names = [p.name for p in pictures]
    if not 0 < len(pictures) <= MOST:
        raise UsageError(f"merge_views: expected 1 to {MOST} pictures, got {len(pictures)}")
    if len(set(names)) < len(names):
        raise UsageError(f"merge_views: the pictures' names must differ, got {names}")
    if gain not in GAINS:
        raise UsageError(f"merge_views: gain must be one of {', '.join(GAINS)}, got {gain!r}")
    if offset and gain == "none":
        raise UsageError('merge_views: offset needs gain = "overlap"')
    if reference is not None and reference not in names:
        raise UsageError(f"merge_views: reference must be one of {', '.join(names)}, got {reference!r}")
    checked_angle(max_obliquity_deg, "merge_views")
    if not (0 < taper_deg < np.inf and 0 < taper_px < np.inf):
        raise UsageError(f"merge_views: taper_deg and taper_px must be > 0, got {taper_deg} and {taper_px}")


def _same(a: Picture, b: Picture) -> bool:
    return np.shape(a.image) == np.shape(b.image) and np.array_equal(a.image, b.image, equal_nan=_is_float(a.image))


def _is_float(image: NDArray[np.generic]) -> bool:
    return np.asarray(image).dtype.kind == "f"


def _too_few(names: Sequence[str], left: Mapping[str, str]) -> str:
    why = "; ".join(f"{name} {reason}" for name, reason in left.items())
    have = f"only {names[0]} shows the surface" if names else "no picture shows the surface"
    return f"merging needs two pictures, {have}" + (f"; {why}" if why else "")


def regions(mesh: Mesh) -> NDArray[np.int64]:
    """(V,) in which cube of a tenth of the mesh's size a node lies."""
    size = max(mesh.size, 1e-300) / REGIONS
    low = mesh.box[0]
    with np.errstate(invalid="ignore"):
        cell = np.clip(np.nan_to_num((mesh.vertices - low) / size), 0, 1000).astype(np.int64)
    return np.asarray(cell @ np.array([1, 1024, 1024**2]))


def _part(gains: Gains, keep: NDArray[np.int64]) -> Gains:
    """The gains of some pictures."""
    count = len(gains.gain)
    both = np.concatenate([keep, keep + count])
    return Gains(
        gains.gain[keep], gains.offset[keep], gains.sigma[keep], gains.offset_sigma[keep],
        gains.cov[np.ix_(both, both)], gains.linked[keep], gains.overlap[np.ix_(keep, keep)],
        int(np.flatnonzero(keep == gains.reference)[0]), gains.systematic, gains.estimated,
    )  # fmt: skip
