"""Moments made of arrays, for tests of tasks without a system under them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass
class ArrayMoment:
    """The Moment protocol over a dictionary of signals."""

    signals: Mapping[str, Array]
    action: Mapping[str, Array] = field(default_factory=dict)
    start: Mapping[str, Array] = field(default_factory=dict)
    earlier: ArrayMoment | None = None
    step: Any = 0

    @property
    def n(self) -> int:
        return len(next(iter(self.signals.values())))

    @property
    def time(self) -> Array:
        return np.zeros(self.n)

    @property
    def before(self) -> ArrayMoment:
        return self if self.earlier is None else self.earlier

    def __getitem__(self, name: str) -> Array:
        return self.signals[name]

    def rows(self, chosen: Any) -> ArrayMoment:
        """Return the moment of some of the environments."""
        return ArrayMoment(
            {k: v[chosen] for k, v in self.signals.items()},
            {k: v[chosen] for k, v in self.action.items()},
            {k: v[chosen] for k, v in self.start.items()},
            None if self.earlier is None else self.earlier.rows(chosen),
        )
