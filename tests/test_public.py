"""The public face: what users type is there, and importing it costs next to nothing."""

import subprocess
import sys

import numpy as np
import pytest

import windmark as wm

CAMERA = wm.Camera((64, 48), 60.0)
POSE = wm.Pose.look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])
PLATE = wm.Mesh.make([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
MARKERS = wm.MarkerSet.make(["a", "b", "c", "d"], PLATE.vertices)
SPOTS = wm.Detections.make(CAMERA.project(POSE.apply(PLATE.vertices))[0])
IMAGE = np.full((48, 64), 5.0)
FIELD = wm.NodeField.make(np.zeros(4), 0.1)
REFERENCE = wm.LoadReference(1.0, 1.0, 1.0)
SEEN = wm.Observations(np.zeros(4, dtype=int), np.arange(4), SPOTS.xy, SPOTS.cov)
VIEW = wm.View("cam1", cam_from_model=POSE)
SWAPPED = {
    "register": lambda: wm.register(MARKERS, SPOTS, CAMERA),
    "track": lambda: wm.track(None, MARKERS, SPOTS, CAMERA),
    "match_pair": lambda: wm.match_pair(CAMERA, SPOTS, SPOTS),
    "reconstruct": lambda: wm.reconstruct(MARKERS, CAMERA, [SPOTS, SPOTS]),
    "undistort": lambda: wm.undistort(CAMERA, IMAGE),
    "magnify_distortion": lambda: wm.magnify_distortion(CAMERA, IMAGE, 3.0),
    "pose_candidates": lambda: wm.pose_candidates(CAMERA, SPOTS.xy, MARKERS.xyz),
    "pose_from_labels": lambda: wm.pose_from_labels(SPOTS.xy, CAMERA, MARKERS.xyz),
    "self_calibrate": lambda: wm.self_calibrate(MARKERS, SEEN, {"camera": CAMERA}, [VIEW], datum=wm.Free()),
    "identify": lambda: wm.identify(MARKERS, SEEN, [], CAMERA, [VIEW]),
    "compare_laws": lambda: wm.compare_laws({}, SEEN, MARKERS, [VIEW], CAMERA),
    "marker_places": lambda: wm.marker_places(MARKERS, SEEN, CAMERA, [VIEW, VIEW]),
    "map_pixels": lambda: wm.map_pixels(CAMERA, PLATE, POSE),
    "see_nodes": lambda: wm.see_nodes(PLATE, POSE, CAMERA),
    "sample": lambda: wm.sample(IMAGE, POSE, CAMERA, PLATE.vertices),
    "sample_line": lambda: wm.sample_line(IMAGE, CAMERA, PLATE, POSE, [-0.5, 0, 0], [0.5, 0, 0]),
    "sample_points": lambda: wm.sample_points(IMAGE, CAMERA, POSE, PLATE.vertices, PLATE),
    "node_values": lambda: wm.node_values(wm.see_nodes(PLATE, CAMERA, POSE), IMAGE),
    "virtual_image": lambda: wm.virtual_image(wm.map_pixels(PLATE, CAMERA, POSE), IMAGE, CAMERA, POSE),
    "merge_views": lambda: wm.merge_views([wm.Picture("cam1", IMAGE, CAMERA, POSE)], PLATE),
    "section": lambda: wm.section([0, 0, 0], PLATE, [0, 1, 0]),
    "write_mesh": lambda: wm.write_mesh(PLATE, "plate.stl"),
    "write_markers": lambda: wm.write_markers(MARKERS, "markers.csv"),
    "write_camera": lambda: wm.write_camera(CAMERA, "cam1.json"),
    "write_image": lambda: wm.write_image(IMAGE, "run7.tif"),
    "integrate_loads": lambda: wm.integrate_loads(FIELD, PLATE, REFERENCE),
    "section_profile": lambda: wm.section_profile(FIELD, PLATE, wm.section(PLATE, [0, 0, 0], [0, 1, 0]), REFERENCE),
    "span_loading": lambda: wm.span_loading(FIELD, PLATE, [], [0, 1, 0], REFERENCE),
    "fill_patches": lambda: wm.fill_patches(FIELD, PLATE, [-1, -1, -1, -1]),
    "pressure_coefficient": lambda: wm.pressure_coefficient(wm.TunnelConditions(1.0, 1.0), FIELD),
    "remove_self_illumination": lambda: wm.remove_self_illumination(wm.form_factors(PLATE), FIELD, 0.5),
    "correct_picture": lambda: wm.correct_picture(wm.SensorModel(0.0, 255.0, 0.5, 1.0), IMAGE),
}


def test_every_public_name_is_there_once():
    assert len(set(wm.__all__)) == len(wm.__all__)
    for name in wm.__all__:
        assert getattr(wm, name) is not None
    assert set(wm.__all__) <= set(dir(wm))


def test_importing_windmark_and_help_load_nothing_heavy():
    code = (
        "import sys; import windmark; import windmark.app.cli; "
        "print(*[m for m in ('numpy', 'numba', 'scipy', 'matplotlib', 'pyvista', 'vtk') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


@pytest.mark.parametrize("verb", SWAPPED)
def test_arguments_in_another_order_are_named(verb, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=rf"^{verb}: \w+ is an? [\w ]+, .*: they are swapped; expected {verb}\("):
        SWAPPED[verb]()
    assert not list(tmp_path.iterdir())


def test_what_numpy_makes_an_array_of_is_an_image_or_points():
    view = wm.see_nodes(PLATE, CAMERA, POSE)
    as_array = type("Foreign", (), {"__array__": lambda self, dtype=None, copy=None: IMAGE})()
    for image in (IMAGE.tolist(), IMAGE.astype(np.uint8), np.ma.masked_array(IMAGE), as_array):
        np.testing.assert_array_equal(wm.node_values(image, view), np.full(4, 5.0, dtype=np.float32))
        assert wm.undistort(image, CAMERA).image.shape == (48, 64)
    assert wm.pose_from_labels(SPOTS.xy.tolist(), tuple(map(tuple, MARKERS.xyz.tolist())), CAMERA).rms_px < 1e-6
