"""The numbers of a frame: what tables, report and journal have of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from windmark.paint import CamerasApart
from windmark.pipeline.deform.followed import Followed

NOTHING = Followed("")
REDUCED, FAILED = "reduced", "failed"


@dataclass(frozen=True)
class FrameRecord:
    """What became of a frame.

    Parameters
    ----------
    key, index, time_s : its name, its place in the run from 0, its time
    pictures : camera -> names, sizes and checksums of its pictures
    status, reason : `REDUCED`; or `FAILED`, and why
    remarks : what is to be said of it
    rms_px : residuals of the registration
    seen : part of the grid's nodes with a temperature
    cameras : that count
    median_T, median_sigma_T : kelvin, over the nodes
    median_q, median_sigma_q : W / m2, over the nodes with a heat flux; NaN without any
    flagged : part of these that LATE, LATERAL or CURVED is said of
    apart : of each two cameras' temperatures, see `CamerasApart`
    causes : of "T" and "q" -> (cause, share of the variance), the largest first
    followed : what was said of the model's markers
    seconds : of the frame's temperatures
    repeated : cameras whose picture repeats the one before, and does not count
    no_flux : why most nodes that have a heat flux in other frames, and a temperature in this one, have none in it
    beyond : camera that lost most of its nodes to the ends of its calibration -> that range, in words
    """

    key: str
    index: int
    time_s: float
    pictures: Mapping[str, str]
    status: str
    reason: str = ""
    remarks: tuple[str, ...] = ()
    rms_px: float = float("nan")
    seen: float = 0.0
    cameras: tuple[str, ...] = ()
    median_T: float = float("nan")
    median_sigma_T: float = float("nan")
    median_q: float = float("nan")
    median_sigma_q: float = float("nan")
    flagged: float = float("nan")
    apart: tuple[CamerasApart, ...] = ()
    causes: Mapping[str, list[tuple[str, float]]] = field(default_factory=dict)
    followed: Followed = NOTHING
    seconds: float = 0.0
    repeated: tuple[str, ...] = ()
    no_flux: str = ""
    beyond: Mapping[str, str] = field(default_factory=dict)
