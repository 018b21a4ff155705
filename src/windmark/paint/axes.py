"""Body and wind axes, and what loads are made dimensionless by.

Body axes here point aft (along which an axial force CA is positive), to starboard (CY) and up (CN): the axes that most
grids have as x, y, z. Moments have the signs of flight mechanics: rolling Cl positive with the starboard wing down,
pitching Cm with the nose up, yawing Cn with the nose to starboard (ISO 1151-1), so Cl and Cn are minus the moments
about the aft and the up axis. Wind axes follow by angle of attack and of sideslip: drag along the wind, lift across it
in the plane of symmetry, side force to starboard.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError

Array = NDArray[np.float64]

COEFFICIENTS = ("CA", "CY", "CN", "Cl", "Cm", "Cn", "CD", "CC", "CL")
"""What `Loads` holds, in this order: body forces, moments about body axes, wind forces (drag, side, lift)."""


@dataclass(frozen=True, eq=False)
class LoadReference:
    """What forces and moments are referred to.

    Parameters
    ----------
    area, chord, span : reference area (length unit squared) and lengths of the mesh's unit; Cm is by chord, Cl and Cn
        are by span
    moment_point : (3,) in model coordinates
    alpha_deg, beta_deg : angle of attack and of sideslip of the body axes
    body_axes : (3, 3) rows aft, starboard and up in model coordinates; right-handed, of length 1

    Raises
    ------
    ValueError
        For lengths that are not above zero or axes that are none.

    Examples
    --------
    >>> import windmark as wm
    >>> reference = wm.LoadReference(area=2.0, chord=0.5, span=4.0, alpha_deg=30.0)
    >>> drag, side, lift = reference.wind_axes()
    >>> lift.round(3).tolist()  # along the body axes aft, starboard, up
    [-0.5, 0.0, 0.866]
    """

    area: float
    chord: float
    span: float
    moment_point: Array = field(default_factory=lambda: np.zeros(3))
    alpha_deg: float = 0.0
    beta_deg: float = 0.0
    body_axes: Array = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        for name in ("area", "chord", "span"):
            if not 0 < getattr(self, name) < np.inf:
                raise UsageError(f"LoadReference: {name} must be > 0, got {getattr(self, name)}")
        if not (np.isfinite(self.alpha_deg) and np.isfinite(self.beta_deg)):
            raise UsageError(f"LoadReference: angles must be finite, got {self.alpha_deg} and {self.beta_deg}")
        point, axes = np.asarray(self.moment_point, dtype=float), np.asarray(self.body_axes, dtype=float)
        if point.shape != (3,) or not np.isfinite(point).all():
            raise ValueError(f"LoadReference: moment_point must be three finite numbers, got {self.moment_point}")
        if axes.shape != (3, 3) or not np.allclose(axes @ axes.T, np.eye(3), atol=1e-6) or np.linalg.det(axes) < 0:
            raise UsageError("LoadReference: body_axes must be three rows of length 1, at right angles, right-handed")
        object.__setattr__(self, "moment_point", point)
        object.__setattr__(self, "body_axes", axes)

    def wind_axes(self) -> Array:
        """(3, 3) rows along the wind (drag), to starboard across it, and up (lift), in body axes."""
        a, b = np.radians(self.alpha_deg), np.radians(self.beta_deg)
        ca, sa, cb, sb = np.cos(a), np.sin(a), np.cos(b), np.sin(b)
        return np.array([[ca * cb, -sb, sa * cb], [ca * sb, cb, sa * sb], [-sa, 0.0, ca]])

    def coefficients(self, force_moment: Array) -> Array:
        """(9, ...) the `COEFFICIENTS` of ``force_moment`` (6, ...): force over q, moment about the point over q."""
        force = np.tensordot(self.body_axes, force_moment[:3], 1) / self.area
        moment = np.tensordot(self.body_axes, force_moment[3:], 1) / self.area
        turned = np.stack([-moment[0] / self.span, moment[1] / self.chord, -moment[2] / self.span])
        return np.concatenate([force, turned, np.tensordot(self.wind_axes(), force, 1)])
