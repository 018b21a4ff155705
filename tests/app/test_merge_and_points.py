"""Several cameras merged by the main job; values at taps and along lines; through the command line."""

from __future__ import annotations

import csv
import shutil

import numpy as np
import pytest

from windmark import io
from windmark.pipeline.simulate_cameras import EXPOSURES, camera_shots, simulate_cameras
from windmark.synth import Sensor


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """Three cameras, small pictures, coarse grid."""
    folder = tmp_path_factory.mktemp("rig")
    return folder, simulate_cameras(folder, 3, 3, size_px=(800, 640), nodes=8000)


@pytest.fixture(scope="module")
def merged(rig, windmark):
    folder, test = rig
    done = windmark("run", folder / "project.toml", "--json")
    assert done.code == 0, done.err
    return folder / "results", done.json, test


def rows(path):
    """A table's comment lines and its rows."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line.startswith("#")], list(csv.DictReader(x for x in lines if x[0] != "#"))


def changed(rig, tmp_path, *edits, without=()):
    """A copy of the test with text of its project file replaced."""
    folder = tmp_path / "copy"
    shutil.copytree(rig[0], folder, ignore=shutil.ignore_patterns("results", *without))
    text = (folder / "project.toml").read_text(encoding="utf-8")
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    (folder / "project.toml").write_text(text, encoding="utf-8")
    return folder


@pytest.mark.slow
def test_all_formats_of_merged_values(merged):
    results, record, test = merged
    names = {p.name for p in (results / "merged").iterdir()}
    assert names >= {"merged.json", "seams.csv", "nodes.vtp", "nodes.dat", "nodes.f", "nodes.csv", "nodes.nc",
                     "view-top.tif", "view-top-sigma.tif", "view-top-source.tif", "view-top.json"}  # fmt: skip
    mesh, fields, units, history = io.read_nodes_netcdf(results / "merged" / "nodes.nc")
    assert set(fields) == {"value", "sigma", "source", "images"}
    assert units["length"] == "mm"
    assert history["images"] == ["cam1", "cam2", "cam3"]
    known = np.isfinite(fields["value"])
    np.testing.assert_array_equal(fields["source"] >= 0, known)
    assert known.sum() == record["merged"][0]["nodes_with_value"]
    assert len(mesh.vertices) == len(test.mesh.vertices)
    top = io.read_image(results / "merged" / "view-top.tif")
    source = io.read_image(results / "merged" / "view-top-source.tif")
    np.testing.assert_array_equal(np.isfinite(top), source > 0)


def test_values_gains_and_seams_against_the_truth(merged):
    results, record, test = merged
    group = record["merged"][0]
    true = np.array(EXPOSURES[:3]) / EXPOSURES[0]
    for k in (1, 2):
        found = group["gain"][f"cam{k + 1}"]
        assert abs(found["gain"] - true[k]) < 5e-3 * true[k]
        assert 0 < found["sigma"] < 5e-3
    level = 4095 - Sensor().black
    truth = level * EXPOSURES[0] * test.shots[0].world.node_intensity()
    _, fields, _, _ = io.read_nodes_netcdf(results / "merged" / "nodes.nc")
    off = np.abs(fields["value"] / truth - 1)
    each = [io.read_nodes_netcdf(results / f"cam{k + 1}" / "nodes.nc")[1]["value"] for k in range(3)]
    for k, values in enumerate(each):
        own = (values - Sensor().black) / (truth * true[k])
        both = np.isfinite(own) & np.isfinite(truth) & (truth > 0)
        assert np.median(off[both]) < np.median(np.abs(own[both] - 1))
    seen = np.any([np.isfinite(v) for v in each], axis=0)
    assert np.isfinite(fields["value"][seen]).all()
    assert group["seams"]["mean_size"] < 1
    assert group["seams"]["nodes"] > 100


def test_taps_of_images_and_merged(merged):
    results, _, _ = merged
    head, table = rows(results / "merged" / "points-taps.csv")
    assert "# length unit: mm" in head
    assert len(table) == 54
    upper = [r for r in table if r["name"].startswith("U")]
    assert all(r["value"] and r["sigma"] and not r["reason"] for r in upper)
    assert all(not r["value"] and "facing_away" in r["reason"] for r in table if r["name"].startswith("L"))
    assert {r["image"] for r in upper} <= {"cam1", "cam2", "cam3"}
    assert max(float(r["moved"]) for r in table) < 0.5  # the grid is coarser than the surface
    for name in ("cam1", "merged"):
        for suffix in (".csv", ".dat", ".nc"):
            text = (results / name / f"points-taps{suffix}").read_bytes()
            assert b"mm" in text
            assert (results / name / f"line-mid-span{suffix}").exists()
    import xarray

    with xarray.open_dataset(results / "merged" / "points-taps.nc", engine="h5netcdf") as data:
        assert data.attrs["length_unit"] == "mm"
        assert data["x"].attrs["units"] == "mm"
        assert [str(n) for n in data["name"].values] == [r["name"] for r in table]
        np.testing.assert_allclose(data["value"].values[:27], [float(r["value"]) for r in upper])
    dat = (results / "merged" / "points-taps.dat").read_text(encoding="utf-8")
    assert '"x [mm]"' in dat
    assert 'AUXDATA name_1 = "U30-03"' in dat
    assert "-9999" in dat


def test_line_has_a_value_at_every_spacing(merged):
    results, _, _ = merged
    head, table = rows(results / "merged" / "line-mid-span.csv")
    assert "# length unit: mm" in head
    arc = np.array([float(r["arc"]) for r in table])
    assert np.allclose(np.diff(arc), arc[-1] / (len(arc) - 1))
    assert abs(np.diff(arc)[0] - 1) < 0.01
    assert all(r["value"] for r in table)


def test_report_shows_it(merged):
    results, _, _ = merged
    page = (results / "report.html").read_text(encoding="utf-8")
    for words in ("Merged images", "The image with the largest", "steps at seams, in sigmas", "Points “taps”",
                  "Values along the line"):  # fmt: skip
        assert words in page


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_an_unregistered_camera_is_named_and_the_others_are_merged(rig, tmp_path, windmark):
    """And points of a polar have a folder each."""
    folder = changed(
        rig, tmp_path, *((f'file = "cam{k}.tif"', f'file = "cam{k}.tif"\npoint = "a2"') for k in (1, 2, 3)),
        ("[[line]]", '[[image]]\nfile = "cam4.tif"\ncamera = "cam1"\npoint = "a4"\n\n[output]\nnodes = ["csv"]\n\n'
         "[[line]]"),
    )  # fmt: skip
    for name in ("cam2.tif", "cam4.tif"):
        io.write_image(folder / name, np.full((640, 800), 700, np.uint16))
    done = windmark("run", folder / "project.toml", "--json")
    assert done.code == 0, done.err
    first, second = done.json["merged"]
    assert (first["point"], first["merged"], second["point"], second["merged"]) == ("a2", True, "a4", False)
    assert list(first["left_out"]) == ["cam2"]
    assert list(first["gain"]) == ["cam1", "cam3"]
    assert "none of them is left (cam4:" in second["reason"]
    assert (folder / "results" / "merged-a2" / "nodes.csv").exists()
    assert [p.name for p in (folder / "results" / "merged-a4").iterdir()] == ["merged.json"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[merge]", '[merge]\nimages = ["cam9"]', "'cam9' is not the name of an image"),
        ("[merge]", '[merge]\nreference = "cam9"', "'cam9' is not the name of an image"),
        ("[merge]", '[merge]\ngain = "auto"', "merge.gain"),
        ("[merge]", '[merge]\ngain = "none"\noffset = true', "offset needs gain"),
        ('file = "cam1.tif"', 'file = "cam1.tif"\npoint = "a"', "cam2 has no point"),
        ('file = "cam1.tif"', 'file = "cam1.tif"\nname = "merged"', "has the name of an image"),
        ('file = "cam2.tif"\ncamera = "cam2"', 'file = "cam2.tif"\ncamera = "cam1"', "both of camera cam1"),
        ('file = "taps.tgts"', 'file = "none.csv"', "points[0].file"),
        ("spacing = 1.0", "spacing = 1.0\nn = 5", "n or spacing"),
        ("spacing = 1.0", "spacing = -1.0", "line[0].spacing"),
    ],
)
def test_wrong_projects_are_refused_before_any_work(rig, tmp_path, windmark, old, new, message):
    folder = changed(rig, tmp_path, (old, new))
    done = windmark("run", folder / "project.toml")
    assert done.code == 2
    assert message in done.err
    assert not (folder / "results").exists()


def test_line_off_the_surface_is_refused(rig, tmp_path, windmark):
    folder = changed(rig, tmp_path, ("start = [", "start = [0, 0, 900] #"))
    done = windmark("run", folder / "project.toml")
    assert done.code == 2
    assert "line mid-span: the surface along the line is" in done.err
    assert "max_distance" in done.err


# --- resect --points -----------------------------------------------------------------------


@pytest.fixture
def resect(merged, tmp_path, windmark):
    """Resect one image at points of a table (text)."""
    results, _, _ = merged

    def run(text, *options, name="points.csv"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return windmark("resect", results.parent / "cam1.tif", "-c", results / "cam1" / "camera.json", "-g",
                        results.parent / "model.grid", "--unit", "mm", "-o", tmp_path / "out", "--nodes", "csv",
                        "--points", path, *options), tmp_path / "out" / "cam1" / f"{path.stem}.csv"  # fmt: skip

    return run


def test_resect_at_points(resect, merged, tmp_path):
    tap = rows(merged[0] / "cam1" / "points-taps.csv")[1][3]
    done, _ = resect(
        f"name,x,y,z,remark\non,{tap['x']},{tap['y']},{tap['z']},a\ninside,150,250,10,b\nfar,0,0,5000,c\n"
        "none,,,,d\n", "--max-distance", "5",
    )  # fmt: skip
    assert done.code == 0, done.err
    head, table = rows(tmp_path / "out" / "cam1" / "points-points.csv")
    assert "# max_distance: 5" in head
    assert [r["reason"] for r in table][2:] == ["far", "no_place"]
    assert table[0]["reason"] == ""
    assert abs(float(table[0]["value"]) - float(tap["value"])) < 1e-3
    assert table[1]["value"] == "" or float(table[1]["moved"]) <= 5
    assert "1 of 4 have a value" in done.out or "2 of 4 have a value" in done.out


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name,x,y,z\n", "no points"),
        ("name,x,y,z\na,1,2,3\na,4,5,6\n", "already on line 2"),
        ("name,x,y\na,1,2\n", "no column 'z'"),
        ("name,x,y,z\n,1,2,3\n", "name is empty"),
        ("name,x,y,z\na,1,2,three\n", "expected a finite number"),
        ("name,x,y,z,nx,ny,nz\na,1,2,3,0,0,0\n", "expected a direction"),
        ("name,x,y,z,role\na,1,2,3,hole\n", "role is 'hole'"),
    ],
)
def test_bad_tables_of_points(resect, text, message):
    done, _ = resect(text)
    assert done.code == 2
    assert message in done.err
    assert "points.csv" in done.err


def test_simulate_several_cameras(tmp_path, windmark):
    assert windmark("simulate", tmp_path / "x", "--cameras", 2, "--deforming", 5).code == 2
    assert not (tmp_path / "x").exists()


def test_camera_shots_are_the_same_for_the_same_seed():
    one, two = (camera_shots(5, 2, size_px=(200, 160), nodes=1000) for _ in range(2))
    for a, b in zip(one.shots, two.shots, strict=True):
        np.testing.assert_array_equal(a.image, b.image)
    assert list(one.cameras) == ["cam1", "cam2"]
