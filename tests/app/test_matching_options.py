"""What the user may say about the matching: time, roles, prior, pixels that are used."""

import json

import numpy as np
import pytest

from windmark import io
from windmark.geometry import Pose

pytestmark = pytest.mark.usefixtures("all_undrawn")


@pytest.fixture
def arguments(virtual_test):
    """``arguments("register", "wind-off.tif", ...)``: with the table, the camera and the radius of the virtual test."""
    folder, _ = virtual_test

    def given(verb, *images):
        files = [folder / name for name in images]
        return [verb, *files, "-m", folder / "markers.csv", "-c", folder / "camera.json", "-r", 4, "--unit", "mm"]

    return given


@pytest.mark.slow
def test_align_leaves_the_walls_out_unless_told(windmark, arguments, virtual_test, tmp_path):
    folder, _ = virtual_test
    call = [*arguments("align", "wind-off.tif", "wind-on.tif"), "--reference", "wind-off", "-g", folder / "model.grid"]
    plain = windmark(*call, "-o", tmp_path / "plain", "--json")
    assert plain.code == 0
    assert plain.json["options"]["markers"]["roles"] == ["model", "primary", "secondary"]
    assert plain.json["images"][1]["registration"]["rms_px"] < 0.03
    walls = windmark(*call, "-o", tmp_path / "walls", "--roles", "model", "--roles", "wall", "--json")
    assert walls.json["markers"] > plain.json["markers"]
    # The model has moved against the walls: with both, that is a deformation of what the walls hold.
    assert "deformation" not in plain.json["images"][1]["registration"]
    assert walls.json["images"][1]["registration"]["deformation"]["largest_px"] > 0.5


@pytest.mark.slow
def test_roles_and_time_of_register_and_run(windmark, arguments, virtual_test, tmp_path):
    folder, _ = virtual_test
    call = [*arguments("register", "wind-off.tif"), "-o", tmp_path / "out"]
    wall = windmark(*call, "--roles", "wall", "--json")
    assert wall.code == 1
    assert "no image could be used" in wall.json["error"]
    assert wall.json["options"]["markers"]["roles"] == ["wall"]
    nobody = windmark(*call, "--roles", "secondary")
    assert nobody.code == 2
    assert "secondary" in nobody.err
    late = windmark(*call, "--max-time", "1e-6", "--json")
    assert late.code == 1
    assert "max_time_s = 1e-06" in late.json["images"][0]["registration"]["reason"]
    late = windmark("run", folder / "project.toml", "-o", tmp_path / "run", "--max-time", "1e-6", "--roles", "model")
    assert late.code == 1
    assert "max_time_s = 1e-06" in late.err
    assert windmark(*call, "--max-time", "0").code == 2
    assert "markers.roles" in windmark(*call, "--roles", "wing").err


def test_prior_with_its_limits(windmark, arguments, tmp_path):
    done = windmark(*arguments("register", "wind-off.tif"), "-o", tmp_path / "cold", "--json")
    camera, pose = io.read_camera(tmp_path / "cold" / "wind-off" / "camera.json")
    turned = Pose.from_rotvec([0, 0, 0.35], [0, 0, 0]) @ pose
    io.write_camera(tmp_path / "prior.json", camera, turned, unit="mm")
    call = [*arguments("register", "wind-off.tif"), "--prior", tmp_path / "prior.json"]
    near = windmark(*call, "-o", tmp_path / "near", "--json")
    assert near.json["images"][0]["registration"]["matched"] == done.json["images"][0]["registration"]["matched"]
    far = windmark(*call, "--prior-max-angle", 10, "-o", tmp_path / "far", "--json")
    assert far.code == 1
    assert "prior" in far.json["images"][0]["registration"]["reason"]
    assert windmark(*call, "--prior-max-scale", 1, "-o", tmp_path / "no").code == 2
    record = json.loads((tmp_path / "near" / "summary.json").read_text())
    assert record["options"]["register"]["prior_max_scale"] == 1.3


def test_masked_spots_are_not_used(windmark, arguments, tmp_path):
    table = tmp_path / "left.csv"
    table.write_text("x,y\n-0.5,-0.5\n640,-0.5\n640,800\n-0.5,800\n")
    done = windmark(*arguments("register", "wind-off.tif"), "--mask", table, "-o", tmp_path / "out", "--json")
    whole = windmark(*arguments("register", "wind-off.tif"), "-o", tmp_path / "all", "--json")
    assert 0 < done.json["images"][0]["spots"] < whole.json["images"][0]["spots"]


@pytest.mark.slow
def test_labels_and_exclusions_by_place(windmark, arguments, tmp_path):
    call = [*arguments("register", "wind-off.tif"), "-o", tmp_path / "out"]
    assert windmark(*call).code == 0
    matches = io.read_matches(tmp_path / "out" / "wind-off" / "matches.csv")
    names, xy = matches.name.tolist(), matches.xy
    right = [part for k in (0, 1, 2) for part in ("--label", f"{names[k]}={xy[k, 0] + 2:.1f},{xy[k, 1]:.1f}")]
    away = ["--exclude", f"{xy[5, 0]:.1f},{xy[5, 1]:.1f}"]
    done = windmark(*call, *right, *away, "--json")
    labels = done.json["images"][0]["registration"]["labels"]
    assert set(names[:3]) <= set(labels)
    assert names[5] not in labels

    wrong = windmark(*call, "--label", f"{names[0]}={xy[1, 0]:.1f},{xy[1, 1]:.1f}")
    assert wrong.code == 1
    assert f"takes the spot for {names[1]}" in wrong.err
    none = windmark(*call, "--label", f"{names[0]}=1,1")
    assert none.code == 1
    assert "no spot within 10 px of (1, 1); the nearest is" in none.err
    for option, words in (
        (["--label", "x"], "NAME=x,y"),
        (["--label", "nobody=1,2"], "nobody"),
        (["--label", f"{names[0]}=1"], "NAME=x,y"),
        (["--label", "a=1,2", "--label", "a=3,4"], "twice"),
        (["--exclude", "1;2"], "x,y"),
    ):
        bad = windmark(*call, *option)
        assert bad.code == 2
        assert words in bad.err


def test_labels_of_a_project(windmark, virtual_test, tmp_path):
    folder, _ = virtual_test
    text = (folder / "project.toml").read_text().replace('file = "', f'file = "{folder}/')
    changed = text.replace("[[image]]", "[[image]]\nlabels = { nobody = [10, 20] }\nexclude = [[3, 4]]", 1)
    assert changed != text
    (tmp_path / "project.toml").write_text(changed)
    done = windmark("run", tmp_path / "project.toml")
    assert done.code == 2
    assert "image[0].labels.nobody" in done.err


@pytest.mark.slow
def test_align_and_resect_take_the_volumes_as_run_does(windmark, arguments, virtual_test, tmp_path):
    """The walls of the grid are dragged along with the model unless the zones say what the model is."""
    from windmark.pipeline.simulate import zones_of

    folder, test = virtual_test
    zones = {n: z for n, z in zones_of(test.mesh).items() if n != "wall"}
    volumes = [a for n, z in zones.items() for a in ("--volume", f"{n}={','.join(z)}")]
    call = [*arguments("align", "wind-off.tif", "wind-on.tif"), "--reference", "wind-off", "-g", folder / "model.grid"]
    seen = {}
    for name, more in (("all", []), ("blank", volumes), ("keep", [*volumes, "--background", "keep"])):
        done = windmark(*call, *more, "-o", tmp_path / name, "--json")
        assert done.code == 0, done.err
        seen[name] = io.read_image(tmp_path / name / "wind-on" / "aligned.tif")
    assert done.json["options"]["grid"]["volumes"] == zones
    is_model = np.isin(test.mesh.volume, list(zones))
    off = test.shot("wind-off").perfect
    wall = (off.triangle >= 0) & ~is_model[off.triangle]
    raw = io.read_image(folder / "wind-on.tif").astype(np.float32)
    assert np.isnan(seen["blank"][wall]).mean() > 0.99
    kept = wall & np.isfinite(seen["keep"])
    assert kept.sum() > 0.9 * wall.sum()
    np.testing.assert_array_equal(seen["keep"][kept & np.isnan(seen["blank"])], raw[kept & np.isnan(seen["blank"])])
    both = np.isfinite(seen["blank"]) & np.isfinite(seen["all"])
    assert np.median(np.abs(seen["blank"][both] - seen["all"][both])) == 0

    run = windmark("run", folder / "project.toml", "-o", tmp_path / "run", "--json")
    posed = tmp_path / "run" / "wind-off" / "camera.json"
    step = windmark("resect", folder / "wind-off.tif", "-c", posed, "-g", folder / "model.grid", "--unit", "mm",
                    *volumes, "-o", tmp_path / "step", "--nodes", "csv", "--json")  # fmt: skip
    assert step.code == 0, step.err
    for key in ("nodes_visible", "nodes_with_value"):
        assert step.json["images"][0][key] == run.json["images"][0][key]


@pytest.mark.parametrize(
    ("volumes", "words"),
    [
        (["=zone01"], "--volume: expected NAME=zone01,zone02 or the name of a zone, got '=zone01'"),
        (["wing="], "--volume: expected NAME=zone01"),
        (["wing=zone01,,zone02"], "--volume: expected NAME=zone01"),
        (["wing=zone01", "wing=zone02"], "--volume: wing is given twice"),
        (["wing=zone01", "tail=zone01"], "a zone belongs to one volume, given more than once: zone01"),
        (["wing=zone77"], "the file has no zone zone77; it has zone01, zone02"),
        (["wing"], "the file has no zone wing; it has"),
    ],
)
def test_volumes_that_cannot_be_are_refused(windmark, arguments, virtual_test, tmp_path, volumes, words):
    folder, _ = virtual_test
    options = [a for v in volumes for a in ("--volume", v)]
    done = windmark(*arguments("align", "wind-off.tif"), "--reference", "wind-off", "-g", folder / "model.grid",
                    *options, "-o", tmp_path / "out")  # fmt: skip
    assert done.code == 2
    assert words in done.err
    assert not (tmp_path / "out").exists()


def test_a_background_that_is_none_is_refused(windmark, arguments, virtual_test, tmp_path):
    folder, _ = virtual_test
    done = windmark(*arguments("align", "wind-off.tif"), "--reference", "wind-off", "-g", folder / "model.grid",
                    "--background", "black", "-o", tmp_path / "out")  # fmt: skip
    assert done.code == 2
    assert "align.background" in done.err
    assert "'blank' or 'keep'" in done.err


def test_a_table_in_another_unit_than_the_project_is_refused(virtual_test, tmp_path, windmark):
    folder, _ = virtual_test
    done = windmark("convert", folder / "markers.csv", tmp_path / "inch.csv", "--unit", "mm", "--to-unit", "in")
    assert done.code == 0
    done = windmark("register", folder / "wind-off.tif", "-m", tmp_path / "inch.csv", "-c", folder / "camera.json",
                    "-r", 4, "--unit", "mm", "-o", tmp_path / "out")  # fmt: skip
    assert done.code == 2
    assert "its lengths are in in, --unit is mm" in done.err
    assert not (tmp_path / "out").exists()
