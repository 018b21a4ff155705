"""The solvers against others' (OpenCV, PoseLib, SciPy) on the same problems."""

from __future__ import annotations

import cv2
import numpy as np
import poselib
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from windmark.geometry import Camera, Pose, align, p3p, p4pf, triangulate
from windmark.geometry.rotations import exp_so3, log_so3


def triangles(n, seed):
    rng = np.random.default_rng(seed)
    cam = np.concatenate([rng.uniform(-1, 1, (n, 3, 2)), np.ones((n, 3, 1))], -1) * rng.uniform(1, 10, (n, 3, 1))
    rotation = exp_so3(rng.normal(size=(n, 3)) * 2)
    translation = rng.normal(size=(n, 3))
    xyz = (cam - translation[:, None]) @ rotation
    return cam / np.linalg.norm(cam, axis=-1, keepdims=True), xyz


def off_by(pose, rays, xyz):
    """Largest angle of a ray to its point; pi when the point is behind."""
    cam = pose.apply(xyz)
    depth = np.sum(cam * rays, axis=1)
    angle = np.linalg.norm(np.cross(cam, rays), axis=1) / np.linalg.norm(cam, axis=1)
    return np.where(depth > 0, angle, np.pi).max()


def by_poselib(rays, xyz):
    return [Pose(p.R, p.t) for p in poselib.p3p(list(rays), list(xyz))]


def by_opencv(rays, xyz):
    _, rvecs, tvecs = cv2.solveP3P(xyz, rays[:, :2] / rays[:, 2:], np.eye(3), None, flags=cv2.SOLVEPNP_P3P)
    return [Pose.from_rotvec(r.ravel(), t.ravel()) for r, t in zip(rvecs, tvecs, strict=True)]


@pytest.mark.slow
@pytest.mark.parametrize("peer", [by_poselib, by_opencv])
def test_p3p_has_every_solution_of_the_peers(peer):
    rays, xyz = triangles(1000, 1)
    found = p3p(rays, xyz)
    compared, same_count = 0, 0
    for k in range(1000):
        ours = found.poses(k)
        theirs = [p for p in peer(rays[k], xyz[k]) if off_by(p, rays[k], xyz[k]) < 1e-9]
        for pose in theirs:
            assert min(float(pose.angle_to(q)) for q in ours) < 1e-5
        compared += len(theirs)
        same_count += len(theirs) == len(ours)
    assert compared > 1300
    assert same_count > 990  # the few others are solutions that the peer has lost


def test_log_and_exp_as_in_scipy():
    rotvec = np.random.default_rng(0).normal(size=(500, 3)) * 1.2
    matrix = Rotation.from_rotvec(rotvec).as_matrix()
    np.testing.assert_allclose(exp_so3(rotvec), matrix, atol=1e-14)
    np.testing.assert_allclose(log_so3(matrix), Rotation.from_matrix(matrix).as_rotvec(), atol=1e-12)


def test_pov_angles_are_scipys_euler_angles():
    rng = np.random.default_rng(1)
    for rx, ry, rz in rng.uniform([-179, -89, -179], [179, 89, 179], (50, 3)):
        r = Rotation.from_euler("xyz", [rx, ry, rz], degrees=True).as_matrix()
        pov = Pose(r, np.zeros(3)).to_pov()
        np.testing.assert_allclose([pov.rx_deg, pov.ry_deg, pov.rz_deg], [rx, ry, rz], atol=1e-10)


def test_rigid_alignment_as_in_scipy():
    rng = np.random.default_rng(2)
    x, w = rng.normal(size=(30, 3)), rng.uniform(0.2, 3, 30)
    y = x @ exp_so3([0.3, 0.4, -2.0]).T + 0.3 * rng.normal(size=(30, 3))
    x -= np.average(x, axis=0, weights=w)
    y -= np.average(y, axis=0, weights=w)
    expected, rssd = Rotation.align_vectors(y, x, weights=w)
    found = align(x, y, weights=w, scale=False)
    np.testing.assert_allclose(found.rotation, expected.as_matrix(), atol=1e-10)
    assert found.rms == pytest.approx(rssd / np.sqrt(w.sum()), rel=1e-9)


@pytest.mark.slow
def test_p4pf_is_scipys_least_squares_minimum():
    rng = np.random.default_rng(3)
    checked = 0
    for _ in range(20):
        focal, pose = 1500.0, Pose(exp_so3(rng.normal(size=3)), np.array([0.1, -0.1, 5.0]))
        xyz = rng.uniform(-1, 1, (4, 3))
        cam = pose.apply(xyz)
        xy = focal * cam[:, :2] / cam[:, 2:] + 0.3 * rng.normal(size=(4, 2))

        def residual(v, xyz=xyz, xy=xy):
            cam = xyz @ exp_so3(v[:3]).T + v[3:6]
            return (1000 * np.exp(v[6]) * cam[:, :2] / cam[:, 2:] - xy).ravel()

        start = np.array([*pose.rotvec, *pose.translation, np.log(1.5)])
        best = least_squares(residual, start, xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac", max_nfev=2000)
        found = p4pf(xy, xyz)
        rms = np.sqrt(2 * best.cost / 4)
        assert min(s.rms_px for s in found) <= rms * (1 + 1e-6) + 1e-9
        close = min(found, key=lambda s: abs(np.log(s.focal_px / 1000) - best.x[6]))
        checked += abs(np.log(close.focal_px / 1000) - best.x[6]) < 1e-4
    assert checked >= 17  # SciPy now and then walks into another of the minima


def test_two_view_triangulation_against_opencv_without_noise_and_scipy_with():
    rng = np.random.default_rng(4)
    camera = Camera((2000, 1500), 2200.0)
    poses = [Pose.look_at(e, [0, 0, 0], [0, 0, 1]) for e in ([3, 0.2, 1.0], [0.5, 3, 0.5])]
    xyz = rng.uniform(-0.4, 0.4, (40, 3))
    xy = np.stack([camera.project(p.apply(xyz))[0] for p in poses])
    matrices = [camera.matrix @ np.column_stack([p.rotation, p.translation]) for p in poses]
    h = cv2.triangulatePoints(*matrices, xy[0].T, xy[1].T)
    np.testing.assert_allclose(triangulate(camera, poses, xy).xyz, (h[:3] / h[3]).T, atol=1e-8)

    noisy = xy + rng.normal(size=xy.shape)
    found = triangulate(camera, poses, noisy)
    for k in range(10):

        def residual(p, k=k):
            return np.concatenate([camera.project(q.apply(p))[0] - noisy[v, k] for v, q in enumerate(poses)])

        best = least_squares(residual, xyz[k], xtol=1e-15, ftol=1e-15, gtol=1e-15)
        np.testing.assert_allclose(found.xyz[k], best.x, atol=1e-7)
        np.testing.assert_allclose(found.cov[k], np.linalg.inv(best.jac.T @ best.jac), rtol=1e-4)
