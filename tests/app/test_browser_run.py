"""The main job's report in a browser: it turns, switches, tells, zooms, prints; nothing is asked of any other place."""

import io
import shutil
import subprocess

import browser
import numpy as np
import pytest
from PIL import Image

pytestmark = browser.needed

CANVAS = ".wm-stage canvas"


@pytest.fixture(scope="module")
def report(windmark, virtual_test, tmp_path_factory):
    """A report of two pictures of the virtual wing."""
    folder = tmp_path_factory.mktemp("run")
    for path in virtual_test[0].iterdir():
        if path.is_file():
            shutil.copy(path, folder)
    done = windmark("run", folder / "project.toml", "--json")
    assert done.code == 0, done.err
    assert done.json["not_drawn"] == []
    (page,) = folder.rglob("report.html")
    return page


@pytest.fixture(scope="module")
def page(report, tmp_path_factory):
    # A small window: without a graphics card every pixel of every change is the processor's.
    with browser.opened(tmp_path_factory.mktemp("browser"), 720, 520) as tab:
        yield tab.open(report)


def pixels(tab, selector=CANVAS):
    """An element as it is drawn, (H, W, 3)."""
    tab.js("document.activeElement.blur()")  # no outline of what has the focus, nothing under the cursor
    tab.mouse("mouseMoved", 2, 2)
    tab.centre(selector)
    box = tab.js(f"(() => {{ const r = document.querySelector('{selector}').getBoundingClientRect();"
                 " return [r.x + scrollX, r.y + scrollY, r.width, r.height]; })()")  # fmt: skip
    return np.asarray(Image.open(io.BytesIO(tab.shot(clip=box))).convert("RGB")).astype(int)


def changed(a, b):
    """Part of the pixels that differ."""
    return float((np.abs(a - b).max(axis=2) > 12).mean())


@pytest.mark.slow
def test_it_loads_without_an_error_and_asks_no_one(page):
    assert page.wrong() == []
    assert page.js("document.querySelectorAll('.wm-scene.wm-ready').length") == 1
    image = pixels(page)
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 200  # a model in colours, no empty stage


def test_it_turns_by_mouse_wheel_and_keys(page):
    x, y = page.centre(CANVAS)
    first = pixels(page)
    page.drag((x, y), (x + 120, y + 30))
    turned = pixels(page)
    assert changed(first, turned) > 0.03
    page.mouse("mouseWheel", x, y, deltaX=0, deltaY=-300)  # the page's, before there was a click
    page.settle()
    assert changed(turned, pixels(page)) < 0.002
    x, y = page.centre(CANVAS)
    page.js(f"document.querySelector('{CANVAS}').focus()")
    page.mouse("mouseWheel", x, y, deltaX=0, deltaY=-300)
    page.settle()
    nearer = pixels(page)
    assert changed(turned, nearer) > 0.03
    page.js(f"document.querySelector('{CANVAS}').focus()")
    page.key("ArrowLeft")
    assert changed(nearer, pixels(page)) > 0.01
    page.js(f"document.querySelector('{CANVAS}').focus()")
    page.key("0")
    assert changed(first, pixels(page)) < 0.002
    assert page.wrong() == []


def test_sigma_and_value(page):
    value = pixels(page)
    title = page.js("document.querySelector('.wm-bar-title').textContent")
    page.click(".wm-switch button:nth-child(2)")
    assert page.js("document.querySelector('.wm-bar-title').textContent") == f"1 sigma of {title}"
    assert changed(value, pixels(page)) > 0.03
    page.click(".wm-switch button:nth-child(1)")
    assert changed(value, pixels(page)) < 0.002


def test_colours_are_those_of_the_colour_bar(page):
    """No light on values: what is drawn at a node is the palette's colour of its value."""
    off = page.js(
        """(() => { const s = WM.scenes[0]; const {canvas, model, range, palette} = s; s.draw();
        const [w, h] = [canvas.clientWidth, canvas.clientHeight];
        const gl = s.gpu.gl; const off = [];
        const at = WM.projectNodes(model.surface, s.matrix, w, h);
        for (let k = 0; k < model.surface.count && off.length < 400; k += 7) {
          if (!Number.isFinite(s.field.values[k])) continue;
          const [x, y] = [Math.floor(at[3 * k]), Math.floor(at[3 * k + 1])];
          const hit = WM.pickSurface(model.surface, at, x + 0.5, y + 0.5);
          if (!hit || hit.node !== k || Math.abs(hit.depth - at[3 * k + 2]) > 1e-3 * hit.depth) continue;
          const got = new Uint8Array(4);
          gl.readPixels(x, canvas.height - 1 - y, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, got);
          const t = Math.min(Math.max((s.field.values[k] - range[0]) / (range[1] - range[0]), 0), 1);
          const of = Math.round(255 * t);
          off.push(Math.max(...[0, 1, 2].map((c) => Math.abs(got[c] - palette[4 * of + c]))));
        }
        return off; })()"""
    )
    assert len(off) > 100
    assert np.percentile(off, 60) <= 12  # a pixel beside the node, a line over it; not a shade


def test_a_node_is_told_with_the_digits_that_its_sigma_earns(page):
    x, y = page.centre(CANVAS)
    page.mouse("mouseMoved", x - 1, y)
    page.mouse("mouseMoved", x, y)
    page.until("!document.querySelector('.wm-tip').hidden")
    said = page.js("document.querySelector('.wm-tip').innerText")
    assert "node" in said
    assert "±" in said or "no value" in said
    assert "x, y, z:" in said


def test_a_marker_is_told_by_its_name_and_residual(page):
    at = page.js(
        """(() => { const s = WM.scenes[0]; s.draw(); const {canvas} = s; const r = canvas.getBoundingClientRect();
        const m = s.model.head.markers; const shifts = s.shiftsSaid;
        for (let k = 0; k < m.names.length; k++) {
          if (!shifts.notes[m.index[k]]) continue;
          const p = WM.onScreen(s.matrix, m.xyz[k], canvas.clientWidth, canvas.clientHeight);
          const said = s.under(p[0], p[1]);
          if (said[0] === m.names[k]) return [r.x + p[0], r.y + p[1], m.names[k]];
        } return null; })()"""
    )
    assert at is not None
    page.mouse("mouseMoved", at[0] + 1, at[1])
    page.mouse("mouseMoved", at[0], at[1])
    page.until("!document.querySelector('.wm-tip').hidden")
    said = page.js("document.querySelector('.wm-tip').innerText")
    assert said.startswith(at[2])
    assert "found − expected" in said


def test_what_is_shown_can_be_switched(page):
    full = pixels(page)
    for label in ("surface", "cameras", "markers"):
        page.js(f"[...document.querySelectorAll('.wm-check')].find((e) => e.textContent === '{label}').click()")
        page.settle()
        fewer = pixels(page)
        assert changed(full, fewer) > 1e-4, label
        full = fewer
    for label in ("surface", "cameras", "markers"):
        page.js(f"[...document.querySelectorAll('.wm-check')].find((e) => e.textContent === '{label}').click()")


def test_another_picture_s_values_are_unpacked_when_they_are_chosen(page):
    names = page.js("WM.scenes[0].model.fields.map((f) => [f.name, Boolean(f.values)])")
    assert len(names) >= 2
    before = pixels(page)
    page.js("WM.scenes[0].choose(1)")
    page.settle()
    assert changed(before, pixels(page)) > 0.003
    assert page.js("Number.isFinite(WM.scenes[0].field.values.find(Number.isFinite))")
    page.js("WM.scenes[0].choose(0)")
    page.settle()


def test_a_picture_zooms_to_its_pixels(page):
    frame = ".wm-photo .wm-zoom"
    x, y = page.centre(frame)
    for count in (1, 2):
        for kind in ("mousePressed", "mouseReleased"):
            page.mouse(kind, x, y, button="left", buttons=1 if kind == "mousePressed" else 0, clickCount=count)
    page.settle()
    assert "scale(6)" in page.js(f"document.querySelector('{frame}').firstElementChild.style.transform")
    page.key("Escape")
    assert "scale(1)" in page.js(f"document.querySelector('{frame}').firstElementChild.style.transform")
    page.js("document.querySelector('.wm-layers input').click()")
    assert page.js("document.querySelector('.wm-photo').className").startswith("wm-photo wm-no-")
    page.js("document.querySelector('.wm-layers input').click()")


def test_tables_are_copied_as_text(page):
    text = page.js("WM.tableText(document.querySelector('table'))")
    rows = [line.split("\t") for line in text.splitlines()]
    assert len({len(row) for row in rows}) == 1
    assert rows[0][0] == "image"
    assert page.js("document.querySelectorAll('.wm-copy').length === document.querySelectorAll('table').length")


def test_light_and_dark(page):
    light = pixels(page)
    page.dark(True)
    page.settle()
    dark = pixels(page)
    page.dark(False)
    page.settle()
    assert dark[:20, :20].mean() < 90 < 200 < light[:20, :20].mean()
    assert changed(light, pixels(page)) < 0.002


@pytest.mark.skipif(shutil.which("pdftotext") is None, reason="no pdftotext here (apt-get install poppler-utils)")
def test_print_has_whole_tables_and_the_model_as_a_picture(page, tmp_path):
    """Every row of the longest table is on paper, though on the screen it scrolls."""
    rows = page.js("[...document.querySelectorAll('.scroll tbody tr')].map((r) => r.cells[0].innerText)")
    printed = page.pdf(tmp_path / "report.pdf")
    text = subprocess.run(["pdftotext", "-layout", printed, "-"], capture_output=True, text=True, check=True).stdout
    words = set(text.split())
    assert rows
    assert [name for name in rows if name not in words] == []
    assert page.js("document.querySelector('.wm-still').src").startswith("data:image/png")
    assert page.wrong() == []


@pytest.mark.slow
def test_a_browser_without_webgl_is_told(report, tmp_path):
    with browser.opened(tmp_path / "other") as tab:
        tab.send("Page.addScriptToEvaluateOnNewDocument",
                 source="HTMLCanvasElement.prototype.getContext = () => null;")  # fmt: skip
        tab.open(report)
        assert "WebGL2" in tab.js("document.querySelector('.wm-fallback').innerText")
        assert tab.js("document.querySelector('.wm-failed') !== null")


@pytest.mark.slow
def test_no_private_path_stands_in_it(report):
    text = report.read_text(encoding="utf-8")
    assert str(report.parents[1]) not in text
    assert str(report.parents[2]) not in text
    assert "SHA-256" in text
