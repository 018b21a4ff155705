"""The marker study: its sheets, its bookkeeping, its bound."""

import numpy as np
import pytest

from windmark.detection.detect import REFINEMENTS
from windmark.pipeline.study import StudySettings, bound, examples, match, measure, run_study, study_sheet
from windmark.scene import Detections
from windmark.synth import disc_image
from windmark.synth.degrade import average_blur

SMALL = {"radii_px": (3.0,), "steps": 3, "markers": 25, "methods": ("bowl",)}


@pytest.fixture(scope="module")
def small():
    return run_study(StudySettings(**SMALL))


# --- settings ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("radii_px", ()), ("radii_px", (0.5,)), ("radii_px", (np.nan,)), ("span_px", -0.1), ("span_px", 2.0),
        ("steps", 0), ("markers", 0), ("max_tilt_deg", 90), ("max_tilt_deg", -1), ("blur_passes", -1),
        ("noise_percent", -1), ("noise_percent", np.nan), ("depth", 0), ("depth", 1e5), ("methods", ("guess",)),
        ("seed", -1),
    ],
)  # fmt: skip
def test_a_wrong_setting_is_named(name, value):
    with pytest.raises(ValueError, match=f"^{name} must be"):
        StudySettings(**{name: value})


def test_the_default_is_the_papers_study_with_every_method():
    settings = StudySettings()
    assert settings.radii_px == (2, 3, 4, 5)
    assert settings.grid == (12, 12)
    np.testing.assert_allclose(settings.real_radii(3.0), np.arange(2.5, 3.55, 0.1))
    assert settings.methods == tuple(REFINEMENTS)


@pytest.mark.parametrize("count", [1, 2, 10, 143, 144, 145])
def test_the_sheet_holds_at_least_the_markers_asked_for(count):
    columns, rows = StudySettings(markers=count).grid
    assert count <= columns * rows < count + columns


def test_a_single_step_is_the_reference_radius_itself():
    assert StudySettings(steps=1).real_radii(4.0).tolist() == [4.0]


# --- sheets -----------------------------------------------------------------------------------


def test_same_seed_same_sheet_and_another_seed_another():
    image, truth = study_sheet(StudySettings(**SMALL), 3.0, 1)
    again, same = study_sheet(StudySettings(**SMALL), 3.0, 1)
    other, _ = study_sheet(StudySettings(**SMALL, seed=1), 3.0, 1)
    np.testing.assert_array_equal(image, again)
    np.testing.assert_array_equal(truth.xy, same.xy)
    assert (image != other).any()


def test_a_row_does_not_depend_on_the_rest_of_the_study(small):
    more = run_study(StudySettings(**{**SMALL, "radii_px": (2.0, 3.0)}))
    rows = more.curve(3.0, "bowl")
    for name, values in small.columns().items():
        np.testing.assert_array_equal(more.columns()[name][rows], values, err_msg=name)


def test_figure_3_shows_the_same_markers_twice():
    sharp, noisy = examples(StudySettings(radii_px=(2.0, 3.2), markers=16, steps=3, methods=("bowl",)))
    assert sharp.radius_px == noisy.radius_px == 3.2
    np.testing.assert_array_equal(sharp.truth.xy, noisy.truth.xy)
    assert (sharp.image == sharp.image.max()).mean() > 0.9  # no noise on the surface
    assert noisy.image[:4].std() == pytest.approx(np.hypot(4.5, np.sqrt(1 / 12)), rel=0.1)
    assert len(noisy.spots["bowl"]) == 16


@pytest.mark.parametrize(("noise_percent", "depth"), [(3, 150), (30, 150), (100, 5000)])
def test_noise_is_never_cut_off_at_black_and_images_have_whole_grey_levels(noise_percent, depth):
    image, truth = study_sheet(StudySettings(**SMALL, noise_percent=noise_percent, depth=depth), 3.0, 0)
    assert image.dtype == np.uint16
    assert 0 < image.min() < image.max() < 65535
    assert truth.noise == pytest.approx(noise_percent / 100 * depth)


# --- bookkeeping ------------------------------------------------------------------------------


def test_errors_are_detected_minus_true_and_counted_within_the_reference_radius():
    _, truth = study_sheet(StudySettings(**SMALL), 3.0, 1)
    xy = truth.xy.copy()
    xy[:, 0] += 0.02
    xy[:10, 1] += 0.3
    xy[24] += (0.0, 3.1)  # too far: a marker missed and a false spot
    xy = np.vstack([xy, xy[3] + (1.5, 0.0), (1.0, 1.0)])  # a second spot on a marker, and one on none
    order = np.random.default_rng(0).permutation(len(xy))
    row = measure(Detections.make(xy[order]), truth, np.full((25, 2), 0.01), 3.0)
    assert (row["markers"], row["missed"], row["false_spots"]) == (25, 1, 3)
    assert row["bias_x_px"] == pytest.approx(0.02)
    assert row["rms_x_px"] == pytest.approx(0.02)
    assert row["bias_y_px"] == pytest.approx(0.3 * 10 / 24)
    assert row["rms_y_px"] == pytest.approx(0.3 * np.sqrt(10 / 24))
    assert row["rms_px"] == pytest.approx(np.sqrt((0.02**2 + 0.09 * 10 / 24) / 2))
    assert row["two_rms_px"] == pytest.approx(2 * row["rms_px"])


def test_the_bound_of_the_found_markers_leaves_out_the_missed_ones():
    _, truth = study_sheet(StudySettings(**SMALL), 3.0, 1)
    variance = np.full((25, 2), 0.01)
    variance[0] = 0.09, 0.25
    row = measure(Detections.make(truth.xy[1:]), truth, variance, 3.0)
    assert row["crlb_found_px"] == pytest.approx(0.1)
    assert row["crlb_px"] == pytest.approx(np.sqrt((48 * 0.01 + 0.34) / 50))


def test_nothing_found_has_no_error_and_all_missed():
    _, truth = study_sheet(StudySettings(**SMALL), 3.0, 1)
    found, error = match(Detections.make(np.empty((0, 2))), truth, 3.0)
    assert not found.any()
    assert error.shape == (25, 2)
    row = measure(Detections.make(np.empty((0, 2))), truth, np.full((25, 2), 0.01), 3.0)
    assert row["missed"] == 25
    assert all(np.isnan(row[key]) for key in ("rms_x_px", "rms_px", "two_rms_px", "bias_y_px", "crlb_found_px"))
    assert row["crlb_px"] == pytest.approx(0.1)


def test_the_summary_pools_markers_not_points(small):
    (row,) = small.summary()
    found = small.markers - small.missed
    assert row["two_rms_px"] == pytest.approx(2 * np.sqrt(np.average(small.rms_px**2, weights=found)))
    assert row["worst_two_rms_px"] == small.two_rms_px.max()
    assert row["markers"] == 75
    assert row["rms_over_crlb"] == pytest.approx(row["two_rms_px"] / row["two_crlb_px"])


def test_a_study_in_which_nothing_is_found_has_empty_figures_and_no_warning():
    study = run_study(StudySettings(**{**SMALL, "noise_percent": 300.0, "steps": 1}))
    (row,) = study.summary()
    assert row["missed"] == 25
    assert np.isnan([row["two_rms_px"], row["worst_two_rms_px"], row["rms_over_crlb"]]).all()


def test_every_method_sees_the_same_sheet(small):
    study = run_study(StudySettings(**{**SMALL, "methods": REFINEMENTS}))
    for method in REFINEMENTS:
        np.testing.assert_array_equal(study.crlb_px[study.curve(3.0, method)], small.crlb_px)


# --- the bound --------------------------------------------------------------------------------


def numeric_bound(truth, k, settings, known):
    """(2,) variances of x and y of marker k: differences of the study's own images, as slow as can be."""
    half, step = int(np.ceil(truth.axes_px.max() + 4.5 * settings.blur_px + 1)), 0.02
    rim = settings.blur_passes + 1  # where the blur's mirrored border is felt
    half += rim
    size = 2 * half + 1
    c, s = np.cos(truth.angle[k]), np.sin(truth.angle[k])
    turn = np.array([[c, -s], [s, c]])
    matrix = turn @ np.diag(truth.axes_px[k]) @ turn.T
    level = settings.depth * (4 / 3 + 5 * settings.noise_percent / 100)
    start = np.array([*(half + truth.xy[k] - np.rint(truth.xy[k])), matrix[0, 0], matrix[0, 1], matrix[1, 1],
                      settings.depth, level, 0.0, 0.0])  # fmt: skip

    def image(p):
        axes, vectors = np.linalg.eigh([[p[2], p[3]], [p[3], p[4]]])
        disc = disc_image((size, size), p[:2], axes[::-1], np.arctan2(vectors[1, 1], vectors[0, 1]),
                          level=p[6], depth=p[5], slope=(p[7], p[8]), subpixels=15)  # fmt: skip
        return average_blur(disc, settings.blur_passes)[rim:-rim, rim:-rim]

    steps = np.array([step] * 5 + [1.0, 1.0, 1e-4, 1e-4])
    columns = [(image(start + h) - image(start - h)).ravel() for h in np.diag(steps)]
    j = np.delete(np.stack(columns, axis=1) / (2 * steps), known, axis=1)
    return np.diag(np.linalg.inv(j.T @ j))[:2] * settings.noise**2


@pytest.mark.parametrize(("r0", "blur_passes"), [(2.0, 1), (3.0, 0), (3.0, 1), (5.0, 2)])
def test_the_bound_is_that_of_the_studys_own_images(r0, blur_passes):
    settings = StudySettings(radii_px=(r0,), steps=1, markers=9, blur_passes=blur_passes)
    _, truth = study_sheet(settings, r0, 0)
    variance = bound(settings, truth)
    assert variance.shape == (9, 2)
    same = np.array([numeric_bound(truth, k, settings, known=[2, 3, 4]) for k in (0, 4, 7)])
    np.testing.assert_allclose(np.sqrt(variance[[0, 4, 7]]), np.sqrt(same), rtol=0.01)
    unknown_ellipse = np.array([numeric_bound(truth, k, settings, known=[]) for k in (0, 4, 7)])
    assert (unknown_ellipse > 0.999 * same).all()
    assert (unknown_ellipse < 1.06 * same).all()


def test_the_bound_is_proportional_to_noise_over_depth():
    settings = [StudySettings(radii_px=(3.0,), steps=1, markers=4, noise_percent=n, depth=5000) for n in (1, 10)]
    low, high = (bound(s, study_sheet(s, 3.0, 0)[1]) for s in settings)
    # The level of the surface follows the noise, and with it a little of what the slope costs.
    np.testing.assert_allclose(np.sqrt(high / low), 10, rtol=0.02)


def test_the_bound_is_larger_along_the_tilted_axis_and_for_rounding():
    settings = StudySettings(radii_px=(3.0,), steps=1)
    _, truth = study_sheet(settings, 3.0, 0)
    variance = bound(settings, truth)
    tilted = truth.tilt_deg > 45
    along_x = np.abs(np.cos(truth.angle)) > 0.9  # the long axis lies along x
    assert (variance[tilted & along_x, 1] < variance[tilted & along_x, 0]).all()
    assert variance[tilted].mean() > 1.2 * variance[~tilted].mean()
    shallow = StudySettings(radii_px=(3.0,), steps=1, depth=5.0)
    assert (bound(shallow, truth_of(shallow)) > 3 * variance).all()


def truth_of(settings):
    return study_sheet(settings, 3.0, 0)[1]
