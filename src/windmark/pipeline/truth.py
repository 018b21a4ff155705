"""A result held against the truth of a synthetic test."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from windmark.geometry import Pose
from windmark.pipeline.results import ImageResult, RunResult
from windmark.pipeline.simulate import true_levels
from windmark.scene import MarkerSet
from windmark.synth import Sensor, Shot, TunnelTest

EXPLANATION = (
    "Labels: a marker is wrong when its spot is more than 2 px from the true image of the disc. Centres: distance of"
    " the spot from the centroid of the disc's true image. Place on the surface: distance in the image between where a"
    " node is and where the found pose puts it. Values: against the noise-free grey level of the node; the median, so"
    " that markers and dirt, which the truth leaves out, do not count."
)


@dataclass(frozen=True)
class Comparison:
    """Found against true, one row per image."""

    good: bool
    verdict: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    explanation: str = EXPLANATION

    def record(self) -> dict[str, Any]:
        """The same for machines."""
        images = [dict(zip(self.columns, row, strict=True)) for row in self.rows]
        return {"good": self.good, "verdict": self.verdict, "images": images}


COLUMNS = (
    "image", "markers visible", "labelled right", "labelled wrong", "centre RMS px", "pose deg", "station mm",
    "place on the surface RMS px", "value error median %",
)  # fmt: skip


def compare(result: RunResult, test: TunnelTest) -> Comparison:
    """Hold every image of a result against its shot of the test; images are named by their frame."""
    assert result.markers is not None
    rows = tuple(_row(item, test.shot(item.name), test, result.markers) for item in result.images)
    wrong, missing = sum(row[3] for row in rows), sum(row[1] - row[2] for row in rows)
    lost = [row[0] for row in rows if not row[2]]
    if lost:
        verdict = f"Not registered: {', '.join(lost)}."
    elif wrong:
        verdict = f"{wrong} markers are labelled wrong."
    else:
        verdict = f"No marker is labelled wrong; {sum(r[2] for r in rows)} of {sum(r[1] for r in rows)} are labelled."
    return Comparison(not (wrong or lost or missing > 0.1 * sum(r[1] for r in rows)), verdict, COLUMNS, rows)


def _row(item: ImageResult, shot: Shot, test: TunnelTest, markers: MarkerSet) -> tuple[Any, ...]:
    truth = shot.perfect.markers
    row_of = {name: k for k, name in enumerate(test.markers.name)}
    used = np.array([row_of[name] for name in markers.name])
    visible = int(truth.visible[used].sum())
    answer, pose = item.registered, item.cam_from_model
    if answer is None or pose is None or item.detections is None:
        return (item.name, visible, 0, 0, None, None, None, None, None)
    index = used[answer.matching.marker]
    distance = np.linalg.norm(item.detections.xy[answer.matching.detection] - truth.ellipse_xy[index], axis=1)
    right = distance <= 2.0
    true_pose = shot.view.cam_from_model
    assert true_pose is not None
    return (
        item.name,
        visible,
        int(right.sum()),
        int((~right).sum()),
        float(np.sqrt(np.mean(distance[right] ** 2))) if right.any() else None,
        float(np.degrees(pose.angle_to(true_pose))),
        float(np.linalg.norm(pose.center - true_pose.center)),
        _place_error_px(item, shot, true_pose, test),
        _value_error_percent(item, shot),
    )


def _place_error_px(item: ImageResult, shot: Shot, true_pose: Pose, test: TunnelTest) -> float | None:
    """RMS over the visible nodes of the distance between the found and the true projection."""
    if item.nodes is None:
        return None
    seen = item.nodes.visible & np.isin(np.arange(len(test.mesh.vertices)), _model_nodes(test))
    true_xy, _ = shot.perfect.camera.project(true_pose.apply(test.mesh.vertices[seen]))
    return float(np.sqrt(np.nanmean(np.sum((item.nodes.xy[seen] - true_xy) ** 2, axis=1))))


def _model_nodes(test: TunnelTest) -> np.ndarray:
    """Nodes of the parts that move with the model (walls do not)."""
    return np.unique(test.mesh.triangles[test.mesh.volume != "wall"])


def _value_error_percent(item: ImageResult, shot: Shot) -> float | None:
    if item.values is None:
        return None
    true = true_levels(shot, Sensor())
    return float(100 * np.nanmedian(np.abs(item.values / true - 1)))
