"""A body and a panel that slides on it, in rows of markers: pictures of it, and what following them gives."""

import numpy as np

from windmark.deformation import Volume, Volumes, law
from windmark.geometry import Camera, Pose
from windmark.pipeline.deform import DeformationTest, FrameImages, Station, follow_deformation
from windmark.scene import MarkerSet
from windmark.synth import disc_image
from windmark.tasks.deform.task import LookOptions

CAMERA, AWAY = Camera((400, 300), 800.0), Pose(np.eye(3), np.array([0.0, 0.0, 800.0]))
BODY = np.array([
    [-150, -110, 0], [-60, -95, 0], [10, -120, 0], [90, -100, 0], [150, -60, 0], [-170, -20, 0], [-150, 90, 0],
    [-40, 115, 0], [40, 100, 0], [130, 110, 0], [-90, -50, 0], [100, 70, 0],
], float)  # fmt: skip
PANEL = np.array([[-70.0 + 25.0 * b, 30.0 * a, 0.0] for a in range(2) for b in range(5)])
PITCH = np.array([25.0, 0.0, 0.0])
END, BEYOND = [0, 5], PANEL[[4, 9]] + PITCH


@law(s="mm")
def slide(X, s):
    return X + np.array([s, 0.0, 0.0])


def test_of(**given):
    xyz = np.vstack([BODY, given.pop("panel", PANEL)])
    markers = MarkerSet.make(
        [f"m{k}" for k in range(len(xyz))], xyz, radius=5.0, normal=np.tile([0.0, 0.0, -1.0], (len(xyz), 1)),
        volume=np.array(["body"] * len(BODY) + ["panel"] * len(PANEL)),
    )  # fmt: skip
    volumes = Volumes.of([Volume("body"), Volume("panel", given.pop("law", slide), parent="body")], "mm")
    stations = (Station("cam", CAMERA, AWAY), *given.pop("more", ()))
    return DeformationTest(stations, markers, volumes, look=LookOptions((5.0,)), **given)


test_of.__test__ = False


def image(s, panel=PANEL, body=BODY, pose=AWAY):
    xy = CAMERA.project(pose.apply(np.vstack([body, panel + np.array([s, 0.0, 0.0])])))[0]
    share = np.prod([disc_image((300, 400), place, 5.0, level=1.0, depth=0.8, blur_px=0.6) for place in xy], axis=0)
    noise = np.random.default_rng(abs(100 + int(10 * s) + len(panel))).normal(0.0, 1.5, share.shape)
    return np.rint(20 + share * 200 + noise).astype(np.uint8)


def followed(*images, test=None):
    frames = [FrameImages(str(k), float(k), {"cam": i}) for k, i in enumerate(images)]
    return list(follow_deformation(frames, test_of() if test is None else test))


def values(frames):
    return [float(f.state.q[0]) for f in frames]
