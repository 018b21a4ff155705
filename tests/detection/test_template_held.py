"""Fits of a known shape: the kernel of a held blur beside the one of any blur, one kernel for all sizes, the colour."""

import numpy as np
import pytest

import windmark as wm
from windmark.detection.template._kernels.algebra import normal_equations
from windmark.detection.template._kernels.held import held_sums, pixel_table
from windmark.detection.template._kernels.model import CENTRE, disc_sums, points_needed
from windmark.detection.template.colour import colour_of, coloured
from windmark.detection.template.disc_model import patch_model, shape_matrix
from windmark.detection.template.fit import fit_all, sized_windows
from windmark.detection.template.request import Neighbours, Request, Scene
from windmark.detection.template.result import Frame
from windmark.scene import Detections

SIZE = 25
CASES = [  # axes, angle, blur, centre; the last ones leave the patch
    ((3.0, 3.0), 0.0, 0.7, (0.3, -0.2)),
    ((2.0, 1.0), 0.9, 0.5, (-0.45, 0.1)),
    ((6.5, 5.0), 1.4, 0.26, (-0.3, -0.3)),
    ((5.0, 2.5), -0.6, 1.9, (0.0, 0.5)),
    ((3.0, 2.0), 0.4, 0.8, (-12.6, 3.0)),
    ((3.0, 2.0), 0.4, 0.8, (2.0, 12.5)),
    ((3.0, 2.0), 0.4, 0.8, (14.0, -13.0)),
    ((3.0, 2.0), 0.4, 0.8, (40.0, 0.0)),
]


@pytest.mark.parametrize(("axes", "angle", "blur", "centre"), CASES)
def test_a_held_blur_gives_the_same_image_and_derivatives(axes, angle, blur, centre):
    """What the table's steps leave is far below what the cut of the Gaussian leaves."""
    shape = shape_matrix(axes, angle)
    p = np.array([*centre, shape[0, 0], shape[0, 1], shape[1, 1], blur, 1.0, 1.0, 0.0, 0.0])
    slow, fast = np.zeros((10, SIZE, SIZE)), np.full((10, SIZE, SIZE), 7.0)
    disc_sums(p, points_needed(p), CENTRE, np.zeros((8, SIZE + 6)), slow)
    held_sums(p, points_needed(p), pixel_table(blur), fast)
    for k, left in ((0, 2e-5), (1, 2e-5), (6, 2e-5)):
        assert np.abs(fast[k] - slow[k]).max() < left
    assert (fast[2:6] == 7.0).all()
    assert (fast[8:] == 7.0).all()


def sheet(seed, *, texture=0.0, noise=2.0, discs=0):
    """A hundred markers of different sizes on light that falls off, some near each other and near the border.

    Sizes and directions are those of the seed `discs`; places, texture and noise those of `seed`.
    """
    rng = np.random.default_rng(seed)
    image = 200.0 + 0.05 * np.arange(500.0) + np.zeros((500, 1))
    xy = (
        6.0
        + 54.0 * np.stack(np.meshgrid(np.arange(10), np.arange(10)), -1).reshape(-1, 2)
        + rng.uniform(0, 3, (100, 2))
    )
    xy[11] = xy[12] - [9.0, 2.0]
    shapes = np.random.default_rng([discs, 99])
    axes = np.sort(shapes.uniform(2.0, 6.0, (100, 2)))[:, ::-1]
    angle = shapes.uniform(-1.5, 1.5, 100)
    for k, (x, y) in enumerate(xy):
        shape = shape_matrix(axes[k], angle[k])
        cols, rows = np.arange(int(x) - 14, int(x) + 15), np.arange(int(y) - 14, int(y) + 15)
        cols, rows = cols[(cols >= 0) & (cols < 500)], rows[(rows >= 0) & (rows < 500)]
        params = [x, y, shape[0, 0], shape[0, 1], shape[1, 1], 0.7, 0.6, 1.0, 0.0, 0.0]
        image[np.ix_(rows, cols)] *= patch_model(cols, rows, params)[0]
    if texture:
        from scipy.ndimage import gaussian_filter

        grain = gaussian_filter(rng.normal(size=image.shape), 1.2)
        image *= 1.0 + texture * grain / grain.std()
    return image + rng.normal(0, noise, image.shape), xy, axes, angle, rng


@pytest.mark.slow
@pytest.mark.parametrize("held", [True, False])
def test_one_kernel_for_all_sizes_is_the_fits_by_size(held):
    image, xy, axes, angle, rng = sheet(1)
    shape = np.array([shape_matrix(*pair)[[0, 0, 1], [0, 1, 1]] for pair in zip(axes, angle, strict=True)])
    blur = np.where(np.arange(100) < 70, 0.7, 0.9)
    request = Request(
        xy + rng.uniform(-0.3, 0.3, xy.shape), axes[:, 0], blur, np.full(100, 0.1), shape if held else None,
        np.where(np.arange(100) % 9 == 0, 2.0, np.inf), np.full((100, 10), np.nan),
    )  # fmt: skip
    scene = Scene(image, None, 1.0, 320.0, True)
    others = Neighbours.find(request)
    groups = sized_windows(scene, request, others)
    assert len(groups) > 3
    done, _ = fit_all(scene, request, others)
    for w in groups:
        states = w.done.states.copy()
        states[:, :2] -= w.start
        fitted = w.fit(np.arange(len(w.index)), states, w.patches)
        for name in ("pixel", "params", "cov", "states", "table", "usable", "saturated"):
            # The same sums; in which order the compiler takes them may differ by the last digits.
            one, other = getattr(done, name)[w.index], getattr(fitted, name)
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12, err_msg=name)
    assert (done.column("status") == 1).mean() > 0.95


@pytest.mark.slow
def test_what_is_held_has_no_influence():
    """`held_sums` leaves the derivatives by a held shape alone, and they come into the influences: they must be 0."""
    from windmark.detection.template._kernels.fit import fit_window, workspace

    space = workspace(SIZE)
    assert (space[0] == 0).all()
    p = np.array([0.2, -0.3, 3.0, 0.0, 3.0, 0.7, 0.6, 1.0, 0.0, 0.0])
    lattice = np.arange(SIZE) - SIZE // 2
    patch = patch_model(lattice, lattice, p)[0] + np.random.default_rng(0).normal(0, 0.01, (SIZE, SIZE))
    u = np.array([0.0, 0.0, 2.25 + 0.49, 0.0, 2.25 + 0.49, 0.49, 0.5 * 9.0, 0.9, 0.0, 0.0])
    fixed = np.array([False, False, True, True, True, True, False, False, False, False])
    out, params, cov, influence = np.zeros(8), np.zeros(10), np.zeros((10, 10)), np.zeros((4, SIZE, SIZE))
    fit_window(
        patch, np.ones((SIZE, SIZE)), np.array([0.0, 0.0, 3.0, 0.7]), u, u.copy(), np.zeros(10), fixed, 0.0, 1.0, 1e-4,
        out, params, cov, influence, pixel_table(0.7), space,
    )  # fmt: skip
    assert (space[0][2:6] == 0).all()
    assert np.abs(params[:2] - p[:2]).max() < 0.02
    # The influences are those of least squares: they carry white noise into the centre's covariance.
    carried = np.tensordot(influence[:2], influence[:2], ((1, 2), (1, 2))) * out[1]
    np.testing.assert_allclose(carried, cov[:2, :2], rtol=1e-4, atol=1e-6 * cov[0, 0])


def test_colour_is_taken_off_and_put_back():
    rng = np.random.default_rng(2)
    white, cov = (np.array([a @ a.T for a in rng.normal(size=(50, 2, 2))]) for _ in range(2))
    colour = colour_of(cov, white)
    np.testing.assert_allclose(coloured(white, colour), cov, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(colour_of(3.0 * white, white), 3.0 * np.tile(np.eye(2), (50, 1, 1)), atol=1e-9)
    low = np.linalg.cholesky(white)
    np.testing.assert_allclose(low @ colour @ np.swapaxes(low, 1, 2), cov, rtol=1e-9, atol=1e-12)


def test_a_colour_that_is_handed_on_gives_the_sigmas_of_a_fresh_one():
    """On coarse paint sigmas are more than 1.5 times those of white noise; by a colour found elsewhere, in other noise
    of the same kind, a tenth of a pixel or more off, they are the same within 5 %, without bias.
    """
    image, xy, axes, angle, _ = sheet(3, texture=0.02, noise=1.0)
    first = wm.detect_at(image, xy, axes_px=axes, angle=angle, search_px=1)
    assert not first.frame.noise.is_white
    both, white = [], []
    for seed in (4, 5, 6):
        image, xy, axes, angle, _ = sheet(seed, texture=0.02, noise=1.0)
        options = {"axes_px": axes, "angle": angle, "search_px": 1, "frame": first.frame, "reshape": False}
        fresh = wm.detect_at(image, xy, **options)
        handed = wm.detect_at(image, xy, colour=first.colour, **options)
        np.testing.assert_array_equal(handed.xy, fresh.xy)
        ok = fresh.found & first.found
        both.append(np.sqrt(handed.cov[ok][:, [0, 1], [0, 1]] / fresh.cov[ok][:, [0, 1], [0, 1]]))
        white.append(np.sqrt(fresh.colour[ok][:, [0, 1], [0, 1]]))
    ratio = np.concatenate(both)
    assert np.median(np.concatenate(white)) > 1.5
    assert abs(np.median(ratio) - 1.0) < 0.01
    assert np.quantile(np.abs(ratio - 1.0), 0.95) < 0.05


def test_where_no_colour_is_known_it_is_found():
    image, xy, axes, angle, _ = sheet(7, texture=0.02)
    first = wm.detect_at(image, xy, axes_px=axes, angle=angle, search_px=1)
    options = {"axes_px": axes, "angle": angle, "search_px": 1, "frame": first.frame, "reshape": False}
    every = wm.detect_at(image, xy, **options)
    part = every.colour.copy()
    part[::3] = np.nan
    again = wm.detect_at(image, xy, colour=part, **options)
    np.testing.assert_allclose(again.cov[every.found], every.cov[every.found], rtol=1e-9)
    assert isinstance(again.detections, Detections)


def test_a_colour_of_the_wrong_shape_is_named():
    with pytest.raises(ValueError, match=r"colour must be \(1, 2, 2\)"):
        wm.detect_at(
            np.zeros((30, 30)), [[10.0, 10.0]], radius_px=3.0, frame=Frame(0.7, 0.1, None), colour=np.zeros((2, 2))
        )


def test_normal_equations_of_a_held_shape_are_those_without_it():
    """Once the right side of what is held was left as the memory came, and zeros were written behind the matrix."""
    rng = np.random.default_rng(1)
    jac, res = rng.normal(size=(10, 5, 5)), rng.normal(size=(5, 5))
    room, rhs, t = np.full((11, 10), 7.0), np.full(10, np.nan), np.eye(5)
    normal_equations(jac, res, False, t, room[:10], rhs, np.empty(10))
    free = [0, 1, 6, 7, 8, 9]
    rows = jac.reshape(10, -1)
    expected, right = np.zeros((10, 10)), np.zeros(10)
    expected[np.ix_(free, free)], right[free] = rows[free] @ rows[free].T, rows[free] @ res.ravel()
    np.testing.assert_allclose(room[:10], expected, atol=1e-12)
    np.testing.assert_allclose(rhs, right, atol=1e-12)
    assert (room[10] == 7.0).all()
