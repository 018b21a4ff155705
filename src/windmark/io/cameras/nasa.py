"""NASA's camera-to-tunnel calibration (uPSP, JSON).

Keys: ``uPSP_cameraMatrix`` [[f, 0, dcx], [0, f, dcy], [0, 0, 1]], the principal point counted from the
middle of the image; ``distCoeffs`` [k1, k2, p1, p2, k3]; ``rmat``, ``tvec``; ``sensor_resolution``
[height, width, ...]. Source: the file format pages of NASA's upsp-processing.

The middle is (width/2, height/2) in pixels whose top-left centre is (0, 0), as uPSP computes it:
checked on NASA's test frame, where (w - 1)/2, (h - 1)/2 fits worse (1.29 px against 1.13 px).
``X_cam = rmat X + tvec``, although the pages call it camera to tunnel: checked on the same data.
Other keys (sensor_size, Updated ...) are not needed and not read.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from windmark.io.cameras import record
from windmark.io.errors import FileError
from windmark.io.text import Pathlike

MATRIX = "uPSP_cameraMatrix"


def parse_nasa(path: Pathlike, content: dict[str, Any], size_px: tuple[int, int] | None) -> record.CameraFile:
    """The camera and pose of a parsed file; ``size_px`` where the file has no sensor_resolution."""
    for key in (MATRIX, "distCoeffs", "rmat", "tvec"):
        if key not in content:
            raise record.key_error(path, key, "missing; expected uPSP_cameraMatrix, distCoeffs, rmat and tvec")
    resolution = content.get("sensor_resolution")
    if resolution is not None:
        if not isinstance(resolution, list) or len(resolution) not in (2, 3):
            raise record.key_error(path, "sensor_resolution", f"{resolution}; expected [height, width, channels]")
        size_px = record.image_size(path, "sensor_resolution", resolution[1::-1])
    elif size_px is None:
        raise FileError(path, "no key sensor_resolution; expected it, or the image size from the caller (size_px)")
    parameters = record.pinhole(path, MATRIX, content[MATRIX]) | record.lens(path, "distCoeffs", content["distCoeffs"])
    parameters["cx"] += size_px[0] / 2
    parameters["cy"] += size_px[1] / 2
    rotation = record.numbers(path, "rmat", content["rmat"], (3, 3))
    translation = record.numbers(path, "tvec", content["tvec"], (3,))
    pose = record.pose(path, "rmat", rotation, np.asarray(translation), mend=True)
    return record.CameraFile(record.camera(path, size_px, parameters), pose, None, "nasa")
