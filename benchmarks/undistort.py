"""The corrected image: time and error beside OpenCV and scipy, in one run, on one thread.

The picture is a sum of waves down to 4 pixels, so what every corrected pixel should hold is known exactly; the
lens moves the corners by about 40 px. Errors are RMS in grey levels of a picture whose own scatter is about 36.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy import ndimage

from windmark.calibration import corrected_camera, undistort
from windmark.geometry import Camera

MARGIN_PX = 8


def main(quick: bool = False) -> dict[str, float]:
    """Measure, print one table, return its numbers."""
    results: dict[str, float] = {}
    _speed(results, (1232, 816) if quick else (4928, 3264), 3 if quick else 5)
    _error(results)
    print("\ncorrected image                                      value")
    for name, value in results.items():
        print(f"{name:<50} {value:10.4g}")
    return results


def lens(size_px: tuple[int, int]) -> Camera:
    """A usual wide lens, scaled to the size of the image."""
    width, height = size_px
    return Camera(size_px, 0.81 * width, 1.0, 0.503 * width, 0.497 * height, -0.08, 0.01, 1e-4, -2e-4)


def median(call: Callable[[], object], repeat: int) -> float:
    """Median CPU time of some calls, after one that compiles."""
    call()
    times = []
    for _ in range(repeat):
        start = time.thread_time()
        call()
        times.append(time.thread_time() - start)
    return float(np.median(times))


def _speed(results: dict[str, float], size_px: tuple[int, int], repeat: int) -> None:
    import cv2

    cv2.setNumThreads(1)
    camera = lens(size_px)
    image = np.random.default_rng(0).integers(0, 4096, size_px[::-1]).astype(np.uint16)
    ours = median(lambda: undistort(image, camera), repeat)
    coefficients = np.array([camera.k1, camera.k2, camera.p1, camera.p2, camera.k3])
    linear = median(lambda: cv2.undistort(image, camera.matrix, coefficients), repeat)

    def lanczos() -> object:
        maps = cv2.initUndistortRectifyMap(camera.matrix, coefficients, None, camera.matrix, size_px, cv2.CV_32FC1)
        return cv2.remap(image, *maps, cv2.INTER_LANCZOS4)

    best = median(lanczos, repeat)
    places = _sources(camera)[..., ::-1].transpose(2, 0, 1)
    scipy_s = median(lambda: ndimage.map_coordinates(image.astype(np.float32), places, order=3, mode="mirror"), 1)
    results[f"undistort, {size_px[0] * size_px[1] / 1e6:.1f} Mpx, 16 bit [s]"] = ours
    results["  / cv2.undistort (linear, 1/32 px)"] = ours / linear
    results["  / cv2 maps + remap, Lanczos 8 x 8 (1/32 px)"] = ours / best
    results["  / scipy map_coordinates, same spline, map given"] = ours / scipy_s


def _error(results: dict[str, float]) -> None:
    import cv2

    camera = lens((960, 640))
    plain = corrected_camera(camera)
    pixels = np.stack(np.meshgrid(np.arange(960), np.arange(640)), axis=-1).astype(float)
    taken = _waves(plain.project(camera.unproject(pixels))[0]).astype(np.float32)
    truth, source = _waves(pixels), _sources(camera)
    inner = ((source > MARGIN_PX) & (source < np.array([960, 640]) - MARGIN_PX)).all(axis=-1)
    x, y = np.moveaxis(source.astype(np.float32), -1, 0)
    coefficients = np.array([camera.k1, camera.k2, camera.p1, camera.p2, camera.k3])
    pictures = {
        "windmark": undistort(taken, camera).image,
        "bilinear, exact places": ndimage.map_coordinates(taken, source[..., ::-1].transpose(2, 0, 1), order=1),
        "cv2.undistort": cv2.undistort(taken, camera.matrix, coefficients),
        "cv2.remap, cubic": cv2.remap(taken, x, y, cv2.INTER_CUBIC),
        "cv2.remap, Lanczos 8 x 8": cv2.remap(taken, x, y, cv2.INTER_LANCZOS4),
    }
    for name, picture in pictures.items():
        results[f"error of {name} [grey levels]"] = float(np.sqrt(np.mean((picture - truth)[inner] ** 2)))


def _sources(camera: Camera) -> np.ndarray:
    """Where each corrected pixel lies in the image as taken, (H, W, 2)."""
    width, height = camera.size_px
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(float)
    return camera.project(corrected_camera(camera).unproject(pixels))[0]


def _waves(xy: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(3)
    frequency, phase = rng.uniform(-0.25, 0.25, (40, 2)) * 2 * np.pi, rng.uniform(0, 2 * np.pi, 40)
    out = np.full(xy.shape[:2], 128.0)
    for (fx, fy), p in zip(frequency, phase, strict=True):
        out += 8 * np.cos(fx * xy[..., 0] + fy * xy[..., 1] + p)
    return out


if __name__ == "__main__":
    main()
