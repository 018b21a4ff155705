"""Matched marks of all pictures, by name, and which camera took which picture."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.calibration import StartFocal, start_focal
from windmark.errors import UsageError
from windmark.geometry import Camera
from windmark.scene import MarkerSet, Observations, View

FIELD = 1.0
"""Focal length, in widths of the image, of a camera of which nothing is known, until the marks say more."""


@dataclass(frozen=True)
class Marks:
    """What a calibration starts from.

    Parameters
    ----------
    observations : ``view`` and ``point`` are indices into ``views`` and ``markers``
    markers : rough coordinates
    cameras : start values by name
    views : each with the name of its camera, poses where known
    ellipses : (O, 3) half axes in pixels and direction of each mark's ellipse, NaN where not measured; None without
    """

    observations: Observations
    markers: MarkerSet
    cameras: Mapping[str, Camera]
    views: tuple[View, ...]
    ellipses: NDArray[np.float64] | None = None


def start_camera(size_px: tuple[int, int], focal_px: float | None) -> Camera:
    """A camera of which only the image's size is known, and perhaps the focal length."""
    return Camera(size_px, focal_px or FIELD * max(size_px))


def with_focal(marks: Marks, seed: int = 0) -> Marks:
    """The marks with focal lengths that they tell themselves (0.4 to 25 widths are tried), where they do."""
    obs, found = marks.observations, dict(marks.cameras)
    for name, camera in marks.cameras.items():
        if camera.lens == "fisheye":  # its focal length is of another kind, see `lens.with_lens`
            continue
        mine = [v for v, view in enumerate(marks.views) if view.camera == name]
        pairs = [(marks.markers.xyz[obs.point[obs.view == v]], obs.xy[obs.view == v]) for v in mine]
        told = start_focal(pairs, camera.size_px, seed=seed)
        if isinstance(told, StartFocal):
            found[name] = replace(camera, focal_px=told.focal_px)
    return replace(marks, cameras=found)


@dataclass(frozen=True)
class Taken:
    """Which camera took an image, and at which instant: images of one instant have the same ``frame``."""

    camera: str
    frame: str


def taken_by(
    images: Sequence[str],
    cameras: Sequence[str],
    patterns: Mapping[str, str] | None = None,
    given: Sequence[str] | None = None,
) -> list[Taken]:
    """The camera and the instant of each image.

    The camera is the given one, that of the pattern that the image's name fits, the only one, or the one whose name
    the image's name begins with. The instant is what stands for the ``*`` of the pattern, or the image's name without
    that of the camera.

    Parameters
    ----------
    images, cameras : names
    patterns : camera -> pattern of its images' names, such as ``*_left``; ``*`` stands for any letters
    given : the camera of each image where it is known, else ""

    Raises
    ------
    ValueError
        For an unknown camera, or an image whose name fits none, or two.
    """
    known = {c: re.compile("(.*)".join(map(re.escape, p.split("*")))) for c, p in (patterns or {}).items()}
    return [_taken(i, g, cameras, known) for i, g in zip(images, given or [""] * len(images), strict=True)]


def _taken(image: str, given: str, cameras: Sequence[str], patterns: Mapping[str, re.Pattern[str]]) -> Taken:
    if given:
        if given not in cameras:
            raise UsageError(f"image {image}: its camera is {given!r}; there are {', '.join(cameras)}")
        return Taken(given, _frame(image, given, len(cameras)))
    if patterns:
        found = [(c, m) for c, p in patterns.items() if (m := p.fullmatch(image))]
        if len(found) != 1:
            which = " and ".join(c for c, _ in found) or "none"
            raise UsageError(f"image {image}: which camera took it? Its name fits the pattern of {which}")
        return Taken(found[0][0], "_".join(found[0][1].groups()))
    fits = [c for c in cameras if len(cameras) == 1 or image.startswith(c)]
    longest = [c for c in fits if len(c) == max(map(len, fits))]
    if len(longest) != 1:
        raise UsageError(
            f"image {image}: which camera took it? Its name begins with none of {', '.join(cameras)}; rename it, give "
            "a column camera in the table of matches, or a pattern of each camera's names"
        )
    return Taken(longest[0], _frame(image, longest[0], len(cameras)))


def _frame(image: str, camera: str, count: int) -> str:
    """The image's name without that of the camera, where there are several cameras."""
    return image if count == 1 else image[len(camera) :].lstrip("/_-. ") if image.startswith(camera) else image


def with_sigma(cov: NDArray[np.float64], sigma_px: float) -> NDArray[np.float64]:
    """Covariances, those that are not known from the sigma given."""
    known = np.asarray(np.isfinite(cov).all(axis=(1, 2), keepdims=True))
    return np.where(known, cov, sigma_px**2 * np.eye(2))


def with_excess(cov: NDArray[np.float64], excess_px: float) -> NDArray[np.float64]:
    """Covariances (N, 2, 2) of spots with so much noise beyond the detector's."""
    return with_sigma(cov, 0.1) + excess_px**2 * np.eye(2)
