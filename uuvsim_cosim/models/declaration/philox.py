"""Random draws as the C runtime makes them: equal integers, normals equal except for libm.

Philox4x32-10 (Salmon et al., SC '11) of key = the two seeds and counter = (variable, sample's low
and high word, block); Box-Muller makes draws 2 b and 2 b + 1 of block b. The same in C is
`fmus/runtime/math/uuv_random.h`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, log, pi, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["WORD", "normals", "philox"]

WORD = 0xFFFFFFFF


def philox(counter: Sequence[Any], key: Sequence[Any]) -> tuple[Any, Any, Any, Any]:
    """Return the four random words of a counter of four words and a key of two.

    Words are whole numbers, or arrays of uint64 that hold 32 bits each.
    """
    c0, c1, c2, c3 = counter
    k0, k1 = key
    for _ in range(10):
        a, b = c0 * 0xD2511F53, c2 * 0xCD9E8D57
        c0, c1, c2, c3 = b >> 32 ^ c1 ^ k0, b & WORD, a >> 32 ^ c3 ^ k1, a & WORD
        k0, k1 = k0 + 0x9E3779B9 & WORD, k1 + 0xBB67AE85 & WORD
    return c0, c1, c2, c3


def normals(seed: NDArray[np.float64], clock: int, sample: int, size: int) -> NDArray[np.float64]:
    """Return `size` standard normals that depend on (seed, clock, sample) alone."""
    key = [int(s) & WORD for s in seed]
    draws: list[float] = []
    for block in range((size + 1) // 2):
        words = philox((clock, sample & WORD, sample >> 32, block), key)
        radius = sqrt(-2.0 * log(_uniform(words[0], words[1])))
        turn = 2.0 * pi * _uniform(words[2], words[3])
        draws += [radius * cos(turn), radius * sin(turn)]
    return np.array(draws[:size])


def _uniform(high: int, low: int) -> float:
    """Return (m + 1/2) 2^-52 of the upper 52 bits m: within (0, 1)."""
    return ((high << 20 | low >> 12) + 0.5) * 2.0**-52
