"""Matching two constellations of one picture plane: right, or refused with the reason; never silently wrong."""

import numpy as np
import pytest

from windmark.scene import Detections
from windmark.tasks.align2d import NoMatching, SpotMatching, _kernels, match_spots
from windmark.tasks.align2d.candidates import ARMS, NEAR_A, NEAR_B, NOISE_PX, SCALE, SEED_TOLERANCE, _near


def moved(x, rng, *, shift=100.0, turn=5.0, scale=1.0, bend=5.0):
    t = np.radians(turn)
    r = scale * np.array([[np.cos(t), -np.sin(t)], [np.sin(t), np.cos(t)]])
    way = rng.uniform(0, 2 * np.pi)
    wave = bend * ((x[:, :1] - 500) / 500) ** 2 * [0.2, 1.0] + 0.5 * bend * np.sin(x[:, 1:] / 300) * [1.0, 0.3]
    return (x - 500) @ r.T + 500 + shift * np.array([np.cos(way), np.sin(way)]) + wave


def pictures(seed, *, count=30, x=None, missing=0.1, false=0.1, noise=0.05, **motion):
    """Spots of two pictures and what each really is (false spots: negative numbers)."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(0, 1000, (count, 2)) if x is None else x(rng)
    y = moved(x, rng, **motion) + rng.normal(0, noise, x.shape)
    spots, labels = [], []
    for number, seen in enumerate((x, y)):
        there = rng.permutation(np.flatnonzero(rng.random(len(x)) >= missing))
        extra = rng.uniform(0, 1000, (int(false * len(x)), 2))
        spots.append(Detections.make(np.vstack([seen[there], extra])))
        labels.append(np.concatenate([there, -1 - np.arange(len(extra)) - 1000 * number]))
    return spots, labels


def check(answer, labels, wrong=0):
    assert isinstance(answer, SpotMatching), getattr(answer, "reason", "")
    right = labels[0][answer.reference] == labels[1][answer.image]
    assert (~right).sum() <= wrong
    both = len(set(labels[0].tolist()) & set(labels[1].tolist()))
    assert right.sum() > 0.85 * both


def lattice(nx, ny, pitch, jitter):
    def make(rng):
        grid = np.stack(np.meshgrid(np.arange(nx), np.arange(ny)), axis=-1).reshape(-1, 2) * pitch + 100.0
        return grid + rng.normal(0, jitter, grid.shape)

    return make


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "case",
    [
        {"count": 15}, {"count": 30, "bend": 30.0}, {"count": 60, "shift": 250.0}, {"count": 20, "turn": 90.0},
        {"count": 20, "scale": 1.5}, {"count": 20, "scale": 0.7, "turn": 170.0},
        {"count": 6, "missing": 0.0, "false": 0.0, "bend": 1.0}, {"x": lattice(8, 6, 80, 1.0)},
    ],
)  # fmt: skip
def test_the_same_markers_are_matched(seed, case):
    spots, labels = pictures(seed, **case)
    check(match_spots(*spots), labels, wrong=1)


@pytest.mark.slow
def test_five_hundred_markers_are_matched():
    spots, labels = pictures(0, count=500, missing=0.05, false=0.05)
    check(match_spots(*spots), labels, wrong=3)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("lay", [lattice(8, 6, 80, 0.0), lattice(12, 3, 60, 0.02), lattice(14, 1, 60, 0.0)])
def test_a_regular_layout_is_refused_as_ambiguous(seed, lay):
    spots, _ = pictures(seed, x=lay, missing=0.05, false=0.0)
    answer = match_spots(*spots)
    assert not answer
    assert answer.cause in ("ambiguous", "weak")


@pytest.mark.parametrize("seed", range(5))
def test_a_largest_motion_tells_a_regular_layout(seed):
    spots, labels = pictures(seed, x=lattice(8, 6, 80, 0.0), missing=0.05, false=0.05, shift=15.0, turn=0.5)
    check(match_spots(*spots, max_shift_px=38), labels)


def test_a_larger_motion_than_stated_is_not_matched_to_something_else():
    spots, labels = pictures(3, count=25, shift=100.0, missing=0.0, false=0.0)
    answer = match_spots(*spots, max_shift_px=40)
    if answer:
        check(answer, labels)


@pytest.mark.parametrize("count", [4, 6, 10, 30, 80])
def test_unrelated_pictures_are_refused(count):
    for seed in range(6 if count < 30 else 2):
        rng = np.random.default_rng(seed)
        a, b = (Detections.make(rng.uniform(0, 1000, (count, 2))) for _ in range(2))
        answer = match_spots(a, b)
        assert not answer
        assert answer.cause in ("nothing", "weak")


def test_a_mirror_image_is_refused_as_one():
    rng = np.random.default_rng(2)
    x = rng.uniform(0, 1000, (25, 2))
    answer = match_spots(Detections.make(x), Detections.make([1000.0, 0.0] + x * [-1.0, 1.0]))
    assert isinstance(answer, NoMatching)
    assert answer.cause == "mirrored"
    assert "flip" in answer.reason


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_spots_are_said(count):
    some = np.random.default_rng(1).uniform(0, 100, (9, 2))
    few, many = Detections.make(some[:count]), Detections.make(some)
    for pair in ((few, many), (many, few)):
        answer = match_spots(*pair)
        assert answer.cause == "too_few"


def test_three_markers_are_no_evidence_by_themselves():
    x = np.array([[100.0, 100.0], [700.0, 160.0], [300.0, 600.0]])
    answer = match_spots(Detections.make(x), Detections.make(x + np.array([40.0, 10.0])))
    assert answer.cause == "weak"
    assert "max_shift_px" in answer.reason


def test_seeds_are_those_of_the_readable_twin():
    rng = np.random.default_rng(7)
    a = np.ascontiguousarray(rng.uniform(0, 300, (14, 2)))
    b = np.ascontiguousarray((a[2:] * 1.1)[rng.permutation(12)] + 20)
    na, nb = _near(a, NEAR_A), _near(b, NEAR_B)
    first = np.arange(0, 14, 2)
    allowed = rng.random((14, 12)) > 0.2
    got = _kernels.seed_turns(a, na, b, nb, first, ARMS, allowed, SCALE, SEED_TOLERANCE, NOISE_PX)
    want = slow_seeds(a, na, b, nb, first, allowed)
    assert np.array_equal(got[0], want[0])
    assert np.allclose(got[1], want[1])
    assert np.allclose(got[2], want[2])
    assert got[3] == want[3]


def slow_seeds(a, na, b, nb, first, allowed):
    met, offset = np.full((len(first), len(b)), -1), np.full((len(first), len(b)), np.inf)
    turn, tried = np.zeros((len(first), len(b), 2)), 0
    za, zb = a @ [1, 1j], b @ [1, 1j]
    for s, p in enumerate(first):
        for q in range(len(b)):
            for i in na[p, :ARMS]:
                for k in nb[q]:
                    z = (zb[k] - zb[q]) / (za[i] - za[p])
                    if not (allowed[p, q] and allowed[i, k] and 1 / SCALE <= abs(z) <= SCALE):
                        continue
                    tried += 1
                    step = z * (za[na[p]] - za[p])
                    reach = SEED_TOLERANCE * abs(step) + NOISE_PX
                    off = np.abs(zb[q] + step[:, None] - zb[nb[q]]).min(axis=1) / reach
                    key = ((off < 1).sum(), -(off[off < 1] ** 2).sum())
                    if key > (met[s, q], -offset[s, q]):
                        met[s, q], offset[s, q], turn[s, q] = key[0], -key[1], (z.real, z.imag)
    return met, offset, turn, tried


@pytest.mark.parametrize("seed", range(4))
def test_another_model_of_the_same_plan_is_not_aligned_by_force(seed):
    """A stated largest motion pairs neighbours, whatever they are; how far they lie off says that they are others."""
    rng = np.random.default_rng(seed)
    a, b = (Detections.make(lattice(8, 6, 80, 5.0)(rng)) for _ in range(2))
    for options in ({}, {"max_shift_px": 30}):
        answer = match_spots(a, b, **options)
        assert not answer
    assert "of their spacing" in answer.reason or answer.cause in ("weak", "nothing", "ambiguous")
