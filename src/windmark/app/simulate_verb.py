"""The verb `windmark simulate`: synthetic tests of every kind, written whole, and what to do with them next."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from windmark.app import console
from windmark.app.progress import progress
from windmark.errors import UsageError
from windmark.pipeline.typed import typed

Record = dict[str, Any]
Kind = tuple[Callable[[Path], Any], Callable[[Any, Path], tuple[Record, list[str]]]]


@dataclass(frozen=True)
class Wishes:
    """Which test: none of them is the default one, a wing wind-off and wind-on before one camera."""

    deforming: int | None = None
    infrared: int | None = None
    cameras: int | None = None
    photos: int | None = None
    clocks: bool = False
    psp: int | None = None
    board: int | None = None
    sequence: int | None = None


def simulate(folder: Path, seed: int, wishes: Wishes, as_json: bool) -> None:
    """Make the test, say what it holds."""
    chosen = [name for name in KINDS if getattr(wishes, name) is not None]
    if len(chosen) > 1:
        raise UsageError(f"{', '.join(f'--{name}' for name in chosen)} are different tests; give one of them")
    if wishes.clocks and wishes.deforming is None:
        raise UsageError("--clocks belongs to --deforming")
    write, describe = (KINDS[chosen[0]] if chosen else _default)(seed, wishes)
    with progress() as show, console.result_folder(folder) as out:
        show("render the virtual wind tunnel")
        made = write(out.place)
    record, lines = describe(made, folder)
    console.answer({"folder": folder, "seed": seed, **record}, as_json, lines)


def _next(folder: Path, verb: str = "run", project: str = "project.toml") -> str:
    return f"next: {typed('windmark', verb, folder / project)}"


def _default(seed: int, wishes: Wishes) -> Kind:
    from windmark.pipeline.simulate import simulate as write

    def describe(test: Any, folder: Path) -> tuple[Record, list[str]]:
        markers, nodes = len(test.markers), len(test.mesh.vertices)
        record = {"markers": markers, "grid_nodes": nodes, "images": [shot.view.frame for shot in test.shots]}
        said = f"{len(test.shots)} images, {markers} markers, {nodes} grid nodes: {folder}"
        return record, [said, _next(folder)]

    return lambda place: write(place, seed), describe


def _infrared(seed: int, wishes: Wishes) -> Kind:
    from windmark.pipeline.simulate_infrared import simulate_infrared as write

    frames = wishes.infrared or 0

    def describe(made: Any, folder: Path) -> tuple[Record, list[str]]:
        markers, nodes = len(made.test.markers), len(made.mesh.vertices)
        said = f"{frames} frames of {len(made.cameras)} infrared cameras, {markers} markers, {nodes} nodes: {folder}"
        record = {"markers": markers, "grid_nodes": nodes, "frames": frames, "cameras": list(made.cameras)}
        return record, [said, _next(folder, "infrared", "infrared.toml")]

    return lambda place: write(place, seed, frames), describe


def _cameras(seed: int, wishes: Wishes) -> Kind:
    from windmark.pipeline.simulate_cameras import simulate_cameras as write

    count = wishes.cameras or 0

    def describe(test: Any, folder: Path) -> tuple[Record, list[str]]:
        markers, nodes = len(test.markers), len(test.mesh.vertices)
        said = f"a picture each of {count} cameras, {markers} markers, {nodes} grid nodes: {folder}"
        return {"markers": markers, "grid_nodes": nodes, "cameras": list(test.cameras)}, [said, _next(folder)]

    return lambda place: write(place, seed, count), describe


def _photos(seed: int, wishes: Wishes) -> Kind:
    from windmark.pipeline.simulate_photos import simulate_photos as write

    count = wishes.photos or 0

    def describe(test: Any, folder: Path) -> tuple[Record, list[str]]:
        photos, camera = folder / "photos" / "*.tif", ("-c", folder / "camera.json")
        known = ("--unit", "mm", "--radius", "2.7")
        commands = (
            typed("windmark", "calibrate", photos, *camera, "-m", folder / "rough.csv", "--datum", "free", *known),
            typed("windmark", "reconstruct", photos, *camera, "-p", folder / "primary.csv", *known),
        )
        said = f"{count} pictures, {len(test.markers)} markers: {folder}"
        return {"markers": len(test.markers), "photos": count}, [said, *(f"next: {c}" for c in commands)]

    return lambda place: write(place, seed, count), describe


def _deforming(seed: int, wishes: Wishes) -> Kind:
    from windmark.pipeline.simulate_deforming import simulate_deforming as write

    frames = wishes.deforming or 0

    def describe(test: Any, folder: Path) -> tuple[Record, list[str]]:
        record = {"markers": len(test.markers), "frames": frames, "cameras": list(test.cameras)}
        said = f"{frames} frames of {len(test.cameras)} cameras, {len(test.markers)} markers: {folder}"
        return record, [said, _next(folder, "deform", "deform.toml")]

    return lambda place: write(place, seed, frames, clocks=wishes.clocks), describe


def _psp(seed: int, wishes: Wishes) -> Kind:
    from windmark.pipeline.simulate_psp import simulate_psp as write

    incidences = wishes.psp or 0

    def describe(test: Any, folder: Path) -> tuple[Record, list[str]]:
        record = {"markers": len(test.test.markers), "taps": len(test.taps), "points": [p.name for p in test.points],
                  "cameras": list(test.cameras)}  # fmt: skip
        said = f"{len(test.points)} points of {len(test.cameras)} cameras, {len(test.taps)} taps: {folder}"
        return record, [said, _next(folder, "psp", "psp.toml")]

    return lambda place: write(place, seed, incidences), describe


def _board(seed: int, wishes: Wishes) -> Kind:
    from windmark.pipeline.simulate_board import MARKS, PITCH
    from windmark.pipeline.simulate_board import simulate_board as write

    count = wishes.board or 0

    def describe(cameras: Any, folder: Path) -> tuple[Record, list[str]]:
        # With its marks the dots may be off their table, as those of a printer are: without them they are held.
        command = typed("windmark", "calibrate", folder / "board" / "left_*.tif", "--board", f"{PITCH}", "--unit", "mm",
                        "-r", "9", "--board-marks", MARKS)  # fmt: skip
        said = f"{count} pictures of a board by each of two cameras: {folder}"
        return {"pictures": count, "cameras": list(cameras)}, [said, f"next: {command}"]

    return lambda place: write(place, seed, count), describe


def _sequence(seed: int, wishes: Wishes) -> Kind:
    from windmark.pipeline.simulate_sequence import simulate_sequence as write

    frames = wishes.sequence or 0

    def describe(test: Any, folder: Path) -> tuple[Record, list[str]]:
        command = typed("windmark", "track", folder / "frames" / "*.tif", "-m", folder / "markers.csv", "-c",
                        folder / "camera.json", "-r", "4", "--unit", "mm", "--roles", "model")  # fmt: skip
        said = f"{frames} pictures of a swinging model: {folder}"
        return {"markers": len(test.markers), "frames": frames}, [said, f"next: {command}"]

    return lambda place: write(place, seed, frames), describe


KINDS: dict[str, Callable[[int, Wishes], Kind]] = {
    "infrared": _infrared, "deforming": _deforming, "cameras": _cameras, "photos": _photos, "psp": _psp,
    "board": _board, "sequence": _sequence,
}  # fmt: skip
"""Name of a wish -> who makes such a test."""
