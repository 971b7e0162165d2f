"""Outliers of a recording: single samples that no motion explains, and large residuals of a fit.

A spike is one to three samples in a row that are far from the samples before and after them, to
the same side. Its robust z is the smaller one of the two steps, over the usual step from sample to
sample (1.4826 times the median, and at least `floor`). A step of a motion leads to other samples
nearby, so it is no spike.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["pulses", "residual_outliers", "spike_remark", "spikes"]

Array = NDArray[np.float64]
_LONGEST = 3  # samples
_SPIKE = 50.0  # robust z; motions of real dives reach 35
_RESIDUAL = 8.0  # robust z; in 100,000 normal residuals, one beyond 4.4 is expected
_TURN = 7.0  # rad: a jump of an angle by more is no full turn
_PULSE = 100.0  # times the size that 99 % of an input's samples have
_SHOWN = 3
_ROBUST = "--residuals robust widens intervals and does not lower the weight of single samples"


def spikes(values: Array, floor: float, *, angle: bool = False) -> Array:
    """Return the robust z (n,) of the samples (n,) that are spikes, 0 for others.

    NaN are no samples. Angles [rad] may jump by whole turns.
    """
    z = np.zeros(len(values))
    good = np.flatnonzero(np.isfinite(values))
    if len(good) < 2 * _LONGEST + 3:
        return z
    v = values[good]

    def between(a: Array, b: Array) -> Array:
        d = b - a
        turns = np.where(np.abs(d) < _TURN, np.rint(d / (2.0 * np.pi)), 0.0)
        return d - 2.0 * np.pi * turns if angle else d

    usual = max(1.4826 * float(np.median(np.abs(between(v[:-1], v[1:])))), floor)
    found = np.zeros(len(v))
    for length in range(1, _LONGEST + 1):
        first = np.arange(1, len(v) - length)
        up = between(v[first - 1], v[first])
        down = between(v[first + length], v[first + length - 1])
        across = np.abs(between(v[first - 1], v[first + length]))
        size = np.where(up * down > 0.0, np.minimum(np.abs(up), np.abs(down)), 0.0) - across
        for k in np.flatnonzero(size > _SPIKE * usual).tolist():
            inside = slice(k + 1, k + 1 + length)
            found[inside] = np.maximum(found[inside], size[k] / usual)
    z[good] = found
    return z


def spike_remark(name: str, t: Array, values: Array, z: Array) -> str:
    """Return a remark on the spikes of a signal that are left out: how many, where, how large."""
    places = np.flatnonzero(z)
    first = places[np.argsort(-z[places], kind="stable")[:_SHOWN]].tolist()
    shown = ", ".join(f"{values[k]:.4g} at {t[k]:.3f} s (robust z {z[k]:.3g})" for k in first)
    more = ", …" if len(places) > _SHOWN else ""
    count = "1 outlier" if len(places) == 1 else f"{len(places)} outliers"
    return f"{count} of {name} left out of the fit: {shown}{more}; {_ROBUST}"


def pulses(name: str, t: Array, values: Array) -> list[str]:
    """Return a remark on samples (n,) of an input that are far beyond all others."""
    size = np.abs(np.nan_to_num(values))
    usual = float(np.quantile(size[size > 0], 0.99)) if np.any(size > 0) else 0.0
    far = np.flatnonzero(size > _PULSE * usual)
    if not len(far):
        return []
    k = int(far[np.argmax(size[far])])
    return [
        f"{len(far)} of {len(values)} samples of {name} are more than {_PULSE:g} times as large as "
        f"99 % of them: {values[k]:.4g} at {t[k]:.3f} s; they are used as recorded"
    ]


def residual_outliers(names: Sequence[str], residuals: Iterable[Array], times: Array) -> list[str]:
    """Return a remark for each signal on residuals (n,) far beyond the others, at times (n,)."""
    found = []
    for name, r in zip(names, residuals, strict=True):
        good = np.flatnonzero(np.isfinite(r))
        if len(good) < 20:
            continue
        middle = float(np.median(r[good]))
        spread = 1.4826 * float(np.median(np.abs(r[good] - middle)))
        z = np.abs(r[good] - middle) / max(spread, 1e-300)
        far = np.flatnonzero(z > _RESIDUAL)
        if not len(far):
            continue
        largest = far[np.argsort(-z[far], kind="stable")[:_SHOWN]]
        shown = ", ".join(f"{times[good[k]]:.3f} s ({z[k]:.3g})" for k in largest.tolist())
        more = ", …" if len(far) > _SHOWN else ""
        found.append(
            f"{len(far)} of {len(good)} residuals of {name} are outliers (robust z above "
            f"{_RESIDUAL:g}): at {shown}{more}; they count in full, and {_ROBUST}: look at them, "
            "and leave them out by --from and --to if the sensor is wrong"
        )
    return found
