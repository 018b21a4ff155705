"""A calibration as files and as a record, and what of it can be read back."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import windmark
from windmark import io
from windmark.calibration import Calibration, NotCalibrated
from windmark.calibration.datum import Fixed, Free, Weighted
from windmark.calibration.quality import Comparison, KnownMarkers, SplitHalf, residual_map
from windmark.calibration.snooping import critical
from windmark.geometry import PARAMETERS
from windmark.geometry.camera import LENS_PARAMETERS
from windmark.io.cameras.record import FREE
from windmark.pipeline.lengths import Lengths
from windmark.scene import MarkerSet
from windmark.tasks.calibrate.marks import Marks
from windmark.tasks.calibrate.picture import Picture
from windmark.tasks.calibrate.rig import beside, beside_record
from windmark.tasks.calibrate.run import Calibrated

Array = NDArray[np.float64]
Record = dict[str, Any]

_COV = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}
MARKERS, MARKERS_COV = "markers.csv", "markers-covariance.csv"
STRONG = 0.9
"""Correlations between interior parameters above this are named."""


def write_calibration(done: Calibrated, folder: Path, unit: str, matched: Sequence[Picture] | None = None) -> None:
    """All files of a calibration into ``folder``; from pictures with the matches."""
    write_network(done.result, folder, unit)
    if matched is not None:
        io.write_table(folder / "matches.csv", match_columns(done.marks))


def write_network(result: Calibration, folder: Path, unit: str) -> None:
    """Cameras (of a rig to each other, too), markers, poses and residuals into ``folder``."""
    for name, camera in result.cameras.items():
        io.write_camera(folder / camera_file(result, name), camera)
    io.write_markers(folder / MARKERS, result.markers, length_unit="" if unit == FREE else unit)
    cov = {key: result.marker_cov[:, i, j] for key, (i, j) in _COV.items()}
    io.write_table(folder / MARKERS_COV, {"name": result.markers.name, **cov})
    io.write_table(folder / "poses.csv", pose_columns(result))
    if result.cam_from_rig:
        io.write_rig(folder / "rig.json", result.cam_from_rig, unit=unit, cov=result.rig_cov)
    io.write_json(folder / "poses.json", {"length_unit": unit, "views": pose_records(result)})
    place = folder / "views"
    place.mkdir()
    for view, cov in zip(result.views, result.pose_cov, strict=True):
        camera = result.camera(view.name)
        known = cov if view.cam_from_model is not None and np.isfinite(cov).all() else None
        io.write_camera(place / file_name(view.name), camera, view.cam_from_model, unit=unit, pose_cov=known)
    io.write_table(folder / "residuals.csv", residual_columns(result))


def camera_file(result: Calibration, name: str) -> str:
    """camera.json, or one file for each of several cameras."""
    return "camera.json" if len(result.cameras) == 1 else f"camera-{name}.json"


def file_name(view: str) -> str:
    """Of a view's camera with its pose; names of views may have the folder of their picture."""
    return f"{view.replace('/', '-').replace(chr(92), '-')}.json"


def views_seen(result: Calibration) -> NDArray[np.int64]:
    """(N,) views that each marker was used in."""
    return np.bincount(result.observations.point[result.used], minlength=len(result.markers))


def stations(result: Calibration) -> tuple[Array, Array]:
    """(V, 3) places of the cameras in the model's frame, and (V, 3, 3) their covariances."""
    poses = [result.pose(v.name) for v in result.views]
    turn = np.stack([p.rotation for p in poses])
    # The pose exp(delta) @ pose has its centre at c - R^T v to first order, v the shift in delta.
    return np.stack([p.center for p in poses]), np.swapaxes(turn, 1, 2) @ result.pose_cov[:, 3:, 3:] @ turn


def pose_columns(result: Calibration) -> dict[str, Any]:
    """One line per view: station, its sigma, angles about the camera's axes 1 sigma, marks and residual."""
    at, cov = stations(result)
    sigma = np.sqrt(np.maximum(np.diagonal(cov, axis1=1, axis2=2), 0.0))
    turn = np.degrees(np.sqrt(np.maximum(np.diagonal(result.pose_cov, axis1=1, axis2=2)[:, :3], 0.0)))
    pov = [
        result.pose(v.name).to_pov(result.cameras[v.camera].focal_px, result.cameras[v.camera].size_px[0])
        for v in result.views
    ]
    view, used = result.observations.view, result.used
    count = np.bincount(view[used], minlength=len(result.views))
    out = np.bincount(view[~used], minlength=len(result.views))
    squares = np.bincount(view[used], (result.residuals[used] ** 2).sum(axis=1), minlength=len(result.views))
    with np.errstate(invalid="ignore"):
        rms = np.sqrt(squares / count)
    return {
        "image": np.array([v.name for v in result.views]), "camera": np.array([v.camera for v in result.views]),
        "frame": np.array([v.frame for v in result.views]),
        **{axis: at[:, k] for k, axis in enumerate("xyz")},
        **{f"sigma_{axis}": sigma[:, k] for k, axis in enumerate("xyz")},
        **{f"r{axis}_deg": np.array([getattr(p, f"r{axis}_deg") for p in pov]) for axis in "xyz"},
        **{f"sigma_cam_{axis}_deg": turn[:, k] for k, axis in enumerate("xyz")},
        "focal_change": result.focal_change,
        **{f"principal_shift_{axis}_px": result.principal_shift[:, k] for k, axis in enumerate("xy")},
        "marks": count, "left_out": out, "rms_px": rms,
    }  # fmt: skip


def pose_records(result: Calibration) -> list[Record]:
    """Every pose with its whole covariance."""
    at, cov = stations(result)
    return [
        {
            "image": v.name, "camera": v.camera, "frame": v.frame, "rotation": result.pose(v.name).rotation,
            "translation": result.pose(v.name).translation, "covariance": result.pose_cov[n],
            "station": at[n], "station_covariance": cov[n], "focal_change": float(result.focal_change[n]),
            "principal_shift_px": result.principal_shift[n],
        }
        for n, v in enumerate(result.views)
    ]  # fmt: skip


def residual_columns(result: Calibration) -> dict[str, Any]:
    """One line per mark; ``test`` is its squared residual in units of its own variance."""
    obs = result.observations
    return {
        "image": np.array([v.name for v in result.views])[obs.view], "name": result.markers.name[obs.point],
        "x": obs.xy[:, 0], "y": obs.xy[:, 1], "dx": result.residuals[:, 0], "dy": result.residuals[:, 1],
        "test": result.test, "used": result.used.astype(np.int64),
    }  # fmt: skip


def match_columns(marks: Marks) -> dict[str, Any]:
    """The marks that were found in pictures, as a table that calibrates again."""
    obs, views = marks.observations, marks.views
    sigma = np.sqrt(np.diagonal(obs.cov, axis1=1, axis2=2))
    return {
        "image": np.array([v.name for v in views])[obs.view], "name": marks.markers.name[obs.point],
        "x": obs.xy[:, 0], "y": obs.xy[:, 1], "sigma_x": sigma[:, 0], "sigma_y": sigma[:, 1],
        "rho": obs.cov[:, 0, 1] / sigma.prod(axis=1), "camera": np.array([v.camera for v in views])[obs.view],
        "frame": np.array([v.frame for v in views])[obs.view],
    }  # fmt: skip


def read_known(folder: Path, lengths: Lengths) -> KnownMarkers:
    """Marker coordinates and covariances of an earlier calibration, from its folder.

    Raises
    ------
    FileError
        When the folder has no such tables, or they name different markers.
    """
    markers = lengths.markers(folder / MARKERS, None)
    table = io.read_table(folder / MARKERS_COV, required=("name", *_COV), known=("name", *_COV))
    if table.text("name") != markers.name.tolist():
        raise io.FileError(folder / MARKERS_COV, f"names other markers than {MARKERS}")
    cov = np.empty((len(markers), 3, 3))
    for key, (i, j) in _COV.items():
        cov[:, i, j] = cov[:, j, i] = table.numbers(key)
    return KnownMarkers(markers, cov)


def datum_words(result: Calibration) -> list[str]:
    """What fixes position, direction and size, in sentences."""
    datum, bars = result.options["datum"], result.options["distances"]
    if datum == Fixed():
        words = ["All markers are held where their table has them: cameras and poses alone were adjusted, and an error "
                 "of the table is an error of the result."]  # fmt: skip
    elif isinstance(datum, Fixed):
        text = f"Position, direction and size are those of the markers {_listed(datum.markers or ())}, held where their"
        words = [text + " table has them, with no uncertainty of their own."]
    elif isinstance(datum, Weighted):
        which = "all markers with a sigma" if datum.markers is None else _listed(datum.markers)
        sigma = "their sigma" if datum.sigma is None else f"a sigma of {datum.sigma:g} per coordinate"
        words = [
            f"Position, direction and size come from {which}, known with {sigma}; they were adjusted with the rest."
        ]
        if datum.covariance is not None:
            words.append(f"The errors of {_listed(datum.covariance.name)} are known together, with their correlations.")
    else:
        assert isinstance(datum, Free)
        which = "all markers" if datum.markers is None else f"the markers {_listed(datum.markers)}"
        kept = "shift nor turn" if bars else "shift, turn nor grow"
        words = [f"Free network: on average {which} do not {kept} against their rough coordinates. Covariances "
                 "are those"
                 " of the network's shape: errors that shift or turn the whole are not in them."]  # fmt: skip
        if not bars:
            words.append("The size is that of the rough coordinates: an error in their scale is an error of the "
                         "result. "
                         "A known distance (--distance) gives it a scale of its own.")  # fmt: skip
    words += [f"Known distance: {d.first} to {d.second}, {d.length:g} with sigma {d.sigma:g}." for d in bars]
    return words


def _listed(names: Any) -> str:
    names = list(names)
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")


def correlations(result: Calibration, camera: str) -> list[tuple[str, str, float]]:
    """Pairs of interior parameters that are correlated beyond `STRONG`, strongest first."""
    cov = result.cameras[camera].cov
    if cov is None:
        return []
    free = [k for k, name in enumerate(PARAMETERS) if cov[k, k] > 0]
    sigma = np.sqrt(np.diag(cov))
    pairs = [
        (PARAMETERS[a], PARAMETERS[b], float(cov[a, b] / (sigma[a] * sigma[b])))
        for n, a in enumerate(free)
        for b in free[n + 1 :]
    ]
    return sorted((p for p in pairs if abs(p[2]) > STRONG), key=lambda p: -abs(p[2]))


def record(
    done: Calibrated,
    unit: str,
    *,
    matched: Sequence[Picture] | None = None,
    against: Comparison | None = None,
) -> Record:
    """The calibration in figures: what `--json` prints and summary.json holds."""
    result = done.result
    cameras = {
        name: {
            "size_px": camera.size_px,
            "lens": camera.lens,
            **{p: {"value": getattr(camera, p), "sigma": result.sigma(name, p)} for p in LENS_PARAMETERS[camera.lens]},
            "correlated": [{"pair": [a, b], "correlation": r} for a, b, r in correlations(result, name)],
            "residual_map_excess": residual_map(result, name).excess,
        }
        for name, camera in result.cameras.items()
    }
    return {
        "windmark": windmark.__version__, "length_unit": unit, "sigma0": result.sigma0,
        "redundancy": result.redundancy, "rms_px": result.rms_px, "marks": len(result.observations),
        "left_out": int((~result.used).sum()), "test_limit": critical(len(result.test)), "views": len(result.views),
        "markers": len(result.markers), "marker_sigma_rms": sigma_rms(result.markers), "datum": datum_words(result),
        "cameras": cameras, "rig": [beside_record(b) for b in beside(result)],
        "halves": _halves_record(done.halves), "suspect": list(result.suspect),
        "warnings": list(result.warnings),
        "unchecked": [
            {"what": what, "words": words}
            for what, words in (("mirror", done.unchecked), ("control", result.unchecked)) if words
        ],
        "swapped": [list(s) for s in result.swapped], "dropped": dict(result.dropped),
        "converged": result.report.reason, "iterations": result.report.iterations,
        "pictures": None if matched is None else [vars_of(m) for m in matched],
        "against": None if against is None else comparison_record(against),
    }  # fmt: skip


def vars_of(one: Picture) -> Record:
    """One picture in figures."""
    return {
        "image": one.name, "spots": len(one.detections), "matched": one.count, "round": one.round,
        "problem": one.problem,
    }  # fmt: skip


def sigma_rms(markers: MarkerSet) -> Array:
    """(3,) root mean square of the markers' sigma along x, y, z."""
    return np.sqrt((markers.sigma**2).mean(axis=0))


def comparison_record(found: Comparison) -> Record:
    """A comparison in figures."""
    return {"markers": len(found.name), "ratio": found.ratio, "rms": found.rms,
            "largest": float(np.linalg.norm(found.difference, axis=1).max())}  # fmt: skip


def _halves_record(halves: SplitHalf | NotCalibrated) -> Record:
    if isinstance(halves, NotCalibrated):
        return {"done": False, "reason": halves.reason}
    change = {c: {p: {"change": d, "sigma": s} for p, (d, s) in of.items()} for c, of in halves.change.items()}
    compared = {} if halves.comparison is None else comparison_record(halves.comparison)
    return {"done": True, **compared, "ratio": halves.ratio, "change": change}
