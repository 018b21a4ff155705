"""The covariance that `register` reports is the scatter of its poses, neither smaller nor larger."""

import numpy as np
import pytest
from registration_scenes import scene

from windmark.registration import register


@pytest.mark.parametrize("kind", ["A", "B"])
def test_mahalanobis_distance_to_the_truth_is_chi_square(kind):
    """Mean of the squared distance over its six degrees of freedom, 60 scenes: 1 within four sigma of the mean."""
    squares = []
    for seed in range(60):
        image = scene(5000 + seed, kind)
        found = register(image.detections, image.markers, image.camera)
        assert found
        delta = (image.cam_from_model @ found.cam_from_model.inverse()).log()
        squares.append(delta @ np.linalg.solve(found.cov, delta) / 6)
    assert 0.72 < np.mean(squares) < 1.3


def test_table_errors_widen_the_covariance():
    image = scene(7, "B")
    rng = np.random.default_rng(0)
    plain = register(image.detections, image.markers, image.camera)
    from dataclasses import replace

    moved = replace(image.markers, xyz=image.markers.xyz + rng.normal(0, 0.002, image.markers.xyz.shape))
    wide = register(image.detections, moved, image.camera)
    assert plain
    assert wide
    assert plain.excess_px < 0.15
    assert wide.excess_px > 3 * plain.excess_px
    assert np.trace(wide.cov) > 4 * np.trace(plain.cov)
