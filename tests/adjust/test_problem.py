"""The engine beyond one pose: several views share a camera, and a law of deformation is just another block."""

from dataclasses import dataclass

import numpy as np
import pytest

from windmark.adjust import CameraBlock, PoseBlock, Prior, Problem, Reprojection, covariance, minimise
from windmark.adjust.terms import Linearised
from windmark.geometry import Camera, DegenerateGeometry, Pose

RNG = np.random.default_rng(7)
XYZ = RNG.uniform(-1, 1, (12, 3)) * [1, 1, 0.3]
CAMERA = Camera((1280, 800), 1700.0, k1=-0.08)


def view(k):
    return Pose.look_at(8 * np.array([np.sin(0.4 * k), 0.3 * np.cos(k), -np.cos(0.4 * k)]), np.zeros(3), [0, -1, 0])


def several_views(free_camera=("focal_px", "k1")):
    block = CameraBlock(tuple(free_camera))
    start = {"camera": block.retract(CAMERA, 0.03 * block.natural(CAMERA).sum(axis=0))}
    blocks, terms = {"camera": block}, []
    for k in range(4):
        key = f"view {k}"
        xy = CAMERA.project(view(k).apply(XYZ))[0]
        terms.append(Reprojection("camera", key, XYZ, xy, free_camera=block.columns))
        blocks[key] = PoseBlock(XYZ.mean(axis=0))
        start[key] = Pose.exp(0.03 * RNG.normal(size=6)) @ view(k)
    return blocks, terms, start


def test_views_share_one_camera():
    blocks, terms, start = several_views()
    problem = Problem(blocks, terms)
    values, system, report = minimise(problem, start)
    assert report.converged
    assert values["camera"].focal_px == pytest.approx(1700.0, abs=1e-6)
    assert values["camera"].k1 == pytest.approx(-0.08, abs=1e-9)
    for k in range(4):
        np.testing.assert_allclose(values[f"view {k}"].rotation, view(k).rotation, atol=1e-9)
    assert problem.size == 26
    assert problem.names[:3] == ("camera.focal_px", "camera.k1", "view 0.rotation_x")
    # Poses of different views meet only through the camera.
    assert (system.information[2:8, 8:] == 0).all()
    assert np.abs(system.information[2:8, :2]).max() > 0
    assert covariance(system, problem.names).shape == (26, 26)


def test_a_view_without_marks_is_named():
    blocks, terms, start = several_views()
    problem = Problem(blocks, terms[:3])
    values, system, _ = minimise(problem, start)
    with pytest.raises(DegenerateGeometry) as caught:
        covariance(system, problem.names)
    assert caught.value.weak == tuple(f"view 3.{name}" for name in blocks["view 3"].names)
    assert values["view 3"].translation == pytest.approx(start["view 3"].translation)


def test_a_fixed_pose_and_a_free_camera():
    block = CameraBlock(("focal_px", "cx"))
    xy = CAMERA.project(view(1).apply(XYZ))[0]
    term = Reprojection("camera", "view", XYZ, xy, free_pose=False, free_camera=block.columns)
    problem = Problem({"camera": block}, [term])
    start = {"camera": block.retract(CAMERA, np.array([50.0, -20.0])), "view": view(1)}
    values, _, report = minimise(problem, start)
    assert report.converged
    assert values["camera"].focal_px == pytest.approx(1700.0, abs=1e-7)
    assert values["view"] is start["view"]


@dataclass(frozen=True)
class BendingBlock:
    """Amplitude of a bending mode."""

    names: tuple[str, ...] = ("bending",)

    def retract(self, value, delta):
        return value + float(delta[0])

    def natural(self, value):
        return np.eye(1)

    def difference(self, value, reference):
        return np.array([value - reference]), np.eye(1)


@dataclass(frozen=True)
class BentReprojection(Reprojection):
    """Points that bend out of plane with the square of x: the law of a deformation job."""

    @property
    def blocks(self):
        return (*super().blocks, "law")

    def _bent(self, values):
        shape = np.zeros_like(self.xyz)
        shape[:, 2] = self.xyz[:, 0] ** 2
        moved = Reprojection(self.camera, self.pose, self.xyz + values["law"] * shape, self.xy, self.whitener)
        return moved, shape

    def residual(self, values):
        return self._bent(values)[0].residual(values)

    def linearise(self, values):
        moved, shape = self._bent(values)
        residual, jacobian = moved.linearise(values)
        d_xyz = jacobian[self.pose][..., 3:]  # by a shift of the points in the camera frame
        law = d_xyz @ (shape @ values[self.pose].rotation.T)[..., None]
        return Linearised(residual, {**jacobian, "law": law})


def test_a_deformation_law_is_one_more_block():
    bent = XYZ + 0.07 * np.c_[np.zeros((12, 2)), XYZ[:, 0] ** 2]
    xy = CAMERA.project(view(1).apply(bent))[0]
    blocks = {"view": PoseBlock(XYZ.mean(axis=0)), "law": BendingBlock()}
    problem = Problem(blocks, [BentReprojection("camera", "view", XYZ, xy)])
    start = {"camera": CAMERA, "view": Pose.exp([0.02, 0, 0.01, 0.1, 0, 0.1]) @ view(1), "law": 0.0}
    values, _, report = minimise(problem, start)
    assert report.converged
    assert values["law"] == pytest.approx(0.07, abs=1e-8)
    # A prior works on a block that the engine has never seen.
    tight = Problem(blocks, [*problem.terms, Prior("law", blocks["law"], 0.0, {"bending": 1e-9})])
    assert minimise(tight, start)[0]["law"] == pytest.approx(0.0, abs=1e-6)


def test_terms_on_unknown_blocks_are_refused():
    blocks, terms, _ = several_views()
    del blocks["view 2"]
    with pytest.raises(ValueError, match="unknown blocks view 2"):
        Problem(blocks, terms)
