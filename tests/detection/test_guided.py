"""`detect_at`: markers near predictions, what is decided about each, and the search's kernels beside slow twins."""

import numpy as np
import pytest

import windmark as wm
from windmark.detection import ANSWERS
from windmark.detection.guided_judge import CHANCE, FOUND, LOST, OTHER, SAME, UNSEEN
from windmark.detection.template.crlb import centre_bound
from windmark.detection.template.disc_model import patch_model, shape_matrix
from windmark.detection.template.request import Scene

BLUR = 0.7


def draw_at(image, xy, axes, angle=0.0, *, contrast=0.6, blur=BLUR):
    """Multiply exact markers into an image of light."""
    shape = shape_matrix(axes, angle)
    for x, y in xy:
        cols, rows = np.arange(int(x) - 14, int(x) + 15), np.arange(int(y) - 14, int(y) + 15)
        params = [x, y, shape[0, 0], shape[0, 1], shape[1, 1], blur, contrast, 1.0, 0.0, 0.0]
        image[np.ix_(rows, cols)] *= patch_model(cols, rows, params)[0]


def field(seed=0, axes=(3.0, 3.0), angle=0.0, *, contrast=0.6, noise=2.0, light=120.0, side=6, there=None):
    """Side x side markers, 44 px apart: image and centres; only those of the mask `there` are drawn."""
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.arange(side), np.arange(side)), -1).reshape(-1, 2)
    xy = 30.0 + 44.0 * grid + rng.uniform(-4, 4, grid.shape)
    image = np.full((44 * side + 16, 44 * side + 16), light)
    draw_at(image, xy if there is None else xy[there], axes, angle, contrast=contrast)
    return image + rng.normal(0, noise, image.shape), xy, rng


def test_finds_all_in_their_order_at_the_bound():
    """Prediction +-2.5 px off: all found, RMS per axis near the Cramer-Rao bound, covariance right."""
    errors, scaled = [], []
    for seed in range(6):
        image, xy, rng = field(seed)
        got = wm.detect_at(image, xy + rng.uniform(-2.5, 2.5, xy.shape), radius_px=3.0, blur_px=BLUR)
        assert got.found.all()
        errors.append(got.xy - xy)
        scaled.append((got.xy - xy) / np.sqrt(np.diagonal(got.cov, axis1=1, axis2=2)))
    bound = centre_bound(
        3.0, blur_px=BLUR, depth=72, noise=2, background=120, photometry="multiplicative", known=(2, 3, 4, 5)
    )
    ratio = np.sqrt(np.mean(np.square(errors)) / (0.5 * np.trace(bound)))
    assert 0.9 < ratio < 1.1
    assert 0.9 < np.std(scaled) < 1.1


@pytest.mark.parametrize("noise", [0.0, 2.0, 12.0])
def test_a_shape_that_is_wrong_by_a_tenth_does_not_move_centres(noise):
    """The excess over the right shape's error is small, and there is no bias."""
    axes, angle = np.array([4.0, 2.8]), 0.6
    image, xy, rng = field(3, axes, angle, noise=noise, side=10)
    right = wm.detect_at(image, xy + 1.0, axes_px=axes, angle=angle, blur_px=BLUR)
    best = np.sqrt(np.mean((right.xy - xy) ** 2))
    for scale in (0.9, 1.1, np.array([1.1, 0.9])):
        got = wm.detect_at(image, xy + rng.uniform(-2, 2, xy.shape), axes_px=scale * axes, angle=angle, blur_px=BLUR)
        assert got.found.all()
        error = got.xy - xy
        assert np.abs(error.mean(axis=0)).max() < 0.003 + 3.5 * best / np.sqrt(len(xy))
        assert np.sqrt(np.mean(error**2)) < 1.15 * best + 0.006


def test_faint_markers_are_found_and_absent_ones_are_not():
    """Depth 3 times the noise: the least that `detect` takes, and by no means always. Every second is not there."""
    found = false = 0
    for seed in range(4):
        there = np.arange(36) % 2 == 0
        image, xy, rng = field(seed, contrast=0.03, noise=1.2, there=there)
        got = wm.detect_at(image, xy + rng.uniform(-2, 2, xy.shape), radius_px=3.0, blur_px=BLUR)
        found += int((got.found & there & (np.hypot(*(got.xy - xy).T) < 1.5)).sum())
        false += int((got.found & ~there).sum())
        assert set(got.answer[~there]) <= {CHANCE, OTHER}
        assert np.isnan(got.xy[~got.found]).all()
        free = wm.detect(image, radius_px=3.0).xy
        assert (np.hypot(*(free[:, None] - xy[there]).transpose(2, 0, 1)).min(axis=1) < 2.0).all()
    assert found >= 65  # of 72
    assert false <= 1


def test_a_dot_of_four_grey_levels_on_a_black_block():
    image, xy, _ = field(1, noise=0.0)
    image[:, 200:] *= 0.1
    rng = np.random.default_rng(5)
    dot = np.array([[240.3, 150.6]])
    image[130:170, 220:260] = 12.0
    draw_at(image, dot, (3.0, 3.0), contrast=0.3)
    grey = np.clip(np.round(image + rng.normal(0, 0.8, image.shape)), 0, 255).astype(np.uint8)
    wanted = np.concatenate([xy[xy[:, 0] < 180], dot])
    got = wm.detect_at(grey, wanted + 1.7, radius_px=3.0)
    assert got.found.all()
    assert np.hypot(*(got.xy[-1] - dot[0])) < 0.3
    assert got.depth[-1] == pytest.approx(3.6, abs=0.7)


def test_edges_lines_and_spots_of_light_are_something_else_or_nothing():
    rng = np.random.default_rng(2)
    image = np.full((120, 200), 110.0)
    image[:, 60:] = 25.0
    image[:, 100:] = 110.0
    image[50:52, 100:] = 40.0
    image[78:84, 148:154] = 200.0
    image += rng.normal(0, 1.0, image.shape)
    predicted = np.array([[60.0, 60.0], [62.0, 30.0], [98.0, 90.0], [140.0, 51.0], [170.0, 52.0], [151.0, 81.0]])
    for blur in (0.5, 1.0):
        got = wm.detect_at(image, predicted, radius_px=3.0, blur_px=blur)
        assert not got.found.any()
        assert set(got.answer) <= {CHANCE, OTHER, LOST}


def test_what_cannot_be_seen_is_said():
    image, xy, _ = field(4)
    mask = np.ones(image.shape, dtype=bool)
    x, y = np.rint(xy[0]).astype(int)
    mask[y - 12 : y + 13, x - 12 : x + 13] = False
    wanted = np.concatenate([xy[:3], [[-40.0, 20.0], [1e6, 5.0]]])
    got = wm.detect_at(image, wanted, radius_px=3.0, blur_px=BLUR, mask=mask)
    assert got.answer.tolist() == [UNSEEN, FOUND, FOUND, UNSEEN, UNSEEN]
    assert got.words[0] == ANSWERS[UNSEEN]
    none = wm.detect_at(image, np.empty((0, 2)), radius_px=3.0)
    assert len(none) == 0
    assert len(none.detections) == 0


@pytest.mark.slow
def test_a_marker_half_hidden_by_the_border_or_by_missing_pixels_is_found():
    image, xy, _ = field(6, noise=1.0)
    cut = image[:, int(np.ceil(xy[0, 0])) :]  # the first column of markers loses its left half or more
    shifted = xy - [np.ceil(xy[0, 0]), 0]
    seen = (shifted[:, 0] > -0.5) & (shifted[:, 0] < 6)
    holes = cut.copy()
    holes[::5, ::7] = np.nan
    for picture in (cut, holes):
        got = wm.detect_at(picture, shifted + np.array([0.4, 0.8]), radius_px=3.0, blur_px=BLUR)
        assert got.found[shifted[:, 0] > 6].all()
        assert (np.hypot(*(got.xy - shifted).T)[got.found & seen] < 0.2).all()
    assert got.flags[seen & got.found].all()


def test_two_predictions_cannot_have_one_marker():
    image, xy, _ = field(7, there=np.arange(36) != 1)
    wanted = np.concatenate([xy[:1] + 0.2, xy[:1] + np.array([1.5, -1.0]), xy[2:6]])
    got = wm.detect_at(image, wanted, radius_px=3.0, blur_px=BLUR)
    assert got.answer.tolist() == [FOUND, SAME, *[FOUND] * 4]


def test_blur_is_learnt_and_handed_on_and_shape_is_fitted_on_demand():
    axes, angle = (3.8, 2.7), -0.7
    image, xy, rng = field(8, axes, angle, noise=1.0)
    first = wm.detect_at(image, xy + rng.uniform(-1, 1, xy.shape), radius_px=3.2, fit_shape=True)
    assert first.found.all()
    assert first.frame.blur_px == pytest.approx(BLUR, abs=0.15)
    assert np.abs(first.axes_px - axes).max() < 0.25
    assert np.abs(first.angle - angle).max() < 0.15
    second = wm.detect_at(image, first.xy, axes_px=first.axes_px, angle=first.angle, search_px=1, frame=first.frame)
    assert second.frame == first.frame
    assert np.sqrt(np.mean((second.xy - xy) ** 2)) < 0.012
    assert len(second.detections) == len(xy)
    assert np.isfinite(second.detections.radius_px).all()


def test_blur_that_changes_is_learnt_anew():
    """A lens that goes out of focus during a run: what was handed on is another frame's."""
    image, xy, rng = field(8, noise=1.0)
    first = wm.detect_at(image, xy, radius_px=3.0)
    soft = np.full_like(image, 120.0)
    draw_at(soft, xy, (3.0, 3.0), blur=2.2)
    soft += rng.normal(0, 1.0, soft.shape)
    second = wm.detect_at(soft, xy, radius_px=3.0, search_px=1, frame=first.frame)
    fresh = wm.detect_at(soft, xy, radius_px=3.0, search_px=1)
    assert first.frame.blur_px < 0.9
    assert second.frame.blur_px == pytest.approx(fresh.frame.blur_px, abs=0.4)  # from where the old blur found them
    assert second.frame.blur_px > 1.5
    assert second.found.all()
    assert np.std((second.xy - xy) / np.sqrt(np.diagonal(second.cov, axis1=1, axis2=2))) < 1.3
    held = wm.detect_at(soft, xy, radius_px=3.0, search_px=1, frame=first.frame, blur_px=BLUR)
    assert held.frame.blur_px == BLUR  # said by the caller


def test_bright_markers_in_infrared():
    image, xy, rng = field(9)
    got = wm.detect_at(300.0 - image, xy + rng.uniform(-2, 2, xy.shape), radius_px=3.0, polarity="bright", blur_px=BLUR)
    assert got.found.all()
    assert (got.depth > 50).all()


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({}, "either"),
        ({"radius_px": 3.0, "axes_px": (3.0, 2.0)}, "either"),
        ({"radius_px": [3.0, 3.0, 3.0]}, "expected radii"),
        ({"radius_px": 0.2}, "at least"),
        ({"radius_px": 3.0, "search_px": -1}, "search_px"),
        ({"radius_px": 3.0, "false_alarms": 0}, "false_alarms"),
        ({"radius_px": 3.0, "photometry": "negative"}, "photometry"),
        ({"radius_px": 3.0, "blur_px": -1.0}, "blur_px"),
        ({"radius_px": 3.0, "polarity": "grey"}, "polarity"),
    ],
)
def test_wrong_options_are_named(options, word):
    with pytest.raises(ValueError, match=word):
        wm.detect_at(np.zeros((30, 30)), [[10.0, 10.0], [20.0, 20.0]], **options)


# --- kernels beside their slow twins -------------------------------------------------------------


def slow_window(image, known, x, y, params, reach):
    """Correlation, depth and residual variance of plane and disc round the pixel (x, y) by `numpy.linalg.lstsq`."""
    half = int(np.ceil(reach))
    cols, rows = np.arange(x - half, x + half + 1), np.arange(y - half, y + half + 1)
    cols, rows = cols[(cols >= 0) & (cols < image.shape[1])], rows[(rows >= 0) & (rows < image.shape[0])]
    from windmark.detection.template.disc_model import disc

    gx, gy = np.meshgrid(cols - x, rows - y)
    use = (gx**2 + gy**2 <= reach**2) & known[np.ix_(rows, cols)]
    template = disc(cols - x, rows - y, params)[0][use]
    plane = np.column_stack([np.ones(use.sum()), gx[use], gy[use]])
    values = image[np.ix_(rows, cols)][use]

    def flat(v):
        return v - plane @ np.linalg.lstsq(plane, v, rcond=None)[0]

    t, v = flat(template), flat(values)
    depth = -(t @ v) / (t @ t)
    return -(t @ v) / np.sqrt((t @ t) * (v @ v)), depth, ((v + depth * t) ** 2).sum() / (use.sum() - 4)


@pytest.mark.parametrize("gaps", [False, True])
def test_search_is_the_best_of_all_windows(gaps):
    from windmark.detection.template._kernels.search import search_discs

    rng = np.random.default_rng(11)
    image = np.full((40, 50), 90.0)
    draw_at(image, [(24.4, 19.3)], (3.4, 2.2), 0.5)
    image += rng.normal(0, 2, image.shape) + 0.3 * np.arange(50)
    known = rng.random(image.shape) > 0.1 if gaps else np.ones(image.shape, dtype=bool)
    shape = shape_matrix((3.4, 2.2), 0.5)
    params = np.array([0.0, 0.0, shape[0, 0], shape[0, 1], shape[1, 1], BLUR])
    out, reach = np.zeros((1, 7)), 7.6
    search_discs(
        *Scene(image, known if gaps else None, 1.0, np.inf, False).pixels(), np.array([[23, 20]]), params[None],
        np.array([reach]), 3, out,
    )  # fmt: skip
    windows = {(x, y): slow_window(image, known, x, y, params, reach) for x in range(20, 27) for y in range(17, 24)}
    (x, y), best = max(windows.items(), key=lambda item: item[1][0])
    assert np.abs(out[0, :2] + [23, 20] - [x, y]).max() <= 0.5
    assert out[0, 2] == pytest.approx(best[0], abs=1e-4)
    assert out[0, 3] == pytest.approx(best[1], rel=1e-3)
    assert out[0, 6] == pytest.approx(best[2], rel=1e-3)


def test_ring_windows_are_such_windows():
    from windmark.detection.template._kernels.search import ring_windows

    rng = np.random.default_rng(12)
    image = rng.normal(50, 3, (40, 40))
    known = np.ones(image.shape, dtype=bool)
    params = np.array([0.0, 0.0, 3.0, 0.0, 3.0, BLUR])
    places, out = np.array([[20, 20], [3, 20], [-6, 20]]), np.empty((3, 5))
    ring_windows(*Scene(image, None, 1.0, np.inf, False).pixels(), places, params, 7.2, out)
    for row, (x, y) in zip(out[:2], places[:2], strict=True):
        rho, depth, misfit = slow_window(image, known, x, y, params, 7.2)
        assert row[0] == pytest.approx(rho, abs=1e-4)
        assert row[1] == pytest.approx(depth, rel=1e-3)
        assert row[3] == pytest.approx(misfit, rel=1e-3)
    assert np.isnan(out[2, :4]).all()
