"""What every pixel shows, as a file."""

import numpy as np
import pytest
import xarray

from windmark.io import FileError, write_pixels


def case():
    rng = np.random.default_rng(0)
    xyz = rng.normal(size=(4, 5, 3))
    volume = np.where(rng.random((4, 5)) < 0.5, "wing", "body").astype("<U8")
    xyz[0], volume[0] = np.nan, ""
    return rng.integers(0, 4095, (4, 5)).astype(np.uint16), xyz, volume


def test_what_is_written_is_read(tmp_path):
    value, xyz, volume = case()
    write_pixels(tmp_path / "p.nc", value, xyz, volume, {"angle": value / 7}, length_unit="in", units={"angle": "deg"})
    with xarray.open_dataset(tmp_path / "p.nc") as found:
        np.testing.assert_array_equal(found["value"], value)
        assert found["value"].dtype == np.uint16
        for k, axis in enumerate("xyz"):
            np.testing.assert_array_equal(found[axis], xyz[..., k])
            assert found[axis].attrs["units"] == "in"
        np.testing.assert_array_equal(found["angle"], value / 7)
        names = [*found["volume_names"].values, ""]
        np.testing.assert_array_equal(np.array(names)[found["volume"].values], volume)
        assert (found.attrs["length_unit"], found["angle"].attrs["units"]) == ("in", "deg")


@pytest.mark.parametrize("wrong", ["value", "xyz", "volume", "field"])
def test_arrays_of_different_pictures_are_refused(tmp_path, wrong):
    value, xyz, volume = case()
    arrays = {"value": value, "xyz": xyz, "volume": volume, "field": value}
    arrays[wrong] = arrays[wrong][1:]
    with pytest.raises(ValueError, match=wrong):
        write_pixels(
            tmp_path / "p.nc", arrays["value"], arrays["xyz"], arrays["volume"], {"f": arrays["field"]}, length_unit="m"
        )
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(FileError):
        write_pixels(tmp_path / "no" / "p.nc", *case(), length_unit="mm")
