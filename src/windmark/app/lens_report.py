"""A lens in a report: its parameters with their sigmas, what it does over the sensor, pictures with it undone."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.app.lens_pictures import correction_photos, distortion_picture, visible_factor
from windmark.app.report import Report, measured
from windmark.calibration import CorrectedImage, magnify_distortion
from windmark.geometry import PARAMETERS, Camera
from windmark.geometry.camera import LENS_PARAMETERS

TESTED = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "tilt_x", "tilt_y", "shear")
SIGNIFICANT = 3.0
UNITS = {"focal_px": "px", "cx": "px", "cy": "px", "tilt_x": "rad", "tilt_y": "rad"}
NAMES = {"focal_px": "focal length", "aspect": "aspect ratio fy/fx", "cx": "principal point cx",
         "cy": "principal point cy", "tilt_x": "sensor tilt about x", "tilt_y": "sensor tilt about y",
         "shear": "shear of the axes"}  # fmt: skip
LENSES = {"brown": "", "rational": "Rational lens. ",
          "fisheye": "Fisheye lens; focal length in pixels per radian. "}  # fmt: skip
PHOTO_BYTES = 140_000
"""Of each of the pictures that compare a lens and none."""


def put_parameters(report: Report, camera: Camera, fixed: str = "not free", *, zeros: bool = True) -> None:
    """The table of a camera's parameters; ``fixed`` is said of those that have no sigma, unless none has one.

    ``zeros``: parameters that are zero have their row, too.
    """
    rows = []
    for p in LENS_PARAMETERS[camera.lens]:
        k, value = PARAMETERS.index(p), float(getattr(camera, p))
        sigma = 0.0 if camera.cov is None else math.sqrt(max(float(camera.cov[k, k]), 0.0))
        if not (zeros or value):
            continue
        t = abs(value) / sigma if sigma > 0 and p in TESTED else None
        verdict = "" if t is None else "significant" if t > SIGNIFICANT else "not significant"
        # What is not free is what was given, with all the digits that it has.
        shown, sigma_shown = measured(value, sigma) if sigma > 0 else (f"{value:.8g}", "–")
        rows.append((NAMES.get(p, p), UNITS.get(p, "–"), shown, sigma_shown, t, verdict if sigma > 0 else fixed))
    columns = 3 if camera.cov is None else 6
    head = ["parameter", "unit", "value", "1 sigma", "|value| / sigma", ""]
    report.table(head[:columns], [row[:columns] for row in rows])
    report.text(f"{LENSES[camera.lens]}Image {camera.size_px[0]} x {camera.size_px[1]} px, horizontal field of view "
                f"{camera.fov_deg:.3f} deg.", "soft")  # fmt: skip


def put_distortion(report: Report, camera: Camera, what: str) -> None:
    """The vectors of the distortion over the sensor; ``what`` says whose where it cannot be drawn."""
    report.drawing(what, lambda: distortion_picture(camera), "What the lens does.", dpi=88)


def put_correction(
    report: Report, name: str, image: NDArray[np.generic], camera: Camera, corrected: CorrectedImage,
    *, room: int = PHOTO_BYTES, magnified: bool = True,
) -> None:  # fmt: skip
    """A picture as taken, with the lens undone, and, of a lens that has a factor, with its distortion magnified."""
    if camera.lens != "brown" or not magnified:
        report.text(f"{name} as taken, and as a pinhole of the same focal length would have seen the middle of it. "
                    "Blue lines are straight in space.")  # fmt: skip
        photos = correction_photos(image, camera, corrected, room=room)
    else:
        factor = visible_factor(camera)
        report.text(f"{name} as taken, with the lens undone, and with its distortion magnified (AIAA 2005-5007, "
                    "Fig. 9). Blue lines are straight in space, yellow ones in the picture: with the lens undone they "
                    "are the same.")  # fmt: skip
        photos = correction_photos(image, camera, corrected, magnify_distortion(image, camera, factor), factor, room)
    for photo in photos:
        report.raw(photo)
    report.side_by_side(len(photos))
