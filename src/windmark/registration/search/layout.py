"""What the search needs to know of a set of markers, found once and used for every image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import DegenerateGeometry, Pose
from windmark.registration._kernels.hypothesis import Model
from windmark.registration._kernels.near import nearest
from windmark.registration._kernels.quad import Table, table_of
from windmark.registration._kernels.symmetry import alike_triangles, motions_of, symmetries_at, symmetries_of
from windmark.registration.cached import cached_property
from windmark.registration.search.field import FAINTEST, FAR, REACH, STIFF, SUPPLE, Field, extents, field_of, modes_of
from windmark.registration.task import on_line
from windmark.scene import MarkerSet

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

NEIGHBOURS = 48
"""Markers looked at in the neighbourhood test."""
REACHES = (7, 10)
"""Neighbours that a marker's quads are taken from: the small table is tried first, the large one after it."""
DIRECTIONS = 60
"""Directions, all round, from which the quads are tabled."""
SYMMETRIES, LEAST_BROUGHT = 200, 0.2
"""Near-symmetries kept at most, and the part of the markers that each must bring onto others."""
SYMMETRIES_AT, LEAST_AT = 24, 5
"""The same of those about one marker: there are 12 of a triangular lattice, front and back."""
SEEDS = 6
"""Triangles whose like is looked for; a near-symmetry that takes all of them off the model is of no use."""
FLAT = 0.15
"""Markers are nearly flat if they are so thin (rms) beside their extent (rms)."""
FLIP = np.diag([-1.0, 1.0, 1.0])
"""Mirrors a model."""
MANY = 1_000
"""Of more markers than this enough neighbours are always seen: the small table does, the large one would take 300 MB of
4,000 markers."""


@dataclass(frozen=True)
class Frame:
    """Centre and size of the marker set: ``xyz = centre + scale * unit``."""

    centre: Array
    scale: float

    def pose(self, rotation: Array, translation: Array) -> Pose:
        """cam_from_model of a pose of the unit model."""
        return Pose.trusted(rotation, self.scale * translation - rotation @ self.centre)

    def unit(self, pose: Pose) -> tuple[Array, Array]:
        """Rotation and translation of a pose for the unit model."""
        return pose.rotation, pose.apply(self.centre) / self.scale

    def change(self, translation: Array) -> Array:
        """(6, 6) from the unit model, turned about its centre, to the model and ``exp(delta) @ pose``."""
        s, (x, y, z) = self.scale, (self.scale * translation).tolist()
        return np.array([
            [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
            [0.0, -z, y, s, 0.0, 0.0], [z, 0.0, -x, 0.0, s, 0.0], [-y, x, 0.0, 0.0, 0.0, s],
        ])  # fmt: skip


class Layout:
    """A set of markers, prepared for `register`; the tables are built when they are first needed.

    Parameters
    ----------
    markers : the table of markers that `register` will be given
    """

    def __init__(self, markers: MarkerSet) -> None:
        self.markers = markers
        self.model, self.frame = unit_model(markers.xyz, markers.normal)
        self._tables: dict[int, Table] = {}
        self._at: dict[tuple[int, int], tuple[Ints, Array, Array]] = {}

    def is_of(self, markers: MarkerSet) -> bool:
        """Whether it was prepared from these markers."""
        mine = self.markers
        if mine is markers:
            return True
        same = ((mine.xyz, markers.xyz), (mine.normal, markers.normal))
        walls = np.array_equal(mine.role == "wall", markers.role == "wall")
        return walls and all(np.array_equal(a, b, equal_nan=True) for a, b in same)

    def ready(self) -> Layout:
        """Build all tables now."""
        for reach in REACHES:
            self.table(reach)
        _ = self.symmetries, self.mirror_starts, self.size, self.on_line
        # Every answer asks for the deformations, so the first one of a prepared set should not find them.
        _ = self.modes_of_each, self.stiff_bows_of_each, self.stiff_turns_of_each, self.walls
        return self

    def table(self, reach: int) -> Table:
        """Quads by key, from so many neighbours of each marker: one of `REACHES`, or more if most are hidden."""
        reach = min(reach, REACHES[0]) if len(self.model.xyz) > MANY else reach
        if reach not in self._tables:
            self._tables[reach] = self._tabled(reach)
        return self._tables[reach]

    @cached_property
    def symmetries(self) -> tuple[Ints, Array, Array]:
        """Near-symmetries: (S, N) the marker onto which each one is brought or -1, rotations and translations.

        Of the unit model. The identity is not among them.
        """
        return self._motions(mirrored=False)

    def symmetries_with(self, label: tuple[int, int] | None) -> tuple[Ints, Array, Array]:
        """The same, and those that bring the marker ``label[0]`` onto the marker ``label[1]``, or onto itself, however
        few they bring onto others.

        Of a regular layout `symmetries` has mostly shifts, as those bring most; the quarter turn about a marker that is
        labelled by hand is not among them where that is far from the middle.
        """
        if label is None:
            return self.symmetries
        if label not in self._at:
            more = symmetries_at(self.model, *label, LEAST_AT, SYMMETRIES_AT)
            self._at[label] = more, *motions_of(self.model.xyz, more, 1.0)
        (onto, turn, shift), (more, turned, shifted) = self.symmetries, self._at[label]
        return np.concatenate([onto, more]), np.concatenate([turn, turned]), np.concatenate([shift, shifted])

    @cached_property
    def mirrors(self) -> tuple[Ints, Array, Array]:
        """The same with a reflection (determinant -1), by which the mirrored model can be taken for the model.

        Of a nearly flat model the first one is the mirroring in its plane, which brings every marker (nearly) onto
        itself: the normals may say that it cannot be seen so, but the relief may well be wrong by its sign.
        """
        motions = self._motions(mirrored=True)
        if self.flat_along is None:
            return motions
        onto, turn, shift = motions
        itself = np.arange(len(self.model.xyz), dtype=np.int32)
        other = (onto == itself).sum(axis=1) * 2 < (onto >= 0).sum(axis=1)
        plane = np.eye(3) - 2 * np.outer(self.flat_along, self.flat_along)
        return (
            np.concatenate([itself[None], onto[other]]),
            np.concatenate([plane[None], turn[other]]),
            np.concatenate([np.zeros((1, 3)), shift[other]]),
        )

    @cached_property
    def mirror_starts(self) -> tuple[Ints, Array, Array, Array]:
        """`mirrors` for the model mirrored by `FLIP`, and across which (3,) that is flat; zero where it is not.

        F x_o is about F (A x_m + s) and must be seen where x_m was.
        """
        (onto, turn, shift), across = self.mirrors, self.flat_along
        flat = np.zeros(3) if across is None else across @ FLIP
        return onto, np.ascontiguousarray(FLIP @ turn), np.ascontiguousarray(shift @ FLIP), flat

    @cached_property
    def flat_along(self) -> Array | None:
        """(3,) unit vector across a nearly flat model; None where it is not."""
        axes, rms = _axes(self.model.xyz)
        return axes[2] if rms[2] <= FLAT * float(np.linalg.norm(rms)) else None

    @cached_property
    def _alike(self) -> list[tuple[Ints, Ints]]:
        """What looks like some compact triangles that are spread over the markers."""
        every = np.arange(len(self.model.xyz), dtype=np.int32)
        return alike_triangles(self.model, spread_corners(self.model.xyz, every, SEEDS))

    def _motions(self, *, mirrored: bool) -> tuple[Ints, Array, Array]:
        least = max(5, int(np.ceil(LEAST_BROUGHT * len(self.model.xyz))))
        onto = symmetries_of(self.model, self._alike, least, SYMMETRIES, mirrored=mirrored)
        return onto, *motions_of(self.model.xyz, onto, -1.0 if mirrored else 1.0)

    def sigma_of(self, markers: MarkerSet) -> Array:
        """(N, 3) of the unit model, zero where unknown; the markers' sigmas may be others than those prepared."""
        return self._sigma if markers is self.markers else _known(markers.sigma) / self.frame.scale

    @cached_property
    def _sigma(self) -> Array:
        return _known(self.markers.sigma) / self.frame.scale

    @cached_property
    def spacing(self) -> Array:
        """(N,) distance of every marker to the nearest other one, in length units."""
        xyz = self.markers.xyz
        return np.asarray(np.linalg.norm(xyz - xyz[self.model.near[:, 0]], axis=1))

    @cached_property
    def on_line(self) -> bool:
        """Whether the markers lie on one line."""
        return on_line(self.markers.xyz)

    @cached_property
    def size(self) -> float:
        """Largest extent of the unit model along a principal axis."""
        return float(extents(self.model.xyz)[1].max())

    @cached_property
    def modes(self) -> Array:
        """(K, N, 3) how the markers may be displaced if the model is deformed; walls are not."""
        return modes_of(self._near_field)

    @cached_property
    def _near_field(self) -> Field:
        return field_of(self.model.xyz, self.markers.role == "wall", REACH)

    @cached_property
    def far_field(self) -> Field:
        """A deformation that is hardly more than a bow."""
        return field_of(self.model.xyz, self.markers.role == "wall", FAR)

    @property
    def fields(self) -> tuple[Field, ...]:
        """Deformations of more than one reach, for a pose whose residuals may have a little of them."""
        return self._near_field, self.far_field

    @cached_property
    def fine_fields(self) -> tuple[Field, ...]:
        """The same for the pose of a model that is bent, where a hundredth of the bow is more than the noise."""
        xyz, walls = self.model.xyz, self.markers.role == "wall"
        return field_of(xyz, walls, REACH, FAINTEST), field_of(xyz, walls, FAR, FAINTEST)

    @cached_property
    def bows(self) -> Array:
        """(K, N, 3) how they may be displaced by a deformation that is hardly more than a bow, but along all axes."""
        return self.far_field.amplitude(SUPPLE)[:, None, None] * self.far_field.modes

    @cached_property
    def modes_of_each(self) -> Array:
        """(N, 3, K) `modes` as `settle._kernels.slopes` wants them: those of a marker's coordinate side by side."""
        return np.ascontiguousarray(self.modes.transpose(1, 2, 0))

    @cached_property
    def stiff_bows_of_each(self) -> Array:
        """(N, 3, K) the same of a stiff model's `far_field`."""
        bows = self.far_field.amplitude(STIFF)[:, None, None] * self.far_field.modes
        return np.ascontiguousarray(bows.transpose(1, 2, 0))

    @cached_property
    def walls(self) -> NDArray[np.bool_]:
        """(N,) markers that do not move."""
        return np.asarray((self.far_field.modes == 0.0).all(axis=(0, 2)))

    @cached_property
    def stiff_turns_of_each(self) -> Array:
        """(N, 3, K) how the whole model would turn if it went on from each marker as these do there."""
        return np.ascontiguousarray(self.far_field.amplitude(STIFF) * self.far_field.motions[:, :3])

    def _tabled(self, reach: int) -> Table:
        return table_of(self.model, min(reach, self.model.near.shape[1]), sphere(DIRECTIONS))


def unit_model(xyz: Array, normal: Array) -> tuple[Model, Frame]:
    """Markers for the kernels, (N, 3) and (N, 3) with NaN where unknown; N >= 2.

    `DegenerateGeometry` where they have no size by which they could be divided.
    """
    centre = xyz.mean(axis=0)
    with np.errstate(over="ignore", invalid="ignore"):
        scale = float(np.sqrt(((xyz - centre) ** 2).sum(axis=1).mean()))
    if not 0.0 < scale < np.inf:
        raise DegenerateGeometry("markers: they are all at one place, or too far apart to be compared")
    unit = (xyz - centre) / scale
    known = np.where(np.isfinite(normal).all(axis=1, keepdims=True), normal, 0.0)
    near = nearest(unit, min(NEIGHBOURS, len(xyz) - 1))[0]
    return Model(unit, np.ascontiguousarray(known), near), Frame(centre, scale)


def _known(sigma: Array) -> Array:
    return np.where(np.isfinite(sigma), sigma, 0.0)


def _axes(xyz: Array) -> tuple[Array, Array]:
    """Principal axes (3, 3) of centred markers (N, 3) as rows, widest first, and their rms (3,) along each."""
    value, vector = np.linalg.eigh(xyz.T @ xyz / len(xyz))
    return vector.T[::-1], np.sqrt(np.maximum(value[::-1], 0.0))


def sphere(n: int) -> Array:
    """(n, 3) unit vectors spread evenly over the sphere (Fibonacci's spiral)."""
    i = np.arange(n) + 0.5
    z, turn = 1 - 2 * i / n, np.pi * (1 + np.sqrt(5)) * i
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1)


def interior_angles(corners: Array) -> Array:
    """(T, 3) interior angles in radians of triangles (T, 3, d); 0 for coincident corners."""
    angles = []
    for a in range(3):
        u, v = corners[:, (a + 1) % 3] - corners[:, a], corners[:, (a + 2) % 3] - corners[:, a]
        length = np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)
        cosine = np.divide((u * v).sum(axis=1), length, out=np.ones(len(u)), where=length > 0)
        angles.append(np.arccos(np.clip(cosine, -1, 1)))
    return np.stack(angles, axis=1)


def spread_corners(p: Array, spots: Ints, count: int) -> Ints:
    """Up to ``count`` compact triplets (C, 3) of the given spots, spread over the image, with sound angles."""
    if len(spots) < 3:
        return np.zeros((0, 3), dtype=np.int32)
    q = p[spots]
    chosen: list[int] = [int(np.argmin(((q - q.mean(axis=0)) ** 2).sum(axis=1)))]
    far = np.full(len(q), np.inf)
    while len(chosen) < min(count, len(q)):
        far = np.minimum(far, ((q - q[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(np.argmax(far)))
    triplets = [corner for a in chosen if (corner := _compact(q, a)) is not None]
    return np.array([spots[list(t)] for t in triplets], dtype=np.int32).reshape(-1, 3)


def _compact(q: Array, a: int) -> tuple[int, int, int] | None:
    """The nearest two neighbours of point ``a`` that make a triangle with angles of 20 degrees or more."""
    order = np.argsort(((q - q[a]) ** 2).sum(axis=1), kind="stable")[1:8]
    for n in range(1, len(order)):
        corners = np.array([[q[a], q[order[k]], q[order[n]]] for k in range(n)])
        good = np.flatnonzero(interior_angles(corners).min(axis=1) >= np.radians(20.0))
        if good.size:
            return a, int(order[good[0]]), int(order[n])
    return None
