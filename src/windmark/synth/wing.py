"""A half model: swept, tapered, twisted wing on an ogive body, and the test section's walls round it.

Frame (mm by default, any unit will do): x downstream, y along the span from the side wall the half
model stands on, z up. The surfaces are analytic; the mesh samples them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.scene import Mesh
from windmark.synth.patch import Patch, assemble, rectangle

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HalfModel:
    """Shape of the model and of the test section; lengths in one unit (mm).

    Parameters
    ----------
    span : y of the wing's tip (before its round cap)
    root_chord, tip_chord : chords at y = 0 and at the tip
    sweep_deg, dihedral_deg, twist_deg : leading-edge sweep, dihedral, washout of the tip (nose down)
    thickness, camber, camber_at : NACA 4-digit section, as fractions of the chord
    body_radius, body_nose, body_tail : radius of the body, x of its two ends
    ogive_nose, ogive_tail : lengths of the two ogives
    floor_z, wall_top : heights of the floor and of the upper edge of the side wall
    wall_x, floor_width : extent of the panels in x, width of the floor in y
    """

    span: float = 600.0
    root_chord: float = 260.0
    tip_chord: float = 120.0
    sweep_deg: float = 28.0
    dihedral_deg: float = 4.0
    twist_deg: float = 3.0
    thickness: float = 0.11
    camber: float = 0.018
    camber_at: float = 0.4
    body_radius: float = 72.0
    body_nose: float = -270.0
    body_tail: float = 640.0
    ogive_nose: float = 230.0
    ogive_tail: float = 260.0
    floor_z: float = -420.0
    wall_top: float = 380.0
    wall_x: tuple[float, float] = (-750.0, 1150.0)
    floor_width: float = 1150.0

    def __post_init__(self) -> None:
        if not (0 < self.tip_chord <= self.root_chord and self.span > self.body_radius > 0):
            raise ValueError("HalfModel: need 0 < tip_chord <= root_chord and span > body_radius > 0")
        if not self.ogive_nose + self.ogive_tail <= self.body_tail - self.body_nose:
            raise ValueError("HalfModel: ogive_nose + ogive_tail must not exceed body_tail - body_nose")

    @property
    def wing_root(self) -> float:
        """The y where the wing's surface starts: inside the body, so that there is no gap."""
        return 0.6 * self.body_radius

    def chord(self, y: ArrayLike) -> Array:
        """Chord at y."""
        return self.root_chord + (self.tip_chord - self.root_chord) * np.asarray(y, dtype=float) / self.span

    def leading_edge(self, y: ArrayLike) -> Array:
        """The x of the leading edge at y, before twist."""
        return np.tan(np.radians(self.sweep_deg)) * np.asarray(y, dtype=float)

    def planform(self, xyz: ArrayLike) -> tuple[Array, Array]:
        """(x/c, eta) of points (..., 3) of the undeformed wing; eta = y / span; clipped to [0, 1]."""
        p = np.asarray(xyz, dtype=float)
        y = np.clip(p[..., 1], 0.0, self.span)
        xc = (p[..., 0] - self.leading_edge(y)) / self.chord(y)
        return np.clip(xc, 0.0, 1.0), y / self.span

    # --- surfaces ------------------------------------------------------------------------
    def wing_surface(self, s: Array, t: Array, side: float) -> Array:
        """Upper (side = 1) or lower (-1) surface; s runs from the leading to the trailing edge."""
        y = self.wing_root + t * (self.span - self.wing_root)
        return self._to_space(*self._section(s, side), y)

    def tip_surface(self, s: Array, t: Array) -> Array:
        """Round cap of the tip: half ellipses from the upper (t = 0) to the lower surface."""
        y = np.full(np.broadcast(s, t).shape, self.span)
        xu, zu = self._section(s, 1.0)
        xl, zl = self._section(s, -1.0)
        upper, lower = self._to_space(xu, zu, y), self._to_space(xl, zl, y)
        # A hair of thickness keeps the cap's cells from collapsing at the leading and trailing edge.
        hair = np.array([0.0, 0.0, 1e-4 * self.tip_chord])
        middle, half = 0.5 * (upper + lower), 0.5 * (upper - lower) + hair
        angle = np.pi * np.asarray(t)[..., None]
        outward = np.linalg.norm(half, axis=-1, keepdims=True) * np.array([0.0, 1.0, 0.0])
        return middle + np.cos(angle) * half + np.sin(angle) * outward

    def body_surface(self, s: Array, t: Array) -> Array:
        """Half body of revolution about the x axis, y >= 0; t runs from the top to the bottom."""
        x = self.body_nose + s * (self.body_tail - self.body_nose)
        radius = self._body_radius(x)
        angle = np.pi * np.asarray(t)
        x, y, z = np.broadcast_arrays(x, radius * np.sin(angle), radius * np.cos(angle))
        return np.stack([x, y, z], axis=-1)

    def _section(self, s: Array, side: float) -> tuple[Array, Array]:
        """NACA 4-digit section with a closed trailing edge, unit chord, cosine spacing in s."""
        x = 0.5 * (1 - np.cos(np.pi * s))
        root = np.sin(0.5 * np.pi * s)  # sqrt(x) without its infinite slope in s
        t = 5 * self.thickness * (0.2969 * root + x * (-0.126 + x * (-0.3516 + x * (0.2843 - 0.1036 * x))))
        p, m = self.camber_at, self.camber
        front = x < p
        line = np.where(front, m / p**2 * (2 * p * x - x * x), m / (1 - p) ** 2 * (1 - 2 * p + 2 * p * x - x * x))
        slope = np.where(front, 2 * m / p**2 * (p - x), 2 * m / (1 - p) ** 2 * (p - x))
        angle = np.arctan(slope)
        return x - side * t * np.sin(angle), line + side * t * np.cos(angle)

    def _to_space(self, xc: Array, zc: Array, y: Array) -> Array:
        """Section coordinates (unit chord) to space: chord, twist about the quarter chord, sweep, dihedral."""
        chord = self.chord(y)
        twist = -np.radians(self.twist_deg) * y / self.span  # washout: the tip's nose down
        dx, dz = (xc - 0.25) * chord, zc * chord
        x = self.leading_edge(y) + 0.25 * chord + np.cos(twist) * dx + np.sin(twist) * dz
        z = np.tan(np.radians(self.dihedral_deg)) * y - np.sin(twist) * dx + np.cos(twist) * dz
        x, y, z = np.broadcast_arrays(x, y, z)
        return np.stack([x, y, z], axis=-1)

    def _body_radius(self, x: Array) -> Array:
        """Tangent ogives at both ends of a cylinder; a pin-hole is left open at the tips (no zero-area cells)."""
        ahead = np.clip((self.body_nose + self.ogive_nose - x) / self.ogive_nose, 0, 1) * self.ogive_nose
        behind = np.clip((x - self.body_tail + self.ogive_tail) / self.ogive_tail, 0, 1) * self.ogive_tail
        radius = np.minimum(_ogive(ahead, self.ogive_nose, self.body_radius),
                            _ogive(behind, self.ogive_tail, self.body_radius))  # fmt: skip
        return np.maximum(radius, 2e-3 * self.body_radius)

    # --- blocks --------------------------------------------------------------------------
    def patches(self, nodes: int = 60_000) -> dict[str, Patch]:
        """The structured blocks by name, with about ``nodes`` nodes in all.

        Raises
        ------
        ValueError
            For fewer than 500 nodes, which could not show the section.
        """
        if nodes < 500:
            raise ValueError(f"HalfModel.patches: nodes must be at least 500, got {nodes}")
        k = np.sqrt(nodes / 60_000)

        def n(full: int) -> int:
            return max(3, round(full * k))

        x0, x1 = self.wall_x
        length, depth, height = x1 - x0, self.floor_width, self.wall_top - self.floor_z
        blocks = [
            Patch("wing_upper", "wing", lambda s, t: self.wing_surface(s, t, 1.0), n(151), n(133)),
            Patch("wing_lower", "wing", lambda s, t: self.wing_surface(s, t, -1.0), n(151), n(133), True),
            Patch("wing_tip", "wing", self.tip_surface, n(151), n(13)),
            Patch("body", "body", self.body_surface, n(161), n(61)),
            rectangle("floor", "wall", (x0, 0, self.floor_z), (length, 0, 0), (0, depth, 0), n(76), n(46)),
            rectangle("side", "wall", (x0, 0, self.floor_z), (0, 0, height), (length, 0, 0), n(33), n(76)),
        ]
        return {p.name: p for p in blocks}

    def mesh(self, nodes: int = 60_000) -> Mesh:
        """The mesh of `patches`, volumes "wing", "body" and "wall"."""
        return assemble(list(self.patches(nodes).values()))


def _ogive(distance: Array, length: float, radius: float) -> Array:
    """Radius of a tangent ogive at a distance from its shoulder, towards the tip."""
    rho = (radius * radius + length * length) / (2 * radius)
    return np.sqrt(rho * rho - distance * distance) + radius - rho
