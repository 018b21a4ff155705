"""Edge support: the kernel against a slow twin, and what it says of discs and of other things."""

import numpy as np
import pytest

from windmark.detection.template.disc_model import patch_model
from windmark.detection.template.refine import make_scene, refine_template
from windmark.detection.template.rim import rim_support

NOISE = 1.0


def fitted(image, places, radius, photometry="multiplicative"):
    fits = refine_template(image, places, radius, photometry=photometry, robust=False, blur_px=(0.9, 0.1))
    scene = make_scene(image, "dark", photometry, None, None)
    return fits, rim_support(scene, fits, np.full(len(fits), NOISE**2))


def twin(image, fits, k, photometry, sectors=8):
    """Worst and median sector of one fit, pixel by pixel from the readable model."""
    angle, axes, blur = fits.angle[k], fits.axes_px[k], fits.blur_px[k]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    shape = turn @ np.diag(axes) @ turn.T
    middle = np.rint(fits.xy[k])
    lattice = np.arange(-25, 26.0)
    d = fits.xy[k] - middle
    slope, paint = fits.slope[k], photometry == "multiplicative"
    here = 1.0 - slope @ d if paint else 1.0
    ground = fits.background[k] * here if paint else fits.background[k] - slope @ d
    p = [*d, shape[0, 0], shape[0, 1], shape[1, 1], blur, fits.depth[k] * here, ground, *(slope / here)]
    model, _ = patch_model(lattice, lattice, p, photometry=photometry)
    rows = lattice.astype(int) + int(middle[1])
    columns = lattice.astype(int) + int(middle[0])
    data = image[np.ix_(rows, columns)]
    reach, found = 1.0 + 1.5 * blur, {}
    inverse = np.linalg.inv(shape)
    for j, y in enumerate(lattice):
        for i, x in enumerate(lattice):
            unit = inverse @ ([x, y] - d)
            length = np.linalg.norm(unit)
            distance = (length**2 - length) / np.linalg.norm(inverse @ unit)
            if abs(distance) < reach:
                sector = int((np.arctan2(unit[1], unit[0]) / (2 * np.pi) + 1) * sectors) % sectors
                found.setdefault(sector, []).append((model[j, i], data[j, i] - model[j, i]))
    shares = []
    for pixels in found.values():
        value, residual = np.array(pixels).T
        n = len(value)
        left = max((residual**2).sum() - (n + 2 * np.sqrt(2 * n)) * NOISE**2, 0.0)
        shares.append(1 - left / ((value - value.mean()) ** 2).sum())
    shares = np.clip(shares, -1, 1)
    return shares.min(), np.median(shares)


@pytest.fixture
def things(draw):
    """Discs, a square, a disc with a thick line through it, the end of a stroke; light that falls off."""
    rng = np.random.default_rng(0)
    image = draw((90, 330), [(40.3, 45.2, 5.0), (100.4, 44.7, 6.0, 3.5, 0.4)], blur=1) - 100.0
    y, x = np.mgrid[:90, :330]
    image += draw((90, 330), [(220.2, 45.1, 5.0)], blur=1) - 100.0
    square = (abs(x - 160) <= 4) & (abs(y - 45) <= 4)
    line = (abs(y - 45 - 0.3 * (x - 220)) <= 1.5) & (abs(x - 220) < 40)
    stroke = (abs(y - 45) <= 2) & (x > 275) & (x < 310)
    image += 100.0 - 60.0 * square - 40.0 * (line & (np.hypot(x - 220, y - 45) > 4)) - 60.0 * stroke
    image *= 1.0 + 0.001 * (x - 165)
    return image + rng.normal(0, NOISE, image.shape)


PLACES = np.array([[40.3, 45.2], [100.4, 44.7], [160.0, 45.0], [220.2, 45.1], [278.0, 45.0]])


@pytest.mark.parametrize("photometry", ["multiplicative", "additive"])
def test_as_its_slow_twin(things, photometry):
    fits, support = fitted(things, PLACES, 4.5, photometry)
    for k in (0, 1, 3):
        np.testing.assert_allclose(support[k], twin(things, fits, k, photometry), atol=2e-3)


def test_what_has_an_edge_all_round(things):
    _, support = fitted(things, PLACES, 4.5)
    assert (support[:2] > 0.9).all()
    assert support[2, 0] < 0.6  # a square's corners
    assert support[3, 0] < 0.5 < support[3, 1]  # the line takes the edge away where it crosses
    assert not support[4, 0] > 0.3  # the stroke goes on


def test_none_where_there_is_no_fit(things):
    fits = refine_template(np.full((40, 40), 7.0), [[20.0, 20.0]], 3.0)
    support = rim_support(make_scene(np.full((40, 40), 7.0), "dark", "multiplicative", None, None), fits, np.ones(1))
    assert support.shape == (1, 2)
    assert not (support > 0.5).any()
