"""Distributions of a parameter, each defined by its quantile function.

A draw depends on one number in (0, 1) alone, so a copula can correlate the draws of any two
distributions. A distribution of a vector has fields with one number for each element.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from itertools import accumulate
from typing import Any, Self, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = [
    "Choice", "Constant", "Distribution", "LogUniform", "Normal", "Triangular", "Uniform",
]  # fmt: skip

Array = NDArray[np.float64]
Numbers = float | Sequence[float]  # one for all elements of a vector, or one for each


class Distribution(ABC):
    """Distribution of one number, or of the independent elements of a vector."""

    @abstractmethod
    def quantile(self, u: Array) -> Array:
        """Return the value that is exceeded with probability 1 - u, of the shape of `u`."""

    @property
    @abstractmethod
    def limits(self) -> tuple[float, float]:
        """The least and the greatest value; infinite for a distribution without limits."""

    @property
    def size(self) -> int | None:
        """The number of elements of the vector; None if the fields hold one number for all."""
        sizes = {len(v) for v in self._numbers().values() if isinstance(v, tuple)}
        if len(sizes) > 1:
            found = ", ".join(f"{k}: {np.size(v)}" for k, v in self._numbers().items())
            raise InputInvalid(f"{self!r}", f"fields of different lengths ({found})", "one")
        return sizes.pop() if sizes else None

    @property
    def joint(self) -> bool:
        """Whether one draw decides all elements of a vector, as whole vectors of `Choice` do."""
        return False

    def element(self, i: int) -> Self:
        """Return the distribution of element `i` of a vector, from 0."""
        own = {k: v[i] for k, v in self._numbers().items() if isinstance(v, tuple)}
        return replace(self, **own) if own else self  # type: ignore[type-var]

    @property
    def range(self) -> tuple[float, float]:
        """Finite limits; of a normal without limits, three deviations from its mean."""
        return self.limits

    def _numbers(self) -> dict[str, Numbers]:
        return {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]

    def _frozen(self, *may_be_infinite: str) -> list[Array]:
        """Keep sequences as tuples of finite floats; return all fields as arrays."""
        for name, given in self._numbers().items():
            try:
                value = np.asarray(given, dtype=float)
                whole = value.ndim <= 1 and not np.isnan(value).any()
                right = whole and (name in may_be_infinite or bool(np.isfinite(value).all()))
            except (TypeError, ValueError):
                right = False
            if not right:
                raise InputInvalid(
                    type(self).__name__,
                    f"{name} is {given!r}",
                    "a finite number, or one for each element of a vector",
                )
            object.__setattr__(
                self, name, float(value) if value.ndim == 0 else tuple(map(float, value))
            )
        _ = self.size
        return [np.asarray(v, dtype=float) for v in self._numbers().values()]

    def _must(self, holds: bool | np.bool_ | NDArray[np.bool_], expected: str) -> None:
        if not np.all(holds):
            raise InputInvalid(f"{self!r}: expected {expected}")


@final
@dataclass(frozen=True)
class Uniform(Distribution):
    """Uniform distribution in [low, high], of a number or of the elements of a vector.

    `low` and `high` are each one number, or one for each element of a vector, in the unit of the
    parameter that is drawn. Raises InputInvalid if `low` is above `high`, and for numbers that are
    not finite.

    Example:

    >>> import numpy as np
    >>> from uuvsim_cosim.envs import Uniform
    >>> mass = Uniform(12.5, 14.5)  # kg
    >>> mass.quantile(np.array([0.0, 0.5, 1.0]))
    array([12.5, 13.5, 14.5])
    >>> mass.limits, mass.range, mass.size, mass.joint
    ((12.5, 14.5), (12.5, 14.5), None, False)
    >>> drag = Uniform([-6.0, -12.0], [-4.0, -8.0])  # of two elements
    >>> drag.size, drag.element(1)
    (2, Uniform(low=-12.0, high=-8.0))
    """

    low: Numbers
    high: Numbers

    def __post_init__(self) -> None:
        """Check the order."""
        low, high = self._frozen()
        self._must(low <= high, "low not above high")

    def quantile(self, u: Array) -> Array:
        """Return low + (high - low) u."""
        low, high = self.limits
        return np.clip(low + (high - low) * u, low, high)

    @property
    def limits(self) -> tuple[float, float]:
        """Return low and high."""
        return _one(self.low), _one(self.high)


@final
@dataclass(frozen=True)
class LogUniform(Distribution):
    """Distribution whose logarithm is uniform in [ln low, ln high]."""

    low: Numbers
    high: Numbers

    def __post_init__(self) -> None:
        """Check the order and the sign."""
        low, high = self._frozen()
        self._must((low > 0) & (low <= high), "low above 0 and not above high")

    def quantile(self, u: Array) -> Array:
        """Return low (high / low)^u."""
        from scipy.special import exp2  # element by element: numpy's differs with alignment

        low, high = self.limits
        return np.clip(low * exp2(math.log2(high / low) * u), low, high)

    @property
    def limits(self) -> tuple[float, float]:
        """Return low and high."""
        return _one(self.low), _one(self.high)


@final
@dataclass(frozen=True)
class Normal(Distribution):
    """Normal distribution, conditioned on [min, max] if these are given."""

    mean: Numbers
    std: Numbers
    min: Numbers = -math.inf
    max: Numbers = math.inf

    def __post_init__(self) -> None:
        """Check the order, and that [min, max] has some probability."""
        _, std, low, high = self._frozen("min", "max")
        self._must(std >= 0, "std of at least 0")
        self._must(low < high, "min below max")
        size = self.size
        for one in [self] if size is None else [self.element(i) for i in range(size)]:
            if _one(one.std) == 0:
                self._must(_one(one.min) <= _one(one.mean) <= _one(one.max), "mean in [min, max]")
            else:
                a, b, _ = one._probabilities()
                self._must(b - a > 1e-9, "min and max that leave more than a billionth of it")

    def quantile(self, u: Array) -> Array:
        """Return the quantile of the conditioned normal, computed from the nearer tail."""
        from scipy.special import ndtri

        if _one(self.std) == 0:
            return np.full(np.shape(u), _one(self.mean))
        a, b, sign = self._probabilities()
        v = u if sign > 0 else 1.0 - u
        z = sign * ndtri(a + (b - a) * v)
        return np.asarray(np.clip(_one(self.mean) + _one(self.std) * z, *self.limits))

    def _probabilities(self) -> tuple[float, float, int]:
        """Return the probabilities of the limits; mirrored (-1) where both lie above the mean."""
        from scipy.special import ndtr

        low, high = ((x - _one(self.mean)) / _one(self.std) for x in self.limits)
        if low > 0:
            return float(ndtr(-high)), float(ndtr(-low)), -1
        return float(ndtr(low)), float(ndtr(high)), 1

    @property
    def limits(self) -> tuple[float, float]:
        """Return min and max."""
        return _one(self.min), _one(self.max)

    @property
    def range(self) -> tuple[float, float]:
        """Return min and max, or three deviations from the mean if that is nearer."""
        mean, wide = _one(self.mean), 3.0 * _one(self.std)
        low, high = max(_one(self.min), mean - wide), min(_one(self.max), mean + wide)
        return (low, high) if low < high else self.limits


@final
@dataclass(frozen=True)
class Triangular(Distribution):
    """Triangular distribution: its density rises from low to mode and falls to high."""

    low: Numbers
    mode: Numbers
    high: Numbers

    def __post_init__(self) -> None:
        """Check the order."""
        low, mode, high = self._frozen()
        self._must((low <= mode) & (mode <= high) & (low < high), "low <= mode <= high, low < high")

    def quantile(self, u: Array) -> Array:
        """Return low + sqrt(u w (mode - low)), or high - sqrt((1 - u) w (high - mode)); w whole."""
        (low, high), mode = self.limits, _one(self.mode)
        w = high - low
        rising = low + np.sqrt(u * w * (mode - low))
        falling = high - np.sqrt((1.0 - u) * w * (high - mode))
        return np.clip(np.where(u * w < mode - low, rising, falling), low, high)

    @property
    def limits(self) -> tuple[float, float]:
        """Return low and high."""
        return _one(self.low), _one(self.high)


@final
@dataclass(frozen=True)
class Choice(Distribution):
    """Discrete distribution of values, or of whole vectors, with equal or given weights."""

    values: Sequence[Any]  # numbers, or vectors
    weights: Sequence[float] | None = None

    def __post_init__(self) -> None:
        """Check values and weights."""
        try:
            values = np.asarray(self.values, dtype=float)
            right = values.ndim in (1, 2) and values.size > 0 and bool(np.isfinite(values).all())
        except (TypeError, ValueError):
            right = False
        if not right:
            raise InputInvalid(
                "Choice", f"values are {self.values!r}", "finite numbers, or vectors of one length"
            )
        kept = tuple(map(float, values)) if values.ndim == 1 else tuple(map(tuple, values.tolist()))
        object.__setattr__(self, "values", kept)
        try:
            weights = (
                np.ones(len(kept)) if self.weights is None else np.asarray(self.weights, float)
            )
            right = weights.shape == (len(kept),) and bool(np.isfinite(weights).all())
            right = right and bool((weights >= 0).all()) and float(weights.sum()) > 0
        except (TypeError, ValueError):
            right = False
        if not right:
            raise InputInvalid(
                "Choice",
                f"weights are {self.weights!r}",
                f"{len(kept)} numbers of at least 0, one for each value",
            )
        if self.weights is not None:
            object.__setattr__(self, "weights", tuple(map(float, weights)))

    @property
    def size(self) -> int | None:
        """The length of the vectors; None if numbers are chosen from."""
        return len(self.values[0]) if self.joint else None

    @property
    def joint(self) -> bool:
        """Whether whole vectors are chosen."""
        return isinstance(self.values[0], tuple)

    def element(self, i: int) -> Choice:
        """Return the choice among the elements i, with the same weights."""
        return Choice([v[i] for v in self.values], self.weights) if self.joint else self

    def quantile(self, u: Array) -> Array:
        """Return the value whose part of (0, 1) contains u."""
        if self.weights is None:
            ends = np.arange(1.0, len(self.values)) / len(self.values)
        else:  # exact sums, each rounded once
            *sums, total = map(float, accumulate(map(Fraction, self.weights)))
            ends = np.array(sums) / total
        return np.asarray(self.values, dtype=float)[np.searchsorted(ends, u, side="right")]

    @property
    def limits(self) -> tuple[float, float]:
        """The least and the greatest value."""
        return min(self.values), max(self.values)


@final
@dataclass(frozen=True)
class Constant(Distribution):
    """Constant value."""

    value: Numbers

    def __post_init__(self) -> None:
        """Check the value."""
        self._frozen()

    def quantile(self, u: Array) -> Array:
        """Return the value."""
        return np.full(np.shape(u), _one(self.value))

    @property
    def limits(self) -> tuple[float, float]:
        """The value twice."""
        return _one(self.value), _one(self.value)


def _one(value: Numbers) -> float:
    if isinstance(value, tuple):
        raise InputInvalid(value, "is of a vector", "one of its elements")
    return float(value)  # type: ignore[arg-type]
