"""The whole check of a layout: table, near-symmetries, campaign, sigma of the pose, advice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError, g2
from windmark.geometry import Camera
from windmark.scene import MarkerSet, Mesh
from windmark.tasks.marker_check.advice import Proposal, advise
from windmark.tasks.marker_check.campaign import OUTCOMES, Campaign, run_campaign
from windmark.tasks.marker_check.rivals import Symmetry, name_list, px_per_length, symmetries
from windmark.tasks.marker_check.settings import DEFAULT_CAMERA, CheckSettings, azimuth_elevation_deg
from windmark.tasks.marker_check.stage import Stage
from windmark.tasks.marker_check.table import Finding, table_findings
from windmark.tasks.marker_check.weakness import PoseSigma, pose_sigmas, seen_by_direction

Array = NDArray[np.float64]
Record = dict[str, Any]

NAMED_PAIRS = 4


@dataclass(frozen=True, eq=False)
class MarkerCheck:
    """What is known of a layout before the test.

    Parameters
    ----------
    stage : markers, camera, model and assumptions
    unit : length unit of the table
    campaign : what came of the virtual views
    sigma : of the pose, per direction of the campaign
    symmetries : what the layout may be confused with, met ones first
    findings : plain checks of the table, gravest first
    proposals : changes that were measured to help, the best first
    """

    stage: Stage
    unit: str
    campaign: Campaign
    sigma: PoseSigma
    symmetries: list[Symmetry]
    findings: list[Finding]
    proposals: list[Proposal]

    @property
    def identifiable(self) -> bool:
        """The campaign's verdict, `Campaign.passed`."""
        return self.campaign.passed

    def reason(self) -> str:
        """The verdict in one sentence."""
        c = self.campaign
        if not c.first_round:
            best = int(c.in_sight.max(initial=0))
            return (
                f"not identifiable: at most {best} of {len(self.stage.markers)} markers are in sight from any direction"
            )
        what = f"{100 * c.share:.1f} % of {c.first_round} views identified"
        if self.identifiable:
            return f"identifiable: {what}, none wrongly"
        parts = [what]
        if c.wrong:
            parts.append(f"{c.wrong} views registered with a wrong pose")
        bad = int(c.bad().sum())
        parts.append(f"{bad} of {int(c.counted.sum())} directions are bad" if bad else "no direction is bad on its own")
        return f"not identifiable: {', '.join(parts)}"

    def lines(self) -> list[str]:
        """The result for people: the verdict, why, what helps, how sure the pose will be, what the table lacks."""
        lines = [self.reason(), *(f"  {line}" for line in [*self._where(), *self._why(), *self._what_helps()])]
        lines += [f"  pose: {line}" for line in self._pose()]
        return lines + [f"  table: {finding.text}" for finding in self.findings]

    def _where(self) -> list[str]:
        c = self.campaign
        lines = []
        if self.stage.settings.everywhere and not c.counted.all():
            lines.append(
                f"checked from {100 * c.counted.mean():.0f} % of all directions; from the others less than two thirds"
                " of the markers that the best direction shows, or too few, are in sight (--view-from checks those)"
            )
        rate, causes = c.rate(), c.causes()
        for d in np.argsort(np.where(c.bad(), rate, np.inf), kind="stable")[:3]:
            if c.bad()[d]:
                azimuth, elevation = azimuth_elevation_deg(c.directions[d])
                lines.append(
                    f"bad: azimuth {azimuth:.0f}, elevation {elevation:.0f} deg: {100 * rate[d]:.0f} % identified,"
                    f" {c.in_sight[d]} markers in sight; {OUTCOMES[causes[d]]}"
                )
        return lines

    def _why(self) -> list[str]:
        lines = [f"confused in {s.met} views: {self._confusion(s)}" for s in self.symmetries[:3] if s.met]
        if not lines and self.symmetries:
            lines = [f"nearest symmetry, met in no view: {self._confusion(self.symmetries[0])}"]
        count = self.campaign.outcomes()
        lines += [f"in {count[k]} views {OUTCOMES[k]}" for k in ("mirrored", "few", "weak", "time") if count[k]]
        return lines

    def _confusion(self, s: Symmetry) -> str:
        names = self.stage.markers.name
        brought, breaking = np.flatnonzero(s.onto >= 0), names[s.onto < 0]
        pairs = ", ".join(f"{names[i]} onto {names[s.onto[i]]}" for i in brought[:NAMED_PAIRS])
        off = "" if np.isnan(s.rms) else f", off by {_rounded(s.rms)} {self.unit} ({_rounded(s.rms_px)} px)"
        broken = f"; only {name_list(breaking)} break it" if 0 < len(breaking) <= len(names) // 2 else ""
        return (
            f"{s.words(self.stage.middle, self.unit)} brings {len(brought)} of {len(names)} markers onto others"
            f" ({pairs}, ...){off}{broken}"
        )

    def _what_helps(self) -> list[str]:
        if self.identifiable:
            return ["nothing to change"]
        if not self.stage.settings.advise:
            return []
        if not self.proposals:
            return ["no move or addition of a few markers was found that helps"]
        first, *others = (p.words(self.unit) for p in self.proposals)
        return [*first, *(f"or {line}" if k == 0 else line for other in others for k, line in enumerate(other))]

    def _pose(self) -> list[str]:
        c, s = self.campaign, self.sigma
        counted = c.counted & np.isfinite(s.surface_px)
        if not counted.any():
            return ["not determined from any direction"]
        middle = [float(np.median(v[counted])) for v in (s.surface_px, s.rotation_deg, s.across, s.along)]
        lines = [f"typically {self._sigma_words(*middle)}"]
        worst = int(np.argmax(np.where(counted, s.surface_px, -1)))
        azimuth, elevation = azimuth_elevation_deg(c.directions[worst])
        values = [float(v[worst]) for v in (s.surface_px, s.rotation_deg, s.across, s.along)]
        lines.append(f"weakest from azimuth {azimuth:.0f}, elevation {elevation:.0f} deg: {self._sigma_words(*values)}")
        weak = self.weak_pose()
        if weak.any():
            lines.append(
                f"weak from {100 * weak.sum() / c.counted.sum():.0f} % of the checked directions: the surface is placed"
                " worse than a spot is measured"
            )
        return lines

    def weak_pose(self) -> NDArray[np.bool_]:
        """(D,) checked directions whose pose places some marker worse than its spot is measured, or is undetermined."""
        return np.asarray(self.campaign.counted & ~(self.sigma.surface_px <= self.stage.settings.noise_px))

    def _sigma_words(self, px: float, degrees: float, across: float, along: float) -> str:
        return (
            f"{g2(px)} px on the surface, {g2(degrees)} deg, {g2(across)} {self.unit} across and {g2(along)}"
            f" {self.unit} along the line of sight (1 sigma)"
        )

    def record(self) -> Record:
        """For machines."""
        c, s = self.campaign, self.sigma
        return {
            "identifiable": self.identifiable,
            "reason": self.reason(),
            "markers": len(self.stage.markers),
            "length_unit": self.unit,
            "identified": None if np.isnan(c.share) else c.share,
            "identified_sigma": c.sigma,
            "views_first_round": c.first_round,
            "views": len(c.trials),
            "outcomes": c.outcomes(),
            "directions_checked": int(c.counted.sum()),
            "directions_bad": int(c.bad().sum()),
            "directions_weak_pose": int(self.weak_pose().sum()),
            "pose_sigma_median": {
                name: _median(getattr(s, name)[c.counted]) for name in ("surface_px", "rotation_deg", "across", "along")
            },
            "symmetries": [symmetry.record(self.stage, self.unit) for symmetry in self.symmetries],
            "findings": [asdict(finding) for finding in self.findings],
            "proposals": [proposal.record(self.unit) for proposal in self.proposals],
            "camera": {"size_px": self.stage.camera.size_px, "focal_px": self.stage.camera.focal_px},
            "settings": asdict(self.stage.settings),
        }

    def columns(self) -> dict[str, Any]:
        """The table of directions."""
        c, s = self.campaign, self.sigma
        azimuth, elevation = azimuth_elevation_deg(c.directions).T
        return {
            "azimuth_deg": np.round(azimuth, 3), "elevation_deg": np.round(elevation, 3), "in_sight": c.in_sight,
            "checked": c.counted.astype(int), "views": c.views(), "identified": c.rate(), "cause": np.array(c.causes()),
            "sigma_surface_px": s.surface_px, "sigma_rotation_deg": s.rotation_deg, "sigma_across": s.across,
            "sigma_along": s.along,
        }  # fmt: skip


def check_markers(
    markers: MarkerSet,
    unit: str,
    *,
    camera: Camera | None = None,
    mesh: Mesh | None = None,
    settings: CheckSettings | None = None,
    progress: Callable[[str], None] | None = None,
) -> MarkerCheck:
    """Check a layout before the test.

    Parameters
    ----------
    markers : the layout
    unit : its length unit, for the words
    camera : interior parameters; None takes `settings.DEFAULT_CAMERA`
    mesh : the model's surface, outward; it then hides markers, fills the image, and new places lie on it
    settings : what is assumed of the test
    progress : called with what is being done

    Raises
    ------
    ValueError
        For a table without markers.
    """
    settings, show = settings or CheckSettings(), progress or (lambda words: None)
    if not len(markers):
        raise UsageError("check_markers: markers must not be empty")
    stage = Stage(markers, camera or DEFAULT_CAMERA, mesh, settings)

    def views(words: str) -> Callable[[int, int], None]:
        return lambda done, total: show(f"{words}: view {done + 1} of {total}")

    if stage.size > 0:
        campaign = run_campaign(stage, seed=settings.seed, progress=views("virtual campaign"))
    else:
        campaign = Campaign(np.zeros((0, 3)), np.zeros(0, int), np.zeros(0, bool))
    show("covariance of the pose")
    directions, scale = campaign.directions, 1.0
    never = np.zeros(len(markers), bool)
    if len(directions):
        scale = px_per_length(stage, campaign)
        never = np.asarray(~seen_by_direction(stage, directions).any(axis=0))
    check = MarkerCheck(
        stage, unit, campaign, pose_sigmas(stage, directions), symmetries(stage, campaign, scale),
        table_findings(stage, campaign, never, scale), [],
    )  # fmt: skip
    if check.identifiable or not settings.advise:
        return check
    check.proposals.extend(advise(stage, campaign, settings.seed + 1, views("trying changes")))
    return check


def _median(values: Array) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else None


def _rounded(value: float) -> str:
    return "0" if value < 1e-9 else f"{g2(value)}"
