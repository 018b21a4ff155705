"""Dirt that hides in a fit: what it is measured by against a fit with a spot in it, and that sigmas cover it."""

import numpy as np
import pytest

from windmark.detection.template.dirt import DIRTY, SURE, Spots
from windmark.detection.template.dirt_images import Plan
from windmark.detection.template.disc_model import patch_model
from windmark.detection.template.fit import sized_windows
from windmark.detection.template.frame import fit_at_first
from windmark.detection.template.refine import fit_candidates, fresh_request, make_scene, refine_template
from windmark.detection.template.request import replace
from windmark.detection.template.result import Frame
from windmark.synth import disc_image

TILE, LEVEL, DEPTH, BLUR, NOISE = 35, 200.0, 140.0, 0.7, 7.0
ACROSS = 8


def pictured(radius, count, dirty, seed, noise=NOISE, spot=0.35, place=1.0, light=0.4):
    """Discs in rows, the first `dirty` of them with a round spot at the rim that takes light away; places too."""
    rng = np.random.default_rng(seed)
    rows = -(-count // ACROSS)
    image, xy = np.full((rows * TILE, ACROSS * TILE), LEVEL), np.empty((count, 2))
    fine = (np.arange(TILE * 8) + 0.5) / 8 - 0.5
    for k in range(count):
        c = TILE // 2 + rng.uniform(-0.5, 0.5, 2)
        axes, turn, along = radius * np.array([1.0, rng.uniform(0.6, 1.0)]), rng.uniform(0, np.pi), rng.uniform(0, 6.3)
        tile = disc_image((TILE, TILE), c, axes, turn, level=LEVEL, depth=DEPTH, blur_px=BLUR)
        if k < dirty:
            e = axes * [np.cos(along), np.sin(along)] * place
            x, y = c + np.array([np.cos(turn) * e[0] - np.sin(turn) * e[1], np.sin(turn) * e[0] + np.cos(turn) * e[1]])
            cover = np.hypot(fine[None, :] - x, fine[:, None] - y) < max(spot * radius, 0.8)
            tile = tile * (1.0 - (1.0 - light) * cover.reshape(TILE, 8, TILE, 8).mean(axis=(1, 3)))
        j, i = divmod(k, ACROSS)
        image[j * TILE : (j + 1) * TILE, i * TILE : (i + 1) * TILE] = tile
        xy[k] = c + np.array([i, j]) * TILE
    return image + rng.normal(0, noise, image.shape), xy


def looked_at(radius, seed, **options):
    """Scene, fits and what else is known of them before anything is looked for."""
    image, xy = pictured(radius, 24, 0, seed, **options)
    scene = make_scene(image, "dark", "multiplicative", None, None)
    fits, doubts = fit_candidates(scene, xy, np.full(len(xy), radius))
    return scene, fits, doubts


@pytest.mark.parametrize("radius", [3.0, 6.0])
def test_a_spot_is_what_a_fit_with_that_spot_in_it_would_find(radius):
    """The slow twin: least squares with the ten unknowns and the amplitude of one spot, linear about the fit."""
    scene, _, doubts = looked_at(radius, 3)
    done, request = doubts.done, doubts.request
    (windows,) = sized_windows(scene, replace(request, states=done.states), doubts.others)[:1]
    some = np.arange(2)
    plan = replace(Plan.make(scene, windows, done.take(windows.index)), steps=[1, 1])
    parts = plan.answers(scene, windows.take(some), done.take(windows.index[some]))
    x = np.arange(windows.weights.shape[1]) - windows.weights.shape[1] // 2
    for b, k in enumerate(windows.index[some]):
        model, jac = patch_model(x, x, done.params[k])
        used = windows.weights[b] > 0
        left = (windows.patches[b] - model)[used]
        # The covariance in noise of 1 is the inverse of the fit's normal matrix, with what it knew beforehand.
        known = done.cov[k] / done.column("noise2")[k]
        for size, answers in enumerate(parts):
            along, across = plan._images(size, done.params[k : k + 1], len(x), np.dtype(float))
            for place in range(0, along.shape[1], 7):
                image = (across[0, place][:, None] * along[0, place])[used]
                slopes = jac[:, used] @ image
                matrix = np.zeros((11, 11))
                matrix[:10, :10], matrix[:10, 10], matrix[10, :10] = np.linalg.inv(known), slopes, slopes
                matrix[10, 10] = image @ image
                whole = np.linalg.inv(matrix)
                unit, amplitude = whole[10, 10], whole[10, 10] * (image @ left)
                if answers.t[b, place] == 0.0:
                    continue
                assert answers.unit[b, place] == pytest.approx(unit, rel=2e-2)
                assert answers.t[b, place] == pytest.approx(amplitude / np.sqrt(unit), abs=0.02 * NOISE)
                far = 0.02 * np.sqrt(known[0, 0])
                assert answers.moves[b, place] == pytest.approx(-whole[:2, 10] / unit, abs=far)


def test_first_looks_are_as_large_as_what_is_asked_of_each():
    scene, _, doubts = looked_at(4.0, 5)
    done, request = doubts.done, doubts.request
    for windows in sized_windows(scene, replace(request, states=done.states), doubts.others):
        part = done.take(windows.index)
        plan = Plan.make(scene, windows, part)
        looks = plan.first_looks(scene, windows, part, np.ones(len(windows.index)))
        for first, answers in zip(looks, plan.answers(scene, windows, part), strict=True):
            ratio = np.abs(first).max(axis=1) / np.abs(answers.t).max(axis=1)
            assert np.median(ratio) == pytest.approx(1.0, abs=0.2)


def test_of_clean_discs_nothing_is_found_and_nothing_added():
    image, xy = pictured(4.0, 200, 0, 7)
    scene = make_scene(image, "dark", "multiplicative", None, None)
    fits, doubts = fit_candidates(scene, xy, np.full(len(xy), 4.0))
    looked = doubts.cast(fits)
    assert not (looked.flags & 4).any()
    np.testing.assert_array_equal(looked.xy, fits.xy)
    assert np.sqrt(looked.cov[:, 0, 0] / fits.cov[:, 0, 0]).mean() < 1.01


@pytest.mark.parametrize(("radius", "noise"), [(4.0, 7.0), (6.0, 7.0), (6.0, 14.0)])
def test_dirt_on_the_rim_is_flagged_and_covered(radius, noise):
    """Some 48 dirty discs of 96: what is not flagged is little, and sigmas cover (z of 48 is known to 0.1)."""
    image, xy = pictured(radius, 96, 48, 11, noise=noise)
    fits = refine_template(image, xy[::-1], np.full(96, radius))
    error = fits.xy - xy[::-1]
    z = np.sqrt(np.einsum("ki,kij,kj->k", error, np.linalg.inv(fits.cov), error) / 2)
    dirty = np.arange(96) >= 48
    least = 1.0 if noise < 10 else 0.8
    assert (fits.flags[dirty] & 4 > 0).mean() > 0.9 * least
    assert np.sqrt(np.mean(z[dirty] ** 2)) < 1.3
    assert (fits.flags[~dirty] & 4 > 0).sum() <= 1
    assert 0.8 < np.sqrt(np.mean(z[~dirty] ** 2)) < 1.25


def test_what_may_be_chance_is_added_by_what_all_of_the_frame_say():
    """Evidence of 2 nats: little where the others are clean, most of it where half of them have dirt on them."""
    spread = np.tile(np.diag([0.04, 0.01]), (40, 1, 1))
    nats = np.full(40, -2.0)
    nats[0] = 2.0
    clean = Spots(np.zeros(40), nats, spread).beyond(0)
    with_dirt = Spots(np.zeros(40), np.where(np.arange(40) % 2 == 0, nats, 30.0), spread).beyond(0)
    assert clean[0, 0, 0] < 0.1 * 0.04
    assert 0.8 * 0.04 < with_dirt[0, 0, 0] < 0.04
    assert with_dirt[1] == pytest.approx(spread[1])
    alone = Spots(np.zeros(1), np.array([np.log((1 - DIRTY) / DIRTY)]), spread[:1]).beyond(0)
    share = (0.838 + DIRTY * 20.0) / 21.0  # with p = 0.838: odds of 99 share / (1 - share) are p / (1 - p)
    assert 99.0 * share / (1.0 - share) == pytest.approx(0.838 / 0.162, rel=0.01)
    assert alone[0, 0, 0] == pytest.approx(0.838 * 0.04, rel=0.01)
    assert Spots(np.array([SURE + 0.1]), nats[:1], spread[:1]).sure[0]


def test_what_was_not_asked_for_is_not_looked_for():
    image, xy = pictured(4.0, 24, 12, 13)
    plain = refine_template(image, xy, np.full(24, 4.0), robust=False)
    robust = refine_template(image, xy, np.full(24, 4.0))
    assert (robust.flags & 4 > 0).sum() > (plain.flags & 4 > 0).sum()
    scene = make_scene(image, "dark", "multiplicative", None, None)
    few = fresh_request(xy[:4], np.full(4, 4.0), Frame(0.7, 0.1, None))
    _, doubts = fit_at_first(scene, few, Frame(0.7, 0.1, None), robust=True)
    assert not doubts.doubtful.size  # no noise is known that residuals could be compared with


def test_where_pixels_are_missing_there_is_no_answer():
    scene, _, doubts = looked_at(4.0, 17)
    done, request = doubts.done, doubts.request
    windows = sized_windows(scene, replace(request, states=done.states), doubts.others)[0]
    part, middle = done.take(windows.index), windows.weights.shape[1] // 2
    plan = Plan.make(scene, windows, part)
    windows.weights[:, :, middle:] = 0.0
    for size, answers in enumerate(plan.answers(scene, windows, part)):
        along, _ = plan._images(size, part.params, windows.weights.shape[1], np.dtype(float))
        column = along.argmax(axis=2) * plan.steps[size]
        assert (answers.t[column > middle + 2] == 0.0).all()
        assert (answers.t[column < middle - 4] != 0.0).all()
