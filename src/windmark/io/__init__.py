"""Files: images, markers, cameras, grids and results. The only place where conventions are converted."""

from windmark.io.atomic import atomic_folder, atomic_path, atomic_write
from windmark.io.cameras import LENGTH_UNITS, CameraFile, read_camera, read_camera_file, write_camera
from windmark.io.csvtable import read_table, write_table
from windmark.io.errors import FileError
from windmark.io.markers import read_markers, write_markers
from windmark.io.tables import MatchTable, read_detections, read_matches, write_detections, write_matches
from windmark.io.text import read_json, write_json

__all__ = [
    "LENGTH_UNITS", "CameraFile", "FileError", "MatchTable", "atomic_folder", "atomic_path", "atomic_write",
    "read_camera", "read_camera_file", "read_detections", "read_json", "read_markers", "read_matches", "read_table",
    "write_camera", "write_detections", "write_json", "write_markers", "write_matches", "write_table",
]  # fmt: skip
