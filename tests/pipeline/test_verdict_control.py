"""What to do where known distances contradict each other."""

from windmark.calibration import NotCalibrated
from windmark.pipeline.verdict.network import calibrate_verdict


def test_a_refusal_for_its_control_says_to_measure_that():
    """It said that `windmark detect` shows the spots."""
    said = calibrate_verdict(NotCalibrated("what is known contradicts itself", "control"), "mm")
    assert said.cause == "control"
    assert "measure the named ones again" in said.next_step
