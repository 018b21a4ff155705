"""Independent measures of discs in real images: thresholds, moments and a plain least-squares fit.

Nothing here uses windmark's detector: these centres are what it is compared with.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Blobs:
    """Connected regions: centre (of the binary region), area, roundness, does it touch the border, number of holes.

    Roundness is the area over that of the ellipse with the same second moments: a filled ellipse has 1, a square
    0.955, a triangle 0.827.
    """

    xy: Array
    area: Array
    roundness: Array
    elongation: Array
    border: NDArray[np.bool_]
    holes: NDArray[np.int64]

    def take(self, chosen: NDArray[np.bool_]) -> Blobs:
        return Blobs(*(getattr(self, n)[chosen] for n in self.__dataclass_fields__))


def blobs(mask: NDArray[np.bool_], min_area: float, max_area: float) -> Blobs:
    """Regions (8-connected, holes filled) of a binary image with an area between the limits."""
    from scipy.ndimage import binary_fill_holes, find_objects, label

    labels, _ = label(mask, structure=np.ones((3, 3)))
    rows = []
    for k, box in enumerate(find_objects(labels), start=1):
        inside = labels[box] == k
        if not min_area / 3 <= inside.sum() <= max_area:
            continue
        filled = binary_fill_holes(inside)
        area = float(filled.sum())
        if not min_area <= area <= max_area:
            continue
        y, x = np.nonzero(filled)
        cov = np.cov(np.stack([x, y]).astype(float), bias=True) + np.eye(2) / 12
        low, high = np.sqrt(np.linalg.eigvalsh(cov))
        cut = box[0].start == 0 or box[1].start == 0 or box[0].stop == mask.shape[0] or box[1].stop == mask.shape[1]
        holes = label(filled & ~inside)[1]
        rows.append(
            (
                x.mean() + box[1].start,
                y.mean() + box[0].start,
                area,
                area / (4 * np.pi * low * high),
                high / low,
                cut,
                holes,
            )
        )
    table = np.array(rows, dtype=float).reshape(-1, 7)
    return Blobs(
        table[:, :2], table[:, 2], table[:, 3], table[:, 4], table[:, 5].astype(bool), table[:, 6].astype(np.int64)
    )


def soft_centroid(image: NDArray, xy: Array, radius_px: float, polarity: str) -> Array:
    """Centroid of a disc, each pixel weighted by how far its level is from the surface (0 up to 25 %, 1 from 75 %).

    The surface is a plane through the ring between 1.4 and 2 radii, the disc's level the median of its core. NaN where
    the ring is outside the image.
    """
    sign = 1.0 if polarity == "dark" else -1.0
    for _ in range(3):
        half = int(np.ceil(2 * radius_px)) + 1
        x0, y0 = np.rint(xy).astype(int) - half
        x1, y1 = x0 + 2 * half + 1, y0 + 2 * half + 1
        x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, image.shape[1]), min(y1, image.shape[0])
        if x1 - x0 < half or y1 - y0 < half:
            return np.full(2, np.nan)
        patch = image[y0:y1, x0:x1].astype(float)
        y, x = np.mgrid[y0:y1, x0:x1] - xy[::-1, None, None]
        r = np.hypot(x, y)
        ring, core = (r > 1.4 * radius_px) & (r < 2 * radius_px), r < 0.6 * radius_px
        ring &= np.abs(patch - np.median(patch[ring])) < 3 * np.median(np.abs(patch[ring] - np.median(patch[ring]))) + 2
        design = np.column_stack([np.ones(ring.sum()), x[ring], y[ring]])
        plane = np.linalg.lstsq(design, patch[ring], rcond=None)[0]
        drop = sign * (plane[0] + plane[1] * x + plane[2] * y - patch)
        weight = np.clip((drop / np.median(drop[core]) - 0.25) / 0.5, 0, 1) * (r < 1.4 * radius_px)
        if weight.sum() <= 0:
            return np.full(2, np.nan)
        xy = xy + np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()
    return xy


def fit_disc(image: NDArray, xy: Array, radius_px: float) -> tuple[Array, Array]:
    """Least-squares fit of a dark ellipse on paint, I = (plane) (1 - c edge), edge a normal distribution function.

    By `scipy.optimize.least_squares` with a soft L1 loss, 5 x 5 sub-pixels, numerical derivatives. Returns the centre
    and the half axes.
    """
    from scipy.optimize import least_squares
    from scipy.special import ndtr

    half = int(np.ceil(2 * radius_px + 3))
    x0, y0 = np.rint(xy).astype(int) - half
    patch = image[max(y0, 0) : y0 + 2 * half + 1, max(x0, 0) : x0 + 2 * half + 1].astype(float)
    sub = (np.arange(5) + 0.5) / 5 - 0.5
    ys = (np.arange(patch.shape[0])[:, None] + sub).ravel()[:, None] + max(y0, 0) - xy[1]
    xs = (np.arange(patch.shape[1])[:, None] + sub).ravel()[None] + max(x0, 0) - xy[0]

    def model(p: Array) -> Array:
        dx, dy = xs - p[0], ys - p[1]
        # The ellipse is dx' M dx = 1; the distance to it is (rho - 1) / |grad rho|.
        gx, gy = p[2] * dx + p[3] * dy, p[3] * dx + p[4] * dy
        rho = np.sqrt(np.maximum(gx * dx + gy * dy, 1e-9))
        distance = (rho - 1) * rho / np.hypot(gx, gy).clip(1e-9)
        light = p[5] + p[6] * xs + p[7] * ys
        fine = light * (1 - p[8] * ndtr(-distance / abs(p[9])))
        return fine.reshape(patch.shape[0], 5, patch.shape[1], 5).mean(axis=(1, 3))

    level, low = np.percentile(patch, [60, 1])
    start = np.array([0, 0, radius_px**-2, 0, radius_px**-2, level, 0, 0, 1 - low / level, 0.7])
    scale = max(1.4826 * float(np.median(np.abs(patch - level))), 1.0)
    fit = least_squares(
        lambda p: ((model(p) - patch) / scale).ravel(), start, loss="soft_l1", f_scale=3.0, x_scale=np.abs(start) + 0.05
    )
    m = fit.x
    return xy + m[:2], 1 / np.sqrt(np.linalg.eigvalsh([[m[2], m[3]], [m[3], m[4]]]))


def label_lattice(xy: Array) -> NDArray[np.int64]:
    """Column and row of every point of a (perspective) lattice, from the middle outwards; (-9999, -9999) if not on it.

    Steps are predicted from the neighbours already labelled, so perspective and lens distortion may bend the lattice.
    """
    from scipy.spatial import cKDTree

    index = np.full((len(xy), 2), -9999)
    tree = cKDTree(xy)
    first = int(tree.query(xy.mean(axis=0))[1])
    around = xy[tree.query(xy[first], k=5)[1][1:]] - xy[first]
    u = around[np.argmax(np.abs(around[:, 0]))]
    v = around[np.argmax(np.abs(around @ np.array([-u[1], u[0]])))]
    u, v = u * np.sign(u[0]), v * np.sign(v[1])
    index[first], steps, queue = 0, {first: (u, v)}, [first]
    while queue:
        k = queue.pop(0)
        for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
            step = sign * steps[k][axis]
            distance, j = tree.query(xy[k] + step)
            if distance < 0.25 * np.hypot(*step) and index[j, 0] == -9999:
                index[j] = index[k] + sign * np.eye(2, dtype=np.int64)[axis]
                new = list(steps[k])
                new[axis] = sign * (xy[j] - xy[k])
                steps[j] = (new[0], new[1])
                queue.append(j)
    return index
