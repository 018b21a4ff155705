"""windmark: wind-tunnel camera images into measurements on the model's surface.

The verbs and nouns that users need are here; they are loaded on first use, so importing
windmark (and `windmark --help`) costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOME = {
    "geometry": ("Camera", "DegenerateGeometry", "Pose", "PoV"),
    "scene": ("Detections", "MarkerCovariance", "MarkerSet", "Matching", "Mesh", "Observations", "Tracks", "View"),
    "detection": ("detect", "detect_at"),
    "registration": (
        "NotRegistered", "PoseCandidates", "Registration", "RigRegistration", "TrackState", "pose_candidates",
        "pose_from_labels", "register", "register_rig", "track",
    ),
    "calibration": (
        "Calibration", "Distance", "Fixed", "Free", "NotCalibrated", "Weighted", "magnify_distortion",
        "self_calibrate", "undistort",
    ),
    "deformation": (
        "Deformation", "NotIdentified", "Stations", "Volume", "compare_laws", "displacements", "identify", "law",
        "marker_places", "span_values", "zero_markers",
    ),
    "epipolar": ("NotMatched", "PairMatching", "match_pair"),
    "tasks.reconstruct": ("NotReconstructed", "Reconstruction", "reconstruct"),
    "resection": (
        "MergedViews", "NodeView", "NotMerged", "Picture", "PixelMap", "PointValues", "map_pixels", "merge_views",
        "node_values", "noise_law", "orient_outward", "sample", "sample_line", "sample_points", "section", "see_nodes",
        "virtual_image",
    ),
    "paint": (
        "InSitu", "Layer", "LoadReference", "Loads", "NodeField", "NotFitted", "PaintFit", "PlanckBand",
        "SensorModel", "SternVolmer", "TunnelConditions", "Wall", "average_frames", "correct_picture",
        "fill_patches", "fit_paint", "form_factors", "form_ratio", "given_temperature", "heat_flux", "in_situ",
        "integrate_loads", "merge_cameras", "photon_transfer", "pressure_coefficient", "pressure_map",
        "recovery_temperature", "remove_self_illumination", "section_profile", "span_loading",
        "surface_temperature", "thermocouple_temperature",
    ),
    "tasks.align2d": ("ImageAlignment", "NotAligned", "align_images"),
    "io": (
        "FileError", "read_camera", "read_image", "read_markers", "read_mesh",
        "write_camera", "write_image", "write_markers", "write_mesh",
    ),
}  # fmt: skip
_WHERE = {name: room for room, names in _HOME.items() for name in names}

__all__ = ["__version__", "synth", *_WHERE]

if TYPE_CHECKING:
    from windmark import synth
    from windmark.calibration import (
        Calibration,
        Distance,
        Fixed,
        Free,
        NotCalibrated,
        Weighted,
        magnify_distortion,
        self_calibrate,
        undistort,
    )
    from windmark.deformation import (
        Deformation,
        NotIdentified,
        Stations,
        Volume,
        compare_laws,
        displacements,
        identify,
        law,
        marker_places,
        span_values,
        zero_markers,
    )
    from windmark.detection import detect, detect_at
    from windmark.epipolar import NotMatched, PairMatching, match_pair
    from windmark.geometry import Camera, DegenerateGeometry, Pose, PoV
    from windmark.io import (
        FileError,
        read_camera,
        read_image,
        read_markers,
        read_mesh,
        write_camera,
        write_image,
        write_markers,
        write_mesh,
    )
    from windmark.paint import (
        InSitu,
        Layer,
        LoadReference,
        Loads,
        NodeField,
        NotFitted,
        PaintFit,
        PlanckBand,
        SensorModel,
        SternVolmer,
        TunnelConditions,
        Wall,
        average_frames,
        correct_picture,
        fill_patches,
        fit_paint,
        form_factors,
        form_ratio,
        given_temperature,
        heat_flux,
        in_situ,
        integrate_loads,
        merge_cameras,
        photon_transfer,
        pressure_coefficient,
        pressure_map,
        recovery_temperature,
        remove_self_illumination,
        section_profile,
        span_loading,
        surface_temperature,
        thermocouple_temperature,
    )
    from windmark.registration import (
        NotRegistered,
        PoseCandidates,
        Registration,
        RigRegistration,
        TrackState,
        pose_candidates,
        pose_from_labels,
        register,
        register_rig,
        track,
    )
    from windmark.resection import (
        MergedViews,
        NodeView,
        NotMerged,
        Picture,
        PixelMap,
        PointValues,
        map_pixels,
        merge_views,
        node_values,
        noise_law,
        orient_outward,
        sample,
        sample_line,
        sample_points,
        section,
        see_nodes,
        virtual_image,
    )
    from windmark.scene import Detections, MarkerCovariance, MarkerSet, Matching, Mesh, Observations, Tracks, View
    from windmark.tasks.align2d import ImageAlignment, NotAligned, align_images
    from windmark.tasks.reconstruct import NotReconstructed, Reconstruction, reconstruct


def __getattr__(name: str) -> Any:
    if name in _WHERE:
        return getattr(importlib.import_module(f"windmark.{_WHERE[name]}"), name)
    if name == "synth":
        return importlib.import_module("windmark.synth")
    raise AttributeError(f"module 'windmark' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
