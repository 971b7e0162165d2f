"""A connector of a system as part of an action or an observation: its limits become [-1, 1]."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["Channel"]


@dataclass(frozen=True)
class Channel:
    """What is acted on, or observed: ``Channel("allocation.tau_d[1]", -40, 40, "N")``.

    `name` is a connector by its path, one element (from 1) or a slice ("hull.eta[1:3]"). `low`
    and `high`, numbers or one for each element, in `unit`, are scaled to -1 and 1; without them
    those of the variable hold. An observation without limits is given as it is. `unit` is that of
    the variable unless given, and must be convertible to it. Angles may pass as `sin_cos`: two
    numbers in place of one, without a jump at pi.
    """

    name: str
    low: float | Sequence[float] | None = None
    high: float | Sequence[float] | None = None
    unit: str | None = None
    sin_cos: bool = False
