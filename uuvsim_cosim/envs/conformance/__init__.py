"""Suite that checks the promises of environments, also of those of other packages.

It may import every other part of `envs`. Start reading with `suite.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from uuvsim_cosim.lazy import lazy

if TYPE_CHECKING:
    from uuvsim_cosim.envs.conformance.suite import cases, check

__all__ = [
    "cases",
    "check",
]

__getattr__, __dir__ = lazy(
    __name__,
    {
        "cases": "suite",
        "check": "suite",
    },
)
