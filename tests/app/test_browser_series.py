"""Reports of sequences and networks in a browser: time, ellipsoids, Cp, print."""

import browser
import networks
import numpy as np
import pytest

from windmark.app.network_scene import network_scene
from windmark.app.report import Report
from windmark.app.scene3d import Field, Frames, Markers, Scene3D, Shifts, Station
from windmark.calibration import Free, self_calibrate
from windmark.geometry import Camera, Pose
from windmark.scene import Mesh
from windmark.scene.mesh import structured_triangles

pytestmark = browser.needed


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    with browser.opened(tmp_path_factory.mktemp("browser")) as opened:
        yield opened


def plate(n=30):
    i, j = np.meshgrid(np.linspace(0, 100, n), np.linspace(0, 50, n))
    return Mesh.make(np.column_stack([i.ravel(), j.ravel(), np.zeros(n * n)]), structured_triangles(n, n), "plate")


def shown(tab, folder, scene):
    report = Report("test")
    report.scene("3D view", lambda: scene, "a scene")
    assert report.failed == []
    (folder / "page.html").write_text(report.html(), encoding="utf-8")
    tab.open(folder / "page.html")
    assert tab.wrong() == []
    return tab


def test_a_sequence_moves_with_its_slider_and_tells_true_lengths(tab, tmp_path):
    mesh = plate()
    shape = (mesh.vertices[:, 0] / 100) ** 2
    rise = np.array([0.0, 1.5, -0.5, 0.75])
    moved = np.zeros((4, len(shape), 3), np.float32)
    moved[:, :, 2] = rise[:, None] * shape
    sigma = np.broadcast_to(0.02 * shape, (4, len(shape))).astype(np.float32)
    frames = Frames(tuple(f"frame {k}" for k in range(4)), moved, sigma, 10.0, "displacement, mm")
    shown(tab, tmp_path, Scene3D("mm", np.array([0, 1.0, -0.7]), np.array([0, 0, 1.0]), mesh, frames=frames))
    assert tab.js("document.querySelector('output').textContent") == "frame 1"  # the largest
    last = len(shape) - 1
    for k in range(4):
        tab.js(f"(() => {{ const s = document.querySelector('input[type=range]'); s.value = {k};"
               " s.dispatchEvent(new Event('input')); })()")  # fmt: skip
        tab.settle()
        value, s, z = tab.js(f"[WM.scenes[0].field.values[{last}], WM.scenes[0].field.sigmas[{last}],"
                             f" WM.scenes[0].model.surface.xyz[{3 * last + 2}]]")  # fmt: skip
        assert value == pytest.approx(abs(rise[k]), abs=2e-3)
        assert s == pytest.approx(0.02, rel=0.02)
        assert z == pytest.approx(10 * rise[k], abs=2e-2)
    tab.js("WM.scenes[0].setMagnify(0)")
    tab.settle()
    assert tab.js(f"WM.scenes[0].model.surface.xyz[{3 * last + 2}]") == pytest.approx(0, abs=1e-6)
    assert tab.wrong() == []


def test_markers_go_with_the_surface(tab, tmp_path):
    """Where the surface is drawn ten times moved, markers at their places of rest would lie beside it."""
    mesh = plate()
    rise = np.array([1.5, -0.5])
    moved = np.zeros((2, len(mesh.vertices), 3), np.float32)
    moved[:, :, 2] = rise[:, None] * (mesh.vertices[:, 0] / 100) ** 2
    xyz = np.array([[np.nan, 0, 0], [100.0, 50, 0], [50, 25, 0]])
    carried = np.zeros((2, 3, 3), np.float32)
    carried[:, :, 2] = rise[:, None] * (xyz[:, 0] / 100) ** 2
    frames = Frames(("a", "b"), moved, None, 10.0, "displacement, mm", carried)
    markers = Markers(("lost", "tip", "middle"), xyz)
    look = np.array([0, 1.0, -0.7]), np.array([0, 0, 1.0])
    shown(tab, tmp_path, Scene3D("mm", *look, mesh, markers=markers, frames=frames))
    for k in range(2):
        tab.js(f"WM.scenes[0].setFrame({k})")
        tab.settle()
        tip, middle = tab.js("WM.scenes[0].model.spots")
        assert tip == pytest.approx([100, 50, 10 * rise[k]], abs=2e-2)
        assert middle == pytest.approx([50, 25, 2.5 * rise[k]], abs=2e-2)
        x, y = tab.js("WM.onScreen(WM.scenes[0].matrix, WM.scenes[0].model.spots[0],"
                      " WM.scenes[0].canvas.clientWidth, WM.scenes[0].canvas.clientHeight)")[:2]  # fmt: skip
        assert tab.js(f"WM.scenes[0].under({x}, {y})[0]") == "tip"
    tab.js("WM.scenes[0].setMagnify(0)")
    tab.settle()
    assert tab.js("WM.scenes[0].model.spots[0][2]") == pytest.approx(0, abs=1e-6)
    assert tab.wrong() == []


def test_a_camera_that_moves_has_its_residuals_and_field_in_every_frame(tab, tmp_path):
    """With the slider go camera, residuals and the field of the same label; with a camera that stands still the eye."""
    camera, xyz = Camera((1200, 800), 1500.0), np.array([[0.0, 0, 0], [60, 0, 0], [0, 40, 0]])
    poses = [Pose.look_at([30 + 20 * k, 20, 200], [30 + 5 * k, 20, 0], [0, 1, 0]) for k in range(3)]
    frames = Frames(
        ("a", "b", "c"), np.zeros((3, 900, 3), np.float32), None, 1.0, "",
        stations=tuple((Station(f"at {k}", camera, p),) if k != 1 else () for k, p in enumerate(poses)),
        shifts=(Shifts(np.full((3, 3), 2.0), 3.0, "three times", ("one", "", "")), None, None), first=0,
    )  # fmt: skip
    fields = [Field(f"{what}-{k}", f"{what} {k}", what, np.full(900, 1.0 + k), frame=k)
              for what in ("T", "q") for k in range(3)]  # fmt: skip
    markers = Markers(("A", "B", "C"), xyz, groups=(("#ff0000", "too close", (1, 2)),))
    look = np.array([0, 0.2, -1.0]), np.array([0, 1.0, 0])
    shown(tab, tmp_path, Scene3D("mm", *look, plate(), fields, markers=markers, frames=frames, chosen=3))
    assert "too close (2)" in tab.js("document.querySelector('.wm-panel').innerText")
    assert "three times" in tab.js("document.querySelector('.wm-panel').innerText")

    def slide(k):
        tab.js(f"(() => {{ const s = document.querySelector('input[type=range]'); s.value = {k};"
               " s.dispatchEvent(new Event('input')); })()")  # fmt: skip
        tab.until(f"WM.scenes[0].field.values?.[0] === {1 + k} && WM.scenes[0].model.frame === {k}")

    def seen(k):
        """Where the camera has the markers by the drawing: what of the eye stands still beside the camera."""
        x = tab.js("WM.scenes[0].orbit.eye")
        return poses[k].apply(np.array([x]))[0]

    before = seen(0)
    tab.js("WM.scenes[0].steady = true")
    slide(1)
    assert tab.js("WM.scenes[0].model.cameras.length") == 0
    assert "three times" not in tab.js("document.querySelector('.wm-panel').innerText")
    slide(2)
    assert seen(2) == pytest.approx(before, abs=1e-3)
    assert tab.js("WM.scenes[0].field.key") == "q-2"
    assert tab.js("WM.scenes[0].model.cameras[0].name") == "at 2"
    tab.js("WM.scenes[0].choose(0)")
    tab.until("WM.scenes[0].model.frame === 0")
    assert tab.js("document.querySelector('output').textContent") == "a"
    assert tab.wrong() == []


def test_markers_have_ellipsoids_with_the_factor_said(tab, tmp_path):
    rng = np.random.default_rng(2)
    xyz = rng.uniform(-50, 50, (20, 3))
    cov = np.array([np.diag([1e-4, 4e-4, 9e-4])] * 20)
    markers = Markers(tuple(f"M{k:02d}" for k in range(20)), xyz, cov, tuple(("painted",) for _ in range(20)))
    camera = Camera((1200, 800), 1500.0)
    stations = [Station(f"view {k}", camera, Pose.look_at([200 * np.cos(k), 200 * np.sin(k), 90], [0, 0, 0], [0, 0, 1]))
                for k in range(3)]  # fmt: skip
    look = np.array([0, 1.0, -0.5]), np.array([0, 0, 1.0])
    shown(tab, tmp_path, Scene3D("mm", *look, stations=stations, markers=markers))
    words = tab.js("document.querySelector('.wm-panel').innerText")
    factor = tab.js("WM.scenes[0].model.head.markers.factor")
    assert factor > 1
    assert f"95 %, drawn × {factor:g}" in words
    longest = tab.js("Math.max(...WM.scenes[0].model.head.markers.axes[0].map(Math.abs))")
    assert longest == pytest.approx(0.03 * 2.7955, rel=1e-3)  # three sigma-axes of 95 % in three dimensions
    centre = tab.js("WM.scenes[0].model.head.cameras[1].center")
    assert np.allclose(centre, [200 * np.cos(1), 200 * np.sin(1), 90], atol=1e-4)
    x, y, _ = tab.js("(() => { const s = WM.scenes[0]; s.draw(); const c = s.canvas;"
                     " return WM.onScreen(s.matrix, s.model.head.markers.xyz[4], c.clientWidth, c.clientHeight);"
                     " })()")  # fmt: skip
    assert tab.js(f"WM.scenes[0].under({x}, {y})")[0].startswith("M")


def test_picking_gives_the_node_under_the_cursor(tab, tmp_path):
    mesh = plate()
    value = np.arange(len(mesh.vertices), dtype=float)
    field = Field("f", "f", "Cp", value, np.full(len(value), 3.0))
    shown(tab, tmp_path, Scene3D("mm", np.array([0, 0.2, -1.0]), np.array([0, 1.0, 0]), mesh, [field]))
    for node in (31, 435, 800):
        x, y, _ = tab.js("(() => { const s = WM.scenes[0]; s.draw(); const c = s.canvas; const p = s.model.surface.xyz;"
                         f" return WM.onScreen(s.matrix, [p[{3 * node}], p[{3 * node + 1}], p[{3 * node + 2}]],"
                         " c.clientWidth, c.clientHeight); })()")  # fmt: skip
        said = tab.js(f"WM.scenes[0].under({x + 0.3}, {y + 0.3})")
        assert said[0] == f"node {node}, plate"
        got = float(said[1].split(":")[1].split("±")[0])
        assert got == pytest.approx(node, abs=0.5)  # rounded to a part of its sigma
        assert said[1].endswith("± 3.0")
    assert tab.js("WM.scenes[0].under(2, 2)") == []


@pytest.mark.parametrize("sick", ["no triangles", "no values", "one value", "holes", "far field"])
def test_sick_data_are_drawn_without_an_error(tab, tmp_path, sick):
    mesh, value = plate(6), np.arange(36.0)
    if sick == "no triangles":
        mesh = Mesh.make(mesh.vertices, np.zeros((0, 3), np.int32))
    elif sick == "no values":
        value = np.full(36, np.nan)
    elif sick == "one value":
        value = np.ones(36)
    elif sick == "holes":
        vertices = mesh.vertices.copy()
        vertices[[3, 20]] = np.nan
        mesh = mesh.moved(vertices)
    else:
        far = np.array([[1e5, 0, 0], [1e5, 1e5, 0], [0, 1e5, 9e4]])
        mesh = Mesh.make(np.concatenate([mesh.vertices, far]), np.concatenate([mesh.triangles, [[36, 37, 38]]]))
        value = np.arange(39.0)
    field = Field("f", "f", "value", value, 0 * value)
    shown(tab, tmp_path, Scene3D("mm", np.array([0, 0.2, -1.0]), np.array([0, 1.0, 0]), mesh, [field]))
    assert tab.js("document.querySelectorAll('.wm-ready').length") == 1
    tab.click(".wm-switch button:nth-child(2)")
    assert tab.wrong() == []


def test_a_calibration_turns(tab, tmp_path):
    case = networks.make(5, points=30, views=6)
    observations, markers, cameras, views, _ = networks.nouns(case)
    result = self_calibrate(observations, markers, cameras, views, datum=Free())
    assert result
    scene = network_scene(result, "mm")
    assert len(scene.stations) == 6
    shown(tab, tmp_path, scene)
    assert "ellipsoids" in tab.js("document.querySelector('.wm-panel').innerText")


@pytest.mark.slow
def test_a_graphics_card_that_was_taken_away_comes_back(tab, tmp_path):
    mesh = plate()
    field = Field("f", "f", "Cp", np.arange(len(mesh.vertices), dtype=float))
    shown(tab, tmp_path, Scene3D("mm", np.array([0, 0.2, -1.0]), np.array([0, 1.0, 0]), mesh, [field]))
    middle = ("(() => { const s = WM.scenes[0]; s.draw(); const gl = s.gpu.gl; const p = new Uint8Array(4);"
              " gl.readPixels(s.canvas.width >> 1, s.canvas.height >> 1, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, p);"
              " return [...p]; })()")  # fmt: skip
    first = tab.js(middle)
    tab.js("window.lost = WM.scenes[0].gpu.gl.getExtension('WEBGL_lose_context')")
    tab.js("lost.loseContext()")
    tab.until("WM.scenes[0].gpu.gl.isContextLost()")
    tab.js("lost.restoreContext()")
    tab.until("!WM.scenes[0].gpu.gl.isContextLost()")
    tab.settle()
    assert tab.js(middle) == first
    assert tab.wrong() == []
