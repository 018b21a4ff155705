"""`refine="template"` in `detect`: nearer to the truth than the bowl, and the fit decides."""

import numpy as np
import pytest

import windmark as wm


def test_nearer_than_the_bowl(scene):
    image, centres = scene
    rms = {}
    for refine in ("bowl", "template"):
        found = wm.detect(image, radius_px=3.0, refine=refine)
        assert len(found) == len(centres)
        error = np.hypot(*(found.xy[:, None] - centres).transpose(2, 0, 1)).min(axis=1)
        rms[refine] = np.sqrt(np.mean(error**2))
    assert rms["template"] < 0.85 * rms["bowl"]


def test_specks_are_smaller_than_markers_however_blurred(draw):
    """Specks of radius 1.1 look as large as SPOT's smallest markers once blurred; their blur is the frame's."""
    rng = np.random.default_rng(0)
    markers = np.stack(np.meshgrid(np.arange(30, 280, 40.0), [30.0, 70.0]), axis=-1).reshape(-1, 2)
    specks = markers + np.array([12.0, 20.0])
    discs = np.vstack([np.column_stack([markers, np.full(len(markers), 3.0)]),
                       np.column_stack([specks, np.full(len(specks), 1.1)])])  # fmt: skip
    image = draw((120, 320), discs, blur=1) + rng.normal(0, 1.0, (120, 320))
    found = wm.detect(image, radius_px=(2.5, 3.3), refine="template")
    assert len(found) == len(markers)
    assert np.hypot(*(found.xy[:, None] - markers).transpose(2, 0, 1)).min(axis=1).max() < 0.1


def test_unknown_photometry_is_named():
    with pytest.raises(ValueError, match="photometry"):
        wm.detect(np.zeros((20, 20)), radius_px=3.0, photometry="negative")
