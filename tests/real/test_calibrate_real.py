"""Pictures of the DBAT sheet from unlabelled spots: the published marks without their names, and three labels."""

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.calibration import Free
from windmark.geometry.similarity import align
from windmark.pipeline.calibrate import CalibrateSettings, MatchedPicture, MatchOptions, calibrate_pictures
from windmark.pipeline.calibrate import from_pictures as rounds
from windmark.pipeline.clock import Clock
from windmark.scene import Detections, MarkerSet
from windmark.tasks.labels import fixed_spots

DATA = Path(__file__).parents[2] / ".." / "shared" / "data" / "dbat-camcal"


@pytest.fixture
def sheet(monkeypatch):
    if not DATA.is_dir():
        pytest.skip("real pictures (dbat-camcal) are not here")
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    import calibration_real

    yield calibration_real.published(DATA)
    sys.modules.pop("calibration_real", None)


def test_a_label_in_some_pictures_is_enough(sheet, monkeypatch, tmp_path):
    obs, names, true = sheet.observations, sheet.markers.name, sheet.markers.xyz
    rng = np.random.default_rng(21)
    rough = MarkerSet.make(names, true + rng.normal(0, 4, true.shape), normal=np.tile([0, 0, 1.0], (len(names), 1)))
    taken = range(0, 21, 2)  # eleven of the pictures
    orders = {v: rng.permutation(np.flatnonzero(obs.view == v)) for v in taken}

    def unlabelled(path, name, camera, options):
        xy = obs.xy[orders[int(name)]]
        spots = Detections.make(xy, cov=np.full((len(xy), 1, 1), 0.15**2) * np.eye(2))
        fixed = fixed_spots(spots, options.labels.get(name, {}), 10.0)
        return MatchedPicture(name, camera.camera, (2272, 1704), spots, fixed=fixed)

    monkeypatch.setattr(rounds, "_detect", unlabelled)
    one = names.tolist().index("1001")
    told = (0, 6, 12, 18)
    labels = {f"{v:02d}": {"1001": tuple(obs.xy[(obs.view == v) & (obs.point == one)][0])} for v in told}
    done, matched = calibrate_pictures(
        [tmp_path / f"{v:02d}.jpg" for v in taken], rough, {"camera": None}, MatchOptions(labels=labels),
        CalibrateSettings(Free()), Clock(),
    )  # fmt: skip
    assert done
    # Some pictures may stay without a certain labelling: the sheet looks nearly the same turned or shifted, and
    # the pose that the first round gives may be too far off.
    assert sum(m.registration is not None for m in matched) >= 8
    for order, m in zip(orders.values(), matched, strict=True):
        if m.registration is None:
            assert "equally good" in m.problem or "off the prior" in m.problem
            continue
        pairs = m.registration.matching
        assert (obs.point[order][pairs.detection] == pairs.marker).all()
    known = true[[names.tolist().index(n) for n in done.result.markers.name]]
    off = align(done.result.markers.xyz, known, scale=True).apply(done.result.markers.xyz) - known
    rms = np.sqrt((off**2).mean(axis=0))
    assert (rms < [0.14, 0.14, 0.3]).all()
