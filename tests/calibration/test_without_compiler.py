"""Where numba's compiler is switched off, NumPy does the work and reaches the same minimum."""

import json
import os
import subprocess
import sys
from pathlib import Path

import networks
import numpy as np
import pytest

from windmark.adjust.network import linear
from windmark.calibration import Free, self_calibrate
from windmark.scene import MarkerSet, Observations, View

pytestmark = pytest.mark.slow  # processes of their own, in which nothing is compiled

HERE = Path(__file__).parent


def solved():
    """A small calibration of large discs, as numbers."""
    case = networks.make(61, views=4, points=11, seen=0.9)
    net = case.network
    markers = MarkerSet.make([f"m{i:02d}" for i in range(11)], case.start.points, radius=np.full(11, 8.0))
    views = [View(f"v{v}", "cam") for v in range(4)]
    observations = Observations(net.view, net.point, net.xy, net.cov)
    found = self_calibrate(observations, markers, {"cam": networks.CAMERA}, views, datum=Free())
    camera = found.cameras["cam"]
    return {
        "sigma0": found.sigma0, "camera": camera.parameters().tolist(), "sigma": np.sqrt(np.diag(camera.cov)).tolist(),
        "xyz": found.markers.xyz.tolist(), "marker_sigma": found.markers.sigma.tolist(),
        "compiled": hasattr(linear.accumulate, "py_func"),
    }  # fmt: skip


def test_the_same_minimum_without_the_compiler():
    path = os.pathsep.join([str(HERE), str(HERE.parent / "adjust"), *sys.path])
    code = "import json, test_without_compiler as t; print(json.dumps(t.solved()))"
    env = {**os.environ, "PYTHONPATH": path, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env, check=False)
    assert done.returncode == 0, done.stderr
    plain, fast = json.loads(done.stdout), solved()
    assert (plain["compiled"], fast["compiled"]) == (False, True)
    assert plain["sigma0"] == pytest.approx(fast["sigma0"], rel=1e-9)
    # Differences in parts of their own sigma; what is not free is equal.
    for value, sigma in (("camera", "sigma"), ("xyz", "marker_sigma")):
        away = np.abs(np.subtract(plain[value], fast[value]))
        assert (away <= 1e-4 * np.array(fast[sigma])).all()
        np.testing.assert_allclose(plain[sigma], fast[sigma], rtol=1e-5, atol=1e-15)
