"""How well a lens is known though its coefficients stand for one another: against images moved by draws of them."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.calibration import Calibration, Free, self_calibrate
from windmark.calibration.lens_known import RADIAL, radial_spread, with_coefficients_told
from windmark.calibration.self_calibrate import FREE_OF
from windmark.geometry import Camera, Pose
from windmark.geometry.camera import PARAMETERS
from windmark.scene import MarkerSet, Observations, View

LENS = Camera((800, 600), 700.0, 1.0, 380.0, 310.0, k1=-0.1, k2=0.05, k4=0.2, k5=0.02, lens="rational")


def test_the_spread_is_the_largest_over_the_image_of_small_draws():
    rng = np.random.default_rng(2)
    index = [PARAMETERS.index(p) for p in RADIAL]
    root = 1e-4 * rng.normal(size=(6, 6))
    cov = np.zeros((14, 14))
    cov[np.ix_(index, index)] = root @ root.T
    cov[0, 0] = 100.0  # the focal length is another matter
    far = np.array([799.0, 0.0]) - [380.0, 310.0]
    rays = LENS.directions(np.array([380.0, 310.0]) + np.linspace(0, 1, 40)[1:, None] * far)
    draws = rng.normal(size=(2000, 6)) @ root.T
    moved = []
    for step in draws[:400]:
        camera = replace(LENS, **{p: getattr(LENS, p) + d for p, d in zip(RADIAL, step, strict=True)})
        moved.append(np.linalg.norm(camera.project(rays)[0] - LENS.project(rays)[0], axis=1))
    share = np.sqrt((np.array(moved) ** 2).mean(axis=0)) / np.linalg.norm(
        LENS.project(rays)[0] - [380.0, 310.0], axis=1
    )
    assert radial_spread(LENS, cov) == pytest.approx(share.max(), rel=0.12)  # 400 draws: 3.5 % (one sigma)


def test_what_moves_no_image_is_no_spread():
    """A change of numerator and denominator alike, of a lens that has none: the images stay where they are."""
    plain = Camera((800, 600), 700.0, lens="rational")
    along = np.zeros(14)
    along[[PARAMETERS.index("k1"), PARAMETERS.index("k4")]] = 1.0
    assert radial_spread(plain, np.outer(along, along)) == pytest.approx(0.0, abs=1e-9)
    alone = np.zeros((14, 14))
    alone[4, 4] = 0.01**2
    corner = ((399.5**2 + 299.5**2) / 700.0**2) * 0.01
    assert radial_spread(plain, alone) == pytest.approx(corner, rel=1e-3)


def network(seed: int, lens: Camera) -> tuple[Observations, MarkerSet, list[View]]:
    """14 pictures of 50 markers, some 660 marks."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-1, 1, (50, 3)) * [1, 0.7, 0.3]
    view, point, xy = [], [], []
    for v, roll in enumerate(rng.uniform(0, 2 * np.pi, 14)):
        eye = [*(0.9 * rng.uniform(-1, 1, 2)), rng.uniform(1.0, 1.6)]
        pose = Pose.look_at(eye, rng.normal(0, 0.2, 3) * [1, 1, 0], [np.cos(roll), np.sin(roll), 0])
        q, seen = lens.project(pose.apply(xyz))
        mine = np.flatnonzero(seen & lens.in_image(q))
        view += [v] * len(mine)
        point += mine.tolist()
        xy.append(q[mine] + rng.normal(0, 0.1, (len(mine), 2)))
    cov = np.tile(0.01 * np.eye(2), (len(view), 1, 1))
    marks = Observations(np.array(view), np.array(point), np.concatenate(xy), cov)
    names = [f"m{i}" for i in range(50)]
    markers = MarkerSet.make(names, xyz + rng.normal(0, 0.003, xyz.shape))
    return marks, markers, [View(f"v{v}", "cam") for v in range(14)]


SIMPLER = Camera((1000, 750), 480.0, k1=0.29, k4=0.36, k5=0.01, lens="rational")
START = {"cam": Camera((1000, 750), 500.0, lens="rational")}


@pytest.mark.parametrize(("lens", "seed"), [(SIMPLER, 0), (SIMPLER, 2), (Camera((1000, 750), 480.0), 13)])
def test_a_lens_of_fewer_coefficients_is_found_where_all_of_them_are_a_valley(lens: Camera, seed: int):
    """With all of them there is no minimum, or (the second) one with a ring in which nothing is known."""
    marks, markers, views = network(seed, lens)
    every = self_calibrate(marks, markers, START, views, datum=Free(), free=FREE_OF["rational"])
    result = self_calibrate(marks, markers, START, views, datum=Free())
    assert result, result.reason
    camera = result.cameras["cam"]
    names = [PARAMETERS[k] for k in np.flatnonzero(np.diagonal(camera.cov))]
    assert set(names) == set(result.options["free"]) < set(FREE_OF["rational"])
    grid = np.stack(np.meshgrid(np.linspace(60, 940, 45), np.linspace(60, 690, 32)), axis=-1).reshape(-1, 2)
    seen = grid[np.linalg.norm(grid - [499.5, 374.5], axis=1) < 480]

    def off(found: Camera) -> tuple[np.ndarray, np.ndarray]:
        xy, known, _, slope = found.project_jacobian(lens.directions(seen))
        assert known.all()
        sigma = np.sqrt(np.einsum("nij,jk,nik->n", slope, found.cov, slope))
        return np.linalg.norm(xy - seen, axis=1), sigma

    error, sigma = off(camera)
    assert (error < 4 * sigma).all()
    assert sigma.max() < 1.5
    if every:
        assert off(every.cameras["cam"])[1].max() > 10  # pixels
    else:
        assert every.cause == "degenerate"


def test_a_lens_whose_marks_tell_all_coefficients_keeps_them():
    marks, markers, views = network(1, replace(SIMPLER, k3=0.02, k6=0.05))
    result = self_calibrate(marks, markers, START, views, datum=Free())
    assert result
    assert set(result.options["free"]) == set(FREE_OF["rational"])
    assert result.sigma0 == pytest.approx(1, abs=0.06)  # 3 sigma


def test_what_fewer_coefficients_do_not_explain_is_not_taken():
    """A lens of all six that is open among the marks stays, where one of fewer leaves residuals."""
    marks, markers, views = network(3, replace(SIMPLER, k3=0.02, k6=0.05))
    result = self_calibrate(marks, markers, START, views, datum=Free())
    worse = replace(result, residuals=2 * result.residuals)
    camera = result.cameras["cam"]
    open_cov = camera.cov + 10.0 * np.diag([p in ("k1", "k2") for p in PARAMETERS])
    left_open = replace(result, cameras={"cam": replace(camera, cov=open_cov)})
    asked = []

    def again(free: tuple[str, ...]) -> Calibration:
        asked.append(free)
        return worse

    kept = with_coefficients_told(left_open, START, FREE_OF["rational"], again, len(marks))
    assert kept is left_open
    assert asked
    assert with_coefficients_told(result, START, FREE_OF["rational"], again, len(marks)) is result
