"""Files: images, markers, cameras, grids and results. The only place where conventions are converted."""

from windmark.io.added import atomic_folder
from windmark.io.atomic import atomic_path, atomic_paths, atomic_write, try_paths
from windmark.io.cameras import (
    CAMERA_FORMATS,
    LENGTH_UNITS,
    CameraFile,
    ColmapModel,
    RigFile,
    is_camera_text,
    read_camera,
    read_camera_file,
    read_colmap,
    read_rig,
    write_camera,
    write_colmap,
    write_rig,
    written_camera_format,
)
from windmark.io.colour import CHANNELS, MOSAICS, from_mosaic, to_grey
from windmark.io.csvtable import read_table, write_table
from windmark.io.errors import FileError, reason, witness
from windmark.io.grey import Levels, read_grey, read_levels
from windmark.io.grid_file import (
    UNIT_FORMATS,
    GridFile,
    fitting_layouts,
    read_grid_file,
    write_grid_file,
    written_grid_format,
)
from windmark.io.images import (
    page_count,
    read_image,
    read_images,
    write_image,
    write_images,
)
from windmark.io.listed import read_listed_markers
from windmark.io.marker_covariance import read_marker_covariance, write_marker_covariance
from windmark.io.markers import read_marker_unit, read_markers, write_markers
from windmark.io.masks import read_mask
from windmark.io.mesh import GRID_FORMATS, GRID_SUFFIXES, grid_format, read_mesh, write_mesh
from windmark.io.mode_tables import read_modes
from windmark.io.netcdf import read_nodes_netcdf, write_nodes_netcdf
from windmark.io.nodes_csv import write_nodes_csv
from windmark.io.pixels import write_pixels
from windmark.io.plot3d import detect_plot3d, read_plot3d, write_plot3d
from windmark.io.plot3d_function import read_plot3d_function, write_plot3d_function
from windmark.io.plot3d_layout import Plot3dLayout
from windmark.io.point_tables import PointList, read_points, write_point_values
from windmark.io.quantity_told import told_quantity
from windmark.io.recordings.address import FrameAddress, frame_address, picture_name
from windmark.io.recordings.base import Frames
from windmark.io.recordings.open import frames, is_recording
from windmark.io.recordings.picture import (
    Frame,
    PictureFile,
    addresses,
    gathered,
    notes_of,
    one_picture,
    pictures,
    times_of,
)
from windmark.io.recordings.write import write_frames
from windmark.io.results import ResultFolder, result_folder
from windmark.io.tables import (
    MatchTable,
    read_detection_names,
    read_detections,
    read_matches,
    write_detections,
    write_matches,
)
from windmark.io.tecplot import write_tecplot
from windmark.io.tecplot_read import read_tecplot
from windmark.io.text import read_json, to_json, write_json
from windmark.io.tgts import write_tgts
from windmark.io.vtk_collection import write_collection
from windmark.io.vtk_write import write_nodes_vtk

__all__ = [
    "CAMERA_FORMATS", "CHANNELS", "LENGTH_UNITS", "MOSAICS", "CameraFile", "ColmapModel", "FileError", "MatchTable",
    "PointList", "RigFile", "read_rig", "write_rig",
    "ResultFolder", "result_folder", "reason", "witness", "atomic_paths", "try_paths",
    "is_camera_text", "atomic_folder", "atomic_path", "atomic_write", "from_mosaic", "read_detection_names",
    "read_camera", "read_camera_file", "read_colmap", "write_colmap", "written_camera_format",
    "read_detections", "read_json", "read_listed_markers", "read_markers", "read_matches", "read_modes", "read_points",
    "read_table",
    "Plot3dLayout", "detect_plot3d", "read_mesh", "read_nodes_netcdf", "read_plot3d", "read_plot3d_function",
    "read_tecplot", "write_collection", "write_mesh", "write_nodes_csv", "write_nodes_netcdf", "write_nodes_vtk",
    "write_plot3d", "write_plot3d_function", "write_tecplot",
    "Frame", "FrameAddress", "Frames", "PictureFile", "addresses", "frame_address", "frames", "gathered",
    "is_recording", "notes_of", "one_picture", "picture_name", "pictures", "times_of", "write_frames",
    "GRID_FORMATS", "GRID_SUFFIXES", "UNIT_FORMATS", "GridFile", "fitting_layouts", "grid_format", "read_grid_file",
    "write_grid_file", "written_grid_format", "read_marker_covariance", "read_marker_unit", "told_quantity",
    "write_tgts", "page_count", "read_grey", "read_image", "read_images", "read_levels", "read_mask", "to_grey",
    "Levels", "to_json",
    "write_image", "write_images", "write_pixels",
    "write_camera", "write_detections", "write_json", "write_marker_covariance", "write_markers", "write_matches",
    "write_point_values", "write_table",
]  # fmt: skip
