"""Work on the machines of a Ray cluster.

It may import errors of this package only. Start reading with `ray_cluster.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from uuvsim_cosim.lazy import lazy

if TYPE_CHECKING:
    from uuvsim_cosim.cluster.ray_cluster import Cluster

__all__ = [
    "Cluster",
]

__getattr__, __dir__ = lazy(
    __name__,
    {
        "Cluster": "ray_cluster",
    },
)
