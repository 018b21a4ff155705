"""What the identification gives: the state of the model and the cameras at one instant, with covariance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.adjust import SolveReport
from windmark.deformation.discs import OtherDiscs
from windmark.deformation.misfit import Misfit
from windmark.deformation.sighting import LAW, MOTION
from windmark.deformation.volumes import Placed, Volumes
from windmark.errors import UsageError, g2, g3
from windmark.geometry import Camera, Pose
from windmark.geometry.described import described
from windmark.geometry.rotations import hat
from windmark.scene import Doubt, Mesh
from windmark.scene.shown import pandas_table

Array = NDArray[np.float64]

CAUSES = {
    "undetermined": "this set-up does not determine all that is free",
    "too_few": "fewer observations than free parameters",
    "no_fit": "no laws and motion fit the observations",
    "moved": "a camera taken as fixed is not where it should be",
    "no_convergence": "the search ended before its minimum",
    "behind": "the start puts markers behind a camera",
    "law": "a law has no place for the markers where the search ended",
}
"""Why there is no result."""


def _figures(d: Deformation) -> dict[str, object]:
    sigma = d.sigma
    return {
        "spots": f"{int(d.used.sum())} of {len(d.used)}", "rms px": f"{g3(d.rms_px)}", "sigma0": f"{g3(d.sigma0)}",
        **{n: f"{v:.5g} ± {g2(sigma[n])}" if n in sigma else f"{v:.5g}" for n, v in d.parameters.items()},
        "warnings": "; ".join(d.warnings) or "none", "unchecked": "; ".join(map(str, d.unchecked)) or "nothing",
    }  # fmt: skip


@described(_figures)
@dataclass(frozen=True, eq=False)
class Deformation:
    """The identified state.

    Parameters
    ----------
    volumes : the model's volumes and their laws
    placed : all markers, bound to the laws
    q : (K,) parameters of all laws, in their own units
    tunnel_from_model : rigid motion of the model
    cam_from_tunnel : pose of every view by its name
    cameras : by name; the focal length replaced where it was free
    names : (F,) names of all that was free, in the order of `cov`
    cov : (F, F) covariance of these, from the covariances of the spots and of the markers; where the residuals are
        larger than these explain, times what is left of sigma0 squared, see `windmark.deformation.judge`. Poses and
        motion are perturbed as ``exp(delta) @ pose``, delta = [rotation, translation]
    slices : where each block stands in it
    residuals_px : (O, 2) projected - observed, in the order of the observations, discs' eccentricity removed
    used : (O,) observations that took part; the others are outliers
    test : (O,) test value of each observation: of a good one chi-square with two degrees of freedom
    rms_px : root mean square length of the used residuals, weighted as the spots are certain
    sigma0 : 1 where the residuals are as large as the covariances say; NaN without redundancy
    chi2, redundancy : sum of squared whitened residuals, priors included, and its expected value
    from_prior : names of law parameters that the images hardly tell: known from their prior alone
    at_bound : names of law parameters that ended at a bound; the covariance has how far beyond it the images put them,
        and where they contradict it that is a doubt
    report : why the solve stopped
    options : everything it was made with
    doubts : what contradicts the rest; ``warnings`` are their sentences
    suspect : names of the markers, views and volumes in them
    unchecked : what these images cannot tell and no sigma contains, as whether a volume that has a law of its own moves
        with the one beside it
    set_up : (F, F) what ``cov`` is without all that turned out to be wrong: what the laws lack, bounds and priors that
        are contradicted, a camera that is late; None where it is the same
    misfit : what the laws lack, where neighbouring residuals agree in it; it is in ``cov`` and in that of every place
    other_discs : what discs of the imaged size would change, or of the table's where the imaged ones fit better; it is
        in ``cov`` and ``set_up``. None where that is nothing, or the size is not known

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> @wm.law(tip={"unit": "mm", "sigma": 20.0})
    ... def bend(xyz, tip):
    ...     return xyz + np.outer((xyz[:, 1] / 400.0) ** 2, [0.0, 0.0, tip])
    >>> x, y = (v.ravel() for v in np.meshgrid([0.0, 40.0, 80.0], np.linspace(50.0, 400.0, 8)))
    >>> markers = wm.MarkerSet.make([f"m{i}" for i in range(24)], np.c_[x, y, 0 * x], volume="wing")
    >>> camera, pose = wm.Camera((640, 480), 800.0), wm.Pose.look_at([300, 200, 700], [40, 200, 0], [0, 1, 0])
    >>> xy, _ = camera.project(pose.apply(bend.function(markers.xyz, 8.0)))
    >>> seen = wm.Observations(np.zeros(24, dtype=int), np.arange(24), xy, np.tile(0.01 * np.eye(2), (24, 1, 1)))
    >>> wing, view = wm.Volume("wing", bend), wm.View("cam1", cam_from_model=pose)
    >>> state = wm.identify(seen, markers, [wing], camera, [view], free_motion=False)
    >>> bool(state), state.fits, state.warnings
    (True, True, ())
    >>> moved, cov = state.displacement([[40.0, 200.0, 0.0]], "wing")  # anywhere on the wing
    >>> moved.round(2).tolist(), np.sqrt(cov[0, 2, 2]).round(2).tolist()
    ([[0.0, 0.0, 2.0]], 0.02)
    """

    volumes: Volumes
    placed: Placed
    q: Array
    tunnel_from_model: Pose
    cam_from_tunnel: Mapping[str, Pose]
    cameras: Mapping[str, Camera]
    names: tuple[str, ...]
    cov: Array
    slices: Mapping[str, slice]
    residuals_px: Array
    used: NDArray[np.bool_]
    test: Array
    rms_px: float
    sigma0: float
    chi2: float
    redundancy: int
    from_prior: tuple[str, ...]
    at_bound: tuple[str, ...]
    report: SolveReport
    options: Mapping[str, Any] = field(default_factory=dict)
    doubts: tuple[Doubt, ...] = ()
    suspect: tuple[str, ...] = ()
    misfit: Misfit | None = None
    unchecked: tuple[Doubt, ...] = ()
    set_up: Array | None = None
    other_discs: OtherDiscs | None = None

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame``: value and sigma of every parameter of the laws (NaN where it was not free)."""
        sigma = self.sigma
        return pandas_table({
            "parameter": list(self.parameters), "value": list(self.parameters.values()),
            "sigma": [sigma.get(n, float("nan")) for n in self.parameters],
        })  # fmt: skip

    def plot(self, ax: Any = None) -> Any:
        """How far the markers moved by the laws, enlarged by a round factor that the title says; matplotlib's axes."""
        from windmark.scene import plots

        moved, _ = self.markers_displaced(frame="model")
        ax = plots.space_axes(ax, self.placed.xyz)
        plots.space_arrows(ax, self.placed.xyz, moved)
        return ax

    @property
    def warnings(self) -> tuple[str, ...]:
        """The doubts as sentences."""
        return tuple(str(d) for d in self.doubts)

    @property
    def cov_of_own_discs(self) -> Array:
        """(F, F) `cov` without what `other_discs` would change."""
        more = None if self.other_discs is None else self.other_discs.follow
        return self.cov if more is None else self.cov - np.outer(more, more)

    @property
    def cov_of_set_up(self) -> Array:
        """(F, F) how well cameras and markers determine all that was free, were all else right."""
        return self.cov if self.set_up is None else self.set_up

    @property
    def fits(self) -> bool:
        """False where more than half of the residuals (their squares) is neither laws nor stated noise."""
        return not (self.doubts and self.sigma0**2 > 2.0)

    @property
    def parameters(self) -> dict[str, float]:
        """The laws' parameters by name."""
        return dict(zip(self.volumes.names, self.q.tolist(), strict=True))

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of everything that was free, by name."""
        return dict(zip(self.names, np.sqrt(np.diag(self.cov)).tolist(), strict=True))

    def place(self, xyz: ArrayLike, volume: Any, *, frame: str = "tunnel") -> tuple[Array, Array]:
        """Where points of the undeformed model are now.

        Parameters
        ----------
        xyz : (N, 3) in the model's frame
        volume : (N,) names of their volumes, or one
        frame : "tunnel"; or "model", which leaves the rigid motion out

        Returns
        -------
        (N, 3) places and (N, 3, 3) their covariance, that of the undeformed points not included
        """
        return self.moved(self.volumes.bind(xyz, volume), frame)

    def moved(self, placed: Placed, frame: str) -> tuple[Array, Array]:
        """`place` of points that are bound to the laws already."""
        place, by_free = self._linearised(placed, frame)
        return place, self.propagated(by_free, self.lacking(placed.xyz, placed.names, frame))

    def linearised(self, xyz: ArrayLike, volume: Any, *, frame: str = "tunnel") -> tuple[Array, Array]:
        """`place` of points (N, 3) and its derivatives (N, 3, F) by everything that was free, in the order of `names`.

        Those by poses and focal lengths of cameras are zero: these move no point.
        """
        return self._linearised(self.volumes.bind(xyz, volume), frame)

    def displacement(self, xyz: ArrayLike, volume: Any, *, frame: str = "tunnel") -> tuple[Array, Array]:
        """`place` less the undeformed place: (N, 3) and (N, 3, 3)."""
        place, cov = self.place(xyz, volume, frame=frame)
        return place - np.asarray(xyz, dtype=float), cov

    def markers_displaced(self, *, frame: str = "tunnel") -> tuple[Array, Array]:
        """`displacement` of all markers that it was identified with, which are bound to their laws already.

        Walls are not told apart: markers on them are moved here as if they were on the model.
        """
        place, cov = self.moved(self.placed, frame)
        return place - self.placed.xyz, cov

    def mesh(self, mesh: Mesh, *, frame: str = "tunnel", placed: Placed | None = None) -> Mesh:
        """The grid as it is now; vertices that belong to no triangle follow the rigid motion.

        ``placed``: `bound_vertices` of the grid, which need not be worked out for every state then.
        """
        _known_frame(frame)
        placed = bound_vertices(self.volumes, mesh) if placed is None else placed
        vertices = placed.place(self.q)
        return mesh.moved(vertices if frame == "model" else self.tunnel_from_model.apply(vertices))

    def propagated(self, by_free: Array, lacking: Array | None = None) -> Array:
        """(..., m, m) covariance of quantities with derivatives (..., m, F) by everything that was free.

        ``lacking`` (..., m, k), see `lacking`: their derivatives by what the laws lack.
        """
        out = np.asarray(by_free @ self.cov @ np.swapaxes(by_free, -1, -2))
        if self.misfit is None or lacking is None:
            return out
        mixed = by_free @ self.misfit.follow @ self.misfit.second @ np.swapaxes(lacking, -1, -2)
        own = lacking @ self.misfit.second @ np.swapaxes(lacking, -1, -2)
        return np.asarray(out + own + mixed + np.swapaxes(mixed, -1, -2))

    def lacking(self, xyz: Array, names: Any, frame: str) -> Array | None:
        """(N, 3, k) how undeformed points of volumes (N,) move by what the laws lack; None where that is nothing."""
        if self.misfit is None:
            return None
        columns = self.misfit.columns(xyz, names)
        return columns if frame == "model" else self.tunnel_from_model.rotation @ columns

    def by_free(self, by_law: Array, by_motion: Array | None = None) -> Array:
        """(..., m, F) derivatives from those by the laws' parameters (..., m, K) and the motion (..., m, 6)."""
        out = np.zeros((*by_law.shape[:-1], len(self.names)))
        if LAW in self.slices:
            out[..., self.slices[LAW]] = by_law
        if MOTION in self.slices and by_motion is not None:
            out[..., self.slices[MOTION]] = by_motion
        return out

    def _linearised(self, placed: Placed, frame: str) -> tuple[Array, Array]:
        _known_frame(frame)
        place, by_q = placed.linearise(self.q)
        if frame == "model":
            return place, self.by_free(by_q)
        place = self.tunnel_from_model.apply(place)
        by_motion = np.concatenate([-hat(place), np.broadcast_to(np.eye(3), (len(place), 3, 3))], axis=-1)
        return place, self.by_free(self.tunnel_from_model.rotation @ by_q, by_motion)


@dataclass(frozen=True)
class NotIdentified:
    """The data says no. Falsy.

    Parameters
    ----------
    reason : why, in words for the user
    cause : key of `CAUSES`
    weak : names of what is not determined
    options : everything the attempt was made with

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> @wm.law(tip={"unit": "mm"})
    ... def bend(xyz, tip):
    ...     return xyz + np.outer((xyz[:, 1] / 400.0) ** 2, [0.0, 0.0, tip])
    >>> markers = wm.MarkerSet.make(["a", "b"], [[0.0, 0.0, 0.0], [0.0, 400.0, 0.0]], volume="wing")
    >>> camera, above = wm.Camera((640, 480), 800.0), wm.Pose.look_at([0, 200, 700], [0, 200, 0], [0, 1, 0])
    >>> xy, _ = camera.project(above.apply(markers.xyz))
    >>> seen = wm.Observations(np.zeros(2, dtype=int), np.arange(2), xy, np.tile(np.eye(2), (2, 1, 1)))
    >>> wing, view = wm.Volume("wing", bend), wm.View("cam1", cam_from_model=above)
    >>> answer = wm.identify(seen, markers, [wing], camera, [view])
    >>> bool(answer), answer.cause
    (False, 'too_few')
    >>> answer.reason
    '2 observations cannot tell 7 unknowns'
    """

    reason: str
    cause: str
    weak: tuple[str, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return False


def vertex_volumes(mesh: Mesh) -> NDArray[np.str_]:
    """(V,) the volume of each vertex: that of a triangle it belongs to, "" for none."""
    out = np.zeros(len(mesh.vertices), dtype=np.asarray(mesh.volume).dtype if len(mesh.volume) else "<U1")
    for k in range(3):
        out[mesh.triangles[:, k]] = mesh.volume
    return out


def bound_vertices(volumes: Volumes, mesh: Mesh) -> Placed:
    """The vertices of a grid, bound to the laws of its volumes."""
    return volumes.bind(mesh.vertices, vertex_volumes(mesh))


def _known_frame(frame: str) -> None:
    if frame not in ("tunnel", "model"):
        raise UsageError(f"frame: expected 'tunnel' or 'model', got {frame!r}")
