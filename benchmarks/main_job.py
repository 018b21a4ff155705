"""The main job on NASA's camera 5: time per stage beside the published figures of upsp-processing.

The peer's seconds are those it takes on its own two test frames (measured on another day on a
comparable two-core machine; it needs an outdated Python and cannot run beside windmark).
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PROJECT = ROOT / "examples" / "nasa-upsp-cam5.toml"
UPSP_S = {"register": 6.0, "visibility + node values": 17.0 + 12.0}


def main(quick: bool = False) -> dict[str, object]:
    """Run the job as a whole process several times, print one table, return medians in seconds."""
    if not (ROOT.parent / "shared" / "data" / "nasa-upsp-cam5").is_dir():
        print("skipped: NASA's test data are not beside the checkout (shared/data/nasa-upsp-cam5)")
        return {"skipped": "no data"}
    runs = [_run() for _ in range(3 if quick else 6)][1:]  # the first may compile
    stages = {name: [run[name] for run in runs] for name in runs[0]}
    median = {name: statistics.median(values) for name, values in stages.items()}
    print(f"{'stage':34s}{'median s':>10s}{'min':>9s}{'max':>9s}{'upsp s':>9s}{'ratio':>8s}")
    for name, values in stages.items():
        peer = UPSP_S.get(name)
        beside = f"{peer:9.1f}{peer / median[name]:8.0f}" if peer else ""
        print(f"{name:34s}{median[name]:10.3f}{min(values):9.3f}{max(values):9.3f}{beside}")
    ratios = {f"upsp / windmark, {name}": peer / median[name] for name, peer in UPSP_S.items()}
    return {"median_s": median, **ratios}


def _run() -> dict[str, float]:
    """One whole process; seconds of every stage."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "windmark.app.cli", "run", str(PROJECT), "-o", f"{folder}/out", "--json"]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    record = json.loads(done.stdout)
    image = record["images"][0]["seconds"]
    seconds = {**image, **record["seconds"]}
    seconds["visibility + node values"] = image["visibility"] + image["node values"]
    return seconds


if __name__ == "__main__":
    main("--quick" in sys.argv)
