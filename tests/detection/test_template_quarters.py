"""What a centre owes to a quarter of its window: against fits of the window whose weights are 0 there."""

from dataclasses import replace

import numpy as np

from windmark.detection.template._kernels.cut import SECTORS, sector_of
from windmark.detection.template.doubt import without_quarters
from windmark.detection.template.fit import Fitted, fit_all, sized_windows
from windmark.detection.template.refine import fresh_request, make_scene
from windmark.detection.template.request import Neighbours
from windmark.detection.template.result import Frame
from windmark.synth import disc_image

TILE, LEVEL, DEPTH, RADIUS = 41, 200.0, 140.0, 5.0


def scene_of(count=16, noise=4.0, dirt=0.0):
    """Discs in a row, each with a patch of dirt of that depth on its rim; scene and centres (count, 2)."""
    rng = np.random.default_rng(5)
    image, xy = np.empty((TILE, count * TILE)), np.empty((count, 2))
    for k in range(count):
        xy[k] = TILE // 2 + rng.uniform(-0.5, 0.5, 2)
        axes, turn = RADIUS * np.array([1.0, rng.uniform(0.6, 1.0)]), rng.uniform(0, np.pi)
        tile = disc_image((TILE, TILE), xy[k], axes, turn, level=LEVEL, depth=DEPTH, blur_px=0.7)
        away = rng.uniform(0, 2 * np.pi)
        spot = xy[k] + 4.5 * np.array([np.cos(away), np.sin(away)])
        x = np.arange(TILE)
        tile[np.hypot(x[None, :] - spot[0], x[:, None] - spot[1]) < 2.2] -= dirt
        image[:, k * TILE : (k + 1) * TILE] = tile
        xy[k, 0] += k * TILE
    return make_scene(image + rng.normal(0, noise, image.shape), "dark", "multiplicative", None, None), xy


def fitted(scene, xy, scale=np.inf):
    request = fresh_request(xy, np.full(len(xy), RADIUS), Frame(0.7, 0.1, None))
    request = replace(request, scale=np.full(len(xy), scale))
    others = Neighbours.find(request)
    return request, others, fit_all(scene, request, others)[0]


def refitted(scene, request, others, done):
    """Movement (K, 8, 2) by fits to the windows without the quarters, to their end."""
    moved = np.empty((len(request.xy), SECTORS, 2))
    for w in sized_windows(scene, replace(request, states=done.states), others):
        for q in range(SECTORS):
            weights = w.weights.copy()
            for n, k in enumerate(w.index):
                x = np.arange(weights.shape[1]) - weights.shape[1] // 2
                along = np.arctan2(x[:, None] - done.params[k, 1], x[None, :] - done.params[k, 0])
                gone = np.abs(np.remainder(along - q * np.pi / 4 + np.pi, 2 * np.pi) - np.pi) < np.pi / 4
                weights[n][gone] = 0.0
            again: Fitted = replace(w, weights=weights).fit(np.arange(len(w.index)), done.states[w.index], w.patches)
            assert (again.column("status") == 1).all()
            moved[w.index, q] = again.params[:, :2] - done.params[w.index, :2]
    return moved


def test_movements_are_those_of_fits_without_the_quarters():
    scene, xy = scene_of(dirt=60.0)
    for scale in (np.inf, 4.0):  # Tukey's weights
        request, others, done = fitted(scene, xy, scale)
        moved = without_quarters(scene, request, done, others)
        expected = refitted(scene, request, others, done)
        assert np.sqrt(np.square(moved - expected).mean()) < 0.05 * np.sqrt(np.square(expected).mean())


def test_dirt_on_the_rim_moves_a_centre_more_than_noise():
    scene, xy = scene_of(dirt=60.0)
    request, others, done = fitted(scene, xy)
    moved = without_quarters(scene, request, done, others)
    assert np.sqrt(np.square(moved).mean()) > 3.0 * np.sqrt(np.trace(done.cov[:, :2, :2], axis1=1, axis2=2)).mean()


def test_a_window_without_pixels_has_no_answer():
    scene, xy = scene_of(count=2)
    request, others, done = fitted(scene, xy)
    blind = replace(scene, usable=np.zeros(scene.image.shape, dtype=bool))
    assert np.isnan(without_quarters(blind, request, done, others)).all()


def test_sectors_are_of_equal_angle_and_in_order():
    for turn in np.linspace(0.0, 2 * np.pi, 400, endpoint=False) + 1e-3:
        assert sector_of(np.cos(turn), np.sin(turn)) == int(turn / (2 * np.pi) * SECTORS) % SECTORS
