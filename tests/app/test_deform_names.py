"""`windmark deform` to its end with the names that cameras give: date stamps, counters of twenty digits."""

import csv
import shutil

import numpy as np
import pytest
import xarray

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("all_undrawn")]  # whole series, for each way of naming pictures

FRAMES = 3


@pytest.fixture(scope="module")
def made(bending, tmp_path_factory):
    folder = bending(6, tmp_path_factory.mktemp("names"))
    text = (folder / "deform.toml").read_text()
    for part in ('grid = ["vtk"]\n', "every = 1\n", '[values]\ncameras = ["cam1"]\nblack = 64\n',
                 '[[points]]\nfile = "taps.csv"\n', 'frames = "frames.csv"\n', 'zero = ["0", "1"]\n'):  # fmt: skip
        assert part in text, part
        text = text.replace(part, "")
    (folder / "deform.toml").write_text(text)
    return folder


@pytest.mark.parametrize(
    ("names", "time_s"),
    [
        (["20261122140005", "20261122140006", "20261122140008"], [0, 1, 3]),
        (["99999999999999999997", "99999999999999999998", "99999999999999999999"], None),
    ],
)
def test_every_name_comes_to_the_end_of_the_results(made, windmark, tmp_path, names, time_s):
    """The first overflowed an int32 as the series was written, after all the work; the second ended frame 2."""
    copy = tmp_path / "test"
    shutil.copytree(made, copy, ignore=shutil.ignore_patterns("truth", "images"))
    (copy / "images").mkdir()
    for k, name in enumerate(names):
        for camera in ("cam1", "cam2"):
            shutil.copy(made / "images" / f"{camera}-{k:04d}.tif", copy / "images" / f"{camera}-{name}.tif")
    done = windmark("deform", copy / "deform.toml", "-o", copy / "out", "--json")
    assert (done.code, done.json["frames"], done.json["lost"]) == (0, FRAMES, 0), done.err
    with open(copy / "out" / "deformation.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["name"] or row["frame"] for row in rows] == names
    with xarray.open_dataset(copy / "out" / "deformation.nc", decode_times=False) as series:
        assert series["frame"].dtype == np.int64
        assert (np.diff(series["frame"].values) > 0).all()
    if time_s is not None:
        assert rows[0]["stamp"] == "2026-11-22T14:00:05"
        seconds = np.array([float(row["time_s"]) for row in rows])
        np.testing.assert_allclose(seconds - seconds[0], time_s)
