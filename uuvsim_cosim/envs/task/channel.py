"""Channel: a connector of a system as part of an action or an observation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["Channel"]


@dataclass(frozen=True)
class Channel:
    """A connector in an action or an observation: ``Channel("allocation.tau_d[1]", -40, 40, "N")``.

    `name` is the path of a connector, one element (from 1) or a slice ("hull.eta[1:3]"). `low` and
    `high`, one number for all elements or one for each, in `unit`, are scaled to -1 and 1; the
    default are the limits of the variable. An observation without limits is not scaled. `unit` is
    by default that of the variable, and must be convertible to it. With `sin_cos`, an angle is
    observed as sine and cosine, without a jump at pi.
    """

    name: str
    low: float | Sequence[float] | None = None
    high: float | Sequence[float] | None = None
    unit: str | None = None
    sin_cos: bool = False
