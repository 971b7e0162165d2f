"""Margins of a loop from its frequency response, and the text that lists them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LoopMargin", "margin_of", "margin_words", "smallest"]


@dataclass(frozen=True)
class LoopMargin:
    """Margins of one loop, opened at its command: gain [1], phase [deg], crossover [rad/s].

    `gain` is the factor of the loop, nearest to 1, at which it becomes unstable: below 1, the
    gain may fall as far; infinite if no factor does. `speed` [m/s] is that of the linear model.

    Example:

    >>> from uuvsim_cosim.models.control.margins import LoopMargin
    >>> LoopMargin("yaw", 0.5, 60.0, 1.0).decibels
    6.020599913279624
    """

    axis: str
    gain: float
    phase: float
    crossover: float
    speed: float = 0.0

    @property
    def decibels(self) -> float:
        """Return the size of the gain margin [dB], up or down."""
        return float(abs(20.0 * np.log10(self.gain)))


def margin_of(
    axis: str, w: NDArray[np.float64], L: NDArray[np.complex128], speed: float = 0.0
) -> LoopMargin:
    """Return the margins of the response L (n,) at rising frequencies w (n,) [rad/s].

    Between two frequencies, L is interpolated linearly over log w. Feedback is negative.

    Example:

    >>> import numpy as np
    >>> from uuvsim_cosim.models.control.margins import margin_of
    >>> w = np.logspace(-2, 2, 2000)
    >>> s = 1j * w
    >>> m = margin_of("yaw", w, 3.0 / (s * (s + 1) * (s + 2)))
    >>> f"{m.gain:.2f} = 1 * 2 * (1 + 2) / 3"
    '2.00 = 1 * 2 * (1 + 2) / 3'
    """

    def crossings(of: NDArray[np.float64]) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
        i = np.flatnonzero(of[:-1] * of[1:] < 0)
        share = of[i] / (of[i] - of[i + 1])
        return L[i] + share * (L[i + 1] - L[i]), w[i] * (w[i + 1] / w[i]) ** share

    real = crossings(L.imag)[0].real
    factors = -1.0 / real[real < 0]
    unit, at = crossings(np.log(np.abs(L)))
    lags = np.abs(np.angle(-unit))
    least = int(np.argmin(lags)) if len(lags) else None
    return LoopMargin(
        axis,
        float(factors[np.argmin(np.abs(np.log(factors)))]) if len(factors) else np.inf,
        np.inf if least is None else float(np.degrees(lags[least])),
        np.nan if least is None else float(at[least]),
        speed,
    )


def smallest(margins: Iterable[LoopMargin]) -> tuple[float, float]:
    """Return the smallest gain margin [dB] and the smallest phase margin [deg] of any loop."""
    loops = list(margins)
    return min(m.decibels for m in loops), min(m.phase for m in loops)


def margin_words(margins: Iterable[LoopMargin]) -> list[str]:
    """Return one text for each axis, with its margins at each speed; "-" marks a gain that falls.

    Example:

    >>> from uuvsim_cosim.models.control.margins import LoopMargin, margin_words
    >>> margin_words([LoopMargin("yaw", 2.0, 50.0, 1.5)])
    ['margins of yaw: phase 50 deg, gain 6.0 dB, crossover 1.5 rad/s']
    """
    of_axis: dict[str, list[LoopMargin]] = {}
    for m in margins:
        of_axis.setdefault(m.axis, []).append(m)
    words = []
    for axis, loops in of_axis.items():
        speeds = ", ".join(f"{m.speed:.2g}" for m in loops if m.speed)
        gains = ", ".join(f"{20.0 * np.log10(m.gain):.1f}" for m in loops)
        words.append(
            f"margins of {axis}{f' at {speeds} m/s' if speeds else ''}: "
            f"phase {', '.join(f'{m.phase:.0f}' for m in loops)} deg, gain {gains} dB, "
            f"crossover {', '.join(f'{m.crossover:.2g}' for m in loops)} rad/s"
        )
    return words
