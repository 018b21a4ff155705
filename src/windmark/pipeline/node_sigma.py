"""How sure the values on nodes are: noise of the picture and the pose that it was mapped with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.errors import DataError
from windmark.pipeline.merge import picture_of
from windmark.pipeline.results import ImageResult
from windmark.resection.noise import noise_law
from windmark.resection.sources import prepare, value_variance
from windmark.scene import Mesh

SAMPLE = 200_000
"""Pixels that tell the noise to 1 %, a part of those that others look at: a report may have hundreds of pictures."""


def node_sigma(item: ImageResult, mesh: Mesh, interpolation: str) -> NDArray[np.float64]:
    """(V,) 1 sigma of the values that an image gave the nodes, as `resection.sample_points` has it of points.

    The noise is estimated from the picture. NaN where there is no value.

    Raises
    ------
    ValueError
        When the image has no values on nodes.
    """
    if item.nodes is None or item.values is None:
        raise DataError(f"node_sigma: {item.name} has no values on nodes")
    assert item.image is not None
    noise = noise_law(item.quantity.of(item.image), most=SAMPLE)
    source = prepare(picture_of(item, noise), None, interpolation, "node_sigma")
    variance = value_variance(source, item.nodes, mesh.vertices, item.values.astype(float))
    return np.asarray(np.sqrt(variance))
