"""What was held wrongly is said as that, not as a difference between the pictures."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.calibration import Calibration, Free, self_calibrate
from windmark.calibration.self_calibrate import FREE
from windmark.geometry import PARAMETERS

TRUE = networks.CAMERA


def doubts(off, seed=31, cov=None, views=10):
    """Of a network of pictures with some parameters held, ``off`` from the truth (``cov``: as is known of these)."""
    observations, markers, cameras, named, _ = networks.nouns(networks.make(seed, points=40, views=views))
    held = replace(TRUE, **{p: getattr(TRUE, p) + change for p, change in off.items()})
    held = replace(held, cov=cov)
    free = [p for p in FREE if p not in off]
    result = self_calibrate(observations, markers, dict.fromkeys(cameras, held), named, datum=Free(), free=free)
    assert isinstance(result, Calibration)
    return result.doubts


@pytest.mark.parametrize(
    "off",
    [{"cx": 15.0}, {"aspect": 1e-3}, {"focal_px": 15.0}, {"k1": 0.01, "k2": 0.0}, {"cx": 15.0, "aspect": 1e-3},
     {"cx": -8.0, "cy": 8.0}],
)  # fmt: skip
def test_it_is_named_with_what_all_pictures_ask_for(off):
    """It was: the principal points, shears or focal lengths of nearly all pictures are not those of the others."""
    (doubt,) = (d for d in doubts(off) if d.cause != "marker")
    assert doubt.cause == "camera"
    said = dict(zip(doubt.names[::2], str(doubt).split(";"), strict=True))
    assert set(said) == {p for p, change in off.items() if change}
    for name, words in said.items():
        change, sigma = (float(n.split(" ")[0].rstrip(":")) for n in words.split("ask for ")[1].split(" +- "))
        assert change == pytest.approx(-off[name], rel=0.15, abs=5 * sigma)


@pytest.mark.parametrize("seed", range(31, 35))
def test_what_is_held_rightly_is_not_named(seed):
    assert [d for d in doubts({"cx": 0.0, "cy": 0.0, "aspect": 0.0, "k1": 0.0}, seed) if d.cause != "focus"] == []


def test_what_its_covariance_leaves_open_is_no_contradiction():
    cov = np.zeros((len(PARAMETERS),) * 2)
    cov[0, 0] = 10.0**2
    assert [d.cause for d in doubts({"focal_px": 6.0})] == ["camera"]
    assert doubts({"focal_px": 6.0}, cov=cov) == ()
