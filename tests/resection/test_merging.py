"""Pictures of several cameras merged on the surface: values, gains, sigma by Monte-Carlo, seams, refusals."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from windmark.geometry import Camera
from windmark.resection import (
    MergedViews,
    NoiseLaw,
    NotMerged,
    Picture,
    map_pixels,
    merge_views,
    nearest_on_surface,
    see_nodes,
)
from windmark.resection.gains import overlap_gains

sys.path.insert(0, str(Path(__file__).parent))
from resection_shapes import box, joined, looking_at, moved, plate

CAMERA = Camera((320, 240), 420.0)
EYES = ((0.0, 0.3, 6.5), (3.0, 0.0, 6.0), (-3.5, 1.0, 5.5))
MESH = plate(50, 40)


def field(xyz):
    """What the surface shows: smooth, 900 to 1100."""
    return 1000 + 60 * np.sin(1.3 * xyz[..., 0]) + 40 * np.cos(1.7 * xyz[..., 1] + xyz[..., 0])


def picture(k, mesh=MESH, *, gain=1.0, offset=0.0, sigma=0.0, rng=None, eye=None, pose=None, **known):
    """A picture of `field` on a mesh by camera k; NaN beside the mesh."""
    pose = looking_at(EYES[k] if eye is None else eye, up=(0, 1, 0)) if pose is None else pose
    image = gain * field(map_pixels(mesh, CAMERA, pose).xyz()) + offset
    if rng is not None:
        image = image + gain * sigma * rng.normal(size=image.shape)
    known.setdefault("noise", gain * sigma)
    return Picture(f"cam{k + 1}", np.where(np.isfinite(image), image, offset + 300.0 * gain).astype(np.float32), CAMERA,
                   pose, **known)  # fmt: skip


def test_perfect_pictures_give_the_surface_back():
    merged = merge_views(MESH, [picture(k, gain=g) for k, g in enumerate((1.0, 3.0, 0.4))])
    assert isinstance(merged, MergedViews)
    inside = (np.abs(MESH.vertices[:, 0]) < 1.9) & (np.abs(MESH.vertices[:, 1]) < 1.4)
    assert np.abs(merged.nodes.value - field(MESH.vertices))[inside].max() < 0.05
    np.testing.assert_allclose(merged.gains.gain, [1.0, 3.0, 0.4], rtol=2e-5)
    assert merged.gains.systematic < 1e-4


def test_every_node_that_any_camera_sees_has_a_value():
    """Also nodes next to outlines, of one camera only, and of an oblique one."""
    mesh = joined(plate(30, 24), moved(box(4, (0.3, 0.3, 0.3)), 0.4, 0.2, 0.5))
    rng = np.random.default_rng(1)
    pictures = [picture(k, mesh, sigma=5, rng=rng) for k in range(3)]
    merged = merge_views(mesh, pictures)
    seen = np.any([see_nodes(mesh, p.camera, p.cam_from_model, max_obliquity_deg=80).visible for p in pictures], axis=0)
    assert seen.any()
    np.testing.assert_array_equal(np.isfinite(merged.nodes.value), seen)
    np.testing.assert_array_equal(merged.nodes.source >= 0, seen)
    np.testing.assert_array_equal(merged.nodes.pictures > 0, seen)
    assert np.isfinite(merged.nodes.sigma[seen]).all()


def test_merged_is_better_than_the_best_single_picture():
    rng = np.random.default_rng(2)
    merged = merge_views(MESH, [picture(k, sigma=20, rng=rng, gain=g) for k, g in enumerate((1.0, 0.5, 2.0))])
    truth = field(MESH.vertices)
    inside = (np.abs(MESH.vertices) < [1.9, 1.4, 1]).all(axis=1)  # the plate's very border is an outline for all
    all_see = np.isfinite(merged.values).all(axis=0) & inside
    single = [np.sqrt(np.mean((v - truth)[all_see] ** 2)) for v in merged.values]
    together = np.sqrt(np.mean((merged.nodes.value - truth)[all_see] ** 2))
    assert together < 0.75 * min(single)


@pytest.mark.slow
@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_sigma_of_nodes_by_monte_carlo(interpolation):
    """Scatter of the merged values over their sigma, noise and pose together: one, from both sides."""
    rng = np.random.default_rng(3)
    true = [looking_at(eye, up=(0, 1, 0)) for eye in EYES]
    cov = np.diag(np.array([1e-3, 1e-3, 2e-3, 4e-3, 4e-3, 1e-2]) ** 2)
    deviate = []
    for _ in range(20):
        wrong = [type(p).exp(rng.multivariate_normal(np.zeros(6), cov)) @ p for p in true]
        shown = [picture(k, pose=true[k], sigma=1.0, rng=rng) for k in range(3)]
        shown = [replace(p, cam_from_model=w, pose_cov=cov) for p, w in zip(shown, wrong, strict=True)]
        merged = merge_views(MESH, shown, gain="none", interpolation=interpolation)
        inside = (np.abs(MESH.vertices[:, 0]) < 1.7) & (np.abs(MESH.vertices[:, 1]) < 1.2)
        deviate.append(((merged.nodes.value - field(MESH.vertices)) / merged.nodes.sigma)[inside])
    assert 0.85 < np.sqrt(np.mean(np.square(deviate))) < 1.12


@pytest.mark.slow
def test_sigma_of_gains_by_monte_carlo():
    rng = np.random.default_rng(4)
    truth = rng.uniform(500, 1500, 400)
    gains = np.array([1.0, 3.0, 0.7])
    region = np.arange(400) // 20
    z, zo = [], []
    for _ in range(150):
        sigma = 30.0 * gains[:, None]
        value = gains[:, None] * truth + np.array([[0.0], [40.0], [-10.0]]) + sigma * rng.normal(size=(3, 400))
        found = overlap_gains(value, np.broadcast_to(sigma**2, value.shape), rng.random(value.shape) < 0.8, region,
                              reference=0, offset=True, estimate=True)  # fmt: skip
        z.append((found.gain - gains)[1:] / found.sigma[1:])
        zo.append((found.offset - [0, 40, -10])[1:] / found.offset_sigma[1:])
    for deviates in (z, zo):  # errors in all pictures: ordinary regression would be 10 sigma off
        assert np.abs(np.mean(deviates, axis=0)).max() < 0.35
        assert 0.75 < np.sqrt(np.mean(np.square(deviates))) < 1.15


def test_outlines_have_a_sigma_that_knows_of_the_mixed_pixels():
    """Nodes on the plate's very border are up to half background in every picture."""
    rng = np.random.default_rng(11)
    merged = merge_views(MESH, [picture(k, sigma=2, rng=rng) for k in range(3)])
    border = (np.abs(MESH.vertices) > [1.999, 1.499, 1]).any(axis=1)
    off = np.abs(merged.nodes.value - field(MESH.vertices))[border]
    assert np.median(off) > 30  # of a noise of 2
    assert np.median(off / merged.nodes.sigma[border]) < 3


def test_gain_stands_markers_that_differ():
    """A tenth of the surface shows something else in one picture: dirt, a glint."""
    rng = np.random.default_rng(5)
    truth = rng.uniform(900, 1100, 600)
    value = np.stack([truth, 2 * truth]) + rng.normal(size=(2, 600)) * [[10], [20]]
    value[1, :60] *= 0.2
    variance, use = np.full((2, 600), [[100.0], [400.0]]), np.ones((2, 600), bool)
    found = overlap_gains(value, variance, use, np.zeros(600, np.int64), reference=0, offset=False, estimate=True)
    assert abs(found.gain[1] - 2) < 0.006


def test_black_level_and_gain_belong_together():
    rng = np.random.default_rng(6)
    pictures = [picture(k, gain=g, offset=64, sigma=3, rng=rng) for k, g in enumerate((1.0, 3.0))]
    merged = merge_views(MESH, pictures, black=64)
    np.testing.assert_allclose(merged.gains.gain, [1, 3], rtol=1e-3)
    free = merge_views(MESH, [pictures[0], replace(pictures[1], image=pictures[1].image + 50)], black=64, offset=True)
    assert abs(free.gains.offset[1] - 50) < 4 * free.gains.offset_sigma[1]
    assert abs(free.gains.gain[1] - 3) < 4 * free.gains.sigma[1]
    assert free.gains.offset_sigma[1] < 10


def test_systematic_difference_is_found_and_in_sigma():
    """One camera sees the light fall off to one side by some percent: no gain explains it."""
    rng = np.random.default_rng(7)
    good, bad = (picture(k, sigma=2, rng=rng) for k in range(2))
    tilt = 1 + 0.06 * np.linspace(-1, 1, CAMERA.size_px[0])
    merged = merge_views(MESH, [good, replace(bad, image=bad.image * tilt)])
    assert 0.005 < merged.gains.systematic < 0.04
    both = merged.nodes.pictures == 2
    assert np.median(merged.nodes.sigma[both] / merged.nodes.value[both]) > 0.5 * merged.gains.systematic


def test_seams_have_steps_of_noise_only_and_no_jump():
    rng = np.random.default_rng(8)
    merged = merge_views(MESH, [picture(k, sigma=15, rng=rng, gain=g) for k, g in enumerate((1.0, 2.0, 0.5))])
    summary = merged.seams.summary()
    assert len(merged.seams) > 40
    assert 0.6 < summary["mean_size"] < 1.0
    assert 0.8 < summary["rms"] < 1.2
    wrong = merge_views(MESH, [picture(k, sigma=15, rng=rng, gain=g) for k, g in enumerate((1.0, 1.2))], gain="none")
    assert wrong.seams.summary()["mean_size"] > 4  # a gain that is not corrected shows
    # A gain error of 20 % fades over the taper: no edge of the grid takes a large part of it.
    smooth = merge_views(MESH, [picture(0), replace(picture(1), image=1.2 * picture(1).image)], gain="none")
    inner = (np.abs(MESH.vertices[:, 0]) < 1.8) & (np.abs(MESH.vertices[:, 1]) < 1.3)
    edge = MESH.triangles[:, :2][inner[MESH.triangles[:, :2]].all(axis=1)]
    jump = np.diff((smooth.nodes.value / field(MESH.vertices))[edge], axis=1)
    assert np.abs(jump).max() < 0.02


def test_weights_go_by_resolution_and_noise():
    """Twice the distance: a quarter of the pixels per area. Twice the noise: a quarter of the weight."""
    eyes = ((0.0, 0.0, 6.0), (0.01, 0.0, 12.0))
    far = [replace(picture(k, eye=eye), noise=10.0) for k, eye in enumerate(eyes)]
    merged = merge_views(MESH, far, gain="none", taper_px=1.0)
    middle = np.argmin(np.linalg.norm(MESH.vertices, axis=1))
    assert merged.nodes.source[middle] == 0
    noisy = merge_views(MESH, [replace(far[0], noise=40.0), far[1]], gain="none", taper_px=1.0)
    assert noisy.nodes.source[middle] == 1
    lifted = merge_views(MESH, [replace(far[0], image=far[0].image + 100), far[1]], gain="none", taper_px=1.0)
    share = (lifted.nodes.value[middle] - merged.nodes.value[middle]) / 100
    assert abs(share - 0.8) < 0.01  # 4 : 1


def test_merged_picture_from_one_point_of_view():
    merged = merge_views(MESH, [picture(k, gain=g) for k, g in enumerate((1.0, 3.0))])
    view = map_pixels(MESH, Camera((200, 150), 300.0), looking_at((0.2, -0.5, 7), up=(0, 1, 0)))
    shown = merged.image(view)
    assert shown.value.shape == (150, 200)
    np.testing.assert_array_equal(np.isfinite(shown.value), shown.source >= 0)
    assert not np.isfinite(shown.value[~view.valid]).any()
    off = np.abs(shown.value - field(view.xyz()))
    assert np.nanmedian(off) < 0.02


def test_points_are_merged_as_nodes_are():
    merged = merge_views(MESH, [picture(k, gain=g) for k, g in enumerate((1.0, 3.0))])
    inner = np.flatnonzero((np.abs(MESH.vertices) < [1.5, 1.1, 1]).all(axis=1))[::37]
    at, views = merged.at(nearest_on_surface(MESH, MESH.vertices[inner] + [0, 0, 1e-3]))
    np.testing.assert_allclose(at.value, merged.nodes.value[inner], rtol=1e-6)
    assert len(views) == 2


# --- attacks -------------------------------------------------------------------------------


def test_no_overlap_is_refused_with_its_way_out():
    left, right = moved(plate(20, 20, (1.8, 2.0)), -1.1, 0, 0), moved(plate(20, 20, (1.8, 2.0)), 1.1, 0, 0)
    both = joined(left, right)
    one = picture(0, both)
    half = np.where(np.arange(320) < 160, np.float32(1), np.float32(np.nan))
    pictures = [replace(one, image=one.image * half), replace(one, name="other", image=2 * one.image * half[::-1])]
    answer = merge_views(both, pictures)
    assert isinstance(answer, NotMerged)
    assert not answer
    assert "overlap" in answer.reason
    assert 'gain = "none"' in answer.reason
    assert isinstance(merge_views(both, pictures, gain="none"), MergedViews)


def test_a_camera_that_sees_nothing_is_left_out_and_named():
    backwards = looking_at((0, 0, 6), target=(0, 0, 12), up=(0, 1, 0))
    away = replace(picture(2), name="away", cam_from_model=backwards)
    merged = merge_views(MESH, [picture(0), picture(1), away])
    assert merged.names == ("cam1", "cam2")
    assert merged.left_out == {"away": "sees no node of the grid"}
    alone = merge_views(MESH, [picture(0), away])
    assert isinstance(alone, NotMerged)
    assert "only cam1" in alone.reason


def test_the_same_picture_twice_counts_once():
    merged = merge_views(MESH, [picture(0), replace(picture(0), name="copy"), picture(1)])
    assert "same picture as cam1" in merged.left_out["copy"]
    assert isinstance(merge_views(MESH, [picture(0), replace(picture(0), name="copy")]), NotMerged)


def test_missing_pixels_are_taken_from_the_other_camera():
    rng = np.random.default_rng(9)
    holed = picture(0, sigma=5, rng=rng)
    holed.image[80:140, 100:200] = np.nan
    merged = merge_views(MESH, [holed, picture(1, sigma=5, rng=rng)])
    lost = np.isnan(merged.values[0]) & np.isfinite(merged.values[1])
    assert lost.sum() > 50
    np.testing.assert_array_equal(merged.nodes.source[lost], 1)
    np.testing.assert_allclose(merged.nodes.value[lost], merged.values[1][lost])
    empty = replace(picture(2), image=np.full((240, 320), np.nan, np.float32), noise=1.0)
    assert merge_views(MESH, [picture(0), picture(1), empty]).left_out == {"cam3": "sees no node of the grid"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"gain": "auto"}, "gain must be one of"),
        ({"gain": "none", "offset": True}, "offset needs gain"),
        ({"reference": "cam9"}, "reference must be one of cam1"),
        ({"taper_px": 0.0}, "taper_deg and taper_px"),
        ({"max_obliquity_deg": 0.0}, "max_obliquity_deg"),
        ({"interpolation": "best"}, "interpolation must be one of"),
    ],
)
def test_wrong_options(options, message):
    with pytest.raises(ValueError, match=message):
        merge_views(MESH, [picture(0), picture(1)], **options)


def test_wrong_pictures():
    with pytest.raises(ValueError, match="names must differ"):
        merge_views(MESH, [picture(0), picture(0)])
    with pytest.raises(ValueError, match="1 to 127"):
        merge_views(MESH, [])
    with pytest.raises(ValueError, match="as its camera says"):
        merge_views(MESH, [replace(picture(0), image=np.zeros((10, 10), np.float32)), picture(1)])
    with pytest.raises(ValueError, match="noise must be"):
        merge_views(MESH, [replace(picture(0), noise=-1.0), picture(1)])
    with pytest.raises(ValueError, match="pose_cov must be"):
        merge_views(MESH, [replace(picture(0), pose_cov=np.eye(3)), picture(1)])


def test_reference_keeps_its_grey_levels():
    merged = merge_views(MESH, [picture(0), picture(1, gain=2.0)], reference="cam2")
    assert merged.options["reference"] == "cam2"
    np.testing.assert_allclose(merged.gains.gain, [0.5, 1.0], rtol=1e-4)
    middle = np.argmin(np.linalg.norm(MESH.vertices, axis=1))
    assert abs(merged.nodes.value[middle] - 2 * field(MESH.vertices[middle])) < 0.1


def test_noise_law_may_be_given_or_estimated():
    rng = np.random.default_rng(10)
    pictures = [picture(k, sigma=8, rng=rng) for k in range(2)]
    given = merge_views(MESH, [replace(p, noise=NoiseLaw(64.0, 0.0, 0.0)) for p in pictures])
    guessed = merge_views(MESH, [replace(p, noise=None) for p in pictures])
    every_pixel = merge_views(MESH, [replace(p, noise=np.full((240, 320), 8.0)) for p in pictures])
    both = given.nodes.pictures == 2
    assert 0.9 < np.median(guessed.nodes.sigma[both] / given.nodes.sigma[both]) < 1.1
    np.testing.assert_allclose(every_pixel.nodes.sigma[both], given.nodes.sigma[both], rtol=1e-6)
