"""Tiny synthetic jobs that make numba compile what the verbs call, room by room; the compiled code is kept on disk."""

from __future__ import annotations

import multiprocessing
import os
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.calibration import Free, undistort
from windmark.detection import detect, merit_map
from windmark.epipolar import PairLinks, chain
from windmark.errors import WindmarkError
from windmark.geometry import Camera, Pose
from windmark.paint import form_factors
from windmark.pipeline.calibrate import CalibrateSettings, calibrate_marks, from_table
from windmark.pipeline.clock import Clock
from windmark.pipeline.job import run_project
from windmark.pipeline.project import make_project
from windmark.pipeline.track_files import follow
from windmark.registration import NotRegistered, register
from windmark.scene import Detections, MarkerSet
from windmark.scene.doubled import doubled
from windmark.synth import TunnelTest, default_stations, swinging, tunnel_sequence, wind_tunnel
from windmark.tasks.align2d import NotAligned, align_images
from windmark.tasks.reconstruct import NotReconstructed, reconstruct

SIZE = (640, 512)
VIEWS, MARKERS, FRAMES = 8, 16, 5
APART = ("registration", "detection", "calibration")
"""Jobs that need nothing of each other: processes do them at the same time, the longest first."""
BESIDE = ("reconstruction", "alignment of pictures")
"""What a process can do after those, beside the rest: other rooms than the rest needs."""
MOST_PROCESSES = len(APART)


class Warmup:
    """The jobs, in order; each compiles what those before it did not, and any can be done alone.

    `jobs` gives name and function of each, so that whoever runs them can say how far it is.
    """

    def jobs(self) -> Iterator[tuple[str, Callable[[], None]]]:
        """Name and function of every job."""
        yield "virtual wind tunnel", self._render
        yield "detection", self._detect
        yield "registration", self._register
        yield "mapping and results", self._run
        yield "calibration", self._calibrate
        yield "tracking", self._track
        yield "reconstruction", self._reconstruct
        yield "alignment of pictures", self._align
        yield "deformation", self._deform
        yield "light between surfaces", self._light

    @cached_property
    def _test(self) -> TunnelTest:
        return wind_tunnel(1, size_px=SIZE, nodes=2000, clutter=None)

    def _render(self) -> None:
        assert self._test.shot().image.size

    def _detect(self) -> None:
        image = self._test.shot().image
        detect(image, radius_px=2.0)
        detect(image, radius_px=2.0, refine="bowl")
        merit_map(image, 2.0)

    def _register(self) -> None:
        rng = np.random.default_rng(1)
        camera, markers = _camera_and_markers(rng)
        pose = Pose.look_at([200.0, 300.0, 900.0], [0.0, 0.0, 30.0], [0.0, 1.0, 0.0])
        xy, _ = camera.project(pose.apply(markers.xyz))
        _registered(xy + rng.normal(0, 0.1, xy.shape), markers, camera)
        markers, bent = _bent_sheet()
        xy, _ = camera.project(pose.apply(bent))
        _registered(xy + rng.normal(0, 0.1, xy.shape), markers, camera)

    def _run(self) -> None:
        test = self._test
        with tempfile.TemporaryDirectory(prefix="windmark-warmup-") as place:
            folder = Path(place)
            io.write_camera(folder / "camera.json", test.cameras["cam1"])
            io.write_markers(folder / "markers.csv", test.markers, length_unit="mm")
            io.write_mesh(folder / "model.grid", test.mesh)
            io.write_image(folder / "off.tif", test.shot().image)
            settings = {
                "title": "warm up", "length_unit": "mm", "camera": [{"file": "camera.json"}],
                "image": [{"file": "off.tif"}], "markers": {"file": "markers.csv"}, "grid": {"file": "model.grid"},
                "detect": {"radius_px": 2.0},
                "view": [{"name": "top", "direction": [0, 0, -1], "up": [0, 1, 0], "size_px": [64, 48]}],
                "section": [{"name": "cut", "point": [0, 350, 0], "normal": [0, 1, 0]}],
            }  # fmt: skip
            run_project(make_project(folder / "project.toml", settings))

    def _calibrate(self) -> None:
        rng = np.random.default_rng(1)
        camera, markers = _camera_and_markers(rng)
        columns: dict[str, list[object]] = {"image": [], "name": [], "x": [], "y": []}
        for v in range(VIEWS):
            eye = 900 * np.array([0.7 * np.sin(v), 0.7 * np.cos(1.7 * v), 1.0])
            pose = Pose.look_at(eye, [0.0, 0.0, 30.0], [np.sin(2.1 * v), np.cos(2.1 * v), 0.0])
            xy = camera.project(pose.apply(markers.xyz))[0] + rng.normal(0, 0.1, (MARKERS, 2))
            for k in np.flatnonzero(camera.in_image(xy)):
                for key, value in zip(columns, (f"v{v}", str(markers.name[k]), *xy[k]), strict=True):
                    columns[key].append(value)
        with tempfile.TemporaryDirectory(prefix="windmark-warmup-") as place:
            path = Path(place) / "marks.csv"
            io.write_table(path, {key: np.array(value) for key, value in columns.items()})
            marks = from_table(io.read_matches(path), markers, {"camera": camera}, sigma_px=0.1)
        calibrate_marks(marks, CalibrateSettings(Free()), Clock())
        undistort(np.zeros(camera.size_px[::-1], np.uint8), camera)

    def _track(self) -> None:
        test = self._test
        film = [(f"f{k}", image) for k, (image, _) in enumerate(tunnel_sequence(test, swinging(FRAMES), seed=1))]
        frames = list(follow(film, test.markers.with_role("model"), test.cameras["cam1"]))
        if not any(frame.status == "tracked" for frame in frames):
            raise RuntimeError(f"the virtual film was not followed: {frames[-1].reason}")

    def _reconstruct(self) -> None:
        rng = np.random.default_rng(1)
        camera, markers = _camera_and_markers(rng)
        spots = []
        for v in range(VIEWS):
            eye = 900 * np.array([0.4 * np.sin(v), 0.4 * np.cos(1.7 * v), 1.0])
            pose = Pose.look_at(eye, [0.0, 0.0, 30.0], [0.0, 1.0, 0.0])
            xy = camera.project(pose.apply(markers.xyz))[0]
            spots.append(Detections.make(rng.permutation(xy + rng.normal(0, 0.1, xy.shape)), sigma_px=0.1))
        answer = reconstruct(spots, camera, markers.take(np.arange(6)))
        if isinstance(answer, NotReconstructed):
            raise RuntimeError(f"the virtual pictures were not reconstructed: {answer.reason}")
        one = np.zeros(1, dtype=int)
        chain([1, 1], [PairLinks(0, 1, one, one, np.ones(1))])  # of few pictures only

    def _align(self) -> None:
        test = self._test
        (first, _), (last, _) = tunnel_sequence(test, swinging(2), seed=1)
        answer = align_images(last, first, radius_px=2.0)
        if isinstance(answer, NotAligned):
            raise RuntimeError(f"the virtual pictures were not aligned: {answer.reason}")

    def _deform(self) -> None:
        from windmark.pipeline.deform import load, read_deform_project, run_sequence
        from windmark.pipeline.simulate_deforming import ZEROS, simulate_deforming

        with tempfile.TemporaryDirectory(prefix="windmark-warmup-") as place:
            folder, results = Path(place) / "wing", Path(place) / "results"
            folder.mkdir()
            results.mkdir()
            simulate_deforming(folder, 1, ZEROS + 1, SIZE)  # the fewest that it makes: one deformed
            run_sequence(load(read_deform_project(folder / "deform.toml")), results)

    def _light(self) -> None:
        mesh = wind_tunnel(1, size_px=SIZE, nodes=500, clutter=None).mesh
        form_factors(mesh, facets=50)
        doubled(mesh)


def _camera_and_markers(rng: np.random.Generator) -> tuple[Camera, MarkerSet]:
    """A camera, and markers in space that are not in rows."""
    camera = default_stations(rng, 1, SIZE)[0][0]
    xyz = np.column_stack([rng.uniform(-200, 200, (MARKERS, 2)), rng.uniform(0, 60, MARKERS)])
    return camera, MarkerSet.make([f"m{k}" for k in range(MARKERS)], xyz, length_unit="mm")


def _bent_sheet() -> tuple[MarkerSet, NDArray[np.float64]]:
    """A table in rows with one odd place, which has nearly a mirror image and half a turn; and its places as it bends:
    all explanations are looked at.
    """
    x, y = (a.ravel() for a in np.meshgrid(np.arange(-125.0, 126.0, 50.0), np.arange(-75.0, 76.0, 50.0)))
    xyz = np.column_stack([x, y, np.zeros(len(x))])
    xyz[7, 0] += 12.0
    names, up = [f"m{k}" for k in range(len(x))], np.tile([0.0, 0.0, 1.0], (len(x), 1))
    bent = xyz + np.outer(6.0 * (x / 125.0) ** 2, [0.0, 0.0, 1.0])
    return MarkerSet.make(names, xyz, normal=up, radius=3.0, length_unit="mm"), bent


def _registered(xy: NDArray[np.float64], markers: MarkerSet, camera: Camera) -> None:
    answer = register(Detections.make(xy, sigma_px=0.1), markers, camera)
    if isinstance(answer, NotRegistered):
        raise RuntimeError(f"the virtual test was not registered: {answer.reason}")


def compile_all(show: Callable[[str, int, int], None], processes: int | None = None) -> dict[str, str]:
    """Do every job; ``show`` is told name, number and count. What could not be done -> why; the others go on.

    Parameters
    ----------
    processes : how many compile at the same time; None: one for each core, as far as jobs can be done apart

    Kernels are kept on the disk by whoever has compiled them; the jobs that need several rooms come last, in this
    process, and find them there.
    """
    jobs = dict(Warmup().jobs())
    failed: dict[str, str] = {}
    count = len(jobs)

    def finished(name: str, wait: Callable[[], None]) -> None:
        if why := _failure(wait):
            failed[name] = why

    processes = min(processes or os.cpu_count() or 1, MOST_PROCESSES)
    apart = [name for name in APART if name in jobs and processes > 1]
    beside = [name for name in BESIDE if name in jobs and apart]
    with ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn")) as pool:
        if apart:
            show(", ".join(apart), 0, count)
        at_work = {pool.submit(_alone, name): name for name in apart}
        for n, job in enumerate(as_completed(at_work), 1):
            show(at_work[job], n, count)
            finished(at_work[job], job.result)
        at_work = {pool.submit(_alone, name): name for name in beside}
        here = [name for name in jobs if name not in (*apart, *beside)]
        for n, name in enumerate(here, len(apart)):
            show(name, n, count)
            finished(name, jobs[name])
        for n, job in enumerate(as_completed(at_work), len(apart) + len(here)):
            show(at_work[job], n, count)
            finished(at_work[job], job.result)
    return failed


def _alone(name: str) -> None:
    """One job, in a process of its own."""
    dict(Warmup().jobs())[name]()


def _failure(work: Callable[[], None]) -> str:
    try:
        work()
    except (WindmarkError, RuntimeError) as error:
        return str(error) or type(error).__name__
    return ""
