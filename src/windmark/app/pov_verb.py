"""The verb `windmark pov`: a point of view printed, converted, compared and drawn."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.app import console
from windmark.app.alone import not_drawn, png_alone
from windmark.app.commands.matching_options import grid_settings
from windmark.app.convert_verb import parse_size
from windmark.app.report import measured
from windmark.app.verdict_words import judged
from windmark.errors import UsageError, WindmarkError
from windmark.geometry import Camera, Pose, PoV
from windmark.pipeline.framing import FOV_DEG, SIZE_PX
from windmark.pipeline.grid import read_grid
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.project_entries import GridEntry
from windmark.pipeline.verdict.viewpoint import viewpoint_findings, viewpoint_verdict
from windmark.pipeline.views import frame_view, perfect_camera, units_per_px
from windmark.scene import Mesh

Array = NDArray[np.float64]
Record = dict[str, Any]
NAMES = ("rx_deg", "ry_deg", "rz_deg", "dx", "dy", "dz")
OPTIONS = {name: f"--{name.removesuffix('_deg')}" for name in (*NAMES, "fov_deg")}


@dataclass(frozen=True)
class Wishes:
    """What is wanted of `windmark pov`; see its options."""

    cameras: tuple[Path, ...] = ()
    numbers: Mapping[str, float] = field(default_factory=dict)
    size: str | None = None
    unit: str | None = None
    direction: str | None = None
    up: str | None = None
    grid: Path | None = None
    volumes: tuple[str, ...] = ()
    markers: Path | None = None
    output: Path | None = None
    picture: Path | None = None


@dataclass(frozen=True)
class Viewpoint:
    """A camera in its place. ``unit`` is None where nothing says it, ``sigma`` None where nothing is known of it."""

    name: str
    camera: Camera
    pose: Pose
    unit: str | None
    sigma: PoV | None = None
    notes: tuple[str, ...] = ()

    @property
    def pov(self) -> PoV:
        """Its seven numbers."""
        return self.pose.to_pov(self.camera.focal_px, self.camera.size_px[0])


def show(wishes: Wishes, as_json: bool) -> None:
    """Find the point of view, write what is wanted, say it."""
    _check(wishes)
    io.try_paths([path for path in (wishes.output, wishes.picture) if path is not None], console.complain)
    lengths = Lengths(wishes.unit)
    views = [_from_file(path, wishes, lengths) for path in wishes.cameras]
    mesh, markers = _model(wishes, lengths)
    console.notes(lengths)
    points = markers if mesh is None else mesh.vertices[mesh.used]
    if wishes.direction is not None:
        views = [_framed(wishes, points)]
    elif wishes.numbers:
        views = [_typed(wishes, views[0] if views else None)]
    view = views[0]
    record, lines = _described(view, points)
    if len(views) > 1:
        other, more = _described(views[1], points)
        difference, words = _difference(view, views[1], points)
        record |= {"other": other, "difference": difference}
        lines += [*more, *words]
    found = [f.at(v.name) for v in views[:2] for f in viewpoint_findings(v.camera, v.pose, points, mesh)]
    files = ("" if path is None else path.name for path in (wishes.output, wishes.picture))
    lines += judged(record, viewpoint_verdict(found, len(views), len(points) > 0, *files))
    if wishes.output is not None:
        if view.unit is None:
            raise UsageError(f"{view.name}: nothing says the length unit; give --unit to write {wishes.output}")
        io.write_camera(wishes.output, view.camera, view.pose, unit=view.unit)
        record["output"] = wishes.output
        lines.append(f"written: {wishes.output}")
    if wishes.picture is not None:
        from windmark.app.pov_pictures import pov_picture

        failed: list[str] = []
        drawn = png_alone("picture", lambda: pov_picture(view, mesh, markers), failed)
        if drawn is not None:
            with io.atomic_path(wishes.picture) as place:
                place.write_bytes(drawn)
            record["picture"] = wishes.picture
            lines.append(f"picture: {wishes.picture}")
        record["not_drawn"] = failed
        lines += not_drawn(failed)
    console.answer(record, as_json, lines)


def _check(wishes: Wishes) -> None:
    if len(wishes.cameras) > 2:
        raise UsageError(f"expected one camera file, or two to compare, got {len(wishes.cameras)}")
    if (wishes.direction is None) != (wishes.up is None):
        raise UsageError("--direction and --up belong together")
    if wishes.direction is not None and (wishes.cameras or set(wishes.numbers) - {"fov_deg"}):
        raise UsageError("--direction stands alone; expected no camera file and no angles or distances with it")
    if len(wishes.cameras) == 2 and (wishes.numbers or wishes.output or wishes.size):
        raise UsageError("two camera files are compared; expected no numbers, --size and --output with them")
    if not (wishes.cameras or wishes.numbers or wishes.direction):
        raise UsageError("expected a camera file, the numbers --rx ... --fov, or --direction and --up; see --help")
    for name, value in wishes.numbers.items():
        if not math.isfinite(value):
            raise UsageError(f"{OPTIONS[name]} must be a finite number, got {value}")
    if not 0 < wishes.numbers.get("fov_deg", 1.0) < 180:
        raise UsageError(f"--fov must be between 0 and 180 degrees, got {wishes.numbers['fov_deg']:g}")
    if wishes.volumes and wishes.grid is None:
        raise UsageError("--volume says what of the --grid takes part; give --grid")


def _model(wishes: Wishes, lengths: Lengths) -> tuple[Mesh | None, Array]:
    """The grid, and the places of the markers that are not on walls (0, 3 without a table)."""
    mesh, xyz = None, np.empty((0, 3))
    if wishes.grid is not None:
        mesh = read_grid(GridEntry(**grid_settings(wishes.grid, list(wishes.volumes))), lengths)
    if wishes.markers is not None:
        markers = lengths.markers(wishes.markers)
        xyz = markers.xyz[markers.role != "wall"]
    return mesh, xyz


def _from_file(path: Path, wishes: Wishes, lengths: Lengths) -> Viewpoint:
    content = lengths.camera(path, size_px=parse_size(wishes.size) if not wishes.numbers else None)
    if content.cam_from_model is None:
        raise io.FileError(path, "has no pose; expected a camera with one (register, calibrate and track write it)")
    camera, pose, sigma = content.camera, content.cam_from_model, None
    focal_sigma = math.nan if camera.cov is None else float(np.sqrt(camera.cov[0, 0]))
    if content.pose_cov is not None:
        sigma = pose.pov_sigma(content.pose_cov, camera.focal_px, camera.size_px[0], focal_sigma)
    return Viewpoint(str(path), camera, pose, content.length_unit or wishes.unit, sigma,
                     (content.note,) if content.note else ())  # fmt: skip


def _typed(wishes: Wishes, base: Viewpoint | None) -> Viewpoint:
    """The numbers given; those that are not are the file's, and all must be given where there is no file."""
    size = parse_size(wishes.size)
    if base is None:
        missing = [OPTIONS[n] for n in (*NAMES, "fov_deg") if n not in wishes.numbers]
        if missing:
            raise UsageError(f"a point of view without a camera file needs all seven numbers; missing: {missing[0]}")
        pov, unit = PoV(**wishes.numbers), wishes.unit
        camera = perfect_camera(size or SIZE_PX, pov.fov_deg)
        return Viewpoint("the numbers given", camera, pov.pose, unit, None, _renamed(pov))
    pov = replace(base.pov, **wishes.numbers)
    camera = base.camera
    if size is not None and size != camera.size_px:
        raise UsageError(f"{base.name} is a camera of {camera.size_px} px; expected no other --size with it")
    if "fov_deg" in wishes.numbers:
        camera = replace(camera, focal_px=pov.focal_px(camera.size_px[0]), cov=None)
    given = ", ".join(OPTIONS[n] for n in wishes.numbers)
    return Viewpoint(f"{base.name} with {given} as given", camera, pov.pose, base.unit, None,
                     (*base.notes, *_renamed(pov)))  # fmt: skip


def _renamed(pov: PoV) -> tuple[str, ...]:
    """What to say where the angles given are another name of the ones that are printed."""
    same = pov.canonical
    if max(abs(getattr(pov, n) - getattr(same, n)) for n in NAMES[:3]) < 1e-6:
        return ()
    angles = ", ".join(f"{getattr(pov, n):g}" for n in NAMES[:3])
    return (f"rx, ry, rz = {angles} deg are another name of the angles below (ry from -90 to 90, rx and rz to 180)",)


def _framed(wishes: Wishes, points: Array) -> Viewpoint:
    if not len(points):
        raise UsageError("--direction frames a model; give its --grid or --markers")
    direction, up = (_three(text, option) for text, option in ((wishes.direction, "--direction"), (wishes.up, "--up")))
    size, fov = parse_size(wishes.size) or SIZE_PX, wishes.numbers.get("fov_deg", FOV_DEG)
    try:
        camera, pose = frame_view(points, direction=direction, up=up, size_px=size, fov_deg=fov)
    except WindmarkError as error:
        raise UsageError(f"--direction, --up: {error!s}") from error
    return Viewpoint(f"the view along {wishes.direction}", camera, pose, wishes.unit)


def _three(text: str | None, option: str) -> Array:
    try:
        values = np.array([float(part) for part in (text or "").split(",")])
    except ValueError:
        values = np.empty(0)
    if values.shape != (3,) or not np.isfinite(values).all() or not values.any():
        raise UsageError(f"{option}: expected three numbers x,y,z, not all zero; got {text!r}")
    return values


def singular_words(pov: PoV) -> str:
    """What is to be known of angles at or near the singular ones; empty elsewhere."""
    sign = "-" if pov.ry_deg > 0 else "+"
    if pov.singular:
        what = f"only rz {sign} rx is defined; rx = 0 is chosen"
        return f"ry is {pov.ry_deg:.0f} deg: rx and rz turn about one axis, {what}"
    if abs(pov.ry_deg) > 89:
        right = f"{math.copysign(90, pov.ry_deg):.0f}"
        return f"ry is near {right} deg: rx and rz turn about nearly one axis, rz {sign} rx is the sure one"
    return ""


def _described(view: Viewpoint, points: Array) -> tuple[Record, list[str]]:
    """A point of view as a record and in lines."""
    pov, sigma, camera = view.pov, view.sigma, view.camera
    width, height = camera.size_px
    unit = view.unit or "(unit not said)"
    ahead, top = view.pose.rotation[2], -view.pose.rotation[1]
    singular = singular_words(pov)
    notes = [*view.notes, *([singular] if singular else [])]
    record: Record = {
        "name": view.name, "pov": pov, "length_unit": view.unit, "size_px": camera.size_px,
        "focal_px": camera.focal_px, "station": view.pose.center, "direction": ahead, "up": top,
        "distance": float(np.linalg.norm(view.pose.translation)), "sigma": sigma, "notes": notes,
    }  # fmt: skip
    lines = [f"{view.name}: {width} x {height} px, focal length {camera.focal_px:.3f} px", *notes]
    for name in (*NAMES, "fov_deg"):
        angle = name.endswith("_deg")
        of = math.nan if sigma is None else getattr(sigma, name)
        digits, known = measured(getattr(pov, name), of) if of > 0 else (f"{getattr(pov, name):z.5f}", "")
        known = known and f"  sigma {known}"
        lines.append(f"  {name.removesuffix('_deg'):4s}{digits:>14s} {'deg' if angle else unit}{known}")
    lines += [
        f"  station in the model's frame: {_triple(view.pose.center)} {unit}",
        f"  looks along {_triple(ahead)}, {_triple(top)} is at the top of the image",
    ]
    if len(points):
        seen, words = _coverage(view, points)
        record["model"] = seen
        lines.append(f"  {words}")
    return record, lines


def _coverage(view: Viewpoint, points: Array) -> tuple[Record, str]:
    xy, valid = view.camera.project(view.pose.apply(points))
    inside = int((valid & view.camera.in_image(xy)).sum())
    before = int((view.pose.apply(points)[:, 2] > 0).sum())
    scale = units_per_px(view.camera, view.pose, points)
    record = {"points": len(points), "in_front": before, "in_image": inside, "units_per_px": scale}
    if not before:
        return record, "the whole model is behind this camera"
    unit = view.unit or "units"
    return record, f"{inside} of {len(points)} points of the model are in the image; {scale:.4g} {unit} per pixel"


def _triple(v: Array) -> str:
    rounded = np.where(np.abs(v) < 1e-12 * np.abs(v).max(initial=0.0), 0.0, v)  # no 1e-16 for nothing
    return "({})".format(", ".join(f"{x:.5g}" for x in rounded))


def _difference(a: Viewpoint, b: Viewpoint, points: Array) -> tuple[Record, list[str]]:
    """How far apart two points of view are: turn, viewing direction, roll, station; in pixels on the model."""
    between = float(np.degrees(np.arccos(np.clip(a.pose.rotation[2] @ b.pose.rotation[2], -1, 1))))
    turn = float(np.degrees(a.pose.angle_to(b.pose)))
    apart = b.pose.center - a.pose.center
    along = float(apart @ a.pose.rotation[2])
    record: Record = {
        "angle_deg": turn, "viewing_direction_deg": between, "station_distance": float(np.linalg.norm(apart)),
        "station_along_view": along, "fov_deg": b.pov.fov_deg - a.pov.fov_deg,
    }  # fmt: skip
    unit = a.unit or b.unit or "(unit not said)"
    lines = [
        f"difference: turned by {turn:.5g} deg (viewing directions {between:.5g} deg apart), stations"
        f" {record['station_distance']:.5g} {unit} apart ({along:.5g} along the view), field of view"
        f" {record['fov_deg']:.5g} deg",
    ]
    if len(points):
        shift = [v.camera.project(v.pose.apply(points))[0] for v in (a, b)]
        both = np.linalg.norm(shift[1] - shift[0], axis=1)
        both = both[np.isfinite(both)]
        if len(both):
            record["shift_px"] = {"rms": float(np.sqrt(np.mean(both**2))), "largest": float(both.max())}
            lines.append(f"  on the model: {record['shift_px']['rms']:.4g} px RMS, {both.max():.4g} px at most")
    return record, lines
