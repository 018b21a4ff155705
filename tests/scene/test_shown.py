"""How nouns look in a session, as tables of pandas, and arguments that are swapped."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import windmark as wm
from windmark.errors import UsageError
from windmark.scene.shown import ARRAY, PATH, by_name, check_kinds, list_of, optional, pandas_table

CAMERA = wm.Camera((640, 480), 800.0, 1.0, 319.5, 239.5)


def markers(count: int = 5) -> wm.MarkerSet:
    return wm.MarkerSet.make([f"m{k}" for k in range(count)], np.arange(3.0 * count).reshape(-1, 3))


@pytest.mark.parametrize("noun", [
    markers(2000), wm.Detections.make(np.ones((2000, 2))), wm.Detections.make(np.zeros((0, 2))), markers(0),
    wm.Matching(np.arange(3), np.arange(3), np.zeros(3)),
])  # fmt: skip
def test_reprs_are_short_and_have_no_arrays(noun):
    assert len(repr(noun)) < 200
    assert "array" not in repr(noun)
    assert type(noun).__name__ in repr(noun)
    assert noun._repr_html_().startswith("<table>")


def test_html_is_escaped():
    odd = wm.MarkerSet.make(["a"], np.zeros((1, 3)), length_unit="<b>")
    assert "<b>" not in odd._repr_html_()


def test_tables_of_pandas():
    pytest.importorskip("pandas")
    table = wm.Detections.make([[1.0, 2.0], [3.0, 4.0]], sigma_px=0.1).to_pandas()
    assert table["y"].tolist() == [2.0, 4.0]
    np.testing.assert_allclose(table["sigma_x"], 0.1)
    assert markers(3).to_pandas()["name"].tolist() == ["m0", "m1", "m2"]


def test_without_pandas_it_is_said(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(UsageError, match="pip install pandas"):
        pandas_table({})


def test_swapped_arguments_are_named():
    spots = wm.Detections.make(np.zeros((4, 2)))
    with pytest.raises(UsageError, match="they are swapped; expected register"):
        wm.register(markers(), spots, CAMERA)
    with pytest.raises(UsageError, match=r"camera is a str; expected register"):
        wm.register(spots, markers(), "camera.json")
    check_kinds("verb", a=(1, int))


def test_kinds_that_no_class_says():
    check_kinds("verb", image=([[1.0]], ARRAY), path=(Path("x"), PATH), spots=([], list_of(wm.Detections)))
    check_kinds("verb", camera=(CAMERA, by_name(wm.Camera)), pose=(None, optional(wm.Pose)))
    for kind, value, text in [
        (ARRAY, None, "a is None; expected verb(a: array)"),
        (ARRAY, "run7.tif", "a is a str; expected verb(a: array)"),
        (PATH, 7, "a is an int; expected verb(a: path)"),
        (list_of(wm.Detections), [CAMERA], "a is a list of Camera; expected verb(a: list of Detections)"),
        (by_name(wm.Camera, single=False), CAMERA, "a is a Camera; expected verb(a: dict of Camera)"),
        (optional(wm.Pose), CAMERA, "a is a Camera; expected verb(a: Pose or None)"),
    ]:
        with pytest.raises(UsageError, match=re.escape(text)):
            check_kinds("verb", a=(value, kind))


def test_the_namespace_holds_what_is_public_only():
    assert dir(wm) == sorted(wm.__all__)
    assert not {"importlib", "TYPE_CHECKING", "Any", "annotations"} & set(dir(wm))


def test_fields_pixels_points_and_merged_views_as_datasets_and_tables():
    field = wm.NodeField.make([1.0, 2.0], 0.5, unit="Pa").with_mode("pose", [0.0, 1.0]).to_xarray()
    assert field["value"].attrs["units"] == "Pa"
    assert field["modes"].sel(mode="pose").values.tolist() == [0.0, 1.0]
    np.testing.assert_allclose(field["sigma"], [0.5, np.hypot(0.5, 1.0)])
    square = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    plain = wm.Mesh.make(square, [[0, 1, 2], [0, 2, 3]], volume=["plate", "plate"])
    mesh = replace(plain, length_unit="mm")
    camera, pose = wm.Camera((16, 12), 40.0, 1.0, 7.5, 5.5), wm.Pose.look_at([0, 0, 10.0], [0, 0, 0], [0, 1.0, 0])
    pixels = wm.map_pixels(mesh, camera, pose).to_xarray()
    assert pixels["x"].attrs["units"] == "mm"
    assert str(pixels["volume"][5, 7].item()) == "plate"
    assert np.isnan(pixels["z"][0, 0])
    assert pixels["volume"][0, 0].item() == ""
    image = np.full((12, 16), 100.0)
    pytest.importorskip("pandas")
    table = wm.sample_points(image, camera, pose, mesh, [[0.1, 0.1, 0.0], [0.0, 0.0, 50.0]]).to_pandas()
    assert table["value"][0] == pytest.approx(100.0)
    assert table["reason"][0] == ""
    pictures = [wm.Picture(name, image * k, camera, pose) for name, k in (("a", 1.0), ("b", 2.0))]
    merged = wm.merge_views(mesh, pictures, gain="none")
    assert merged, merged
    assert merged.to_xarray()["values"].sel(picture="b").sizes == {"node": 4}
