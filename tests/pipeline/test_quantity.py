"""What the values of a picture are, and how files say it."""

import numpy as np
import pytest

from windmark import io
from windmark.pipeline.quantity import Quantity, quantity_of


def test_names_of_columns_and_labels():
    grey = Quantity()
    assert (grey.column, grey.unit_words, grey.label, grey.words) == ("value", "grey level", "grey level", "")
    warm = Quantity("temperature", "degC")
    assert (warm.column, warm.unit_words, warm.label) == ("temperature_degC", "degC", "temperature, degC")
    light = Quantity("radiance", "W/m2/sr", 0.01, 2)
    assert light.column == "radiance_W_m2_sr"
    assert light.words == "the values are radiance, W/m2/sr (2 + 0.01 x the file's grey level)"


def test_rescaling_is_exact_and_leaves_what_needs_none():
    levels = np.array([[0, 1], [40_000, 65_535]], np.uint16)
    assert Quantity("temperature", "K").of(levels) is levels
    kelvin = Quantity("temperature", "degC", 0.01, -273.15).of(levels)
    assert kelvin.dtype == np.float32
    np.testing.assert_array_equal(kelvin, (levels * 0.01 - 273.15).astype(np.float32))
    assert Quantity(scale=2.0).of(levels.astype(float)).dtype == np.float64


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("heat", "K"), "quantity must be one of grey, radiance, temperature, got 'heat'"),
        (("temperature", "C"), "unit of a temperature must be one of K, degC, degF, got 'C'"),
        (("temperature", ""), "unit of a temperature must be one of"),
        (("radiance", ""), "unit of a radiance must be given"),
        (("grey", "K"), "grey levels have none"),
        (("grey", "", 0.0), "scale must not be 0"),
        (("grey", "", 1.0, float("inf")), "scale and offset finite"),
    ],
)
def test_what_cannot_be(arguments, message):
    with pytest.raises(ValueError, match=message.replace("(", r"\(")):
        Quantity(*arguments)


def test_the_user_and_the_file():
    told = ("temperature", "degC")
    assert quantity_of(None, None, 1, 0, told) == Quantity("temperature", "degC")
    assert quantity_of(None, None, 1, 0, None) == Quantity()
    assert quantity_of("temperature", "degC", 1, 0, told) == Quantity("temperature", "degC")
    assert quantity_of("temperature", "K", 1, 273.15, told) == Quantity("temperature", "K", 1, 273.15)
    with pytest.raises(ValueError, match="that its values are temperature in degC; expected temperature K"):
        quantity_of("temperature", "K", 1, 0, told)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("the values are temperature in K", ("temperature", "K")),
        ("the values are temperature, degC (-273.15 + 0.01 x the file's grey level)", ("temperature", "degC")),
        ("the values are radiance, W/m2/sr (0 + 2 x the file's grey level)", ("radiance", "W/m2/sr")),
        ("Radiance [W/(m²·sr)]", ("radiance", "W/m2/sr")),
        ("Temperature (°F)", ("temperature", "degF")),
        ("Reflected temperature [°C];20", None),
        ("Temperature [°C];20", None),
        ("Temperature: 20", None),
        ("temperature in Kansas", None),
        ("Temperature [K]\nRadiance [W/m2/sr]", None),
    ],
)
def test_words_in_files(tmp_path, words, told):
    (tmp_path / "a.csv").write_text(f"{words}\n1;2;3\n4;5;6\n", encoding="utf-8")
    (tmp_path / "b.csv").write_bytes(f"{words.replace('·', '.')}\n1;2;3\n4;5;6\n".encode("cp1252"))
    assert io.told_quantity(tmp_path / "a.csv") == told
    assert io.told_quantity(tmp_path / "b.csv") == told
    io.write_image(tmp_path / "c.tif", np.zeros((4, 5), np.float32), description=words)
    assert io.told_quantity(tmp_path / "c.tif") == told
    np.testing.assert_array_equal(io.read_image(tmp_path / "c.tif"), np.zeros((4, 5)))
