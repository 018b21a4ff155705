"""The paint's texture belongs to a marker's place: shared by all cameras, and taken off the spots' own covariance."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.deformation import Volumes, identify
from windmark.detection.template.noise import FrameNoise
from windmark.detection.template.result import Frame
from windmark.geometry import Camera, Pose
from windmark.pipeline.deform import DeformationTest, Station
from windmark.scene import MarkerSet, Observations, View
from windmark.tasks.deform.spots import Labelled
from windmark.tasks.deform.texture import texture_of, without_texture
from windmark.tasks.predictions import Known

CAMERA = Camera((800, 600), 1000.0)
POSES = {
    n: Pose.look_at(1000 * np.array([np.sin(a), 0.0, np.cos(a)]), np.zeros(3), [0.0, 1.0, 0.0])
    for n, a in (("left", -0.5), ("right", 0.5))
}
SHARE, SIGMA = 0.6, 0.05


def markers(count=12, normals=True, sigma=np.nan):
    xyz = np.random.default_rng(2).uniform(-150, 150, (count, 3)) * [1, 1, 0.1]
    normal = np.tile([0.0, 0.0, 1.0] if normals else [np.nan] * 3, (count, 1))
    return MarkerSet.make(
        [f"m{k}" for k in range(count)], xyz, radius=3.0, normal=normal, sigma=np.full((count, 3), sigma)
    )


def setup(table, **more):
    return DeformationTest(tuple(Station(n, CAMERA, p) for n, p in POSES.items()), table, Volumes.of([]), **more)


def labelled(table, share=SHARE):
    noise = replace(FrameNoise.white(1.0), texture=share)
    out = {}
    for name, pose in POSES.items():
        xy, n = CAMERA.project(pose.apply(table.xyz))[0], len(table)
        out[name] = Labelled(
            np.arange(n), xy, np.tile(SIGMA**2 * np.eye(2), (n, 1, 1)), np.full((n, 2), 3.0), np.zeros(n),
            np.full((n, 3), np.nan), n, Known(Frame(0.6, 0.0, noise), np.full((n, 2, 2), np.nan)),
        )  # fmt: skip
    return out


def state_of(table, spots):
    n = len(table)
    seen = Observations(
        np.repeat([0, 1], n), np.tile(np.arange(n), 2), *(np.concatenate([getattr(s, c) for s in spots.values()])
                                                           for c in ("xy", "cov"))
    )  # fmt: skip
    views = [View(name, name, "", pose) for name, pose in POSES.items()]
    return identify(seen, table, [], dict.fromkeys(POSES, CAMERA), views)


def test_noise_and_texture_together_are_the_spots_covariance():
    table = markers()
    spots, test = labelled(table), setup(table)
    texture = texture_of(spots, state_of(table, spots), test)
    assert texture.known.all()
    for name, pose in POSES.items():
        left = without_texture(spots[name], test, texture)
        assert left == pytest.approx((1 - SHARE) * spots[name].cov)
        j = CAMERA.project_jacobian(pose.apply(table.xyz))[2] @ pose.rotation
        whole = left + j @ texture.place_cov @ np.swapaxes(j, 1, 2)
        # The two cameras see a place from two sides; each gets its own back but for their distances.
        assert np.diagonal(whole, axis1=1, axis2=2) == pytest.approx(SIGMA**2, rel=0.25)
    assert texture.place_cov[:, 2] == pytest.approx(0.0, abs=1e-12)  # in the tangent plane


def test_the_tables_own_sigma_is_added():
    table = markers(sigma=0.02)
    spots = labelled(table)
    texture = texture_of(spots, state_of(table, spots), setup(table))
    assert texture.place_cov[:, 2, 2] == pytest.approx(0.02**2)


def test_without_normals_or_texture_nothing_is_split():
    table = markers(normals=False)
    spots = labelled(table)
    texture = texture_of(spots, state_of(table, spots), setup(table))
    assert not texture.known.any()
    assert without_texture(spots["left"], setup(table), texture) == pytest.approx(spots["left"].cov)
    plain = labelled(markers(), share=0.0)
    assert texture_of(plain, state_of(markers(), plain), setup(markers())) is None
    assert without_texture(plain["left"], setup(markers()), None) is plain["left"].cov


def test_places_from_wind_off_images_hold_it_already():
    table = markers()
    spots = labelled(table)
    test = setup(table, marker_cov=np.tile(1e-6 * np.eye(3), (len(table), 1, 1)))
    assert without_texture(spots["left"], test, None) == pytest.approx((1 - SHARE) * spots["left"].cov)
