"""Many views adjusted at once: shared cameras, poses, rigs, free points; solved with a Schur complement."""

from windmark.adjust.network.model import Bars, KnownTogether, Network
from windmark.adjust.network.problem import NetworkProblem
from windmark.adjust.network.robust import graduated
from windmark.adjust.network.state import NetworkState
from windmark.adjust.network.steps import minimise_network_by_steps

__all__ = [
    "Bars", "KnownTogether", "Network", "NetworkProblem", "NetworkState", "graduated", "minimise_network_by_steps",
]  # fmt: skip
