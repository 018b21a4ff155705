"""`windmark deform` with cameras that are not in step, why cameras show few markers, and `windmark laws --compare`."""

import csv
import shutil

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from windmark import io
from windmark.pipeline.simulate_deforming import simulate_deforming

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("all_undrawn")]  # a sequence by cameras that are not in step

FRAMES = 10


def rows(path):
    with open(path, newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("clocks")
    simulate_deforming(folder, 3, FRAMES, (640, 400), clocks=True)
    text = (folder / "deform.toml").read_text()
    (folder / "deform.toml").write_text(text.split("[values]")[0] + '[output]\nfilm = false\nfolder = "deformation"\n')
    return folder


def test_cameras_that_are_not_in_step_measure_the_truth(made, windmark):
    done = windmark("deform", made / "deform.toml", "--json")
    assert done.code == 0
    assert (done.json["frames"], done.json["lost"], done.json["clock"]) == (FRAMES, 0, "cam1")
    assert 0.005 < done.json["cameras"]["cam2"]["max_lag_s"] < 0.017
    table, truth = rows(made / "deformation" / "deformation.csv"), rows(made / "truth" / "states.csv")
    assert [float(r["time_s"]) for r in table] == pytest.approx(np.arange(FRAMES) / 50)
    error = []
    for row, true in zip(table[3:], truth[3:], strict=True):
        rise = sum(float(row[f"wing.bend_{k}"]) for k in (2, 3)) - 528 * float(true["tip_fraction"])
        twist = sum(float(row[f"wing.twist_{k}"]) for k in (1, 2)) - float(true["twist_deg"])
        assert abs(twist) < 5 * float(row["sigma_wing.twist_2"])
        error.append(rise)
    assert np.sqrt(np.mean(np.square(error))) < 0.15  # the nearest pictures: 0.5 mm (benchmarks/deformation_clocks.py)
    lags = [r for r in rows(made / "deformation" / "cameras.csv") if r["camera"] == "cam2"]
    assert {r["reason"] for r in lags} == {""}
    assert max(abs(float(r["lag_s"])) for r in lags) == pytest.approx(done.json["cameras"]["cam2"]["max_lag_s"])
    assert "The instants are the pictures of cam1" in (made / "deformation" / "report.html").read_text(encoding="utf-8")


def test_live_pictures_have_no_clocks(made, windmark, tmp_path):
    done = windmark("deform", made / "deform.toml", "--watch", tmp_path, "--idle", "0.1", "-o", tmp_path / "out")
    assert done.code == 2
    assert "measured from the disk" in done.err


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('times = "cam2-times.csv"', 'times = "none.csv"', "camera[1].times"),
        ('times = "cam2-times.csv"', 'times = "cam2-times.csv"\nrate_hz = 30', "give one of them"),
        ("[sequence]", '[sequence]\nclock = "cam9"', "'cam9' is not the name of a camera"),
        ("[sequence]", "[sequence]\nmax_lag_s = 0", "max_lag_s"),
    ],
)
def test_bad_clocks_name_their_key(made, windmark, tmp_path, old, new, message):
    folder = tmp_path / "t"
    shutil.copytree(made, folder, ignore=shutil.ignore_patterns("deformation*"))
    text = (folder / "deform.toml").read_text()
    assert old in text
    (folder / "deform.toml").write_text(text.replace(old, new, 1))
    done = windmark("deform", folder / "deform.toml")
    assert done.code == 2
    assert message in done.err


def test_why_a_camera_shows_few_markers(made, windmark, tmp_path):
    folder = tmp_path / "t"
    shutil.copytree(made, folder, ignore=shutil.ignore_patterns("deformation*"))

    def spoil(frame, change):
        path = folder / "images" / f"cam1-{frame:04d}.tif"
        image = io.read_image(path)
        io.write_image(path, np.clip(change(image.astype(float)), 0, 4095).astype(image.dtype))

    spoil(4, lambda i: np.full_like(i, 300.0))
    spoil(5, lambda i: uniform_filter1d(i, 25, axis=1))
    spoil(6, lambda i: 200 + np.random.default_rng(0).integers(0, 3, i.shape))
    spoil(8, lambda i: np.full_like(i, 4095.0) - (np.indices(i.shape).sum(axis=0) % 7 == 0) * 200)
    spoil(9, lambda i: np.roll(i, 190, axis=1))
    done = windmark("deform", folder / "deform.toml", "--json")
    assert done.code == 0
    why = {f["frame"]: f["reason"] for f in done.json["cameras"]["cam1"]["few"]}
    expected = {"4": "an empty picture: all pixels are 300", "5": "blurred", "6": "dark: its grey levels span",
                "8": "saturated: ", "9": "its markers are not where they should be"}  # fmt: skip
    assert {k: word in why.get(k, "") for k, word in expected.items()} == dict.fromkeys(expected, True), why
    assert set(why) == set(expected)
    assert not done.json["cameras"]["cam2"]["few"]
    table = rows(folder / "deformation" / "deformation.csv")
    assert [bool(r["few"]) for r in table] == [str(k) in expected for k in range(FRAMES)]
    assert "why so few" in (folder / "deformation" / "report.html").read_text(encoding="utf-8")


def test_laws_are_compared_by_evidence(made, windmark, tmp_path):
    done = windmark("laws", "--compare", made / "deform.toml", "--law", "beam:twist=[2]", "--law", "beam:bend=[2]",
                    "--frames", "4", "--pictures", tmp_path / "laws", "--json")  # fmt: skip
    assert done.code == 0
    assert done.json["winner"] == "beam twist=[2]"  # bending with powers 2 and 3, twist with 2: the truth
    scores = {s["name"]: s for s in done.json["laws"]}
    assert scores["beam (project)"]["parameters"] == scores["beam twist=[2]"]["parameters"] + 1
    assert scores["beam (project)"]["evidence"] < 0 < scores["beam bend=[2]"]["chi2"]
    assert scores["none"]["held_out_px"] > 2 * scores["beam twist=[2]"]["held_out_px"]
    assert done.json["verdict"]["word"] == "good"
    assert sorted(p.name for p in (tmp_path / "laws").iterdir()) == ["laws.csv", "laws.png", "manifest.json"]


def test_laws_that_the_data_cannot_tell_have_no_winner(made, windmark, tmp_path):
    text = (made / "deform.toml").read_text()
    extra = text.replace("[stations]", '[[volume.alternative]]\nlaw = "beam"\n\n[stations]')
    (made / "twice.toml").write_text(extra)
    out = tmp_path / "laws"
    done = windmark("laws", "--compare", made / "twice.toml", "--frames", "2", "--pictures", out, "--json")
    assert done.code == 1
    assert done.json["winner"] is None
    assert "cannot tell beam" in done.json["verdict"]["reason"]


@pytest.mark.parametrize(
    ("law", "message"),
    [("bean", "neither a built-in law"), ("beam:twist", "expected option=value"), ("beam:twist=x", "expected option"),
     ("beam:wist=[2]", "has no option wist")],
)  # fmt: skip
def test_bad_laws_to_compare(made, windmark, law, message):
    done = windmark("laws", "--compare", made / "deform.toml", "--law", law)
    assert done.code == 2
    assert message in done.err
    assert windmark("laws", "--law", "beam").code == 2
