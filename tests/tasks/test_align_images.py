"""2D alignment as a whole: pictures in, the aligned picture out, or the reason why not."""

import numpy as np
import pytest

import windmark as wm
from windmark.geometry.planar import KINDS
from windmark.synth import disc_image
from windmark.tasks.align2d import still

SIZE = (520, 400)


def paint(xy):
    """Light of the surface, on which the markers lie, in the reference's pixels."""
    x, y = xy[..., 0], xy[..., 1]
    return 140 + 25 * np.sin(x / 37) * np.cos(y / 29) + 0.05 * x


def shot(place, *, seed=0, size=SIZE, markers=None, radius=4.0, noise=0.5, polarity="dark"):
    """Picture of a flat model whose point u of the reference is seen at ``place(u)``: discs drawn, paint moved."""
    rng = np.random.default_rng(seed + 99)
    at = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).astype(float)
    u = at.copy()
    for _ in range(25):  # where each pixel comes from
        u = u + (at - place(u.reshape(-1, 2)).reshape(u.shape))
    image = paint(u)
    half = 12
    for xy in place(np.asarray(markers)):
        first = np.rint(xy).astype(int) - half
        if min(*first, *(np.array(size) - first - 2 * half - 1)) < 0:
            continue
        disc = disc_image((2 * half + 1,) * 2, xy - first, (radius, radius), 0.0, level=1.0, depth=0.7, blur_px=0.7)
        part = image[first[1] : first[1] + 2 * half + 1, first[0] : first[0] + 2 * half + 1]
        part *= disc if polarity == "dark" else 2.0 - disc
    return image + rng.normal(0, noise, image.shape)


def layout(seed=0, count=24, size=SIZE):
    """Markers at least 36 px apart."""
    rng = np.random.default_rng(seed)
    chosen: list[np.ndarray] = []
    while len(chosen) < count:
        p = rng.uniform(30, np.array(size) - 30)
        if all(np.hypot(*(p - q)) > 36 for q in chosen):
            chosen.append(p)
    return np.array(chosen)


def still_place(u):
    return u


def bent(u):
    return u @ [[0.998, 0.02], [-0.02, 1.001]] + [14.0, -6.0] + 4 * ((u[:, 1:] - 200) / 200) ** 2 * [0.1, 1.0]


@pytest.fixture(scope="module")
def pictures():
    markers = layout()
    return shot(still_place, markers=markers), shot(bent, seed=1, markers=markers), markers


def test_the_model_is_put_back_where_the_reference_has_it(pictures):
    reference, image, markers = pictures
    answer = wm.align_images(image, reference, radius_px=4)
    assert isinstance(answer, wm.ImageAlignment), answer.reason
    assert len(answer.pairs) > 0.9 * len(markers)
    assert answer.kind in ("poly2", "spline")
    assert answer.held_out_px < 0.1
    truth = bent(answer.reference_xy)
    assert np.hypot(*(answer.transform.apply(answer.reference_xy) - truth).T).max() < 0.08
    inside = ~answer.extrapolated() & np.isfinite(answer.image)
    flat = np.ones(reference.shape, dtype=bool)  # away from the markers, whose rims no two pictures sample alike
    y, x = np.mgrid[: reference.shape[0], : reference.shape[1]]
    for m in markers:
        flat &= np.hypot(x - m[0], y - m[1]) > 9
    off = (answer.image - reference)[inside & flat]
    assert np.sqrt((off**2).mean()) < 1.0  # two times the camera's noise
    before = (image - reference)[inside & flat]
    assert np.sqrt((before**2).mean()) > 5


def test_the_result_says_where_it_extrapolates(pictures):
    reference, image, _ = pictures
    answer = wm.align_images(image, reference, radius_px=4)
    sigma, outside = answer.sigma_map(), answer.extrapolated()
    assert sigma.shape == outside.shape == reference.shape
    assert np.median(sigma[outside]) > np.median(sigma[~outside])
    x, y = answer.reference_xy[5]
    assert not outside[int(y), int(x)]
    assert sigma[200, 250] == pytest.approx(float(answer.transform.sigma_px([250.0, 200.0])), rel=0.1)
    assert outside[0, 0]


def test_identical_pictures_are_aligned_by_nothing(pictures):
    reference, _, _ = pictures
    answer = wm.align_images(reference, reference, radius_px=4)
    assert answer.kind == "similarity"
    assert answer.held_out_px < 1e-6
    assert np.nanmax(np.abs(answer.image - reference.astype(np.float32))) < 1e-2


def test_a_picture_of_another_size_is_put_on_the_references_size(pictures):
    reference, _, markers = pictures
    image = shot(lambda u: u + np.array([60.0, 40.0]), seed=3, size=(640, 480), markers=markers)
    answer = wm.align_images(image, reference, radius_px=4)
    assert answer.image.shape == reference.shape
    assert np.abs(answer.shift_px - [60, 40]).max() < 0.1


def test_bright_markers_of_an_infrared_camera():
    markers = layout(4)
    reference, image = (
        shot(place, seed=k, markers=markers, polarity="bright") for k, place in enumerate((still_place, bent))
    )
    answer = wm.align_images(image, reference, radius_px=4, polarity="bright")
    assert answer, answer.reason
    assert answer.held_out_px < 0.15


def test_an_unknown_radius_is_estimated_in_each_picture():
    markers = layout(5, 16)
    reference = shot(still_place, markers=markers)
    image = shot(lambda u: 1.25 * (u - 200) + 240, seed=2, size=(700, 540), markers=markers, radius=5.0)
    answer = wm.align_images(image, reference)
    assert answer, answer.reason
    assert np.sqrt(np.linalg.det(answer.transform.jacobian([200.0, 200.0]))) == pytest.approx(1.25, abs=1e-3)


@pytest.mark.parametrize("bad", [np.full((400, 520), 7.0), np.full((400, 520), np.nan)])
def test_a_picture_without_markers_is_said(pictures, bad):
    answer = wm.align_images(bad, pictures[0], radius_px=4)
    assert not answer
    assert answer.cause == "no_spots"
    assert "no marker in the image" in answer.reason


def spots(xy, sigma=0.03):
    return wm.Detections.make(xy, sigma_px=sigma)


BLANK = np.zeros((1000, 1000), dtype=np.float32)


def given(a, b, **options):
    return wm.align_images(BLANK, BLANK, detections=spots(b), reference_detections=spots(a), **options)


def test_pairs_by_name_need_no_constellation():
    grid = np.stack(np.meshgrid(np.arange(5), np.arange(4)), axis=-1).reshape(-1, 2) * 100.0
    moved = grid + np.array([100.0, 0.0])
    assert given(grid, moved).cause == "ambiguous"
    answer = given(grid, moved, pairs=np.stack([np.arange(20)] * 2, axis=1))
    assert answer
    assert np.isnan(answer.log10_nfa)
    assert np.allclose(answer.shift_px, [100, 0])


def test_a_wrong_name_is_rejected_and_said():
    rng = np.random.default_rng(1)
    x = rng.uniform(0, 1000, (20, 2))
    y = x + np.array([30.0, 5.0]) + rng.normal(0, 0.03, x.shape)
    pairs = np.stack([np.arange(20)] * 2, axis=1)
    pairs[[3, 11], 1] = pairs[[11, 3], 1]
    answer = given(x, y, pairs=pairs)
    assert sorted(answer.rejected[:, 0]) == [3, 11]
    assert answer.held_out_px < 0.15


def test_markers_on_the_walls_stand_still_and_take_no_part():
    rng = np.random.default_rng(2)
    x = rng.uniform([300, 100], [700, 900], (25, 2))
    wall = rng.uniform(0, 250, (8, 2))
    y = x + np.array([3.0, -1.0]) + 1e-5 * (x - 500) ** 2 + rng.normal(0, 0.02, x.shape)
    a, b = np.vstack([x, wall]), np.vstack([y, wall + rng.normal(0, 0.02, wall.shape)])
    answer = given(a, b)
    assert sorted(answer.still[:, 0]) == list(range(25, 33))
    assert answer.held_out_px < 0.1
    kept = given(a, b, keep_still=True)
    assert not len(kept.still)
    assert kept.held_out_px > 3 * answer.held_out_px


def test_a_marker_on_the_axis_of_the_rotation_does_not_count_as_standing_still():
    rng = np.random.default_rng(3)
    x = np.vstack([rng.uniform(0, 1000, (25, 2)), [[500.0, 500.0]]])
    t = np.radians(2)
    y = (x - 500) @ [[np.cos(t), np.sin(t)], [-np.sin(t), np.cos(t)]] + 500
    noise = np.tile(0.02**2 * np.eye(2), (26, 1, 1))
    assert not still.standing_still(x, y, noise, noise).any()


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_can_be_asked_for(kind):
    x = np.random.default_rng(4).uniform(0, 1000, (40, 2))
    answer = given(x, 1.01 * x + np.array([5.0, 3.0]), kind=kind)
    assert answer.kind == kind
    assert np.allclose(answer.transform.apply([[400.0, 300.0]]), [[409.0, 306.0]], atol=1e-3)


def test_a_kind_that_the_markers_do_not_determine_is_refused_with_the_reason():
    x = np.random.default_rng(5).uniform(0, 1000, (7, 2))
    answer = given(x, x + 20.0, kind="poly3")
    assert not answer
    assert answer.cause == "undetermined"
    assert "poly3 needs at least 13 pairs of markers, there are 7" in answer.reason
    along = np.sort(np.random.default_rng(8).uniform(0, 900, 12))
    line = np.column_stack([along, 0.5 * along])
    answer = given(line, line + 20.0, kind="affine", max_shift_px=40)
    assert "off that line are needed" in answer.reason


def test_three_named_markers_bear_a_similarity():
    x = np.array([[100.0, 100.0], [700.0, 160.0], [300.0, 600.0]])
    answer = given(x, x + np.array([40.0, 10.0]), pairs=np.stack([np.arange(3)] * 2, axis=1))
    assert answer.kind == "similarity"
    assert given(x[:2], x[:2], pairs=np.array([[0, 0], [1, 1]])).cause == "undetermined"


def test_the_fold_of_a_polynomial_far_from_the_markers_shows_nothing():
    rng = np.random.default_rng(6)
    x = rng.uniform(400, 600, (40, 2))
    y = x + 1.2e-3 * (x[:, :1] - 500) ** 2 * [1.0, 0.0]
    image = np.tile(np.arange(1000, dtype=np.float32), (1000, 1))
    answer = wm.align_images(image, BLANK, detections=spots(y), reference_detections=spots(x), kind="poly2")
    fold = 500 - 1 / (2 * 1.2e-3)
    assert np.isnan(answer.image[500, : int(fold) - 40]).all()
    assert np.isfinite(answer.image[500, 400:600]).all()


def test_wrong_usage_is_said(pictures):
    reference = pictures[0]
    with pytest.raises(ValueError, match="kind must be auto, similarity"):
        wm.align_images(reference, reference, kind="rigid")
    with pytest.raises(ValueError, match="max_shift_px must be > 0"):
        wm.align_images(reference, reference, max_shift_px=0)
    with pytest.raises(ValueError, match=r"reference must be \(H, W\)"):
        wm.align_images(reference, np.zeros(4))
    with pytest.raises(ValueError, match="expected detections"):
        wm.align_images(np.zeros((9, 9, 3)), reference)
    x = np.random.default_rng(7).uniform(0, 900, (9, 2))
    with pytest.raises(ValueError, match="whole numbers"):
        given(x, x, pairs=np.zeros((3, 2)))
    with pytest.raises(ValueError, match="only once"):
        given(x, x, pairs=np.zeros((3, 2), int))
    with pytest.raises(ValueError, match="numbers of spots, 0 to 8"):
        given(x, x, pairs=np.array([[0, 9]]))


def test_saturated_pixels_have_no_value_in_the_aligned_picture():
    markers = layout()
    first, second = (shot(p, markers=markers, noise=1.0, seed=k) for k, p in enumerate((still_place, bent)))
    clipped = np.clip(np.rint(second), 0, 165).astype(np.uint8)
    share = (clipped == 165).mean()
    assert 0.02 < share < 0.3
    answer = wm.align_images(clipped, np.rint(first).astype(np.uint8), radius_px=4.0)
    whole = wm.align_images(np.rint(second).astype(np.uint8), np.rint(first).astype(np.uint8), radius_px=4.0)
    lost = np.isnan(answer.image) & np.isfinite(whole.image)
    assert share < lost.mean() < 3 * share
    known = np.isfinite(answer.image) & np.isfinite(whole.image)
    assert np.abs(answer.image - whole.image)[known].max() < 6.0
