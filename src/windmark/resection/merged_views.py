"""What merging several pictures gives: the values, how each picture counts, and how to ask for more points.

Each picture's part is recomputed where it is asked for, with the weights and gains that the nodes have told.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.geometry.described import described
from windmark.resection.gains import Gains
from windmark.resection.nearest import SurfacePoints
from windmark.resection.pixelmap import PixelMap
from windmark.resection.seams import Seams
from windmark.resection.sources import Prepared, Taken, take
from windmark.resection.steps import step_variance
from windmark.resection.surface_view import see_surface
from windmark.resection.virtual import see_pixels
from windmark.resection.visibility import NodeView
from windmark.scene import Mesh
from windmark.scene.shown import xarray_dataset

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MergedValues:
    """Merged values at N points, or at the pixels (H, W) of a view.

    Parameters
    ----------
    value : float64, in the reference picture's grey levels less ``black``; NaN where no picture sees the point
    sigma : its standard deviation: noise, poses, gains, and the pictures' systematic difference
    source : int8, the picture that counts most; -1 for none
    pictures : int8, how many pictures have a value there
    """

    value: Array
    sigma: Array
    source: NDArray[np.int8]
    pictures: NDArray[np.int8]


@described(lambda m: {
    "pictures": ", ".join(m.names), "nodes": len(m.nodes.value), "with value": int(np.isfinite(m.nodes.value).sum()),
    "left out": ", ".join(m.left_out) or "none",
})  # fmt: skip
@dataclass(frozen=True, eq=False)
class MergedViews:
    """Pictures merged on a surface.

    Parameters
    ----------
    mesh : the surface
    names : of the C pictures that take part; ``nodes.source`` counts in them
    nodes : of every node the value with its sigma, the source and the number of pictures
    views : (C) where each picture sees the nodes and why not
    values, sigmas : (C, V) of every picture by itself, gains applied; NaN where it has none
    gains : relative gains
    seams : steps where one picture takes over from another
    well : (C, V) nodes that a picture sees well enough to be compared with others
    left_out : pictures that do not take part, with the reason

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> plate = wm.Mesh.make([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> camera, grey = wm.Camera((64, 48), 60.0), np.ones((48, 64))
    >>> left, right = (wm.Pose.look_at([x, 0.0, 4.0], [x, 0.0, 0.0], [0.0, 1.0, 0.0]) for x in (-1.4, 1.4))
    >>> pictures = [wm.Picture("left", 5 * grey, camera, left), wm.Picture("right", 7 * grey, camera, right)]
    >>> merged = wm.merge_views(plate, pictures, gain="none")
    >>> merged.names, merged.nodes.source.tolist(), merged.nodes.value.tolist()
    (('left', 'right'), [0, 1, 1, 0], [5.0, 7.0, 7.0, 5.0])
    """

    mesh: Mesh
    names: tuple[str, ...]
    nodes: MergedValues
    views: tuple[NodeView, ...]
    values: Array
    sigmas: Array
    gains: Gains
    seams: Seams
    well: NDArray[np.bool_]
    left_out: Mapping[str, str]
    options: Mapping[str, Any] = field(default_factory=dict)
    _sources: tuple[Prepared, ...] = field(default=(), repr=False)

    def __bool__(self) -> bool:
        return True

    def to_xarray(self) -> Any:
        """An ``xarray.Dataset``: merged values by node, which picture counts most, and every picture's own values."""
        merged = {k: (("node",), getattr(self.nodes, k), "") for k in ("value", "sigma", "source", "pictures")}
        own = {"values": (("picture", "node"), self.values, ""), "sigmas": (("picture", "node"), self.sigmas, "")}
        return xarray_dataset({**merged, **own}, {"picture": list(self.names)})

    def step_variances(self) -> Array:
        """(C, V) of `values`, beside steps of the picture (`steps.step_variance`): to compare pictures with."""
        own = [step_variance(s, v) for s, v in zip(self._sources, self.views, strict=True)]
        return np.stack(own) / self.gains.gain[:, None] ** 2

    def at(self, points: SurfacePoints) -> tuple[MergedValues, tuple[NodeView, ...]]:
        """Merged values at points of the surface, with the same weights and gains, and how each picture sees them."""
        views = tuple(
            see_surface(self.mesh, points, s.picture.camera, s.picture.cam_from_model,
                        max_obliquity_deg=self.options["max_obliquity_deg"])
            for s in self._sources
        )  # fmt: skip
        return self._merged(views, points.xyz, points.normal), views

    def image(self, pixel_map: PixelMap) -> MergedValues:
        """The merged picture from any point of view: all pictures looked up at each virtual pixel's surface point."""
        on = pixel_map.valid
        xyz = pixel_map.xyz()[on]
        normal = self.mesh.triangle_normals()[pixel_map.triangle[on]]
        normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        views = tuple(
            see_pixels(pixel_map, s.picture.camera, s.picture.cam_from_model,
                       max_obliquity_deg=self.options["max_obliquity_deg"])
            for s in self._sources
        )  # fmt: skip
        flat = self._merged(views, xyz, normal)
        out = MergedValues(
            np.full(on.shape, np.nan), np.full(on.shape, np.nan), np.full(on.shape, -1, np.int8),
            np.zeros(on.shape, np.int8),
        )  # fmt: skip
        for name in ("value", "sigma", "source", "pictures"):
            getattr(out, name)[on] = getattr(flat, name)
        return out

    def _merged(self, views: Sequence[NodeView], xyz: Array, normal: Array) -> MergedValues:
        taken = [take_values(s, v, xyz, normal, self.options) for s, v in zip(self._sources, views, strict=True)]
        return combined_values(*stacked_values(taken), self.gains)[0]


@dataclass(frozen=True)
class NotMerged:
    """There is nothing to merge. Falsy.

    Parameters
    ----------
    reason : why, in words for the user
    left_out : single pictures with their reasons

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> plate = wm.Mesh.make([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> above = wm.Pose.look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    >>> picture = wm.Picture("cam1", np.full((48, 64), 5.0), wm.Camera((64, 48), 60.0), above)
    >>> answer = wm.merge_views(plate, [picture])
    >>> bool(answer)
    False
    >>> answer.reason
    'merging needs two pictures, only cam1 shows the surface'
    """

    reason: str
    left_out: Mapping[str, str] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return False


def take_values(source: Prepared, view: NodeView, xyz: Array, normal: Array, options: Mapping[str, Any]) -> Taken:
    """What a picture says at points (N, 3) with normals (N, 3), less its black level."""
    taken = take(source, view, xyz, normal, max_obliquity_deg=options["max_obliquity_deg"],
                 taper_deg=options["taper_deg"], taper_px=options["taper_px"])  # fmt: skip
    return Taken(taken.value - options["black"], taken.variance, taken.weight, taken.taper)


def stacked_values(taken: Sequence[Taken]) -> tuple[Array, Array, Array]:
    """Values, variances and weights (C, N)."""
    return (np.stack([t.value for t in taken]), np.stack([t.variance for t in taken]),
            np.stack([t.weight for t in taken]))  # fmt: skip


def combined_values(value: Array, variance: Array, weight: Array, gains: Gains) -> tuple[MergedValues, Array, Array]:
    """The weighted mean, and every picture's own calibrated values and variances (C, N).

    A picture with gain g has noise of variance s^2 / g^2 after calibration, so its weight takes g^2.
    """
    g = gains.gain[:, None]
    own, own_variance = (value - gains.offset[:, None]) / g, variance / g**2
    seen = np.isfinite(own)
    w = np.where(seen, weight * g**2, 0.0)
    total = w.sum(axis=0)
    share = np.divide(w, total, out=np.zeros_like(w), where=total > 0)
    filled = np.where(seen, own, 0.0)
    mean = np.where(total > 0, (share * filled).sum(axis=0), np.nan)
    s = float(np.nan_to_num(gains.systematic))
    spread = (share**2 * np.where(seen, own_variance + (s * own) ** 2, 0.0)).sum(axis=0)
    by = np.concatenate([share * filled / g, share / g])
    spread += np.einsum("pn,pq,qn->n", by, gains.cov, by)
    source = np.where(total > 0, np.argmax(w, axis=0), -1).astype(np.int8)
    merged = MergedValues(mean, np.where(total > 0, np.sqrt(spread), np.nan), source, seen.sum(axis=0).astype(np.int8))
    return merged, own, own_variance
