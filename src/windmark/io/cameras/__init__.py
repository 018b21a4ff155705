"""Camera files of windmark and of other programs; conventions are converted here and nowhere else.

==============  ===================================  =====================================================
format          pixel origin and principal point     lens
==============  ===================================  =====================================================
windmark        centre of the top-left pixel         OpenCV's, forward
opencv          centre of the top-left pixel         forward: k1 k2 p1 p2 k3 (tau_x tau_y)
nasa            principal point from the middle      OpenCV's
colmap          corner of the top-left pixel, so     OpenCV's, forward
                cx is windmark's + 0.5
mrcal           centre of the top-left pixel         OpenCV's, forward
metashape       cx, cy from (width/2, height/2),     forward; P1 and P2 are OpenCV's p2 and p1; b1 = fx - fy
                counted from the corner
australis       xp, yp in mm from the middle,        *backward*, in mm: refitted over the sensor
                y up
==============  ===================================  =====================================================
"""

from windmark.io.cameras.colmap import ColmapModel, read_colmap, write_colmap
from windmark.io.cameras.files import (
    CAMERA_FORMATS,
    is_camera_text,
    read_camera,
    read_camera_file,
    write_camera,
    written_camera_format,
)
from windmark.io.cameras.record import LENGTH_UNITS, CameraFile
from windmark.io.cameras.rig import RigFile, read_rig, write_rig

__all__ = [
    "CAMERA_FORMATS", "LENGTH_UNITS", "CameraFile", "ColmapModel", "RigFile", "is_camera_text", "read_camera",
    "read_camera_file", "read_colmap", "read_rig", "write_camera", "write_colmap", "write_rig", "written_camera_format",
]  # fmt: skip
