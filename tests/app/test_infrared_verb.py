"""`windmark infrared` on a simulated run: against its truth, stopped and resumed, and each kind of mistake."""

import csv
import json
import shutil

import numpy as np
import pytest

from windmark import io
from windmark.pipeline.simulate_infrared import simulate_infrared
from windmark.synth.heated import heated_test
from windmark.tasks.infrared import CURVED, LATE, LATERAL

DOUBTFUL = LATE | LATERAL | CURVED

WHOLE_GRIDS = True  # see `quick_pictures`


@pytest.fixture(scope="module")
def heated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("heated") / "test"
    folder.mkdir()
    simulate_infrared(folder, 11, 12, (480, 384))
    return folder


@pytest.fixture
def copied(heated, tmp_path):
    return shutil.copytree(heated, tmp_path / "test")


@pytest.fixture(scope="module")
def coarse(tmp_path_factory):
    """The grid with a third of its nodes."""
    path = tmp_path_factory.mktemp("coarse") / "model.grid"
    io.write_mesh(path, heated_test(11, frames=12, size_px=(480, 384), nodes=6_000).test.mesh)
    return path


@pytest.fixture
def light(copied, coarse):
    """The run on a coarse grid, for what is not held against the truth at the nodes."""
    shutil.copy(coarse, copied / "model.grid")
    return copied


def rows(path):
    with open(path, newline="") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


def replaced(path, *pairs):
    text = path.read_text()
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    path.write_text(text)


def short(folder, last):
    """Only the first frames, by one camera, the zero of one frame: quick."""
    for file in (folder / "images").iterdir():
        if int(file.stem[-4:]) > last:
            file.unlink()
    text = (folder / "infrared.toml").read_text()
    one, _, rest = text.partition("# This one's are counts")
    text = one + rest[rest.index("# Plugs") :]
    assert 'zero = ["0", "1", "2"]' in text
    (folder / "infrared.toml").write_text(text.replace('zero = ["0", "1", "2"]', 'zero = ["0"]'))


def cold(folder, last=2):
    """Only the first frames, by one camera, and temperatures without a heat flux."""
    short(folder, last)
    text = (folder / "infrared.toml").read_text()
    (folder / "infrared.toml").write_text(text[: text.index("[heat]")] + text[text.index("[[points]]") :])


def results(folder):
    """Every file of a result but what names times."""
    return {
        str(p.relative_to(folder)): p.read_bytes()
        for p in sorted(folder.rglob("*"))
        if p.is_file() and p.suffix in (".csv", ".vtp", ".pvd")
    }


@pytest.mark.slow
def test_a_simulated_run_comes_out_as_it_is_true(windmark, heated, tmp_path):
    done = windmark("infrared", heated / "infrared.toml", "--output", tmp_path / "out", "--json")
    assert done.code == 0, done.err
    assert [r["status"] for r in done.json["results"]] == ["reduced"] * 12
    inside_T, inside_q, count = [], [], 0
    for of in done.json["results"]:
        found = io.read_nodes_netcdf(tmp_path / "out" / "frames" / f"{of['frame']}.nc")[1]
        true = io.read_nodes_netcdf(heated / "truth" / f"{of['frame']}.nc")[1]
        off = found["temperature"] - true["temperature"]
        seen = np.isfinite(off)
        assert seen.sum() > 4_000
        inside_T.append(np.abs(off / found["sigma_temperature"])[seen] < 1.96)
        assert np.median(np.abs(off[seen])) < 0.15
        off = found["heat_flux"] - true["heat_flux"]
        on = np.isfinite(off) & (found["flags"].astype(int) & DOUBTFUL == 0)
        assert on.any() == (of["time_s"] > 0.28)
        inside_q.append(np.abs(off / found["sigma_heat_flux"])[on] < 1.96)
        count += int(on.sum())
        if of["time_s"] > 0.5:
            assert np.sqrt(np.mean(off[on] ** 2)) < 0.15 * np.nanmean(true["heat_flux"])
    assert 0.9 < np.concatenate(inside_T).mean() <= 1
    assert 0.92 < np.concatenate(inside_q).mean() < 0.995
    assert count > 5 * 4_000
    points = rows(tmp_path / "out" / "points-points.csv")
    assert len(points) == 6 * 12
    assert sum(bool(p["heat_flux_W_m2"]) for p in points) >= 6 * 5
    assert {p["flags"] for p in points if float(p["time_s"]) < 0.28} == {"before the heating began"}
    table = rows(tmp_path / "out" / "frames.csv")
    assert [r["cameras"] for r in table] == ["cam1 cam2"] * 12
    assert (tmp_path / "out" / "run.pvd").read_text().count("DataSet") == 12
    assert 'timestep="0.35"' in (tmp_path / "out" / "run.pvd").read_text()
    html = (tmp_path / "out" / "report.html").read_text()
    assert html.count("<img") >= 12
    assert not done.json["not_drawn"]
    shares = dict(done.json["results"][-1]["causes"]["T"])
    assert shares["emissivity"] > shares["noise"]


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_run_that_was_stopped_goes_on_with_the_same_bytes(windmark, light, tmp_path, monkeypatch):
    from windmark.pipeline.infrared import run as job

    short(light, 7)
    whole, stopped = tmp_path / "whole", tmp_path / "stopped"
    assert windmark("infrared", light / "infrared.toml", "-o", whole).code == 0
    one_frame = job.one_frame

    def breaks(run, store, frame, images):
        if frame.key == "5":
            raise KeyboardInterrupt
        return one_frame(run, store, frame, images)

    monkeypatch.setattr(job, "one_frame", breaks)
    ended = windmark("infrared", light / "infrared.toml", "-o", stopped)
    assert ended.code == 130
    assert "5 frames are kept" in ended.err
    monkeypatch.undo()
    again = windmark("infrared", light / "infrared.toml", "-o", stopped, "--resume", "--json")
    assert again.code == 0, again.err
    assert results(stopped) == results(whole)
    assert not list(stopped.glob(".windmark*"))


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_bad_frames_stop_no_others_and_leave_gaps_that_are_flagged(windmark, copied):
    short(copied, 11)
    bright = io.read_grey(copied / "images" / "cam1-0004.tif")
    clipped = np.minimum(bright, int(np.percentile(bright, 80))).astype(np.uint16)
    io.write_image(copied / "images" / "cam1-0004.tif", clipped)
    (copied / "images" / "cam1-0007.tif").write_bytes(b"II*\0nothing")
    io.write_image(copied / "images" / "cam1-0009.tif", np.full_like(bright, 29000))
    done = windmark("infrared", copied / "infrared.toml", "--json")
    assert done.code == 0, done.err
    said = {r["frame"]: (r["status"], r["reason"]) for r in done.json["results"]}
    for frame, words in {"4": "are saturated", "7": "cam1-0007.tif", "9": "the model was not found"}.items():
        assert said[frame][0] == "failed", said[frame]
        assert words in said[frame][1], said[frame]
        assert "\n" not in said[frame][1]
    assert sum(status == "reduced" for status, _ in said.values()) == 9
    place = copied / "infrared" / "frames"
    after, true = (io.read_nodes_netcdf(p)[1] for p in (place / "11.nc", copied / "truth" / "11.nc"))
    off = (after["heat_flux"] - true["heat_flux"]) / after["sigma_heat_flux"]
    on = np.isfinite(off) & (after["flags"].astype(int) & DOUBTFUL == 0)
    assert on.sum() > 3_000
    assert np.mean(np.abs(off[on]) < 1.96) > 0.85


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_frames_that_repeat_the_one_before_are_gaps_and_told(windmark, copied):
    short(copied, 11)
    for k in (5, 8):
        shutil.copy(copied / "images" / f"cam1-{k - 1:04d}.tif", copied / "images" / f"cam1-{k:04d}.tif")
    done = windmark("infrared", copied / "infrared.toml", "--json")
    assert done.code == 0, done.err
    failed = {r["frame"]: r["reason"] for r in done.json["results"] if r["status"] == "failed"}
    assert [*failed] == ["5", "8"]
    assert set(failed.values()) == {"cam1: its picture repeats the one before: the camera dropped a frame, and it does "
                                    "not count"}  # fmt: skip
    assert done.json["verdict"]["word"] == "doubtful"
    assert "2 of 12 pictures of cam1 repeat the one before" in done.json["verdict"]["reason"]
    after, true = (io.read_nodes_netcdf(p / "11.nc")[1] for p in (copied / "infrared" / "frames", copied / "truth"))
    off = (after["heat_flux"] - true["heat_flux"]) / after["sigma_heat_flux"]
    on = np.isfinite(off) & (after["flags"].astype(int) & DOUBTFUL == 0)
    assert np.mean(np.abs(off[on]) < 1.96) > 0.85


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_heating_that_began_before_its_start_is_told(windmark, light):
    short(light, 9)
    replaced(light / "infrared.toml", ("start_s = 0.28", "start_s = 0.42"))
    done = windmark("infrared", light / "infrared.toml", "--json")
    assert done.code == 0, done.err
    assert any("rises by" in r and "before heat.start_s" in r for r in done.json["remarks"]), done.json["remarks"]


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_without_walls_there_are_temperatures_and_their_mean(windmark, copied):
    cold(copied, 5)
    # Of single pixels: the noise of a whole cell of them hardly shows beside what stays from frame to frame.
    replaced(copied / "infrared.toml", ("[[points]]", '[sampling]\nvalues = "linear"\n\n[[points]]'))
    done = windmark("infrared", copied / "infrared.toml", "--json")
    assert done.code == 0, done.err
    assert "median_heat_flux" not in done.json["results"][-1]
    mean = io.read_nodes_netcdf(copied / "infrared" / "frames" / "mean.nc")[1]
    one = io.read_nodes_netcdf(copied / "infrared" / "frames" / "3.nc")[1]
    true = io.read_nodes_netcdf(copied / "truth" / "3.nc")[1]["temperature"]
    on = np.isfinite(mean["temperature"])
    assert "heat_flux" not in mean
    # Noise goes with the root of six frames; what pixels are still unequal by does not, nor the lens's blur.
    assert np.std((mean["temperature"] - true)[on]) < 0.92 * np.nanstd(one["temperature"] - true)
    assert np.mean(np.abs(mean["temperature"] - true)[on] < 1.96 * mean["sigma_temperature"][on]) > 0.9
    assert done.json["mean"]["frames"] == 6


MISTAKES = {
    "the start is not between the frames": (
        [("start_s = 0.28", "start_s = 28")], "heat.start_s: is 28, the frames are from 0 to"),
    "the wall is too thin": (
        [("thickness_mm = 12", "thickness_mm = 0.05")], "the back of this semi-infinite wall is felt from"),
    "a conductivity in W / cm K": (
        [("conductivity_W_mK = 0.2", "conductivity_W_mK = 0.002")], "is in another unit than its key says"),
    "degrees Celsius": ([("surroundings_K = ", "surroundings_K = 15.2 # ")], "expected a temperature in kelvin"),
    "a wall of no volume": ([('volumes = ["wing"]', 'volumes = ["flap"]')], "no part of the grid is called 'flap'"),
    "no wall": ([("[heat]\nstart_s = 0.28\n", "")], "heat and wall belong together"),
    "no calibration": ([('black_bodies = "calibration/black-bodies-cam2.csv"\n', "")], "counts need black_bodies"),
    "no noise": ([('even = ["calibration/cold-cam1-*.tif", "calibration/warm-cam1-*.tif"]\n', "")],
                 "nothing says the noise"),
    "no even pictures": ([("cold-cam1", "colt-cam1")], "camera[0].even: no file matches 'calibration/colt-cam1-*.tif'"),
    "an unknown key": ([("emissivity_sigma", "emisivity = 1\nemissivity_sigma")], "unknown key"),
    "a rate that the table contradicts": ([('frames = "frames.csv"', 'frames = "frames.csv"\nrate_hz = 2000')],
                                          "one of them is wrong, or time_s is not in seconds"),
}  # fmt: skip


@pytest.mark.parametrize("what", MISTAKES)
def test_a_mistake_in_the_project_is_one_sentence(windmark, copied, what):
    pairs, words = MISTAKES[what]
    replaced(copied / "infrared.toml", *pairs)
    done = windmark("infrared", copied / "infrared.toml")
    assert done.code == 2, done.out
    told = [line for line in done.err.splitlines() if line.startswith("windmark")]
    assert words in told[-1], done.err
    assert "infrared.toml" in told[-1] or "frames.csv" in told[-1]
    assert not (copied / "infrared").exists()


def test_frames_in_the_wrong_order_of_time_are_named(windmark, copied):
    table = (copied / "frames.csv").read_text()
    (copied / "frames.csv").write_text(table.replace("\n5,0.25\n", "\n5,0.15\n"))
    done = windmark("infrared", copied / "infrared.toml")
    assert done.code == 2
    assert "frames.csv" in done.err
    assert "frame 5 at 0.15 s is not after frame 4 at 0.2 s" in done.err
    (copied / "frames.csv").write_text(table.replace("\n5,0.25\n", "\n"))
    done = windmark("infrared", copied / "infrared.toml")
    assert done.code == 2
    assert "nothing says when frame 5 was taken" in done.err


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_an_emissivity_table_that_lacks_angles_leaves_nodes_without_values(windmark, light):
    cold(light)
    replaced(light / "infrared.toml", ("[surface]\nemissivity = 0.", '[surface]\ntable = "emissivity.csv"\n# '))
    io.write_table(light / "emissivity.csv", {"angle_deg": np.array([0.0, 20.0]), "emissivity": np.array([0.9, 0.9])})
    done = windmark("infrared", light / "infrared.toml", "--json")
    assert done.code == 0, done.err
    said = "% of the nodes that it shows have no temperature: seen under an angle that the emissivity's table does not"
    assert all(said in r["remarks"][0] for r in done.json["results"])
    few = done.json["results"][0]["seen"]
    io.write_table(light / "emissivity.csv", {"angle_deg": np.array([0.0, 60.0]), "emissivity": np.array([0.9, 0.9])})
    done = windmark("infrared", light / "infrared.toml", "--json")
    assert done.code == 0, done.err
    assert done.json["results"][0]["seen"] > few + 0.02
    assert done.json["results"][0]["remarks"] == []


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_numbers_that_the_calibration_is_not_of_are_told(windmark, light):
    cold(light)
    replaced(light / "infrared.toml", ("scale = 0.01", "scale = 0.001"))
    done = windmark("infrared", light / "infrared.toml", "--json")
    assert done.code == 1
    assert "beyond the camera's calibration" in done.json["results"][0]["reason"]
    assert "units are mixed" in done.json["results"][0]["reason"]


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_model_that_no_camera_shows_is_told(windmark, light):
    cold(light)
    for file in (light / "images").glob("*.tif"):
        io.write_image(file, np.random.default_rng(1).normal(28900, 3, (384, 480)).astype(np.uint16))
    done = windmark("infrared", light / "infrared.toml")
    assert done.code == 2
    assert "no wind-off frame can be used" in done.err
    replaced(light / "infrared.toml", ("zero = [", "# zero = ["))
    done = windmark("infrared", light / "infrared.toml")
    assert done.code == 1
    assert "no frame could be reduced; the first:" in done.err
    assert "the model was not found" in done.err
    assert json.loads((light / "infrared" / "summary.json").read_text())["failed"] == 3


def test_even_pictures_are_inputs_of_the_run_however_they_are_named(copied):
    import tifffile

    from windmark.pipeline.infrared import load_infrared, made_with, read_infrared_project
    from windmark.pipeline.same_run import changed

    short(copied, 7)
    place = copied / "calibration"
    tifffile.imwrite(place / "warm.tif", np.stack([io.read_grey(f) for f in sorted(place.glob("warm-cam1-*.tif"))]))
    replaced(copied / "infrared.toml", ('"calibration/cold', f'"{place.as_posix()}/cold'),
             ("warm-cam1-*.tif", "warm.tif[0]"))  # fmt: skip
    before = made_with(load_infrared(read_infrared_project(copied / "infrared.toml")))
    assert {"calibration/warm.tif", "calibration/cold-cam1-0.tif"} <= set(before["files"])
    assert not any("images" in name for name in before["files"])
    with open(place / "cold-cam1-3.tif", "ab") as stream:
        stream.write(b"0")
    now = made_with(load_infrared(read_infrared_project(copied / "infrared.toml")))
    assert changed(before, now) == "calibration/cold-cam1-3.tif has changed since"
