"""The verb `windmark reconstruct`: read, find the spots, reconstruct, write one folder, say it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from windmark import io
from windmark.app import console
from windmark.app.alone import not_drawn
from windmark.app.progress import progress
from windmark.app.provenance import Provenance
from windmark.app.verdict_words import put_verdict, verdict_lines
from windmark.calibration import Distance
from windmark.errors import UsageError, g2
from windmark.geometry import Camera
from windmark.pipeline.alike import left_out
from windmark.pipeline.calibrate import MatchOptions, Picture
from windmark.pipeline.calibrate.outputs import sigma_rms
from windmark.pipeline.calibrate.read import picture_names
from windmark.pipeline.clock import Clock
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.reconstruct.outputs import (
    length_words,
    picture_records,
    primary_residuals,
    primary_sigma_words,
    record,
    write_reconstruction,
)  # fmt: skip
from windmark.pipeline.reconstruct.read import read_labels, read_poses, read_spots
from windmark.pipeline.verdict import Verdict
from windmark.pipeline.verdict.network import reconstruct_verdict
from windmark.scene import MarkerSet
from windmark.tasks.reconstruct import NotReconstructed, Reconstruction, reconstruct
from windmark.tasks.reconstruct.free import sigma_words
from windmark.tasks.reconstruct.pair import PairLines, pair_lines

Record = dict[str, Any]

FREE_UNIT = "free"
"""Length unit of a result whose scale is free."""
NO_MARKERS = MarkerSet.make([], np.zeros((0, 3)))


@dataclass(frozen=True)
class Files:
    """What is read and written.

    Parameters
    ----------
    images : the pictures
    cameras, patterns : interior parameters by name; camera -> pattern of its images' names, for several cameras
    primary, labels, rough : tables of known markers, of their places in pictures, of rough coordinates
    poses : folder of known poses
    free : interior parameters to be found, too
    model_px : noise of the spots beyond their own
    pair : names of two pictures to be drawn with their epipolar lines
    unit : length unit of the markers
    output : folder of the results
    free_frame : no primary markers
    distances : known ones, with a free frame
    primary_cov : table of the joint covariance of primaries
    """

    images: tuple[io.PictureFile, ...]
    cameras: Mapping[str, Camera]
    patterns: Mapping[str, str]
    primary: Path | None
    labels: Path | None
    rough: Path | None
    poses: Path | None
    free: tuple[str, ...]
    model_px: float
    pair: tuple[str, str] | None
    unit: str
    output: Path
    free_frame: bool = False
    distances: tuple[Distance, ...] = ()
    primary_cov: Path | None = None

    def __post_init__(self) -> None:
        if self.free_frame == (self.primary is not None):
            raise UsageError("give --primary, the known markers, or --free-frame where there are none; one of the two")
        if self.primary_cov is not None and self.free_frame:
            raise UsageError("--primary-cov is the covariance of --primary; with --free-frame there are none")
        if self.distances and not self.free_frame:
            raise UsageError("--distance is for --free-frame; the primary markers have a scale of their own")
        if self.distances and self.poses is not None:
            raise UsageError("--poses have a scale of their own: leave --distance out")
        if self.distances and self.labels is None:
            raise UsageError("--distance names markers: --labels must say where they are (image,name,x,y)")
        metric = self.primary is not None or self.poses is not None or bool(self.distances)
        if not metric and self.unit not in ("", FREE_UNIT):
            raise UsageError("--unit has no meaning without --primary, --poses or --distance: the scale is free")
        if metric:
            Lengths(self.unit)
        if self.patterns and set(self.patterns) != set(self.cameras):
            raise UsageError(f"--images-of is for the cameras {', '.join(self.patterns)}, --camera for "
                             f"{', '.join(self.cameras)}; expected the same")  # fmt: skip
        unknown = [n for n in self.pair or () if n not in self.names]
        if unknown or (self.pair is not None and self.pair[0] == self.pair[1]):
            raise UsageError(f"--pair: expected the names of two different pictures among {', '.join(self.names[:5])}, "
                             f"got {' and '.join(self.pair or ())}")  # fmt: skip

    @property
    def names(self) -> list[str]:
        """Names of the pictures."""
        return picture_names(self.images)


def run(files: Files, match: MatchOptions, as_json: bool) -> None:
    """Reconstruct and write everything into a folder, whole or not at all."""
    lengths = Lengths(files.unit if files.unit in io.LENGTH_UNITS else None)
    primary = NO_MARKERS if files.primary is None else lengths.markers(files.primary)
    cov = None if files.primary_cov is None else lengths.covariance(files.primary_cov, primary)
    primary = primary if cov is None else cov.on(primary)
    rough = None if files.rough is None else lengths.markers(files.rough)
    table = None if files.labels is None else read_labels(files.labels, files.names, primary)
    poses = {} if files.poses is None else read_poses(files.poses, files.names, lengths)
    console.notes(lengths)
    with progress() as show, console.result_folder(files.output) as out:
        clock = Clock(show)
        pictures, views = read_spots(files.images, files.cameras, files.patterns, match, clock)
        views = tuple(replace(v, cam_from_model=poses.get(v.name)) for v in views)
        labels = None if table is None else table.spots(pictures)
        with clock("reconstruct"):
            result = reconstruct(
                [p.detections for p in pictures], files.cameras, None if files.free_frame else primary,
                primary_cov=cov, views=views, labels=labels, rough=rough, free=files.free, model_px=files.model_px,
                distances=files.distances, seed=match.seed,
            )  # fmt: skip
        unread = {p.name: p.unread for p in pictures if p.unread and p.name in result.dropped}
        result = replace(result, dropped={**result.dropped, **unread})
        if isinstance(result, NotReconstructed):
            verdict = reconstruct_verdict(result, files.unit, pictures)
            console.refuse(_why(result), as_json, {**_refusal(result, pictures), "verdict": verdict.record()},
                           verdict.next_step)  # fmt: skip
            return
        if result.free_scale:
            files = replace(files, unit=FREE_UNIT)
        pair = _pair(files, result, pictures)
        content = _write(out, files, result, primary, pictures, pair, match, clock)
    console.answer({**content, "folder": files.output}, as_json, [
        *_lines(result, primary, pictures, pair, files), *verdict_lines(Verdict.of_record(content["verdict"])),
        *not_drawn(content["not_drawn"]),
        f"report: {files.output / 'report.html'}",
    ])  # fmt: skip


def _pair(files: Files, result: Reconstruction, pictures: Sequence[Picture]) -> PairLines | None:
    """The lines of the pair that was asked for; None where one of its pictures has no pose."""
    if files.pair is None or any(n in result.dropped for n in files.pair):
        return None
    spots = {p.name: p.detections.xy for p in pictures}
    a, b = files.pair
    return pair_lines(result, a, b, spots[a], spots[b])


def _write(
    out: io.ResultFolder, files: Files, result: Reconstruction, primary: MarkerSet, pictures: Sequence[Picture],
    pair: PairLines | None, match: MatchOptions, clock: Clock,
) -> Record:  # fmt: skip
    """The folder; what its summary holds."""
    from windmark.app.reconstruct_report import Shown, reconstruction_report

    place = out.place
    with clock("write"):
        write_reconstruction(result, place, files.unit, {p.name: p.detections for p in pictures})
    content = record(result, primary, pictures, files.unit, pair)
    with clock("draw report"):
        paths = dict(zip(files.names, files.images, strict=True))
        shown = Shown(files.unit, primary, pictures, paths, match, pair)
        page = reconstruction_report(result, shown, clock, place)
    verdict = reconstruct_verdict(result, length_words(files.unit), pictures)
    put_verdict(page, verdict)
    content["verdict"] = verdict.record()
    page.provenance(Provenance(out.sources()))
    (place / "report.html").write_text(page.html(), encoding="utf-8")
    content["not_drawn"] = page.failed
    console.write_summary(out, {**content, "seconds": clock.seconds})
    return content


def _why(no: NotReconstructed) -> str:
    """The refusal in words: reason, and which pictures could not take part."""
    return ". ".join([f"not reconstructed: {no.reason}", *left_out(no.dropped, no.reason)])


def _refusal(no: NotReconstructed, pictures: Sequence[Picture]) -> Record:
    return {"reconstructed": False, "reason": no.reason, "cause": no.cause, "dropped": dict(no.dropped),
            "pictures": picture_records(pictures, no)}  # fmt: skip


def _lines(
    result: Reconstruction, primary: MarkerSet, pictures: Sequence[Picture], pair: PairLines | None, files: Files
) -> list[str]:
    """The reconstruction in a few lines."""
    done, unit, against = result.calibration, files.unit, primary_residuals(result, primary)
    posed, seen = len(pictures) - len(result.dropped), result.count
    rms = sigma_rms(result.markers)
    lines = [
        f"{posed} of {len(pictures)} pictures used, {len(result.markers)} markers ({len(against.name)} primary), in "
        f"{seen.min()} to {seen.max()} pictures each; {int(done.used.sum())} marks, "
        f"{int((~done.used).sum())} left out; sigma0 {done.sigma0:.3f}, RMS {result.rms_px:.3f} px",
        f"markers, 1 sigma: {g2(rms[0])}, {g2(rms[1])}, {g2(rms[2])} {length_words(unit)} along x, y, z",
    ]
    if result.frame:
        lines.append(f"{result.frame}; {sigma_words(result.frame)}")
    if len(against.name):
        rms_known = (against.difference**2).sum(axis=1).mean() ** 0.5
        lines.append(f"primaries against their table: {g2(rms_known)} {unit} RMS")
    lines += [f"primaries: {words}" for words in primary_sigma_words(primary, unit)]
    lines += [f"  open: {name}: {len(spots)} spots have several possible partners, or one that could be chance"
              for name, spots in result.open_spots.items() if len(spots)]  # fmt: skip
    lines += [f"  primary marker {name} was not recognised: {result.unrecognised[name]}" for name in against.missing]
    for name, camera in result.cameras.items():
        free = [f"{p} {getattr(camera, p):.6g} ({g2(done.sigma(name, p))})" for p in files.free]
        lines += [f"{name}: {', '.join(free)}"] if free else []
    lines += [f"  not used: {name}: {why}" for name, why in result.dropped.items()]
    lines += [f"warning: {sentence}" for sentence in result.warnings]
    if pair is not None:
        drawn = files.output / "pair.png"
        lines.append(f"{pair.a.name} and {pair.b.name}: {len(pair.names)} markers in both, RMS {pair.rms_px:.3f} px "
                     "from their epipolar lines" + (f": {drawn}" if drawn.is_file() else ""))  # fmt: skip
    elif files.pair is not None:
        gone = next(n for n in files.pair if n in result.dropped)
        lines.append(f"--pair was not drawn: {gone} has no pose")
    return lines
