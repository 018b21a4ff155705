"""The Cramer-Rao bound of a marker's centre: what no unbiased detector can beat in white noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.detection.template.disc_model import check_photometry, patch_model, shape_matrix

Array = NDArray[np.float64]

SINGULAR = 1e-12
"""Least eigenvalue of the information about scaled unknowns; below it there is none but rounding."""


def window_radius(radius_px: ArrayLike, blur_px: ArrayLike, blurs: float = 4.0) -> Array:
    """Radius of the window that holds a marker and enough of what is round it: max(2 r, r + blurs * blur + 1).

    A window of 2 r alone loses up to 42 % of the accuracy where the blur is large.
    """
    radius = np.asarray(radius_px, dtype=float)
    return np.maximum(2.0 * radius, radius + blurs * np.asarray(blur_px, dtype=float) + 1.0)


def covariance_bound(jacobian: ArrayLike, noise: float = 1.0) -> Array:
    """Smallest covariance of unbiased estimates in white noise: the inverse of the Fisher information J J^T / noise^2.

    Parameters
    ----------
    jacobian : (..., U, P) derivatives of P pixels by U unknowns
    noise : standard deviation of a pixel

    Returns
    -------
    (..., U, U), infinite where the pixels do not determine the unknowns (a disc that lies within one pixel)
    """
    rows = np.asarray(jacobian, dtype=float)
    scale = np.linalg.norm(rows, axis=-1)  # the unknowns have different units: scale before inverting
    rows = rows / np.where(scale > 0, scale, 1.0)[..., None]
    information = rows @ np.swapaxes(rows, -1, -2)
    known = np.linalg.eigvalsh(information)[..., 0] > SINGULAR
    cov = np.linalg.inv(np.where(known[..., None, None], information, np.eye(information.shape[-1])))
    cov = cov / np.where(known[..., None, None], scale[..., None, :] * scale[..., :, None], 1.0)
    return np.asarray(np.where(known[..., None, None], cov * noise**2, np.inf))


def centre_bound(
    axes_px: ArrayLike,
    angle: float = 0.0,
    *,
    blur_px: float,
    depth: float = 1.0,
    noise: float = 1.0,
    background: float = 4.0 / 3.0,
    slope: tuple[float, float] = (0.0, 0.0),
    xy: ArrayLike = (0.0, 0.0),
    photometry: str = "additive",
    window_px: float | None = None,
    known: ArrayLike = (),
) -> Array:
    """Smallest covariance of an unbiased estimate of a marker's centre, all ten unknowns of the model estimated.

    Fisher information of `patch_model` in white noise: the inverse of J^T J / noise^2, its block of the centre.

    Parameters
    ----------
    axes_px : half axes (2,) of the imaged ellipse, or one radius
    angle : direction of the first half axis from x towards y, radians
    blur_px : standard deviation of the Gaussian blur
    depth, noise, background : grey levels; the bound depends on noise / depth, and on depth / background only if the
        photometry is multiplicative
    slope : of the light, per pixel: relative to `background` if multiplicative, else in grey levels
    xy : centre relative to a pixel's centre; sharp discs are located a little worse or better by it
    photometry : "multiplicative" or "additive"
    window_px : pixels within this distance of the centre are used; None takes `window_radius` of the larger half axis
    known : indices into `disc_model.UNKNOWNS` of what is not estimated

    Returns
    -------
    (2, 2) covariance in px^2
    """
    check_photometry(photometry)
    axes = np.broadcast_to(np.asarray(axes_px, dtype=float), (2,))
    center = np.asarray(xy, dtype=float)
    reach = float(window_radius(axes.max(), blur_px)) if window_px is None else float(window_px)
    if not (axes.min() > 0 and blur_px > 0 and reach > 0 and noise > 0 and depth != 0):
        raise ValueError("centre_bound: axes_px, blur_px, window_px, noise must be > 0 and depth not 0")
    shape = shape_matrix(axes, angle)
    params = np.array([*center, shape[0, 0], shape[0, 1], shape[1, 1], blur_px, depth, background, *slope], dtype=float)
    half = int(np.ceil(reach + np.abs(center).max()))
    lattice = np.arange(-half, half + 1.0)
    _, jac = patch_model(lattice, lattice, params, photometry=photometry)
    inside = np.hypot(lattice[None, :] - center[0], lattice[:, None] - center[1]) <= reach
    free = np.setdiff1d(np.arange(10), np.asarray(known, dtype=int))
    return covariance_bound(jac[free][:, inside], noise)[:2, :2]


def bound_factor(radius_px: float, tilt_deg: float, blur_px: float, *, samples: int = 64, **options: object) -> float:
    """The k of "one standard deviation per axis = k * noise / depth" for a disc seen at an angle.

    Root mean square over both axes and over `samples` places of the centre within its pixel and azimuths, on a
    low-discrepancy sequence (no random numbers); `options` go to `centre_bound`.
    """
    axes = np.array([radius_px, radius_px * np.cos(np.radians(tilt_deg))])
    places = (0.5 + np.arange(1, samples + 1)[:, None] * np.array([0.8191725134, 0.6710436067, 0.5497004779])) % 1.0
    options = {"window_px": float(window_radius(radius_px, blur_px)), **options}
    total = 0.0
    for p in places:
        cov = centre_bound(axes, np.pi * p[2], blur_px=blur_px, xy=p[:2] - 0.5, **options)  # type: ignore[arg-type]
        total += 0.5 * np.trace(cov)
    return float(np.sqrt(total / samples))
