"""Pictures of a model that swings before one camera as files: what `track` wants, and beside it the truth."""

from __future__ import annotations

from pathlib import Path

from windmark import io
from windmark.errors import UsageError
from windmark.synth import TunnelTest, swinging, tunnel_sequence, wind_tunnel


def simulate_sequence(folder: Path, seed: int, frames: int) -> TunnelTest:
    """Film the virtual model and write the pictures into ``folder`` (existing, empty or not).

    Files: frames/f001.tif and so on, camera.json (interior parameters, no pose), markers.csv (the model's and the
    walls'), and truth/f001.json, the camera with its pose to the model in each picture.

    Raises
    ------
    UsageError
        For fewer than two frames.
    """
    if frames < 2:
        raise UsageError(f"sequence: expected at least 2, got {frames}")
    test = wind_tunnel(seed)
    io.write_camera(folder / "camera.json", test.cameras["cam1"])
    io.write_markers(folder / "markers.csv", test.markers, length_unit="mm")
    for name in ("frames", "truth"):
        (folder / name).mkdir(exist_ok=True)
    digits = max(3, len(str(frames)))
    for k, (image, pose) in enumerate(tunnel_sequence(test, swinging(frames), seed=seed), start=1):
        name = f"f{k:0{digits}d}"
        io.write_image(folder / "frames" / f"{name}.tif", image)
        io.write_camera(folder / "truth" / f"{name}.json", test.cameras["cam1"], pose, unit="mm")
    return test
