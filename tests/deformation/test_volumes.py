"""Volumes that are attached to each other."""

import numpy as np
import pytest

from windmark.deformation import Parameter, Volume, Volumes, function_law
from windmark.deformation.laws import Beam, Hinge, Rigid

RNG = np.random.default_rng(3)
XYZ = RNG.uniform([100, 80, 0], [400, 590, 30], (12, 3))
BEAM = Beam(root=(100, 72, 0), tip=(350, 600, 0), section=(0, 1, 0))
HINGE = Hinge((250, 150, 10), (320, 450, 15))
BODY = Rigid(pivot=(50, 0, 0))
ATTACH = (220.0, 300.0, -10.0)
ROOTED = function_law(lambda xyz, sag: xyz + 1e-6 * sag * xyz[:, :1] ** 2 * np.array([0, 0, 1]), {"sag": "mm"})


def differences(place, q, step=1e-3):
    """Independent derivative: central differences of fourth order."""
    columns = []
    for j in range(len(q)):
        h = step * np.eye(len(q))[j]
        columns.append((8 * (place(q + h) - place(q - h)) - place(q + 2 * h) + place(q - 2 * h)) / (12 * step))
    return np.stack(columns, axis=-1)


def test_names_slices_and_start():
    volumes = Volumes.of([Volume("flap", HINGE, "wing"), Volume("wing", BEAM, "body"), Volume("body")])
    assert volumes.names == ("flap.angle", "wing.bend_2", "wing.bend_3", "wing.twist_1", "wing.twist_2")
    assert volumes.parameters[0] == Parameter("angle", "deg")
    np.testing.assert_array_equal(volumes.start, np.zeros(5))
    assert Volumes.of(volumes) is volumes


def test_a_flap_is_turned_and_then_bent_with_the_wing():
    volumes = Volumes.of([Volume("flap", HINGE, "wing"), Volume("wing", BEAM, "body"), Volume("body", BODY)])
    q = np.array([12.0, 20, -3, 1, 0.5, 1, 2, 3, 0.5, -1, 2])
    turned = HINGE.bind(XYZ).place(q[:1])
    bent = BEAM.bind(turned).place(q[1:5])
    np.testing.assert_allclose(volumes.bind(XYZ, "flap").place(q), BODY.bind(bent).place(q[5:]), atol=1e-12)
    mixed = volumes.bind(XYZ, ["flap"] * 4 + ["wing"] * 4 + ["body"] * 2 + ["wheel"] * 2).place(q)
    np.testing.assert_allclose(mixed[:4], volumes.bind(XYZ[:4], "flap").place(q), atol=1e-12)
    np.testing.assert_allclose(mixed[4:8], BODY.bind(BEAM.bind(XYZ[4:8]).place(q[1:5])).place(q[5:]), atol=1e-12)
    np.testing.assert_allclose(mixed[8:10], BODY.bind(XYZ[8:10]).place(q[5:]), atol=1e-12)
    np.testing.assert_array_equal(mixed[10:], XYZ[10:])


CHAINS = {
    "flap": [Volume("part", HINGE, "wing"), Volume("wing", BEAM, "body"), Volume("body", BODY)],
    "without a law": [Volume("part", None, "wing"), Volume("wing", BEAM, "body"), Volume("body", BODY)],
    "through one without": [Volume("part", HINGE, "wing"), Volume("wing", None, "body"), Volume("body", BEAM)],
    "attached": [Volume("part", None, "wing", ATTACH), Volume("wing", BEAM)],
    "attached, own law": [Volume("part", HINGE, "wing", ATTACH), Volume("wing", BEAM, "body"), Volume("body", BODY)],
    "attached, bent above": [Volume("part", None, "wing", ATTACH), Volume("wing", BEAM, "body"),
                             Volume("body", ROOTED)],
    "attached twice": [Volume("part", None, "wing", ATTACH), Volume("wing", BEAM, "body", (0.0, 1.0, 2.0)),
                       Volume("body", ROOTED)],
    "alone": [Volume("part", BEAM), Volume("other", HINGE)],
}  # fmt: skip


@pytest.mark.parametrize("name", CHAINS)
def test_derivatives_of_every_chain(name):
    volumes = Volumes.of(CHAINS[name])
    q = volumes.start + RNG.uniform(-3, 3, len(volumes.names))
    placed = volumes.bind(XYZ, "part")
    alone = placed.place(q)
    place, by_q = placed.linearise(q)
    np.testing.assert_allclose(place, alone, atol=1e-10)
    np.testing.assert_allclose(by_q, differences(placed.place, q), atol=2e-6 * np.abs(by_q).max())


def test_what_is_kept_of_the_last_parameters_is_theirs_alone():
    """Also where the caller writes into what it was given, or goes on with the same array."""
    placed = Volumes.of(CHAINS["alone"]).bind(XYZ, "part")
    q, other = RNG.uniform(-3, 3, (2, len(placed.volumes.names)))
    place, by_q = (a.copy() for a in placed.linearise(q))
    for got in placed.linearise(q):
        got[:] = np.nan
    placed.place(q)[:] = np.nan
    np.testing.assert_array_equal(placed.place(q), place)
    np.testing.assert_array_equal(placed.linearise(q)[1], by_q)
    q[:] = other
    assert not np.allclose(placed.place(q), place)
    np.testing.assert_array_equal(placed.linearise(q)[0], placed.place(other))


@pytest.mark.parametrize("name", ["attached", "attached, bent above", "attached twice"])
def test_what_is_attached_keeps_its_shape_and_stays_in_its_place(name):
    volumes = Volumes.of(CHAINS[name])
    q = RNG.uniform(-5, 5, len(volumes.names)) + 10
    place = volumes.bind(np.vstack([XYZ, ATTACH]), "part").place(q)

    def apart(points):
        return np.linalg.norm(points[:, None] - points[None], axis=2)

    np.testing.assert_allclose(apart(place), apart(np.vstack([XYZ, ATTACH])), atol=1e-8)
    # The joint goes where the volume it is attached to takes it.
    np.testing.assert_allclose(place[-1], volumes.bind([ATTACH], "wing").place(q)[0], atol=1e-9)
    assert np.linalg.norm(place[-1] - ATTACH) > 1


def test_an_attached_body_takes_the_rotation_of_its_joint():
    turn = np.array([0, 0, 0, 3.0, -5, 8])
    volumes = Volumes.of([Volume("part", None, "body", ATTACH), Volume("body", BODY)])
    np.testing.assert_allclose(volumes.bind(XYZ, "part").place(turn), BODY.bind(XYZ).place(turn), atol=1e-8)


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ([Volume("wing"), Volume("wing")], "volumes: wing is there more than once"),
        ([Volume("flap", HINGE, "wing")], "parent 'wing' of flap is not one of flap"),
        ([Volume("a", None, "b"), Volume("b", None, "a")], "a -> b -> a: a volume cannot be its own parent"),
        ([Volume("a", None, "a")], "a -> a: a volume cannot be its own parent"),
    ],
)
def test_wrong_volumes(parts, words):
    with pytest.raises(ValueError, match=words):
        Volumes.of(parts)


def test_wrong_input():
    with pytest.raises(ValueError, match="attach has no meaning without a parent"):
        Volume("engine", attach=(0, 0, 0))
    volumes = Volumes.of([Volume("wing", BEAM)])
    with pytest.raises(ValueError, match=r"xyz must be \(N, 3\), got \(3,\)"):
        volumes.bind([1, 2, 3], "wing")
    with pytest.raises(ValueError, match=r"volume must be \(12,\), got \(2,\)"):
        volumes.bind(XYZ, ["wing", "wing"])
