"""The ends of what `simulate` and the seeds take: the command line says them by the option, Python by the argument."""

import pytest

from windmark.errors import UsageError
from windmark.pipeline.simulate_board import simulate_board
from windmark.pipeline.simulate_cameras import simulate_cameras
from windmark.pipeline.simulate_deforming import simulate_deforming
from windmark.pipeline.simulate_infrared import simulate_infrared
from windmark.pipeline.simulate_photos import simulate_photos
from windmark.pipeline.simulate_psp import simulate_psp
from windmark.pipeline.simulate_sequence import simulate_sequence

LEAST = {
    "--deforming": (simulate_deforming, 3), "--infrared": (simulate_infrared, 8), "--cameras": (simulate_cameras, 2),
    "--photos": (simulate_photos, 2), "--psp": (simulate_psp, 1), "--board": (simulate_board, 3),
    "--sequence": (simulate_sequence, 2),
}  # fmt: skip


@pytest.mark.parametrize("option", LEAST)
def test_a_number_that_is_too_small_is_refused_by_its_option(option, windmark, tmp_path):
    write, least = LEAST[option]
    done = windmark("simulate", tmp_path / "s", option, least - 1)
    assert done.code == 2
    assert f"'{option}': expected >= {least}" in done.err
    with pytest.raises(UsageError, match=f"expected (at least )?{least}"):
        write(tmp_path / "s", 1, least - 1)
    assert not list(tmp_path.glob("s/*"))


def test_more_cameras_than_there_are_places_for(windmark, tmp_path):
    done = windmark("simulate", tmp_path / "s", "--cameras", 6)
    assert done.code == 2
    assert "'--cameras': expected >= 2 and <= 5, not 6" in done.err
    with pytest.raises(UsageError, match="cameras: expected 2 to 5, got 6"):
        simulate_cameras(tmp_path / "s", 1, 6)


@pytest.mark.parametrize("verb", ["simulate", "demo"])
def test_seeds_are_not_negative(verb, windmark, tmp_path):
    done = windmark(verb, tmp_path / "s", "--seed", -1)
    assert done.code == 2
    assert "'--seed': expected >= 0, not -1" in done.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["deform", "x.toml", "--watch", ".", "--idle", "nan"], "'--idle': expected > 0, not nan"),
        (["calibrate", "x.csv", "--unit", "mm", "--max-sigma0", "0"], "'--max-sigma0': expected > 0, not 0"),
        (["undistort", "x.tif", "-c", "c.json", "--magnify", "-1"], "'--magnify': expected > 0 and <= 1000, not -1"),
        (["paint-calibrate", "x.csv", "--t-ref", "20"], "'--t-ref': expected > 50, not 20"),
        (["detect", "x.tif", "-r", "3", "-r", "-1"], "'--radius' / '-r': expected >= 1 and <= 1000, not -1"),
        (["markers", "check", "x.csv", "--unit", "mm", "--within", "0"], "'--within': expected > 0 and <= 180, not 0"),
    ],
)
def test_numbers_beyond_their_range_are_refused_by_their_option_before_any_file_is_read(words, said, windmark):
    done = windmark(*words)
    assert done.code == 2
    assert said in done.err
