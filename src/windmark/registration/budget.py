"""The time that a search may take."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose
from windmark.geometry._p3p_kernels import p3p_batch_kernel
from windmark.registration._kernels.evidence import log10_nfa
from windmark.registration._kernels.growth import growth_kernel
from windmark.registration._kernels.hypothesis import hypotheses_kernel
from windmark.registration._kernels.match import search_kernel
from windmark.registration._kernels.quad import first_of_each_kernel, spot_quads_kernel, table_kernel
from windmark.registration._kernels.rival import rivals_kernel
from windmark.registration._kernels.symmetry import symmetries_kernel
from windmark.registration.settle._kernels.doubt import doubt_kernel
from windmark.registration.settle._kernels.places import places_kernel
from windmark.registration.settle._kernels.settle import accept_kernel, fit_kernel, settle_kernel
from windmark.registration.settle._kernels.smooth import smooth_cov_kernel
from windmark.registration.settle._kernels.worth import worth_kernel
from windmark.registration.task import Visible

_KERNELS = (
    log10_nfa, growth_kernel, hypotheses_kernel, p3p_batch_kernel, rivals_kernel, search_kernel, spot_quads_kernel,
    table_kernel, symmetries_kernel, first_of_each_kernel, settle_kernel, fit_kernel, accept_kernel, worth_kernel,
    doubt_kernel, places_kernel, smooth_cov_kernel,
)  # fmt: skip


class Budget:
    """CPU time of this thread, so that other work on the machine changes no result.

    When numba has compiled a kernel, or read it from its cache, the clock starts again: the first call of a process
    shall not be refused for that.
    """

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self._start, self._compiled = time.thread_time(), _compiled()

    @property
    def spent(self) -> float:
        """Seconds so far."""
        now, compiled = time.thread_time(), _compiled()
        if compiled != self._compiled:
            self._start, self._compiled = now, compiled
        return now - self._start

    @property
    def over(self) -> bool:
        """Whether the time is spent."""
        return self.spent > self.seconds

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


def _compiled() -> int:
    # Of the dispatcher's properties `signatures` would hash every type again.
    return sum(len(kernel.overloads) for kernel in _KERNELS)
