"""The virtual wind tunnel: images with exactly known truth.

A perfect world first (`HalfModel`, `rows_layout`, `Paint`, `World`, `render`), then what spoils its
images (`degrade`, `Sensor`); `wind_tunnel` puts both together, `marker_sheet` makes the paper's
marker study. Everything random takes a generator or a seed: same seed, same bytes.
"""

from windmark.synth import degrade
from windmark.synth.boards import BoardSpots, board_spots
from windmark.synth.decals import Decals
from windmark.synth.degrade import Sensor
from windmark.synth.discs import SheetTruth, disc_image, marker_sheet
from windmark.synth.infrared import InfraredTest, infrared_test
from windmark.synth.layout import rows_layout
from windmark.synth.marks import Clutter, Marks
from windmark.synth.motion import bend, flex, random_poses
from windmark.synth.paint import Flow, Paint, TransonicFlow
from windmark.synth.paint_camera import PaintCamera
from windmark.synth.patch import Patch, assemble
from windmark.synth.polar_flow import PolarFlow
from windmark.synth.pressure_paint import SensitivePaint, SternVolmer, StillAir
from windmark.synth.psp import PspPoint, PspTest, psp_test
from windmark.synth.render import Rendering, render
from windmark.synth.scenes import Scene, marker_scene
from windmark.synth.screen import Rays
from windmark.synth.sequence import WingState, deformed_world, deforming_sequence, swinging, tunnel_sequence
from windmark.synth.stereo import stereo_layout, stereo_stations, stereo_wing
from windmark.synth.truth import MarkerTruth, marker_truth
from windmark.synth.tunnel import WIND_OFF, WIND_ON, Shot, TunnelTest, default_stations, wind_tunnel
from windmark.synth.wing import HalfModel
from windmark.synth.world import World

__all__ = [
    "WIND_OFF", "WIND_ON", "BoardSpots", "Clutter", "Decals", "Flow", "HalfModel", "InfraredTest", "MarkerTruth",
    "Marks", "Paint", "PaintCamera", "Patch", "PolarFlow", "PspPoint", "PspTest", "Rays", "Rendering", "Scene",
    "Sensor", "SensitivePaint", "SheetTruth", "Shot", "SternVolmer", "StillAir", "TransonicFlow",
    "TunnelTest", "WingState", "World", "assemble", "bend", "board_spots", "default_stations", "deformed_world",
    "deforming_sequence", "degrade", "disc_image", "flex", "infrared_test", "marker_scene", "marker_sheet",
    "marker_truth", "psp_test", "random_poses", "render", "rows_layout", "stereo_layout", "stereo_stations",
    "stereo_wing", "swinging", "tunnel_sequence", "wind_tunnel",
]  # fmt: skip
