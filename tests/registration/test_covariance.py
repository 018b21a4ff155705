"""The covariance that `register` reports is the scatter of its poses, neither smaller nor larger."""

from dataclasses import replace

import numpy as np
import pytest
from registration_scenes import scene, whitened_error

from windmark.registration import register

CELLS = (("A", 0.25, 0.5, 40), ("A", 0.5, 1.0, 16), ("B", 0.0, 0.0, 16), ("B", 0.5, 1.0, 24), ("C", 0.5, 1.0, 4))
"""Kind, hidden, false spots, and how many images."""


@pytest.mark.slow
@pytest.mark.parametrize("free_focal", [False, True])
def test_errors_are_as_large_as_the_covariance_says(free_focal):
    """All parameters whitened, 100 images: standard deviation 0.92 to 1.08, by chance to 0.03."""
    z = []
    for kind, hidden, false, count in CELLS:
        for seed in range(count):
            image = scene(52_000 + seed, kind, hidden=hidden, false=false)
            off = np.exp(np.random.default_rng(seed).uniform(-0.2, 0.2)) if free_focal else 1.0
            given = replace(image.camera, focal_px=off * image.camera.focal_px)
            found = register(image.detections, image.markers, given, free_focal=free_focal, max_time_s=30.0)
            if found:
                z.append(whitened_error(found, image))
            else:  # flat markers seen frontally
                assert free_focal
                assert found.cause in ("focal", "ambiguous", "weak")
    assert len(z) > 80
    assert 0.92 < np.sqrt(np.mean(np.square(z))) < 1.08
    assert (np.sqrt(np.mean(np.square(z), axis=0)) < 1.25).all()


def test_table_errors_widen_the_covariance():
    image = scene(7, "B")
    rng = np.random.default_rng(0)
    plain = register(image.detections, image.markers, image.camera)
    moved = replace(image.markers, xyz=image.markers.xyz + rng.normal(0, 0.002, image.markers.xyz.shape))
    wide = register(image.detections, moved, image.camera)
    assert plain
    assert wide
    assert plain.excess_px < 0.15
    assert wide.excess_px > 3 * plain.excess_px
    assert np.trace(wide.cov) > 4 * np.trace(plain.cov)
