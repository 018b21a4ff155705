"""Images of one time point merged on the surface: which belong together, values on nodes, at points and in views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from windmark import resection
from windmark.pipeline.points import MergedTable, PointSet, merged_points
from windmark.pipeline.project import Project
from windmark.pipeline.quantity import Quantity
from windmark.pipeline.results import FramedView, ImageResult, ViewImage
from windmark.pipeline.wanted import groups
from windmark.resection import MergedValues, MergedViews, NotMerged, Picture, PixelMap
from windmark.scene import Mesh
from windmark.scene.levels import missing_at
from windmark.tasks.black import beside_black


@dataclass(frozen=True)
class MergedView:
    """A merged virtual image, and per pixel sigma, dominant image and number of images."""

    view: ViewImage
    values: MergedValues


@dataclass(frozen=True)
class MergeResult:
    """The images of one point merged.

    Parameters
    ----------
    point : of the test; None where there is only one
    images : names of those that were wanted
    outcome : what came of it; its reason where nothing did
    missing : images that could not take part, with the reason
    views, points : merged virtual images, values at points and along lines
    quantity : what the values are
    """

    point: str | None
    images: tuple[str, ...]
    outcome: MergedViews | NotMerged
    missing: dict[str, str]
    views: tuple[MergedView, ...] = ()
    points: tuple[MergedTable, ...] = ()
    quantity: Quantity = field(default_factory=Quantity)

    @property
    def folder(self) -> str:
        """Name of its folder among the results."""
        return "merged" if self.point is None else f"merged-{self.point}"

    @property
    def merged(self) -> MergedViews | None:
        """The merged images when there are any."""
        return self.outcome if isinstance(self.outcome, MergedViews) else None


def picture_of(item: ImageResult, light: NDArray[np.generic] | None = None) -> Picture:
    """An image, in its own quantity, with its pose as the rooms take it; its ``light``, where that is at hand."""
    assert item.image is not None
    assert item.cam_from_model is not None
    cov = item.pose_cov if item.registered is None else item.registered.cov
    whole, light, noise = item.quantity.of(item.image), item.light if light is None else light, None
    if light is not whole or item.apart > 1:
        if item.black is not None:  # on the model; behind it, too, noise is too small where it is clipped
            whole = missing_at(whole, beside_black(item.image))
        # Of the levels as the camera stored them, with the noise of rounding.
        noise = resection.noise_law(whole, apart=None if item.apart == 1 else item.apart)
    return Picture(item.name, light, item.camera, item.cam_from_model, noise, cov)


def merge_images(
    project: Project,
    images: Sequence[ImageResult],
    mesh: Mesh,
    framed: Sequence[FramedView],
    pixels: Sequence[PixelMap],
    sets: tuple[PointSet, ...],
) -> tuple[MergeResult, ...]:
    """Merge the images of every point; one that went wrong is left out and named."""
    assert project.merge is not None
    known = {item.name: item for item in images}
    wanted = groups(project.merge, [(entry.label, entry.point) for entry in project.image])
    return tuple(
        _group(project, point, [known[name] for name in names], mesh, framed, pixels, sets)
        for point, names in wanted.items()
    )


def _group(
    project: Project,
    point: str | None,
    items: list[ImageResult],
    mesh: Mesh,
    framed: Sequence[FramedView],
    pixels: Sequence[PixelMap],
    sets: tuple[PointSet, ...],
) -> MergeResult:
    options = project.merge
    assert options is not None
    names = tuple(item.name for item in items)
    missing = {i.name: i.problem or "has no pose" for i in items if i.cam_from_model is None or i.image is None}
    good = [item for item in items if item.name not in missing]
    if len(good) < 2:
        have = f"only {good[0].name} is left" if good else "none of them is left"
        why = "; ".join(f"{name}: {text}" for name, text in missing.items())
        lost = NotMerged(f"merging needs two images with poses, {have}" + (f" ({why})" if why else ""))
        return MergeResult(point, names, lost, missing)
    quantity = good[0].quantity
    if len({(i.quantity.name, i.quantity.unit) for i in good}) > 1:
        what = ", ".join(f"{i.name}: {i.quantity.label}" for i in good)
        return MergeResult(point, names, NotMerged(f"the images show different quantities ({what})"), missing)
    gain = options.gain or ("overlap" if quantity.name == "grey" else "none")
    reference = options.reference if options.reference in [item.name for item in good] else None
    outcome = resection.merge_views(
        mesh, [picture_of(item) for item in good], gain=gain, offset=options.offset, black=options.black,
        reference=reference, max_obliquity_deg=project.resect.max_obliquity_deg, taper_deg=options.taper_deg,
        taper_px=options.taper_px, interpolation=project.resect.interpolation,
    )  # fmt: skip
    if isinstance(outcome, NotMerged):
        return MergeResult(point, names, outcome, {**missing, **outcome.left_out})
    views = tuple(_view(outcome, view, seen) for view, seen in zip(framed, pixels, strict=True))
    missing = {**missing, **outcome.left_out}
    return MergeResult(point, names, outcome, missing, views, merged_points(sets, outcome), quantity)


def _view(merged: MergedViews, view: FramedView, pixels: PixelMap) -> MergedView:
    values = merged.image(pixels)
    shown: NDArray[np.float32] = values.value.astype(np.float32)
    image = ViewImage(view.name, shown, np.isfinite(shown), view.camera, view.cam_from_model, view.units_per_px)
    return MergedView(image, values)
