"""The paint's texture, which displaces a marker's image by the same in every camera and frame.

A detector's covariance of a centre holds the sensor's noise, new in every image, and the texture round the marker,
which goes with the surface. Two cameras do not average the second part away, nor do many frames (the same marker's
error in two cameras 60 degrees apart, 1 % grain: correlation 0.5). So it belongs to the marker's place: its part of the
spots' covariance is turned into a covariance of the place in the tangent plane, which all images share.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.deformation import Deformation
from windmark.deformation.turned import surface_axes
from windmark.tasks.deform.memory import displaced
from windmark.tasks.deform.spots import Labelled
from windmark.tasks.deform.task import DeformationTest

Array = NDArray[np.float64]

MOST_SHARE = 0.99
"""Of a spot's variance that texture can be: where a blur hides the pixels' own noise, what is left looks like it."""

GRAZING = 0.05
"""Markers seen flatter than that, as the ratio of areas, tell nothing of their tangent plane."""


@dataclass(frozen=True)
class Texture:
    """What the texture makes of the markers' places.

    Parameters
    ----------
    place_cov : (N, 3, 3) of the places in the model's frame, the table's own sigma included
    known : (N,) markers of which it is known
    """

    place_cov: Array
    known: NDArray[np.bool_]


def texture_of(labelled: Mapping[str, Labelled], state: Deformation, test: DeformationTest) -> Texture | None:
    """The texture of every marker with a normal, as the spots of one instant show it; None without any."""
    markers = test.markers
    if not any(_share(s) for s in labelled.values()):
        return None
    placed, motion = displaced(markers, state), state.tunnel_from_model
    total, count = np.zeros((len(markers), 3, 3)), np.zeros(len(markers))
    for name, spots in labelled.items():
        normal = placed.normal[spots.marker]
        good = np.isfinite(normal).all(axis=1)
        rows, normal = spots.marker[good], normal[good]
        station = test.station(name)
        camera = state.cameras.get(name, station.camera)
        pose = state.cam_from_tunnel.get(name, station.cam_from_tunnel)
        tangent = surface_axes(normal)[..., :2]
        by_tangent = camera.project_jacobian(pose.apply(placed.xyz[rows]))[2] @ pose.rotation @ tangent
        size = np.linalg.norm(by_tangent, axis=(1, 2))
        seen = np.abs(np.linalg.det(by_tangent)) > GRAZING * size**2
        back = tangent[seen] @ np.linalg.inv(by_tangent[seen])
        cov = back @ (_share(spots) * spots.cov[good][seen]) @ np.swapaxes(back, 1, 2)
        total[rows[seen]] += cov
        count[rows[seen]] += 1
    known = count > 0
    total[known] /= count[known, None, None]
    wall = markers.role == "wall"
    own = np.where(wall[:, None, None], total, motion.rotation.T @ total @ motion.rotation)
    sigma = np.where(np.isfinite(markers.sigma), markers.sigma, 0.0)
    return Texture(own + (sigma**2)[:, :, None] * np.eye(3), known)


def without_texture(spots: Labelled, test: DeformationTest, texture: Texture | None) -> Array:
    """(n, 2, 2) covariance of spots less what the covariance of the markers' places holds.

    Places that were corrected by wind-off images (``test.marker_cov``) are where the texture shows them.
    """
    if test.marker_cov is not None:
        known = np.ones(len(spots.marker), bool)
    elif texture is not None:
        known = texture.known[spots.marker]
    else:
        return spots.cov
    return np.asarray(spots.cov * (1 - _share(spots) * known)[:, None, None])


def _share(spots: Labelled) -> float:
    noise = None if spots.known is None else spots.known.frame.noise
    return 0.0 if noise is None else min(noise.texture, MOST_SHARE)
