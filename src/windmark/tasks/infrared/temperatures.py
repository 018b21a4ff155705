"""Infrared pictures of one instant to the temperature of the surface, each camera by itself and merged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.paint import MergedCameras, NodeField, NotFitted, merge_cameras, surface_temperature
from windmark.paint.radiance import Radiance
from windmark.paint.stern_volmer import NO_RATIO, TEMPERATURE_OUTSIDE
from windmark.tasks.infrared.flags import BEYOND, MARKER, NO_EMISSIVITY, SATURATED, UNSEEN
from windmark.tasks.psp import ModelPicture, Sampling, sample_picture
from windmark.tasks.psp.sampling import Samples

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Flags = NDArray[np.uint16]

DIRECTIONS = 3
"""Of a registration's errors so many are kept as modes, those that change the signal most; the others are noise."""
REGISTRATION, CALIBRATION = "registration", "calibration"


@dataclass(frozen=True)
class SurfaceLight:
    """What lies between the surface's temperature and the light that reaches a camera; parameters of
    `paint.surface_temperature`.

    ``emissivity``: of angles (N,) in degrees, NaN where it is not known.
    """

    emissivity: Callable[[ArrayLike], Array]
    emissivity_sigma: float
    surroundings: float
    surroundings_sigma: float
    transmission: float = 1.0
    transmission_sigma: float = 0.0
    window_temperature: float | None = None


@dataclass(frozen=True, eq=False)
class CameraTemperature:
    """What one camera says in one instant.

    Parameters
    ----------
    field : (V) kelvin; modes ``registration:k``, ``emissivity``, ``surroundings``, ``window``, ``calibration NAME:k``
    weight : (V,) see `Samples`
    flags : (V,) bits of `FLAGS`
    """

    field: NodeField
    weight: Array
    flags: Flags


def frame_temperatures(
    pictures: Sequence[ModelPicture],
    radiances: Mapping[str, Radiance],
    surface: SurfaceLight,
    *,
    how: Sampling,
) -> dict[str, CameraTemperature]:
    """Camera -> temperature at the V nodes, from the pictures of one instant.

    Parameters
    ----------
    pictures : one of each camera; ``light`` is the signal in the unit of the camera's radiance
    radiances : camera -> black body's signal
    surface : emissivity and what it reflects
    how : of sampling; nodes of its patches get no temperature

    Notes
    -----
    All cameras share the instant's registration: its leading directions are the same for all of them.
    """
    samples = {p.camera: sample_picture(p, how) for p in pictures}
    axes = _leading(samples)
    out = {}
    for name, s in samples.items():
        turned = np.nan_to_num(s.columns) @ axes
        rest = (turned[:, DIRECTIONS:] ** 2).sum(axis=1)
        kept = turned[:, :DIRECTIONS]
        names = tuple(f"{REGISTRATION}:{k + 1}" for k in range(kept.shape[1]))
        # What was taken off for the bend of the signal is as unsure as it is large.
        white = np.where(np.isfinite(s.variance), s.variance, 0.0) + rest + s.bent**2
        signal = NodeField(s.value, white, kept, names)
        emissivity = np.where(np.isfinite(s.value), surface.emissivity(np.minimum(s.obliquity_deg, 90.0)), np.nan)
        field, why = surface_temperature(
            signal, radiances[name], emissivity=emissivity, emissivity_sigma=surface.emissivity_sigma,
            surroundings=surface.surroundings, surroundings_sigma=surface.surroundings_sigma,
            transmission=surface.transmission, transmission_sigma=surface.transmission_sigma,
            window_temperature=surface.window_temperature,
        )  # fmt: skip
        own = tuple(n.replace(CALIBRATION, f"{CALIBRATION} {name}") for n in field.names)
        field = replace(field, names=own)
        out[name] = _without_markers(field, s, why, emissivity, how)
    return out


def _leading(samples: Mapping[str, Samples]) -> Array:
    """Directions of the registration's errors, the one that changes the signals most first; relative to each signal."""
    relative = []
    for s in samples.values():
        middle = float(np.nanmedian(np.abs(s.value))) if np.isfinite(s.value).any() else 1.0
        relative.append(np.nan_to_num(s.columns / (middle or 1.0)))
    _, axes = np.linalg.eigh(sum(r.T @ r for r in relative))
    return np.asarray(axes[:, ::-1])


def _without_markers(
    field: NodeField, s: Samples, why: NDArray[np.uint8], emissivity: Array, how: Sampling
) -> CameraTemperature:
    flags = np.zeros(len(field), np.uint16)
    lacks = ~np.isfinite(s.value)
    flags[lacks & (s.weight == 0)] |= UNSEEN
    flags[lacks & (s.weight > 0)] |= SATURATED
    flags[~lacks & ~np.isfinite(emissivity)] |= NO_EMISSIVITY
    flags[~lacks & ((why & (NO_RATIO | TEMPERATURE_OUTSIDE)) > 0) & np.isfinite(emissivity)] |= BEYOND
    if how.patches is not None:
        flags[~lacks & how.patches.nodes] |= MARKER
    good = (flags == 0) & field.known
    clean = NodeField(
        np.where(good, field.value, np.nan), np.where(good, field.white, 0.0),
        np.where(good[:, None], field.modes, 0.0), field.names, "K",
    )  # fmt: skip
    return CameraTemperature(clean, np.where(good, s.weight, 0.0), flags)


def merged_temperature(cameras: Mapping[str, CameraTemperature]) -> tuple[MergedCameras | None, Flags]:
    """Cameras by their inverse variance, None where none shows a node; and (V,) why a node has no temperature."""
    names = list(cameras)
    flags = np.bitwise_or.reduce([c.flags for c in cameras.values()])
    done = merge_cameras([cameras[n].field for n in names], names, gain="none",
                         tapers=np.stack([cameras[n].weight for n in names]))  # fmt: skip
    if isinstance(done, NotFitted) or not done.field.known.any():
        return None, flags
    return done, np.where(done.field.known, 0, flags).astype(np.uint16)
