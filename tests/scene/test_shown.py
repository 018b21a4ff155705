"""How nouns look in a session, as tables of pandas, and arguments that are swapped."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import windmark as wm
from windmark.errors import UsageError
from windmark.geometry.described import numbers
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


@pytest.mark.parametrize(("noun", "words"), [
    (CAMERA, "size px=640 x 480, focal px=800"),
    (wm.Camera((64, 48), 60.0, k1=-0.2, cov=np.eye(14)), "lens=brown k1 -0.2, covariance=yes"),
    (wm.Camera((64, 48), 60.0, lens="fisheye"), "lens=fisheye"),
    (wm.Pose.from_rotvec([0, 0, np.pi / 2], [1.0, -1e-16, 3.0]), "turned deg=(0, 0, 90), translation=(1, 0, 3)"),
    (wm.NodeField.make(np.ones(500), 0.1).with_mode("lamp", np.ones(500)), "known=500, unit=none, modes=lamp"),
    (wm.Tracks(np.arange(300) // 3, np.arange(300) % 3, np.arange(300)), "marks=300, tracks=100, views=3"),
    (wm.SensorModel(np.zeros((40, 50)), 4000.0, 0.5, 4.0), "gain=0.5, saturation=4000, read sigma=2"),
    (wm.Picture("left", np.ones((40, 50)), CAMERA, wm.Pose.identity()), "name=left, size=50 x 40"),
])  # fmt: skip
def test_what_a_noun_says_of_itself(noun, words):
    assert words in repr(noun)
    assert len(repr(noun)) < 250
    assert "array" not in repr(noun)
    assert noun._repr_html_().count("<tr>") >= 3


def test_numbers_have_no_sign_of_nothing():
    assert numbers([-0.0, 1.0, -1e-17, 12345.678]) == "(0, 1, 0, 12346)"


def test_html_is_escaped():
    odd = wm.MarkerSet.make(["a"], np.zeros((1, 3)), length_unit="<b>")
    assert "<b>" not in odd._repr_html_()


def test_tables_of_pandas():
    pytest.importorskip("pandas")
    table = wm.Detections.make([[1.0, 2.0], [3.0, 4.0]], sigma_px=0.1).to_pandas()
    assert table["y"].tolist() == [2.0, 4.0]
    np.testing.assert_allclose(table["sigma_x"], 0.1)
    leaning = wm.Detections.make([[1.0, 2.0]], cov=[[[0.04, 0.03], [0.03, 0.09]]]).to_pandas()
    np.testing.assert_allclose(leaning[["sigma_x", "sigma_y", "rho"]].iloc[0], [0.2, 0.3, 0.5])
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


def test_results_are_tables_and_drawings():
    pytest.importorskip("pandas")
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    rng = np.random.default_rng(1)
    xyz = rng.uniform(-1.0, 1.0, (20, 3)) * [2.0, 1.5, 0.2]
    poses = [wm.Pose.look_at(eye, [0, 0, 0], [0, 1, 0]) for eye in ((-1, 0, 6), (1, 0, 6), (0, 1, 6))]
    spots = [wm.Detections.make(CAMERA.project(pose.apply(xyz))[0].round(2), sigma_px=0.01) for pose in poses]
    known = wm.MarkerSet.make(list("abcdef"), xyz[:6], role="primary")
    views = [wm.View(f"view{i}", cam_from_model=pose) for i, pose in enumerate(poses)]
    found = wm.reconstruct(spots, CAMERA, known, views=views)
    table = found.to_pandas()
    assert table["views"].tolist() == [3] * 20
    np.testing.assert_allclose(table["sigma_z"] ** 2, found.marker_cov[:, 2, 2])
    axes = found.plot()
    assert [len(line.get_data_3d()[0]) for line in axes.lines] == [14, 6, 3]
    pairs = wm.match_pair(spots[0], spots[1], CAMERA)
    assert pairs.to_pandas()["b"].tolist() == pairs.b.tolist()
    assert f"pairs={len(pairs)}" in repr(pairs)
    marks = wm.Observations(np.zeros(2, dtype=int), np.arange(2), np.ones((2, 2)), np.tile(0.04 * np.eye(2), (2, 1, 1)))
    np.testing.assert_allclose(marks.to_pandas()["sigma_x"], 0.2)
    picture = wm.synth.marker_scene(1, size_px=(160, 120), markers=12).image
    aligned = wm.align_images(np.roll(picture, (2, 3), axis=(0, 1)), picture)
    assert "pairs=12" in repr(aligned)
    np.testing.assert_allclose(aligned.to_pandas()["dx"], aligned.residual[:, 0])
    assert "px" in aligned.plot().get_title()
    pyplot.close("all")


def test_of_a_surface_and_its_loads():
    pytest.importorskip("pandas")
    plate = wm.Mesh.make([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]], "wing")
    beside = wm.Pose.look_at([1.4, 0.0, 4.0], [1.4, 0.0, 0.0], [0.0, 1.0, 0.0])
    seen = wm.see_nodes(plate, wm.Camera((64, 48), 60.0), beside)
    assert repr(seen) == "NodeView(nodes=4, visible=2, picture=64 x 48 px)"
    assert seen.to_pandas()["reason"].tolist() == ["outside", "visible", "visible", "outside"]
    loads = wm.integrate_loads(plate, wm.NodeField.make([-0.5] * 4, 0.01), wm.LoadReference(4.0, 2.0, 2.0))
    table = loads.to_pandas()
    assert table.query("volume == 'wing' and coefficient == 'CL'")["value"].iloc[0] == loads.row("wing")["CL"][0]
    assert "wing=CA " in repr(loads)


def test_a_deformation_is_drawn():
    pyplot = pytest.importorskip("matplotlib.pyplot")
    from windmark.scene import plots

    pyplot.switch_backend("agg")
    ax = plots.space_axes(None, np.eye(3))
    plots.space_arrows(ax, np.eye(3), [[0, 0, 0.01]] * 3)
    assert ax.get_title() == "displacements x 10, the longest is 0.01"
    pyplot.close("all")
