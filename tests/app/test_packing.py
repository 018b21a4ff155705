"""What is packed comes out again: by the page's own script, run by Node where it is there, and by a twin here."""

import gzip
import json
import re
import shutil
import subprocess

import numpy as np
import pytest

from windmark.app import web
from windmark.app.feature_edges import feature_edges
from windmark.app.packing import _DIGITS, COARSE, FINE, Packed, coordinates
from windmark.app.scene_document import low_rank
from windmark.scene import Mesh
from windmark.scene.mesh import structured_triangles


def opened(text):
    length, digits = text.split("|", 1)
    number = [_DIGITS.index(c.encode()) for c in digits]
    fours = [sum(d * 85 ** (4 - k) for k, d in enumerate(number[i : i + 5])) for i in range(0, len(number), 5)]
    whole = gzip.decompress(b"".join(four.to_bytes(4, "big") for four in fours)[: int(length)])
    length = int.from_bytes(whole[:4], "little")
    return json.loads(whole[4 : 4 + length]), np.frombuffer(whole, np.uint8, offset=4 + length)


def page_text(path):
    """A report with the parts that are packed in it."""
    page = path.read_text(encoding="utf-8")
    parts = re.findall(r'<script type="text/plain" id="part-[^"]*">([^<]*)</script>', page)
    return page + "".join(opened(part)[1].tobytes().decode() for part in parts)


def ints(raw, of):
    planes = raw[of["at"] : of["at"] + of["planes"] * of["n"]].reshape(of["planes"], of["n"]).astype(np.uint64)
    folded = sum(planes[p] << np.uint64(8 * p) for p in range(of["planes"])) if of["n"] else np.zeros(0, np.uint64)
    out = (folded >> np.uint64(1)).astype(np.int64) ^ -(folded & np.uint64(1)).astype(np.int64)
    for _ in range(of["times"]):
        for k in range(of["lag"], len(out)):
            out[k] += out[k - of["lag"]]
    return out


def known(raw, of, n):
    if "known" not in of:
        return np.ones(n, bool)
    return np.unpackbits(raw[of["known"] :], count=n, bitorder="little").astype(bool)


CASES = {
    "empty": np.zeros(0, int), "one": np.array([-7]), "steady": np.arange(0, 900, 3),
    "large": np.array([0, 2**31 - 1, -(2**31) + 1, 5, -5]), "corners": structured_triangles(7, 9).ravel(),
    "noise": np.random.default_rng(3).integers(-70_000, 70_000, 500),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_whole_numbers_come_back_exactly(case):
    packed = Packed()
    packed.ints(np.array([1, 2, 3]))  # something else before it
    head, raw = opened(packed.text({"a": packed.ints(CASES[case])}))
    assert np.array_equal(ints(raw, head["a"]), CASES[case])


def test_numbers_too_large_are_refused():
    with pytest.raises(ValueError, match="below 2"):
        Packed().ints([2**31])


@pytest.mark.parametrize("fineness", [FINE, COARSE])
def test_a_field_is_rounded_by_less_than_its_noise_and_gaps_stay(fineness):
    rng = np.random.default_rng(5)
    sigma = rng.uniform(0.5, 3.0, 4000)
    value = 1000 + 300 * np.sin(np.arange(4000) / 200) + sigma * rng.normal(size=4000)
    value[100:300] = sigma[100:300] = np.nan
    packed = Packed()
    head, raw = opened(packed.text({"v": packed.field(value, sigma, fineness), "s": packed.sigmas(sigma, fineness)}))
    v, s = head["v"], head["s"]
    back = np.where(known(raw, v, 4000), v["offset"] + v["step"] * ints(raw, v["codes"]), np.nan)
    assert np.array_equal(np.isnan(back), np.isnan(value))
    assert np.nanmax(np.abs(back - value)) <= 0.5 * v["step"] * (1 + 1e-9)
    assert v["step"] <= fineness.sigma_part * np.nanmedian(sigma) * (1 + 1e-9)
    again = np.where(known(raw, s, 4000), s["least"] * s["ratio"] ** (ints(raw, s["codes"]) - 1.0), np.nan)
    assert np.nanmax(np.abs(np.log(again / sigma))) <= 0.51 * np.log(fineness.sigma_step)


@pytest.mark.parametrize("value", [np.full(5, np.nan), np.zeros(5), np.array([np.nan, 1, 1, np.nan, 1])])
def test_fields_of_nothing_or_one_number(value):
    packed = Packed()
    head, raw = opened(packed.text({"v": packed.field(value, np.zeros(5))}))
    v = head["v"]
    back = np.where(known(raw, v, 5), v["offset"] + v["step"] * ints(raw, v["codes"]), np.nan)
    assert np.array_equal(back, value, equal_nan=True)


def test_a_far_field_does_not_coarsen_the_model():
    """Coordinates are stepped by the model's size, wherever the outermost node is."""
    xyz = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5e3, 5e3, 5e3]], dtype=float)
    packed = Packed()
    columns = coordinates(packed, xyz, 1.5)
    head, raw = opened(packed.text({"x": columns}))
    back = np.stack([c["offset"] + c["step"] * ints(raw, c["codes"]) for c in head["x"]], axis=1)
    assert np.abs(back - xyz).max() <= 0.5 * 1.5 / 65_535 * (1 + 1e-6)


def test_a_structured_grid_of_300000_nodes_takes_less_than_100_kb():
    i, j = np.meshgrid(np.arange(600.0), np.arange(500.0))
    xyz = np.column_stack([i.ravel(), j.ravel(), np.sin(i.ravel() / 90) * 20])
    packed = Packed()
    text = packed.text({"x": coordinates(packed, xyz, 800.0), "t": packed.ints(structured_triangles(600, 500))})
    assert len(text) < 100_000


def test_edges_are_borders_and_bends():
    fold = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1]], dtype=float)
    mesh = Mesh.make(fold, np.array([[0, 1, 2], [0, 2, 3], [0, 4, 5], [0, 5, 1]]))
    edges = {tuple(e) for e in feature_edges(mesh).tolist()}
    assert edges == {(0, 1), (1, 2), (2, 3), (0, 3), (0, 4), (4, 5), (1, 5)}  # no diagonal, but the fold
    assert not len(feature_edges(Mesh.make(np.zeros((0, 3)), np.zeros((0, 3), np.int32))))


def test_shapes_of_few_parameters_take_few_modes():
    rng = np.random.default_rng(7)
    q, modes = rng.normal(size=(30, 2)), rng.normal(size=(2, 600))
    rows = q @ modes
    weights, found = low_rank(rows, 1e-6)
    assert found.shape == (2, 600)
    assert np.abs(weights @ found - rows).max() <= 1e-6
    assert np.abs(found).max() <= 1 + 1e-12
    none_w, none = low_rank(np.zeros((4, 9)), 0.0)
    assert none_w.shape == (4, 0)
    assert none.shape == (0, 9)


@pytest.mark.skipif(shutil.which("node") is None, reason="no Node here: the page's script is tried in the browser only")
def test_the_page_s_own_script_reads_the_same():
    packed = Packed()
    value = np.array([1.5, np.nan, -2.0, 40.25])
    text = packed.text({
        "ints": {k: packed.ints(v) for k, v in CASES.items()}, "value": packed.field(value, np.full(4, 0.01)),
        "sigma": packed.sigmas([0.0, 1.0, np.nan, 2.0]),
    })  # fmt: skip
    words = "\n".join([
        "globalThis.document = {addEventListener() {}}; globalThis.window = globalThis;",
        "window.addEventListener = () => 0;",
        web.script(),
        f"WM.unpack({json.dumps(text)}).then(({{head, bytes}}) => console.log(JSON.stringify({{",
        "  ints: Object.fromEntries(Object.entries(head.ints).map(([k, v]) => [k, [...WM.ints(bytes, v)]])),",
        "  value: [...WM.rounded(bytes, head.value)], sigma: [...WM.sigmas(bytes, head.sigma)],",
        "  texts: [WM.withSigma(126.713, 6.7), WM.withSigma(0.123456, 0.00021), WM.withSigma(15234, 230),",
        "    WM.withSigma(3.14159, undefined), WM.withSigma(NaN, 1), WM.withSigma(5, 0)],",
        "  ticks: WM.tickTexts(WM.ticks(-0.03, 0.021)), many: WM.tickTexts(WM.ticks(0, 2.4e7, 3)),",
        "})));",
    ])  # fmt: skip
    done = subprocess.run(["node", "-"], input=words, capture_output=True, text=True, timeout=60, check=True)
    got = json.loads(done.stdout)
    for name, numbers in CASES.items():
        assert got["ints"][name] == numbers.tolist()
    assert got["value"][1] is None
    assert np.allclose([got["value"][k] for k in (0, 2, 3)], value[[0, 2, 3]], atol=0.00126)
    assert got["sigma"] == [0, pytest.approx(1.0), None, pytest.approx(2.0, rel=0.01)]
    assert got["texts"] == ["126.7 ± 6.7", "0.12346 ± 0.00021", "15230 ± 230", "3.142", "no value", "5.000 (exact)"]
    assert got["ticks"] == ["−0.03", "−0.02", "−0.01", "0.00", "0.01", "0.02"]
    assert got["many"] == ["0", "1e+7", "2e+7"]
