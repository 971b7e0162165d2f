"""`--ray ADDRESS` of a command: the cluster that it names, or none where it is not given."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.cluster.ray_cluster import Cluster

__all__ = ["RAY", "clustered"]

RAY = "A Ray cluster: HOST:PORT, ray://HOST:PORT, auto or local."


@contextmanager
def clustered(
    address: str | None, jobs: int | None = None, *, alike: tuple[str, ...] = ()
) -> Iterator[Cluster | None]:
    """Connect for as long as it is entered; `jobs` are the workers of a local cluster."""
    if address is None:
        yield None
        return
    if jobs is not None and address != "local":
        raise InputInvalid(
            f"--jobs {jobs} with --ray {address}: the cluster says how many", "one of them"
        )
    from uuvsim_cosim.cluster.ray_cluster import Cluster

    with Cluster(address, workers=jobs, alike=alike) as cluster:
        yield cluster
