"""Cameras merged on nodes: values, gains and sigma by draws, what no gain explains, seams, refusals."""

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.errors import UsageError
from windmark.paint import NodeField, merge_cameras

sys.path.insert(0, str(Path(__file__).parent))
from paint_shapes import plate

MESH = plate(61, 41)
X = MESH.vertices[:, 0]
TRUE = 1 + 0.2 * np.sin(1.3 * X) + 0.1 * MESH.vertices[:, 1]


def views(rng, gains=(1.0, 1.03), sigmas=(0.01, 0.004), shading=0.0):
    """Two cameras, the one from the left, the other from the right, both in the middle."""
    out = []
    for k, (g, s) in enumerate(zip(gains, sigmas, strict=True)):
        seen = (X < 0.8) if k == 0 else (X > -0.8)
        shade = 1 + shading * np.sin(7 * X + 3 * MESH.vertices[:, 1] + 2 * k)
        out.append(NodeField.make(np.where(seen, g * TRUE * shade + s * rng.normal(size=len(X)), np.nan), s))
    return out


@pytest.mark.slow
def test_gains_and_sigmas_cover():
    z, off = [], []
    for seed in range(60):
        got = merge_cameras(views(np.random.default_rng(seed)), ["left", "right"])
        assert got
        assert np.prod(got.gain) == pytest.approx(1)
        off.append((np.log(got.gain[1] / got.gain[0]) - np.log(1.03)) / (2 * got.gain_sigma[0]))
        # Gains are relative: the mean camera is the measure.
        z.append((got.field.value - TRUE * np.sqrt(1.03)) / got.field.sigma)
    assert 0.75 < np.std(off) < 1.25
    assert 0.93 < np.mean(np.abs(z) < 1.96) < 0.985


def test_merged_is_better_than_each_and_gain_is_shared_by_all_nodes():
    rng = np.random.default_rng(0)
    fields = views(rng)
    got = merge_cameras(fields, ["left", "right"])
    both = np.isfinite(fields[0].value) & np.isfinite(fields[1].value)
    assert (got.field.sigma[both] < np.minimum(fields[0].sigma, fields[1].sigma)[both] * 1.02).all()
    assert any(n.startswith("camera gain") for n in got.field.names)
    assert set(got.source[X < -0.9]) == {0}
    assert set(got.source[X > -0.7]) == {1}
    plain = merge_cameras(fields, ["left", "right"], gain="none")
    assert np.all(plain.gain == 1)
    assert plain.systematic > 0.01  # the gain that was not taken off


def test_what_no_gain_explains_is_found_and_is_shared():
    got = merge_cameras(views(np.random.default_rng(1), sigmas=(0.002, 0.002), shading=0.02), ["left", "right"])
    assert 0.007 < got.systematic < 0.03
    assert {"camera left", "camera right"} <= set(got.field.names)
    assert np.mean(np.abs((got.field.value - TRUE * np.sqrt(1.03)) / got.field.sigma) < 1.96) > 0.9


def test_dirt_on_one_camera_does_not_move_the_gain_and_is_told():
    fields = views(np.random.default_rng(2))
    dirty = (np.abs(X) < 0.25) & (MESH.vertices[:, 1] > 0.5)
    fields[0].value[dirty] *= 0.5
    got = merge_cameras(fields, ["left", "right"])
    assert np.log(got.gain[1] / got.gain[0]) == pytest.approx(np.log(1.03), abs=0.004)
    (apart,) = got.apart
    assert (apart.first, apart.second) == ("left", "right")
    assert apart.beyond == pytest.approx(dirty.sum() / (np.abs(X) < 0.8).sum(), rel=0.1)
    assert 0.7 < apart.typical < 1.5


def test_how_far_cameras_are_apart_is_told_in_their_stated_sigmas():
    """A gain that is not taken off goes into the sigma, but not unsaid: 3 % beside 1.1 % of noise."""
    fields = views(np.random.default_rng(5))
    (right,), (wrong,) = (merge_cameras(fields, ["left", "right"], gain=g).apart for g in ("overlap", "none"))
    assert 0.7 < right.typical < 1.3
    assert right.beyond == 0
    assert wrong.typical > 2.5 * right.typical
    assert wrong.beyond == 0
    assert merge_cameras(fields[:1], ["left"]).apart == ()


def test_seams_are_as_large_as_their_sigma_and_a_wrong_gain_shows():
    fields = views(np.random.default_rng(3))
    tapers = np.stack([np.clip((0.8 - X) / 1.6, 0, 1), np.clip((X + 0.8) / 1.6, 0, 1)])
    good = merge_cameras(fields, ["left", "right"], tapers=tapers).seams(MESH.triangles)
    assert 0.7 < good.typical < 1.3
    assert good.unchecked == 0
    bad = merge_cameras(fields, ["left", "right"], tapers=tapers, gain="none")
    assert np.abs(bad.seams(MESH.triangles).step).mean() > 0.02
    assert np.isnan(merge_cameras(fields[:1], ["left"]).seams(MESH.triangles).typical)


def test_three_cameras_in_a_chain_and_one_apart():
    rng = np.random.default_rng(4)
    cuts = [(-3, -0.5), (-1.2, 1.2), (0.5, 3)]
    gains = [0.9, 1.0, 1.2]
    fields = [NodeField.make(np.where((a < X) & (b > X), g * TRUE + 0.005 * rng.normal(size=len(X)), np.nan), 0.005)
              for (a, b), g in zip(cuts, gains, strict=True)]  # fmt: skip
    got = merge_cameras(fields, list("abc"))
    np.testing.assert_allclose(got.gain / got.gain[1], gains, rtol=0.005)
    apart = merge_cameras([fields[0], fields[2]], list("ac"))
    assert not apart
    assert "c shares fewer than 20 well-seen nodes" in apart.reason
    assert merge_cameras([fields[0], fields[2]], list("ac"), gain="none")


def test_a_shared_error_stays_one_and_wrong_use_is_told():
    a, b = (f.with_mode("temperature", 0.01) for f in views(np.random.default_rng(5)))
    got = merge_cameras([a, b], ["left", "right"], gain="none").field
    np.testing.assert_allclose(got.modes[:, got.names.index("temperature")], 0.01)
    with pytest.raises(UsageError, match="different names"):
        merge_cameras([a, b], ["x", "x"])
    with pytest.raises(UsageError, match="gain must be one of"):
        merge_cameras([a, b], ["x", "y"], gain="auto")
