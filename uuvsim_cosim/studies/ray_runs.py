"""Runs simulated by the free workers of a Ray cluster."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, final

from uuvsim_cosim.cluster.ray_cluster import Cluster
from uuvsim_cosim.studies.simulate_runs import (
    KernelRuns,
    MasterRuns,
    Outcome,
    Script,
    Simulated,
    Starts,
)

if TYPE_CHECKING:
    from ray import ObjectRef

__all__ = ["RayRuns", "ray_runs"]

IN_FLIGHT = 2  # requests for each CPU: one is worked on, one waits

_made: dict[tuple[str, str, int], Simulated] = {}  # of a worker's process


def ray_runs(
    cluster: Cluster, script: Script, by: Literal["kernel", "master"], n: int
) -> list[Simulated]:
    """Return enough simulators to keep the cluster busy; a kernel's batch has `n` places."""
    content = pickle.dumps(script)
    key = (hashlib.blake2b(content, digest_size=16).hexdigest(), by, n)
    kept = cluster.put(content)
    return [RayRuns(cluster, key, kept) for _ in range(IN_FLIGHT * max(cluster.cpus, 1))]


@final
class RayRuns:
    """One request at a time to the cluster; a run depends on seed and start values only."""

    def __init__(self, cluster: Cluster, key: tuple[str, str, int], kept: ObjectRef) -> None:
        self._cluster, self._key, self._kept = cluster, key, [kept]

    def runs(self, seeds: Sequence[int], start: Starts) -> list[Outcome]:
        """Simulate runs on the cluster."""
        return self._cluster.call(_runs, self._key, self._kept, list(seeds), dict(start))

    def close(self) -> None:
        """Do nothing: the cluster ends its own work."""


def _runs(
    key: tuple[str, str, int], kept: list[ObjectRef], seeds: list[int], start: Starts
) -> list[Outcome]:
    """Simulate in a worker, which keeps its kernel or master for the next call."""
    if key not in _made:
        import ray

        script: Script = pickle.loads(ray.get(kept[0]))
        _, by, n = key
        for other in list(_made):  # one at a time: a kernel's batch may fill the memory
            _made.pop(other).close()
        _made[key] = KernelRuns(script, n, 1) if by == "kernel" else MasterRuns(script)
    return _made[key].runs(seeds, start)
