"""The work, and the time, that a search may take."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g2
from windmark.geometry import Camera, Pose
from windmark.geometry._p3p_kernels import p3p_batch_kernel
from windmark.registration._kernels.evidence import log10_nfa
from windmark.registration._kernels.match import search_kernel
from windmark.registration._kernels.quad import spot_quads_kernel, table_kernel
from windmark.registration._kernels.rival import rivals_kernel
from windmark.registration._kernels.symmetry import motions_kernel
from windmark.registration.settle._kernels.doubt import look_kernel
from windmark.registration.settle._kernels.places import places_kernel
from windmark.registration.settle._kernels.settle import accept_kernel, fit_kernel, settle_kernel
from windmark.registration.task import Task, Visible

_KERNELS = (
    log10_nfa, p3p_batch_kernel, rivals_kernel, search_kernel, spot_quads_kernel, table_kernel, motions_kernel,
    settle_kernel, fit_kernel, accept_kernel, look_kernel, places_kernel,
)  # fmt: skip

PER_SECOND = 1e7
"""Units of work that a core of 2024 does in a second."""
LINK, TRIPLET, SETTLE, SETTLE_PAIR, BEND, BEND_PAIR = 1, 5, 900, 35, 35_000, 700
"""What is counted, in units of about 0.1 us: a link of a quad, one of a triplet (P3P and what it must pass), a
candidate that is refined, for each marker of it, and the same with a deformation. Guarded by
`benchmarks/matching_refusals.py`: the time of a refusal is as even as these are right."""
LEAST, PER_POINT = 200_000, 2_500
"""The search may do so much work, and so much for each marker and each spot, times the root of the number of focal
lengths to try. With half of the markers hidden and as many false spots, 99 of 100 right solutions need no more than
half of it, with all that is done to check them. Few spots are searched in full besides."""
RANSAC, PER_CAMERA = 200_000_000, 2_000_000
"""The paper's search may do so much work, and a rig so much for each camera."""


class Budget:
    """Units of work, counted as they are done: the same answer on any machine. And the time, where a user limits it.

    The time is the CPU time of this thread, so that other work on the machine changes no result. When numba has
    compiled a kernel, or read it from its cache, that clock starts again: the first call of a process shall not be
    refused for it.

    Parameters
    ----------
    max_work : units of work
    seconds : None for no limit
    """

    def __init__(self, max_work: float = np.inf, seconds: float | None = None) -> None:
        self.max_work, self.seconds, self.spent = max_work, seconds, 0.0
        self._start, self._compiled = 0.0, 0
        if seconds is not None:
            self._start, self._compiled = time.thread_time(), _compiled()

    @classmethod
    def of(cls, work: float, limit_s: float | None) -> Budget:
        """So much work, and the time if there is a limit; a long one lets it work as long, too."""
        return cls(max(work, PER_SECOND * (limit_s or 0.0)), limit_s)

    def spend(self, units: float) -> None:
        """Count work."""
        self.spent += units

    @property
    def out_of_time(self) -> bool:
        """Whether the time is over."""
        if self.seconds is None:
            return False
        now, compiled = time.thread_time(), _compiled()
        if compiled != self._compiled:
            self._start, self._compiled = now, compiled
        return now - self._start > self.seconds

    @property
    def over(self) -> bool:
        """Whether the work or the time is spent."""
        return self.spent > self.max_work or self.out_of_time

    @property
    def exhausted(self) -> bool:
        """Whether twice the work or the time is spent: what was found near the end can still be checked."""
        return self.spent > 2 * self.max_work or self.out_of_time

    @property
    def why(self) -> str:
        """Why it is over."""
        if self.seconds is not None and (self.out_of_time or self.spent <= self.max_work):
            return f"stopped after max_time_s = {self.seconds:g} s"
        return (
            f"stopped after the work of {g2(self.max_work / PER_SECOND)} s on a quiet machine (a larger max_time_s "
            "lets it do more)"
        )

    def without(self, function: Visible | None) -> Visible | None:
        """The function, its own time not counted."""
        if function is None:
            return None

        def uncounted(pose: Pose, camera: Camera) -> NDArray[np.bool_]:
            start = time.thread_time()
            seen = function(pose, camera)
            self._start += time.thread_time() - start
            return seen

        return uncounted


def work_for(task: Task, method: str) -> float:
    """What the search may do for one picture."""
    if method == "ransac":
        return RANSAC
    work = (LEAST + PER_POINT * (len(task.markers) + len(task.xy))) * float(len(task.focal_factors)) ** 0.5
    return work + TRIPLET * task.sparse_links


def _compiled() -> int:
    # Of the dispatcher's properties `signatures` would hash every type again.
    return sum(len(kernel.overloads) for kernel in _KERNELS)
