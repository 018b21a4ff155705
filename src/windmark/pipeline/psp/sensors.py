"""What a camera does to the light: dark and flat pictures, and the gain that the pictures themselves show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.errors import DataError
from windmark.paint import Linearity, NotFitted, PhotonTransfer, SensorModel, mean_dark, mean_flat, photon_transfer
from windmark.pipeline.deform.frames import files_of
from windmark.pipeline.deform.pictures import read
from windmark.pipeline.psp.bits import Bits, DarkLevel
from windmark.pipeline.psp.entries import CAMERA
from windmark.pipeline.psp.project import PspProject
from windmark.pipeline.psp.response import OddResponse, odd_response
from windmark.pipeline.psp.table import PointRow
from windmark.pipeline.same_picture import content_of, first_of
from windmark.pipeline.settings import existing
from windmark.scene import Mesh
from windmark.tasks.deform.task import Station
from windmark.tasks.psp.flats import clipped_part

Array = NDArray[np.float64]

WindOff = tuple[PhotonTransfer | None, str, list[str]]
TRIED = 3
"""Points whose wind-off pictures are asked for the gain, one after the other."""


@dataclass(frozen=True)
class CameraSensor:
    """A camera's sensor.

    Parameters
    ----------
    model : how pictures are corrected
    gain_from : what said the gain
    remarks : what is to be said
    black_given : whether anything says the level without light
    contents : of its dark and flat pictures, see `same_picture.content_of` -> their names in words
    dark : how the levels of its dark pictures are stored; None without
    odd : what the noise of its pictures says against them, see `odd_response`; None where it says nothing
    flat_clipped : part of the model's pixels that are saturated in its flat pictures, see `flats.clipped_part`
    """

    model: SensorModel
    gain_from: str
    remarks: tuple[str, ...] = ()
    black_given: bool = True
    contents: Mapping[bytes, str] = field(default_factory=dict)
    dark: DarkLevel | None = None
    odd: OddResponse | None = None
    flat_clipped: float = 0.0


def pictures_named(project: PspProject, pattern: str, camera: str) -> list[io.PictureFile]:
    """The pictures that a pattern names for a camera, in order; none where there is no such file."""
    return files_of(project.path.parent / pattern.replace(CAMERA, camera))


def read_sensor(
    project: PspProject, name: str, station: Station, rows: Sequence[PointRow], mesh: Mesh
) -> CameraSensor:
    """The sensor of a camera from its dark and flat pictures, and its gain from pictures of one scene.

    ``mesh``: the model at rest, which flat pictures must show unsaturated.
    Where the project does not say the gain, the scatter of several flat pictures does or, where an even field tells too
    little, that of the first points' wind-off pictures.

    Raises
    ------
    FileError
        For patterns that name no picture, pictures of another size, flats that are no brighter than the dark, and where
        nothing says the gain: without it no result has a sigma.
    """
    how = project.radiometry
    remarks: list[str] = []
    contents: dict[bytes, str] = {}
    (dark, dark_variance, dead), stored = _dark(project, name, station, remarks, contents)
    saturation = np.inf if how.saturation is None else how.saturation
    if how.flat is None:
        remarks.append(f"camera {name}: no flat pictures are given: unequal pixels are not corrected, nor in any sigma")
    flats = None if how.flat is None else _read_all(project, "flat", name, station, remarks, contents)
    noise = float("nan") if stored is None or how.linearity is not None else stored.noise
    gain, read_variance, source = how.gain_levels, how.read_variance, "radiometry.gain"
    seen = None
    if gain is None or np.isfinite(noise):
        seen = _of_wind_off(project, name, station, rows, dark)
    if gain is None:
        gain, read_variance, source = _gain(project, name, flats, dark, seen)
    odd = None if seen is None or seen[0] is None else odd_response(seen[0], noise)
    linearity = None if how.linearity is None else read_linearity(named_file(project, "linearity", name))
    sensor = SensorModel(dark, saturation, gain, read_variance, dark_variance, linearity=linearity, dead=dead)
    clipped = 0.0
    if flats is not None:
        clipped = clipped_part(flats, sensor, station, mesh)
        try:
            flat, flat_variance, bad = mean_flat(flats, sensor)
        except DataError as error:
            raise io.FileError(project.path, f"camera {name}: {error}", "radiometry.flat") from None
        bad = bad if dead is None else bad | dead
        sensor = replace(sensor, flat=flat, flat_variance=flat_variance, dead=bad)
    return CameraSensor(
        sensor, source, tuple(remarks), how.dark is not None or how.black is not None, contents, stored, odd,
        clipped,
    )  # fmt: skip


def named_file(project: PspProject, key: str, camera: str) -> Path:
    """The file of a key of ``[radiometry]`` for a camera; FileError where there is none."""
    return existing(project.path, f"radiometry.{key}", Path(getattr(project.radiometry, key).replace(CAMERA, camera)))


def read_linearity(path: Path) -> Linearity:
    """A CSV table ``level,light``: grey levels less dark, and the light that they stand for, in any unit.

    Raises
    ------
    FileError
        For a table of fewer than two rows, or one that does not rise all the way.
    """
    table = io.read_table(path, required=("level", "light"), known=None)
    level, light = table.numbers("level"), table.numbers("light")
    if len(level) < 2:
        raise io.FileError(path, f"has {len(level)} rows; expected at least two")
    rising = np.r_[True, (np.diff(level) > 0) & (np.diff(light) > 0)]
    table.check(rising, "level and light must both rise from row to row")
    return Linearity(level, light)


def _dark(
    project: PspProject, name: str, station: Station, remarks: list[str], contents: dict[bytes, str]
) -> tuple[tuple[Array | float, Array | float, NDArray[np.bool_] | None], DarkLevel | None]:
    """Level without light, its variance, dead and hot pixels; and how its pictures are stored."""
    how = project.radiometry
    if how.dark is not None:
        frames = _read_all(project, "dark", name, station, remarks, contents)
        found = mean_dark(frames)
        noise = float(np.median(found[1])) * len(frames) if len(frames) > 1 else float("nan")
        return found, DarkLevel(found[0], Bits.of(frames), noise)
    if how.black is None:
        remarks.append(f"camera {name}: neither dark pictures nor radiometry.black are given: the level without light "
                       "is taken as 0")  # fmt: skip
    return (how.black or 0.0, 0.0, None), None


def _gain(
    project: PspProject, name: str, flats: Array | None, dark: Array | float, off: WindOff | None
) -> tuple[float, float, str]:
    """Gain, read variance, and which pictures say them."""
    reasons = []
    if flats is not None and len(flats) > 1:
        found = photon_transfer(flats, dark=dark, saturation=project.radiometry.saturation)
        if not isinstance(found, NotFitted):
            return found.gain, found.read_variance, "flat pictures"
        reasons.append(f"flat pictures: {found.reason}")
    assert off is not None
    if off[0] is not None:
        return off[0].gain, off[0].read_variance, off[1]
    why = "; ".join([*reasons, *off[2]]) or "there are none"
    raise io.FileError(
        project.path, f"camera {name}: no pictures say its gain ({why}); expected it in photo-electrons per grey level",
        "radiometry.gain",
    )  # fmt: skip


def _of_wind_off(
    project: PspProject, name: str, station: Station, rows: Sequence[PointRow], dark: Array | float
) -> WindOff:
    """The noise of the first wind-off pictures that tell it; their name in words; why others do not."""
    reasons = []
    for row in rows[:TRIED]:
        off = row.off or next((part.pattern for part in row.parts if not row.own), "")
        files = pictures_named(project, off, name) if off else []
        if len(files) < 2:
            reasons.append(f"wind-off pictures of {row.name}: there are {len(files)}, two are needed")
            continue
        good = _readable(files, station)
        good = [good[k] for k, first in enumerate(first_of([content_of(g) for g in good])) if k == first]
        if len(good) < 2:
            reasons.append(f"wind-off pictures of {row.name}: {len(good)} of {len(files)} can be read and are no "
                           "copies, two are needed")  # fmt: skip
            continue
        found = photon_transfer(np.stack(good), dark=dark, saturation=project.radiometry.saturation)
        if not isinstance(found, NotFitted):
            return found, f"wind-off pictures of {row.name}", reasons
        reasons.append(f"wind-off pictures of {row.name}: {found.reason}")
    return None, "", reasons


def _read_all(
    project: PspProject, kind: str, name: str, station: Station, remarks: list[str], contents: dict[bytes, str]
) -> Array:
    """(F, H, W) the pictures of a kind, dark or flat; one that is there twice counts once."""
    pattern = getattr(project.radiometry, kind)
    files = pictures_named(project, pattern, name)
    if not files:
        shown = pattern.replace(CAMERA, name)
        raise io.FileError(project.path, f"no file matches {shown!r} beside the project", f"radiometry.{kind}")
    images = [np.asarray(read(file, station)) for file in files]
    own = [content_of(image) for image in images]
    first = first_of(own)
    for k, of in enumerate(first):
        if of != k:
            remarks.append(f"camera {name}: {kind} picture {files[k].name} is the same picture as {files[of].name}: it "
                           "counts once")  # fmt: skip
    contents.update((content, f"{kind} picture {file.name}") for content, file in zip(own, files, strict=True))
    return np.stack([image for k, image in enumerate(images) if first[k] == k])


def _readable(files: Sequence[io.PictureFile], station: Station) -> list[NDArray[np.generic]]:
    """Those that can be read: a point's pictures may be bad, it says which when it is reduced."""
    out = []
    for file in files:
        with suppress(io.FileError):
            out.append(np.asarray(read(file, station)))
    return out
