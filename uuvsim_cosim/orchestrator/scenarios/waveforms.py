"""Test signals by name: step, chirp and PRBS, as functions of time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.units import frequency_of, seconds_of

__all__ = ["KINDS", "Waveform", "waveform"]

# Names and defaults of each waveform's parameters; those without a default are required.
KINDS: dict[str, dict[str, str | None]] = {
    "step": {"value": None, "at": "0", "until": "inf"},
    "chirp": {"amplitude": None, "from": None, "to": None, "at": "0", "until": None},
    "prbs": {"amplitude": None, "hold": None, "order": "7", "seed": "1", "at": "0", "until": "inf"},
}


@dataclass(frozen=True)
class Waveform:
    """Function of time: size · shape(t - at) in [at, until), 0 outside.

    `size` is the text of its value or amplitude, with or without a unit; `shape` is within [-1, 1].
    """

    kind: str
    size: str
    at: float  # s
    until: float  # s
    shape: Callable[[float], float]

    def of(self, t: float) -> float:
        """Return the value at a time [s], as a multiple of the size."""
        return self.shape(t - self.at) if self.at <= t < self.until else 0.0


def waveform(text: str, place: str) -> Waveform:
    """Read a waveform such as ``chirp,amplitude=5,from=0.01,to=1,at=10,until=60``.

    - step: `value` from `at` on.
    - chirp: a sine of `amplitude` whose frequency grows linearly from `from` to `to` [Hz] between
      `at` and `until`.
    - prbs: plus or minus `amplitude`, held for `hold` [s], in the order of a maximum-length
      sequence of 2^order - 1 bits (shift register with start state `seed`); repeated.

    Times are in s, frequencies in Hz, or carry a unit. Raises InputInvalid that names `place`.
    """
    kind, *items = (part.strip() for part in text.split(","))
    if kind not in KINDS:
        raise InputInvalid(place, f"{kind!r}", f"one of {', '.join(KINDS)}")
    known = KINDS[kind]
    expected = ",".join(
        (kind, *(f"{k}=…" if v is None else f"[{k}={v}]" for k, v in known.items()))
    )
    found: dict[str, str] = {}
    for item in items:
        key, equals, value = (part.strip() for part in item.partition("="))
        if key not in known or not equals or not value or key in found:
            raise InputInvalid(place, f"{item!r}", expected)
        found[key] = value
    missing = [key for key, default in known.items() if default is None and key not in found]
    if missing:
        raise InputInvalid(place, f"without {', '.join(missing)}", expected)
    given = {**{k: v for k, v in known.items() if v is not None}, **found}
    at, until = (seconds_of(given[key], f"{place}: {key}") for key in ("at", "until"))
    if not (0 <= at < math.inf and until > at):
        raise InputInvalid(place, f"at={given['at']}, until={given['until']}", "0 <= at < until")
    if kind == "step":
        return Waveform(kind, given["value"], at, until, lambda t: 1.0)
    if kind == "chirp":
        first, last = (frequency_of(given[key], f"{place}: {key}") for key in ("from", "to"))
        if math.isinf(until) or min(first, last) < 0:
            raise InputInvalid(f"{place}: expected until in s, and frequencies of 0 Hz or more")
        # The chirp is sin(2 pi (f0 t + (f1 - f0) t^2 / (2 T))).
        rate = (last - first) / (2.0 * (until - at))
        return Waveform(
            kind, given["amplitude"], at, until,
            lambda t: math.sin(2.0 * math.pi * (first * t + rate * t * t)),
        )  # fmt: skip
    hold = seconds_of(given["hold"], f"{place}: hold")
    for key in ("order", "seed"):
        if not given[key].isdecimal():
            raise InputInvalid(place, f"{key}: {given[key]!r}", "a whole number")
    order, seed = int(given["order"]), int(given["seed"])
    if not (0 < hold < math.inf and 2 <= order <= 20 and 0 < seed < 2**order):
        raise InputInvalid(
            place,
            f"hold={given['hold']}, order={order}, seed={seed}",
            "hold > 0 s, order from 2 to 20, and seed from 1 to 2^order - 1",
        )
    from scipy.signal import max_len_seq

    state = np.array([seed >> k & 1 for k in range(order)], dtype=np.int8)
    bits = 2.0 * max_len_seq(order, state=state)[0].astype(float) - 1.0
    return Waveform(
        kind, given["amplitude"], at, until,
        # A tick that is equal to the time of a change within rounding belongs to the new bit.
        lambda t: float(bits[math.floor(t / hold + 1e-9) % len(bits)]),
    )  # fmt: skip
